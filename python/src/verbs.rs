//! Verbs of the command for Python: their options are checked, and their results described, by the command's
//! own code, in this process.

use std::ffi::OsString;
use std::path::PathBuf;

use bench::cli::Cli;
use bench::export::ExportOptions;
use bench::optics::{Optics, svg, text};
use microsig_core::formats::stack::{Stack, StackAxis, StackFormat};
use microsig_core::sensor::{Counts, Image};
use numpy::PyReadonlyArray3;
use pyo3::prelude::*;
use storage::dataset::DatasetPlace;

use crate::dataset::{Place, ScenarioText};
use crate::object::Object;
use crate::run::{OnInterrupt, Show, run};
use crate::scores::one_of;

/// The result of a verb (None if it has none), the same as text, warnings, and the checks that failed.
type Said = (Option<Object>, String, Vec<String>, Vec<String>);

/// Runs a verb; `arguments` begin with the program's name.
#[pyfunction]
pub(crate) fn call(py: Python<'_>, arguments: Vec<OsString>, show: Show<'_>) -> PyResult<Said> {
    let answer = run(py, show, OnInterrupt::Wait, move |progress| Cli::call(&arguments, progress.clone()))?;
    Ok((answer.result.map(Object), answer.text, answer.warnings, answer.failures))
}

/// The particle images of a scenario's optics over depth: as an object, as text, as a picture (SVG); warnings.
#[pyfunction]
pub(crate) fn optics(py: Python<'_>, of: ScenarioText) -> PyResult<(Object, String, String, Vec<String>)> {
    run(py, false, OnInterrupt::Wait, move |_| {
        let scenario = of.resolve()?;
        let found = Optics::of(&scenario)?;
        let warnings = scenario.warnings.iter().map(ToString::to_string);
        let warnings = warnings.chain(found.preview.warnings.iter().cloned()).collect();
        Ok((Object::of(&found)?, text(&found), svg(&[found])?, warnings))
    })
}

/// Writes truth or images of a dataset in the format of another program.
#[pyfunction]
#[expect(clippy::too_many_arguments, reason = "the options of the command")]
pub(crate) fn export(
    py: Python<'_>,
    dataset: Place,
    out: PathBuf,
    format: String,
    images: String,
    stack: Option<String>,
    pair: Option<u32>,
    displacement: String,
    force: bool,
) -> PyResult<()> {
    let dataset = DatasetPlace::from(dataset);
    run(py, false, OnInterrupt::Wait, move |_| {
        let options = ExportOptions {
            format: one_of("format", &format)?,
            out: out.into(),
            pair,
            displacement: one_of("displacement", &displacement)?,
            images: one_of("images", &images)?,
            stack,
            force,
        };
        bench::export::export(&dataset, &options).map(drop)
    })
}

/// Writes images (uint16 or float32) at equally or unequally spaced depths (um) as the pages of a TIFF file.
#[pyfunction]
pub(crate) fn write_stack(
    py: Python<'_>,
    path: PathBuf,
    images: Images<'_>,
    um_per_px: f64,
    depths_um: Vec<f64>,
    ome: bool,
    name: String,
) -> PyResult<()> {
    let (counts, [pages, rows, columns]) = match images {
        Images::Whole(of) => (Counts::Whole(of.as_array().iter().copied().collect()), shape(&of)),
        Images::Unrounded(of) => (Counts::Unrounded(of.as_array().iter().copied().collect()), shape(&of)),
    };
    run(py, false, OnInterrupt::Leave, move |_| {
        if pages != depths_um.len() {
            let message =
                format!("{pages} images and {} depths: expected one depth per image", depths_um.len());
            return Err(storage::Error::input(message));
        }
        let (pixels, shown) = (rows * columns, path.display().to_string());
        let bits = if matches!(counts, Counts::Whole(_)) { 16 } else { Image::FLOAT_BITS };
        let page = |k: usize| {
            let counts = match &counts {
                Counts::Whole(all) => Counts::Whole(all[k * pixels..][..pixels].to_vec()),
                Counts::Unrounded(all) => Counts::Unrounded(all[k * pixels..][..pixels].to_vec()),
            };
            Ok::<_, storage::Error>(Image { width: columns as u32, height: rows as u32, bits, counts })
        };
        let stack = Stack { name, um_per_px, axis: StackAxis::Depth(depths_um) };
        let format = if ome { StackFormat::Ome } else { StackFormat::ImageJ };
        storage::save(&path, |writer| stack.write(writer, format, &shown, page))
    })
}

/// Images as an array.
#[derive(FromPyObject)]
pub(crate) enum Images<'py> {
    Whole(PyReadonlyArray3<'py, u16>),
    Unrounded(PyReadonlyArray3<'py, f32>),
}

fn shape<T: numpy::Element>(of: &PyReadonlyArray3<'_, T>) -> [usize; 3] {
    let (pages, rows, columns) = of.as_array().dim();
    [pages, rows, columns]
}
