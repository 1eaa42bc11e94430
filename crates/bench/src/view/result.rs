//! A result on the page: the outcome of `evaluate` for every point.
//!
//! Scores and matching come from [`scoring::evaluate`] with the default options of `microsig evaluate`, so
//! the numbers on the page equal those in `score.json`.

use std::ops::Range;
use std::path::Path;

use serde_json::{Map, Value, json};

use super::columns::list;
use scoring::evaluate::candidates::Candidates;
use scoring::evaluate::clear::switches;
use scoring::evaluate::detection::error;
use scoring::evaluate::field::ComparedVector;
use scoring::evaluate::gate::Gate;
use scoring::evaluate::links::{correct_links, successors};
use scoring::evaluate::matching::NONE;
use scoring::evaluate::planes::PlanePoint;
use scoring::evaluate::track_set::TrackSet;
use scoring::evaluate::truth::TrueParticles;
use scoring::evaluate::{EvaluateOptions, Evaluation, Particles, Score, evaluate_files};
use scoring::results::{Conventions, Position};
use storage::error::Result;

/// Maximum number of points in a list.
const MAX_LIST: usize = 500;

#[derive(Debug)]
pub(super) struct OpenResult {
    pub(super) score: Score,
    /// All scored points, sorted by frame: found, missed and ghost particles.
    points: Vec<Point>,
    /// Number of the last frame with points, plus 1.
    frames: u32,
    /// The vectors of a field: pair (NaN: all), x and y (px), displacement and true displacement along x and
    /// y (px).
    vectors: Vec<[f64; 7]>,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum PointOutcome {
    Found,
    Missed,
    Ghost,
}

#[derive(Debug, Clone, Copy)]
struct Point {
    frame: u32,
    kind: PointOutcome,
    /// Row in the table of the truth ([`NONE`] for ghosts) and in the result ([`NONE`] for missed particles).
    truth_row: u32,
    result_row: u32,
    /// Position of a true particle or a ghost: px, px, um.
    at: [f64; 3],
    /// Position error (result - truth) of a found particle: px, px, um; NaN for others.
    error: [f64; 3],
    /// SNR and overlap of the true particle; NaN for ghosts.
    snr: f64,
    overlap: f64,
    /// Number of the result's track; [`NONE`] for missed particles.
    track: u32,
    /// Position (px) of the track's previous point, and whether the link from it is correct.
    from: Option<([f64; 2], bool)>,
    /// Whether CLEAR MOT counts an identity switch here.
    is_switch: bool,
}

/// Selection and order of the points in a list.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Filter {
    /// 0 found, 1 missed, 2 ghosts; `None`: all.
    pub(super) kind: Option<u32>,
    /// Sort key: 0 error in the image plane, 1 error in depth, 2 frame.
    pub(super) by: u32,
    /// Range of depth, um.
    pub(super) z_um: [f64; 2],
    /// Range of the signal-to-noise ratio.
    pub(super) snr: [f64; 2],
    /// Range of the overlap.
    pub(super) overlap: [f64; 2],
    /// Whether to select only identity switches.
    pub(super) switches: bool,
}

impl OpenResult {
    /// Scores a result as `microsig evaluate` does.
    pub(super) fn open(dataset: &Path, path: &Path) -> Result<Self> {
        let evaluation = evaluate_files(dataset, path, &EvaluateOptions::default())?;
        let (points, vectors) = match &evaluation.particles {
            Some(particles) => {
                let truth = TrueParticles::read(dataset, &Conventions::default())?;
                (points(&evaluation, particles, &truth)?, Vec::new())
            }
            None => (in_planes(&evaluation), vectors(&evaluation)),
        };
        let frames = points.last().map_or(0, |point| point.frame + 1);
        Ok(OpenResult { score: evaluation.score, points, frames, vectors })
    }

    /// Scores, whether points are linked, and the numbers of found, missed and ghost particles in each frame.
    pub(super) fn about(&self) -> Value {
        let mut counts = vec![[0u32; 3]; self.frames as usize];
        self.points.iter().for_each(|point| counts[point.frame as usize][point.kind as usize] += 1);
        let of = |k: usize| counts.iter().map(|counts| counts[k]).collect::<Vec<_>>();
        json!({ "score": self.score, "is_field": self.score.field.is_some(),
            "is_linked": self.points.iter().any(|point| point.from.is_some()),
            "tp": of(0), "fn": of(1), "fp": of(2) })
    }

    fn within(&self, frame: u32) -> Range<usize> {
        let first = self.points.partition_point(|point| point.frame < frame);
        let end = self.points.partition_point(|point| point.frame <= frame);
        first..end
    }

    /// The points of a frame by columns.
    pub(super) fn frame(&self, frame: u32) -> Value {
        Value::Object(columns(self.points[self.within(frame)].iter()))
    }

    /// The points selected by a filter, worst first, and their total number.
    pub(super) fn worst(&self, filter: &Filter) -> Value {
        let mut chosen: Vec<&Point> = self.points.iter().filter(|point| filter.admits(point)).collect();
        let size = |point: &Point| match filter.by {
            0 => point.error[0].hypot(point.error[1]),
            1 => point.error[2].abs(),
            _ => -f64::from(point.frame),
        };
        // Missed particles and ghosts have no error; they come first, in the order of frames.
        let rank = |point: &Point| match (filter.by, point.kind) {
            (2, _) | (_, PointOutcome::Found) => 0,
            (_, PointOutcome::Ghost) => 1,
            (_, PointOutcome::Missed) => 2,
        };
        let key = |point: &Point| if size(point).is_nan() { f64::NEG_INFINITY } else { size(point) };
        chosen.sort_by(|a, b| rank(b).cmp(&rank(a)).then_with(|| key(b).total_cmp(&key(a))));
        let of = chosen.len();
        json!({ "of": of, "columns": columns(chosen.into_iter().take(MAX_LIST)) })
    }

    /// The vectors of a field for an image pair by columns.
    pub(super) fn vectors(&self, pair: u32) -> Value {
        let is_of = |v: &&[f64; 7]| v[0].is_nan() || v[0] == f64::from(pair);
        let of: Vec<&[f64; 7]> = self.vectors.iter().filter(is_of).collect();
        let names = ["pair", "x_px", "y_px", "dx_px", "dy_px", "true_dx_px", "true_dy_px"];
        let column = |k: usize| list(of.iter().map(|v| v[k]));
        Value::Object(names.iter().enumerate().map(|(k, name)| ((*name).to_owned(), column(k))).collect())
    }
}

/// The points of a recording whose planes are known: found within the gate in depth, ghosts beyond it.
fn in_planes(evaluation: &Evaluation) -> Vec<Point> {
    let gate_um = evaluation.score.planes.as_ref().map_or(0.0, |planes| planes.gate_z_um);
    let point = |of: &PlanePoint| {
        let is_found = of.error_um.abs() < gate_um;
        let z_um = if is_found { of.height_um } else { of.height_um + of.error_um };
        Point {
            frame: of.frame,
            kind: if is_found { PointOutcome::Found } else { PointOutcome::Ghost },
            truth_row: NONE,
            result_row: NONE,
            at: [of.x_px, of.y_px, z_um],
            error: if is_found { [0.0, 0.0, of.error_um] } else { [f64::NAN; 3] },
            snr: f64::NAN,
            overlap: f64::NAN,
            track: NONE,
            from: None,
            is_switch: false,
        }
    };
    let mut points: Vec<Point> = evaluation.plane_points.iter().map(point).collect();
    points.sort_by_key(|point| point.frame);
    points
}

impl Filter {
    fn admits(&self, point: &Point) -> bool {
        // Ghosts have neither SNR nor overlap, so any bound on these excludes them.
        let within = |value: f64, [low, high]: [f64; 2]| {
            if value.is_nan() {
                low == f64::NEG_INFINITY && high == f64::INFINITY
            } else {
                (low..=high).contains(&value)
            }
        };
        self.kind.is_none_or(|kind| kind == point.kind as u32)
            && (!self.switches || point.is_switch)
            && within(point.at[2], self.z_um)
            && within(point.snr, self.snr)
            && within(point.overlap, self.overlap)
    }
}

fn points(evaluation: &Evaluation, particles: &Particles, truth: &TrueParticles) -> Result<Vec<Point>> {
    let (t, r, matching) = (&particles.scored.truth, &particles.scored.result, &particles.matching);
    let property = |name: &str, row: u32| {
        let values = truth.properties.iter().find(|(own, _)| *own == name);
        values.and_then(|(_, values)| values.get(row as usize)).copied().unwrap_or(f64::NAN)
    };
    let place = |at: &Position, has_z: bool| [at.x_px, at.y_px, if has_z { at.z_um } else { f64::NAN }];
    let next = successors(t);
    let mut is_right = vec![false; r.len()];
    correct_links(r, matching, &next).for_each(|(_, (_, to))| is_right[to] = true);
    let mut from = vec![None; r.len()];
    for (a, b) in r.links() {
        let at = &r.points[a as usize].at;
        from[b as usize] = Some(([at.x_px, at.y_px], is_right[b as usize]));
    }
    let mut is_switch = vec![false; r.len()];
    // Points that are not linked change no identity.
    if let Some(gate) = evaluation.score.definitions.gate.filter(|_| r.links().next().is_some()) {
        mark_switches((t, r), &gate, &mut is_switch)?;
    }
    let result_columns = |j: usize| (r.points[j].source, r.points[j].track, from[j], is_switch[j]);
    let mut points = Vec::with_capacity(t.len());
    for (i, p) in t.points.iter().enumerate() {
        let partner = (matching.result_for[i] != NONE).then_some(matching.result_for[i] as usize);
        let (result_row, track, from, is_switch) = partner.map_or((NONE, NONE, None, false), result_columns);
        let error = partner.map_or([f64::NAN; 3], |j| {
            let [x, y, z] = error(t, r, (i, j));
            [x, y, if particles.depth { z } else { f64::NAN }]
        });
        points.push(Point {
            frame: p.frame,
            kind: if partner.is_some() { PointOutcome::Found } else { PointOutcome::Missed },
            truth_row: p.source,
            result_row,
            // Particles have their depth even if they are scored in two dimensions.
            at: place(&truth.rows[p.source as usize].at, truth.has_z),
            error,
            snr: property("snr", p.source),
            overlap: property("overlap", p.source),
            track,
            from,
            is_switch,
        });
    }
    let ghosts = (0..r.len()).filter(|j| matching.truth_for[*j] == NONE);
    points.extend(ghosts.map(|j| {
        let (result_row, track, from, is_switch) = result_columns(j);
        Point {
            frame: r.points[j].frame,
            kind: PointOutcome::Ghost,
            truth_row: NONE,
            result_row,
            at: place(&r.points[j].at, particles.depth),
            error: [f64::NAN; 3],
            snr: f64::NAN,
            overlap: f64::NAN,
            track,
            from,
            is_switch,
        }
    }));
    points.sort_by_key(|point| point.frame);
    Ok(points)
}

/// Marks the points of a result where CLEAR MOT counts an identity switch.
fn mark_switches((truth, result): (&TrackSet, &TrackSet), gate: &Gate, marks: &mut [bool]) -> Result<()> {
    let candidates = Candidates::new(truth, result, gate)?;
    switches(truth, result, &candidates).into_iter().for_each(|point| marks[point as usize] = true);
    Ok(())
}

fn vectors(evaluation: &Evaluation) -> Vec<[f64; 7]> {
    let pair = |pair: Option<u32>| pair.map_or(f64::NAN, f64::from);
    let of = |v: &ComparedVector| {
        let (at, moved) = (&v.measured.at, &v.measured.moved);
        [pair(v.measured.pair), at.x_px, at.y_px, moved[0], moved[1], v.truth[0], v.truth[1]]
    };
    evaluation.vectors.iter().map(of).collect()
}

/// Points as one list per column.
fn columns<'a>(points: impl Iterator<Item = &'a Point>) -> Map<String, Value> {
    let points: Vec<&Point> = points.collect();
    let column = |of: &dyn Fn(&Point) -> f64| list(points.iter().map(|point| of(point)));
    let row = |row: u32| if row == NONE { f64::NAN } else { f64::from(row) };
    let from = |point: &Point, k: usize| point.from.map_or(f64::NAN, |(at, _)| at[k]);
    let columns: [(&str, Value); 17] = [
        ("frame", column(&|p| f64::from(p.frame))),
        ("kind", column(&|p| f64::from(p.kind as u8))),
        ("truth_row", column(&|p| row(p.truth_row))),
        ("result_row", column(&|p| row(p.result_row))),
        ("x_px", column(&|p| p.at[0])),
        ("y_px", column(&|p| p.at[1])),
        ("z_um", column(&|p| p.at[2])),
        ("dx_px", column(&|p| p.error[0])),
        ("dy_px", column(&|p| p.error[1])),
        ("dz_um", column(&|p| p.error[2])),
        ("snr", column(&|p| p.snr)),
        ("overlap", column(&|p| p.overlap)),
        ("track", column(&|p| row(p.track))),
        ("from_x_px", column(&|p| from(p, 0))),
        ("from_y_px", column(&|p| from(p, 1))),
        ("is_right", column(&|p| p.from.map_or(f64::NAN, |(_, right)| f64::from(u8::from(right))))),
        ("is_switch", column(&|p| f64::from(u8::from(p.is_switch)))),
    ];
    columns.into_iter().map(|(name, values)| (name.to_owned(), values)).collect()
}
