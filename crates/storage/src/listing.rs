//! Files of folders in natural order, and patterns of their names.

use std::path::{Path, PathBuf};

use crate::error::{Error, Result};

/// The visible files of a folder in natural order: `img2.tif` before `img10.tif`.
///
/// # Errors
/// A folder that cannot be read; names that are not UTF-8.
pub fn listed(folder: &Path) -> Result<Vec<PathBuf>> {
    let folder = if folder.as_os_str().is_empty() { Path::new(".") } else { folder };
    let failed = |e| Error::read(folder, e);
    let mut names = Vec::new();
    for entry in std::fs::read_dir(folder).map_err(failed)? {
        let path = entry.map_err(failed)?.path();
        let Some(name) = path.file_name().and_then(|name| name.to_str()) else {
            return Err(Error::input(format!("{}: the name is not UTF-8", path.display())));
        };
        if !name.starts_with('.') && path.is_file() {
            names.push(name.to_owned());
        }
    }
    names.sort_by(|a, b| natord::compare(a, b));
    Ok(names.into_iter().map(|name| folder.join(name)).collect())
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn patterns_fit_names() {
        for (pattern, name, fits) in [
            ("*.tif", "a.tif", true),
            ("a?c*", "abcd", true),
            ("*b*d", "abcbd", true),
            ("a*b", "acd", false),
            ("a", "ab", false),
        ] {
            assert_eq!(fits(pattern, name), fits, "{pattern} {name}");
        }
    }
}
