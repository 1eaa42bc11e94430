//! What the end-to-end tests share: reference data and the measures that images are compared by.

pub mod measure;
pub mod npy;

use std::path::{Path, PathBuf};

use microsig_core::formats::{data_file, settings_file};
use microsig_core::{Particle, Settings};

/// The folder of stored reference data.
pub fn data() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("data")
}

/// Reads a settings file.
pub fn settings(path: &Path) -> anyhow::Result<Settings> {
    Ok(settings_file::read(std::fs::File::open(path)?, &path.display().to_string())?.settings)
}

/// Reads a data file.
pub fn particles(path: &Path) -> anyhow::Result<Vec<Particle>> {
    Ok(data_file::read(std::fs::File::open(path)?, &path.display().to_string())?)
}
