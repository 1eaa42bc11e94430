//! `suite score --anchors`: degenerate results, which must not rank ahead of a genuine measurement.
//!
//! Each is made from the truth of a case and is the best possible result of its kind: a result that avoids
//! measuring must lose even then. Anchors made from the best tracker's result must not rank ahead of that
//! result; the others must rank behind every tracker.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use serde::{Deserialize, Serialize};

use super::{CaseResult, Status};
use dataset::manifest::ScoringGates;
use scenario::{Metric, Split, SuiteCase};
use scoring::evaluate::field::true_field;
use scoring::evaluate::matching::NONE;
use scoring::evaluate::truth::TrueParticles;
use scoring::evaluate::{EvaluateOptions, Evaluation, evaluate_files};
use scoring::ranking::{Contestant, rank};
use scoring::results::Conventions;
use storage::TemporaryFolder;
use storage::error::{Error, Result};
use storage::{input, save_bytes};

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

/// A row of a result, by column.
type Row = BTreeMap<String, String>;

/// What anchors are made from.
struct Given<'a> {
    truth: TrueParticles,
    train: TrueParticles,
    /// Radius of the gate in the image plane, px.
    gate_px: f64,
    /// The best result and its rows.
    best: Option<(&'a Evaluation, Vec<Row>)>,
}

/// Makes the rows of an anchor; `None` if it does not apply to the case.
type Make = fn(&Given<'_>) -> Option<Vec<Row>>;

const OF_PARTICLES: [(&str, Against, Make); 12] = [
    ("empty", Against::All, |_| Some(Vec::new())),
    ("one-row", Against::All, |given| Some(vec![true_row(&given.truth, 0)])),
    ("ghost-rows", Against::All, |given| Some(frames(&given.truth).into_iter().map(ghost).collect())),
    ("decoys", Against::All, |given| Some(decoys(given, 0.0))),
    // Where particles are dense, a coarser grid has more hits than ghosts.
    ("decoys-1.4-gates", Against::All, |given| Some(decoys(given, 1.4))),
    ("decoys-2-gates", Against::All, |given| Some(decoys(given, 2.0))),
    ("decoys-3-gates", Against::All, |given| Some(decoys(given, 3.0))),
    ("constant-depth", Against::Source, constant_depth),
    ("cut-frames", Against::Source, cut_frames),
    ("cut-worst", Against::NotBefore, cut_worst),
    ("one-velocity", Against::NotBefore, one_velocity),
    ("constant-claims", Against::NotBefore, constant_claims),
];

fn row<const N: usize>(cells: [(&str, String); N]) -> Row {
    cells.into_iter().map(|(name, value)| (name.to_owned(), value)).collect()
}

fn frames(truth: &TrueParticles) -> BTreeSet<u32> {
    truth.rows.iter().map(|row| row.frame).collect()
}

/// A row of the truth as a result.
fn true_row(truth: &TrueParticles, i: usize) -> Row {
    let at = &truth.rows[i].at;
    let [x_px, y_px, z_um] = [at.x_px, at.y_px, at.z_um].map(|v| v.to_string());
    let frame = truth.rows[i].frame.to_string();
    row([("frame", frame), ("track", "-1".to_owned()), ("x_px", x_px), ("y_px", y_px), ("z_um", z_um)])
}

/// A ghost in a corner of the image, with an axis.
fn ghost(frame: u32) -> Row {
    let mut ghost: Row = ["x_px", "y_px"].map(|name| (name.to_owned(), "1".to_owned())).into();
    ghost.extend(row([("frame", frame.to_string()), ("track", "-1".to_owned()), ("z_um", "0".to_owned())]));
    ghost.extend(axis([0.0, 0.0, 1.0]));
    ghost
}

fn axis([x, y, z]: [f64; 3]) -> Row {
    row([("axis_x", x.to_string()), ("axis_y", y.to_string()), ("axis_z", z.to_string())])
}

/// Maximum number of rows of a grid; results may have 100,000.
const DECOYS: usize = 90_000;

/// A hexagonal grid with a step of `gates` gate radii, at most as dense as results may be, all with the mean
/// axis of the truth.
fn decoys(given: &Given<'_>, gates: f64) -> Vec<Row> {
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
    let mean = mean_axis(truth);
    let mut all = Vec::new();
    for &frame in &frames {
        for k in 0..planes {
            let z_um = low + (high - low) * (k as f64 + 0.5) / planes as f64;
            for (i, j) in (0..columns).flat_map(|i| (0..rows).map(move |j| (i, j))) {
                let x_px = 0.5 + step * (i as f64 + if j % 2 == 0 { 0.25 } else { 0.75 });
                let y_px = 0.5 + step * flat * (j as f64 + 0.5);
                let mut decoy = row([("frame", frame.to_string()), ("track", "-1".to_owned())]);
                decoy.extend(row([
                    ("x_px", x_px.to_string()),
                    ("y_px", y_px.to_string()),
                    ("z_um", z_um.to_string()),
                ]));
                decoy.extend(axis(mean));
                all.push(decoy);
            }
        }
    }
    all
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
fn constant_depth(given: &Given<'_>) -> Option<Vec<Row>> {
    let (_, rows) = given.best.as_ref()?;
    let z_um = mean(given.train.rows.iter().map(|row| row.at.z_um)).to_string();
    rows.iter().any(|row| row.contains_key("z_um")).then(|| {
        let flat = |row: &Row| row.clone().into_iter().chain([("z_um".to_owned(), z_um.clone())]).collect();
        rows.iter().map(flat).collect()
    })
}

/// The best result without two of five frames or image pairs, each replaced by a ghost.
fn cut_frames(given: &Given<'_>) -> Option<Vec<Row>> {
    let (_, rows) = given.best.as_ref()?;
    let unit = |frame: u32| if given.truth.facts.pairs { frame / 2 } else { frame };
    let all: BTreeSet<u32> = frames(&given.truth).into_iter().map(unit).collect();
    let cut: BTreeSet<u32> = all.iter().copied().take((2 * all.len()).div_ceil(5)).collect();
    let is_kept = |row: &&Row| row["frame"].parse().is_ok_and(|frame: u32| !cut.contains(&unit(frame)));
    let left_out = frames(&given.truth).into_iter().filter(|frame| cut.contains(&unit(*frame)));
    Some(rows.iter().filter(is_kept).cloned().chain(left_out.map(ghost)).collect())
}

/// The best result without the 10 % of its matches with the largest errors.
fn cut_worst(given: &Given<'_>) -> Option<Vec<Row>> {
    let (best, rows) = given.best.as_ref()?;
    let found = best.particles.as_ref()?;
    let gate = best.score.definitions.gate?;
    let (t, r) = (&found.scored.truth, &found.scored.result);
    let matched = r.points.iter().zip(&found.matching.of_result).filter(|(_, of)| **of != NONE);
    let mut errors: Vec<(f64, u32)> = matched
        .map(|(point, of)| (gate.squared(&t.points[*of as usize].at, &point.at), point.source))
        .collect();
    errors.sort_by(|a, b| b.0.total_cmp(&a.0));
    let worst: BTreeSet<u32> = errors.iter().take(errors.len() / 10).map(|(_, source)| *source).collect();
    // Rows without coordinates are dropped before they are numbered; microsig's own trackers have none.
    let kept = rows.iter().enumerate().filter(|(i, _)| !worst.contains(&(*i as u32)));
    Some(kept.map(|(_, row)| row.clone()).collect())
}

/// The best result with a velocity in one row only: the first true one.
fn one_velocity(given: &Given<'_>) -> Option<Vec<Row>> {
    let (_, rows) = given.best.as_ref()?;
    let claimed = given.truth.velocity_um_s.first()?;
    let claim = |i: usize, row: &Row| {
        let velocity = ["u_um_s", "v_um_s", "w_um_s"].iter().zip(claimed);
        let cells = velocity
            .map(|(name, v)| ((*name).to_owned(), if i == 0 { v.to_string() } else { String::new() }));
        row.clone().into_iter().chain(cells).collect()
    };
    Some(rows.iter().enumerate().map(|(i, row)| claim(i, row)).collect())
}

/// The best result with the mean velocity and the mean axis of train in all rows.
fn constant_claims(given: &Given<'_>) -> Option<Vec<Row>> {
    let (_, rows) = given.best.as_ref()?;
    let velocity = [0, 1, 2].map(|k| mean(given.train.velocity_um_s.iter().map(|v| v[k])));
    let mut cells: Row = ["u_um_s", "v_um_s", "w_um_s"]
        .map(str::to_owned)
        .into_iter()
        .zip(velocity.map(|v| v.to_string()))
        .collect();
    if !given.train.axes.is_empty() {
        cells.extend(axis(mean_axis(&given.train)));
    }
    Some(rows.iter().map(|row| row.clone().into_iter().chain(cells.clone()).collect()).collect())
}

/// The anchors of fields: name, what each is compared with, rows.
fn of_fields(
    test: &Path,
    train: &Path,
    best: Option<&Vec<Row>>,
) -> Result<Vec<(&'static str, Against, Vec<Row>)>> {
    let truths = true_field::of_dataset(test, None)?;
    let Some((_, truth)) = truths.named.first() else { return Ok(Vec::new()) };
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
    let grid = |moved: &dyn Fn(f64, f64) -> Option<[f64; 2]>| -> Vec<Row> {
        let places = || {
            (0..(height / 8.0) as u32)
                .flat_map(|j| (0..(width / 8.0) as u32).map(move |i| (place(i), place(j))))
        };
        let of = |pair: u32, (x, y): (f64, f64)| {
            let [dx, dy] = moved(x, y)?.map(|d| d.to_string());
            let mut vector =
                row([("pair", pair.to_string()), ("flag", "0".to_owned()), ("dx_px", dx), ("dy_px", dy)]);
            vector.extend(row([("x_px", x.to_string()), ("y_px", y.to_string())]));
            Some(vector)
        };
        pairs.iter().flat_map(|pair| places().filter_map(move |at| of(*pair, at))).collect()
    };
    let constant = mean_of(truth);
    let of_train = match true_field::of_dataset(train, None)?.named.first() {
        Some((_, truth)) => mean_of(truth),
        None => constant,
    };
    let middle = (width / 2.0, height / 2.0);
    let single = truth.of_pair(pairs.first().copied(), middle.0, middle.1).map_or(constant, |d| [d[0], d[1]]);
    let is_first = |x: f64, y: f64| x < 8.0 && y < 8.0;
    let mut all = vec![
        ("empty", Against::All, Vec::new()),
        ("zeros", Against::All, grid(&|_, _| Some([0.0; 2]))),
        ("constant", Against::All, grid(&|_, _| Some(constant))),
        ("mean-of-train", Against::All, grid(&|_, _| Some(of_train))),
        // The displacement in the middle of the image, everywhere.
        ("one-for-all", Against::All, grid(&|_, _| Some(single))),
        ("one-vector", Against::All, grid(&|x, y| is_first(x, y).then_some(single))),
    ];
    let cut: BTreeSet<String> =
        pairs.iter().take((2 * pairs.len()).div_ceil(5)).map(u32::to_string).collect();
    let named = best.filter(|rows| pairs.len() > 1 && rows.iter().all(|row| row.contains_key("pair")));
    if let Some(rows) = named {
        let kept = rows.iter().filter(|row| !cut.contains(&row["pair"])).cloned().collect();
        all.push(("cut-pairs", Against::Source, kept));
    }
    Ok(all)
}

/// The rows of a CSV file; `None` if it has another format or lacks this column.
fn read(path: &Path, needed: &str) -> Option<Vec<Row>> {
    let rows: Vec<Row> = csv::Reader::from_reader(input::open(path).ok()?)
        .into_deserialize()
        .collect::<std::result::Result<_, _>>()
        .ok()?;
    rows.iter().all(|row| row.contains_key(needed)).then_some(rows)
}

fn csv_of(rows: &[Row], is_of_fields: bool) -> Result<Vec<u8>> {
    let failed = |e: csv::Error| Error::input(e.to_string());
    let least: &[&str] = match is_of_fields {
        true => &["pair", "x_px", "y_px", "dx_px", "dy_px", "flag"],
        false => &["frame", "track", "x_px", "y_px"],
    };
    let mut names: BTreeSet<&str> = least.iter().copied().collect();
    names.extend(rows.iter().flat_map(|row| row.keys().map(String::as_str)));
    if rows.is_empty() && !is_of_fields {
        // Empty in depth as well.
        names.insert("z_um");
    }
    let mut table = csv::Writer::from_writer(Vec::new());
    table.write_record(&names).map_err(failed)?;
    for row in rows {
        table
            .write_record(names.iter().map(|name| row.get(*name).map_or("", String::as_str)))
            .map_err(failed)?;
    }
    table.into_inner().map_err(|e| failed(e.into_error().into()))
}

/// Evaluates the anchors of a case. `ranked` has the trackers that have scores, best first, with their
/// evaluations; `results` is the file of a tracker's result.
///
/// # Errors
/// A truth that cannot be read; an I/O error.
pub(super) fn of_case(
    case: &SuiteCase,
    datasets: &Path,
    rules: &EvaluateOptions,
    ranked: &[(&CaseResult, &Evaluation)],
    results: &dyn Fn(&str) -> std::path::PathBuf,
) -> Result<Vec<AnchorResult>> {
    let (test, train) =
        (datasets.join(case.split_folder(Split::Test)), datasets.join(case.split_folder(Split::Train)));
    let train = if train.is_dir() { train } else { test.clone() };
    let is_of_fields = case.rank_by.first().is_some_and(|metric| metric.is_of_fields());
    let best = ranked.first().copied();
    let rows =
        best.and_then(|(best, _)| read(&results(&best.tracker), if is_of_fields { "x_px" } else { "frame" }));
    let made: Vec<(&str, Against, Vec<Row>)> = if is_of_fields {
        of_fields(&test, &train, rows.as_ref())?
    } else {
        let of = |path: &Path| TrueParticles::read(path, &Conventions::default());
        let best = best.map(|(_, evaluation)| evaluation).zip(rows);
        let gate_px = rules.gate_xy_px.unwrap_or(ScoringGates::XY_PX);
        let given = Given { truth: of(&test)?, train: of(&train)?, gate_px, best };
        let made =
            OF_PARTICLES.iter().filter_map(|(name, against, make)| Some((*name, *against, make(&given)?)));
        made.collect()
    };
    let place = TemporaryFolder::new()?;
    let mut anchors = Vec::new();
    for (name, against, rows) in made {
        let file = place.path().join(format!("{name}.csv"));
        save_bytes(&file, &csv_of(&rows, is_of_fields)?)?;
        let evaluation = evaluate_files(&test, &file, rules);
        anchors.push(against_trackers(case, name, against, evaluation, (ranked, rules.seed)));
    }
    Ok(anchors)
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
