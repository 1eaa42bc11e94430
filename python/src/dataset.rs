//! Datasets: made in memory, or read from a folder.

use std::io::Cursor;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use generator::runner::{GenerateOptions, MemoryDataset};
use microsig_core::KEYS;
use microsig_core::formats::tiff;
use microsig_core::sensor::Counts;
use numpy::ndarray::{ArrayView3, IntoDimension};
use numpy::{Element, PyArray1, PyArray3, PyArrayMethods};
use pyo3::exceptions::PyRuntimeError;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use scenario::{self, Assignment, Scenario};
use storage::dataset::manifest::Manifest;
use storage::dataset::{DatasetPlace, TableReader};

use crate::columns::{arrays, table};
use crate::object::Object;
use crate::run::{OnInterrupt, Show, raise, run};
use crate::tables;

/// A table: its path in a dataset, what a row is, units and meanings by column, values by column.
type PyTable<'py> = (String, String, Bound<'py, PyDict>, Bound<'py, PyDict>);

/// A scenario's text with its name in messages and the folder of its files, values by path, and a seed.
#[derive(Debug, Clone, FromPyObject)]
pub(crate) struct ScenarioText {
    #[pyo3(item)]
    pub(crate) text: String,
    #[pyo3(item)]
    pub(crate) name: String,
    #[pyo3(item)]
    pub(crate) folder: PathBuf,
    #[pyo3(item)]
    pub(crate) values: Vec<(String, String)>,
    #[pyo3(item)]
    pub(crate) seed: Option<u64>,
}

impl ScenarioText {
    /// The values that replace the text's.
    pub(crate) fn assignments(&self) -> Vec<Assignment> {
        let of = |(path, value): &(String, String)| Assignment { path: path.clone(), value: value.clone() };
        self.values.iter().map(of).collect()
    }

    /// The scenario, every rule checked.
    pub(crate) fn resolve(&self) -> storage::Result<Scenario> {
        scenario::load_text(
            &self.text,
            (&self.name, &self.folder),
            &self.assignments(),
            self.seed,
            &tables::context(),
        )
    }
}

/// A dataset in memory.
#[pyclass(frozen, module = "microsig._microsig")]
pub(crate) struct Made(pub(crate) Arc<MemoryDataset>);

/// Where a dataset is.
#[derive(FromPyObject)]
pub(crate) enum Place {
    Memory(Py<Made>),
    Folder(PathBuf),
}

impl From<Place> for DatasetPlace {
    fn from(place: Place) -> Self {
        match place {
            Place::Memory(made) => DatasetPlace::Memory(made.get().0.clone()),
            Place::Folder(path) => DatasetPlace::Folder(path),
        }
    }
}

#[pymethods]
impl Made {
    /// Counts of all images, (frames, rows, columns), not copied.
    fn images<'py>(slf: &Bound<'py, Self>) -> PyResult<Bound<'py, PyAny>> {
        match slf.get().0.counts() {
            Counts::Whole(counts) => borrowed(slf, counts),
            Counts::Unrounded(counts) => borrowed(slf, counts),
        }
    }

    /// Tables of frames, tracks and displacements.
    fn tables<'py>(&self, py: Python<'py>) -> PyResult<Vec<PyTable<'py>>> {
        let made = Arc::clone(&self.0);
        let tables = run(py, false, OnInterrupt::Leave, move |_| Ok(made.tables()))?;
        tables.into_iter().map(|(of, columns)| table(py, &of, columns)).collect()
    }

    /// Tables of depths and, if there is one, of the field.
    fn field_tables<'py>(&self, py: Python<'py>) -> PyResult<Vec<PyTable<'py>>> {
        let made = Arc::clone(&self.0);
        let tables = run(py, false, OnInterrupt::Leave, move |_| made.field_tables())?;
        tables.into_iter().map(|(of, columns)| table(py, &of, columns)).collect()
    }

    /// Table and images of the calibration stack, if there is one.
    fn calibration<'py>(&self, py: Python<'py>) -> PyResult<Option<(PyTable<'py>, Bound<'py, PyAny>)>> {
        let made = Arc::clone(&self.0);
        let calibration = run(py, false, OnInterrupt::Leave, move |progress| made.calibration(progress))?;
        let Some(calibration) = calibration else { return Ok(None) };
        let ((of, columns), images) = (calibration.table, calibration.images);
        let size = images.first().map_or((0, 0), |image| (image.height as usize, image.width as usize));
        let n = images.len();
        let counts = images.into_iter().map(|image| image.counts).collect();
        Ok(Some((table(py, &of, columns)?, stack(py, counts, (n, size.0, size.1))?)))
    }

    /// The scenario, every default written out, as [`written`] gives it.
    fn scenario(&self) -> PyResult<(Object, String)> {
        written(self.0.scenario()).map_err(raise)
    }

    /// MicroSIG's settings by name.
    fn settings<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        settings(py, self.0.scenario())
    }

    /// Object-space length of a pixel, um; least and greatest depth, um; time between frames, s; bits of a
    /// count.
    fn facts(&self) -> (f64, (f64, f64), f64, u8) {
        let scenario = self.0.scenario();
        let um_per_px = scenario.settings.um_per_px();
        (um_per_px, scenario.depth_range_um, scenario.recordings.dt_s(), self.0.bits())
    }

    /// What should be known about the dataset.
    fn warnings(&self) -> Vec<String> {
        self.0.warnings()
    }

    /// Writes the dataset into a folder.
    fn save(&self, py: Python<'_>, out: PathBuf, force: bool, show: Show<'_>) -> PyResult<()> {
        let made = Arc::clone(&self.0);
        run(py, show, OnInterrupt::Wait, move |progress| {
            let progress = progress.clone();
            made.save(&GenerateOptions { out, force, resume: false, progress }).map(drop)
        })
    }
}

/// The text of a scenario or sweep (a regular file of at most 16 MB, or the name of a shipped one) and the folder
/// that paths in it are relative to; None: the folder of the shipped files.
#[pyfunction]
pub(crate) fn read_scenario(py: Python<'_>, path: PathBuf) -> PyResult<(String, Option<PathBuf>)> {
    let found = run(py, false, OnInterrupt::Leave, move |_| scenario::ScenarioText::open(&path))?;
    let folder = (!found.is_unpacked()).then(|| found.folder.clone());
    Ok((found.text, folder))
}

/// Writes the shipped scenarios, and the files that they refer to, into a folder.
#[pyfunction]
pub(crate) fn unpack_scenarios(py: Python<'_>, folder: PathBuf) -> PyResult<()> {
    run(py, false, OnInterrupt::Leave, move |_| {
        scenario::SHIPPED.extract(&folder).map_err(storage::Error::write(&folder))
    })
}

/// A dataset in memory from a scenario.
#[pyfunction]
pub(crate) fn generate(py: Python<'_>, text: ScenarioText, show: Show<'_>) -> PyResult<Made> {
    Made::of(py, show, move || text.resolve())
}

impl Made {
    /// The dataset of a scenario.
    pub(crate) fn of(
        py: Python<'_>,
        show: Show<'_>,
        scenario: impl FnOnce() -> storage::Result<Scenario> + Send + 'static,
    ) -> PyResult<Made> {
        let made = run(py, show, OnInterrupt::Wait, move |progress| {
            MemoryDataset::take(scenario()?, progress).map(Arc::new)
        })?;
        Ok(Made(made))
    }
}

/// A scenario, every default written out, as [`written`] gives it, and its warnings.
#[pyfunction]
pub(crate) fn resolve(py: Python<'_>, text: ScenarioText) -> PyResult<(Object, String, Vec<String>)> {
    run(py, false, OnInterrupt::Leave, move |_| {
        let scenario = text.resolve()?;
        let (spec, ron) = written(&scenario)?;
        Ok((spec, ron, scenario.warnings))
    })
}

/// A scenario as an object, with the files that it refers to where they were read, so that it can be used
/// anywhere; and as RON, with their paths in its dataset.
pub(crate) fn written(scenario: &Scenario) -> storage::Result<(Object, String)> {
    let Object(mut spec) = Object::of(&scenario.spec)?;
    for input in &scenario.inputs {
        if let Some(path) = spec.pointer_mut(&format!("/{}", input.key.replace('.', "/"))) {
            *path = input.source.to_string_lossy().into();
        }
    }
    Ok((Object(spec), scenario::write(&scenario.spec)?))
}

fn settings<'py>(py: Python<'py>, scenario: &Scenario) -> PyResult<Bound<'py, PyDict>> {
    let dict = PyDict::new(py);
    for (key, value) in KEYS.iter().zip(scenario.settings.values()) {
        if key.is_whole {
            dict.set_item(key.name, value as u64)?;
        } else {
            dict.set_item(key.name, value)?;
        }
    }
    Ok(dict)
}

/// Numbers of a dataset in memory as an array that keeps it alive.
fn borrowed<'py, T: Element>(made: &Bound<'py, Made>, counts: &[T]) -> PyResult<Bound<'py, PyAny>> {
    let view = ArrayView3::from_shape(made.get().0.shape(), counts)
        .map_err(|e| PyRuntimeError::new_err(e.to_string()))?;
    // SAFETY: the counts live as long as this object, which the array keeps alive, and neither moves nor
    // changes: the class is frozen, and the array is made read-only before anybody else sees it.
    let images = unsafe { PyArray3::borrow_from_array(&view, made.clone().into_any()) };
    images.readwrite().make_nonwriteable();
    Ok(images.into_any())
}

/// Images as one array: of whole counts if all have them, otherwise of floating-point numbers.
fn stack(
    py: Python<'_>,
    images: Vec<Counts>,
    (frames, rows, columns): (usize, usize, usize),
) -> PyResult<Bound<'_, PyAny>> {
    let are_whole = images.iter().all(|counts| matches!(counts, Counts::Whole(_)));
    let mut all = if are_whole { Counts::Whole(Vec::new()) } else { Counts::Unrounded(Vec::new()) };
    images.iter().for_each(|counts| all.extend(counts));
    array(py, all, [frames, rows, columns])
}

/// Counts as an array of this shape.
pub(crate) fn array<const N: usize>(
    py: Python<'_>,
    counts: Counts,
    shape: [usize; N],
) -> PyResult<Bound<'_, PyAny>>
where
    [usize; N]: IntoDimension,
{
    Ok(match counts {
        Counts::Whole(counts) => PyArray1::from_vec(py, counts).reshape(shape)?.into_any(),
        Counts::Unrounded(counts) => PyArray1::from_vec(py, counts).reshape(shape)?.into_any(),
    })
}

/// The manifest of a dataset's folder.
#[pyfunction]
pub(crate) fn manifest(py: Python<'_>, dataset: PathBuf) -> PyResult<Object> {
    run(py, false, OnInterrupt::Leave, move |_| Object::of(&Manifest::read(&dataset)?))
}

/// Scenario, as [`written`] gives it, and settings of a dataset's folder.
#[pyfunction]
pub(crate) fn scenario_of<'py>(
    py: Python<'py>,
    dataset: PathBuf,
) -> PyResult<(Object, String, Bound<'py, PyDict>)> {
    let scenario =
        run(py, false, OnInterrupt::Leave, move |_| scenario::of_dataset(&dataset, &tables::context()))?.0;
    let (spec, ron) = written(&scenario).map_err(raise)?;
    Ok((spec, ron, settings(py, &scenario)?))
}

/// Columns of a table (CSV) in a dataset's folder; `kinds` are the columns' types by name, as in the
/// manifest.
#[pyfunction]
pub(crate) fn read_table<'py>(
    py: Python<'py>,
    path: PathBuf,
    kinds: std::collections::HashMap<String, String>,
) -> PyResult<Bound<'py, PyDict>> {
    let columns = run(py, false, OnInterrupt::Leave, move |_| {
        TableReader::open(&path)?.columns(|name| kinds.get(name).map_or("string", String::as_str))
    })?;
    arrays(py, columns)
}

/// Images (TIFF) of one size, (frames, rows, columns).
#[pyfunction]
pub(crate) fn read_images(
    py: Python<'_>,
    paths: Vec<PathBuf>,
    width: u32,
    height: u32,
) -> PyResult<Bound<'_, PyAny>> {
    let frames = paths.len();
    let images = run(py, false, OnInterrupt::Leave, move |progress| {
        use rayon::prelude::*;
        let read = |path: &PathBuf| {
            progress.check()?;
            read_image(path, (width, height))
        };
        paths.par_iter().map(read).collect::<storage::Result<Vec<Counts>>>()
    })?;
    stack(py, images, (frames, height as usize, width as usize))
}

fn read_image(path: &Path, size: (u32, u32)) -> storage::Result<Counts> {
    let bytes = storage::input::read(path)?;
    Ok(tiff::read_counts(Cursor::new(bytes), &path.display().to_string(), size)?)
}

/// Copies a dataset.
#[pyfunction]
pub(crate) fn copy_dataset(py: Python<'_>, dataset: PathBuf, out: PathBuf, force: bool) -> PyResult<()> {
    run(py, false, OnInterrupt::Wait, move |_| generator::dataset::copy(&dataset, &out, force))
}
