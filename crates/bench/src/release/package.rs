//! The contents of an archive: paths and files, which are hashed and zipped.
//!
//! Archives are reproducible: entries are sorted, have a fixed date (1 January 1980, the earliest in zip) and
//! mode, and are compressed by the same code on every platform.

use std::collections::BTreeMap;
use std::io::{Cursor, Seek, Write};
use std::path::{Path, PathBuf};

use zip::write::SimpleFileOptions;
use zip::{CompressionMethod, DateTime, ZipWriter};

use storage::checksums::{Fingerprint, fingerprint};
use storage::error::{Error, Result};
use storage::folder::files_below;
use storage::{save, save_bytes};

/// Contents of a file of a package.
#[derive(Debug)]
enum Content {
    File(PathBuf),
    Bytes(Vec<u8>),
}

/// Files by path in the archive.
#[derive(Debug, Default)]
pub(crate) struct Package {
    files: BTreeMap<String, Content>,
}

impl Package {
    /// Adds a file with these contents.
    pub(crate) fn write(&mut self, path: &str, bytes: impl Into<Vec<u8>>) {
        self.files.insert(path.to_owned(), Content::Bytes(bytes.into()));
    }

    /// Adds a file from disk.
    pub(crate) fn copy(&mut self, path: &str, from: PathBuf) {
        self.files.insert(path.to_owned(), Content::File(from));
    }

    /// Adds the files of a folder whose relative paths satisfy `wanted`.
    pub(crate) fn copy_folder(&mut self, folder: &Path, wanted: impl Fn(&str) -> bool) -> Result<()> {
        for path in files_below(folder)?.into_iter().filter(|p| wanted(p)) {
            self.copy(&path, folder.join(&path));
        }
        Ok(())
    }

    /// The paths of all files.
    pub(crate) fn paths(&self) -> Vec<String> {
        self.files.keys().cloned().collect()
    }

    /// Sizes and hashes of all files, by path.
    pub(crate) fn fingerprints(&self) -> Result<BTreeMap<String, Fingerprint>> {
        let of = |content: &Content| match content {
            Content::File(path) => fingerprint(path),
            Content::Bytes(bytes) => Ok(Fingerprint::of(bytes)),
        };
        self.files.iter().map(|(path, content)| Ok((path.clone(), of(content)?))).collect()
    }

    /// Writes all files into a zip archive, below the folder `root`; an empty one is the archive itself.
    pub(crate) fn zip(&self, root: &str, out: &Path) -> Result<()> {
        save(out, |writer| self.zip_into(writer, root, out))
    }

    /// A zip archive in memory; `name` is its name in messages.
    pub(crate) fn zipped(&self, name: &str) -> Result<Vec<u8>> {
        let mut archive = Cursor::new(Vec::new());
        self.zip_into(&mut archive, "", Path::new(name))?;
        Ok(archive.into_inner())
    }

    fn zip_into(&self, writer: impl Write + Seek, root: &str, out: &Path) -> Result<()> {
        let above = if root.is_empty() { String::new() } else { format!("{root}/") };
        let failed = |e: zip::result::ZipError| Error::write(out)(e.into());
        let mut zip = ZipWriter::new(writer);
        for (path, content) in &self.files {
            let size = match content {
                Content::File(path) => std::fs::metadata(path).map_err(|e| Error::read(path, e))?.len(),
                Content::Bytes(bytes) => bytes.len() as u64,
            };
            let options = SimpleFileOptions::default()
                .compression_method(CompressionMethod::Deflated)
                .compression_level(Some(6))
                .last_modified_time(DateTime::default())
                .unix_permissions(0o644)
                .large_file(size >= u64::from(u32::MAX));
            zip.start_file(format!("{above}{path}"), options).map_err(failed)?;
            match content {
                Content::Bytes(bytes) => zip.write_all(bytes).map_err(Error::write(out))?,
                Content::File(path) => {
                    let mut file = storage::input::open(path)?;
                    std::io::copy(&mut file, &mut zip).map_err(Error::write(out))?;
                }
            }
        }
        zip.finish().map_err(failed)?;
        Ok(())
    }

    /// Writes the files added by [`Package::write`] into a folder.
    pub(crate) fn unpack(&self, folder: &Path) -> Result<()> {
        for (path, content) in &self.files {
            if let Content::Bytes(bytes) = content {
                save_bytes(&folder.join(path), bytes)?;
            }
        }
        Ok(())
    }
}
