//! What the end-to-end tests share: reference data and the measures that images are compared by.

pub mod ensemble;
pub mod error_map;
pub mod expected;
pub mod leak;
pub mod maxima;
pub mod measure;
pub mod microsig;
pub mod npy;
pub mod reference;

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

/// Reads the counts of an image file, row by row.
pub fn counts(path: &Path) -> anyhow::Result<Vec<f64>> {
    let open = || Ok::<_, anyhow::Error>(std::io::BufReader::new(std::fs::File::open(path)?));
    let name = path.display().to_string();
    let size = tiff::decoder::Decoder::new(open()?)?.dimensions()?;
    Ok(microsig_core::formats::tiff::read(open()?, &name, size)?)
}

/// SHA-256 of a file, in hexadecimal.
pub fn sha256(path: &Path) -> anyhow::Result<String> {
    use sha2::Digest;
    let digest = sha2::Sha256::digest(std::fs::read(path)?);
    Ok(digest.iter().map(|byte| format!("{byte:02x}")).collect())
}
