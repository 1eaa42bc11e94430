//! The truth that results are scored against: of a dataset, or of a bare table.
//!
//! Scored are the particles that are visible and inside the depth range. Each section of a track between rows that are not
//! scored is a reference track of its own. A result point assigned to a particle that is not scored is dropped with it,
//! and the result's track is cut there: so `truth/tracks.csv` itself is a perfect result.

use std::collections::BTreeMap;
use std::path::Path;

use serde_json::Value;

use super::cloud::{Cloud, Loose};
use super::gate::Gate;
use super::matching::{Cost, NONE, optimal};
use crate::dataset::checksums::fingerprint;
use crate::dataset::folder::is_partial;
use crate::dataset::manifest::MANIFEST;
use crate::dataset::truth::{FRAMES, TRACKS};
use crate::error::{Error, Result};
use crate::results::sheet::{Separator, Sheet, shorten};
use crate::results::{Conventions, Found, Points, Row, Speed, read_points};

/// What is known about a measurement beside its particles.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Facts {
    /// Name of the dataset; the table's file name if it is bare.
    pub name: String,
    /// SHA-256 of the dataset's truth/tracks.csv as its manifest tells it, or of the bare table.
    pub sha256: Option<String>,
    /// Object-space length of a pixel, um.
    pub um_per_px: Option<f64>,
    /// Least and greatest depth, um.
    pub depth_um: Option<(f64, f64)>,
    /// Width and height of the images, px.
    pub sensor_px: Option<(f64, f64)>,
    /// Time between frames (in pair recordings: of a pair), s.
    pub dt_s: Option<f64>,
    /// Whether frames are pairs: links exist from A to B only.
    pub pairs: bool,
    /// Number of frames.
    pub frames: Option<u32>,
    /// Version of the generator.
    pub generator: Option<String>,
    /// Whether frames come in bursts of four: there is no image pair from one burst to the next.
    pub bursts: bool,
    /// Where particles are seen sharpest, um.
    pub focus_um: Option<f64>,
    /// Whether all depths are seen alike.
    pub is_all_in_focus: bool,
    /// Whether this is a test split, whose truth only its organisers have.
    pub is_withheld: bool,
}

impl Facts {
    /// Of a dataset or a bare table; what is given comes first.
    ///
    /// # Errors
    /// A manifest or table that cannot be read.
    pub fn of(path: &Path, given: &Conventions) -> Result<Self> {
        let told = if path.is_dir() {
            facts(path)?
        } else {
            Facts {
                name: path.file_stem().unwrap_or_default().to_string_lossy().into_owned(),
                sha256: Some(fingerprint(path)?.sha256.to_string()),
                ..Facts::default()
            }
        };
        let um_per_px = given.um_per_px.or(told.um_per_px);
        Ok(Facts { um_per_px, depth_um: given.depth_um.or(told.depth_um), ..told })
    }

    /// Whether frames make an image pair of this number.
    pub fn has_pair(&self, pair: u32) -> bool {
        let Some(frames) = self.frames else { return true };
        if self.pairs {
            return pair < frames / 2;
        }
        pair.saturating_add(1) < frames && !(self.bursts && pair % 4 == 3)
    }

    /// The rows of a result in frames, or of image pairs, that there are not: what is wrong, with lines.
    pub fn beyond(&self, path: &Path, found: &Found) -> Vec<String> {
        // A file that is wrong all over needs no full list.
        const MOST: usize = 100;
        let place = |lines: &[u32], i: usize| match lines.get(i) {
            Some(line) => format!("{}:{line}", path.display()),
            None => path.display().to_string(),
        };
        let frames = self.frames.unwrap_or(u32::MAX);
        let mut wrong: Vec<String> = match found {
            Found::Points(points) => {
                let rows = points.rows.iter().enumerate().filter(|(_, row)| row.frame >= frames);
                let what =
                    |frame: u32| format!("frame = {frame}: expected 0 to {}", frames.saturating_sub(1));
                rows.take(MOST)
                    .map(|(i, row)| format!("{}: {}", place(&points.lines, i), what(row.frame)))
                    .collect()
            }
            Found::Field(field) => {
                let pairs = field.vectors.iter().enumerate().filter_map(|(i, v)| Some((i, v.pair?)));
                let wrong = pairs.filter(|(_, pair)| !self.has_pair(*pair)).take(MOST);
                let what = |pair: u32| format!("pair = {pair}: the dataset has no such image pair");
                wrong.map(|(i, pair)| format!("{}: {}", place(&field.lines, i), what(pair))).collect()
            }
        };
        shorten(&mut wrong);
        wrong
    }

    /// Refuses what needs the truth of a test split.
    ///
    /// # Errors
    /// Says that it is withheld.
    pub(crate) fn needs_truth(&self, dataset: &Path) -> Result<()> {
        if self.is_withheld {
            return Err(Error::input(format!(
                "{}: a test split, whose truth is withheld: only its organisers have it; \
                 evaluate --validate-only checks a result without it",
                dataset.display()
            )));
        }
        Ok(())
    }

    /// The depth range, um; `None` if it is unknown or empty.
    pub fn depth_h_um(&self) -> Option<f64> {
        self.depth_um.map(|(low, high)| high - low).filter(|h| *h > 0.0)
    }
}

/// The true particles of all frames, in the order of their table.
#[derive(Debug, Clone, Default)]
pub struct Truth {
    /// What is known beside them.
    pub facts: Facts,
    /// Where they are.
    pub rows: Vec<Row>,
    /// Whether there is a depth.
    pub has_z: bool,
    /// Which are on the sensor.
    pub visible: Vec<bool>,
    /// Velocities, um/s; empty if unknown.
    pub velocity_um_s: Vec<[f64; 3]>,
    /// When frames were taken, s; empty if unknown.
    pub times_s: BTreeMap<u32, f64>,
    /// Further properties that recall and errors can be binned by: name, and a value per row.
    pub properties: Vec<(&'static str, Vec<f64>)>,
    /// What should be known about it.
    pub notes: Vec<String>,
}

/// Columns of the truth that make curves of their own if they are there.
const PROPERTIES: [&str; 2] = ["snr", "overlap"];

impl Truth {
    /// Reads the truth of a dataset, or a bare table of particles.
    ///
    /// # Errors
    /// Files that cannot be read or do not hold what they should.
    pub fn read(path: &Path, given: &Conventions) -> Result<Self> {
        let facts = Facts::of(path, given)?;
        if path.is_dir() {
            facts.needs_truth(path)?;
            let mut truth = tracks(&path.join(TRACKS.path), facts)?;
            let frames = path.join(FRAMES.path);
            if frames.exists() {
                truth.times_s = times(&frames)?;
            }
            return Ok(truth);
        }
        tracks(path, facts)
    }

    /// Time from a frame to a later one, s; `None` if it is unknown.
    pub fn elapsed_s(&self, from: u32, to: u32) -> Option<f64> {
        let at = |frame: u32| self.times_s.get(&frame);
        let elapsed = if self.times_s.is_empty() {
            self.facts.dt_s.map(|dt_s| dt_s * (f64::from(to) - f64::from(from)))
        } else {
            at(from).zip(at(to)).map(|(from, to)| to - from)
        };
        elapsed.filter(|t| *t > 0.0)
    }

    /// Time from each frame to the next, s; `None` if it varies or is unknown.
    pub fn step_s(&self) -> Option<f64> {
        if self.times_s.is_empty() {
            return self.facts.dt_s;
        }
        let next_to = |a: u32, b: u32| b == a + 1 && !(self.facts.pairs && a % 2 == 1);
        let frames = self.times_s.iter().zip(self.times_s.iter().skip(1));
        let mut steps = frames.filter(|((a, _), (b, _))| next_to(**a, **b)).map(|((_, s), (_, t))| t - s);
        let first = steps.next()?;
        steps.all(|step| same_time(step, first)).then_some(first)
    }

    /// The particles of the frames before one, without their further properties.
    pub(super) fn before(&self, end: u32) -> Self {
        let kept = || self.rows.iter().zip(&self.visible).filter(|(row, _)| row.frame < end);
        Truth {
            facts: self.facts.clone(),
            has_z: self.has_z,
            rows: kept().map(|(row, _)| *row).collect(),
            visible: kept().map(|(_, visible)| *visible).collect(),
            ..Truth::default()
        }
    }

    /// The part that is scored, and the part of a result that is.
    ///
    /// # Errors
    /// A gate that is too wide.
    pub fn scored(&self, result: &Points, gate: &Gate, flat: bool, border_px: f64) -> Result<Scored> {
        let at = |row: &Row| if flat { crate::results::Position { z_um: 0.0, ..row.at } } else { row.at };
        let counts: Vec<bool> = (0..self.rows.len()).map(|i| self.is_scored(i, border_px)).collect();
        let loose = |rows: &[Row]| -> Vec<Loose> {
            let track = |r: &Row| (r.track >= 0).then_some((r.track, 0));
            rows.iter()
                .enumerate()
                .map(|(i, r)| Loose { frame: r.frame, track: track(r), at: at(r), source: i as u32 })
                .collect()
        };
        let (mut all, mut found) = (loose(&self.rows), loose(&result.rows));
        let mut dropped = vec![false; found.len()];
        if counts.contains(&false) {
            let with_unscored: std::collections::BTreeSet<u32> =
                self.rows.iter().zip(&counts).filter(|(_, c)| !**c).map(|(r, _)| r.frame).collect();
            let part = |points: &[Loose]| {
                Cloud::new(points.iter().copied().filter(|p| with_unscored.contains(&p.frame)).collect())
            };
            let (truths, results) = (part(&all), part(&found));
            let matching = optimal(&truths, &results, gate, Cost::Squares)?;
            for (r, &t) in matching.of_result.iter().enumerate() {
                if t != NONE && !counts[truths.points[t as usize].source as usize] {
                    dropped[results.points[r].source as usize] = true;
                }
            }
        }
        cut(&mut all, |i| !counts[i], self.facts.pairs);
        cut(&mut found, |i| dropped[i], self.facts.pairs);
        let keep = |points: Vec<Loose>, kept: &dyn Fn(usize) -> bool| {
            Cloud::new(points.into_iter().filter(|p| kept(p.source as usize)).collect())
        };
        Ok(Scored {
            ignored_truth: counts.iter().filter(|c| !**c).count(),
            ignored_result: dropped.iter().filter(|d| **d).count(),
            truth: keep(all, &|i| counts[i]),
            result: keep(found, &|i| !dropped[i]),
        })
    }

    /// Whether a row is scored: visible, inside the depth range, and this far from the edge.
    pub(crate) fn is_scored(&self, i: usize, border_px: f64) -> bool {
        let at = &self.rows[i].at;
        let inside =
            self.facts.depth_um.is_none_or(|(low, high)| !self.has_z || (low..=high).contains(&at.z_um));
        let clear = border_px <= 0.0
            || self.facts.sensor_px.is_none_or(|(width, height)| {
                let on = |v: f64, size: f64| v >= 0.5 + border_px && v < size + 0.5 - border_px;
                on(at.x_px, width) && on(at.y_px, height)
            });
        self.visible[i] && inside && clear
    }
}

/// The scored part of truth and result.
#[derive(Debug, Clone)]
pub struct Scored {
    /// True particles that are scored; `source` is the row of the truth.
    pub truth: Cloud,
    /// Result points that are scored; `source` is the row of the result.
    pub result: Cloud,
    /// True particles that are not.
    pub ignored_truth: usize,
    /// Result points that were assigned to those.
    pub ignored_result: usize,
}

/// Numbers the sections of tracks that ignored rows, and the ends of pairs, divide.
fn cut(points: &mut [Loose], ignored: impl Fn(usize) -> bool, pairs: bool) {
    let mut order: Vec<usize> = (0..points.len()).filter(|&i| points[i].track.is_some()).collect();
    order.sort_unstable_by_key(|&i| (points[i].track, points[i].frame));
    let (mut before, mut section): (Option<(i64, u32)>, u32) = (None, 0);
    for i in order {
        let (track, frame) = (points[i].track.map_or(-1, |t| t.0), points[i].frame);
        match before {
            Some((t, f)) if t == track => section += u32::from(pairs && f / 2 != frame / 2),
            _ => section = 0,
        }
        before = Some((track, frame));
        section += u32::from(ignored(points[i].source as usize));
        points[i].track = Some((track, section));
    }
}

/// What a dataset tells about results, beside what is given.
///
/// # Errors
/// A manifest that cannot be read.
pub fn conventions(dataset: &Path, given: Conventions) -> Result<Conventions> {
    let facts = facts(dataset)?;
    Ok(Conventions {
        um_per_px: given.um_per_px.or(facts.um_per_px),
        depth_um: given.depth_um.or(facts.depth_um),
        height_px: facts.sensor_px.map(|s| s.1),
        ..given
    })
}

/// Reads what a dataset's manifest tells.
pub(crate) fn facts(dataset: &Path) -> Result<Facts> {
    if is_partial(dataset) {
        return Err(Error::input(format!(
            "{}: unfinished; microsig generate --resume (or sweep --resume) goes on with it",
            dataset.display()
        )));
    }
    let path = dataset.join(MANIFEST);
    let text = std::fs::read_to_string(&path).map_err(|e| Error::read(&path, e))?;
    let manifest: Value =
        serde_json::from_str(&text).map_err(|e| Error::input(format!("{}: {e}", path.display())))?;
    let own = &manifest["microsig"];
    let positive = |v: &Value| v.as_f64().filter(|v| *v > 0.0 && v.is_finite());
    let both = |a: Option<f64>, b: Option<f64>| a.zip(b);
    let timing = &own["timing"];
    let pairs = timing["mode"] == "pairs";
    let frames = if pairs { timing["pairs"].as_u64().map(|p| 2 * p) } else { timing["frames"].as_u64() };
    Ok(Facts {
        name: manifest["name"].as_str().unwrap_or("dataset").to_owned(),
        sha256: hash(&manifest),
        um_per_px: positive(&own["um_per_px"]),
        depth_um: both(own["depth_range_um"][0].as_f64(), own["depth_range_um"][1].as_f64())
            .filter(|(l, h)| l <= h),
        sensor_px: both(positive(&own["sensor"]["width_px"]), positive(&own["sensor"]["height_px"])),
        dt_s: positive(&timing["dt_s"]),
        pairs,
        frames: frames.and_then(|f| u32::try_from(f).ok()),
        generator: own["generator_version"].as_str().map(str::to_owned),
        bursts: timing["mode"] == "four_pulse",
        focus_um: own["particle_image"]["focus_um"].as_f64(),
        is_all_in_focus: own["particle_image"].get("focus_um").is_some_and(Value::is_null),
        is_withheld: own["truth"] == "withheld",
    })
}

/// The hash of the true particles, which nobody needs to read again for it.
fn hash(manifest: &Value) -> Option<String> {
    let of = manifest["resources"].as_array()?.iter().find(|r| r["path"] == TRACKS.path)?;
    Some(of["hash"].as_str()?.trim_start_matches("sha256:").to_owned())
}

fn tracks(path: &Path, facts: Facts) -> Result<Truth> {
    let points = read_points(path, &Conventions::default())?;
    let mut truth = Truth { facts, has_z: points.has_z, ..Truth::default() };
    if points.n_nan > 0 {
        return Err(Error::input(format!(
            "{}: {} rows of the truth have no coordinates",
            path.display(),
            points.n_nan
        )));
    }
    truth.rows = points.rows;
    truth.velocity_um_s =
        points.velocities.filter(|v| v.unit == Speed::UmPerS).map(|v| v.rows).unwrap_or_default();
    let n = truth.rows.len();
    let sheet = Sheet::open(path, Separator::Comma, 1)?;
    let (visible, ignore) = (sheet.column("visible"), sheet.column("ignore"));
    let time = sheet.column("t_s");
    let properties: Vec<(&'static str, usize)> =
        PROPERTIES.iter().filter_map(|&name| sheet.column(name).map(|c| (name, c))).collect();
    truth.visible = vec![true; n];
    truth.properties = properties.iter().map(|&(name, _)| (name, Vec::with_capacity(n))).collect();
    let mut row = 0;
    if visible.is_some() || ignore.is_some() || time.is_some() || !properties.is_empty() {
        sheet.rows(|cells| {
            truth.visible[row] = cells.number_or_nan(visible)? != 0.0 && cells.number_or_nan(ignore)? != 1.0;
            if let Some(time) = time {
                truth.times_s.insert(truth.rows[row].frame, cells.number(time)?);
            }
            for (values, &(_, column)) in truth.properties.iter_mut().zip(&properties) {
                values.1.push(cells.number(column)?);
            }
            row += 1;
            Ok(())
        })?;
    }
    Ok(truth)
}

/// Whether two times are the same but for rounding of the sums they come from.
pub(super) fn same_time(a: f64, b: f64) -> bool {
    (a - b).abs() <= 1e-6 * a.abs().max(b.abs())
}

/// When frames were taken.
fn times(path: &Path) -> Result<BTreeMap<u32, f64>> {
    let sheet = Sheet::open(path, Separator::Comma, 1)?;
    let (frame, time) = (sheet.need("frame")?, sheet.need("t_s")?);
    let mut times = BTreeMap::new();
    sheet.rows(|cells| {
        times.insert(cells.number(frame)? as u32, cells.number(time)?);
        Ok(())
    })?;
    Ok(times)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::results::Position;

    fn row(frame: u32, track: i64, x_px: f64) -> Row {
        Row { frame, track, at: Position { x_px, y_px: 10.0, z_um: 0.0 } }
    }

    #[test]
    fn a_particle_that_leaves_and_comes_back_is_two_tracks_in_truth_and_result() {
        let rows: Vec<Row> = (0..6).map(|f| row(f, 4, f64::from(f))).collect();
        let truth = Truth {
            visible: vec![true, true, false, false, true, true],
            rows: rows.clone(),
            ..Truth::default()
        };
        let result = Points { rows, ..Points::default() };
        let scored = truth.scored(&result, &Gate::radial(2.0), true, 0.0).unwrap();
        assert_eq!((scored.truth.len(), scored.truth.n_tracks(), scored.ignored_truth), (4, 2, 2));
        assert_eq!((scored.result.len(), scored.result.n_tracks(), scored.ignored_result), (4, 2, 2));
    }

    #[test]
    fn links_of_pair_recordings_stay_within_pairs() {
        let rows: Vec<Row> = (0..4).map(|f| row(f, 1, 5.0)).collect();
        let truth = Truth {
            facts: Facts { pairs: true, ..Facts::default() },
            visible: vec![true; 4],
            rows: rows.clone(),
            ..Truth::default()
        };
        let scored =
            truth.scored(&Points { rows, ..Points::default() }, &Gate::radial(2.0), true, 0.0).unwrap();
        assert_eq!(scored.truth.links().count(), 2);
    }
}
