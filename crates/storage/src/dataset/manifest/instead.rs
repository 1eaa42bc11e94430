//! What a path is if it is no dataset, and which dataset may be meant: a folder in it or around it.

use std::path::Path;

use super::MANIFEST;

/// A message on a path without a manifest.
pub(super) fn no_dataset(path: &Path) -> String {
    let name = path.display();
    match std::fs::metadata(path) {
        Err(e) => return format!("{name}: {e}"),
        Ok(about) if !about.is_dir() => {
            return format!("{name}: a file; expected the folder of a dataset, which has {MANIFEST}");
        }
        Ok(_) => {}
    }
    let is_one = |path: &Path| path.join(MANIFEST).is_file();
    let mut inside: Vec<String> = std::fs::read_dir(path)
        .into_iter()
        .flat_map(|entries| entries.flatten())
        .filter(|entry| is_one(&entry.path()))
        .map(|entry| entry.file_name().to_string_lossy().into_owned())
        .collect();
    inside.sort();
    let around = path.canonicalize().ok().and_then(|whole| whole.parent().map(Path::to_owned));
    let hint = match (inside.as_slice(), around.filter(|around| is_one(around))) {
        ([], None) => String::new(),
        ([], Some(around)) => format!("; {} is one", around.display()),
        ([only], _) => format!("; {} is one", path.join(only).display()),
        ([first, ..], _) => {
            format!(
                "; it holds {} datasets, of which to give one: {}",
                inside.len(),
                path.join(first).display()
            )
        }
    };
    format!("{name}: no dataset: it has no {MANIFEST}{hint}")
}
