//! Progress with rate and remaining time on standard error: bars on a terminal, otherwise reports.

mod reports;

use std::borrow::Cow;
use std::io::Write as _;
use std::sync::{Arc, LazyLock, Mutex, PoisonError};
use std::time::Duration;

use indicatif::{
    HumanDuration, MultiProgress, ProgressBar, ProgressDrawTarget, ProgressState, ProgressStyle,
};
use microsig_core::cancel::Cancellation;
use microsig_core::render::TableStore;

use crate::error::{Error, Result};
use crate::table_cache::TableFolder;
pub use reports::Reports;
use reports::{Form, Reported};

/// All bars of the process, stacked.
static BARS: LazyLock<MultiProgress> = LazyLock::new(MultiProgress::new);

/// How progress is shown.
#[derive(Debug, Clone, Default)]
enum Shown {
    /// Not at all.
    #[default]
    Nothing,
    /// Only by warnings.
    Warnings,
    /// By bars on a terminal.
    Bars,
    /// By reports instead of bars.
    Reports(Arc<Reports>),
}

/// Progress of some work: how it is shown (by default not at all), and what stops the work.
#[derive(Debug, Clone, Default)]
pub struct Progress {
    shown: Shown,
    /// Whether the work is a part of a longer task, which has the notes.
    is_part: bool,
    stop: Cancellation,
}

impl Progress {
    /// Checks whether the work may continue.
    pub fn check(&self) -> Result<()> {
        if self.stop.is_cancelled() { Err(Error::Interrupted) } else { Ok(()) }
    }

    /// The same for work that another thread may stop.
    #[must_use]
    pub fn stopped_by(self, stop: &Cancellation) -> Self {
        Progress { stop: stop.clone(), ..self }
    }

    /// Bars on a terminal.
    pub fn bars() -> Self {
        Progress { shown: Shown::Bars, ..Progress::default() }
    }

    /// A line every minute, with the time left.
    pub fn lines() -> Self {
        Progress::reported(Reports::start(Form::Lines, Some(Duration::from_secs(60)), report))
    }

    /// A JSON object per task and line, when the task begins, every second, and when it ends.
    pub fn json() -> Self {
        Progress::reported(Reports::start(Form::Json, Some(Duration::from_secs(1)), report))
    }

    /// Progress that another thread asks for; no notes are printed.
    pub fn asked() -> (Self, Arc<Reports>) {
        let reports = Reports::start(Form::Polled, None, |_| ());
        (Progress { is_part: true, ..Progress::reported(Arc::clone(&reports)) }, reports)
    }

    fn reported(reports: Arc<Reports>) -> Self {
        Progress { shown: Shown::Reports(reports), ..Progress::default() }
    }

    /// Whether notes are printed: not if nothing is shown, and not for a part of a longer task.
    pub fn has_notes(&self) -> bool {
        !self.is_part && matches!(self.shown, Shown::Bars | Shown::Reports(_))
    }

    /// Prints a warning, if there is one, on standard error, above the bars, also within a longer task.
    pub fn warn(&self, text: Option<&str>) {
        if let Some(text) = text.filter(|_| !matches!(self.shown, Shown::Nothing)) {
            let _ = BARS.suspend(|| writeln!(std::io::stderr().lock(), "warning: {text}"));
        }
    }

    /// Prints a note on standard error, above the bars.
    pub fn note(&self, text: &str) {
        if self.has_notes() {
            // A note that cannot be printed does not stop the work.
            let _ = BARS.suspend(|| writeln!(std::io::stderr().lock(), "{text}"));
        }
    }

    /// A bar for `n` images.
    pub fn images(&self, n: u64) -> Bar {
        self.task(Some(n), "images")
    }

    /// A bar for work of which a share is known to be done ([`Bar::set_share`]).
    pub fn percent(&self, of: &'static str) -> Bar {
        self.task(Some(100), of)
    }

    /// A bar for the `n` cases of a sweep, and the progress within a case, shown below it.
    pub fn cases(&self, n: u64) -> (Bar, Progress) {
        let mut within = Progress { is_part: true, ..self.clone() };
        if matches!(&self.shown, Shown::Reports(reports) if reports.are_polled()) {
            // The parts would only interrupt it.
            within.shown = Shown::Warnings;
        }
        (self.task(Some(n), "cases"), within)
    }

    /// A spinner with the elapsed time, for work of unknown duration.
    pub fn spinner(&self, what: &'static str) -> Bar {
        self.task(None, what)
    }

    /// A task with `parts` steps, or of unknown length.
    fn task(&self, parts: Option<u64>, what: &'static str) -> Bar {
        let bar = ProgressBar::with_draw_target(Some(parts.unwrap_or(0)), ProgressDrawTarget::hidden());
        let reported = match &self.shown {
            Shown::Nothing | Shown::Warnings => None,
            Shown::Reports(reports) => Some(reports.task(what, bar.clone())),
            Shown::Bars => {
                draw(&BARS.add(bar.clone()), parts, what);
                None
            }
        };
        Bar { bar, reported }
    }
}

/// Draws a bar, or a spinner for a task of unknown duration.
fn draw(bar: &ProgressBar, parts: Option<u64>, what: &'static str) {
    let (template, tick_ms) = match parts {
        // The ticks keep the bar moving while no part is finished.
        Some(_) => (format!("{{pos}}/{{len}} {what} {{msg}} {{wide_bar}} {{rate}}{{left}}"), 500),
        None => ("{spinner} {msg} {elapsed}".to_owned(), 200),
    };
    if let Ok(style) = ProgressStyle::with_template(&template) {
        bar.set_style(style.with_key("rate", rate).with_key("left", left));
    }
    if parts.is_none() {
        bar.set_message(what);
    }
    bar.enable_steady_tick(Duration::from_millis(tick_ms));
}

/// Writes a line of a report; if that is not possible, the work goes on.
fn report(line: &str) {
    let _ = writeln!(std::io::stderr().lock(), "{line}");
}

/// A task whose progress is shown.
#[derive(Debug)]
pub struct Bar {
    bar: ProgressBar,
    reported: Option<Reported>,
}

impl Bar {
    /// `n` more parts are done.
    pub fn inc(&self, n: u64) {
        self.bar.inc(n);
    }

    /// Which share of [`Progress::percent`] is done.
    pub fn set_share(&self, share: f64) {
        self.bar.set_position((100.0 * share) as u64);
    }

    /// States which part is under way.
    pub fn set_message(&self, message: impl Into<Cow<'static, str>>) {
        self.bar.set_message(message);
    }

    /// Ends the task.
    pub fn finish(self) {
        self.bar.finish_and_clear();
        drop(self.reported);
    }
}

/// Storage of renderers' tables: in a folder, if there is one, with a bar while they are computed.
#[derive(Debug)]
pub struct Tables {
    folder: Option<TableFolder>,
    progress: Progress,
    /// Number of tables made so far, and the bar, while tables are computed.
    bar: Mutex<(u64, Option<Bar>)>,
}

impl Tables {
    /// Tables stored in `folder`, or not stored.
    pub fn new(folder: Option<TableFolder>, progress: Progress) -> Self {
        Tables { folder, progress, bar: Mutex::default() }
    }
}

impl TableStore for Tables {
    fn load(&self, description: &str) -> Option<Vec<u8>> {
        self.folder.as_ref()?.load(description)
    }

    fn save(&self, description: &str, bytes: &[u8]) {
        self.folder.iter().for_each(|folder| folder.save(description, bytes));
    }

    fn tables_started(&self, tables: usize) {
        let mut lock = self.bar.lock().unwrap_or_else(PoisonError::into_inner);
        let (made, bar) = &mut *lock;
        let bar = bar.get_or_insert_with(|| {
            let bar = self.progress.task(Some(0), "image tables");
            // Not all tables of a run are known from the beginning.
            if *made > 0 {
                bar.set_message(format!("{made} more made before"));
            }
            bar
        });
        bar.bar.inc_length(tables as u64);
    }

    fn table_finished(&self) {
        let mut lock = self.bar.lock().unwrap_or_else(PoisonError::into_inner);
        let (made, bar) = &mut *lock;
        *made += 1;
        let Some(shown) = bar.as_ref() else { return };
        shown.inc(1);
        if Some(shown.bar.position()) == shown.bar.length() {
            bar.take().into_iter().for_each(Bar::finish);
        }
    }
}

/// Writes the rate per second, once the first item is done.
fn rate(state: &ProgressState, out: &mut dyn std::fmt::Write) {
    if state.pos() > 0 {
        // Errors of drawing a bar are ignored.
        let _ = match state.per_sec() {
            rate if rate < 10.0 => write!(out, "{rate:.1}/s, "),
            rate => write!(out, "{rate:.0}/s, "),
        };
    }
}

/// Writes the remaining time, which is unknown until the first item is done.
fn left(state: &ProgressState, out: &mut dyn std::fmt::Write) {
    let _ = match state.pos() {
        0 => write!(out, "time left unknown"),
        _ => write!(out, "{} left", HumanDuration(state.eta())),
    };
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_count_of_tables_goes_on() {
        let (progress, reports) = Progress::asked();
        let tables = Tables::new(None, progress);
        let message = || tables.bar.lock().unwrap().1.as_ref().map(|bar| bar.bar.message());
        tables.tables_started(2);
        tables.table_finished();
        assert_eq!((reports.now(), message().as_deref()), (Some(("image tables", 1, 2)), Some("")));
        tables.table_finished();
        tables.tables_started(1);
        assert_eq!(message().as_deref(), Some("2 more made before"));
        assert_eq!(reports.now(), Some(("image tables", 0, 1)));
    }
}
