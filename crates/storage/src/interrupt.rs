//! Cleanup on interruption: temporary files and folders, and locks, are removed when a signal ends the
//! program.

use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Mutex, MutexGuard, PoisonError};

use super::removal;
use crate::error::{Error, Result};

/// A path and how it is cleaned up.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) enum Place {
    File(PathBuf),
    /// A temporary folder of this process, removed with all its contents.
    Folder(PathBuf),
    /// A folder under construction: only files written by microsig are removed.
    Partial(PathBuf),
    /// A folder under construction that a later run can resume: only temporary files are removed.
    Resumable(PathBuf),
}

static PLACES: Mutex<Vec<Place>> = Mutex::new(Vec::new());
static INTERRUPTED: AtomicBool = AtomicBool::new(false);

/// The paths to clean up. An interruption holds them until the program exits.
pub(super) fn places() -> MutexGuard<'static, Vec<Place>> {
    PLACES.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Guard: the path is cleaned up if the program is interrupted while the guard exists.
#[derive(Debug)]
pub(crate) struct Temporary(Place);

impl Temporary {
    pub(crate) fn file(path: &Path) -> Self {
        Temporary::new(Place::File(path.to_owned()))
    }

    pub(crate) fn partial(path: &Path, resumable: bool) -> Self {
        let path = path.to_owned();
        Temporary::new(if resumable { Place::Resumable(path) } else { Place::Partial(path) })
    }

    fn new(place: Place) -> Self {
        places().push(place.clone());
        Temporary(place)
    }

    /// Gives the folder its final name by `rename`, either before an interruption or not at all; from then on the
    /// folder that it `replaced` is cleaned up instead.
    pub(crate) fn complete(&mut self, replaced: &Path, rename: impl FnOnce() -> Result<()>) -> Result<()> {
        let mut places = places();
        rename()?;
        let replaced = Place::Partial(replaced.to_owned());
        places.iter_mut().filter(|place| **place == self.0).for_each(|place| *place = replaced.clone());
        self.0 = replaced;
        Ok(())
    }
}

impl Drop for Temporary {
    fn drop(&mut self) {
        let mut places = places();
        if let Some(i) = places.iter().rposition(|place| *place == self.0) {
            places.remove(i);
        }
    }
}

/// A temporary folder that is removed with all its contents, also when the program is interrupted.
#[derive(Debug)]
pub struct TemporaryFolder {
    folder: tempfile::TempDir,
    _temporary: Temporary,
}

impl TemporaryFolder {
    /// Creates the folder in the system's temporary directory.
    pub fn new() -> Result<Self> {
        let folder = tempfile::tempdir().map_err(Error::write(&std::env::temp_dir()))?;
        let _temporary = Temporary::new(Place::Folder(folder.path().to_owned()));
        Ok(TemporaryFolder { folder, _temporary })
    }

    /// Path of the folder.
    pub fn path(&self) -> &Path {
        self.folder.path()
    }
}

/// Called by the first interruption, instead of exiting.
static SHUTDOWN: Mutex<Option<Box<dyn Fn() + Send>>> = Mutex::new(None);

/// Allows a program that runs until it is interrupted to end by itself: the first signal calls `end`, the
/// second one exits.
pub fn on_interrupt(end: impl Fn() + Send + 'static) {
    *SHUTDOWN.lock().unwrap_or_else(PoisonError::into_inner) = Some(Box::new(end));
}

/// Exit code of an interrupted program, the shell convention for SIGINT.
const EXIT_CODE: i32 = 130;

/// Installs a handler that cleans up and exits on SIGINT, SIGTERM and SIGHUP (Ctrl-C on Windows); before it
/// exits, it calls `report` with whether a run can be resumed.
pub fn clean_up_on_signals(report: impl Fn(bool) + Send + 'static) -> Result<()> {
    ctrlc::set_handler(move || {
        if let Some(end) = SHUTDOWN.lock().unwrap_or_else(PoisonError::into_inner).take() {
            return end();
        }
        INTERRUPTED.store(true, Ordering::SeqCst);
        // Held until exit, so that no path is added.
        let places = places();
        clean_up(&places);
        report(places.iter().any(|place| matches!(place, Place::Resumable(_))));
        std::process::exit(EXIT_CODE);
    })
    .map_err(|e| Error::input(format!("signals: {e}")))
}

/// Removes what an interrupted program leaves, the latest first.
pub(super) fn clean_up(places: &[Place]) {
    for place in places.iter().rev() {
        // Errors can no longer be reported.
        let _ = match place {
            Place::File(path) => std::fs::remove_file(path).map_err(Error::write(path)),
            Place::Folder(path) => again(|| std::fs::remove_dir_all(path).map_err(Error::write(path))),
            Place::Partial(path) if path.exists() => again(|| removal::remove_own(path)),
            Place::Partial(_) => Ok(()),
            Place::Resumable(path) => removal::remove_temporaries(path),
        };
    }
}

/// Makes writes beyond the file size limit of the process (`ulimit -f`) fail with an error and a path, in
/// this thread and those that it starts: the signal that would end the program without a message is blocked.
#[cfg(unix)]
pub fn file_size_limits_are_errors() {
    use nix::sys::signal::{SigSet, Signal};
    let signals: SigSet = [Signal::SIGXFSZ].into_iter().collect();
    // On failure, the signal keeps its effect.
    let _ = signals.thread_block();
}

/// This system has no such signal.
#[cfg(not(unix))]
pub fn file_size_limits_are_errors() {}

/// Retries, because other threads may still complete a file while a folder is being emptied.
fn again(remove: impl Fn() -> Result<()>) -> Result<()> {
    const TRIES: u32 = 20;
    for _ in 1..TRIES {
        if remove().is_ok() {
            return Ok(());
        }
        std::thread::sleep(std::time::Duration::from_millis(10));
    }
    remove()
}

/// Blocks forever if the program is being interrupted, so that no new file is started.
pub(crate) fn pause_if_interrupted() {
    while INTERRUPTED.load(Ordering::SeqCst) {
        std::thread::park();
    }
}
