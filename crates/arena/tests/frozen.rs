//! Scores of small results, digit for digit: `frozen/scores/` beside this file. Each result has misses, ghosts, wrong
//! links, outliers, and points or vectors without values.
//!
//! After a change of scores on purpose, `UPDATE_FROZEN=1 cargo test --workspace --test frozen` writes the files
//! anew; their diff belongs to the change.

use std::path::{Path, PathBuf};

use arena::report::{self, Named};
use arena::suite::ScoreOptions;
use generator::runner::{GenerateOptions, SuiteOptions, SuiteSelection, generate, generate_suite};
use microsig_core::render::Context;
use scenario::Size;
use scoring::evaluate::gate::Shape;
use scoring::evaluate::{EvaluateOptions, Evaluation, Truth, Versions, evaluate, evaluate_files};
use scoring::results::{Conventions, Origin, read};
use serde_json::{Map, Value};
use storage::Progress;
use storage::dataset::{PlaneRow, RecordingFacts};

fn data() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/frozen")
}

/// A dataset generated from `frozen/NAME.ron`.
struct Dataset(tempfile::TempDir);

impl Dataset {
    fn new(name: &str) -> Self {
        let place = tempfile::tempdir().unwrap();
        let scenario =
            scenario::load(data().join(format!("{name}.ron")), &[], None, &Context::default()).unwrap();
        let out = place.path().join("dataset");
        let options = GenerateOptions { out, force: false, resume: false, progress: Progress::default() };
        generate(&scenario, &options).unwrap();
        Dataset(place)
    }

    fn path(&self) -> PathBuf {
        self.0.path().join("dataset")
    }

    fn evaluate(&self, result: &str, options: &EvaluateOptions) -> Evaluation {
        unversioned(evaluate_files(&self.path(), data().join(result), options).unwrap())
    }
}

/// Without the versions of the program, which change with every release.
fn unversioned(mut evaluation: Evaluation) -> Evaluation {
    evaluation.score.definitions.versions = Versions::default();
    evaluation
}

/// Compares a value with `frozen/scores/NAME`, or replaces that file.
fn is_json(name: &str, found: &Value) {
    let (file, found) = (data().join("scores").join(name), lines(found, "") + "\n");
    if std::env::var_os("UPDATE_FROZEN").is_some() {
        return std::fs::write(file, found).unwrap();
    }
    let frozen = std::fs::read_to_string(&file).unwrap_or_default();
    let differs = |(_, (a, b)): &(usize, (&str, &str))| a != b;
    let lines = (1..).zip(frozen.lines().zip(found.lines()));
    let first: Vec<_> = lines.filter(differs).take(5).collect();
    assert!(frozen == found, "{}: lines that differ (frozen, found): {first:#?}", file.display());
}

/// JSON with a line for each key and each row of a table.
fn lines(value: &Value, indent: &str) -> String {
    let is_row =
        |v: &Value| v.as_object().is_none_or(|row| !row.values().any(|v| v.is_array() || v.is_object()));
    let inner = format!("{indent}  ");
    let block = |[open, close]: [char; 2], items: Vec<String>| {
        format!("{open}\n{inner}{}\n{indent}{close}", items.join(&format!(",\n{inner}")))
    };
    let item = |v: &Value| if is_row(v) { v.to_string() } else { lines(v, &inner) };
    match value {
        Value::Array(items) if items.iter().any(|v| !v.is_number()) => {
            block(['[', ']'], items.iter().map(item).collect())
        }
        Value::Object(keys) if !keys.is_empty() => {
            let key = |(key, v): (&String, &Value)| format!("{key:?}: {}", lines(v, &inner));
            block(['{', '}'], keys.iter().map(key).collect())
        }
        flat => flat.to_string(),
    }
}

fn is_score(name: &str, evaluation: &Evaluation) {
    is_json(name, &serde_json::to_value(&evaluation.score).unwrap());
}

fn written(file: &Path) -> Value {
    serde_json::from_slice(&std::fs::read(file).unwrap()).unwrap()
}

/// The scores of files in several formats that depend on how a format is read.
fn are_formats(name: &str, dataset: &Dataset, files: &[(&str, &EvaluateOptions)], keys: &[&str]) {
    let of = |&(file, options): &(&str, &EvaluateOptions)| {
        let score = serde_json::to_value(dataset.evaluate(file, options).score).unwrap();
        let kept = keys.iter().map(|key| ((*key).to_owned(), score.pointer(key).unwrap().clone()));
        (file.to_owned(), Value::Object(kept.collect()))
    };
    let all: Map<String, Value> = files.iter().map(of).collect();
    is_json(name, &Value::Object(all));
}

/// Particles in three dimensions with tracks, velocities and claimed uncertainties; what a team may see of
/// them where the truth is withheld.
#[test]
fn tracks() {
    let dataset = Dataset::new("tracks");
    let options = EvaluateOptions { auto_offset: true, crlb: true, ..EvaluateOptions::default() };
    let evaluation = dataset.evaluate("tracks.csv", &options);
    is_score("tracks.json", &evaluation);

    // Of few particles the counts are published, and nothing else.
    for (name, border_px) in [("for_team.json", 0.0), ("for_team_few.json", 22.0)] {
        let options = EvaluateOptions { shape: Some(Shape::Box), border_px, ..EvaluateOptions::default() };
        let (mut truth, _) = Truth::read(&dataset.path(), false, &options).unwrap();
        truth.facts.is_from_key = true;
        let given = options.conventions.completed(&truth.facts);
        let result = read(data().join("tracks.csv"), &given).unwrap();
        let evaluation = unversioned(evaluate(&truth, &result, &options).unwrap());
        let out = dataset.0.path().join(name);
        report::write(&out, &evaluation, false, false).unwrap();
        is_json(name, &written(&out.join("for_team/score.json")));
    }
}

#[test]
fn formats_of_particles() {
    let plain = EvaluateOptions::default();
    let files = [
        "isbi.xml",
        "trackmate.xml",
        "trackmate_spots.csv",
        "napari.csv",
        "defocustracker.csv",
        "defocustracker.txt",
        "lpt.dat",
    ];
    are_formats(
        "formats.json",
        &Dataset::new("tracks"),
        &files.map(|file| (file, &plain)),
        &["/assumptions", "/warnings", "/counts", "/detection", "/links", "/isbi"],
    );
}

/// Pairs in the image plane, without a border of 8 px.
#[test]
fn pairs() {
    let options = EvaluateOptions { dims: Some(2), border_px: 8.0, ..EvaluateOptions::default() };
    is_score("pairs.json", &Dataset::new("pairs").evaluate("trackpy.csv", &options));
}

/// Spheroids; the corner of the first pixel is at (0, 0).
#[test]
fn spheroids() {
    let conventions = Conventions { origin: Some(Origin::Corner0), ..Conventions::default() };
    let options = EvaluateOptions { conventions, ..EvaluateOptions::default() };
    is_score("rods.json", &Dataset::new("rods").evaluate("rods.csv", &options));
}

#[test]
fn bursts_and_boxes() {
    let (dataset, plain) = (Dataset::new("bursts"), EvaluateOptions::default());
    is_score("bursts.json", &dataset.evaluate("bursts.csv", &plain));
    let boxes = [("boxes.json", &plain)];
    are_formats(
        "boxes.json",
        &dataset,
        &boxes,
        &["/assumptions", "/warnings", "/counts", "/detection", "/boxes"],
    );
}

/// A recording of planes of known height.
#[test]
fn planes() {
    let facts = RecordingFacts {
        name: "planes".to_owned(),
        um_per_px: Some(0.645),
        depth_um: Some((-20.0, 20.0)),
        sensor_px: Some((96.0, 64.0)),
        frames: Some(6),
        is_recording: true,
        ..RecordingFacts::default()
    };
    let planes = (0..6).map(|frame| PlaneRow { frame, z_um: -15.0 + 5.0 * f64::from(frame) }).collect();
    let truth = Truth { facts, planes: Some(planes), ..Truth::default() };
    let options = EvaluateOptions { border_px: 4.0, ..EvaluateOptions::default() };
    let given = options.conventions.completed(&truth.facts);
    let result = read(data().join("planes.csv"), &given).unwrap();
    is_score("planes.json", &unversioned(evaluate(&truth, &result, &options).unwrap()));
}

#[test]
fn fields() {
    let plain = EvaluateOptions::default();
    is_score("field.json", &Dataset::new("pairs").evaluate("field.csv", &plain));
    let conventions = Conventions { y_up: Some(true), height_px: Some(96.0), ..Conventions::default() };
    let y_up = EvaluateOptions { conventions, ..EvaluateOptions::default() };
    let files = [
        ("pivlab.txt", &y_up),
        ("openpiv.txt", &plain),
        ("davis.txt", &plain),
        ("tecplot.dat", &plain),
        ("dense.flo", &plain),
    ];
    let keys = [
        "/assumptions",
        "/warnings",
        "/counts/n_nan",
        "/field/n_total",
        "/field/n_reported",
        "/field/n_interpolated",
    ];
    let true_keys = [
        "/field/n_outside",
        "/field/nodes",
        "/field/u",
        "/field/v",
        "/field/aee_px",
        "/field/outlier_fraction",
    ];
    are_formats("field_formats.json", &Dataset::new("pair"), &files, &[&keys[..], &true_keys].concat());
}

/// A leaderboard of two cases: an honest tracker, one with a missing case, one with a file that is refused.
#[test]
fn suite() {
    let place = tempfile::tempdir().unwrap();
    let suite = scenario::Suite::open(data().join("suite.ron")).unwrap();
    let datasets = place.path().join("datasets");
    let options = SuiteOptions {
        out: datasets.clone(),
        force: false,
        resume: false,
        progress: Progress::default(),
        context: Context::default(),
    };
    let chosen = SuiteSelection { split: Some(scenario::Split::Test), ..SuiteSelection::default() };
    generate_suite(&suite, Size::Smoke, &chosen, &options).unwrap();
    let results = place.path().join("results");
    for (tracker, case, file) in [
        ("good", "tracks", "suite_good.csv"),
        ("good", "pairs", "suite_pairs.csv"),
        ("fair", "tracks", "suite_fair.csv"),
        ("broken", "tracks", "suite_good.csv"),
        ("broken", "pairs", "pivlab.txt"),
    ] {
        let folder = results.join(tracker).join("T").join(case);
        std::fs::create_dir_all(&folder).unwrap();
        std::fs::copy(data().join(file), folder.join("results.csv")).unwrap();
    }
    let out = place.path().join("scores");
    let options = ScoreOptions {
        results: vec![results],
        against: None,
        late: false,
        out: out.clone(),
        site: None,
        force: false,
        selection: SuiteSelection::default(),
        seed: 0,
    };
    arena::suite::score(&suite, &datasets, &options).unwrap();
    let mut scores = written(&out.join("suite_scores.json"));
    scores.as_object_mut().unwrap().remove("microsig");
    is_json("suite_scores.json", &scores);
}

#[test]
fn scores_at_different_gates_are_not_compared_silently() {
    let dataset = Dataset::new("tracks");
    let of = |gate_xy_px| {
        let options = EvaluateOptions { gate_xy_px, ..EvaluateOptions::default() };
        let evaluation = dataset.evaluate("napari.csv", &options);
        Named {
            name: format!("{gate_xy_px:?}"),
            tracker: format!("{gate_xy_px:?}"),
            score: evaluation.score,
            units: None,
        }
    };
    let is_warned =
        |scores| report::ranking(scores).unwrap().warnings.iter().any(|w| w.contains("different gates:"));
    assert!(is_warned(vec![of(None), of(Some(1.5))]));
    assert!(!is_warned(vec![of(None), of(None)]));
}
