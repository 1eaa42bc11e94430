//! Fingerprints of a dataset's files, recorded while they are written, so that files are not read again for
//! hashing.

use std::collections::BTreeMap;

use storage::checksums::Fingerprint;

/// Entry of a frame.
#[derive(Debug, Clone, Copy)]
pub(crate) struct FrameEntry {
    /// Number of visible particles.
    pub visible: u64,
    /// Fingerprint of its data file.
    pub particles: Fingerprint,
    /// Fingerprint of its image.
    pub image: Fingerprint,
}

/// Fingerprints of files that this run has written: about 90 bytes per frame.
#[derive(Debug, Default)]
pub(crate) struct Ledger {
    /// In the order of frames.
    pub frames: Vec<FrameEntry>,
    /// Of the files that do not belong to a frame, by path.
    pub others: BTreeMap<&'static str, Fingerprint>,
}
