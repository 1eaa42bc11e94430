//! Writes manifest and checksums, which complete a dataset. Files are processed in small groups, so that
//! memory does not grow with their number.

use std::cell::RefCell;
use std::io::{Seek, SeekFrom, Write};

use rayon::prelude::*;
use serde::ser::{Error as _, SerializeSeq};
use serde::{Serialize, Serializer};

use super::{MANIFEST, Manifest, Resource};
use crate::OutputFolder;
use crate::checksums::{self, Fingerprint, SHA256SUMS};
use crate::error::{Error, Result};
use crate::folder::FilesBelow;
use crate::journal::JOURNAL;

/// Number of files whose fingerprints are in memory at a time.
const GROUP: usize = 64;

/// Writes both files; `head` is the manifest without its resources, `entry` returns a file's fingerprint and
/// its resource.
pub fn seal(folder: &OutputFolder, head: &Manifest, entry: impl Entry) -> Result<()> {
    // Listed here, so that the temporary files of manifest and checksums are not included.
    let files = RefCell::new(FilesBelow::new(folder.path())?);
    let manifest = folder.join(MANIFEST);
    folder.save(SHA256SUMS, |writer| {
        let sums = Sums { writer: RefCell::new(writer), manifest_at: RefCell::new(None) };
        folder.save(MANIFEST, |writer| {
            let package =
                Package { head, resources: Resources { files: &files, entry: &entry, sums: &sums } };
            serde_json::to_writer_pretty(&mut *writer, &package)
                .map_err(|e| Error::write(&manifest)(e.into()))?;
            writer.write_all(b"\n").map_err(Error::write(&manifest))
        })?;
        let fingerprint = checksums::fingerprint(&manifest)?;
        sums.finish(&fingerprint).map_err(Error::write(&folder.join(SHA256SUMS)))
    })
}

/// Returns the fingerprint of the file at a path in the dataset, and its resource in the manifest.
pub trait Entry: Fn(&str) -> Result<(Fingerprint, Resource)> + Sync {}

impl<F: Fn(&str) -> Result<(Fingerprint, Resource)> + Sync> Entry for F {}

/// The manifest, with its resources last.
#[derive(Serialize)]
#[serde(bound = "E: Entry, W: Write + Seek")]
struct Package<'a, E, W> {
    #[serde(flatten)]
    head: &'a Manifest,
    resources: Resources<'a, E, W>,
}

/// The resources of the manifest; writing one also adds its line to the checksums.
struct Resources<'a, E, W> {
    files: &'a RefCell<FilesBelow>,
    entry: &'a E,
    sums: &'a Sums<'a, W>,
}

impl<E: Entry, W: Write + Seek> Serialize for Resources<'_, E, W> {
    fn serialize<S: Serializer>(&self, serializer: S) -> std::result::Result<S::Ok, S::Error> {
        let mut list = serializer.serialize_seq(None)?;
        let mut files = self.files.borrow_mut();
        let own = |file: &Result<String>| {
            file.as_ref().is_ok_and(|file| [MANIFEST, SHA256SUMS, JOURNAL].contains(&file.as_str()))
        };
        let mut others = files.by_ref().filter(|file| !own(file));
        loop {
            let group: Vec<String> =
                others.by_ref().take(GROUP).collect::<Result<_>>().map_err(S::Error::custom)?;
            if group.is_empty() {
                return list.end();
            }
            let entries: Vec<_> = group.par_iter().map(|path| (self.entry)(path)).collect();
            for (path, entry) in group.iter().zip(entries) {
                let (fingerprint, resource) = entry.map_err(S::Error::custom)?;
                list.serialize_element(&resource)?;
                self.sums.add(path, &fingerprint).map_err(S::Error::custom)?;
            }
        }
    }
}

/// `SHA256SUMS` while it is written: the manifest's line is reserved in the order of paths, and its hash is
/// filled in at the end.
struct Sums<'a, W> {
    writer: RefCell<&'a mut W>,
    manifest_at: RefCell<Option<u64>>,
}

impl<W: Write + Seek> Sums<'_, W> {
    fn add(&self, path: &str, fingerprint: &Fingerprint) -> std::io::Result<()> {
        if path > MANIFEST {
            self.reserve_line()?;
        }
        writeln!(self.writer.borrow_mut(), "{}  {path}", fingerprint.sha256)
    }

    /// Reserves the line of the manifest, with its final length.
    fn reserve_line(&self) -> std::io::Result<()> {
        let mut at = self.manifest_at.borrow_mut();
        if at.is_none() {
            let mut writer = self.writer.borrow_mut();
            *at = Some(writer.stream_position()?);
            writeln!(writer, "{}  {MANIFEST}", "0".repeat(64))?;
        }
        Ok(())
    }

    fn finish(&self, manifest: &Fingerprint) -> std::io::Result<()> {
        self.reserve_line()?;
        let mut writer = self.writer.borrow_mut();
        writer.seek(SeekFrom::Start(self.manifest_at.borrow().unwrap_or_default()))?;
        write!(writer, "{}", manifest.sha256)?;
        writer.seek(SeekFrom::End(0)).map(|_| ())
    }
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
