//! A dataset on the page: frames, truth, optics.

use std::fmt::Debug;
use std::path::{Component, Path, PathBuf};
use std::sync::{Arc, OnceLock};

use microsig_core::formats::tiff;
use microsig_core::render::Context;
use microsig_core::{Particle, Spheroid};
use serde_json::{Value, json};

use super::columns::{Indexed, by_column, list};
use super::optics;
use generator::dataset::truth::depth;
use microsig_core::visibility::DepthScan;
use scenario::{self, Scenario};
use storage::dataset::manifest::Manifest;
use storage::dataset::{FieldRow, FrameRow, Row, TrackRow};
use storage::error::{Error, Result};
use storage::input;

/// Maximum size of an image, pixels.
const MAX_IMAGE: u64 = 1 << 26;

/// Maximum number of vectors in a response.
const MAX_VECTORS: usize = 20_000;

#[derive(Debug)]
pub(super) struct OpenDataset {
    folder: PathBuf,
    context: Context,
    manifest: Manifest,
    /// Paths of the images, by frame.
    images: Vec<PathBuf>,
    /// Number of visible particles in each frame.
    n_visible: Vec<f64>,
    times_s: Vec<f64>,
    tracks: Once<Option<Indexed>>,
    field: Once<Option<Indexed>>,
    optics: Once<(Scenario, DepthScan)>,
}

/// A value computed on first use; an error is stored and returned each time.
type Once<T> = OnceLock<std::result::Result<Arc<T>, String>>;

fn once<T>(cell: &Once<T>, make: impl FnOnce() -> Result<T>) -> Result<Arc<T>> {
    cell.get_or_init(|| make().map(Arc::new).map_err(|e| e.to_string())).clone().map_err(Error::input)
}

impl OpenDataset {
    /// Reads the manifest of a dataset.
    pub(super) fn open(folder: &Path, context: &Context) -> Result<Self> {
        let mut manifest = Manifest::read(folder)?;
        let resources = std::mem::take(&mut manifest.resources);
        let mut frames: Vec<(u32, PathBuf, f64)> = resources
            .into_iter()
            .filter_map(|file| {
                let is_image = file.path.starts_with("images/") && file.path.ends_with(".tif");
                let n_visible = file.n_visible.map_or(f64::NAN, |n| n as f64);
                Some((file.frame.filter(|_| is_image && is_within(&file.path))?, file.path.into(), n_visible))
            })
            .collect();
        frames.sort_by_key(|(frame, ..)| *frame);
        if frames.is_empty() || frames.iter().zip(0..).any(|((frame, ..), k)| *frame != k) {
            return Err(Error::input(format!("{}: the manifest does not list all images", folder.display())));
        }
        Ok(OpenDataset {
            context: context.clone(),
            times_s: times_s(folder, frames.len()).unwrap_or_default(),
            n_visible: frames.iter().map(|frame| frame.2).collect(),
            images: frames.into_iter().map(|frame| frame.1).collect(),
            folder: folder.to_owned(),
            manifest,
            tracks: OnceLock::new(),
            field: OnceLock::new(),
            optics: OnceLock::new(),
        })
    }

    fn size_px(&self) -> Result<(u32, u32)> {
        let sensor = self.manifest.microsig.sensor.as_ref().map(|s| (s.width_px, s.height_px));
        let size = sensor.filter(|(w, h)| *w > 0 && *h > 0 && u64::from(*w) * u64::from(*h) <= MAX_IMAGE);
        size.ok_or_else(|| {
            Error::input(format!(
                "{}: the manifest does not give the size of the images",
                self.folder.display()
            ))
        })
    }

    pub(super) fn frames(&self) -> usize {
        self.images.len()
    }

    /// Whether frames 2k and 2k + 1 are pairs.
    pub(super) fn are_pairs(&self) -> bool {
        self.manifest.microsig.timing.are_pairs()
    }

    /// Properties that the page needs before it shows a frame.
    pub(super) fn about(&self) -> Result<Value> {
        let (facts, (width, height)) = (&self.manifest.microsig, self.size_px()?);
        Ok(json!({
            "name": self.manifest.name, "title": self.manifest.title, "width": width, "height": height,
            "bits": facts.sensor.as_ref().map(|s| s.bit_depth), "frames": self.frames(),
            "are_pairs": self.are_pairs(), "mode": facts.timing.mode(), "dt_s": facts.timing.dt_s(),
            "times_s": list(self.times_s.iter().copied()),
            "n_visible": list(self.n_visible.iter().copied()),
            "um_per_px": facts.um_per_px, "depth_um": facts.depth_range_um, "n_p": facts.n_p, "n_s": facts.n_s,
            "n_ppp": facts.n_ppp, "snr": facts.snr.as_ref().and_then(|snr| snr.value),
            "a_pi_px": facts.a_pi_px, "max_displacement_px": facts.max_displacement_px,
            "gates": facts.scoring_gates, "renderer": facts.renderer, "generator": facts.generator_version,
            "has_truth": self.folder.join(TrackRow::PATH).is_file(),
            "has_field": self.folder.join(FieldRow::PATH).is_file(),
            "columns": TrackRow::table(&[]).columns.iter().map(|c| json!([c.name, c.unit, c.description])).collect::<Vec<_>>(),
        }))
    }

    /// The counts of a frame as 16-bit little-endian numbers; `None` if there is no such frame.
    pub(super) fn counts(&self, frame: usize) -> Result<Option<Vec<u8>>> {
        let Some(image) = self.images.get(frame) else { return Ok(None) };
        let path = self.folder.join(image);
        let file = input::open_unlinked(&path)?;
        Ok(Some(tiff::read_bytes(file, &path.display().to_string(), self.size_px()?)?))
    }

    fn tracks(&self) -> Result<Arc<Option<Indexed>>> {
        once(&self.tracks, || optional(&self.folder.join(TrackRow::PATH)))
    }

    /// The true particles of a frame by columns; `row` is the row of the first one in the table. Null without
    /// truth.
    pub(super) fn truth(&self, frame: u32) -> Result<Value> {
        let tracks = self.tracks()?;
        let Some(tracks) = tracks.as_ref() else { return Ok(Value::Null) };
        let (rows, before) = tracks.rows(frame)?;
        Ok(json!({ "row": before, "n": rows.len(), "columns": by_column(&tracks.header, &rows) }))
    }

    /// The vectors of the true field of an image pair by columns; a steady field applies to every pair. If
    /// there are too many vectors to draw, only every n-th row.
    pub(super) fn field(&self, pair: u32) -> Result<Value> {
        let field = once(&self.field, || optional(&self.folder.join(FieldRow::PATH)))?;
        let Some(field) = field.as_ref() else { return Ok(Value::Null) };
        let numbers: Vec<u32> = field.numbers().take(2).collect();
        let (rows, _) = field.rows(if numbers == [0] { 0 } else { pair })?;
        let step = rows.len().div_ceil(MAX_VECTORS).max(1);
        let kept: Vec<Vec<f64>> = rows.iter().step_by(step).cloned().collect();
        Ok(json!({ "n": kept.len(), "of": rows.len(), "columns": by_column(&field.header, &kept) }))
    }

    fn optics(&self) -> Result<Arc<(Scenario, DepthScan)>> {
        once(&self.optics, || {
            let (scenario, _) = scenario::of_dataset(&self.folder, &self.context)?;
            let scan = scenario.scan_of_mean()?;
            Ok((scenario, scan))
        })
    }

    /// Peak, widths and area of particle images over depth.
    pub(super) fn depth(&self) -> Result<Value> {
        let optics = self.optics()?;
        let (rows, image) = depth::measure(&optics.0, &optics.1)?;
        Ok(optics::curves(&optics.1, &rows, &image))
    }

    /// The noise-free image of a particle of a frame; null if there is no such particle.
    pub(super) fn particle(&self, frame: u32, row: usize) -> Result<Value> {
        let tracks = self.tracks()?;
        let Some(tracks) = tracks.as_ref() else { return Ok(Value::Null) };
        let (rows, _) = tracks.rows(frame)?;
        let Some(row) = rows.get(row) else { return Ok(Value::Null) };
        let optics = self.optics()?;
        let scenario = &optics.0;
        let cell = |name: &str| tracks.column(name).map_or(f64::NAN, |k| row[k]);
        let depth_factor = scenario.depth_factor();
        let light = if cell("light").is_finite() { cell("light") } else { 1.0 };
        let spheroid =
            Spheroid { e_p: cell("e_p"), alpha_rad: cell("alpha_rad"), beta_rad: cell("beta_rad") };
        let particle = Particle {
            spheroid: scenario.layout.spheroids.then_some(spheroid),
            c_int: cell("c_int") * light,
            ..Particle::sphere(cell("x_px"), cell("y_px"), cell("z_um") / depth_factor, cell("d_um"))
        };
        let numbers = [particle.x_px, particle.y_px, particle.z_um, particle.d_um, particle.c_int];
        if numbers.iter().any(|x| !x.is_finite()) || scenario.renderer.check(&particle).is_err() {
            return Ok(Value::Null);
        }
        optics::crop(scenario, &particle)
    }
}

/// Opens a table, if it exists.
fn optional(path: &Path) -> Result<Option<Indexed>> {
    if path.exists() { Indexed::open(path).map(Some) } else { Ok(None) }
}

/// Times of the frames, s; `None` without the table.
fn times_s(folder: &Path, frames: usize) -> Option<Vec<f64>> {
    let table = Indexed::open(&FrameRow::path_in(folder)?).ok()?;
    let column = table.column("t_s")?;
    let times: Vec<f64> = table.all().ok()?.iter().map(|row| row[column]).collect();
    (times.len() == frames).then_some(times)
}

/// Whether a path stays within its folder.
fn is_within(path: &str) -> bool {
    Path::new(path).components().all(|part| matches!(part, Component::Normal(_)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn paths_of_a_manifest_stay_within_the_dataset() {
        assert!(is_within("images/frame_00000.tif"));
        for path in ["images/../../secret.tif", "/etc/x.tif", "../x.tif", "images/a/../../../x.tif"] {
            assert!(!is_within(path), "{path}");
        }
    }
}
