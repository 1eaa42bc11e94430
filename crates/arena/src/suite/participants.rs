//! Information that participants give about a tracker for the page of a suite:
//! `RESULTS/TRACKER/tracker.json`.

use std::collections::BTreeMap;

use serde::Deserialize;

use super::entry::Entry;
use super::page::Annotations;
use storage::error::{Error, Result};
use storage::input::read_text_up_to;
use storage::json;
use storage::shown::name;

/// The file beside the folders of a tracker's tracks.
pub(super) const ABOUT: &str = "tracker.json";

/// Maximum length of the file, bytes.
const MAX_BYTES: u64 = 1_000_000;

/// The contents of the file; every key is optional.
#[derive(Debug, Default, Deserialize)]
#[serde(default, deny_unknown_fields)]
struct Participant {
    /// Name on the page, instead of the name of the folder.
    name: Option<String>,
    /// Purpose of the tracker.
    made_for: Option<String>,
    /// Who made the tracker or ran it.
    by: Option<String>,
    version: Option<String>,
    /// The command that was run on each dataset.
    command: Option<String>,
    /// The machine on which it ran.
    machine: Option<String>,
    /// Time per frame, s, by `TRACK/CASE`.
    seconds_per_frame: BTreeMap<String, f64>,
}

/// Names, purposes and times of the trackers that have such a file.
/// Errors: a file of another form, a case that the suite does not have at this size, a time that is not > 0.
pub(super) fn annotations(entries: &mut [Entry], cases: &[String]) -> Result<Annotations> {
    let mut more = Annotations::default();
    let mut problems = Vec::new();
    for entry in entries {
        let path = entry.folder.join(ABOUT);
        if !path.exists() {
            continue;
        }
        let mut wrong = Vec::new();
        let about: Participant = json::parse(&read_text_up_to(&path, MAX_BYTES)?).unwrap_or_else(|what| {
            wrong.push(what);
            Participant::default()
        });
        let tracker = &entry.name;
        more.names.extend(about.name.map(|text| (tracker.clone(), name(&text))));
        let texts = [
            ("", about.made_for),
            ("by ", about.by),
            ("version ", about.version),
            ("command: ", about.command),
            ("on ", about.machine),
        ];
        let texts: Vec<String> =
            texts.into_iter().filter_map(|(what, text)| Some(format!("{what}{}", name(&text?)))).collect();
        if !texts.is_empty() {
            more.made_for.insert(tracker.clone(), texts.join("; "));
        }
        for (case, seconds) in about.seconds_per_frame {
            if !cases.contains(&case) {
                wrong.push(format!("seconds_per_frame: {case}: expected TRACK/CASE of the suite"));
            } else if !(seconds > 0.0 && seconds.is_finite()) {
                wrong.push(format!("seconds_per_frame: {case} = {seconds}: expected a time > 0 s"));
            } else {
                more.seconds_per_frame.insert((tracker.clone(), case), seconds);
            }
        }
        let shown = format!("{tracker}/{ABOUT}: ");
        let wrong: Vec<String> = wrong.iter().map(|what| shown.clone() + what).collect();
        match wrong[..] {
            [] => {}
            _ if entry.is_submission() => entry.fault = Some(wrong.join("; ")),
            _ => problems.extend(wrong),
        }
    }
    if problems.is_empty() { Ok(more) } else { Err(Error::Input(problems)) }
}
