//! Reads and validates `score.json` for `compare`; errors name the offending key.

use std::path::Path;

use serde_json::Value;

use super::files::{SCORE, UNITS};
use scoring::evaluate::score_keys::beyond_ranges;
use scoring::evaluate::{Score, UnitScores};
use storage::error::{Error, Result};
use storage::json::mistyped;
use storage::{InputFile, input};

/// Largest score file accepted, bytes; the largest known one is less than a tenth of this.
const LARGEST: u64 = 64 << 20;

/// Largest file of units accepted, bytes: enough for ten million particles.
const LARGEST_UNITS: u64 = 1 << 30;

/// Reads a score file, or the one in a folder.
/// Errors: a file that is not a score, with every problem in it.
pub(super) fn read(path: &InputFile) -> Result<Score> {
    let file: InputFile = if path.is_dir() { path.join(SCORE).into() } else { path.clone() };
    if path.is_dir() && !file.exists() {
        let what =
            format!("has no {SCORE}; expected the folder of `microsig evaluate --out`, or its {SCORE}");
        return Err(Error::input(format!("{}: {what}", path.display())));
    }
    let text = input::text_of(&file, file.open()?, LARGEST)?;
    parse(&text).map_err(|problems| {
        Error::Input(problems.into_iter().map(|problem| format!("{}: {problem}", file.display())).collect())
    })
}

/// Reads the input of the paired comparison from the file beside a score; `None` if it does not exist.
pub(super) fn read_units(path: &InputFile) -> Result<Option<UnitScores>> {
    if path.is_standard() {
        return Ok(None);
    }
    let folder = if path.is_dir() { path } else { path.parent().unwrap_or(Path::new("")) };
    let file = folder.join(UNITS);
    if !file.is_file() {
        return Ok(None);
    }
    parse_units(&input::read_text_up_to(&file, LARGEST_UNITS)?)
        .map(Some)
        .map_err(|e| Error::input(format!("{}: {e}", file.display())))
}

/// Parses the input of the paired comparison.
/// Errors: the first problem in it.
pub fn parse_units(text: &str) -> std::result::Result<UnitScores, String> {
    let units: UnitScores = serde_json::from_str(text).map_err(|e| e.to_string())?;
    if units.is_sound() { Ok(units) } else { Err("not written by microsig evaluate".to_owned()) }
}

/// Parses a score.
/// Errors: every problem in it.
pub fn parse(text: &str) -> std::result::Result<Score, Vec<String>> {
    let value: Value = serde_json::from_str(text).map_err(|e| vec![e.to_string()])?;
    let score: Score = serde_path_to_error::deserialize(&value).map_err(|e| vec![mistyped(&value, &e)])?;
    if score.definitions.versions.microsig.is_empty() {
        return Err(vec![
            "definitions.versions.microsig is missing: not a score file of microsig evaluate".to_owned(),
        ]);
    }
    let is_empty = score.detection.is_none() && score.field.is_none() && score.planes.is_none();
    // If the truth is withheld, scores of few particles are withheld as well.
    if is_empty && !score.truth_is_secret {
        return Err(vec![
            "neither detection nor field nor planes: not a score file of microsig evaluate".to_owned(),
        ]);
    }
    let problems = beyond_ranges(&value);
    if !problems.is_empty() {
        return Err(problems);
    }
    Ok(score)
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    #[test]
    fn what_is_no_score_is_refused_by_its_key() {
        let problems = |score: &Value| parse(&score.to_string()).err().unwrap_or_default();
        let score = |f1: Value, interval: Value| {
            json!({ "definitions": { "versions": { "microsig": "1" } },
                "detection": { "f1": f1, "interval_f1": interval } })
        };
        assert_eq!(problems(&score(json!(0.5), json!([0.4, 0.6]))), Vec::<String>::new());
        assert_eq!(problems(&score(Value::Null, Value::Null)), Vec::<String>::new());
        let withheld = json!({ "definitions": { "versions": { "microsig": "1" } }, "truth_is_secret": true });
        assert_eq!(problems(&withheld), Vec::<String>::new());
        for (score, expected) in [
            (score(json!(2), Value::Null), "detection.f1 = 2: expected from 0 to 1, or null"),
            (score(json!("0.5"), Value::Null), "detection.f1 = \"0.5\": expected"),
            (score(json!(0.5), json!([0.6, 0.4])), "detection.interval_f1 = [0.6,0.4]: expected [low, high]"),
            (json!({ "detection": { "f1": 1 } }), "definitions.versions.microsig is missing"),
            (json!({ "definitions": { "versions": { "microsig": "1" } } }), "neither detection nor field"),
        ] {
            let found = problems(&score);
            assert!(found.len() == 1 && found[0].starts_with(expected), "{expected}: {found:?}");
        }
    }
}
