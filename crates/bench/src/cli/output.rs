//! Output of all verbs: results go to standard output, everything else to standard error.

use std::fmt::Display;
use std::io::Write;
use std::path::Path;

use serde::Serialize;

use super::Common;
use generator::runner::Progress;
use storage::error::{Error, Result};

/// Progress bars, unless `--quiet`.
pub(super) fn progress(common: &Common) -> Progress {
    if common.quiet { Progress::Hidden } else { Progress::Bar }
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
    if !common.quiet {
        let mut stderr = std::io::stderr().lock();
        // A warning that cannot be printed does not stop the run.
        let _ = warnings.iter().try_for_each(|w| writeln!(stderr, "warning: {}", printable(&w.to_string())));
    }
}

/// Prints a note on standard error, unless `--quiet`.
pub(super) fn say(text: &str, common: &Common) {
    if !common.quiet {
        announce(text);
    }
}

/// Prints a note on standard error, even with `--quiet`.
pub(super) fn announce(text: &str) {
    let _ = writeln!(std::io::stderr().lock(), "{text}");
}

/// Prints a result: as a sentence, or as one JSON object with `--json`.
pub(super) fn report(text: &str, result: &impl Serialize, common: &Common) -> Result<()> {
    let line = if common.json {
        // serde_json escapes control characters below U+0020 only.
        escaped(&serde_json::to_string(result).map_err(|e| Error::input(e.to_string()))?)
    } else {
        printable(text)
    };
    match writeln!(std::io::stdout().lock(), "{line}") {
        // A reader such as `head` may close the pipe early.
        Err(e) if e.kind() == std::io::ErrorKind::BrokenPipe => Ok(()),
        written => written.map_err(Error::write(Path::new("standard output"))),
    }
}
