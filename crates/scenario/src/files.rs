//! The files that scenarios name.

use std::path::{Path, PathBuf};

use super::language::problems::Problems;
use storage::error::Error;

/// A file that the scenario names.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Input {
    /// Its path in the dataset.
    pub path: String,
    /// What it holds.
    pub bytes: Vec<u8>,
}

/// The files that the scenario names.
pub(super) struct Files<'a> {
    /// Where the scenario lies, and paths in it begin.
    pub(super) folder: &'a Path,
    pub(super) inputs: Vec<Input>,
}

impl Files<'_> {
    /// Reads a file.
    pub(super) fn read(&self, key: &str, file: &str, problems: &mut Problems) -> Option<(PathBuf, Vec<u8>)> {
        let path = self.folder.join(file);
        let bytes = problems.of(key, std::fs::read(&path).map_err(|e| Error::read(&path, e)))?;
        Some((path, bytes))
    }

    /// Keeps a file for the dataset and gives its path there; files of one name get numbers.
    pub(super) fn keep(&mut self, path: &Path, bytes: Vec<u8>) -> String {
        let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        let mut copy = format!("inputs/{name}");
        let mut number = 2;
        while self.inputs.iter().any(|input| input.path == copy) {
            copy = format!("inputs/{number}_{name}");
            number += 1;
        }
        self.inputs.push(Input { path: copy.clone(), bytes });
        copy
    }
}
