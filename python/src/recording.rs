//! Recordings of one's own.

use std::path::PathBuf;

use fit::StagePositions;
use import::{ImportOptions, import};
use pyo3::prelude::*;

use crate::columns::ranges;
use crate::run::{OnInterrupt, Show, run};
use crate::tables;

/// Options of an import; numbers are within their ranges.
#[derive(Debug, Clone, FromPyObject)]
#[pyo3(from_item_all)]
struct How {
    images: Vec<PathBuf>,
    pages_per_time: Option<usize>,
    page: Option<usize>,
    scan: Option<PathBuf>,
    z: Option<PathBuf>,
    z_step_um: Option<f64>,
    z_toward: bool,
    optics: Option<PathBuf>,
    um_per_px: Option<f64>,
    dt_s: Option<f64>,
    pairs: bool,
    truth: Vec<PathBuf>,
    all_particles: bool,
    dark: Option<PathBuf>,
    flat: Option<PathBuf>,
    field: usize,
    particles: usize,
    window_px: Option<usize>,
    copy: bool,
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
            context: tables::context(),
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
