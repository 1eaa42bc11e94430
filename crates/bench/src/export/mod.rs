//! `microsig export`: the truth of a dataset in other programs' formats.
//!
//! What is exported is what is scored (`evaluate::truth`): visible particles inside the depth range, each contiguous visible
//! run with a number of its own. So an export, read back and evaluated, scores perfectly. Coordinates, units and first
//! frame are those of the format; [`crate::results`] says the same for reading.

mod field;
mod particles;

use std::path::{Path, PathBuf};

use serde::Serialize;

use crate::dataset::save_bytes;
use crate::error::{Error, Result};

/// Formats that are written.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Format {
    /// XML of the ISBI challenge: px, first pixel's centre at 0; z in um.
    Isbi,
    /// trackpy's data frame as CSV: px, first pixel's centre at 0; z in um.
    Trackpy,
    /// DefocusTracker's table as CSV: px from 1, Z in [0, 1] over the depth range, frames from 1.
    Defocustracker,
    /// TrackMate's table of spots: um, first pixel's centre at 0.
    TrackmateSpots,
    /// napari's tracks as CSV: px, first pixel's centre at 0; z in um.
    Napari,
    /// Middlebury's dense flow: a vector for each pixel.
    Flo,
    /// OpenPIV's text file: a vector for each node of the truth's grid.
    Openpiv,
}

/// Which true displacement field is exported.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Displacement {
    /// Of what is at the place half-way in time.
    Central,
    /// Of what is at the place in the first frame.
    Forward,
    /// The central one averaged over depth.
    Weighted,
}

impl Displacement {
    /// Its name in `truth/field.csv`.
    pub fn name(self) -> &'static str {
        match self {
            Displacement::Central => "central",
            Displacement::Forward => "forward",
            Displacement::Weighted => "weighted",
        }
    }
}

/// How to export.
#[derive(Debug, Clone)]
pub struct Options {
    /// The format.
    pub format: Format,
    /// The file.
    pub out: PathBuf,
    /// Image pair of a field that changes with time.
    pub pair: Option<u32>,
    /// Which field.
    pub displacement: Displacement,
    /// Replace what exists.
    pub force: bool,
}

/// What was exported.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Exported {
    /// The file.
    pub out: PathBuf,
    /// Points or vectors.
    pub rows: usize,
    /// Tracks; `None` of a field.
    pub tracks: Option<usize>,
}

/// Writes the truth of a dataset in another program's format. The file appears whole or not at all.
///
/// # Errors
/// A dataset whose truth is missing or lacks what the format needs; a file that exists, unless `force`; writing.
pub fn export(dataset: &Path, options: &Options) -> Result<Exported> {
    let out = &options.out;
    if out.exists() && !options.force {
        return Err(Error::Exists(out.clone()));
    }
    if !dataset.is_dir() {
        return Err(Error::input(format!("{}: expected a dataset's folder", dataset.display())));
    }
    let (bytes, rows, tracks) = match options.format {
        Format::Flo | Format::Openpiv => {
            let (bytes, rows) = field::write(dataset, options)?;
            (bytes, rows, None)
        }
        format => {
            let spots = particles::Spots::read(dataset)?;
            (spots.write(format)?, spots.len(), Some(spots.tracks()))
        }
    };
    save_bytes(out, &bytes)?;
    Ok(Exported { out: out.clone(), rows, tracks })
}
