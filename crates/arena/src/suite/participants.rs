//! Information that participants give about a tracker for the page of a suite:
//! `RESULTS/TRACKER/tracker.json`.

use std::collections::BTreeMap;
use std::path::Path;

use serde::Deserialize;

use super::page::Annotations;
use scenario::SuiteCase;
use storage::error::{Error, Result};
use storage::input::read_text_up_to;
use storage::json;
use storage::shown::name;

/// The file beside the folders of a tracker's tracks.
const ABOUT: &str = "tracker.json";

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
    /// Time per frame, s, by `TRACK/CASE`.
    seconds_per_frame: BTreeMap<String, f64>,
}

/// Names, purposes and times of the trackers that have such a file.
///
/// # Errors
/// A file of another form, a case that the suite does not have at this size, a time that is not > 0.
pub(super) fn annotations(results: &Path, trackers: &[String], cases: &[SuiteCase]) -> Result<Annotations> {
    let mut more = Annotations::default();
    let mut problems = Vec::new();
    for tracker in trackers {
        let path = results.join(tracker).join(ABOUT);
        if !path.exists() {
            continue;
        }
        let mut refuse = |what: String| problems.push(format!("{}: {what}", path.display()));
        let about: Participant = match json::parse(&read_text_up_to(&path, MAX_BYTES)?) {
            Ok(about) => about,
            Err(what) => {
                refuse(what);
                continue;
            }
        };
        more.names.extend(about.name.map(|text| (tracker.clone(), name(&text))));
        more.made_for.extend(about.made_for.map(|text| (tracker.clone(), name(&text))));
        for (case, seconds) in about.seconds_per_frame {
            if !cases.iter().any(|known| known.folder() == case) {
                refuse(format!("seconds_per_frame: {case}: expected TRACK/CASE of the suite"));
            } else if !(seconds > 0.0 && seconds.is_finite()) {
                refuse(format!("seconds_per_frame: {case} = {seconds}: expected a time > 0 s"));
            } else {
                more.seconds_per_frame.insert((tracker.clone(), case), seconds);
            }
        }
    }
    if problems.is_empty() { Ok(more) } else { Err(Error::Input(problems)) }
}
