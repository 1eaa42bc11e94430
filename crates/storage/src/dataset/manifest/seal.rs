//! Writes manifest and checksums, which complete a dataset. Files are processed in small groups, so that
//! memory does not grow with their number.

use std::io::{Seek, SeekFrom, Write};

use rayon::prelude::*;

use super::{MANIFEST, Manifest, Resource};
use crate::checksums::{self, Fingerprint, SHA256SUMS};
use crate::folder::FilesBelow;
use crate::journal::JOURNAL;
use crate::{Error, OutputFolder, Result};

/// Number of files whose fingerprints are in memory at a time.
const GROUP: usize = 64;

/// Writes both files; `head` is the manifest without its resources, `entry` returns the fingerprint of the file
/// at a path in the dataset, and its resource.
pub fn seal(
    folder: &OutputFolder,
    head: &Manifest,
    entry: impl Fn(&str) -> Result<(Fingerprint, Resource)> + Sync,
) -> Result<()> {
    let is_own = |file: &Result<String>| {
        file.as_ref().is_ok_and(|file| [MANIFEST, SHA256SUMS, JOURNAL].contains(&file.as_str()))
    };
    // Listed here, so that the temporary files of manifest and checksums are not included.
    let mut files = FilesBelow::new(folder.path())?.filter(|file| !is_own(file));
    let (manifest, checksums) = (folder.join(MANIFEST), folder.join(SHA256SUMS));
    folder.save(SHA256SUMS, |sums| {
        let mut manifest_at = None;
        folder.save(MANIFEST, |writer| {
            let pretty =
                |text: serde_json::Result<String>| text.map_err(|e| Error::write(&manifest)(e.into()));
            let head = pretty(serde_json::to_string_pretty(head))?;
            let mut before = head.trim_end_matches("\n}").to_owned() + ",\n  \"resources\": [";
            loop {
                let group: Vec<String> = files.by_ref().take(GROUP).collect::<Result<_>>()?;
                if group.is_empty() {
                    return writeln!(writer, "\n  ]\n}}").map_err(Error::write(&manifest));
                }
                let entries: Vec<_> = group.par_iter().map(|path| entry(path)).collect();
                for (path, entry) in group.iter().zip(entries) {
                    let (fingerprint, resource) = entry?;
                    let resource = pretty(serde_json::to_string_pretty(&resource))?.replace('\n', "\n    ");
                    write!(writer, "{before}\n    {resource}").map_err(Error::write(&manifest))?;
                    ",".clone_into(&mut before);
                    if path.as_str() > MANIFEST {
                        line_of_manifest(sums, &mut manifest_at).map_err(Error::write(&checksums))?;
                    }
                    writeln!(sums, "{}  {path}", fingerprint.sha256).map_err(Error::write(&checksums))?;
                }
            }
        })?;
        let hash = checksums::fingerprint(&manifest)?.sha256;
        let at = line_of_manifest(sums, &mut manifest_at).map_err(Error::write(&checksums))?;
        let filled = sums.seek(SeekFrom::Start(at)).and_then(|_| write!(sums, "{hash}"));
        filled.and_then(|()| sums.seek(SeekFrom::End(0))).map(drop).map_err(Error::write(&checksums))
    })
}

/// The position of the line of the manifest in the order of paths, which is written with its final length if it
/// is not there yet: its hash is filled in at the end.
fn line_of_manifest(sums: &mut (impl Write + Seek), at: &mut Option<u64>) -> std::io::Result<u64> {
    if let Some(at) = at {
        return Ok(*at);
    }
    let here = sums.stream_position()?;
    writeln!(sums, "{}  {MANIFEST}", "0".repeat(64))?;
    *at = Some(here);
    Ok(here)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_manifest_is_sorted_among_the_checksums() {
        let place = tempfile::tempdir().unwrap();
        for file in ["README.md", "a.csv", "truth.csv"] {
            std::fs::write(place.path().join(file), file).unwrap();
        }
        let head = Manifest { name: "x".to_owned(), ..Manifest::default() };
        seal(&OutputFolder::existing(place.path()), &head, |path: &str| {
            let found = checksums::fingerprint(&place.path().join(path))?;
            Ok((found, Resource { path: path.to_owned(), bytes: found.bytes, ..Resource::default() }))
        })
        .unwrap();
        let text = std::fs::read_to_string(place.path().join(SHA256SUMS)).unwrap();
        let sums = checksums::read(&text, SHA256SUMS).unwrap();
        let files: Vec<&str> = text.lines().map(|line| &line[66..]).collect();
        assert_eq!(files, ["README.md", "a.csv", MANIFEST, "truth.csv"]);
        for (file, sum) in sums {
            assert_eq!(
                checksums::fingerprint(&place.path().join(&file)).unwrap().sha256.to_string(),
                sum,
                "{file}"
            );
        }
        let manifest = std::fs::read_to_string(place.path().join(MANIFEST)).unwrap();
        let whole = Manifest::parse(&manifest, MANIFEST).unwrap();
        assert_eq!(manifest, serde_json::to_string_pretty(&whole).unwrap() + "\n");
        assert_eq!((whole.name.as_str(), whole.resources.len()), ("x", 3));
    }
}
