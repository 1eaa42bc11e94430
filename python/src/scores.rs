//! Trackers and scores.

use std::path::PathBuf;
use std::sync::Arc;

use arena::report;
use pyo3::exceptions::{PyIndexError, PyValueError};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use scenario::{self, Literal, Sweep, resolve};
use scoring::evaluate::gate::Shape;
use scoring::evaluate::{EvaluateOptions, Hint, Score, Truth, UnitScores, evaluate_files, evaluate_source};
use scoring::results::{Conventions, Format, LengthUnit, Origin, PairChoice, Source};
use storage::InputFile;
use storage::argument::{Variants, variant};
use storage::dataset::{Columns, DatasetPlace};
use tracking::{AspectRatio, METHODS, ParticleShape, TrackOptions, result};

use crate::columns::{self, arrays, columns};
use crate::dataset::{Made, Place};
use crate::object::Object;
use crate::run::{OnInterrupt, Show, raise, run};
use crate::tables;

/// Options of scoring; numbers are within their ranges.
#[derive(Debug, Clone, FromPyObject)]
#[pyo3(from_item_all)]
pub(crate) struct How {
    format: Option<String>,
    gate: Option<String>,
    gate_xy_px: Option<f64>,
    gate_z_um: Option<f64>,
    dims: Option<u8>,
    isbi_gate_px: Option<f64>,
    border_px: f64,
    origin: Option<String>,
    unit: Option<String>,
    y_up: Option<bool>,
    shift_px: (f64, f64),
    frame_base: Option<i64>,
    um_per_px: Option<f64>,
    dt_s: Option<f64>,
    pair: Option<String>,
    depth_um: Option<(f64, f64)>,
    plane_um: Option<f64>,
    auto_offset: bool,
    crlb: bool,
    seed: u64,
}

/// The value of an option that has a few.
pub(crate) fn one_of<T: Variants>(name: &str, given: &str) -> storage::Result<T> {
    variant(given).map_err(|expected| storage::Error::input(format!("{name} = {given:?}: {expected}")))
}

/// [`one_of`] for an option that may be missing.
fn optional<T: Variants>(name: &str, given: Option<&String>) -> storage::Result<Option<T>> {
    given.map(|given| one_of(name, given)).transpose()
}

fn optional_pair(given: Option<&str>) -> storage::Result<Option<PairChoice>> {
    let wrong = |expected| storage::Error::input(format!("pair: {expected}"));
    given.map(|given| given.parse().map_err(wrong)).transpose()
}

impl How {
    fn options(&self) -> storage::Result<EvaluateOptions> {
        Ok(EvaluateOptions {
            conventions: Conventions {
                format: optional::<Format>("format", self.format.as_ref())?,
                origin: optional::<Origin>("origin", self.origin.as_ref())?,
                unit: optional::<LengthUnit>("unit", self.unit.as_ref())?,
                y_up: self.y_up,
                shift_px: self.shift_px.into(),
                frame_base: self.frame_base,
                um_per_px: self.um_per_px,
                dt_s: self.dt_s,
                pair: optional_pair(self.pair.as_deref())?,
                depth_um: self.depth_um,
                ..Conventions::default()
            },
            shape: optional::<Shape>("gate", self.gate.as_ref())?,
            gate_xy_px: self.gate_xy_px,
            gate_z_um: self.gate_z_um,
            dims: self.dims,
            isbi_gate_px: self.isbi_gate_px,
            border_px: self.border_px,
            plane_um: self.plane_um,
            auto_offset: self.auto_offset,
            crlb: self.crlb,
            seed: self.seed,
            context: tables::context(),
        })
    }
}

/// Where a result is: its path, or the columns of a table.
#[derive(FromPyObject)]
pub(crate) enum Given<'py> {
    File(PathBuf),
    Columns(Vec<(String, columns::Given<'py>)>),
}

/// A scored result.
#[pyclass(frozen, module = "microsig._microsig")]
pub(crate) struct Scored {
    score: Score,
    /// Input of paired comparisons.
    units: Arc<UnitScores>,
}

#[pymethods]
impl Scored {
    /// All scores, as in `score.json`; hints name the arguments of Python.
    fn scores(&self) -> PyResult<Object> {
        Object::of(&self.in_python()).map_err(raise)
    }

    /// The bytes of `score.json`.
    fn json(&self) -> PyResult<String> {
        report::json(&self.score).map_err(raise)
    }

    /// The command's table.
    fn table(&self) -> String {
        report::table(&self.in_python())
    }

    /// For pickle.
    fn __reduce__(slf: &Bound<'_, Self>) -> PyResult<(Py<PyAny>, (String, String))> {
        let units = report::units_json(&slf.get().units).map_err(raise)?;
        Ok((slf.get_type().getattr("of_files")?.unbind(), (slf.get().json()?, units)))
    }

    /// From the bytes of `score.json` and `units.json`.
    #[staticmethod]
    fn of_files(score: &str, units: &str) -> PyResult<Self> {
        let score = report::parse_score(score).map_err(|problems| raise(storage::Error::Input(problems)))?;
        let units = report::parse_units(units).map_err(|problem| raise(storage::Error::input(problem)))?;
        Ok(Scored { score, units: Arc::new(units) })
    }
}

impl Scored {
    fn in_python(&self) -> Score {
        let hints = self.score.hints.iter().cloned().map(Hint::in_python).collect();
        Score { hints, ..self.score.clone() }
    }
}

/// Scores a result against the truth of a dataset.
#[pyfunction]
pub(crate) fn evaluate(py: Python<'_>, dataset: Place, result: Given<'_>, how: How) -> PyResult<Scored> {
    let (file, table) = match result {
        Given::File(path) => (Some(path), Columns::default()),
        Given::Columns(given) => (None, columns(given)),
    };
    run(py, false, OnInterrupt::Leave, move |_| {
        let options = how.options()?;
        let truth = |is_field| match &dataset {
            Place::Memory(made) => {
                let made = &*made.get().0;
                Truth::from_memory(made, made.scenario(), is_field, &options)
            }
            Place::Folder(path) => Truth::read(path, is_field, &options),
        };
        let evaluation = match (&dataset, &file) {
            (Place::Folder(dataset), Some(file)) => evaluate_files(dataset, file, &options)?,
            (_, Some(file)) => evaluate_source(truth, Source::at(file.into())?, &options)?,
            (_, None) => evaluate_source(truth, Source::Columns(table), &options)?,
        };
        Ok(Scored { score: evaluation.score, units: Arc::new(evaluation.units) })
    })
}

/// The leaderboard of several scores by the names of their trackers: its entries, warnings, text.
#[pyfunction]
pub(crate) fn compare(
    py: Python<'_>,
    scores: Vec<(String, Py<Scored>)>,
) -> PyResult<(Object, Vec<String>, String)> {
    run(py, false, OnInterrupt::Leave, move |_| {
        let named = scores.into_iter().map(|(name, scored)| {
            let Scored { score, units } = scored.get();
            report::Named { tracker: name.clone(), name, score: score.clone(), units: Some(units.clone()) }
        });
        let ranking = report::ranking(named.collect())?;
        Ok((Object::of(&ranking.entries)?, ranking.warnings, ranking.text))
    })
}

/// An aspect ratio: a number, or `common` or `each`.
#[derive(FromPyObject)]
pub(crate) enum Aspect {
    Given(f64),
    Named(String),
}

/// Tracks a dataset by options within their ranges; gives the columns of the result and the warnings.
#[pyfunction]
#[expect(clippy::too_many_arguments, reason = "the options of the command")]
pub(crate) fn track<'py>(
    py: Python<'py>,
    dataset: Place,
    method: String,
    max_displacement_px: f64,
    diameter_px: f64,
    noise_xy_px: f64,
    noise_z_um: f64,
    ensemble: bool,
    spheroids: bool,
    aspect_ratio: Aspect,
    fit_diameter: bool,
    positions: Option<PathBuf>,
    seed: u64,
    show: Show<'py>,
) -> PyResult<(Bound<'py, PyDict>, Vec<String>)> {
    let dataset = DatasetPlace::from(dataset);
    let aspect = match aspect_ratio {
        Aspect::Given(ratio) => AspectRatio::Given(ratio),
        Aspect::Named(name) => name.parse().map_err(PyValueError::new_err)?,
    };
    let (columns, warnings) = run(py, show, OnInterrupt::Wait, move |progress| {
        let options = TrackOptions {
            method,
            max_displacement_px,
            diameter_px,
            noise_xy_px,
            noise_z_um,
            seed,
            force: false,
            ensemble,
            shape: if spheroids { ParticleShape::Spheroid { aspect } } else { ParticleShape::Sphere },
            fit_diameter,
            positions: positions.map(InputFile::from),
            progress: progress.clone(),
            context: tables::context(),
        };
        result(&dataset, &options)
    })?;
    Ok((arrays(py, columns)?, warnings))
}

/// Name and description of every tracking method.
#[pyfunction]
pub(crate) fn methods() -> Vec<(&'static str, &'static str)> {
    METHODS.iter().map(|method| (method.name, method.about)).collect()
}

/// The cases of a sweep.
#[pyclass(frozen, module = "microsig._microsig")]
pub(crate) struct SweepCases {
    sweep: Sweep,
    /// Folder to which files of the base scenario are relative.
    inputs: PathBuf,
}

/// A case: name, values of the axes, repetition, seed.
type CaseFacts = (String, Vec<Object<Literal>>, u32, u64);

#[pymethods]
impl SweepCases {
    /// Paths of the axes.
    fn axes(&self) -> Vec<String> {
        self.sweep.spec.axes.iter().map(|axis| axis.path.clone()).collect()
    }

    /// All cases.
    fn cases(&self) -> Vec<CaseFacts> {
        let values = |case: &scenario::Case| case.values.iter().map(|v| Object(Literal::of(v))).collect();
        let of = |case: &scenario::Case| (case.name.clone(), values(case), case.repetition, case.seed);
        self.sweep.cases.iter().map(of).collect()
    }

    /// The dataset of a case, in memory.
    fn generate(&self, py: Python<'_>, index: usize) -> PyResult<Made> {
        let case = self.sweep.cases.get(index);
        let case = case.ok_or_else(|| PyIndexError::new_err(format!("case {index} does not exist")))?;
        let spec = self.sweep.scenario(case).map_err(raise)?;
        let inputs = self.inputs.clone();
        Made::of(py, false.into(), move || resolve(spec, &inputs, &tables::context()))
    }
}

/// Reads a sweep.
#[pyfunction]
pub(crate) fn sweep(
    py: Python<'_>,
    text: String,
    name: String,
    folder: PathBuf,
    seed: Option<u64>,
) -> PyResult<SweepCases> {
    let of = folder.clone();
    let sweep = run(py, false, OnInterrupt::Leave, move |_| scenario::parse_sweep(&text, &name, &of, seed))?;
    let base = folder.join(&sweep.spec.base);
    let inputs = base.parent().map_or(folder, std::path::Path::to_owned);
    Ok(SweepCases { sweep, inputs })
}
