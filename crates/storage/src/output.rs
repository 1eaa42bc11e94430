use std::fs::File;
use std::io::BufWriter;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use super::checksums::Fingerprint;
use super::file::{self, Placed};
use super::interrupt::pause_if_interrupted;
use super::journal::{Journal, slashed};
use super::lock::lock_name;
use crate::error::{Error, Result};

/// A folder that files are written into, by their path in it (with `/`). If it is under construction, each file
/// is entered in its journal first, so that whatever is left of an interrupted run can be removed or reused.
#[derive(Debug, Clone)]
pub struct OutputFolder {
    path: PathBuf,
    journal: Option<Arc<Journal>>,
    /// Path in the folder of the journal; ends with `/` unless it is empty.
    within: String,
}

impl OutputFolder {
    /// A folder that exists and belongs to the user: without a journal, so that none of its files is ever
    /// removed.
    pub fn existing(path: &Path) -> Self {
        OutputFolder { path: path.to_owned(), journal: None, within: String::new() }
    }

    /// A folder under construction.
    pub(crate) fn with_journal(path: &Path, journal: Arc<Journal>) -> Self {
        OutputFolder { journal: Some(journal), ..OutputFolder::existing(path) }
    }

    /// Path of the folder.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Path of a file or folder in it.
    pub fn join(&self, file: impl AsRef<Path>) -> PathBuf {
        self.path.join(file)
    }

    /// A folder in it, which is created with those above it if it does not exist.
    pub fn subfolder(&self, name: &str) -> Result<Self> {
        let path = self.join(name);
        std::fs::create_dir_all(&path).map_err(Error::write(&path))?;
        let within = format!("{}{name}/", self.within);
        Ok(OutputFolder { path, journal: self.journal.clone(), within })
    }

    /// Writes a file atomically: to a temporary file, which is then renamed.
    pub fn save(
        &self,
        file: impl AsRef<Path>,
        write: impl FnOnce(&mut BufWriter<&File>) -> Result<()>,
    ) -> Result<()> {
        self.start(&file)?;
        file::save(&self.join(file), write)
    }

    /// [`OutputFolder::save`] for contents in memory.
    pub fn save_bytes(&self, file: impl AsRef<Path>, bytes: impl AsRef<[u8]>) -> Result<()> {
        self.start(&file)?;
        file::save_bytes(&self.join(file), bytes.as_ref())
    }

    /// [`OutputFolder::save_bytes`] with permissions for the owner only.
    pub fn save_private(&self, file: impl AsRef<Path>, bytes: &[u8]) -> Result<()> {
        self.start(&file)?;
        file::save_private(&self.join(file), bytes)
    }

    /// Puts a file of another folder here: as a hard link if `link` and if the file system has links between
    /// the two places, as a copy otherwise. A symbolic link is followed.
    pub fn place(&self, file: impl AsRef<Path>, from: &Path, link: bool) -> Result<Placed> {
        self.start(&file)?;
        file::place(from, &self.join(file), link)
    }

    /// Creates a file that is written over a longer time: not atomically, so only in a folder under
    /// construction.
    pub fn create(&self, file: impl AsRef<Path>) -> Result<File> {
        self.start(&file)?;
        let path = self.join(file);
        File::create(&path).map_err(Error::write(&path))
    }

    /// Records the hash of a finished file: a run that resumes this one keeps the file.
    pub fn finished(&self, file: impl AsRef<Path>, fingerprint: &Fingerprint) -> Result<()> {
        let Some(journal) = &self.journal else { return Ok(()) };
        journal.finished(self.entry(file.as_ref()), fingerprint)
    }

    /// Path of a folder in it that is written as one of its own, with a lock and a journal, such as a
    /// dataset: its lock is recorded here, where it would remain if the process is killed.
    pub fn nested(&self, name: &str) -> Result<PathBuf> {
        self.start(lock_name(name.as_ref()))?;
        Ok(self.join(name))
    }

    fn start(&self, file: impl AsRef<Path>) -> Result<()> {
        pause_if_interrupted();
        let Some(journal) = &self.journal else { return Ok(()) };
        journal.started(self.entry(file.as_ref()))
    }

    /// A file as the journal names it.
    fn entry(&self, file: &Path) -> String {
        format!("{}{}", self.within, slashed(file))
    }
}
