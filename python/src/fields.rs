//! Velocity fields.

use std::sync::Arc;

use flows::eulerian::{central, forward};
use flows::registry;
use flows::scale::ImageVector;
use glam::DVec3;
use numpy::{PyArray1, PyArray2, PyArray3, PyArrayMethods, PyReadonlyArray2};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use rayon::prelude::*;
use scenario::Scenario;

use crate::dataset::ScenarioText;
use crate::object::Object;
use crate::run::{OnInterrupt, raise, run};

/// Number of points that a thread processes at a time.
const POINTS: usize = 256;

/// The velocity field of a scenario.
#[pyclass(frozen, module = "microsig._microsig")]
pub(crate) struct FlowField(Arc<Scenario>);

fn points(given: &PyReadonlyArray2<'_, f64>) -> PyResult<Vec<DVec3>> {
    let given = given.as_array();
    let [n, axes] = [given.shape()[0], given.shape()[1]];
    if axes != 3 {
        return Err(PyValueError::new_err(format!("points of shape ({n}, {axes}): expected (n, 3), in um")));
    }
    Ok(given.rows().into_iter().map(|row| DVec3::new(row[0], row[1], row[2])).collect())
}

impl FlowField {
    /// Values for every point.
    fn of_points<const N: usize>(
        &self,
        py: Python<'_>,
        points: Vec<DVec3>,
        of: impl Fn(&dyn flows::VelocityField, DVec3) -> storage::Result<[f64; N]> + Send + Sync + 'static,
    ) -> PyResult<Vec<f64>> {
        let scenario = Arc::clone(&self.0);
        run(py, false, OnInterrupt::Leave, move |progress| {
            let Some(field) = scenario.field() else {
                return Err(storage::Error::input("recorded tracks have no velocity field"));
            };
            let all: Vec<[f64; N]> = points
                .par_iter()
                .with_min_len(POINTS)
                .map(|point| {
                    progress.check()?;
                    of(field, *point)
                })
                .collect::<storage::Result<_>>()?;
            Ok(all.into_iter().flatten().collect())
        })
    }
}

#[pymethods]
impl FlowField {
    /// Velocities (um/s) at points (um), (n, 3), and a time (s).
    fn velocity<'py>(
        &self,
        py: Python<'py>,
        at: PyReadonlyArray2<'py, f64>,
        t_s: f64,
    ) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let at = points(&at)?;
        let n = at.len();
        let found = self.of_points(py, at, move |field, x| Ok(field.velocity(x, t_s).to_array()))?;
        PyArray1::from_vec(py, found).reshape([n, 3])
    }

    /// Velocity gradients (1/s), (n, 3, 3): `[:, i, j]` is the derivative of component i along axis j.
    fn gradient<'py>(
        &self,
        py: Python<'py>,
        at: PyReadonlyArray2<'py, f64>,
        t_s: f64,
    ) -> PyResult<Bound<'py, PyArray3<f64>>> {
        let at = points(&at)?;
        let n = at.len();
        // glam stores columns.
        let gradient =
            move |field: &dyn flows::VelocityField, x| Ok(field.gradient(x, t_s).transpose().to_cols_array());
        let found = self.of_points::<9>(py, at, gradient)?;
        PyArray1::from_vec(py, found).reshape([n, 3, 3])
    }

    /// Displacements (um) of fluid elements from the first to the second time, given their positions at the
    /// first time or half-way.
    fn displacement<'py>(
        &self,
        py: Python<'py>,
        at: PyReadonlyArray2<'py, f64>,
        t0_s: f64,
        t1_s: f64,
        halfway: bool,
    ) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let at = points(&at)?;
        let n = at.len();
        let found = self.of_points(py, at, move |field, x| {
            let along =
                if halfway { central(field, x, (t0_s, t1_s)) } else { forward(field, x, (t0_s, t1_s)) };
            Ok(along?.to_array())
        })?;
        PyArray1::from_vec(py, found).reshape([n, 3])
    }

    /// Whether the velocity does not depend on time.
    fn is_steady(&self) -> bool {
        self.0.field().is_some_and(flows::VelocityField::is_steady)
    }

    /// The scenario of the field.
    fn scenario(&self) -> PyResult<Object> {
        Object::of(&self.0.spec).map_err(raise)
    }

    /// A displacement (um) as seen in the image, px.
    fn displacement_px(&self, dx_um: f64, dy_um: f64) -> (f64, f64) {
        let ImageVector { dx_px, dy_px, .. } =
            self.0.scale.displacement_to_image(DVec3::new(dx_um, dy_um, 0.0));
        (dx_px, dy_px)
    }
}

/// The velocity field of a scenario.
#[pyfunction]
pub(crate) fn field(py: Python<'_>, text: ScenarioText) -> PyResult<FlowField> {
    Ok(FlowField(run(py, false, OnInterrupt::Leave, move |_| text.resolve().map(Arc::new))?))
}

/// An available field: name, formula, source, and name, default, range and meaning of its parameters.
type Offer = (String, String, String, Vec<(String, String, String, String)>);

/// The available fields.
#[pyfunction]
pub(crate) fn fields() -> Vec<Offer> {
    let parameter = |p: &flows::params::Parameter| {
        (p.name.to_owned(), p.default_text(), p.allowed(), p.meaning().to_owned())
    };
    let of = |entry: &registry::FieldEntry| {
        let parameters = entry.parameters.iter().map(parameter).collect();
        (entry.name.to_owned(), entry.formula.to_owned(), entry.source.to_owned(), parameters)
    };
    registry::ENTRIES.iter().map(of).collect()
}
