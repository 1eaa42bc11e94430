//! What a split holds before it is an archive: paths and their contents, hashed and zipped.
//!
//! The same contents give the same archive: entries are sorted, have one date (1 January 1980, zip's first) and one mode,
//! and are compressed by the same code everywhere.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::Write;
use std::path::{Path, PathBuf};

use zip::write::SimpleFileOptions;
use zip::{CompressionMethod, DateTime, ZipWriter};

use crate::dataset::checksums::{Fingerprint, fingerprint};
use crate::dataset::folder::files_below;
use crate::dataset::{save, save_bytes};
use crate::error::{Error, Result};

/// A file of a package.
#[derive(Debug)]
enum Content {
    File(PathBuf),
    Bytes(Vec<u8>),
}

/// Files by their paths.
#[derive(Debug, Default)]
pub(super) struct Package {
    files: BTreeMap<String, Content>,
}

impl Package {
    /// Adds a file that is written here.
    pub(super) fn write(&mut self, path: &str, bytes: impl Into<Vec<u8>>) {
        self.files.insert(path.to_owned(), Content::Bytes(bytes.into()));
    }

    /// Adds a file that lies on disk.
    pub(super) fn copy(&mut self, path: &str, from: PathBuf) {
        self.files.insert(path.to_owned(), Content::File(from));
    }

    /// Adds those files of a folder whose paths are wanted.
    pub(super) fn copy_folder(&mut self, folder: &Path, wanted: impl Fn(&str) -> bool) -> Result<()> {
        for path in files_below(folder)?.into_iter().filter(|p| wanted(p)) {
            self.copy(&path, folder.join(&path));
        }
        Ok(())
    }

    /// Sizes and hashes of all files.
    pub(super) fn fingerprints(&self) -> Result<BTreeMap<String, Fingerprint>> {
        let of = |content: &Content| match content {
            Content::File(path) => fingerprint(path),
            Content::Bytes(bytes) => Ok(Fingerprint::of(bytes)),
        };
        self.files.iter().map(|(path, content)| Ok((path.clone(), of(content)?))).collect()
    }

    /// Writes all files into a zip archive, below a folder of its own.
    pub(super) fn zip(&self, root: &str, out: &Path) -> Result<()> {
        save(out, |writer| {
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
                zip.start_file(format!("{root}/{path}"), options).map_err(failed)?;
                match content {
                    Content::Bytes(bytes) => zip.write_all(bytes).map_err(Error::write(out))?,
                    Content::File(path) => {
                        let mut file = File::open(path).map_err(|e| Error::read(path, e))?;
                        std::io::copy(&mut file, &mut zip).map_err(Error::write(out))?;
                    }
                }
            }
            zip.finish().map_err(failed)?;
            Ok(())
        })
    }

    /// Writes the files that were not copied into a folder.
    pub(super) fn unpack(&self, folder: &Path) -> Result<()> {
        for (path, content) in &self.files {
            if let Content::Bytes(bytes) = content {
                save_bytes(&folder.join(path), bytes)?;
            }
        }
        Ok(())
    }
}
