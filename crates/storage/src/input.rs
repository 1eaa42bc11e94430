//! Reading untrusted files: regular files, with a size limit.
//!
//! Pipes, devices and sockets may be endless or block the reader; they are refused before being opened. All
//! files given by users are opened here (`tests/suite/house.rs` checks it).

use std::fs::{File, Metadata, OpenOptions};
use std::io::Read;
use std::path::Path;

use crate::error::{Error, Result};
use crate::memory::{free_memory, size_text};

/// Opens a regular file; links are followed. Errors: a file that cannot be opened; a folder, pipe, device or
/// socket.
pub fn open(path: &Path) -> Result<File> {
    open_shown(path, path)
}

/// [`open`] for a file that errors name `shown`.
pub(crate) fn open_shown(path: &Path, shown: &Path) -> Result<File> {
    regular(shown, &std::fs::metadata(path).map_err(|e| Error::read(shown, e))?)?;
    let file = without_waiting().open(path).map_err(|e| Error::read(shown, e))?;
    // The file may have been replaced since the check.
    regular(shown, &file.metadata().map_err(|e| Error::read(shown, e))?)?;
    Ok(file)
}

/// Options to open a file for reading without blocking if it has become a pipe; they have no effect on
/// regular files.
fn without_waiting() -> OpenOptions {
    let mut options = File::options();
    options.read(true);
    #[cfg(unix)]
    std::os::unix::fs::OpenOptionsExt::custom_flags(&mut options, libc::O_NONBLOCK);
    options
}

/// Opens a regular file that is not a symbolic link. Errors: as [`open`], and a symbolic link.
pub fn open_unlinked(path: &Path) -> Result<File> {
    regular(path, &std::fs::symlink_metadata(path).map_err(|e| Error::read(path, e))?)?;
    open(path)
}

fn regular(path: &Path, of: &Metadata) -> Result<()> {
    if of.is_file() {
        return Ok(());
    }
    let what = match of.file_type() {
        t if t.is_dir() => "a folder",
        t if t.is_symlink() => "a symbolic link",
        _ => "a pipe, device or socket",
    };
    Err(Error::input(format!("{}: {what}; expected a regular file", path.display())))
}

/// File size from which free memory is checked before reading, bytes.
const LARGE: u64 = 64 << 20;

/// Reads a regular file. Errors: as [`open`]; a file that cannot be read, or that is larger than free memory.
pub fn read(path: &Path) -> Result<Vec<u8>> {
    let file = open(path)?;
    let size = file.metadata().map_err(|e| Error::read(path, e))?.len();
    if let Some(free) = (size >= LARGE).then(free_memory).flatten().filter(|free| size > *free) {
        let (size, free) = (size_text(size), size_text(free));
        return Err(Error::input(format!(
            "{}: is read into memory and needs {size}, but only {free} are free",
            path.display()
        )));
    }
    let mut bytes = Vec::new();
    // At most the measured size, in case the file grows meanwhile.
    file.take(size.max(LARGE)).read_to_end(&mut bytes).map_err(|e| Error::read(path, e))?;
    Ok(bytes)
}

/// Maximum size of text files, bytes: a manifest of a million images has 400 MB.
const LARGEST_TEXT: u64 = 1 << 30;

/// Reads a text file of at most 1 GiB.
pub fn read_text(path: &Path) -> Result<String> {
    read_text_up_to(path, LARGEST_TEXT)
}

/// Reads a text file of at most `most` bytes. Errors: as [`open`]; a longer file; text that is not UTF-8.
pub fn read_text_up_to(path: &Path, most: u64) -> Result<String> {
    let file = open(path)?;
    // Checked before a gigabyte is read in vain.
    if file.metadata().is_ok_and(|of| of.len() > most) {
        return Err(too_long(path, most));
    }
    text_of(path, file, most)
}

fn too_long(path: &Path, most: u64) -> Error {
    Error::input(format!("{}: larger than {most} bytes", path.display()))
}

/// [`read_text_up_to`] for an open file.
pub fn text_of(path: &Path, file: impl Read, most: u64) -> Result<String> {
    let mut bytes = Vec::new();
    file.take(most.saturating_add(1)).read_to_end(&mut bytes).map_err(|e| Error::read(path, e))?;
    if bytes.len() as u64 > most {
        return Err(too_long(path, most));
    }
    String::from_utf8(bytes).map_err(|e| {
        let at = e.utf8_error().valid_up_to();
        Error::input(format!("{}: byte {at}: expected UTF-8", path.display()))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn texts_are_bounded_and_regular() {
        let place = tempfile::tempdir().unwrap();
        let path = place.path().join("a.txt");
        std::fs::write(&path, "four").unwrap();
        assert_eq!(read_text_up_to(&path, 4).unwrap(), "four");
        assert!(read_text_up_to(&path, 3).unwrap_err().to_string().contains("larger than 3 bytes"));
        assert!(open(place.path()).unwrap_err().to_string().contains("a folder; expected a regular file"));
        std::fs::write(&path, [b'a', 0xff]).unwrap();
        assert!(read_text_up_to(&path, 4).unwrap_err().to_string().contains("byte 1: expected UTF-8"));
    }

    #[test]
    fn files_larger_than_memory_are_refused() {
        let place = tempfile::tempdir().unwrap();
        let path = place.path().join("sparse");
        // A sparse file takes no space on disk.
        File::create(&path).unwrap().set_len(1 << 43).unwrap();
        let message = read(&path).unwrap_err().to_string();
        assert!(message.contains("sparse: is read into memory and needs 8796.1 GB, but only"), "{message}");
        assert!(read_text(&path).unwrap_err().to_string().contains("larger than"));
    }

    #[cfg(unix)]
    #[test]
    fn devices_and_links_are_refused() {
        let message = |e: Error| e.to_string();
        assert!(message(open(Path::new("/dev/zero")).unwrap_err()).contains("device"));
        let place = tempfile::tempdir().unwrap();
        let pipe = place.path().join("pipe");
        assert!(std::process::Command::new("mkfifo").arg(&pipe).status().unwrap().success());
        assert!(message(open(&pipe).unwrap_err()).contains("pipe"));
        // Also a pipe that replaces a file after the check.
        assert!(!without_waiting().open(&pipe).unwrap().metadata().unwrap().is_file());
        let (path, link) = (place.path().join("a.txt"), place.path().join("b.txt"));
        std::fs::write(&path, "four").unwrap();
        std::os::unix::fs::symlink(&path, &link).unwrap();
        assert!(open(&link).is_ok());
        assert!(message(open_unlinked(&link).unwrap_err()).contains("a symbolic link"));
        std::os::unix::fs::symlink("loop", place.path().join("loop")).unwrap();
        assert!(open(&place.path().join("loop")).is_err());
    }
}
