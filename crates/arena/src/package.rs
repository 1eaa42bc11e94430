//! The contents of an archive: paths and files, which are hashed and zipped.
//!
//! Archives are reproducible: entries are sorted, have a fixed date (1 January 1980, the earliest in zip) and
//! mode, and are compressed by the same code on every platform.

use std::cell::Cell;
use std::collections::BTreeMap;
use std::io::{self, Cursor, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

use zip::write::SimpleFileOptions;
use zip::{CompressionMethod, DateTime, ZipWriter};

use storage::OutputFolder;
use storage::checksums::{Fingerprint, fingerprint};
use storage::error::{Error, Result};
use storage::folder::files_below;

/// Contents of a file of a package.
#[derive(Debug)]
enum Content {
    File(PathBuf),
    Bytes(Vec<u8>),
}

/// Files by path in the archive.
#[derive(Debug, Default)]
pub struct Package {
    files: BTreeMap<String, Content>,
}

impl Package {
    /// Adds a file with these contents.
    pub fn write(&mut self, path: &str, bytes: impl Into<Vec<u8>>) {
        self.files.insert(path.to_owned(), Content::Bytes(bytes.into()));
    }

    /// Adds a file from disk.
    pub fn copy(&mut self, path: &str, from: PathBuf) {
        self.files.insert(path.to_owned(), Content::File(from));
    }

    /// Adds the files of a folder whose relative paths satisfy `wanted`.
    pub fn copy_folder(&mut self, folder: &Path, wanted: impl Fn(&str) -> bool) -> Result<()> {
        for path in files_below(folder)?.into_iter().filter(|p| wanted(p)) {
            self.copy(&path, folder.join(&path));
        }
        Ok(())
    }

    pub fn paths(&self) -> Vec<String> {
        self.files.keys().cloned().collect()
    }

    /// Sizes and hashes of all files, by path.
    pub fn fingerprints(&self) -> Result<BTreeMap<String, Fingerprint>> {
        let of = |content: &Content| match content {
            Content::File(path) => fingerprint(path),
            Content::Bytes(bytes) => Ok(Fingerprint::of(bytes)),
        };
        self.files.iter().map(|(path, content)| Ok((path.clone(), of(content)?))).collect()
    }

    /// Writes all files into a zip archive, below the folder `root`; an empty one is the archive itself.
    pub fn zip(&self, root: &str, folder: &OutputFolder, file: &str) -> Result<()> {
        folder.save(file, |writer| self.zip_into(writer, root, &folder.join(file)))
    }

    /// A zip archive in memory; `name` is its name in messages.
    pub fn zipped(&self, name: &str) -> Result<Vec<u8>> {
        let mut archive = Cursor::new(Vec::new());
        self.zip_into(&mut archive, "", Path::new(name))?;
        Ok(archive.into_inner())
    }

    fn zip_into(&self, writer: impl Write + Seek, root: &str, out: &Path) -> Result<()> {
        let above = if root.is_empty() { String::new() } else { format!("{root}/") };
        let failed = |e: zip::result::ZipError| Error::write(out)(e.into());
        let error = Cell::new(None);
        let mut zip = ZipWriter::new(Postponed { writer, at: 0, end: 0, error: &error });
        for (path, content) in &self.files {
            if let Some(error) = error.take() {
                return Err(Error::write(out)(error));
            }
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
        error.take().map_or(Ok(()), |error| Err(Error::write(out)(error)))
    }

    /// Writes the files added by [`Package::write`] into a folder.
    pub fn unpack(&self, folder: &OutputFolder) -> Result<()> {
        for (path, content) in &self.files {
            if let Content::Bytes(bytes) = content {
                folder.save_bytes(path, bytes)?;
            }
        }
        Ok(())
    }
}

/// Writes until the first error, which it keeps, and then discards all output: a [`ZipWriter`] that
/// encounters an error prints it on standard error when it is dropped.
struct Postponed<'e, W> {
    writer: W,
    /// Position and length of the output.
    at: u64,
    end: u64,
    error: &'e Cell<Option<io::Error>>,
}

impl<W> Postponed<'_, W> {
    /// Performs an operation unless an error has occurred.
    fn attempt<T>(&mut self, action: impl FnOnce(&mut W) -> io::Result<T>) {
        let before = self.error.take();
        let error = if before.is_some() { before } else { action(&mut self.writer).err() };
        self.error.set(error);
    }
}

impl<W: Write> Write for Postponed<'_, W> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.attempt(|writer| writer.write_all(bytes));
        self.at += bytes.len() as u64;
        self.end = self.end.max(self.at);
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        self.attempt(Write::flush);
        Ok(())
    }
}

impl<W: Seek> Seek for Postponed<'_, W> {
    fn seek(&mut self, to: SeekFrom) -> io::Result<u64> {
        let moved = match to {
            SeekFrom::Start(at) => Some(at),
            SeekFrom::Current(by) => self.at.checked_add_signed(by),
            SeekFrom::End(by) => self.end.checked_add_signed(by),
        };
        self.at = moved.ok_or(io::ErrorKind::InvalidInput)?;
        let at = self.at;
        self.attempt(|writer| writer.seek(SeekFrom::Start(at)));
        Ok(at)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A disk with this much free space, bytes.
    struct Full(Cursor<Vec<u8>>, usize);

    impl Write for Full {
        fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
            if self.0.get_ref().len() + bytes.len() > self.1 {
                return Err(io::ErrorKind::StorageFull.into());
            }
            self.0.write(bytes)
        }

        fn flush(&mut self) -> io::Result<()> {
            Ok(())
        }
    }

    impl Seek for Full {
        fn seek(&mut self, to: SeekFrom) -> io::Result<u64> {
            self.0.seek(to)
        }
    }

    #[test]
    fn wherever_an_archive_does_not_fit_the_error_is_that_of_the_disk() {
        let mut package = Package::default();
        package.write("a", vec![7; 100]);
        package.write("b", (0..=255).cycle().take(3000).collect::<Vec<u8>>());
        let whole = package.zipped("x.zip").unwrap();
        let mut disk = Full(Cursor::default(), whole.len());
        package.zip_into(&mut disk, "", Path::new("x.zip")).unwrap();
        assert!(disk.0.into_inner() == whole);
        for room in 0..whole.len() {
            let disk = Full(Cursor::default(), room);
            let error = package.zip_into(disk, "", Path::new("x.zip")).unwrap_err();
            let is_full = |source: &io::Error| source.kind() == io::ErrorKind::StorageFull;
            assert!(matches!(&error, Error::Write { source, .. } if is_full(source)), "{room}: {error}");
        }
    }
}
