//! A dataset on disk: names, tables, manifest, checksums.
//!
//! ```text
//! DATASET/
//!   datapackage.json  SHA256SUMS  README.md  LICENSE  preview.png
//!   scenario.ron      the scenario with every default written out    inputs/  files it names
//!   settings.txt      particles/STEM.txt   images/STEM.tif
//!   truth/            frames.csv, tracks.csv, displacements.csv, field.csv, depth.csv, boxes.csv
//!   calibration/      settings.txt, particles/, images/, calibration.csv
//! ```

pub mod calibration;
mod camera;
pub mod card;
mod contact_sheet;
pub mod manifest;
pub mod source;
pub mod truth;

pub use camera::Camera;
pub use contact_sheet::ContactSheet;
pub use source::copy;

use std::collections::BTreeMap;

use scenario::{Recordings, Scenario};
use storage::checksums::Fingerprint;
use storage::dataset::{BoxRow, DepthRow, DisplacementRow, FrameRow, Row, Table};

/// The tables that a dataset of this scenario can hold.
pub fn tables(scenario: &Scenario) -> Vec<Table> {
    let fixed = [FrameRow::table(&[]), DisplacementRow::table(&[]), DepthRow::table(&[]), BoxRow::table(&[])];
    let own = [
        calibration::table(&scenario.calibrated_um(), !scenario.calibrated_px().is_empty()),
        truth::tracks(scenario),
    ];
    let grid = scenario.truth_grid().map(|nodes| truth::field::table(&nodes));
    fixed.into_iter().chain(own).chain(grid).collect()
}

/// Folders of data files and images.
const PARTICLES: &str = "particles/";
const IMAGES: &str = "images/";

/// Paths of a frame's data file and image in the dataset: `particles/frame_00000.txt`, `images/pair_00000_a.tif`,
/// `burst_00000_d`.
pub(crate) fn frame_paths(recordings: &Recordings, frame: u32) -> [String; 2] {
    let stem = recordings.stem(frame);
    [format!("{PARTICLES}{stem}.txt"), format!("{IMAGES}{stem}.tif")]
}

/// A frame's files, as this run has written them.
#[derive(Debug, Clone, Copy)]
pub(crate) struct FrameEntry {
    /// Number of visible particles.
    pub visible: u64,
    /// Fingerprint of its data file.
    pub particles: Fingerprint,
    /// Fingerprint of its image.
    pub image: Fingerprint,
}

/// Fingerprints of the files that this run has written, so that they are not read again for hashing: about 90
/// bytes per frame.
#[derive(Debug, Default)]
pub(crate) struct FileHashes {
    /// In the order of frames.
    pub frames: Vec<FrameEntry>,
    /// Of the files that do not belong to a frame, by path.
    pub others: BTreeMap<&'static str, Fingerprint>,
}
