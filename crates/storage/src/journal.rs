//! The journal of a folder under construction: every file that microsig starts to write there, and the hash
//! of every finished one, one JSON object per line.
//!
//! A file is recorded before it gets its final name, so that every file is listed no matter how the run ends.
//! Only listed files are ever removed; only files that match their recorded hash are reused.

use std::collections::{BTreeMap, BTreeSet, HashSet};
use std::fs::{File, OpenOptions};
use std::hash::{DefaultHasher, Hash, Hasher};
use std::io::Write;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};

use serde::{Deserialize, Serialize};

use super::checksums::Fingerprint;
use super::input::read_text;
use crate::error::{Error, Result};

/// Name of the journal.
pub const JOURNAL: &str = ".microsig-journal";

/// Prefix of temporary files; a later run uses it to recognize files left by an interrupted one.
pub(super) const TEMPORARY: &str = ".unfinished-";

#[derive(Debug, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
enum Entry {
    /// Hashes of the inputs of the folder, by name.
    Source(BTreeMap<String, String>),
    /// A file that was started, by its path in the folder.
    File(String),
    /// A finished file.
    Done { file: String, bytes: u64, sha256: String },
}

/// Contents of a journal.
#[derive(Debug, Default)]
pub struct Listing {
    /// Hashes of the inputs of the folder, by name, if recorded.
    pub source: Option<BTreeMap<String, String>>,
    /// Files that were started.
    pub files: BTreeSet<String>,
    /// Size and SHA-256 of finished files.
    pub done: BTreeMap<String, (u64, String)>,
}

impl Listing {
    /// Whether a file was finished with this fingerprint.
    pub fn has(&self, file: &str, fingerprint: &Fingerprint) -> bool {
        let entry = self.done.get(file);
        entry
            .is_some_and(|(bytes, sha)| *bytes == fingerprint.bytes && *sha == fingerprint.sha256.to_string())
    }
}

/// A journal that is being written.
#[derive(Debug)]
pub(crate) struct Journal {
    path: PathBuf,
    file: Mutex<File>,
    /// Hashes of the paths recorded by this process (hashes save memory: there is one entry per file).
    entered: Mutex<HashSet<u64>>,
}

impl Journal {
    /// Starts the journal of a folder, or continues an existing one.
    pub(crate) fn open(folder: &Path) -> Result<Arc<Self>> {
        let path = folder.join(JOURNAL);
        let file = OpenOptions::new().create(true).append(true).open(&path).map_err(Error::write(&path))?;
        let journal = Arc::new(Journal { path, file: Mutex::new(file), entered: Mutex::default() });
        // Terminates a line truncated by a crash.
        journal.write("\n")?;
        Ok(journal)
    }

    pub(crate) fn source(&self, hashes: &BTreeMap<String, String>) -> Result<()> {
        self.add(&Entry::Source(hashes.clone()))
    }

    /// Records a file that is about to be written, by its path in the folder.
    pub(crate) fn started(&self, file: String) -> Result<()> {
        self.add(&Entry::File(file))
    }

    pub(crate) fn finished(&self, file: String, fingerprint: &Fingerprint) -> Result<()> {
        self.add(&Entry::Done { file, bytes: fingerprint.bytes, sha256: fingerprint.sha256.to_string() })
    }

    /// Whether this process has recorded a file.
    pub(crate) fn lists(&self, file: &str) -> bool {
        self.entered.lock().unwrap_or_else(PoisonError::into_inner).contains(&key(file))
    }

    fn add(&self, entry: &Entry) -> Result<()> {
        if let Entry::File(file) | Entry::Done { file, .. } = entry {
            self.entered.lock().unwrap_or_else(PoisonError::into_inner).insert(key(file));
        }
        let line = serde_json::to_string(entry).map_err(|e| Error::write(&self.path)(e.into()))?;
        self.write(&format!("{line}\n"))
    }

    fn write(&self, line: &str) -> Result<()> {
        let mut file = self.file.lock().unwrap_or_else(PoisonError::into_inner);
        file.write_all(line.as_bytes()).map_err(Error::write(&self.path))
    }
}

fn key(file: &str) -> u64 {
    let mut hasher = DefaultHasher::new();
    file.hash(&mut hasher);
    hasher.finish()
}

/// A relative path with `/` as separator.
pub(super) fn slashed(path: &Path) -> String {
    path.components().map(|part| part.as_os_str().to_string_lossy()).collect::<Vec<_>>().join("/")
}

/// Reads the journal of a folder; `None` if it does not exist. Truncated lines are skipped.
pub fn read(folder: &Path) -> Result<Option<Listing>> {
    let path = folder.join(JOURNAL);
    if !path.is_file() {
        return Ok(None);
    }
    let mut listing = Listing::default();
    for entry in read_text(&path)?.lines().filter_map(|line| serde_json::from_str(line).ok()) {
        match entry {
            Entry::Source(hash) => listing.source = Some(hash),
            Entry::File(file) => {
                // The file is being rewritten, so its earlier hash is invalid.
                listing.done.remove(&file);
                listing.files.insert(file);
            }
            Entry::Done { file, bytes, sha256 } => {
                listing.done.insert(file, (bytes, sha256));
            }
        }
    }
    Ok(Some(listing))
}

/// Replaces the journal of a finished folder by a sorted list of its files, independent of the order of
/// writing.
pub(crate) fn keep_list(folder: &Path) -> Result<()> {
    let path = folder.join(JOURNAL);
    let mut text = String::new();
    let files = read(folder)?.unwrap_or_default().files;
    for file in files.into_iter().filter(|file| folder.join(file).exists()) {
        let line = serde_json::to_string(&Entry::File(file)).map_err(|e| Error::write(&path)(e.into()))?;
        text += &line;
        text.push('\n');
    }
    // After a crash, one of the two lists exists.
    let unfinished = folder.join(format!("{TEMPORARY}journal"));
    std::fs::write(&unfinished, text).map_err(Error::write(&unfinished))?;
    std::fs::rename(&unfinished, &path).map_err(Error::write(&path))
}

#[cfg(test)]
mod tests {
    use super::super::output::OutputFolder;
    use super::*;

    #[test]
    fn files_are_listed_before_they_are_there_and_a_cut_off_line_is_left_out() {
        let place = tempfile::tempdir().unwrap();
        let folder = place.path();
        assert!(read(folder).unwrap().is_none());
        let journal = Journal::open(folder).unwrap();
        let source = BTreeMap::from([("a".to_owned(), "b".to_owned())]);
        journal.source(&source).unwrap();
        let output = OutputFolder::with_journal(folder, Arc::clone(&journal));
        output.subfolder("images").unwrap().save_bytes("a\nb.tif", b"x").unwrap();
        let fingerprint = Fingerprint::of(b"x");
        output.finished("images/a\nb.tif", &fingerprint).unwrap();
        journal.write("{\"file\":\"cut").unwrap();

        let journal = Journal::open(folder).unwrap();
        OutputFolder::with_journal(folder, Arc::clone(&journal)).create("next").unwrap();
        OutputFolder::existing(folder).save_bytes("unlisted", b"").unwrap();
        let listing = read(folder).unwrap().unwrap();
        assert_eq!(listing.source, Some(source));
        assert!(journal.lists("next") && !journal.lists("unlisted"));
        assert_eq!(listing.files.iter().collect::<Vec<_>>(), ["images/a\nb.tif", "next"]);
        assert!(listing.has("images/a\nb.tif", &fingerprint));
        assert!(!listing.has("images/a\nb.tif", &Fingerprint::of(b"")) && !listing.has("next", &fingerprint));
    }
}
