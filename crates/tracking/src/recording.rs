//! The part of a dataset that is available to trackers.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use super::gray_image::GrayImage;
use storage::dataset::{DatasetPlace, RecordingFacts};
use storage::error::{Error, Result};

/// The images of a dataset.
#[derive(Debug)]
pub(super) struct Recording {
    place: DatasetPlace,
    /// Paths of the images.
    images: Vec<String>,
    size: (u32, u32),
    facts: RecordingFacts,
}

impl Recording {
    /// Lists the images of a dataset or of a split of a challenge.
    pub(super) fn open(place: &DatasetPlace) -> Result<Self> {
        let facts = place.facts()?;
        let Some((width, height)) = facts.sensor_px else {
            let what = "the manifest lacks the size of the sensor";
            return Err(Error::input(format!("{}: {what}", place.name())));
        };
        let names = match place {
            DatasetPlace::Folder(folder) => images_in(&folder.join("images"), &facts.images)?,
            DatasetPlace::Memory(_) => facts.images.clone(),
        };
        let images = names.iter().map(|name| format!("images/{name}")).collect();
        Ok(Recording { place: place.clone(), images, size: (width as u32, height as u32), facts })
    }

    pub(super) fn frames(&self) -> usize {
        self.images.len()
    }

    /// Width and height of the images, px.
    pub(super) fn size(&self) -> (usize, usize) {
        (self.size.0 as usize, self.size.1 as usize)
    }

    /// Whether frames 2k and 2k + 1 form independent pairs.
    pub(super) fn pairs(&self) -> bool {
        self.facts.pairs
    }

    pub(super) fn depth_h_um(&self) -> Option<f64> {
        self.facts.depth_h_um()
    }

    /// Diameter of a disc with the mean area of particle images over depth, px.
    pub(super) fn image_diameter_px(&self) -> Option<f64> {
        self.facts.image_area_px.map(|area| 2.0 * (area / std::f64::consts::PI).sqrt())
    }

    /// Largest displacement from frame to frame, px.
    pub(super) fn max_displacement_px(&self) -> Option<f64> {
        self.facts.max_displacement_px
    }

    /// How far the fastest particle moves within an exposure, px.
    pub(super) fn max_streak_px(&self) -> Option<f64> {
        self.facts.max_streak_px
    }

    /// Why hardly any particle can be found, if overlap or noise prevent it.
    pub(super) fn hopeless(&self) -> &[String] {
        &self.facts.hopeless
    }

    /// The fraction of the sensor that contains particles.
    pub(super) fn image_share(&self) -> f64 {
        self.facts.image_share.unwrap_or(1.0)
    }

    pub(super) fn frame(&self, index: usize) -> Result<GrayImage> {
        read_image(&self.place, &self.images[index], self.size)
    }

    /// The image pairs: number and first frame of each.
    pub(super) fn image_pairs(&self) -> Vec<(usize, usize)> {
        let step = if self.facts.pairs { 2 } else { 1 };
        let firsts = (0..self.frames().saturating_sub(1)).step_by(step).enumerate();
        firsts.filter(|(pair, _)| self.facts.has_pair(*pair as u32)).collect()
    }
}

/// The names of the images in a folder, checked against the manifest: missing or additional images would shift the frames.
fn images_in(folder: &Path, listed: &[String]) -> Result<Vec<String>> {
    let mut images: Vec<PathBuf> = Vec::new();
    for entry in std::fs::read_dir(folder).map_err(|e| Error::read(folder, e))? {
        let path = entry.map_err(|e| Error::read(folder, e))?.path();
        if path.extension().is_some_and(|e| e == "tif") {
            images.push(path);
        }
    }
    if images.is_empty() {
        return Err(Error::input(format!("{}: expected images (*.tif), found none", folder.display())));
    }
    let name = |path: &PathBuf| path.file_name().unwrap_or_default().to_string_lossy().into_owned();
    let found: BTreeSet<String> = images.iter().map(name).collect();
    let listed: BTreeSet<String> = listed.iter().cloned().collect();
    let some = |names: Vec<&String>| -> String {
        let text: Vec<&str> = names.iter().take(5).map(|name| name.as_str()).collect();
        format!("{}{}", text.join(", "), if names.len() > 5 { ", ..." } else { "" })
    };
    let missing: Vec<&String> = listed.difference(&found).collect();
    let unknown: Vec<&String> = found.difference(&listed).collect();
    let mut problems = Vec::new();
    if !missing.is_empty() {
        problems.push(format!("{} missing: {}", missing.len(), some(missing)));
    }
    if !unknown.is_empty() {
        problems.push(format!("{} unknown: {}", unknown.len(), some(unknown)));
    }
    if problems.is_empty() {
        let mut names: Vec<String> = found.into_iter().collect();
        names.sort_by(|a, b| natord::compare(a, b));
        return Ok(names);
    }
    Err(Error::input(format!(
        "{}: expected the {} images that the dataset's manifest lists; {}",
        folder.display(),
        listed.len(),
        problems.join("; ")
    )))
}

/// Reads an image of this size (px).
pub(super) fn read_image(place: &DatasetPlace, path: &str, (width, height): (u32, u32)) -> Result<GrayImage> {
    let counts = place.image(path, (width, height))?;
    Ok(GrayImage {
        width: width as usize,
        height: height as usize,
        counts: counts.values().map(|count| count as f32).collect(),
    })
}
