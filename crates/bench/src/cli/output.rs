//! Output of all verbs: results go to standard output, everything else to standard error.

use std::fmt::Display;
use std::io::Write;
use std::path::Path;
use std::sync::{Mutex, PoisonError};

use serde::Serialize;

use super::Common;
use generator::runner::Progress;
use storage::error::{Error, Result};

/// What a verb gives to a program that calls it ([`super::Cli::call`]).
#[derive(Debug, Default)]
pub struct Answer {
    /// The result as one JSON object, as `--json` prints it; empty if the verb has none.
    pub json: String,
    /// The result as a sentence.
    pub text: String,
    /// Warnings.
    pub warnings: Vec<String>,
    /// Checks that failed.
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

/// Progress bars, unless `--quiet`; for a program, its progress.
pub(super) fn progress(common: &Common) -> Progress {
    match &common.caller {
        Some(caller) => caller.progress.clone(),
        None if common.quiet => Progress::Hidden,
        None => Progress::Bar,
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
pub(super) fn warn(warnings: &[impl Display], common: &Common) {
    if let Some(caller) = &common.caller {
        caller.tell(|answer| answer.warnings.extend(warnings.iter().map(ToString::to_string)));
    } else if !common.quiet {
        let mut stderr = std::io::stderr().lock();
        // A warning that cannot be printed does not stop the run.
        let _ = warnings.iter().try_for_each(|w| writeln!(stderr, "warning: {}", printable(&w.to_string())));
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

/// Prints a result: as a sentence, or as one JSON object with `--json`.
pub(super) fn report(text: &str, result: &impl Serialize, common: &Common) -> Result<()> {
    // serde_json escapes control characters below U+0020 only.
    let json =
        || serde_json::to_string(result).map(|json| escaped(&json)).map_err(|e| Error::input(e.to_string()));
    if let Some(caller) = &common.caller {
        let json = json()?;
        caller.tell(|answer| (answer.json, answer.text) = (json, text.to_owned()));
        return Ok(());
    }
    let line = if common.json { json()? } else { printable(text) };
    match writeln!(std::io::stdout().lock(), "{line}") {
        // A reader such as `head` may close the pipe early.
        Err(e) if e.kind() == std::io::ErrorKind::BrokenPipe => Ok(()),
        written => written.map_err(Error::write(Path::new("standard output"))),
    }
}
