//! A lock held by a process while it writes a folder, so that two runs never write the same folder.
//!
//! It is an operating system lock on the file `.NAME.lock` next to the folder. The system releases it
//! whenever the process ends: after a crash the file may remain, but it blocks nobody. docs/cluster.md
//! describes network file systems.

use std::ffi::{OsStr, OsString};
use std::fs::{File, OpenOptions, TryLockError};
use std::io::{ErrorKind, Read, Seek, Write};
use std::path::{Path, PathBuf};

use super::interrupt::Temporary;
use crate::error::{Error, Result};

#[derive(Debug)]
pub(crate) struct FolderLock {
    path: PathBuf,
    /// Warning if the file system has no locks.
    pub(crate) warning: Option<String>,
    // Unlocked when closed, after the file has been removed.
    _file: Option<File>,
    _temporary: Temporary,
}

impl FolderLock {
    /// Locks a folder, which need not exist. Errors: [`Error::Busy`] if another process holds the lock; an
    /// I/O error.
    pub(crate) fn take(folder: &Path) -> Result<Self> {
        let Some(name) = folder.file_name() else {
            return Err(Error::input(format!("{}: expected the name of a folder", folder.display())));
        };
        let mut path = folder.with_file_name(lock_name(name));
        if let Some(parent) = path.parent().filter(|parent| !parent.as_os_str().is_empty()) {
            std::fs::create_dir_all(parent).map_err(Error::write(parent))?;
        }
        loop {
            let mut file = match open(&path) {
                // The parent folder is read-only: use a lock file inside the folder.
                Err(e) if e.kind() == ErrorKind::PermissionDenied && folder.is_dir() => {
                    path = folder.join(".microsig.lock");
                    open(&path)
                }
                opened => opened,
            }
            .map_err(|e| refused(folder, &path, e))?;
            match file.try_lock() {
                Ok(()) => {}
                Err(TryLockError::WouldBlock) => {
                    let mut owner = String::new();
                    // Best effort: the message is less specific without the owner.
                    let _ = Read::take(&file, 1 << 10).read_to_string(&mut owner);
                    let owner = owner.trim();
                    let owner = if owner.is_empty() { "another process" } else { owner };
                    return Err(Error::Busy { path: folder.to_owned(), owner: owner.to_owned() });
                }
                Err(TryLockError::Error(e)) => {
                    let warning = format!(
                        "{}: this file system does not support locks ({e}), so two runs can write to the same folder",
                        path.display()
                    );
                    let _temporary = Temporary::file(&path);
                    return Ok(FolderLock { path, warning: Some(warning), _file: None, _temporary });
                }
            }
            // The previous owner may have removed the file between open and lock.
            if !is_still_at(&file, &path) {
                continue;
            }
            let _temporary = Temporary::file(&path);
            let owner =
                format!("process {} on {}\n", std::process::id(), gethostname::gethostname().display());
            file.set_len(0)
                .and_then(|()| file.rewind())
                .and_then(|()| file.write_all(owner.as_bytes()))
                .map_err(Error::write(&path))?;
            return Ok(FolderLock { path, warning: None, _file: Some(file), _temporary });
        }
    }
}

pub(crate) fn lock_name(folder: &OsStr) -> OsString {
    let mut lock = OsString::from(".");
    lock.push(folder);
    lock.push(".lock");
    lock
}

/// The error of a lock that cannot be created. If the folder is not writable, the error reports that instead
/// of the lock.
fn refused(folder: &Path, lock: &Path, e: std::io::Error) -> Error {
    if !matches!(e.kind(), ErrorKind::PermissionDenied | ErrorKind::ReadOnlyFilesystem) {
        return Error::write(lock)(e);
    }
    let place = lock.parent().filter(|place| !place.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let what = format!("cannot write to {} ({e}); choose another output folder", place.display());
    Error::write(folder)(std::io::Error::new(e.kind(), what))
}

fn open(path: &Path) -> std::io::Result<File> {
    OpenOptions::new().read(true).write(true).create(true).truncate(false).open(path)
}

impl Drop for FolderLock {
    fn drop(&mut self) {
        // Removed while locked, so that a process that opened the file earlier sees that it is gone. A
        // remaining file is harmless.
        let _ = std::fs::remove_file(&self.path);
    }
}

#[cfg(unix)]
fn is_still_at(file: &File, path: &Path) -> bool {
    use std::os::unix::fs::MetadataExt;
    match (file.metadata(), std::fs::symlink_metadata(path)) {
        (Ok(a), Ok(b)) => (a.dev(), a.ino()) == (b.dev(), b.ino()),
        _ => false,
    }
}

/// On other systems an open file cannot be removed.
#[cfg(not(unix))]
fn is_still_at(_: &File, path: &Path) -> bool {
    path.exists()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_second_run_is_told_who_holds_the_lock_and_a_file_left_behind_stops_nobody() {
        let place = tempfile::tempdir().unwrap();
        let folder = place.path().join("set");
        let held = FolderLock::take(&folder).unwrap();
        let message = FolderLock::take(&folder).unwrap_err().to_string();
        assert!(message.contains(&format!("process {} on ", std::process::id())), "{message}");
        drop(held);
        assert_eq!(std::fs::read_dir(place.path()).unwrap().count(), 0);
        // As left by a killed process.
        std::fs::write(place.path().join(".set.lock"), "process 1 on elsewhere\n").unwrap();
        drop(FolderLock::take(&folder).unwrap());
        assert_eq!(std::fs::read_dir(place.path()).unwrap().count(), 0);
    }

    /// Tests the error itself: folder permissions do not restrict root, and tests may run as root.
    #[test]
    fn a_read_only_place_is_named_instead_of_the_lock() {
        let of = |kind: ErrorKind| {
            refused(Path::new("/data/set"), Path::new("/data/.set.lock"), kind.into()).to_string()
        };
        for kind in [ErrorKind::PermissionDenied, ErrorKind::ReadOnlyFilesystem] {
            let said = of(kind);
            assert!(
                said.starts_with("/data/set: cannot write to /data (")
                    && said.contains("choose another output folder"),
                "{said}"
            );
        }
        assert!(of(ErrorKind::StorageFull).starts_with("/data/.set.lock: "));
    }
}
