//! Lists the files below a folder, sorted by path.

use std::path::{Path, PathBuf};

use crate::error::{Error, Result};

/// All files below a folder, as sorted relative paths with `/` as separator.
pub fn files_below(folder: &Path) -> Result<Vec<String>> {
    FilesBelow::new(folder)?.collect()
}

/// Iterator over the files below a folder, in the order of [`files_below`].
///
/// Only the names in the current folder and its parents are held in memory: a dataset has as many files as
/// frames.
pub struct FilesBelow {
    root: PathBuf,
    /// The current folder and its parents: relative path, and the remaining names.
    open: Vec<(String, std::vec::IntoIter<String>)>,
}

impl FilesBelow {
    /// Starts at a folder; nested folders are read when they are reached.
    pub fn new(folder: &Path) -> Result<Self> {
        let mut files = FilesBelow { root: folder.to_owned(), open: Vec::new() };
        files.enter(String::new())?;
        Ok(files)
    }

    fn enter(&mut self, prefix: String) -> Result<()> {
        let folder = self.root.join(&prefix);
        let mut names = Vec::new();
        for entry in std::fs::read_dir(&folder).map_err(|e| Error::read(&folder, e))? {
            let entry = entry.map_err(|e| Error::read(&folder, e))?;
            let mut name = entry.file_name().to_string_lossy().into_owned();
            // With a trailing `/`, the names of folders sort like the paths of their contents. Links are not
            // followed: they may form cycles.
            if entry.file_type().map_err(|e| Error::read(&folder, e))?.is_dir() {
                name.push('/');
            }
            names.push(name);
        }
        names.sort_unstable();
        self.open.push((prefix, names.into_iter()));
        Ok(())
    }
}

impl Iterator for FilesBelow {
    type Item = Result<String>;

    fn next(&mut self) -> Option<Self::Item> {
        loop {
            let (prefix, names) = self.open.last_mut()?;
            let Some(name) = names.next() else {
                self.open.pop();
                continue;
            };
            let path = format!("{prefix}{name}");
            if !path.ends_with('/') {
                return Some(Ok(path));
            }
            if let Err(error) = self.enter(path) {
                return Some(Err(error));
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn files_come_in_the_order_of_their_paths() {
        let place = tempfile::tempdir().unwrap();
        let paths = ["a", "b/c/x", "b/d", "b-", "b.", "b0", "b/c-", "z/y"];
        for path in paths {
            let path = place.path().join(path);
            std::fs::create_dir_all(path.parent().unwrap()).unwrap();
            std::fs::write(path, "").unwrap();
        }
        std::fs::create_dir(place.path().join("empty")).unwrap();
        let mut sorted = paths;
        sorted.sort_unstable();
        assert_eq!(files_below(place.path()).unwrap(), sorted);
    }
}
