//! The scenario in the editor: parsing its text, initial text and presets, saving.

use std::path::Path;

use microsig_core::problem::Problem;

use serde_json::{Value, json};

use super::subject::Subject;
use scenario::{self, Scenario, shipped, template};
use storage::error::{Error, MOST_SHOWN, Result, more};
use storage::save_result;

/// Reads and resolves the scenario's text; returns its problems as JSON if there are any.
pub(super) fn read(subject: &Subject, text: &str) -> std::result::Result<Scenario, Value> {
    let name = subject.scenario.as_deref().and_then(Path::file_name);
    let name = name.map_or_else(|| "scenario".to_owned(), |name| name.to_string_lossy().into_owned());
    scenario::load_text(text, (&name, &subject.base()), &[], None, &subject.context).map_err(|error| {
        match error {
            Error::Problems(problems) => {
                let first = problems.iter().take(MOST_SHOWN).map(|problem| described(problem, text));
                Value::Array(
                    first.chain(more(problems.len()).map(|text| json!({ "message": text }))).collect(),
                )
            }
            other => Value::Array(other.messages().iter().map(|text| json!({ "message": text })).collect()),
        }
    })
}

/// A problem with its position in the text, in UTF-16 code units as in browsers.
fn described(problem: &Problem, text: &str) -> Value {
    let units = |end: usize| text.get(..end).map(|before| before.encode_utf16().count());
    let place = problem.place.as_ref().filter(|place| place.source.text == text);
    json!({
        "message": problem.message(), "path": problem.path, "line": place.map(|place| place.line_and_column().0),
        "from": place.and_then(|place| units(place.span.start)), "to": place.and_then(|place| units(place.span.end)),
    })
}

/// Initial name, text and presets of the page.
pub(super) fn about(subject: &Subject) -> Result<Value> {
    let (name, text) = subject.text()?;
    let presets = shipped().into_iter().filter(|shipped| !shipped.is_sweep());
    let presets: Vec<Value> = std::iter::once(json!({
        "name": "every key", "text": template()?, "question": "A commented scenario with every key and its default."
    }))
    .chain(presets.map(|s| json!({ "name": s.name, "text": s.text, "question": s.question() })))
    .collect();
    let file = subject.scenario.as_ref();
    Ok(json!({
        "name": name, "text": text, "presets": presets, "may_save": file.is_some(),
        "exists": file.is_some_and(|file| file.exists()),
    }))
}

/// Writes the scenario's file.
pub(super) fn save(subject: &Subject, text: &str) -> Result<Value> {
    let Some(file) = &subject.scenario else {
        return Err(Error::input("no file to save to: open the page with `microsig view FILE.ron`"));
    };
    save_result(file, true, text.as_bytes())?;
    Ok(json!({ "saved": file.display().to_string() }))
}
