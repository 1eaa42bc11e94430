//! A dataset, wherever it is.

use std::borrow::Cow;
use std::fmt::Debug;
use std::io::{BufReader, Cursor};
use std::path::{Path, PathBuf};
use std::sync::Arc;

use microsig_core::formats::{data_file, settings_file, tiff};
use microsig_core::sensor::{Counts, Image};
use microsig_core::{Particle, Settings};

use crate::dataset::manifest::Manifest;
use crate::dataset::{
    BoxRow, CalibrationRow, FieldRow, FrameRow, RecordingFacts, Row, TableReader, TrackRow, TrueFlow,
};
use crate::{Error, Result, input};

/// The settings of the calibration stacks.
const SETTINGS: &str = "calibration/settings.txt";

/// A dataset in a folder or in memory. What is in a folder is validated as untrusted input.
#[derive(Debug, Clone)]
pub enum DatasetPlace {
    /// Its folder.
    Folder(PathBuf),
    /// In memory.
    Memory(Arc<dyn DatasetInMemory>),
}

/// A dataset that was generated in memory. Paths are those of its files if it were in a folder.
pub trait DatasetInMemory: Debug + Send + Sync {
    /// The manifest, which lists images and tracks only.
    fn manifest(&self) -> Result<&Manifest>;

    /// The rows of `truth/frames.csv`.
    fn frames(&self) -> Vec<FrameRow>;

    /// The rows of `truth/tracks.csv`.
    fn tracks(&self) -> Box<dyn Iterator<Item = &TrackRow> + '_>;

    /// The rows of `truth/boxes.csv`, if the scenario has it.
    fn boxes(&self) -> Option<Vec<BoxRow>>;

    /// The rows of `truth/field.csv`, if the scenario has it.
    fn field(&self) -> Result<Option<Vec<FieldRow>>>;

    /// The flow, if the scenario has `truth/field.csv`.
    fn flow(&self) -> Result<Option<Arc<dyn TrueFlow>>>;

    /// A frame or an image of a calibration stack, by its path.
    fn image(&self, path: &str) -> Result<Option<Image>>;

    /// The rows of `calibration/calibration.csv`, if there are calibration stacks.
    fn calibration_rows(&self) -> Result<Option<Vec<CalibrationRow>>>;

    /// The settings of the calibration stacks, if there are any.
    fn calibration_settings(&self) -> Result<Option<Settings>>;

    /// The particle of a data file of the calibration stacks, by its path.
    fn calibration_particle(&self, path: &str) -> Result<Option<Particle>>;
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

    /// The rows of `truth/tracks.csv`, and whether these have numbers of tracks. Where a table has no such column, z is
    /// NaN, and particles are visible. Errors: a truth that is withheld or unknown; a table that cannot be read; a particle
    /// without coordinates.
    pub fn tracks(&self) -> Result<(Vec<TrackRow>, bool)> {
        let folder = match self {
            DatasetPlace::Folder(folder) => folder,
            DatasetPlace::Memory(made) => return Ok((made.tracks().cloned().collect(), true)),
        };
        self.facts()?.needs_truth(folder)?;
        let table = TableReader::open(folder.join(TrackRow::PATH))?;
        let [has_tracks, has_z, has_visible] =
            ["track", "z_um", "visible"].map(|name| table.column(name).is_some());
        let mut rows = Vec::new();
        table.rows(&["frame", "x_px", "y_px"], |_, row: TrackRow| {
            if !(row.x_px + row.y_px).is_finite() || (has_z && !row.z_um.is_finite()) {
                return Err("a particle without coordinates".to_owned());
            }
            if i64::try_from(row.track).is_err() {
                return Err(format!("track = {}: too large", row.track));
            }
            rows.push(TrackRow { visible: row.visible || !has_visible, ..row });
            Ok(())
        })?;
        Ok((rows, has_tracks))
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
            DatasetPlace::Memory(made) => {
                made.image(path)?.map(|image| image.counts).ok_or_else(|| missing(path))
            }
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
            DatasetPlace::Memory(made) => made.image(path)?.ok_or_else(|| missing(path)),
        }
    }

    /// Whether the dataset has calibration stacks.
    pub fn has_calibration(&self) -> Result<bool> {
        match self {
            DatasetPlace::Folder(folder) => Ok(folder.join(CalibrationRow::PATH).is_file()),
            DatasetPlace::Memory(made) => Ok(made.calibration_rows()?.is_some()),
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
                (2..).zip(made.calibration_rows()?.unwrap_or_default()).try_for_each(|(line, row)| {
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
            DatasetPlace::Memory(made) => made.calibration_settings(),
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
            DatasetPlace::Memory(made) => made.calibration_particle(path)?.ok_or_else(|| missing(path)),
        }
    }
}

fn missing(path: &str) -> Error {
    Error::input(format!("{path}: this dataset in memory has no such file"))
}
