//! Output of all verbs: results go to standard output, everything else to standard error.

use std::fmt::Display;
use std::io::{IsTerminal as _, Write};
use std::sync::{Mutex, OnceLock, PoisonError};

use serde::Serialize;
use serde_json::Value;

use super::Common;
use super::options::ProgressStyle;
use storage::error::{Error, Result};
use storage::{OutputFile, Progress};

/// What a verb gives to a program that calls it ([`super::Cli::call`]).
#[derive(Debug, Default)]
pub struct Answer {
    /// The result, which `--json` prints; `None` if the verb has none.
    pub result: Option<Value>,
    /// The result as a sentence.
    pub text: String,
    pub warnings: Vec<String>,
    pub failures: Vec<String>,
}

/// A program that calls a verb.
#[derive(Debug)]
pub(super) struct Caller {
    progress: Progress,
    pub(super) answer: Mutex<Answer>,
}

impl Caller {
    pub(super) fn new(progress: Progress) -> Self {
        Caller { progress, answer: Mutex::default() }
    }

    fn tell(&self, change: impl FnOnce(&mut Answer)) {
        change(&mut self.answer.lock().unwrap_or_else(PoisonError::into_inner));
    }
}

/// Progress as asked for by `--progress`, none with `--quiet`; for a program, its progress.
pub(super) fn progress(common: &Common) -> Progress {
    // All tasks are reported together.
    static REPORTS: OnceLock<Progress> = OnceLock::new();
    if let Some(caller) = &common.caller {
        return caller.progress.clone();
    }
    match common.progress {
        _ if common.quiet => Progress::default(),
        ProgressStyle::Auto if std::io::stderr().is_terminal() => Progress::bars(),
        ProgressStyle::Auto | ProgressStyle::Lines => REPORTS.get_or_init(Progress::lines).clone(),
        ProgressStyle::Json => REPORTS.get_or_init(Progress::json).clone(),
    }
}

/// Replaces hidden characters: names from untrusted files could manipulate a terminal with them.
pub fn printable(text: &str) -> String {
    let shown =
        |c: char| if storage::shown::is_hidden(c) && !matches!(c, '\n' | '\t') { '\u{fffd}' } else { c };
    text.chars().map(shown).collect()
}

/// Escapes hidden characters in JSON.
fn escaped(json: &str) -> String {
    let mut text = String::with_capacity(json.len());
    for c in json.chars() {
        match c {
            c if storage::shown::is_hidden(c) => text += &format!("\\u{:04x}", u32::from(c)),
            c => text.push(c),
        }
    }
    text
}

/// Prints warnings, unless `--quiet`.
pub(super) fn warn(warnings: impl IntoIterator<Item = impl Display>, common: &Common) {
    if let Some(caller) = &common.caller {
        caller.tell(|answer| answer.warnings.extend(warnings.into_iter().map(|warning| warning.to_string())));
    } else if !common.quiet {
        let mut stderr = std::io::stderr().lock();
        // A warning that cannot be printed does not stop the run.
        let _ =
            warnings.into_iter().try_for_each(|w| writeln!(stderr, "warning: {}", printable(&w.to_string())));
    }
}

/// Prints a note on standard error, unless `--quiet`.
pub(super) fn say(text: &str, common: &Common) {
    if !common.quiet && common.caller.is_none() {
        announce(text);
    }
}

/// Prints a note on standard error, even with `--quiet`.
pub(super) fn announce(text: &str) {
    let _ = writeln!(std::io::stderr().lock(), "{text}");
}

/// Prints what was asked for: as text, or as one JSON object with `--json`.
pub(super) fn report(text: &str, result: &impl Serialize, common: &Common) -> Result<()> {
    if let Some(caller) = &common.caller {
        let result = serde_json::to_value(result).map_err(|e| Error::input(e.to_string()))?;
        caller.tell(|answer| (answer.result, answer.text) = (Some(result), text.to_owned()));
        return Ok(());
    }
    storage::print(format!("{}\n", line(text, result, common)?).as_bytes())
}

/// Sums up what was done or written: as a sentence unless `--quiet`, or as one JSON object with `--json`.
pub(super) fn summarize(text: &str, result: &impl Serialize, common: &Common) -> Result<()> {
    let is_wanted = common.json || !common.quiet || common.caller.is_some();
    if is_wanted { report(text, result, common) } else { Ok(()) }
}

/// [`summarize`] for a file: on standard error if the file is standard output.
pub(super) fn written(out: &OutputFile, text: &str, result: &impl Serialize, common: &Common) -> Result<()> {
    if !out.is_standard() {
        return summarize(text, result, common);
    }
    if common.json || !common.quiet {
        announce(&line(text, result, common)?);
    }
    Ok(())
}

/// Saves a plot (SVG), as PNG if the name of the file ends in it.
pub(super) fn save_picture(file: &OutputFile, force: bool, svg: &str) -> Result<()> {
    if file.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("png")) {
        return file.save(force, crate::optics::png(svg)?);
    }
    file.save(force, svg)
}

fn line(text: &str, result: &impl Serialize, common: &Common) -> Result<String> {
    if common.json { json_of(result) } else { Ok(printable(text)) }
}

fn json_of(result: &impl Serialize) -> Result<String> {
    // serde_json escapes control characters below U+0020 only.
    Ok(escaped(&serde_json::to_string(result).map_err(|e| Error::input(e.to_string()))?))
}
