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
mod ledger;
pub mod manifest;
pub mod secret;
pub mod source;
pub mod truth;

pub use camera::Camera;
pub use contact_sheet::ContactSheet;
pub(crate) use ledger::{FrameEntry, Ledger};
pub use source::copy;

use scenario::{Recordings, Scenario};
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

/// Name of a frame's files without extension.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Stem {
    /// `frame_00000`; `pair_00000_a` and `pair_00000_b`; `burst_00000_a` to `burst_00000_d`.
    pub name: String,
}

impl Stem {
    /// The stem of a frame, given its number in the dataset.
    pub fn of(recordings: &Recordings, frame: u32) -> Self {
        Stem { name: recordings.stem(frame) }
    }

    /// Path of the data file in the dataset.
    pub fn particles(&self) -> String {
        format!("{PARTICLES}{}.txt", self.name)
    }

    /// Path of the image in the dataset.
    pub fn image(&self) -> String {
        format!("{IMAGES}{}.tif", self.name)
    }
}
