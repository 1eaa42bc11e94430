//! `-`: standard input and output in place of a file, while a command runs that allows it.

use std::fs::File;
use std::io::{Read, Write};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Mutex, PoisonError};

use super::interrupt::TemporaryFolder;
use crate::error::{Error, Result};

/// Name of both streams on the command line.
const DASH: &str = "-";

/// Largest standard input, bytes: a bound for endless ones.
const LARGEST: u64 = 1 << 36;

static ALLOWED: AtomicBool = AtomicBool::new(false);

/// What was read from standard input, once it has been asked for: a file, because readers need its size, and
/// some read it twice.
static INPUT: Mutex<Option<TemporaryFolder>> = Mutex::new(None);

/// While this guard exists, the path `-` is standard input or output; otherwise it is a file of that name, as
/// `./-` always is.
#[derive(Debug)]
pub struct StandardStreams(());

impl StandardStreams {
    /// Makes `-` the standard streams.
    pub fn allow() -> Self {
        ALLOWED.store(true, Ordering::SeqCst);
        StandardStreams(())
    }
}

impl Drop for StandardStreams {
    fn drop(&mut self) {
        ALLOWED.store(false, Ordering::SeqCst);
        INPUT.lock().unwrap_or_else(PoisonError::into_inner).take();
    }
}

/// Whether a path stands for standard input or output.
pub fn is_standard(path: &Path) -> bool {
    path.as_os_str() == DASH && ALLOWED.load(Ordering::SeqCst)
}

/// Standard input from its beginning, however often it is opened.
pub(crate) fn input() -> Result<File> {
    let mut input = INPUT.lock().unwrap_or_else(PoisonError::into_inner);
    let file = match input.as_ref() {
        Some(folder) => stored_in(folder),
        None => {
            let folder = TemporaryFolder::new()?;
            let file = stored_in(&folder);
            store(std::io::stdin().lock(), &file, LARGEST)?;
            *input = Some(folder);
            file
        }
    };
    File::open(&file).map_err(|e| Error::read(&file, e))
}

fn stored_in(folder: &TemporaryFolder) -> PathBuf {
    folder.path().join("standard-input")
}

fn store(from: impl Read, file: &Path, most: u64) -> Result<()> {
    let mut stored = File::create_new(file).map_err(Error::write(file))?;
    let bytes =
        std::io::copy(&mut from.take(most.saturating_add(1)), &mut stored).map_err(Error::write(file))?;
    if bytes > most {
        return Err(Error::input(format!("standard input: larger than {most} bytes")));
    }
    Ok(())
}

/// Writes to standard output. A reader that closes it early, such as `head`, is no error.
///
/// # Errors
/// An I/O error.
pub fn print(bytes: &[u8]) -> Result<()> {
    let mut stdout = std::io::stdout().lock();
    match stdout.write_all(bytes).and_then(|()| stdout.flush()) {
        Err(e) if e.kind() == std::io::ErrorKind::BrokenPipe => Ok(()),
        written => written.map_err(Error::write(Path::new("standard output"))),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn endless_input_is_refused_and_a_dash_is_a_file_unless_it_is_allowed() {
        let place = tempfile::tempdir().unwrap();
        let at = |name: &str| place.path().join(name);
        store(&b"four"[..], &at("a"), 4).unwrap();
        assert_eq!(std::fs::read(at("a")).unwrap(), b"four");
        let message = store(std::io::repeat(0), &at("b"), 4).unwrap_err().to_string();
        assert_eq!(message, "standard input: larger than 4 bytes");

        assert!(!is_standard(Path::new("-")));
        let streams = StandardStreams::allow();
        assert!(is_standard(Path::new("-")) && !is_standard(Path::new("./-")));
        drop(streams);
        assert!(!is_standard(Path::new("-")));
    }
}
