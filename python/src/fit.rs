//! Fits of microscopes.

use std::path::PathBuf;
use std::sync::Arc;

use bench::fitting::{FitFolder, FittedScan, read_places};
use fit::{Astigmatic, ExtraParameter, FitOptions, Given, Scan, StagePositions, WaveModel};
use microsig_core::render::waves::{Emission, Layers};
use numpy::PyReadonlyArray3;
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

use crate::object::Object;
use crate::run::{OnInterrupt, Show, raise, run};
use crate::scores::one_of;

/// Options of a fit.
#[derive(Debug, Clone, FromPyObject)]
#[pyo3(from_item_all)]
pub(crate) struct How {
    magnification: f64,
    pixel_size_um: f64,
    z_step_um: Option<f64>,
    /// +1: away from the lens, -1: toward it.
    direction: Option<f64>,
    depth_factor: f64,
    medium: f64,
    diameter_um: Option<f64>,
    particles: Option<Places>,
    astigmatic: Option<bool>,
    free_flux: bool,
    free: Vec<String>,
    wavelength_um: Option<f64>,
    emission: String,
    fluid: Option<f64>,
    fluid_depth_um: Option<f64>,
    field: bool,
    page: Option<usize>,
    planes: Option<(usize, usize)>,
    window_px: Option<usize>,
    bootstrap: usize,
    seed: u64,
}

/// Positions of particles: a table, or (x, y) of each, px.
#[derive(Debug, Clone, FromPyObject)]
pub(crate) enum Places {
    File(PathBuf),
    Given(Vec<[f64; 2]>),
}

/// Stage positions of planes: a table, or a position for each, um.
#[derive(FromPyObject)]
pub(crate) enum Positions {
    File(PathBuf),
    Given(Vec<f64>),
}

/// A scan: its file or folder, or images (planes, rows, columns).
#[derive(FromPyObject)]
pub(crate) enum Images<'py> {
    File(PathBuf),
    Bytes(PyReadonlyArray3<'py, u8>),
    Words(PyReadonlyArray3<'py, u16>),
}

impl Images<'_> {
    /// Height, width, counts of each plane and the largest count of their type.
    fn planes(&self) -> Option<([usize; 2], Vec<Vec<u16>>, u16)> {
        match self {
            Images::File(_) => None,
            Images::Bytes(of) => {
                let of = of.as_array();
                let plane =
                    |plane: numpy::ndarray::ArrayView2<'_, u8>| plane.iter().map(|c| u16::from(*c)).collect();
                Some(([of.dim().1, of.dim().2], of.outer_iter().map(plane).collect(), 255))
            }
            Images::Words(of) => {
                let of = of.as_array();
                let plane = |plane: numpy::ndarray::ArrayView2<'_, u16>| plane.iter().copied().collect();
                Some(([of.dim().1, of.dim().2], of.outer_iter().map(plane).collect(), u16::MAX))
            }
        }
    }
}

impl How {
    fn options(&self) -> storage::Result<FitOptions> {
        let free = self.free.iter().map(|name| one_of::<ExtraParameter>("free", name));
        let emission = one_of::<Emission>("emission", &self.emission)?;
        let layers = self.fluid.map(|n_s| {
            let layers = Layers::default();
            Layers { n_s, focus_depth_um: self.fluid_depth_um.unwrap_or(layers.focus_depth_um), ..layers }
        });
        Ok(FitOptions {
            given: Given::new(self.magnification, self.pixel_size_um, self.medium, self.depth_factor),
            diameter_um: self.diameter_um,
            direction: self.direction,
            astigmatic: self.astigmatic.map_or(Astigmatic::Auto, Astigmatic::Known),
            free_flux: self.free_flux,
            half_window: self.window_px.map(|width| width / 2),
            places_px: match &self.particles {
                None => None,
                Some(Places::File(path)) => Some(read_places(&path.into())?),
                Some(Places::Given(places)) => Some(places.clone()),
            },
            waves: self.wavelength_um.map(|wavelength_um| WaveModel { wavelength_um, emission, layers }),
            free: free.collect::<storage::Result<_>>()?,
            bootstrap: self.bootstrap,
            seed: self.seed,
        })
    }
}

/// A fit, and the name of its scan.
#[pyclass(frozen, module = "microsig._microsig")]
pub(crate) struct FittedMicroscope {
    made: Arc<FittedScan>,
    scan: String,
    /// About the positions of planes and the folder.
    warnings: Vec<String>,
}

#[pymethods]
impl FittedMicroscope {
    /// The result, as in `fit.json` or `field.json`.
    fn result(&self) -> PyResult<Object> {
        self.made.result().map(Object).map_err(raise)
    }

    /// The result as the command prints it.
    fn text(&self) -> String {
        self.made.text()
    }

    /// What should be known.
    fn warnings(&self) -> Vec<String> {
        self.warnings.iter().chain(self.made.warnings()).cloned().chain(self.made.failure()).collect()
    }

    /// A text file of the fit, such as `scenario.ron`.
    fn file(&self, name: &str) -> PyResult<String> {
        let found = self.made.files().iter().find(|(file, _)| *file == name);
        let (_, bytes) = found.ok_or_else(|| PyValueError::new_err(format!("a fit has no file {name}")))?;
        Ok(String::from_utf8_lossy(bytes).into_owned())
    }

    /// Writes the report and the files into a folder; gives a warning about it.
    fn save(&self, py: Python<'_>, out: PathBuf, force: bool) -> PyResult<Option<String>> {
        let (made, scan) = (Arc::clone(&self.made), self.scan.clone());
        let is_of_waves = matches!(*made, FittedScan::Waves { .. });
        run(py, false, OnInterrupt::Wait, move |_| {
            let folder = FitFolder::start(&out, is_of_waves, force)?;
            let warning = folder.warning().map(str::to_owned);
            folder.finish(&made, &scan, &out)?;
            Ok(warning)
        })
    }
}

/// Fits a scan. With `out`, the folder is checked before the fit, and written after it.
#[pyfunction]
pub(crate) fn fit_scan(
    py: Python<'_>,
    scan: Images<'_>,
    z: Option<Positions>,
    how: How,
    out: Option<(PathBuf, bool)>,
    show: Show<'_>,
) -> PyResult<FittedMicroscope> {
    let planes = scan.planes();
    let file = if let Images::File(path) = scan { Some(path) } else { None };
    run(py, show, OnInterrupt::Wait, move |progress| {
        let options = how.options()?;
        FittedScan::check(&options, how.field)?;
        let name = file.as_ref().map_or("scan".to_owned(), |path| path.display().to_string());
        let positions = match (z, how.z_step_um) {
            (Some(Positions::File(path)), _) => StagePositions::Table(path.into()),
            (Some(Positions::Given(z_um)), _) => StagePositions::Given(z_um),
            (None, Some(step)) => StagePositions::Step(step),
            (None, None) => StagePositions::FromFile,
        };
        let mut scan = match (file, planes) {
            (Some(path), _) => Scan::read(&path, &positions, how.page)?,
            (None, Some(_)) if how.page.is_some() => {
                return Err(storage::Error::input("page: expected with a file or folder"));
            }
            (None, Some(([height, width], planes, full_scale))) => {
                let stage_um = positions.of_planes(planes.len())?;
                Scan::new((width, height), planes, stage_um, full_scale)?
            }
            (None, None) => return Err(storage::Error::input("scan: expected images")),
        };
        if let Some((first, last)) = how.planes {
            scan = scan.cut(first, last)?;
        }
        let folder = out
            .map(|(out, force)| {
                FitFolder::start(&out, options.waves.is_some(), force).map(|folder| (folder, out))
            })
            .transpose()?;
        let mut warnings: Vec<String> = options.warning().into_iter().collect();
        warnings.extend(folder.iter().filter_map(|(folder, _)| folder.warning().map(str::to_owned)));
        let made = FittedScan::of(&scan, &options, how.field, progress)?;
        if let Some((folder, out)) = folder {
            folder.finish(&made, &name, &out)?;
        }
        Ok(FittedMicroscope { made: Arc::new(made), scan: name, warnings })
    })
}
