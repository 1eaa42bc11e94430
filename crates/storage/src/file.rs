//! Atomic file writes: a file appears complete or not at all.

use std::fs::{File, FileType, OpenOptions};
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};

use super::checksums::SHA256SUMS;
use super::interrupt::{Temporary, pause_if_interrupted};
use super::journal::TEMPORARY;
use super::removal::MANIFEST;
use crate::error::{Error, Result};

/// Write buffer, bytes.
const BUFFER: usize = 1 << 16;

/// Writes a file atomically: to a temporary file, which is then renamed.
pub fn save(path: &Path, write: impl FnOnce(&mut BufWriter<&File>) -> Result<()>) -> Result<()> {
    replace(path, PUBLIC, |file| {
        let mut writer = BufWriter::with_capacity(BUFFER, file);
        write(&mut writer)?;
        writer.flush().map_err(Error::write(path))
    })
}

/// [`save`] for contents in memory.
pub fn save_bytes(path: &Path, bytes: &[u8]) -> Result<()> {
    replace(path, PUBLIC, |mut file| file.write_all(bytes).map_err(Error::write(path)))
}

/// [`save_bytes`], unless the file has these bytes already: a run that finds everything done leaves no trace.
pub fn save_changed(path: &Path, bytes: &[u8]) -> Result<()> {
    let is_same = crate::input::read(path).is_ok_and(|found| found == bytes);
    if is_same { Ok(()) } else { save_bytes(path, bytes) }
}

/// How a file was put into another folder.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Placed {
    /// As a hard link: both names are of the same bytes on disk.
    Linked,
    /// As a copy.
    Copied,
}

/// [`OutputFolder::place`](crate::OutputFolder::place).
pub(crate) fn place(file: &Path, to: &Path, link: bool) -> Result<Placed> {
    let whole = file.canonicalize().map_err(|e| Error::read(file, e))?;
    if link && std::fs::hard_link(&whole, to).is_ok() {
        return Ok(Placed::Linked);
    }
    let mut from = crate::input::open(&whole)?;
    save(to, |writer| std::io::copy(&mut from, writer).map(drop).map_err(Error::write(to)))?;
    Ok(Placed::Copied)
}

/// [`save_bytes`] with permissions for the owner only.
pub(crate) fn save_private(path: &Path, bytes: &[u8]) -> Result<()> {
    replace(path, PRIVATE, |mut file| file.write_all(bytes).map_err(Error::write(path)))
}

/// Destination of an output path given by the user.
#[derive(Debug, Clone, PartialEq, Eq)]
enum Destination {
    /// A regular file, written atomically.
    File(PathBuf),
    /// A device or pipe, written directly.
    Stream,
}

/// Checks that a result may be written to a path: it does not exist, it is a character device or pipe, or,
/// with `force`, it is a regular file or a link to one. Errors: [`Error::Exists`] without `force`; a folder,
/// a dangling link or another kind of device.
pub fn may_write(path: &Path, force: bool) -> Result<()> {
    destination(path, force).map(drop)
}

fn destination(path: &Path, force: bool) -> Result<Destination> {
    let Ok(own) = std::fs::symlink_metadata(path) else { return Ok(Destination::File(path.to_owned())) };
    let refuse =
        |what: &str| Err(Error::input(format!("{}: is {what}, which is not replaced", path.display())));
    let Ok(target) = std::fs::metadata(path) else { return refuse("a broken link") };
    let kind = target.file_type();
    if is_stream(kind) {
        return Ok(Destination::Stream);
    }
    if kind.is_dir() {
        return refuse("a folder");
    }
    if !kind.is_file() {
        return refuse("a device");
    }
    if !force {
        return Err(Error::exists(path));
    }
    // Replaces the target of a link and keeps the link.
    let file =
        if own.is_symlink() { path.canonicalize().map_err(Error::write(path))? } else { path.to_owned() };
    Ok(Destination::File(file))
}

#[cfg(unix)]
fn is_stream(kind: FileType) -> bool {
    use std::os::unix::fs::FileTypeExt;
    kind.is_char_device() || kind.is_fifo()
}

#[cfg(not(unix))]
fn is_stream(_: FileType) -> bool {
    false
}

/// Checks that a path lies outside finished datasets, whose `SHA256SUMS` lists every file. Errors: a path in
/// a folder with `SHA256SUMS` and a manifest, or below one.
pub fn outside_datasets(path: &Path) -> Result<()> {
    let whole = std::path::absolute(path).map_err(|e| Error::read(path, e))?;
    // Resolves links above the file.
    let above = whole.parent().and_then(|above| above.ancestors().find_map(|p| p.canonicalize().ok()));
    let is_dataset = |folder: &&Path| folder.join(SHA256SUMS).is_file() && folder.join(MANIFEST).is_file();
    match above.as_deref().and_then(|above| above.ancestors().find(is_dataset)) {
        None => Ok(()),
        Some(dataset) => Err(Error::input(format!(
            "{}: lies in the dataset {}, whose files are listed in {SHA256SUMS}; expected a path outside of it",
            path.display(),
            dataset.display()
        ))),
    }
}

/// Writes a result to a path given by the user. Removes temporary files left by killed runs. Errors: as
/// [`may_write`] and [`outside_datasets`]; an I/O error.
pub fn save_result(path: &Path, force: bool, bytes: &[u8]) -> Result<()> {
    outside_datasets(path)?;
    match destination(path, force)? {
        Destination::File(file) => {
            remove_stale(file.parent().unwrap_or(Path::new(".")));
            save_bytes(&file, bytes)
        }
        Destination::Stream => OpenOptions::new()
            .write(true)
            .open(path)
            .and_then(|mut stream| stream.write_all(bytes))
            .map_err(Error::write(path)),
    }
}

/// Removes unlocked temporary files: a process that writes one holds its lock.
fn remove_stale(folder: &Path) {
    let folder = if folder.as_os_str().is_empty() { Path::new(".") } else { folder };
    for entry in std::fs::read_dir(folder).into_iter().flatten().flatten() {
        let is_temporary = entry.file_name().to_string_lossy().starts_with(TEMPORARY);
        if is_temporary && entry.file_type().is_ok_and(|kind| kind.is_file()) {
            let free = File::open(entry.path()).is_ok_and(|file| file.try_lock().is_ok());
            if free {
                // Best effort.
                let _ = std::fs::remove_file(entry.path());
            }
        }
    }
}

/// File modes before the umask is applied.
const PUBLIC: u32 = 0o666;
const PRIVATE: u32 = 0o600;

fn replace(path: &Path, mode: u32, write: impl FnOnce(&File) -> Result<()>) -> Result<()> {
    pause_if_interrupted();
    let folder = path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let mut builder = tempfile::Builder::new();
    builder.prefix(TEMPORARY);
    let refused = |e: std::io::Error| {
        let is_folder_missing = e.kind() == std::io::ErrorKind::NotFound && !folder.exists();
        Error::write(path)(if is_folder_missing { no_folder(folder) } else { e })
    };
    let file = builder.make_in(folder, |at| create(at, mode)).map_err(refused)?;
    let _temporary = Temporary::file(file.path());
    // Without support for locks, stale files are not removed.
    let _ = file.as_file().try_lock();
    write(file.as_file())?;
    pause_if_interrupted();
    file.persist(path).map_err(|e| Error::Write { path: path.to_owned(), source: e.error })?;
    Ok(())
}

/// Creates a temporary file. Unlike in `tempfile`, its errors do not name the file.
fn create(path: &Path, mode: u32) -> std::io::Result<File> {
    let mut options = OpenOptions::new();
    options.read(true).write(true).create_new(true);
    permit(&mut options, mode);
    options.open(path)
}

#[cfg(unix)]
fn permit(options: &mut OpenOptions, mode: u32) {
    std::os::unix::fs::OpenOptionsExt::mode(options, mode);
}

#[cfg(not(unix))]
fn permit(_: &mut OpenOptions, _: u32) {}

fn no_folder(folder: &Path) -> std::io::Error {
    let message = format!("the folder {} does not exist", folder.display());
    std::io::Error::new(std::io::ErrorKind::NotFound, message)
}

#[cfg(all(test, unix))]
mod tests {
    use super::*;
    use std::os::unix::fs::{MetadataExt, PermissionsExt, symlink};

    #[test]
    fn devices_are_written_into_links_are_followed_and_nothing_else_is_replaced() {
        let place = tempfile::tempdir().unwrap();
        let at = |name: &str| place.path().join(name);
        let null = Path::new("/dev/null");
        let device = std::fs::metadata(null).unwrap().rdev();
        save_result(null, true, b"x").unwrap();
        assert_eq!(std::fs::metadata(null).unwrap().rdev(), device);

        std::fs::write(at("file"), "old").unwrap();
        symlink(at("file"), at("link")).unwrap();
        symlink(at("nothing"), at("dangling")).unwrap();
        std::fs::create_dir(at("folder")).unwrap();
        assert!(matches!(save_result(&at("link"), false, b"new"), Err(Error::Exists { .. })));
        save_result(&at("link"), true, b"new").unwrap();
        assert!(std::fs::symlink_metadata(at("link")).unwrap().is_symlink());
        assert_eq!(std::fs::read(at("file")).unwrap(), b"new");
        for (name, what) in [("dangling", "a broken link"), ("folder", "a folder")] {
            let message = save_result(&at(name), true, b"new").unwrap_err().to_string();
            assert!(message.contains(what), "{message}");
        }
    }

    #[test]
    fn what_cannot_be_written_is_told_without_the_temporary_file() {
        let place = tempfile::tempdir().unwrap();
        std::fs::write(place.path().join("file"), "").unwrap();
        let message = |name: &str| {
            let path = place.path().join(name);
            let said = save_result(&path, false, b"").unwrap_err().to_string();
            said.strip_prefix(&format!("{}: ", path.display())).map(str::to_owned).unwrap_or(said)
        };
        let missing = place.path().join("a/b");
        assert_eq!(message("a/b/c.svg"), format!("the folder {} does not exist", missing.display()));
        assert_eq!(message("file/c.svg"), std::io::Error::from_raw_os_error(20).to_string());
    }

    #[test]
    fn a_killed_runs_file_is_removed_but_not_one_that_is_being_written() {
        let place = tempfile::tempdir().unwrap();
        let at = |name: &str| place.path().join(name);
        std::fs::write(at(".unfinished-stale"), "half").unwrap();
        let busy = File::create(at(".unfinished-busy")).unwrap();
        busy.lock().unwrap();
        save_result(&at("out.csv"), false, b"1").unwrap();
        assert!(!at(".unfinished-stale").exists() && at(".unfinished-busy").exists());
    }

    #[test]
    fn secrets_are_for_their_owner_alone_and_other_files_as_the_umask_says() {
        let place = tempfile::tempdir().unwrap();
        let mode =
            |name: &str| std::fs::metadata(place.path().join(name)).unwrap().permissions().mode() & 0o777;
        std::fs::write(place.path().join("as_the_umask_says"), "").unwrap();
        save_bytes(&place.path().join("public"), b"").unwrap();
        save_private(&place.path().join("private"), b"").unwrap();
        assert_eq!((mode("public"), mode("private")), (mode("as_the_umask_says"), 0o600));
    }
}
