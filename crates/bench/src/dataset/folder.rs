//! A folder that appears whole or not at all: it is made as `NAME.partial` and renamed when it is finished.

use std::path::{Path, PathBuf};

use crate::error::{Error, Result};

/// A folder in the making.
#[derive(Debug)]
pub struct Partial {
    partial: PathBuf,
    path: PathBuf,
    remove_on_drop: bool,
}

/// Where a folder is made before it has its name.
pub fn partial_name(path: &Path) -> PathBuf {
    let mut name = path.file_name().unwrap_or_default().to_owned();
    name.push(".partial");
    path.with_file_name(name)
}

/// Whether a folder's name says that it is unfinished.
pub fn is_partial(path: &Path) -> bool {
    path.extension().is_some_and(|e| e == "partial")
}

impl Partial {
    /// Begins the folder `path`, or goes on with one that was begun. With `remove_on_drop` an unfinished folder is
    /// removed again, else it stays to be resumed.
    pub fn create(path: &Path, remove_on_drop: bool) -> Result<Self> {
        if path.file_name().is_none() {
            return Err(Error::input(format!("{}: expected the name of a folder", path.display())));
        }
        let partial = partial_name(path);
        std::fs::create_dir_all(&partial).map_err(Error::write(&partial))?;
        Ok(Partial { partial, path: path.to_owned(), remove_on_drop })
    }

    /// Begins the folder `path` anew; if it is not finished, nothing is left of it.
    pub fn anew(path: &Path) -> Result<Self> {
        let left_over = partial_name(path);
        if left_over.exists() {
            std::fs::remove_dir_all(&left_over).map_err(Error::write(&left_over))?;
        }
        Partial::create(path, true)
    }

    /// Where to write.
    pub fn folder(&self) -> &Path {
        &self.partial
    }

    /// Gives the folder its name. With `replace`, a folder that stands there is removed first, if it holds the file of
    /// that name: nothing is ever removed that this program did not make.
    pub fn finish(mut self, replace: Option<&str>) -> Result<()> {
        if self.path.exists() {
            may_stand(&self.path, replace)?;
            std::fs::remove_dir_all(&self.path).map_err(Error::write(&self.path))?;
        }
        std::fs::rename(&self.partial, &self.path).map_err(Error::write(&self.path))?;
        self.remove_on_drop = false;
        Ok(())
    }
}

impl Drop for Partial {
    fn drop(&mut self) {
        if self.remove_on_drop {
            // Nothing more can be done about a failure here, and the name says that the folder is unfinished.
            let _ = std::fs::remove_dir_all(&self.partial);
        }
    }
}

/// Whether a folder of this name may be made: there is none, or one that `replace` allows to remove.
///
/// # Errors
/// [`Error::Exists`] without `replace`; [`Error::Input`] if what stands there was not made by this program.
pub fn may_stand(path: &Path, replace: Option<&str>) -> Result<()> {
    if !path.exists() {
        return Ok(());
    }
    let Some(mark) = replace else { return Err(Error::Exists(path.to_owned())) };
    let is_empty = std::fs::read_dir(path).is_ok_and(|mut entries| entries.next().is_none());
    if is_empty || path.join(mark).is_file() {
        return Ok(());
    }
    Err(Error::input(format!("{}: has no {mark}, so it is not replaced even with --force", path.display())))
}

/// All files below a folder, as sorted paths relative to it with `/` between the parts.
pub fn files_below(folder: &Path) -> Result<Vec<String>> {
    Files::below(folder)?.collect()
}

/// The files below a folder, one after the other in the order of [`files_below`].
///
/// Only the names in the folder that is being read, and in those that hold it, are in memory: a dataset has as many files
/// as frames.
pub(crate) struct Files {
    root: PathBuf,
    /// Folders that are being read, each in the one before it: their paths below the root, and what is still to come.
    open: Vec<(String, std::vec::IntoIter<String>)>,
}

impl Files {
    /// Reads the folder itself; those in it are read when their turn comes.
    pub(crate) fn below(folder: &Path) -> Result<Self> {
        let mut files = Files { root: folder.to_owned(), open: Vec::new() };
        files.enter(String::new())?;
        Ok(files)
    }

    fn enter(&mut self, prefix: String) -> Result<()> {
        let folder = self.root.join(&prefix);
        let mut names = Vec::new();
        for entry in std::fs::read_dir(&folder).map_err(|e| Error::read(&folder, e))? {
            let entry = entry.map_err(|e| Error::read(&folder, e))?;
            let mut name = entry.file_name().to_string_lossy().into_owned();
            // With the mark of a folder, names sort as the paths of all that is in it.
            if entry.path().is_dir() {
                name.push('/');
            }
            names.push(name);
        }
        names.sort_unstable();
        self.open.push((prefix, names.into_iter()));
        Ok(())
    }
}

impl Iterator for Files {
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
    fn a_folder_has_its_name_only_when_it_is_finished() {
        let place = tempfile::tempdir().unwrap();
        let path = place.path().join("set.v1");
        let partial = Partial::create(&path, true).unwrap();
        assert!(is_partial(partial.folder()) && !path.exists());
        drop(partial);
        assert!(!partial_name(&path).exists());

        let partial = Partial::create(&path, true).unwrap();
        std::fs::write(partial.folder().join("a"), "1").unwrap();
        partial.finish(None).unwrap();
        assert_eq!(files_below(&path).unwrap(), ["a"]);

        let other = Partial::create(&path, true).unwrap();
        assert!(other.finish(Some("mark")).unwrap_err().to_string().contains("not replaced"));
        assert_eq!(files_below(&path).unwrap(), ["a"], "nothing was removed");

        let again = Partial::create(&path, true).unwrap();
        assert!(matches!(again.finish(None), Err(Error::Exists(_))));
    }

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
