//! `suite score --anchors`: degenerate results, which must not rank ahead of a genuine measurement.
//!
//! Each is made from the truth of a case and is the best possible result of its kind: a result that avoids
//! measuring must lose even then. Anchors made from the best tracker's result must not rank ahead of that
//! result; the others must rank behind every tracker.

use std::collections::BTreeSet;
use std::path::Path;

use serde::{Deserialize, Serialize};

use super::{CaseResult, Status};
use dataset::manifest::ScoringGates;
use scenario::{Metric, Split, SuiteCase};
use scoring::evaluate::field::true_field;
use scoring::evaluate::matching::NONE;
use scoring::evaluate::truth::TrueParticles;
use scoring::evaluate::{EvaluateOptions, Evaluation, Truth, evaluate};
use scoring::ranking::{Contestant, rank, ranks_fields};
use scoring::results::{
    self, Conventions, Field, FlowVector, Points, Position, TrackRow, TrackerResult, Velocities, VelocityUnit,
};
use storage::error::Result;

/// Minimum number of tracks, or of squares of nodes, of a case in which anchors are judged.
const FEWEST_UNITS: usize = 10;

/// A degenerate result for a case.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct AnchorResult {
    /// Its scores; its rank is that among the trackers and itself.
    pub result: CaseResult,
    /// The tracker from whose result it is made.
    pub made_from: Option<String>,
    /// Trackers that should rank ahead of it but do not.
    pub not_behind: Vec<String>,
}

/// What an anchor is compared with.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Against {
    /// It must rank behind every tracker.
    All,
    /// It must rank behind the result from which it is made.
    Source,
    /// It must not rank ahead of the result from which it is made.
    NotBefore,
}

/// What anchors are made from.
struct Given<'a> {
    truth: TrueParticles,
    train: TrueParticles,
    /// Radius of the gate in the image plane, px.
    gate_px: f64,
    /// The best result and its particles.
    best: Option<(&'a Evaluation, Points)>,
}

/// Makes an anchor; `None` if it does not apply to the case.
type Make = fn(&Given<'_>) -> Option<Points>;

const OF_PARTICLES: [(&str, Against, Make); 15] = [
    ("empty", Against::All, |_| Some(Points { has_z: true, ..Points::default() })),
    ("one-row", Against::All, |given| {
        Some(of_rows(vec![TrackRow { track: -1, ..given.truth.rows[0] }], None))
    }),
    ("ghost-rows", Against::All, |given| {
        Some(of_rows(frames(&given.truth).into_iter().map(ghost).collect(), Some(AXIS)))
    }),
    ("decoys", Against::All, |given| Some(decoys(given, 0.0))),
    // Where particles are dense, a coarser grid has more hits than ghosts.
    ("decoys-1.4-gates", Against::All, |given| Some(decoys(given, 1.4))),
    ("decoys-2-gates", Against::All, |given| Some(decoys(given, 2.0))),
    ("decoys-3-gates", Against::All, |given| Some(decoys(given, 3.0))),
    ("constant-depth", Against::Source, constant_depth),
    ("cut-frames", Against::Source, cut_frames),
    ("cut-worst", Against::NotBefore, cut_worst),
    ("answers-around", Against::NotBefore, answers_around),
    ("one-velocity", Against::NotBefore, one_velocity),
    ("constant-claims", Against::NotBefore, constant_claims),
    ("wide-claims", Against::NotBefore, |given| claims_times(given, 1e3)),
    ("narrow-claims", Against::NotBefore, |given| claims_times(given, 1e-3)),
];

/// Rows with the same axis.
fn of_rows(rows: Vec<TrackRow>, axis: Option<[f64; 3]>) -> Points {
    Points {
        axes: axis.map_or(Vec::new(), |axis| vec![axis; rows.len()]),
        rows,
        has_z: true,
        ..Points::default()
    }
}

fn frames(truth: &TrueParticles) -> BTreeSet<u32> {
    truth.rows.iter().map(|row| row.frame).collect()
}

/// An axis along the optical axis.
const AXIS: [f64; 3] = [0.0, 0.0, 1.0];

/// A ghost in a corner of the image.
fn ghost(frame: u32) -> TrackRow {
    TrackRow { frame, track: -1, at: Position { x_px: 1.0, y_px: 1.0, z_um: 0.0 } }
}

/// The rows of a result for which `is_kept` is true.
fn kept(points: &Points, is_kept: impl Fn(usize, &TrackRow) -> bool) -> Points {
    let index: Vec<usize> = (0..points.rows.len()).filter(|i| is_kept(*i, &points.rows[*i])).collect();
    fn select<T: Copy>(of: &[T], index: &[usize]) -> Vec<T> {
        if of.is_empty() { Vec::new() } else { index.iter().map(|i| of[*i]).collect() }
    }
    let velocities = points.velocities.as_ref();
    Points {
        rows: select(&points.rows, &index),
        lines: Vec::new(),
        sigma: select(&points.sigma, &index),
        velocities: velocities.map(|of| Velocities { rows: select(&of.rows, &index), ..of.clone() }),
        boxes: select(&points.boxes, &index),
        axes: select(&points.axes, &index),
        ..points.clone()
    }
}

/// Maximum number of rows of a grid; results may have 100,000.
const DECOYS: usize = 90_000;

/// A hexagonal grid with a step of `gates` gate radii, at most as dense as results may be, all with the mean
/// axis of the truth.
fn decoys(given: &Given<'_>, gates: f64) -> Points {
    let truth = &given.truth;
    let frames = frames(truth);
    let (width, height) = truth.facts.sensor_px.unwrap_or((256.0, 256.0));
    let (low, high) = truth.facts.depth_um.unwrap_or((0.0, 0.0));
    let planes = if truth.has_z { 6 } else { 1 };
    let of_plane = (DECOYS / frames.len().max(1) / planes).max(1) as f64;
    // Area of a point of the grid: step² √3 / 2.
    let flat = 3_f64.sqrt() / 2.0;
    let densest = (width * height / of_plane / flat).sqrt();
    let step = densest.max(if gates > 0.0 { gates * given.gate_px } else { 2.0 });
    let (columns, rows) = ((width / step).floor() as usize, (height / step / flat).floor() as usize);
    let mut all = Vec::new();
    for &frame in &frames {
        for k in 0..planes {
            let z_um = low + (high - low) * (k as f64 + 0.5) / planes as f64;
            for (i, j) in (0..columns).flat_map(|i| (0..rows).map(move |j| (i, j))) {
                let x_px = 0.5 + step * (i as f64 + if j % 2 == 0 { 0.25 } else { 0.75 });
                let y_px = 0.5 + step * flat * (j as f64 + 0.5);
                all.push(TrackRow { frame, track: -1, at: Position { x_px, y_px, z_um } });
            }
        }
    }
    of_rows(all, Some(mean_axis(truth)))
}

/// Mean of true axes. Axes have no sign, so they are first flipped to the same side.
fn mean_axis(truth: &TrueParticles) -> [f64; 3] {
    let known = truth.axes.iter().filter(|axis| axis[0].is_finite());
    let sum = known.fold([0.0; 3], |sum: [f64; 3], axis| {
        let dot: f64 = sum.iter().zip(axis).map(|(a, b)| a * b).sum();
        std::array::from_fn(|k| sum[k] + axis[k] * if dot < 0.0 { -1.0 } else { 1.0 })
    });
    if sum == [0.0; 3] { [1.0, 0.0, 0.0] } else { sum }
}

fn mean(values: impl Iterator<Item = f64>) -> f64 {
    let (n, sum) = values.fold((0.0, 0.0), |(n, sum), v| (n + 1.0, sum + v));
    if n > 0.0 { sum / n } else { 0.0 }
}

/// The best result at the mean depth of train.
fn constant_depth(given: &Given<'_>) -> Option<Points> {
    let (_, points) = given.best.as_ref().filter(|(_, points)| points.has_z)?;
    let z_um = mean(given.train.rows.iter().map(|row| row.at.z_um));
    let flat = |row: &TrackRow| TrackRow { at: Position { z_um, ..row.at }, ..*row };
    Some(Points { rows: points.rows.iter().map(flat).collect(), ..points.clone() })
}

/// The best result without two of five frames or image pairs, each replaced by a ghost.
fn cut_frames(given: &Given<'_>) -> Option<Points> {
    let (_, points) = given.best.as_ref()?;
    let unit = |frame: u32| if given.truth.facts.pairs { frame / 2 } else { frame };
    let all: BTreeSet<u32> = frames(&given.truth).into_iter().map(unit).collect();
    let cut: BTreeSet<u32> = all.iter().copied().take((2 * all.len()).div_ceil(5)).collect();
    let left = kept(points, |_, row| !cut.contains(&unit(row.frame)));
    let ghosts = frames(&given.truth).into_iter().filter(|frame| cut.contains(&unit(*frame))).map(ghost);
    Some(with_rows(left, ghosts))
}

/// A result with more rows; what else it has is missing for these.
fn with_rows(mut points: Points, more: impl Iterator<Item = TrackRow>) -> Points {
    points.rows.extend(more);
    let n = points.rows.len();
    if !points.sigma.is_empty() {
        points.sigma.resize(n, [f64::NAN; 3]);
    }
    if let Some(velocities) = &mut points.velocities {
        velocities.rows.resize(n, [f64::NAN; 3]);
    }
    if !points.axes.is_empty() {
        points.axes.resize(n, AXIS);
    }
    points.boxes.clear();
    points
}

/// The best result with four more rows around each, so that their gates touch. Where few particles are found, this
/// raises F1.
fn answers_around(given: &Given<'_>) -> Option<Points> {
    let (_, points) = given.best.as_ref()?;
    let step = 1.4 * given.gate_px;
    let around = points.rows.iter().flat_map(|row| {
        [(step, 0.0), (0.0, step), (-step, 0.0), (0.0, -step)].map(|(dx, dy)| TrackRow {
            track: -1,
            at: Position { x_px: row.at.x_px + dx, y_px: row.at.y_px + dy, ..row.at },
            ..*row
        })
    });
    Some(with_rows(points.clone(), around))
}

/// The best result without the 10 % of its matches with the largest errors.
fn cut_worst(given: &Given<'_>) -> Option<Points> {
    let (best, points) = given.best.as_ref()?;
    let found = best.particles.as_ref()?;
    let gate = best.score.definitions.gate?;
    let (t, r) = (&found.scored.truth, &found.scored.result);
    let matched = r.points.iter().zip(&found.matching.of_result).filter(|(_, of)| **of != NONE);
    let mut errors: Vec<(f64, u32)> = matched
        .map(|(point, of)| (gate.squared(&t.points[*of as usize].at, &point.at), point.source))
        .collect();
    errors.sort_by(|a, b| b.0.total_cmp(&a.0));
    let worst: BTreeSet<u32> = errors.iter().take(errors.len() / 10).map(|(_, source)| *source).collect();
    Some(kept(points, |i, _| !worst.contains(&(i as u32))))
}

/// The best result with these velocities, um/s.
fn with_velocities(points: &Points, rows: Vec<[f64; 3]>) -> Points {
    Points { velocities: Some(Velocities { unit: VelocityUnit::UmPerS, rows }), ..points.clone() }
}

/// The best result with a velocity in one row only: the first true one.
fn one_velocity(given: &Given<'_>) -> Option<Points> {
    let (_, points) = given.best.as_ref()?;
    let mut rows = vec![[f64::NAN; 3]; points.rows.len()];
    *rows.first_mut()? = *given.truth.velocity_um_s.first()?;
    Some(with_velocities(points, rows))
}

/// The best result with the mean velocity and the mean axis of train in all rows.
fn constant_claims(given: &Given<'_>) -> Option<Points> {
    let (_, points) = given.best.as_ref()?;
    let velocity = [0, 1, 2].map(|k| mean(given.train.velocity_um_s.iter().map(|v| v[k])));
    let n = points.rows.len();
    let mut claimed = with_velocities(points, vec![velocity; n]);
    if !given.train.axes.is_empty() {
        claimed.axes = vec![mean_axis(&given.train); n];
    }
    Some(claimed)
}

/// The best result with all claimed uncertainties multiplied by a factor.
fn claims_times(given: &Given<'_>, factor: f64) -> Option<Points> {
    let (_, points) = given.best.as_ref().filter(|(_, points)| !points.sigma.is_empty())?;
    let sigma = points.sigma.iter().map(|of| of.map(|u| factor * u)).collect();
    Some(Points { sigma, ..points.clone() })
}

/// The anchors of fields: name, what each is compared with, rows.
fn of_fields(test: &Path, train: &Path, best: Option<&Field>) -> Result<Vec<(&'static str, Against, Field)>> {
    let truths = true_field::of_dataset(test, None)?;
    let Some((_, truth)) = truths.fields.first() else { return Ok(Vec::new()) };
    let (width, height) = truths.facts.sensor_px.unwrap_or((256.0, 256.0));
    let pairs: Vec<u32> =
        (0..truths.facts.frames.unwrap_or(0)).filter(|pair| truths.facts.has_pair(*pair)).collect();
    let mean_of = |truth: &true_field::TrueField| {
        let (columns, rows) = truth.nodes();
        let nodes = || {
            rows.iter()
                .flat_map(|y| columns.iter().filter_map(|x| truth.of_pair(pairs.first().copied(), *x, *y)))
        };
        [0, 1].map(|k| mean(nodes().map(|d| d[k])))
    };
    let place = |k: u32| 4.5 + 8.0 * f64::from(k);
    let grid = |moved: &dyn Fn(f64, f64) -> Option<[f64; 2]>| -> Field {
        let places = || {
            (0..(height / 8.0) as u32)
                .flat_map(|j| (0..(width / 8.0) as u32).map(move |i| (place(i), place(j))))
        };
        let of = |pair: u32, (x_px, y_px): (f64, f64)| {
            let [dx, dy] = moved(x_px, y_px)?;
            let at = Position { x_px, y_px, z_um: 0.0 };
            let sigma = [f64::NAN; 2];
            Some(FlowVector { pair: Some(pair), at, moved: [dx, dy, f64::NAN], flag: 0, sigma })
        };
        let vectors = pairs.iter().flat_map(|pair| places().filter_map(move |at| of(*pair, at))).collect();
        Field { vectors, ..Field::default() }
    };
    let constant = mean_of(truth);
    let of_train = match true_field::of_dataset(train, None)?.fields.first() {
        Some((_, truth)) => mean_of(truth),
        None => constant,
    };
    let middle = (width / 2.0, height / 2.0);
    let single = truth.of_pair(pairs.first().copied(), middle.0, middle.1).map_or(constant, |d| [d[0], d[1]]);
    let is_first = |x: f64, y: f64| x < 8.0 && y < 8.0;
    let mut all = vec![
        ("empty", Against::All, Field::default()),
        ("zeros", Against::All, grid(&|_, _| Some([0.0; 2]))),
        ("constant", Against::All, grid(&|_, _| Some(constant))),
        ("mean-of-train", Against::All, grid(&|_, _| Some(of_train))),
        // The displacement in the middle of the image, everywhere.
        ("one-for-all", Against::All, grid(&|_, _| Some(single))),
        ("one-vector", Against::All, grid(&|x, y| is_first(x, y).then_some(single))),
    ];
    let cut: BTreeSet<u32> = pairs.iter().copied().take((2 * pairs.len()).div_ceil(5)).collect();
    let is_named =
        |field: &&Field| pairs.len() > 1 && field.vectors.iter().all(|vector| vector.pair.is_some());
    if let Some(field) = best.filter(is_named) {
        let is_kept = |vector: &&FlowVector| vector.pair.is_some_and(|pair| !cut.contains(&pair));
        let vectors = field.vectors.iter().filter(is_kept).copied().collect();
        all.push(("cut-pairs", Against::Source, Field { vectors, ..Field::default() }));
    }
    Ok(all)
}

/// Evaluates the anchors of a case. `ranked` has the trackers that have scores, best first, with their
/// evaluations; `file_of` gives the file of a tracker's result.
///
/// # Errors
/// A truth that cannot be read; an I/O error.
pub(super) fn of_case(
    case: &SuiteCase,
    datasets: &Path,
    rules: &EvaluateOptions,
    ranked: &[(&CaseResult, &Evaluation)],
    file_of: &dyn Fn(&str) -> std::path::PathBuf,
) -> Result<Vec<AnchorResult>> {
    let (test, train) =
        (datasets.join(case.split_folder(Split::Test)), datasets.join(case.split_folder(Split::Train)));
    let train = if train.is_dir() { train } else { test.clone() };
    let is_of_fields = ranks_fields(&case.rank_by);
    let best = ranked.first().copied();
    // Results in other units than px are not spoiled.
    let found =
        best.and_then(|(best, _)| results::read(file_of(&best.tracker), &Conventions::default()).ok());
    let made: Vec<(&str, Against, TrackerResult)> = if is_of_fields {
        let best = match &found {
            Some(TrackerResult::Field(field)) => Some(field),
            _ => None,
        };
        let made = of_fields(&test, &train, best)?.into_iter();
        made.map(|(name, against, field)| (name, against, TrackerResult::Field(field))).collect()
    } else {
        let of = |path: &Path| TrueParticles::read(path, &Conventions::default());
        let best = match found {
            Some(TrackerResult::Points(points)) => best.map(|(_, evaluation)| (evaluation, points)),
            _ => None,
        };
        let gate_px = rules.gate_xy_px.unwrap_or(ScoringGates::XY_PX);
        let given = Given { truth: of(&test)?, train: of(&train)?, gate_px, best };
        let made = OF_PARTICLES.iter().filter_map(|(name, against, make)| {
            Some((*name, *against, TrackerResult::Points(make(&given)?)))
        });
        made.collect()
    };
    let (truth, _) = Truth::read(&test, is_of_fields, rules)?;
    let of = |(name, against, result): (&str, Against, TrackerResult)| {
        let evaluation = evaluate(&truth, &result, rules);
        against_trackers(case, name, against, evaluation, (ranked, rules.seed))
    };
    Ok(made.into_iter().map(of).collect())
}

fn against_trackers(
    case: &SuiteCase,
    name: &str,
    against: Against,
    evaluation: Result<Evaluation>,
    (ranked, seed): (&[(&CaseResult, &Evaluation)], u64),
) -> AnchorResult {
    let evaluation = evaluation.map(Some).map_err(|e| e.to_string());
    let result = super::result(case, name.to_owned(), &evaluation);
    let made_from = ranked.first().filter(|_| against != Against::All).map(|best| best.0.tracker.clone());
    let (Status::Scored, Ok(Some(own))) = (result.status, &evaluation) else {
        return AnchorResult { result, made_from, not_behind: Vec::new() };
    };
    let all = ranked.iter().map(|(_, evaluation)| *evaluation).chain([own]);
    let contestants: Vec<Contestant<'_>> =
        all.map(|of| Contestant { score: &of.score, units: Some(&of.units) }).collect();
    let mut ranks = vec![0; contestants.len()];
    rank(&contestants, &case.rank_by as &[Metric], seed).into_iter().for_each(|(i, rank)| ranks[i] = rank);
    let place = ranks[ranked.len()];
    // Too few tracks or nodes to separate results.
    let has_few = own.units.n_units() < FEWEST_UNITS;
    let is_ahead = |i: usize| match against {
        Against::All => ranks[i] >= place,
        Against::Source => i == 0 && ranks[i] >= place,
        Against::NotBefore => i == 0 && ranks[i] > place,
    };
    let not_behind =
        (0..ranked.len()).filter(|i| !has_few && is_ahead(*i)).map(|i| ranked[i].0.tracker.clone()).collect();
    AnchorResult { result: CaseResult { rank: Some(place), ..result }, made_from, not_behind }
}
