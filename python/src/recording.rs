//! Recordings of one's own.

use std::path::PathBuf;

use fit::StagePositions;
use import::{ImportOptions, import};
use microsig_core::render::Context;
use pyo3::prelude::*;

use crate::columns::ranges;
use crate::run::{OnInterrupt, Show, run};

/// Options of an import; numbers are within their ranges.
#[derive(Debug, Clone, FromPyObject)]
struct How {
    #[pyo3(item)]
    images: Vec<PathBuf>,
    #[pyo3(item)]
    pages_per_time: Option<usize>,
    #[pyo3(item)]
    page: Option<usize>,
    #[pyo3(item)]
    scan: Option<PathBuf>,
    #[pyo3(item)]
    z: Option<PathBuf>,
    #[pyo3(item)]
    z_step_um: Option<f64>,
    #[pyo3(item)]
    z_toward: bool,
    #[pyo3(item)]
    optics: Option<PathBuf>,
    #[pyo3(item)]
    um_per_px: Option<f64>,
    #[pyo3(item)]
    dt_s: Option<f64>,
    #[pyo3(item)]
    pairs: bool,
    #[pyo3(item)]
    truth: Vec<PathBuf>,
    #[pyo3(item)]
    all_particles: bool,
    #[pyo3(item)]
    dark: Option<PathBuf>,
    #[pyo3(item)]
    flat: Option<PathBuf>,
    #[pyo3(item)]
    field: usize,
    #[pyo3(item)]
    particles: usize,
    #[pyo3(item)]
    window_px: Option<usize>,
    #[pyo3(item)]
    copy: bool,
    #[pyo3(item)]
    force: bool,
}

/// Imports a recording into a folder; gives warnings.
#[pyfunction]
fn import_recording(py: Python<'_>, out: PathBuf, how: How, show: Show<'_>) -> PyResult<Vec<String>> {
    let made = run(py, show, OnInterrupt::Wait, move |progress| {
        let positions = match (how.z, how.z_step_um) {
            (Some(file), _) => StagePositions::Table(file.into()),
            (None, Some(step)) => StagePositions::Step(step),
            (None, None) => StagePositions::FromFile,
        };
        let options = ImportOptions {
            images: how.images,
            pages_per_time: how.pages_per_time,
            page: how.page,
            scan: how.scan,
            positions,
            toward_lens: how.z_toward,
            optics: how.optics.map(Into::into),
            um_per_px: how.um_per_px,
            dt_s: how.dt_s,
            pairs: how.pairs,
            truth: how.truth.into_iter().map(Into::into).collect(),
            all_particles: how.all_particles,
            dark: how.dark,
            flat: how.flat,
            field: how.field,
            particles: how.particles,
            window_px: how.window_px,
            copy: how.copy,
            force: how.force,
            progress: progress.clone(),
            context: Context::default(),
        };
        import(&out, &options)
    })?;
    Ok(made.warnings)
}

/// Adds the function.
pub(crate) fn add(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add("IMPORT_RANGES", ranges(&ImportOptions::RANGES))?;
    module.add_function(wrap_pyfunction!(import_recording, module)?)
}
