//! Shared code of the end-to-end tests: reference data, measures for comparing images, checks of the
//! repository.

pub mod ensemble;
pub mod expected;
pub mod golden;
pub mod leak;
pub mod maxima;
pub mod measure;
pub mod microsig;
pub mod npy;
pub mod picture;
pub mod process;
pub mod reference;
pub mod scan;

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use anyhow::Context;
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

/// Width and height of an image file, px.
pub fn image_size(path: &Path) -> anyhow::Result<(u32, u32)> {
    let file = std::io::BufReader::new(std::fs::File::open(path)?);
    Ok(tiff::decoder::Decoder::new(file)?.dimensions()?)
}

/// SHA-256 of a file, in hexadecimal.
pub fn sha256(path: &Path) -> anyhow::Result<String> {
    Ok(sha256_of(&std::fs::read(path)?))
}

/// SHA-256 of bytes, in hexadecimal.
pub fn sha256_of(bytes: &[u8]) -> String {
    use sha2::Digest;
    sha2::Sha256::digest(bytes).iter().map(|byte| format!("{byte:02x}")).collect()
}

/// SHA-256 of every file below a folder, by relative path.
pub fn tree(folder: &Path) -> anyhow::Result<BTreeMap<String, String>> {
    let mut files = BTreeMap::new();
    let mut folders = vec![folder.to_owned()];
    while let Some(next) = folders.pop() {
        for entry in std::fs::read_dir(&next).with_context(|| next.display().to_string())? {
            let path = entry?.path();
            if path.is_dir() {
                folders.push(path);
            } else {
                let name = path.strip_prefix(folder)?.to_string_lossy().into_owned();
                files.insert(name, sha256(&path)?);
            }
        }
    }
    Ok(files)
}
