//! What participants may see of scores against a withheld truth: the scores that [`SCORES`] lists as published, rounded, and
//! a few counts. Nothing else is copied, so that a new score is withheld unless its entry in that list says otherwise.
//!
//! The error of a single particle, combined with its submitted position, reveals its true position. Published scores are
//! therefore averages over at least 20 particles (true tracks; for fields, squares of 32 px with reference nodes, in any
//! image pair: many rows for the same particle or node count once). They are rounded to three digits, and to a step that is
//! at least the change that one of them can cause: the gate divided by their number, or 1 divided by it for rates. With
//! all digits, two submissions that differ in one row would reveal its true position exactly. Scores of a field's own
//! vectors, errors of velocity and amplitude responses are not published: a single value of any size would be a weight that
//! tells its own error.
//!
//! Everything that is published passes through [`published`]: `for_team`, the scoring program of Codabench
//! (which passes on `for_team/score.json`), the leaderboards of `compare` and of suites.

use serde_json::{Map, Value, json};

use super::files::SCORE;
use super::{REPORT, page};
use scoring::evaluate::{Evaluation, Hint, Score};
use scoring::ranking::{Published, SCORES};
use storage::OutputFolder;
use storage::error::{Error, Result};

/// Name of the folder.
pub(super) const FOLDER: &str = "for_team";

/// Minimum number of particles or squares over which scores are averaged.
pub(crate) const FEWEST: usize = 20;

/// Number of significant digits.
const DIGITS: usize = 3;

/// The counts that are published: those that do not depend on which rows are matched, and missing frames.
const COUNTS: [&str; 6] = ["frames", "frames_missing", "n_truth", "n_nan", "n_unlinked", "tracks_truth"];

/// Writes `score.json` into the folder `for_team`; returns its name.
pub(super) fn write(folder: &OutputFolder, score: &Score) -> Result<String> {
    folder.subfolder(FOLDER)?.save_bytes(SCORE, super::json(&published(score)?)?)?;
    Ok(format!("{FOLDER}/{SCORE}"))
}

/// Names and contents of the files of an evaluation that may be published: `score.json` and, unless the truth is
/// withheld, `report.html` without true positions.
pub(crate) fn published_files(evaluation: &Evaluation) -> Result<Vec<(&'static str, String)>> {
    let mut files = vec![(SCORE, super::json(&published(&evaluation.score)?)?)];
    if !evaluation.score.truth_is_secret {
        files.push((REPORT, page::page(evaluation, false)?));
    }
    Ok(files)
}

/// The publishable part of a score as JSON: all of it, unless the truth is withheld.
fn published(score: &Score) -> Result<Value> {
    let value = |score: &Score| serde_json::to_value(score).map_err(|e| Error::input(e.to_string()));
    if !score.truth_is_secret {
        return value(score);
    }
    // The rest of a hint quotes scores, also of a sample; a hint without a question is left out. Hints and warnings of a
    // field depend on its truth at single places.
    let hints = score.hints.iter().filter(|hint| !hint.question.is_empty() && score.field.is_none());
    let mut warnings: Vec<&str> =
        score.warnings.iter().filter(|_| score.field.is_none()).map(String::as_str).collect();
    let n = score.counts.units_found;
    let why =
        format!("fewer than {FEWEST} particles or squares of nodes could be compared: scores are withheld");
    if n < FEWEST {
        warnings.push(&why);
    }
    let counts = serde_json::to_value(&score.counts).map_err(|e| Error::input(e.to_string()))?;
    let counts: Map<String, Value> =
        COUNTS.iter().map(|key| ((*key).to_owned(), counts[*key].clone())).collect();
    let mut all = json!({
        "dataset": score.dataset,
        "result": score.result,
        "counts": counts,
        "definitions": score.definitions,
        "assumptions": score.assumptions,
        "hints": hints.map(|hint| Hint::new(hint.question.clone(), "")).collect::<Vec<_>>(),
        "warnings": warnings,
        "truth_is_secret": true,
    });
    for def in SCORES.iter().filter(|_| n >= FEWEST) {
        let (Some(kind), (Some(value), ends)) = (def.published, def.measured(score)) else { continue };
        let of = |value: f64| rounded(value, step(kind, score, value) / n as f64);
        let (group, name) = def.path.rsplit_once('.').unwrap_or_default();
        let group = group.split('.').fold(&mut all, |at, key| &mut at[key]);
        group[name] = json!(of(value));
        group[format!("interval_{name}")] = json!(ends.map(|ends| ends.map(of)));
    }
    Ok(all)
}

/// The publishable part of a score; all other scores are undefined.
pub(crate) fn redacted(score: &Score) -> Result<Score> {
    if !score.truth_is_secret {
        return Ok(score.clone());
    }
    serde_json::from_value(published(score)?).map_err(|e| Error::input(e.to_string()))
}

/// The largest change of a sum that a single particle or square of nodes can cause.
fn step(kind: Published, score: &Score, value: f64) -> f64 {
    let gate = score.definitions.gate.map_or((1.0, f64::INFINITY), |gate| (gate.xy_px, gate.z_um));
    match kind {
        Published::Rate => value.abs().max(1.0),
        Published::Px => gate.0,
        Published::Um if gate.1.is_finite() => gate.1,
        Published::Um => value.abs().max(1.0),
        Published::DepthShare => 0.1,
        Published::Degrees => 90.0,
    }
}

/// A number with three digits, rounded to a step of 1, 2 or 5 times a power of ten that is at least the given
/// one.
fn rounded(exact: f64, least: f64) -> f64 {
    let digits: f64 = format!("{exact:.*e}", DIGITS - 1).parse().unwrap_or(exact);
    if least <= 0.0 || !digits.is_finite() {
        return digits;
    }
    let power = least.log10().floor();
    let step = [1.0, 2.0, 5.0, 10.0].map(|k| k * 10f64.powf(power)).into_iter().find(|step| *step >= least);
    let step = step.unwrap_or(least);
    // Formatted, so that no digits beyond the step remain.
    let places = (-power).clamp(0.0, 300.0) as usize;
    format!("{:.places$}", (digits / step).round() * step).parse::<f64>().unwrap_or(digits) + 0.0
}

#[cfg(test)]
mod tests {
    use std::collections::{BTreeMap, BTreeSet};

    use scoring::evaluate::score_keys::score_keys;
    use scoring::evaluate::{EvaluateOptions, evaluate_files};

    use super::*;

    fn numbers(path: &str, value: &Value, found: &mut BTreeMap<String, f64>) {
        match value {
            Value::Number(number) => found.extend([(path.to_owned(), number.as_f64().unwrap())]),
            Value::Array(values) => values.iter().for_each(|value| numbers(path, value, found)),
            Value::Object(fields) => {
                for (key, value) in fields {
                    numbers(&format!("{path}.{key}"), value, found);
                }
            }
            _ => {}
        }
    }

    /// A score in which every key outside lists has a value, and `n` units are found.
    fn complete(n: usize) -> Score {
        let mut all = serde_json::to_value(Score::default()).unwrap();
        let single = score_keys().into_iter().filter(|key| {
            key.is_float && !key.path.contains(['[', '*']) && !key.path.starts_with("definitions")
        });
        for key in single {
            let is_interval = key.path.rsplit('.').next().unwrap().starts_with("interval_");
            let value =
                if is_interval { json!([0.123_456_789, 0.234_567_891]) } else { json!(0.198_765_432) };
            // Some are lists.
            for value in [json!([value.clone()]), value] {
                let mut with = all.clone();
                *key.path.split('.').fold(&mut with, |at, part| &mut at[part]) = value;
                if serde_json::from_value::<Score>(with.clone()).is_ok() {
                    all = with;
                }
            }
        }
        let mut score: Score = serde_json::from_value(all).unwrap();
        (score.truth_is_secret, score.counts.units_found) = (true, n);
        score
    }

    #[test]
    fn no_number_leaves_that_is_not_listed() {
        let mut exact = BTreeMap::new();
        let score = complete(400);
        numbers("", &serde_json::to_value(&score).unwrap(), &mut exact);
        assert!(exact.len() > 100, "{}", exact.len());
        let (mut left, mut listed) = (BTreeMap::new(), BTreeSet::new());
        numbers("", &published(&score).unwrap(), &mut left);
        for def in SCORES.iter().filter(|def| def.published.is_some()) {
            let (group, name) = def.path.rsplit_once('.').unwrap();
            listed.extend([format!(".{}", def.path), format!(".{group}.interval_{name}")]);
        }
        listed.extend(COUNTS.map(|count| format!(".counts.{count}")));
        for (path, value) in &left {
            assert!(listed.contains(path) || path.starts_with(".definitions."), "{path}");
            // At most one particle of 400 in 1: three decimals.
            let thousandths = value * 1e3;
            assert!(
                path.starts_with(".definitions.") || (thousandths - thousandths.round()).abs() < 1e-9,
                "{path} {value}"
            );
        }
        assert_eq!(left[".detection.f1"], 0.2);
        assert_eq!(redacted(&score).unwrap().detection.unwrap().jaccard, None);
        // Few particles: no score at all.
        let mut left = BTreeMap::new();
        numbers("", &published(&complete(19)).unwrap(), &mut left);
        assert!(
            left.keys().all(|path| path.starts_with(".definitions.") || path.starts_with(".counts.")),
            "{left:?}"
        );
    }

    /// Displacements at nodes 16 px apart.
    fn grid(of: impl Fn(f64, f64) -> [f64; 2]) -> String {
        let places = (0..32).flat_map(|j| (0..32).map(move |i| [i, j].map(|k| 8.5 + 16.0 * f64::from(k))));
        rows(places.map(|[x, y]| (x, y, of(x, y))))
    }

    fn rows(vectors: impl Iterator<Item = (f64, f64, [f64; 2])>) -> String {
        let row = |(x, y, [u, v]): (f64, f64, [f64; 2])| format!("0,{x},{y},{u},{v}\n");
        "pair,x_px,y_px,dx_px,dy_px\n".to_owned() + &vectors.map(row).collect::<String>()
    }

    /// What is published of a result for a withheld truth.
    fn told(truth: &str, result: &str) -> Option<Value> {
        let place = tempfile::tempdir().unwrap();
        let files = [("truth.csv", truth), ("result.csv", result)].map(|(name, text)| {
            let file = place.path().join(name);
            std::fs::write(&file, text).unwrap();
            file
        });
        let result = storage::InputFile::from(files[1].clone());
        let mut score = evaluate_files(&files[0], result, &EvaluateOptions::default()).ok()?.score;
        score.truth_is_secret = true;
        score.definitions.truth_sha256 = None;
        Some(published(&score).unwrap())
    }

    #[test]
    fn copies_of_a_vector_do_not_tell_its_truth() {
        let flow = |x: f64, y: f64| [1.3311 + 0.01 * x, -1.4784 + 0.01 * y];
        let (here, other) = (grid(flow), grid(|x, y| flow(x, y).map(|d| 0.9 * d)));
        for [x, y] in [[264.5, 264.5], [200.5, 296.5], [133.0, 77.0]] {
            for (step, moved) in [(0.0, 0.0), (1e-6, 0.0), (1e-6, 1e6), (0.03, 0.0)] {
                let copies = rows((0..1000).map(|k| (x + step * f64::from(k), y, [moved; 2])));
                let of_both = [&here, &other].map(|truth| told(truth, &copies));
                assert_eq!(of_both[0], of_both[1], "{x} {y} {step} {moved}");
                // Vectors at one place are refused.
                assert_eq!(of_both[0].is_some(), step > 0.0);
                let Some(told) = &of_both[0] else { continue };
                assert!(told["field"].is_null() && told["warnings"][0].is_string());
            }
        }
        // A complete field has scores at the nodes of the truth only. A huge vector among them would be a weight.
        let whole = |huge: f64| {
            told(&here, &grid(|x, y| if (x, y) == (264.5, 264.5) { [huge, 0.0] } else { [3.0, 0.0] }))
                .unwrap()
        };
        let all = whole(3.0);
        assert!(all["field"]["nodes"]["rms_px"].is_f64(), "{all:#}");
        let mut left = BTreeMap::new();
        numbers("", &all["field"], &mut left);
        assert!(left.keys().all(|path| path.starts_with(".nodes.")), "{left:?}");
        assert_eq!(all, whole(1e6));
    }

    #[test]
    fn hints_ask_without_scores() {
        let hint =
            Hint { f1: Some(0.91), ..Hint::new("origin mismatch?", "F1 would be 0.91 instead of 0.25") };
        let unasked = Hint { question: String::new(), ..hint.clone() };
        let warnings = vec!["fewer rows".to_owned()];
        let score = Score { hints: vec![hint, unasked], warnings, truth_is_secret: true, ..Score::default() };
        let asked = redacted(&score).unwrap();
        assert_eq!(asked.warnings[0], "fewer rows");
        assert_eq!(asked.hints, [Hint::new("origin mismatch?", "")]);
    }

    #[test]
    fn one_particle_changes_no_digit_for_certain() {
        for (exact, least, expected) in [
            (0.0, 0.1, 0.0),
            (0.26, 0.03, 0.25),
            (123.4, 30.0, 100.0),
            (-0.004, 0.01, 0.0),
            (5.0, 1e-9, 5.0),
            (0.012_345, 0.005, 0.01),
            (-1234.56, 3.1, -1230.0),
        ] {
            assert_eq!(rounded(exact, least), expected, "{exact} {least}");
        }
    }
}
