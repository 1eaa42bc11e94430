//! Lists the files below a folder, sorted by path.

use std::path::{Path, PathBuf};

use crate::error::{Error, Result};

/// All files below a folder, as sorted relative paths with `/` as separator.
pub fn files_below(folder: &Path) -> Result<Vec<String>> {
    FilesBelow::new(folder)?.collect()
}

/// Names of the entries of a folder that are wanted, in natural order: `img2.tif` before `img10.tif`. Errors:
/// a folder that cannot be read; a wanted name that is not UTF-8, which tables could not hold.
pub fn names(folder: &Path, wanted: impl Fn(&str) -> bool) -> Result<Vec<String>> {
    let mut names = Vec::new();
    for entry in std::fs::read_dir(folder).map_err(|e| Error::read(folder, e))? {
        let name = entry.map_err(|e| Error::read(folder, e))?.file_name();
        if !wanted(&name.to_string_lossy()) {
            continue;
        }
        names.push(name.into_string().map_err(|name| {
            Error::input(format!("{}: expected a name in UTF-8", folder.join(name).display()))
        })?);
    }
    names.sort_by(|a, b| natord::compare(a, b).then_with(|| a.cmp(b)));
    Ok(names)
}

/// Whether a name belongs to a TIFF file that is not hidden.
pub fn is_tiff(name: &str) -> bool {
    let lower = name.to_ascii_lowercase();
    !name.starts_with('.') && (lower.ends_with(".tif") || lower.ends_with(".tiff"))
}

/// Whether a name fits a pattern in which `*` is any text and `?` any character.
pub fn fits(pattern: &str, name: &str) -> bool {
    let (pattern, name): (Vec<char>, Vec<char>) = (pattern.chars().collect(), name.chars().collect());
    // The last `*` and how much of the name it covers.
    let (mut p, mut n, mut star) = (0, 0, None);
    while n < name.len() {
        match pattern.get(p) {
            Some('*') => {
                star = Some((p, n));
                p += 1;
            }
            Some(c) if *c == '?' || *c == name[n] => (p, n) = (p + 1, n + 1),
            _ => match star {
                Some((at, covered)) => {
                    star = Some((at, covered + 1));
                    (p, n) = (at + 1, covered + 1);
                }
                None => return false,
            },
        }
    }
    pattern[p..].iter().all(|c| *c == '*')
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
    fn patterns_fit_names() {
        for (pattern, name, expected) in [
            ("*.tif", "a.tif", true),
            ("a?c*", "abcd", true),
            ("*b*d", "abcbd", true),
            ("a*b", "acd", false),
            ("a", "ab", false),
        ] {
            assert_eq!(fits(pattern, name), expected, "{pattern} {name}");
        }
    }

    #[test]
    fn names_are_in_natural_order_and_in_utf8() {
        let place = tempfile::tempdir().unwrap();
        for name in ["img10.tif", "img2.TIF", "img1.tiff", "notes.txt", ".img0.tif"] {
            std::fs::write(place.path().join(name), "").unwrap();
        }
        assert_eq!(names(place.path(), is_tiff).unwrap(), ["img1.tiff", "img2.TIF", "img10.tif"]);
        assert!(names(&place.path().join("none"), is_tiff).is_err());
        #[cfg(unix)]
        {
            let name: &std::ffi::OsStr = std::os::unix::ffi::OsStrExt::from_bytes(b"\xb5m.tif");
            std::fs::write(place.path().join(name), "").unwrap();
            let message = names(place.path(), is_tiff).unwrap_err().to_string();
            assert!(message.contains("expected a name in UTF-8"), "{message}");
            assert_eq!(names(place.path(), |name| name == "notes.txt").unwrap(), ["notes.txt"]);
        }
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
