//! The true particles that results are scored against, from a dataset or a bare table.
//!
//! Only visible particles inside the depth range are scored. Each section of a track between unscored rows is
//! a reference track of its own. A result point assigned to an unscored particle is dropped, and the result's
//! track is cut there, so that `truth/tracks.csv` itself scores as a perfect result.

use std::collections::BTreeMap;
use std::path::Path;

use super::gate::Gate;
use super::matching::{Cost, NONE, optimal};
use super::measurement::{TableSize, facts_of};
use super::track_set::{TrackSet, UnsortedPoint};
use crate::results::sheet::TextTable;
use crate::results::{
    Conventions, Converter, PARTICLES, Points, Position, TrackRow, VelocityUnit, read_points,
};
use microsig_core::Spheroid;
use storage::checksums::Hashing;
use storage::dataset::{DatasetPlace, FrameRow, RecordingFacts, Row, TableReader};
use storage::error::{Error, Result};
use storage::input;

/// The true particles of all frames, in the order of their table.
#[derive(Debug, Clone, Default)]
pub struct TrueParticles {
    /// Facts about the measurement.
    pub facts: RecordingFacts,
    /// Frame, track and position of each particle.
    pub rows: Vec<TrackRow>,
    /// Whether the table has z.
    pub has_z: bool,
    /// Whether each particle is visible (on the sensor and not marked `ignore`).
    pub visible: Vec<bool>,
    /// Velocity of each particle, um/s; empty if unknown.
    pub velocity_um_s: Vec<[f64; 3]>,
    /// Symmetry axis of each spheroid, NaN for spheres; empty if there are no spheroids.
    pub axes: Vec<[f64; 3]>,
    /// Polar over equatorial diameter of each particle, as long as `axes`; empty for a bare table.
    pub aspects: Vec<f64>,
    /// Time of each frame, s; empty if unknown.
    pub times_s: BTreeMap<u32, f64>,
    /// Diameter (um) and brightness of each particle; empty for a bare table.
    pub sizes: Vec<[f64; 2]>,
    /// Further properties by which recall and errors are binned: name, and a value for each row.
    pub properties: Vec<(&'static str, Vec<f64>)>,
    /// Notes on how the truth was interpreted.
    pub notes: Vec<String>,
}

/// Optional columns of the truth over which curves are computed.
const PROPERTIES: [&str; 2] = ["snr", "overlap"];

/// Largest plausible value of such a property.
const LARGEST_PROPERTY: f64 = 1e12;

impl TrueParticles {
    /// Whether any particle is at a depth other than 0.
    pub(super) fn has_depth(&self) -> bool {
        self.has_z && self.rows.iter().any(|row| row.at.z_um != 0.0)
    }

    /// The visible spheroids, with their depths (um).
    pub(super) fn spheroids(&self) -> Vec<(f64, Spheroid)> {
        let shapes = self.axes.iter().zip(&self.aspects).zip(&self.visible);
        let seen =
            self.rows.iter().zip(shapes).filter(|(_, ((axis, _), visible))| **visible && axis[0].is_finite());
        seen.map(|(row, ((axis, e_p), _))| (row.at.z_um, Spheroid::from_axis(*e_p, *axis))).collect()
    }

    /// Reads the truth of a dataset, or a bare table of particles.
    pub fn read(path: &Path, given: &Conventions) -> Result<Self> {
        let facts = facts_of(path, given)?;
        if path.is_dir() { Ok(Self::from_dataset(path, facts)?.0) } else { bare(path, facts) }
    }

    /// The truth of a dataset in a folder or in memory.
    pub fn from_place(dataset: &DatasetPlace) -> Result<Self> {
        let facts = dataset.facts()?;
        match dataset {
            DatasetPlace::Folder(folder) => Ok(Self::from_dataset(folder, facts)?.0),
            DatasetPlace::Memory(made) => Self::from_rows(facts, made.tracks(), &made.frames()),
        }
    }

    /// Reads the truth of a dataset in one pass; if it has changed since the dataset was made, the hash in
    /// the facts is replaced. Also returns the size of its table.
    pub(super) fn from_dataset(dataset: &Path, facts: RecordingFacts) -> Result<(Self, TableSize)> {
        facts.needs_truth(dataset)?;
        let path = dataset.join(storage::dataset::TrackRow::PATH);
        let name = path.display().to_string();
        let table = TableReader::new(&name, Hashing::new(input::open(&path)?))?;
        let columns = Present::of(|name| table.column(name).is_some());
        let (mut rows, mut incomplete) = (Rows::new(facts, columns)?, 0);
        let needed = ["frame", "x_px", "y_px"];
        let read = table.rows(&needed, |_, row| {
            incomplete += u64::from(!rows.add(&row)?);
            Ok(())
        })?;
        if incomplete > 0 {
            return Err(without_coordinates(&path, incomplete));
        }
        let (found, mut truth) = (read.fingerprint(), rows.truth());
        let size = TableSize { bytes: found.bytes, rows: truth.rows.len() as u64 };
        if let Some(recorded) = truth.facts.sha256.as_mut() {
            *recorded = found.sha256.to_string();
        }
        if dataset.join(FrameRow::PATH).exists() {
            truth.times_s = times(&storage::dataset::read_rows::<FrameRow>(dataset, &["frame", "t_s"])?);
        }
        Ok((truth, size))
    }

    /// The truth in rows of a dataset.
    pub fn from_rows<'r>(
        facts: RecordingFacts,
        tracks: impl Iterator<Item = &'r storage::dataset::TrackRow>,
        frames: &[FrameRow],
    ) -> Result<Self> {
        let mut rows = Rows::new(facts, Present::of(|_| true))?;
        for row in tracks {
            rows.add(row)
                .map_err(|what| Error::input(format!("{}: {what}", storage::dataset::TrackRow::PATH)))?;
        }
        Ok(TrueParticles { times_s: times(frames), ..rows.truth() })
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

    /// The particles of frames before `end`, with positions and visibility only.
    pub(super) fn before(&self, end: u32) -> Self {
        let kept = || self.rows.iter().zip(&self.visible).filter(|(row, _)| row.frame < end);
        TrueParticles {
            facts: self.facts.clone(),
            has_z: self.has_z,
            rows: kept().map(|(row, _)| *row).collect(),
            visible: kept().map(|(_, visible)| *visible).collect(),
            ..TrueParticles::default()
        }
    }

    /// Selects the scored points of truth and result. `flat` ignores depth; particles outside the region are not
    /// scored, nor are ghosts there.
    pub fn scored(&self, result: &Points, gate: &Gate, flat: bool, region: Region) -> Result<ScoredPoints> {
        let Region { border_px, depth_um } = region;
        let at = |row: &TrackRow| if flat { Position { z_um: 0.0, ..row.at } } else { row.at };
        let ignored: Vec<bool> = (0..self.rows.len()).map(|i| !self.is_scored(i, border_px)).collect();
        let loose = |(i, r): (usize, &TrackRow)| {
            let track = (r.track >= 0).then_some((r.track, 0));
            UnsortedPoint { frame: r.frame, track, at: at(r), source: i as u32 }
        };
        let mut dropped = vec![false; result.rows.len()];
        // A range that contains the whole truth is the measurement's: ghosts beyond it are counted.
        let is_beyond = |at: &Position| depth_um.is_some_and(|(low, high)| !(low..=high).contains(&at.z_um));
        let is_part = !flat && self.rows.iter().any(|row| is_beyond(&row.at));
        let is_outside =
            |row: &TrackRow| !self.is_clear(&row.at, border_px) || (is_part && is_beyond(&row.at));
        let outside: Vec<bool> = result.rows.iter().map(is_outside).collect();
        if ignored.contains(&true) || outside.contains(&true) {
            let unscored =
                self.rows.iter().zip(&ignored).filter(|(_, ignored)| **ignored).map(|(r, _)| r.frame);
            let ghosts = result.rows.iter().zip(&outside).filter(|(_, b)| **b).map(|(r, _)| r.frame);
            let with_unscored: std::collections::BTreeSet<u32> = unscored.chain(ghosts).collect();
            let part = |rows: &[TrackRow]| {
                let part = rows.iter().enumerate().filter(|(_, r)| with_unscored.contains(&r.frame));
                TrackSet::new(part.map(loose).collect())
            };
            let (truths, results) = (part(&self.rows), part(&result.rows));
            let matching = optimal(&truths, &results, gate, Cost::Squares)?;
            for (r, &t) in matching.truth_for.iter().enumerate() {
                let source = results.points[r].source as usize;
                dropped[source] = match t {
                    NONE => outside[source],
                    t => ignored[truths.points[t as usize].source as usize],
                };
            }
        }
        // One after the other: large results take a tenth less memory.
        let keep = |rows: &[TrackRow], ignored: &[bool]| {
            let mut points: Vec<UnsortedPoint> = rows.iter().enumerate().map(loose).collect();
            cut(&mut points, |i| ignored[i], self.facts.pairs);
            points.retain(|p| !ignored[p.source as usize]);
            TrackSet::new(points)
        };
        Ok(ScoredPoints {
            ignored_truth: ignored.iter().filter(|ignored| **ignored).count(),
            ignored_result: dropped.iter().filter(|d| **d).count(),
            truth: keep(&self.rows, &ignored),
            result: keep(&result.rows, &dropped),
        })
    }

    /// Whether a row is scored: visible, inside the depth range, and at least `border_px` from the edge of
    /// the sensor.
    pub fn is_scored(&self, i: usize, border_px: f64) -> bool {
        let at = &self.rows[i].at;
        let inside =
            self.facts.depth_um.is_none_or(|(low, high)| !self.has_z || (low..=high).contains(&at.z_um));
        self.visible[i] && inside && self.is_clear(at, border_px)
    }

    /// Drops the axes if there are spheres only.
    fn without_spheres(&mut self) {
        if self.axes.iter().all(|axis| axis[0].is_nan()) {
            // Not `clear`, which keeps the memory.
            (self.axes, self.aspects) = (Vec::new(), Vec::new());
        }
    }

    /// Whether a position is at least `border_px` from the edge of the sensor.
    fn is_clear(&self, at: &Position, border_px: f64) -> bool {
        border_px <= 0.0
            || self.facts.sensor_px.is_none_or(|(width, height)| {
                let on = |v: f64, size: f64| v >= 0.5 + border_px && v < size + 0.5 - border_px;
                on(at.x_px, width) && on(at.y_px, height)
            })
    }
}

/// The part of the recorded volume in which particles are scored.
#[derive(Debug, Clone, Copy, Default)]
pub struct Region {
    /// Width of the border of the image that does not belong to it, px.
    pub border_px: f64,
    /// Depths that an option limits it to, um; `None`: the dataset's.
    pub depth_um: Option<(f64, f64)>,
}

/// The scored points of truth and result.
#[derive(Debug, Clone)]
pub struct ScoredPoints {
    /// Scored true particles; `source` is the row in the truth.
    pub truth: TrackSet,
    /// Scored result points; `source` is the row in the result.
    pub result: TrackSet,
    /// Number of true particles that are not scored.
    pub ignored_truth: usize,
    /// Number of result points assigned to those.
    pub ignored_result: usize,
}

/// Numbers the sections of tracks, which are divided by ignored rows and at the ends of image pairs.
fn cut(points: &mut [UnsortedPoint], ignored: impl Fn(usize) -> bool, pairs: bool) {
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

fn without_coordinates(path: &Path, rows: u64) -> Error {
    Error::input(format!("{}: {rows} rows of the truth have no coordinates", path.display()))
}

/// Which columns the table of tracks has.
struct Present {
    track: bool,
    z: bool,
    visible: bool,
    velocity: bool,
    axes: bool,
    brightness: bool,
    properties: [bool; PROPERTIES.len()],
}

impl Present {
    fn of(has: impl Fn(&str) -> bool) -> Self {
        let all = |names: &[&str]| names.iter().all(|name| has(name));
        Present {
            track: has("track"),
            z: has("z_um"),
            visible: has("visible"),
            velocity: all(&["u_um_s", "v_um_s"]),
            axes: all(&["e_p", "alpha_rad", "beta_rad"]),
            brightness: has("c_int"),
            properties: PROPERTIES.map(has),
        }
    }
}

/// Collects the true particles from rows of a dataset.
struct Rows {
    truth: TrueParticles,
    columns: Present,
    converter: Converter,
}

impl Rows {
    fn new(facts: RecordingFacts, columns: Present) -> Result<Self> {
        let there = PROPERTIES.into_iter().zip(columns.properties).filter(|(_, there)| *there);
        let properties = there.map(|(name, _)| (name, Vec::new())).collect();
        let truth = TrueParticles { facts, has_z: columns.z, properties, ..TrueParticles::default() };
        Ok(Rows { truth, columns, converter: Converter::new(PARTICLES, &Conventions::default())? })
    }

    /// Adds a row; returns `false` if it has no coordinates.
    fn add(&mut self, row: &storage::dataset::TrackRow) -> std::result::Result<bool, String> {
        let Rows { truth, columns, converter } = self;
        let frame = converter.frame(f64::from(row.frame))?;
        let z_um = if columns.z { row.z_um } else { 0.0 };
        let Some(at) = converter.position(row.x_px, row.y_px, z_um)? else { return Ok(false) };
        let whole = i64::try_from(row.track).map_err(|_| format!("track = {}: too large", row.track));
        truth.rows.push(TrackRow { frame, track: if columns.track { whole? } else { -1 }, at });
        truth.visible.push(row.visible || !columns.visible);
        truth.sizes.push([row.d_um, if columns.brightness { row.c_int } else { 1.0 }]);
        if row.t_s.is_finite() {
            truth.times_s.insert(frame, row.t_s);
        }
        if columns.velocity {
            let velocity = [row.u_um_s, row.v_um_s, row.w_um_s];
            truth.velocity_um_s.push(converter.velocity(velocity, ["u_um_s", "v_um_s", "w_um_s"])?);
        }
        if columns.axes {
            let spheroid = Spheroid { e_p: 1.0, alpha_rad: row.alpha_rad, beta_rad: row.beta_rad };
            truth.axes.push(if row.e_p == 1.0 { [f64::NAN; 3] } else { spheroid.axis() });
            truth.aspects.push(row.e_p);
        }
        for (name, values) in &mut truth.properties {
            values.push(property(name, if *name == PROPERTIES[0] { row.snr } else { row.overlap })?);
        }
        Ok(true)
    }

    fn truth(self) -> TrueParticles {
        let mut truth = self.truth;
        truth.without_spheres();
        truth
    }
}

/// A property of a particle within its range. Unknown and infinite values are in no bin; differences of the
/// others must be finite.
fn property(name: &str, value: f64) -> std::result::Result<f64, String> {
    if value.is_finite() && value.abs() > LARGEST_PROPERTY {
        return Err(format!("{name} = {value:e}: expected at most {LARGEST_PROPERTY:e} in size"));
    }
    Ok(value)
}

/// Times of frames, s.
fn times(frames: &[FrameRow]) -> BTreeMap<u32, f64> {
    // Times of recordings may be unknown.
    frames.iter().filter(|row| row.t_s.is_finite()).map(|row| (row.frame, row.t_s)).collect()
}

/// Reads a bare table.
pub(super) fn bare(path: &Path, facts: RecordingFacts) -> Result<TrueParticles> {
    let points = read_points(path, &Conventions::default())?;
    let mut truth = TrueParticles { facts, has_z: points.has_z, ..TrueParticles::default() };
    if points.n_nan > 0 {
        return Err(without_coordinates(path, points.n_nan as u64));
    }
    truth.rows = points.rows;
    truth.velocity_um_s =
        points.velocities.filter(|v| v.unit == VelocityUnit::UmPerS).map(|v| v.rows).unwrap_or_default();
    let n = truth.rows.len();
    let sheet = TextTable::open(path, 1)?;
    let (visible, ignore) = (sheet.column("visible"), sheet.column("ignore"));
    let (time, aspect) = (sheet.column("t_s"), sheet.column("e_p"));
    truth.sizes = points.diameters_um.iter().map(|d_um| [*d_um, 1.0]).collect();
    truth.axes = if aspect.is_some() { points.axes } else { Vec::new() };
    let properties: Vec<(&'static str, usize)> =
        PROPERTIES.iter().filter_map(|&name| sheet.column(name).map(|c| (name, c))).collect();
    truth.visible = vec![true; n];
    truth.properties = properties.iter().map(|&(name, _)| (name, Vec::with_capacity(n))).collect();
    let mut row = 0;
    if [visible, ignore, time, aspect].iter().any(Option::is_some) || !properties.is_empty() {
        sheet.rows(|cells| {
            truth.visible[row] = cells.number_or_nan(visible)? != 0.0 && cells.number_or_nan(ignore)? != 1.0;
            if cells.number_or_nan(aspect)? == 1.0 && row < truth.axes.len() {
                truth.axes[row] = [f64::NAN; 3];
            }
            if let Some(time) = time {
                truth.times_s.insert(truth.rows[row].frame, cells.number(time)?);
            }
            for (values, &(_, column)) in truth.properties.iter_mut().zip(&properties) {
                values.1.push(property(values.0, cells.number(column)?)?);
            }
            row += 1;
            Ok(())
        })?;
    }
    truth.without_spheres();
    Ok(truth)
}

/// Whether two times are equal up to rounding errors.
pub(super) fn same_time(a: f64, b: f64) -> bool {
    (a - b).abs() <= 1e-6 * a.abs().max(b.abs())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::results::Position;

    fn row(frame: u32, track: i64, x_px: f64) -> TrackRow {
        TrackRow { frame, track, at: Position { x_px, y_px: 10.0, z_um: 0.0 } }
    }

    #[test]
    fn a_particle_that_leaves_and_comes_back_is_two_tracks_in_truth_and_result() {
        let rows: Vec<TrackRow> = (0..6).map(|f| row(f, 4, f64::from(f))).collect();
        let truth = TrueParticles {
            visible: vec![true, true, false, false, true, true],
            rows: rows.clone(),
            ..TrueParticles::default()
        };
        let result = Points { rows, ..Points::default() };
        let scored = truth.scored(&result, &Gate::radial(2.0), true, Region::default()).unwrap();
        assert_eq!((scored.truth.len(), scored.truth.n_tracks(), scored.ignored_truth), (4, 2, 2));
        assert_eq!((scored.result.len(), scored.result.n_tracks(), scored.ignored_result), (4, 2, 2));
    }

    #[test]
    fn a_border_begins_at_the_edge_of_the_first_pixel() {
        let scored = |x_px: f64, border_px: f64| {
            let facts = RecordingFacts { sensor_px: Some((20.0, 20.0)), ..RecordingFacts::default() };
            let (rows, visible) = (vec![row(0, 0, x_px)], vec![true]);
            TrueParticles { facts, rows, visible, ..TrueParticles::default() }.is_scored(0, border_px)
        };
        assert!(scored(4.5, 4.0) && !scored(4.4, 4.0));
        assert!(scored(16.4, 4.0) && !scored(16.5, 4.0));
    }

    #[test]
    fn ghosts_outside_the_scored_depths_are_left_out_if_there_are_particles() {
        let at =
            |x_px: f64, z_um: f64| TrackRow { at: Position { x_px, y_px: 10.0, z_um }, ..row(0, -1, x_px) };
        let of = |depths: [f64; 2], given: Option<(f64, f64)>| {
            let truth = TrueParticles {
                facts: RecordingFacts { depth_um: given.or(Some((0.0, 30.0))), ..RecordingFacts::default() },
                has_z: true,
                visible: vec![true; 2],
                rows: vec![at(10.0, depths[0]), at(50.0, depths[1])],
                ..TrueParticles::default()
            };
            // A match, a ghost within 0 to 10 um, and one at 20 um.
            let rows = vec![at(10.0, 5.0), at(90.0, 5.0), at(30.0, 20.0)];
            let region = Region { border_px: 0.0, depth_um: given };
            let gate = Gate::radial(2.0);
            truth.scored(&Points { rows, ..Points::default() }, &gate, false, region).unwrap().result.len()
        };
        assert_eq!(of([5.0, 25.0], Some((0.0, 10.0))), 2);
        assert_eq!(of([5.0, 25.0], None), 3);
        // The range of a measurement without particles elsewhere.
        assert_eq!(of([5.0, 8.0], Some((0.0, 10.0))), 3);
    }

    #[test]
    fn links_of_pair_recordings_stay_within_pairs() {
        let rows: Vec<TrackRow> = (0..4).map(|f| row(f, 1, 5.0)).collect();
        let truth = TrueParticles {
            facts: RecordingFacts { pairs: true, ..RecordingFacts::default() },
            visible: vec![true; 4],
            rows: rows.clone(),
            ..TrueParticles::default()
        };
        let scored = truth
            .scored(&Points { rows, ..Points::default() }, &Gate::radial(2.0), true, Region::default())
            .unwrap();
        assert_eq!(scored.truth.links().count(), 2);
    }
}
