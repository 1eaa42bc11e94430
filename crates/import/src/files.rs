//! Files given by paths, folders and patterns, in natural order: `img2.tif` before `img10.tif`.

use std::path::{Path, PathBuf};

use storage::error::{Error, Result};
use storage::listing::fits;

/// The TIFF files of all arguments, in the order of the arguments.
///
/// # Errors
/// An argument without files.
pub(crate) fn of(arguments: &[PathBuf]) -> Result<Vec<PathBuf>> {
    let mut files = Vec::new();
    for argument in arguments {
        let found = if argument.is_dir() {
            listed(argument, is_tiff)?
        } else {
            let pattern = argument.file_name().unwrap_or_default().to_string_lossy().into_owned();
            if pattern.contains(['*', '?']) && !argument.exists() {
                let folder = argument.parent().filter(|p| !p.as_os_str().is_empty());
                listed(folder.unwrap_or(Path::new(".")), |name| fits(&pattern, name))?
            } else {
                vec![argument.clone()]
            }
        };
        if found.is_empty() {
            let what =
                if argument.is_dir() { "a folder without *.tif files" } else { "no file has such a name" };
            return Err(Error::input(format!("{}: {what}; expected images", argument.display())));
        }
        files.extend(found);
    }
    Ok(files)
}

fn is_tiff(name: &str) -> bool {
    let lower = name.to_ascii_lowercase();
    lower.ends_with(".tif") || lower.ends_with(".tiff")
}

/// Files of a folder in natural order.
fn listed(folder: &Path, wanted: impl Fn(&str) -> bool) -> Result<Vec<PathBuf>> {
    let entries = std::fs::read_dir(folder).map_err(|e| Error::read(folder, e))?;
    let mut names: Vec<String> = entries
        .filter_map(|entry| entry.ok()?.file_name().into_string().ok())
        .filter(|name| !name.starts_with('.') && wanted(name))
        .collect();
    names.sort_by(|a, b| natord::compare(a, b));
    Ok(names.into_iter().map(|name| folder.join(name)).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn files_are_in_natural_order() {
        let place = tempfile::tempdir().unwrap();
        for name in ["img10.tif", "img2.TIF", "img1.tiff", "notes.txt", ".img0.tif"] {
            std::fs::write(place.path().join(name), "").unwrap();
        }
        let names = |argument: &Path| -> Vec<String> {
            let name = |path: &PathBuf| path.file_name().unwrap().to_string_lossy().into_owned();
            of(&[argument.to_owned()]).unwrap().iter().map(name).collect()
        };
        assert_eq!(names(place.path()), ["img1.tiff", "img2.TIF", "img10.tif"]);
        assert_eq!(names(&place.path().join("img1*")), ["img1.tiff", "img10.tif"]);
        assert!(
            of(&[place.path().join("b*.tif")]).unwrap_err().to_string().contains("no file has such a name")
        );
    }
}
