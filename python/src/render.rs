//! Images of particles given as arrays.

use std::path::PathBuf;

use generator::runner::render_particles;
use microsig_core::emission::SpheroidLaw;
use microsig_core::formats::settings_file;
use microsig_core::render::RenderMethod;
use microsig_core::render::expected::DEFAULT_TOLERANCE;
use microsig_core::sensor::{ImageFormat, NoiseRounding};
use microsig_core::{Particle, Spheroid};
use numpy::PyReadonlyArray2;
use numpy::ndarray::{ArrayView1, ArrayView2};
use pyo3::prelude::*;

use crate::dataset::array;
use crate::run::{OnInterrupt, raise, run};
use crate::tables;

/// An image of particles, (rows, columns), and warnings about it. `settings` is the text of a settings file,
/// which `name` is in messages; `rows` are read from a data file.
#[pyfunction]
#[expect(clippy::too_many_arguments, reason = "the options of the command")]
pub(crate) fn render<'py>(
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
    let particles = particles(rows.as_array()).map_err(raise)?;
    let spheroids = if uniform { SpheroidLaw::Uniform } else { SpheroidLaw::Original };
    let renderer = if expected {
        RenderMethod::Expected { spheroids, tolerance: DEFAULT_TOLERANCE }
    } else {
        RenderMethod::Rays { spheroids }
    }
    .into();
    let rounding = if round_once { NoiseRounding::AfterSum } else { NoiseRounding::BeforeSum };
    let format = if unrounded { ImageFormat::Float32 } else { ImageFormat::Integer };
    let (image, warnings) = run(py, false, OnInterrupt::Leave, move |_| {
        let read = settings_file::read(settings.as_bytes(), &name)?;
        let exposed = (rounding, format);
        let (random, context) = ((seed, frame), tables::context());
        let (image, more) =
            render_particles(&read.settings, renderer, &particles, random, exposed, &context)?;
        Ok((image, read.warnings.into_iter().chain(more).collect()))
    })?;
    let size = [image.height as usize, image.width as usize];
    Ok((array(py, image.counts, size)?, warnings))
}

/// The particles of an array with the columns of a data file.
fn particles(rows: ArrayView2<'_, f64>) -> storage::Result<Vec<Particle>> {
    let columns = rows.ncols();
    if ![4, 5, 7, 8].contains(&columns) {
        let message = format!("particles: {columns} columns: expected 4, 5, 7 or 8");
        return Err(storage::Error::input(message));
    }
    let (has_spheroids, has_c_int) = (columns > 6, columns % 3 == 2);
    let particle = |(k, row): (usize, ArrayView1<'_, f64>)| {
        let wrong = |column: usize, what: &str, allowed: &str| {
            let at = format!("particles:{}, column {}", k + 1, column + 1);
            Err(storage::Error::input(format!("{at}: {what}{}: expected {allowed}", row[column])))
        };
        if let Some(column) = row.iter().position(|value| !value.is_finite()) {
            return wrong(column, "", "a finite number");
        }
        if row[3] <= 0.0 {
            return wrong(3, "d_p = ", "a diameter > 0 um");
        }
        if has_spheroids && row[4] <= 0.0 {
            return wrong(4, "e_p = ", "an aspect ratio > 0");
        }
        let c_int = if has_c_int { row[columns - 1] } else { 1.0 };
        if c_int < 0.0 {
            return wrong(columns - 1, "c_int = ", "a factor >= 0");
        }
        let spheroid = has_spheroids.then(|| Spheroid { e_p: row[4], alpha_rad: row[5], beta_rad: row[6] });
        Ok(Particle { x_px: row[0], y_px: row[1], z_um: row[2], d_um: row[3], spheroid, c_int })
    };
    rows.outer_iter().enumerate().map(particle).collect()
}

/// The text of a settings file: a regular file of at most 1 MB.
#[pyfunction]
pub(crate) fn read_settings(py: Python<'_>, path: PathBuf) -> PyResult<String> {
    const MAX_BYTES: u64 = 1_000_000;
    run(py, false, OnInterrupt::Leave, move |_| storage::input::read_text_up_to(&path, MAX_BYTES))
}

/// Width and height that a settings file tells, px.
#[pyfunction]
pub(crate) fn image_size(py: Python<'_>, settings: PathBuf) -> PyResult<(u32, u32)> {
    run(py, false, OnInterrupt::Leave, move |_| {
        let file = storage::input::open(&settings)?;
        let read = settings_file::read(file, &settings.display().to_string())?.settings;
        Ok((read.pixel_dim_x, read.pixel_dim_y))
    })
}
