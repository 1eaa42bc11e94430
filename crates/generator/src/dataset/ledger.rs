//! Fingerprints of a dataset's files, recorded while they are written, so that files are not read again for
//! hashing.
//!
//! Entries of frames are stored in a temporary file, so that memory does not grow with the number of frames.

use std::collections::BTreeMap;
use std::io::{Read, Seek, SeekFrom, Write};
use std::sync::{Mutex, PoisonError};

use tempfile::SpooledTempFile;

use storage::checksums::{Fingerprint, Hash};
use storage::error::{Error, Result};

/// Entry of a frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct FrameEntry {
    /// Number of visible particles.
    pub visible: u64,
    /// Fingerprint of its data file.
    pub particles: Fingerprint,
    /// Fingerprint of its image.
    pub image: Fingerprint,
}

/// Bytes of an entry in the temporary file: the number of particles, size and hash of each of two files.
const ENTRY: usize = 8 + 2 * (8 + 32);

/// Bytes of entries that are kept in memory; more are moved to a file.
const IN_MEMORY: usize = 1 << 15;

/// Fingerprints of files that this run has written.
#[derive(Debug)]
pub(crate) struct Ledger {
    /// Entries of equal length, in the order of frames.
    frames: Mutex<SpooledTempFile>,
    others: BTreeMap<String, Fingerprint>,
}

impl Ledger {
    pub(crate) fn new() -> Self {
        let frames = Mutex::new(tempfile::spooled_tempfile(IN_MEMORY));
        Ledger { frames, others: BTreeMap::new() }
    }

    /// Adds a file that does not belong to a frame.
    pub(crate) fn add(&mut self, path: &str, fingerprint: Fingerprint) {
        self.others.insert(path.to_owned(), fingerprint);
    }

    /// The fingerprint of a file that does not belong to a frame, if it has been added.
    pub(crate) fn other(&self, path: &str) -> Option<Fingerprint> {
        self.others.get(path).copied()
    }

    /// Adds the next frame.
    pub(crate) fn add_frame(&mut self, entry: &FrameEntry) -> Result<()> {
        let frames = self.frames.get_mut().unwrap_or_else(PoisonError::into_inner);
        let mut bytes = Vec::with_capacity(ENTRY);
        bytes.extend(entry.visible.to_le_bytes());
        for file in [entry.particles, entry.image] {
            bytes.extend(file.bytes.to_le_bytes());
            bytes.extend(file.sha256.0);
        }
        frames.write_all(&bytes).map_err(Error::write(&std::env::temp_dir()))
    }

    /// The entry of a frame that has been added.
    pub(crate) fn frame(&self, index: u32) -> Result<FrameEntry> {
        let mut frames = self.frames.lock().unwrap_or_else(PoisonError::into_inner);
        let mut bytes = [0; ENTRY];
        frames
            .seek(SeekFrom::Start(u64::from(index) * ENTRY as u64))
            .and_then(|_| frames.read_exact(&mut bytes))
            .map_err(|e| Error::read(&std::env::temp_dir(), e))?;
        let mut rest = bytes.as_slice();
        let visible = number(&mut rest);
        let (particles, image) = (fingerprint(&mut rest), fingerprint(&mut rest));
        Ok(FrameEntry { visible, particles, image })
    }
}

fn take<const N: usize>(bytes: &mut &[u8]) -> [u8; N] {
    let mut taken = [0; N];
    let n = bytes.len().min(N);
    let (first, rest) = bytes.split_at(n);
    taken[..n].copy_from_slice(first);
    *bytes = rest;
    taken
}

fn number(bytes: &mut &[u8]) -> u64 {
    u64::from_le_bytes(take(bytes))
}

fn fingerprint(bytes: &mut &[u8]) -> Fingerprint {
    Fingerprint { bytes: number(bytes), sha256: Hash(take(bytes)) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn entries_are_found_again_in_memory_and_beyond() {
        let entry = |k: u32| FrameEntry {
            visible: u64::from(k) << 33,
            particles: Fingerprint::of(&k.to_le_bytes()),
            image: Fingerprint::of(&vec![1; k as usize]),
        };
        for frames in [3, 1000] {
            let mut ledger = Ledger::new();
            (0..frames).for_each(|k| ledger.add_frame(&entry(k)).unwrap());
            assert!((0..frames).rev().all(|k| ledger.frame(k).unwrap() == entry(k)));
            assert!(ledger.frame(frames).is_err());
        }
    }
}
