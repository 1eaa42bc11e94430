//! A `score.json` as `compare` reads it: whatever does not look like a score is refused by its key.

use std::path::Path;

use serde_json::Value;

use super::SCORE;
use crate::error::{Error, Result};

/// Rates: from 0 to 1.
const RATES: [&str; 9] = [
    "detection.f1",
    "detection.recall",
    "detection.precision",
    "links.f1",
    "hota.hota",
    "isbi.alpha",
    "isbi.beta",
    "isbi.jsc",
    "isbi.jsc_theta",
];
/// Rates of fields.
const RATES_OF_FIELDS: [&str; 1] = ["field.valid_vector_probability"];
/// Errors: from 0 on.
const ERRORS: [&str; 5] = [
    "detection.rmse_xy_px",
    "gdpt.sigma_z_over_h",
    "field.aee_px",
    "field.u_inliers.rms_px",
    "field.v_inliers.rms_px",
];
/// Intervals of rates and of errors.
const INTERVALS: [(&str, f64); 9] = [
    ("detection.interval.f1", 1.0),
    ("links.interval_f1", 1.0),
    ("hota.interval_hota", 1.0),
    ("field.interval_valid_vector_probability", 1.0),
    ("detection.interval.rmse_xy_px", f64::INFINITY),
    ("gdpt.interval.sigma_z_over_h", f64::INFINITY),
    ("field.interval_aee_px", f64::INFINITY),
    ("field.interval_rms_u_inliers_px", f64::INFINITY),
    ("field.interval_rms_v_inliers_px", f64::INFINITY),
];

/// The value at a key's path; null if it is not there.
pub(super) fn at<'a>(score: &'a Value, key: &str) -> &'a Value {
    key.split('.').fold(score, |value, step| &value[step])
}

/// Reads a score, or that in a folder.
///
/// # Errors
/// A file that is none, with all that is wrong in it.
pub(super) fn read(path: &Path) -> Result<Value> {
    let file = if path.is_dir() { path.join(SCORE) } else { path.to_owned() };
    let text = std::fs::read_to_string(&file).map_err(|e| Error::read(&file, e))?;
    let score: Value =
        serde_json::from_str(&text).map_err(|e| Error::input(format!("{}: {e}", file.display())))?;
    let problems: Vec<String> =
        problems(&score).into_iter().map(|problem| format!("{}: {problem}", file.display())).collect();
    if problems.is_empty() { Ok(score) } else { Err(Error::Input(problems)) }
}

fn problems(score: &Value) -> Vec<String> {
    let version = "definitions.versions.microsig";
    if !at(score, version).is_string() {
        return vec![format!("{version} is missing: no score of microsig evaluate")];
    }
    if !score["detection"].is_object() && !score["field"].is_object() {
        return vec!["neither detection nor field: no score of microsig evaluate".to_owned()];
    }
    let mut problems = Vec::new();
    let rates = RATES.iter().chain(&RATES_OF_FIELDS).map(|key| (key, 1.0));
    for (key, most) in rates.chain(ERRORS.iter().map(|key| (key, f64::INFINITY))) {
        let value = at(score, key);
        if !value.is_null() && !value.as_f64().is_some_and(|v| (0.0..=most).contains(&v)) {
            problems.push(format!("{key} = {value}: expected {}, or null", range(most)));
        }
    }
    for (key, most) in INTERVALS {
        let value = at(score, key);
        let ends = value[0].as_f64().zip(value[1].as_f64());
        let fits = ends.is_some_and(|(low, high)| 0.0 <= low && low <= high && high <= most);
        if !value.is_null() && !fits {
            problems.push(format!("{key} = {value}: expected [low, high], {}, or null", range(most)));
        }
    }
    problems
}

fn range(most: f64) -> &'static str {
    if most == 1.0 { "from 0 to 1" } else { "a number >= 0" }
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    #[test]
    fn what_is_no_score_is_refused_by_its_key() {
        let score = |f1: Value, interval: Value| {
            json!({ "definitions": { "versions": { "microsig": "1" } },
                "detection": { "f1": f1, "interval": { "f1": interval } } })
        };
        assert_eq!(problems(&score(json!(0.5), json!([0.4, 0.6]))), Vec::<String>::new());
        assert_eq!(problems(&score(Value::Null, Value::Null)), Vec::<String>::new());
        for (score, expected) in [
            (score(json!(2), Value::Null), "detection.f1 = 2: expected from 0 to 1, or null"),
            (score(json!("0.5"), Value::Null), "detection.f1 = \"0.5\": expected"),
            (score(json!(0.5), json!([0.6, 0.4])), "detection.interval.f1 = [0.6,0.4]: expected [low, high]"),
            (json!({ "detection": { "f1": 1 } }), "definitions.versions.microsig is missing"),
            (json!({ "definitions": { "versions": { "microsig": "1" } } }), "neither detection nor field"),
        ] {
            let found = problems(&score);
            assert!(found.len() == 1 && found[0].starts_with(expected), "{expected}: {found:?}");
        }
    }
}
