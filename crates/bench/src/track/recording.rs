//! The part of a dataset that trackers may see.

use std::fs::File;
use std::io::BufReader;
use std::path::{Path, PathBuf};

use microsig_core::formats::{settings_file, tiff};
use serde::Deserialize;

use super::picture::Picture;
use crate::dataset::calibration::CALIBRATION;
use crate::error::{Error, Result};
use crate::evaluate::truth::{Facts, facts};

/// The images of a dataset.
#[derive(Debug)]
pub(super) struct Recording {
    root: PathBuf,
    images: Vec<PathBuf>,
    size: (u32, u32),
    facts: Facts,
}

/// A step of the calibration stack.
#[derive(Debug)]
pub(super) struct Step {
    pub(super) z_um: f64,
    /// Where the particle is, from the middle of the first pixel, px.
    pub(super) at: [f64; 2],
    pub(super) picture: Picture,
}

/// A row of the stack's table.
#[derive(Debug, Deserialize)]
struct Listed {
    z_um: f64,
    x_px: f64,
    y_px: f64,
    image: String,
}

impl Recording {
    /// Looks for the images of a dataset or of a split of a challenge.
    pub(super) fn open(dataset: &Path) -> Result<Self> {
        let facts = facts(dataset)?;
        let Some((width, height)) = facts.sensor_px else {
            return Err(Error::input(format!(
                "{}: the manifest does not tell the sensor's size",
                dataset.display()
            )));
        };
        let folder = dataset.join("images");
        let mut images = Vec::new();
        for entry in std::fs::read_dir(&folder).map_err(|e| Error::read(&folder, e))? {
            let path = entry.map_err(|e| Error::read(&folder, e))?.path();
            if path.extension().is_some_and(|e| e == "tif") {
                images.push(path);
            }
        }
        if images.is_empty() {
            return Err(Error::input(format!("{}: expected images (*.tif), found none", folder.display())));
        }
        images.sort_by(|a, b| natord::compare(&a.to_string_lossy(), &b.to_string_lossy()));
        Ok(Recording { root: dataset.to_owned(), images, size: (width as u32, height as u32), facts })
    }

    pub(super) fn frames(&self) -> usize {
        self.images.len()
    }

    /// Whether frames 2k and 2k + 1 are pairs that have nothing to do with each other.
    pub(super) fn pairs(&self) -> bool {
        self.facts.pairs
    }

    pub(super) fn depth_h_um(&self) -> Option<f64> {
        self.facts.depth_h_um()
    }

    pub(super) fn frame(&self, index: usize) -> Result<Picture> {
        picture(&self.images[index], self.size)
    }

    /// The calibration stack, by depth.
    pub(super) fn calibration(&self) -> Result<Vec<Step>> {
        let table = self.root.join(CALIBRATION.path);
        if !table.exists() {
            let hint = "this method needs the dataset's calibration stack, and there is none";
            return Err(Error::input(format!("{}: {hint}", table.display())));
        }
        let path = self.root.join("calibration/settings.txt");
        let file = File::open(&path).map_err(|e| Error::read(&path, e))?;
        let settings = settings_file::read(file, &path.display().to_string())?.settings;
        let size = (settings.pixel_dim_x, settings.pixel_dim_y);

        let mut reader = csv::Reader::from_path(&table).map_err(|e| Error::read(&table, e.into()))?;
        let rows = reader
            .deserialize()
            .collect::<std::result::Result<Vec<Listed>, _>>()
            .map_err(|e| Error::input(format!("{}: {e}", table.display())))?;
        let mut steps = rows
            .into_iter()
            .map(|row| {
                let at = [row.x_px - 1.0, row.y_px - 1.0];
                Ok(Step { z_um: row.z_um, at, picture: picture(&self.root.join(row.image), size)? })
            })
            .collect::<Result<Vec<_>>>()?;
        steps.sort_by(|a, b| a.z_um.total_cmp(&b.z_um));
        steps.dedup_by(|a, b| a.z_um == b.z_um);
        Ok(steps)
    }
}

fn picture(path: &Path, (width, height): (u32, u32)) -> Result<Picture> {
    let file = BufReader::new(File::open(path).map_err(|e| Error::read(path, e))?);
    let counts = tiff::read(file, &path.display().to_string(), (width, height))?;
    Ok(Picture {
        width: width as usize,
        height: height as usize,
        counts: counts.into_iter().map(|c| c as f32).collect(),
    })
}
