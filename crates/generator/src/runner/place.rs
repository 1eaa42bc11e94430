//! A dataset, wherever it is.

use std::borrow::Cow;
use std::io::{BufReader, Cursor};
use std::path::{Path, PathBuf};
use std::sync::Arc;

use microsig_core::formats::{data_file, settings_file, tiff};
use microsig_core::sensor::{Counts, Image};
use microsig_core::{Particle, Settings};
use storage::dataset::manifest::Manifest;
use storage::dataset::{CalibrationRow, RecordingFacts, Row, TableReader};

use super::memory::MemoryDataset;
use crate::dataset::calibration::CalibrationStack;
use storage::{Error, Result, input};

/// The settings of the calibration stacks.
const SETTINGS: &str = "calibration/settings.txt";

/// A dataset in a folder or in memory. What is in a folder is validated as untrusted input.
#[derive(Debug, Clone)]
pub enum DatasetPlace {
    /// Its folder.
    Folder(PathBuf),
    /// In memory.
    Memory(Arc<MemoryDataset>),
}

impl From<&Path> for DatasetPlace {
    fn from(folder: &Path) -> Self {
        DatasetPlace::Folder(folder.to_owned())
    }
}

impl DatasetPlace {
    /// What it is called in messages.
    pub fn name(&self) -> String {
        match self {
            DatasetPlace::Folder(folder) => folder.display().to_string(),
            DatasetPlace::Memory(_) => "the dataset in memory".to_owned(),
        }
    }

    /// What a file is called in messages.
    pub fn shown(&self, path: &str) -> String {
        match self {
            DatasetPlace::Folder(folder) => folder.join(path).display().to_string(),
            DatasetPlace::Memory(_) => path.to_owned(),
        }
    }

    /// The manifest.
    pub fn manifest(&self) -> Result<Cow<'_, Manifest>> {
        match self {
            DatasetPlace::Folder(folder) => Manifest::read(folder).map(Cow::Owned),
            DatasetPlace::Memory(made) => made.manifest().map(Cow::Borrowed),
        }
    }

    /// The facts about its recording.
    pub fn facts(&self) -> Result<RecordingFacts> {
        match self {
            DatasetPlace::Folder(folder) => RecordingFacts::read(folder),
            DatasetPlace::Memory(made) => Ok(RecordingFacts::of(made.manifest()?)),
        }
    }

    /// A frame or an image of a calibration stack of this size (px), by its path. Errors: an image that does
    /// not exist, cannot be read, or has another size.
    pub fn image(&self, path: &str, size: (u32, u32)) -> Result<Counts> {
        match self {
            DatasetPlace::Folder(folder) => {
                let path = folder.join(path);
                let file = BufReader::new(input::open(&path)?);
                Ok(tiff::read_counts(file, &path.display().to_string(), size)?)
            }
            DatasetPlace::Memory(made) => image_of(made, path).map(|image| image.counts),
        }
    }

    /// A frame or an image of a calibration stack, by its path; `bits` is the depth of images in a folder.
    pub fn whole_image(&self, path: &str, bits: u8) -> Result<Image> {
        match self {
            DatasetPlace::Folder(folder) => {
                let path = folder.join(path);
                let (bytes, name) = (input::read(&path)?, path.display().to_string());
                let (width, height) = tiff::size(BufReader::new(Cursor::new(&bytes)), &name)?;
                let counts = tiff::read_counts(Cursor::new(&bytes), &name, (width, height))?;
                Ok(Image { width, height, bits, counts })
            }
            DatasetPlace::Memory(made) => image_of(made, path),
        }
    }

    /// Whether the dataset has calibration stacks.
    pub fn has_calibration(&self) -> Result<bool> {
        match self {
            DatasetPlace::Folder(folder) => Ok(folder.join(CalibrationRow::PATH).is_file()),
            DatasetPlace::Memory(made) => Ok(made.calibration_stack()?.is_some()),
        }
    }

    /// Calls `each` for the rows of the table of calibration stacks, with the numbers of their lines; a
    /// folder must have the columns `needed`. Errors: a table that cannot be read; those of `each`, with file
    /// and line.
    pub fn calibration_rows(
        &self,
        needed: &[&str],
        mut each: impl FnMut(u64, CalibrationRow) -> std::result::Result<(), String>,
    ) -> Result<()> {
        match self {
            DatasetPlace::Folder(folder) => {
                TableReader::open(folder.join(CalibrationRow::PATH))?.rows(needed, each).map(drop)
            }
            DatasetPlace::Memory(made) => {
                let rows = made.calibration_stack()?.map(CalibrationStack::rows).into_iter().flatten();
                (2..).zip(rows).try_for_each(|(line, row)| {
                    each(line, row)
                        .map_err(|what| Error::input(format!("{}:{line}: {what}", CalibrationRow::PATH)))
                })
            }
        }
    }

    /// The settings with which the calibration stacks were made, if they are known; the numerical aperture of those in a folder is less
    /// than `largest`.
    pub fn calibration_settings(&self, largest: f64) -> Result<Option<Settings>> {
        match self {
            DatasetPlace::Folder(folder) => {
                let path = folder.join(SETTINGS);
                if !path.exists() {
                    return Ok(None);
                }
                let read =
                    settings_file::read_immersed(input::open(&path)?, &path.display().to_string(), largest)?;
                Ok(Some(read.settings))
            }
            DatasetPlace::Memory(made) => Ok(made.calibration_stack()?.map(|stack| stack.settings.clone())),
        }
    }

    /// The particle of a data file of the calibration stacks. Errors: a file that does not exist, cannot be
    /// read, or has no particle.
    pub fn calibration_particle(&self, path: &str) -> Result<Particle> {
        match self {
            DatasetPlace::Folder(folder) => {
                let path = folder.join(path);
                let name = path.display().to_string();
                let first = data_file::read(input::open(&path)?, &name)?.into_iter().next();
                let none = || format!("{name}: no particle; expected that of the calibration image");
                first.ok_or_else(|| Error::input(none()))
            }
            DatasetPlace::Memory(made) => {
                let stack = made.calibration_stack()?;
                let row =
                    |stack: &CalibrationStack| stack.rows().iter().position(|row| row.particles == path);
                let particle = stack.and_then(|stack| stack.particles.get(row(stack)?));
                particle.copied().ok_or_else(|| missing(path))
            }
        }
    }
}

/// A frame or an image of a calibration stack.
fn image_of(made: &MemoryDataset, path: &str) -> Result<Image> {
    if let Some(frame) = made.frame_of(path) {
        return Ok(made.image(frame));
    }
    let stack = made.calibration_stack()?;
    let row = |stack: &CalibrationStack| stack.rows().iter().position(|row| row.image == path);
    stack.and_then(|stack| Some(stack.image(row(stack)?))).ok_or_else(|| missing(path))
}

fn missing(path: &str) -> Error {
    Error::input(format!("{path}: this dataset in memory has no such file"))
}
