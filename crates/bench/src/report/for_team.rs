//! What participants may see of the scores of a withheld truth.
//!
//! The error of a single particle, with the position that was submitted for it, is its true position: results
//! of one row per frame would reveal the truth by the biases of frames. So participants get averages over
//! many particles only, with three digits.

use std::path::Path;

use serde_json::{Number, Value};

use super::files::SCORE;
use super::{REPORT, page};
use scoring::evaluate::curves::Bin;
use scoring::evaluate::gdpt::DepthNode;
use scoring::evaluate::{Evaluation, Score};
use storage::error::{Error, Result};
use storage::save_bytes;

/// Name of the folder.
pub(super) const FOLDER: &str = "for_team";

/// Fewest particles or vectors over which errors are averaged.
const FEWEST: usize = 20;

/// Digits of numbers.
const DIGITS: i32 = 3;

/// Writes `score.json`, and `report.html` if asked for, into the folder `for_team`; returns their names.
pub(super) fn write(folder: &Path, evaluation: &Evaluation, html: bool) -> Result<Vec<String>> {
    let folder = folder.join(FOLDER);
    std::fs::create_dir(&folder).map_err(Error::write(&folder))?;
    let has_enough = averaged(evaluation) >= FEWEST;
    let score =
        if has_enough { with_full_bins(&evaluation.score) } else { without_scores(&evaluation.score) };
    let mut names = vec![SCORE];
    let value = serde_json::to_value(&score).map_err(|e| Error::input(e.to_string()))?;
    let text = serde_json::to_string_pretty(&rounded(value)).map_err(|e| Error::input(e.to_string()))?;
    save_bytes(&folder.join(SCORE), (text + "\n").as_bytes())?;
    if html && has_enough {
        let evaluation = Evaluation { score, ..evaluation.clone() };
        save_bytes(&folder.join(REPORT), page::page(&evaluation, false)?.as_bytes())?;
        names.push(REPORT);
    }
    Ok(names.into_iter().map(|name| format!("{FOLDER}/{name}")).collect())
}

/// Number of particles or vectors over which the errors of all are averaged.
fn averaged(evaluation: &Evaluation) -> usize {
    evaluation.score.detection.as_ref().map_or(evaluation.vectors.len(), |detection| detection.tp)
}

/// The score without errors of bins that average over few particles.
fn with_full_bins(score: &Score) -> Score {
    let mut score = score.clone();
    for bin in score.curves.iter_mut().flat_map(|curve| &mut curve.bins) {
        if bin.tp < FEWEST {
            let Bin { from, to, n_true, tp, recall, .. } = *bin;
            *bin = Bin { from, to, n_true, tp, recall, ..Bin::default() };
        }
    }
    for node in score.gdpt.iter_mut().flat_map(|gdpt| &mut gdpt.curve) {
        if node.tp < FEWEST {
            let DepthNode { z_over_h, n_true, tp, recall, precision, .. } = *node;
            *node = DepthNode { z_over_h, n_true, tp, recall, precision, ..DepthNode::default() };
        }
    }
    score
}

/// What is told of a result with next to nothing in common with the truth.
fn without_scores(score: &Score) -> Score {
    let mut warnings = score.warnings.clone();
    warnings.push(format!("fewer than {FEWEST} particles or vectors could be compared: no scores are told"));
    Score {
        dataset: score.dataset.clone(),
        result: score.result.clone(),
        counts: score.counts.clone(),
        definitions: score.definitions.clone(),
        assumptions: score.assumptions.clone(),
        warnings,
        ..Score::default()
    }
}

/// All numbers that are not whole with few digits.
fn rounded(value: Value) -> Value {
    match value {
        Value::Number(number) if number.is_f64() => {
            let exact = number.as_f64().unwrap_or_default();
            let few = format!("{exact:.*e}", DIGITS as usize - 1).parse().ok();
            few.and_then(Number::from_f64).map_or(Value::Null, Value::Number)
        }
        Value::Array(values) => values.into_iter().map(rounded).collect(),
        Value::Object(fields) => fields.into_iter().map(|(key, value)| (key, rounded(value))).collect(),
        other => other,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use scoring::evaluate::curves::Curve;

    #[test]
    fn few_particles_and_many_digits_are_not_told() {
        let bin = |tp| Bin { tp, recall: Some(0.5), bias_x_px: Some(0.123_456), ..Bin::default() };
        let curve = Curve { against: "z_um".to_owned(), bins: vec![bin(FEWEST - 1), bin(FEWEST)] };
        let told = with_full_bins(&Score { curves: vec![curve], ..Score::default() });
        let bins = &told.curves[0].bins;
        assert_eq!(bins.iter().map(|b| b.bias_x_px).collect::<Vec<_>>(), [None, Some(0.123_456)]);
        assert_eq!(bins[0].recall, Some(0.5));
        let value = rounded(serde_json::to_value(&told).unwrap());
        assert_eq!(value["curves"][0]["bins"][1]["bias_x_px"], 0.123);
        assert_eq!(value["curves"][0]["bins"][1]["tp"], FEWEST);
        assert_eq!(
            rounded(serde_json::json!([-1234.56, 0.0, 7, null])),
            serde_json::json!([-1230.0, 0.0, 7, null])
        );
    }
}
