//! Images of particles given as arrays.

use std::fmt::Write;
use std::path::PathBuf;

use generator::runner::render_particles;
use microsig_core::emission::SpheroidLaw;
use microsig_core::formats::{data_file, settings_file};
use microsig_core::render::RendererSpec;
use microsig_core::render::expected::DEFAULT_TOLERANCE;
use microsig_core::sensor::{ImageFormat, NoiseRounding};
use numpy::PyReadonlyArray2;
use pyo3::prelude::*;

use crate::dataset::array;
use crate::run::{OnInterrupt, run};

/// An image of particles, (rows, columns), and warnings about it. `settings` is the text of a settings file,
/// which `name` is in messages; `rows` are those of a data file.
#[pyfunction]
#[expect(clippy::too_many_arguments, reason = "the options of the command")]
fn render<'py>(
    py: Python<'py>,
    settings: String,
    name: String,
    rows: PyReadonlyArray2<'py, f64>,
    expected: bool,
    uniform: bool,
    round_once: bool,
    unrounded: bool,
    seed: u64,
    frame: u32,
) -> PyResult<(Bound<'py, PyAny>, Vec<String>)> {
    let mut text = String::new();
    for row in rows.as_array().rows() {
        for value in row {
            // Writing to a string cannot fail.
            let _ = write!(text, "{value} ");
        }
        text.push('\n');
    }
    let spheroids = if uniform { SpheroidLaw::Uniform } else { SpheroidLaw::Original };
    let renderer = if expected {
        RendererSpec::Expected { spheroids, tolerance: DEFAULT_TOLERANCE }
    } else {
        RendererSpec::Rays { spheroids }
    };
    let rounding = if round_once { NoiseRounding::AfterSum } else { NoiseRounding::BeforeSum };
    let format = if unrounded { ImageFormat::Float32 } else { ImageFormat::Integer };
    let (image, warnings) = run(py, false, OnInterrupt::Leave, move |_| {
        let read = settings_file::read(settings.as_bytes(), &name)?;
        let particles = data_file::read(text.as_bytes(), "particles")?;
        let exposed = (rounding, format);
        let (image, more) = render_particles(&read.settings, renderer, &particles, (seed, frame), exposed)?;
        Ok((image, read.warnings.into_iter().chain(more).collect()))
    })?;
    let size = [image.height as usize, image.width as usize];
    Ok((array(py, image.counts, size)?, warnings))
}

/// The text of a settings file: a regular file of at most 1 MB.
#[pyfunction]
fn read_settings(py: Python<'_>, path: PathBuf) -> PyResult<String> {
    const MAX_BYTES: u64 = 1_000_000;
    run(py, false, OnInterrupt::Leave, move |_| storage::input::read_text_up_to(&path, MAX_BYTES))
}

/// Width and height that a settings file tells, px.
#[pyfunction]
fn image_size(py: Python<'_>, settings: PathBuf) -> PyResult<(u32, u32)> {
    run(py, false, OnInterrupt::Leave, move |_| {
        let file = storage::input::open(&settings)?;
        let read = settings_file::read(file, &settings.display().to_string())?.settings;
        Ok((read.pixel_dim_x, read.pixel_dim_y))
    })
}

pub(crate) fn add(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add_function(wrap_pyfunction!(render, module)?)?;
    module.add_function(wrap_pyfunction!(read_settings, module)?)?;
    module.add_function(wrap_pyfunction!(image_size, module)?)
}
