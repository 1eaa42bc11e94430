//! Files that a command is given: `-` is standard input or standard output, `./-` is a file of that name.
//! Only [`InputFile::argument`] and [`OutputFile::argument`] give `-` this meaning; elsewhere it is an
//! ordinary file.

use std::fs::File;
use std::io::{Read, Write};
use std::ops::Deref;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};

use super::interrupt::TemporaryFolder;
use super::{file, input};
use crate::error::{Error, Result};

/// Name of both streams on the command line, and in messages.
const DASH: &str = "-";

/// Largest standard input, bytes: a bound for endless ones.
const LARGEST: u64 = 1 << 36;

/// A file that is read, or standard input. As a path it is the name in messages: `-` for standard input, or as
/// given to [`InputFile::shown_as`], such as a file's name in its archive.
#[derive(Debug, Clone)]
pub struct InputFile {
    path: PathBuf,
    contents: Contents,
}

/// Where the contents of an [`InputFile`] are.
#[derive(Debug, Clone)]
enum Contents {
    /// At its path.
    Here,
    /// In another file.
    At(PathBuf),
    /// In standard input.
    Standard(StandardInput),
}

/// Standard input, kept in a file once it has been asked for, because readers need its size, and some read it
/// twice. Of several arguments `-`, the first one that is read has all of it.
type StandardInput = Arc<Mutex<Option<TemporaryFolder>>>;

impl InputFile {
    /// An argument of a command: `-` is standard input.
    pub fn argument(path: impl Into<PathBuf>) -> Self {
        let path = path.into();
        let contents =
            if path.as_os_str() == DASH { Contents::Standard(Arc::default()) } else { Contents::Here };
        InputFile { path, contents }
    }

    /// A file that messages name by another path.
    pub fn shown_as(file: impl Into<PathBuf>, shown: impl Into<PathBuf>) -> Self {
        InputFile { path: shown.into(), contents: Contents::At(file.into()) }
    }

    /// Whether this is standard input.
    pub fn is_standard(&self) -> bool {
        matches!(self.contents, Contents::Standard(_))
    }

    /// Path of a file with these contents, for readers of paths: of standard input, where it is kept.
    pub fn file(&self) -> Result<PathBuf> {
        let standard = match &self.contents {
            Contents::Here => return Ok(self.path.clone()),
            Contents::At(file) => return Ok(file.clone()),
            Contents::Standard(standard) => standard,
        };
        let mut standard = standard.lock().unwrap_or_else(PoisonError::into_inner);
        match standard.as_ref() {
            Some(folder) => Ok(stored_in(folder)),
            None => {
                let folder = TemporaryFolder::new()?;
                let file = stored_in(&folder);
                store(std::io::stdin().lock(), &file, LARGEST)?;
                *standard = Some(folder);
                Ok(file)
            }
        }
    }

    /// Opens the file as [`input::open`] does; standard input from its beginning, however often it is opened.
    /// Errors: as [`input::open`]; standard input that is too large or cannot be stored.
    pub fn open(&self) -> Result<File> {
        input::open_shown(&self.file()?, &self.path)
    }
}

impl<P: Into<PathBuf>> From<P> for InputFile {
    fn from(path: P) -> Self {
        InputFile { path: path.into(), contents: Contents::Here }
    }
}

impl From<&InputFile> for InputFile {
    fn from(file: &InputFile) -> Self {
        file.clone()
    }
}

impl Deref for InputFile {
    type Target = Path;

    fn deref(&self) -> &Path {
        &self.path
    }
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

/// A file that a result is written to, or standard output. As a path, for messages, standard output is `-`.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct OutputFile {
    path: PathBuf,
    is_standard: bool,
}

impl OutputFile {
    /// An argument of a command: `-` is standard output.
    pub fn argument(path: impl Into<PathBuf>) -> Self {
        let path = path.into();
        OutputFile { is_standard: path.as_os_str() == DASH, path }
    }

    /// Whether this is standard output.
    pub fn is_standard(&self) -> bool {
        self.is_standard
    }

    /// Checks that a result may be written: to standard output always.
    pub fn may_write(&self, force: bool) -> Result<()> {
        if self.is_standard { Ok(()) } else { file::may_write(&self.path, force) }
    }

    /// Checks that the file lies outside of finished datasets, as [`file::outside_datasets`].
    pub fn outside_datasets(&self) -> Result<()> {
        if self.is_standard { Ok(()) } else { file::outside_datasets(&self.path) }
    }

    /// Writes a result, as [`file::save_result`].
    pub fn save(&self, force: bool, bytes: impl AsRef<[u8]>) -> Result<()> {
        let bytes = bytes.as_ref();
        if self.is_standard { print(bytes) } else { file::save_result(&self.path, force, bytes) }
    }
}

impl<P: Into<PathBuf>> From<P> for OutputFile {
    fn from(path: P) -> Self {
        OutputFile { path: path.into(), is_standard: false }
    }
}

impl Deref for OutputFile {
    type Target = Path;

    fn deref(&self) -> &Path {
        &self.path
    }
}

/// Writes to standard output. A reader that closes it early, such as `head`, is no error.
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
    fn endless_input_is_refused_and_a_dash_is_a_file_unless_it_is_an_argument() {
        let place = tempfile::tempdir().unwrap();
        let at = |name: &str| place.path().join(name);
        store(&b"four"[..], &at("a"), 4).unwrap();
        assert_eq!(std::fs::read(at("a")).unwrap(), b"four");
        let message = store(std::io::repeat(0), &at("b"), 4).unwrap_err().to_string();
        assert_eq!(message, "standard input: larger than 4 bytes");

        assert!(InputFile::argument("-").is_standard() && OutputFile::argument("-").is_standard());
        assert!(!InputFile::argument("./-").is_standard() && !OutputFile::argument("./-").is_standard());
        assert!(!InputFile::from("-").is_standard() && !OutputFile::from("-").is_standard());
    }
}
