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

    /// Where to write.
    pub fn folder(&self) -> &Path {
        &self.partial
    }

    /// Gives the folder its name; with `replace`, what stands there is removed first.
    pub fn finish(mut self, replace: bool) -> Result<()> {
        if self.path.exists() {
            if !replace {
                return Err(Error::Exists(self.path.clone()));
            }
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

/// All files below a folder, as sorted paths relative to it with `/` between the parts.
pub fn files_below(folder: &Path) -> Result<Vec<String>> {
    fn walk(folder: &Path, prefix: &str, files: &mut Vec<String>) -> Result<()> {
        for entry in std::fs::read_dir(folder).map_err(|e| Error::read(folder, e))? {
            let entry = entry.map_err(|e| Error::read(folder, e))?;
            let name = format!("{prefix}{}", entry.file_name().to_string_lossy());
            if entry.path().is_dir() {
                walk(&entry.path(), &format!("{name}/"), files)?;
            } else {
                files.push(name);
            }
        }
        Ok(())
    }
    let mut files = Vec::new();
    walk(folder, "", &mut files)?;
    files.sort();
    Ok(files)
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
        partial.finish(false).unwrap();
        assert_eq!(files_below(&path).unwrap(), ["a"]);

        let again = Partial::create(&path, true).unwrap();
        assert!(matches!(again.finish(false), Err(Error::Exists(_))));
    }
}
