//! What resolving a scenario finds: the files that it refers to, problems and warnings.

use std::path::{Path, PathBuf};

use microsig_core::problem::{Problem, Problems};
use microsig_core::render::Context;
use storage::{Error, input};

use super::language::schema::joined;
use super::spec;

/// A file that the scenario refers to.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Input {
    /// Key of the scenario that refers to it, such as `motion.tracks.file`.
    pub key: String,
    /// Its path in the dataset.
    pub path: String,
    /// The file that was read, an absolute path.
    pub source: PathBuf,
    /// Its content.
    pub bytes: Vec<u8>,
}

/// Files, problems and warnings of a scenario.
pub(super) struct Findings<'a> {
    /// Folder of the scenario, to which its paths are relative.
    folder: &'a Path,
    /// Where renderers keep their tables.
    pub(super) context: &'a Context,
    pub(super) inputs: Vec<Input>,
    pub(super) problems: Problems,
    pub(super) warnings: Vec<String>,
}

impl<'a> Findings<'a> {
    pub(super) fn new(folder: &'a Path, context: &'a Context) -> Self {
        let problems = Problems::default();
        Findings { folder, context, inputs: Vec::new(), problems, warnings: Vec::new() }
    }

    pub(super) fn warn(&mut self, warning: impl Into<String>) {
        self.warnings.push(warning.into());
    }

    /// Reads a file; an error becomes a problem at `key`.
    pub(super) fn read(&mut self, key: &str, file: &str) -> Option<(PathBuf, Vec<u8>)> {
        let path = self.folder.join(file);
        let bytes = self.problems.of(key, input::read(&path))?;
        Some((path, bytes))
    }

    /// Keeps a file that was read for `key`, to be copied to the dataset, and returns its path there; files with
    /// the same name are numbered.
    pub(super) fn keep(&mut self, key: &str, path: &Path, bytes: Vec<u8>) -> String {
        // Line breaks would split the lines of tables and checksums.
        let name = path.file_name().unwrap_or_default().to_string_lossy().replace(char::is_control, "_");
        let mut copy = format!("inputs/{name}");
        let mut number = 2;
        while self.inputs.iter().any(|input| input.path == copy) {
            copy = format!("inputs/{number}_{name}");
            number += 1;
        }
        // Fails only for an empty path.
        let source = std::path::absolute(path).unwrap_or_else(|_| path.to_owned());
        self.inputs.push(Input { key: key.to_owned(), path: copy.clone(), source, bytes });
        copy
    }
}

/// Collects the problems of results.
pub(super) trait Collect {
    /// The value of a result. The problems of an error are added at their keys, if the language has these,
    /// otherwise at `path`; keys may be relative to it.
    fn of<T, E: Into<Error>>(&mut self, path: &str, result: Result<T, E>) -> Option<T>;
}

impl Collect for Problems {
    fn of<T, E: Into<Error>>(&mut self, path: &str, result: Result<T, E>) -> Option<T> {
        let found = match result.map_err(Into::into) {
            Ok(value) => return Some(value),
            Err(Error::Problems(found)) => {
                self.0.extend(found);
                return None;
            }
            Err(Error::Flow(flows::Error::Parameter(problem))) => vec![problem],
            Err(Error::Optics(microsig_core::Error::Malformed(found))) => found,
            Err(error) => error.problems().into_iter().map(|text| Problem::other("", text)).collect(),
        };
        for problem in found {
            let keys = [joined(path, &problem.path), problem.path.to_string()];
            let is_key = |key: &String| !problem.path.is_empty() && spec::schema().find(key).is_some();
            self.push(match keys.into_iter().find(is_key) {
                Some(key) => Problem { path: key.into(), place: None, ..problem },
                None => Problem::other(path, problem.to_string()),
            });
        }
        None
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_kept_file_has_a_name_on_one_line() {
        let context = Context::default();
        let mut findings = Findings::new(Path::new("."), &context);
        let mut keep = |name| findings.keep("particles.number", Path::new(name), Vec::new());
        assert_eq!([keep("a\nb.txt"), keep("a_b.txt")], ["inputs/a_b.txt", "inputs/2_a_b.txt"]);
    }
}
