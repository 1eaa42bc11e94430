//! Safe removal of folders written by microsig: only files listed in a journal or in a dataset's checksums
//! are removed.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use serde::Deserialize;

use super::checksums::{self, SHA256SUMS};
use super::input::read_text;
use super::journal::{self, JOURNAL, Journal, TEMPORARY};
use super::walk::files_below;
use crate::error::{Error, Result};

pub(super) const MANIFEST: &str = "datapackage.json";

/// Files that microsig wrote into a folder, from its journal and from the checksums of a dataset: a dataset
/// loses its journal when it is finished, and gets another one if it is resumed after that. `None` if it has
/// neither.
fn listed(folder: &Path) -> Result<Option<BTreeSet<String>>> {
    let journal = journal::read(folder)?.map(|listing| {
        let mut files = listing.files;
        files.insert(JOURNAL.to_owned());
        files
    });
    let checksums = match in_checksums(folder) {
        // Temporary files of an interrupted run.
        Err(_) if journal.is_some() => None,
        read => read?,
    };
    Ok(match (journal, checksums) {
        (Some(journal), Some(checksums)) => Some(journal.into_iter().chain(checksums).collect()),
        (journal, checksums) => journal.or(checksums),
    })
}

/// The files that the checksums of a dataset list; `None` if it has none.
fn in_checksums(folder: &Path) -> Result<Option<BTreeSet<String>>> {
    /// The part of a manifest that identifies the generator.
    #[derive(Deserialize)]
    struct Head {
        microsig: Generator,
    }
    #[derive(Deserialize)]
    struct Generator {
        generator: String,
    }
    let (sums, manifest) = (folder.join(SHA256SUMS), folder.join(MANIFEST));
    if !sums.is_file() || !manifest.is_file() {
        return Ok(None);
    }
    let head: Option<Head> = serde_json::from_str(&read_text(&manifest)?).ok();
    if head.is_none_or(|head| head.microsig.generator != "microsig") {
        return Ok(None);
    }
    let sums = checksums::read(&read_text(&sums)?, &sums.display().to_string())?;
    Ok(Some(sums.into_keys().chain([SHA256SUMS.to_owned()]).collect()))
}

/// The files and the folders to remove, each folder after its contents. Errors: files that microsig did not
/// write; the first of them are named.
pub(super) fn plan(folder: &Path) -> Result<(Vec<PathBuf>, Vec<PathBuf>)> {
    let (mut files, mut folders, mut others) = (Vec::new(), Vec::new(), Vec::new());
    walk(folder, &mut Vec::new(), &mut files, &mut folders, &mut others)?;
    if others.is_empty() {
        return Ok((files, folders));
    }
    const NAMED: usize = 3;
    let named: Vec<String> = others.iter().take(NAMED).map(|path| path.display().to_string()).collect();
    let more =
        if others.len() > NAMED { format!(" and {} more", others.len() - NAMED) } else { String::new() };
    Err(Error::input(format!(
        "{}: contains files that microsig did not write: {}{more}; move them elsewhere first, or remove the folder yourself",
        folder.display(),
        named.join(", ")
    )))
}

/// Visits a folder; `lists` contains the parent folders with their lists of files.
fn walk(
    folder: &Path,
    lists: &mut Vec<(PathBuf, BTreeSet<String>)>,
    files: &mut Vec<PathBuf>,
    folders: &mut Vec<PathBuf>,
    others: &mut Vec<PathBuf>,
) -> Result<()> {
    // A nested folder may have its own list, like the datasets in a release.
    let own = listed(folder)?.map(|list| (folder.to_owned(), list));
    let depth = lists.len();
    lists.extend(own);
    let mut entries = std::fs::read_dir(folder)
        .and_then(Iterator::collect::<std::io::Result<Vec<_>>>)
        .map_err(|e| Error::read(folder, e))?;
    entries.sort_by_key(std::fs::DirEntry::file_name);
    for entry in entries {
        let place = entry.path();
        let is_listed = |(root, list): &(PathBuf, BTreeSet<String>)| {
            place.strip_prefix(root).is_ok_and(|within| list.contains(&journal::slashed(within)))
        };
        // Symbolic links are treated as files, no matter what they point to.
        if entry.file_type().map_err(|e| Error::read(&place, e))?.is_dir() {
            walk(&place, lists, files, folders, others)?;
        } else if entry.file_name().to_string_lossy().starts_with(TEMPORARY) || lists.iter().any(is_listed) {
            files.push(place);
        } else {
            others.push(place);
        }
    }
    lists.truncate(depth);
    folders.push(folder.to_owned());
    Ok(())
}

/// The files in an order in which a later run can complete the removal after a crash: lists last, and of a dataset, whose
/// checksums are no list without its manifest, a journal of these two.
fn files_to_remove(mut files: Vec<PathBuf>, folders: &[PathBuf]) -> Vec<PathBuf> {
    for folder in folders.iter().filter(|folder| folder.join(SHA256SUMS).is_file()) {
        // Best effort: a full disk is no reason not to remove files.
        let _ = Journal::open(folder).and_then(|journal| {
            journal.started(SHA256SUMS.to_owned())?;
            journal.started(MANIFEST.to_owned())
        });
        files.push(folder.join(JOURNAL));
    }
    let is_list = |path: &Path| path.ends_with(SHA256SUMS) || path.ends_with(MANIFEST);
    files.sort_by_key(|path| (path.ends_with(JOURNAL), is_list(path)));
    files
}

/// Removes a folder that contains only files written by microsig. Errors: files that microsig did not write:
/// they are named, and nothing is removed; an I/O error.
pub fn remove_own(folder: &Path) -> Result<()> {
    let (files, folders) = plan(folder)?;
    let files = files_to_remove(files, &folders);
    let gone = |e: &std::io::Error| e.kind() == std::io::ErrorKind::NotFound;
    for file in files {
        std::fs::remove_file(&file)
            .or_else(|e| if gone(&e) { Ok(()) } else { Err(e) })
            .map_err(Error::write(&file))?;
    }
    for folder in folders {
        std::fs::remove_dir(&folder)
            .or_else(|e| if gone(&e) { Ok(()) } else { Err(e) })
            .map_err(Error::write(&folder))?;
    }
    Ok(())
}

/// Removes temporary files below a folder under construction.
pub(super) fn remove_temporaries(folder: &Path) -> Result<()> {
    let is_temporary = |file: &str| file.rsplit('/').next().is_some_and(|name| name.starts_with(TEMPORARY));
    for file in files_below(folder)?.into_iter().filter(|file| is_temporary(file)) {
        let path = folder.join(file);
        std::fs::remove_file(&path).map_err(Error::write(&path))?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A dataset without a journal, which is removed file by file as if each step were the last of a process.
    #[test]
    fn a_removal_that_is_cut_off_can_be_completed() {
        let place = tempfile::tempdir().unwrap();
        let folder = place.path().join("set");
        let sums = ["a", MANIFEST].map(|file| format!("{:064x}  {file}\n", 0)).concat();
        for kept in 0..4 {
            std::fs::create_dir_all(&folder).unwrap();
            std::fs::write(folder.join(MANIFEST), r#"{"microsig": {"generator": "microsig"}}"#).unwrap();
            std::fs::write(folder.join(SHA256SUMS), &sums).unwrap();
            std::fs::write(folder.join("a"), "1").unwrap();
            let files = files_to_remove(plan(&folder).unwrap().0, std::slice::from_ref(&folder));
            assert_eq!(files.len(), 4);
            files[..files.len() - kept].iter().for_each(|file| std::fs::remove_file(file).unwrap());
            remove_own(&folder).unwrap();
            assert!(!folder.exists());
        }
    }
}
