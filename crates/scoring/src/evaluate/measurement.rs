//! Facts about a measurement other than its particles, from the dataset's manifest.

use std::collections::BTreeMap;
use std::io::{BufRead, BufReader};
use std::path::Path;

use crate::results::sheet::shorten;
use crate::results::{Conventions, LARGEST_UM, Limits, TrackerResult};
use generator::dataset::manifest::{MANIFEST, Manifest, SensorFacts};
use storage::checksums::fingerprint;
use storage::error::{Error, Result};
use storage::folder::is_partial;
use storage::input;
use storage::tables::truth::{FIELD_PATH, TRACKS};

/// Facts about a measurement other than its particles.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct RecordingFacts {
    /// Name of the dataset, or the file name of a bare table.
    pub name: String,
    /// SHA-256 of truth/tracks.csv as recorded in the manifest, or of the bare table.
    pub sha256: Option<String>,
    /// Object-space length of a pixel, um.
    pub um_per_px: Option<f64>,
    /// The rows of the matrix by which a cylindrical lens in front of the camera stretches images.
    pub stretch: Option<[[f64; 2]; 2]>,
    /// Smallest and largest depth, um.
    pub depth_um: Option<(f64, f64)>,
    /// Width and height of the images, px.
    pub sensor_px: Option<(f64, f64)>,
    /// Time between frames (in double-frame recordings: between the frames of a pair), s.
    pub dt_s: Option<f64>,
    /// File names of the images.
    pub images: Vec<String>,
    /// Whether frames are recorded in pairs, so that links exist from A to B only.
    pub pairs: bool,
    /// Number of frames.
    pub frames: Option<u32>,
    /// Version of microsig that generated the dataset.
    pub generator: Option<String>,
    /// Whether frames come in bursts of four: there is no image pair from one burst to the next.
    pub bursts: bool,
    /// Depth at which particle images are sharpest, um.
    pub focus_um: Option<f64>,
    /// Mean area of a particle image over depth, px.
    pub image_area_px: Option<f64>,
    /// The fraction of the sensor in which particles can be, if walls or bodies exclude them from the rest.
    pub image_share: Option<f64>,
    /// Whether particle images are equally sharp at all depths.
    pub is_all_in_focus: bool,
    /// Whether this is a test split, whose truth only the organizers have.
    pub is_withheld: bool,
    /// Whether it was generated with a secret key.
    pub is_from_key: bool,
    /// Whether only particles are scored, because the velocity field is that of the train split.
    pub is_for_particles_only: bool,
    /// Whether only displacement fields are scored.
    pub is_for_fields_only: bool,
}

impl RecordingFacts {
    /// Facts of a dataset or a bare table; `given` values take precedence.
    ///
    /// # Errors
    /// A manifest or table that cannot be read.
    pub fn of(path: &Path, given: &Conventions) -> Result<Self> {
        let own = if path.is_dir() {
            of_manifest(path)?
        } else {
            RecordingFacts {
                name: path.file_stem().unwrap_or_default().to_string_lossy().into_owned(),
                sha256: Some(fingerprint(path)?.sha256.to_string()),
                ..RecordingFacts::default()
            }
        };
        let um_per_px = given.um_per_px.or(own.um_per_px);
        Ok(RecordingFacts { um_per_px, depth_um: given.depth_um.or(own.depth_um), ..own })
    }

    /// A vector as it would be in an image without the stretch by a cylindrical lens in front of the camera.
    pub fn unstretched(&self, [x, y, z]: [f64; 3]) -> [f64; 3] {
        self.stretch.map_or([x, y, z], |[[a, b], [c, d]]| {
            let of = a * d - b * c;
            [(d * x - b * y) / of, (a * y - c * x) / of, z]
        })
    }

    /// Whether the recording has an image pair of this number.
    pub fn has_pair(&self, pair: u32) -> bool {
        let Some(frames) = self.frames else { return true };
        if self.pairs {
            return pair < frames / 2;
        }
        pair.saturating_add(1) < frames && !(self.bursts && pair % 4 == 3)
    }

    /// Describes rows of a result in frames or image pairs that the dataset does not have, each with file and
    /// line.
    pub fn beyond(&self, path: &Path, found: &TrackerResult) -> Vec<String> {
        // The list is cut off for files in which most rows are wrong.
        const MOST: usize = 100;
        let place = |lines: &[u32], i: usize| match lines.get(i) {
            Some(line) => format!("{}:{line}", path.display()),
            None => path.display().to_string(),
        };
        let frames = self.frames.unwrap_or(u32::MAX);
        let mut wrong: Vec<String> = match found {
            TrackerResult::Points(points) => {
                let rows = points.rows.iter().enumerate().filter(|(_, row)| row.frame >= frames);
                let what =
                    |frame: u32| format!("frame = {frame}: expected 0 to {}", frames.saturating_sub(1));
                rows.take(MOST)
                    .map(|(i, row)| format!("{}: {}", place(&points.lines, i), what(row.frame)))
                    .collect()
            }
            TrackerResult::Field(field) => {
                let pairs = field.vectors.iter().enumerate().filter_map(|(i, v)| Some((i, v.pair?)));
                let wrong = pairs.filter(|(_, pair)| !self.has_pair(*pair)).take(MOST);
                let what = |pair: u32| format!("pair = {pair}: the dataset has no such image pair");
                wrong.map(|(i, pair)| format!("{}: {}", place(&field.lines, i), what(pair))).collect()
            }
        };
        shorten(&mut wrong);
        wrong
    }

    /// Conventions for reading a result: those given, completed by facts of the dataset.
    pub fn conventions(&self, given: Conventions) -> Conventions {
        Conventions {
            um_per_px: self.um_per_px,
            depth_um: self.depth_um,
            height_px: self.sensor_px.map(|s| s.1),
            ..given
        }
    }

    /// Refuses an operation that needs the truth of a test split.
    ///
    /// # Errors
    /// If the truth is withheld.
    pub fn needs_truth(&self, dataset: &Path) -> Result<()> {
        if self.is_withheld {
            return Err(Error::input(format!(
                "{}: a test split, whose truth is withheld: only its organizers have it; \
                 evaluate --validate-only checks a result without it",
                dataset.display()
            )));
        }
        Ok(())
    }

    /// Whether depth can be measured from the images, so that results of a challenge need it.
    pub fn is_scored_in_depth(&self) -> bool {
        self.depth_h_um().is_some() && !self.is_all_in_focus
    }

    /// The depth range, um; `None` if it is unknown or empty.
    pub fn depth_h_um(&self) -> Option<f64> {
        self.depth_um.map(|(low, high)| high - low).filter(|h| *h > 0.0)
    }
}

/// Refuses a dataset and a result in the wrong order.
///
/// # Errors
/// A file in place of the dataset, and a dataset in place of the result.
pub fn check_order(dataset: &Path, result: &Path) -> Result<()> {
    if dataset.is_file() && result.join(MANIFEST).is_file() {
        return Err(Error::input(format!(
            "{} is a dataset and {} a file: give the dataset first, then the result",
            result.display(),
            dataset.display()
        )));
    }
    Ok(())
}

/// Upper limits on the size of a result, from the size of the truth (a dataset or a bare table).
///
/// # Errors
/// A truth that is unreadable.
pub fn limits(dataset: &Path, facts: &RecordingFacts) -> Result<Limits> {
    let mut files = vec![dataset.to_owned()];
    if dataset.is_dir() {
        files = [TRACKS.path, FIELD_PATH].map(|path| dataset.join(path)).to_vec();
        files.retain(|path| path.exists());
    }
    if files.is_empty() {
        // A test split without its truth.
        return Ok(Limits::default());
    }
    let (mut bytes, mut rows) = (0, 0);
    for path in files {
        let mut reader = BufReader::with_capacity(1 << 16, input::open(&path)?);
        loop {
            let piece = reader.fill_buf().map_err(|e| Error::read(&path, e))?;
            if piece.is_empty() {
                break;
            }
            let n = piece.len();
            rows += piece.iter().filter(|byte| **byte == b'\n').count() as u64;
            bytes += n as u64;
            reader.consume(n);
        }
    }
    let pixels = facts.sensor_px.map_or(0.0, |(width, height)| width * height);
    Ok(Limits::of_truth(bytes, rows, pixels as u64))
}

/// Reads the facts in a dataset's manifest.
///
/// # Errors
/// A dataset that is not finished; a manifest that cannot be read.
pub fn of_manifest(dataset: &Path) -> Result<RecordingFacts> {
    if is_partial(dataset) {
        return Err(Error::input(format!(
            "{}: unfinished; microsig generate --resume (or sweep --resume) continues it",
            dataset.display()
        )));
    }
    Ok(facts_of(&Manifest::read(dataset)?))
}

/// The facts in a manifest.
fn facts_of(manifest: &Manifest) -> RecordingFacts {
    let (own, timing) = (&manifest.microsig, &manifest.microsig.timing);
    let positive = |v: Option<f64>| v.filter(|v| *v > 0.0 && v.is_finite());
    let sensor = |side: fn(&SensorFacts) -> u32| positive(own.sensor.as_ref().map(|s| f64::from(side(s))));
    let pairs = timing.are_pairs();
    let images = manifest.resources.iter().filter_map(|resource| resource.path.strip_prefix("images/"));
    RecordingFacts {
        images: images.map(str::to_owned).collect(),
        name: if manifest.name.is_empty() { "dataset".to_owned() } else { manifest.name.clone() },
        // Recorded hash of the true particles, which saves reading them again.
        sha256: manifest.resource(TRACKS.path).map(|r| r.sha256().to_owned()),
        um_per_px: positive(own.um_per_px),
        stretch: own.image_stretch.filter(|[[a, b], [c, d]]| a * d - b * c > 0.0),
        depth_um: own
            .depth_range_um
            .map(|[low, high]| (low, high))
            .filter(|(l, h)| l <= h && l.abs().max(h.abs()) <= LARGEST_UM),
        sensor_px: sensor(|s| s.width_px).zip(sensor(|s| s.height_px)),
        dt_s: positive(timing.dt_s()),
        pairs,
        frames: if pairs { timing.pairs().and_then(|p| p.checked_mul(2)) } else { timing.frames() },
        generator: own.generator_version.clone(),
        bursts: timing.are_bursts(),
        focus_um: own.particle_image.as_ref().and_then(|p| p.focus_um),
        image_area_px: positive(own.a_pi_px),
        image_share: own.image_share.filter(|share| *share > 0.0 && *share < 1.0),
        // The public part of a test split names its renderer, not its particle images.
        is_all_in_focus: own
            .particle_image
            .as_ref()
            .map_or(own.renderer.as_deref() == Some("gaussian"), |p| p.focus_um.is_none()),
        is_withheld: own.truth.as_deref() == Some("withheld"),
        is_from_key: own.seed == Some(None),
        is_for_fields_only: own.scored.as_ref().is_some_and(|s| !s.iter().any(|s| s == "particles")),
        is_for_particles_only: own.scored.as_ref().is_some_and(|s| !s.iter().any(|s| s == "fields")),
    }
}

/// Table of a sweep's cases, in the folder that holds the datasets.
const CASES: &str = "cases.csv";

/// The parameter values of a dataset that is a case of a sweep: the columns between `seed` and `status` of
/// `cases.csv` in the parent folder. Empty for other datasets.
///
/// # Errors
/// A table of cases that cannot be read.
pub(super) fn axes(dataset: &Path) -> Result<BTreeMap<String, serde_json::Value>> {
    let Ok(whole) = dataset.canonicalize() else { return Ok(BTreeMap::new()) };
    let (Some(sweep), Some(name)) = (whole.parent(), whole.file_name()) else { return Ok(BTreeMap::new()) };
    let path = sweep.join(CASES);
    if !whole.join(MANIFEST).is_file() || !path.is_file() {
        return Ok(BTreeMap::new());
    }
    let failed = |e: csv::Error| Error::input(format!("{}: {e}", path.display()));
    let mut reader = csv::Reader::from_reader(input::open(&path)?);
    let header = reader.headers().map_err(failed)?.clone();
    let column = |name: &str| header.iter().position(|h| h == name);
    let (Some(dataset), Some(seed), Some(status)) = (column("dataset"), column("seed"), column("status"))
    else {
        return Ok(BTreeMap::new());
    };
    for record in reader.records() {
        let record = record.map_err(failed)?;
        if name == &record[dataset] {
            let axes = (seed + 1..status).map(|i| (header[i].to_owned(), value(&record[i])));
            return Ok(axes.collect());
        }
    }
    Ok(BTreeMap::new())
}

/// Converts a cell to a number if possible, otherwise to text.
fn value(text: &str) -> serde_json::Value {
    let number = text.parse::<f64>().ok().and_then(serde_json::Number::from_f64);
    number.map_or_else(|| text.into(), serde_json::Value::Number)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn facts_in_a_manifest_are_read_and_others_are_unknown() {
        let read = |text: &str| Manifest::parse(text, "datapackage.json").map(|manifest| facts_of(&manifest));
        let facts = read(
            r#"{ "name": "a", "microsig": { "timing": { "mode": "pairs", "pairs": 3, "dt_s": 0.01 },
                "depth_range_um": [-5, 5], "um_per_px": -1, "scored": ["particles"],
                "particle_image": { "d_um": 2, "focus_um": null } },
                "resources": [ { "path": "truth/tracks.csv", "bytes": 1, "hash": "sha256:12" } ] }"#,
        )
        .unwrap();
        assert_eq!((facts.frames, facts.pairs, facts.dt_s), (Some(6), true, Some(0.01)));
        assert_eq!((facts.sensor_px, facts.um_per_px, facts.depth_um), (None, None, Some((-5.0, 5.0))));
        assert!(
            facts.is_all_in_focus && facts.is_for_particles_only && facts.sha256.as_deref() == Some("12")
        );
        for (renderer, in_focus) in [("gaussian", true), ("rays", false)] {
            let public = read(&format!(r#"{{ "microsig": {{ "renderer": "{renderer}" }} }}"#)).unwrap();
            assert_eq!(public.is_all_in_focus, in_focus, "{renderer}");
        }
        assert_eq!(
            read("{}").unwrap(),
            RecordingFacts { name: "dataset".to_owned(), ..RecordingFacts::default() }
        );
        assert!(read("{").is_err());
    }
}
