//! Progress with rate and remaining time on standard error: bars on a terminal, otherwise reports.

use std::borrow::Cow;
use std::io::Write as _;
use std::sync::{Arc, LazyLock, Mutex, PoisonError};
use std::time::Duration;

use indicatif::{
    HumanDuration, MultiProgress, ProgressBar, ProgressDrawTarget, ProgressState, ProgressStyle,
};
use microsig_core::cancel::Cancellation;
use microsig_core::render::TableStore;

use super::reports::{Form, Reported, Reports};
use storage::error::{Error, Result};
use storage::table_cache::TableFolder;

/// All bars of the process, stacked.
static BARS: LazyLock<MultiProgress> = LazyLock::new(MultiProgress::new);

/// How progress is shown, and whether the work can be stopped.
#[derive(Debug, Clone)]
pub enum Progress {
    /// Bars on a terminal.
    Bar,
    /// Bars below existing ones.
    Below(MultiProgress),
    /// Reports instead of bars; whether without notes, as for a part of a longer task.
    Reports(Arc<Reports>, bool),
    /// No bars.
    Hidden,
    /// Work that another thread may stop.
    Stoppable(Cancellation, Box<Progress>),
}

impl Progress {
    /// Checks whether the work may continue.
    pub fn check(&self) -> Result<()> {
        match self {
            Progress::Stoppable(stop, _) if stop.is_cancelled() => Err(Error::Interrupted),
            Progress::Stoppable(_, within) => within.check(),
            _ => Ok(()),
        }
    }

    /// A line every minute, with the time left.
    pub fn lines() -> Self {
        Progress::Reports(Reports::start(Form::Lines, Some(Duration::from_secs(60)), report), false)
    }

    /// A JSON object per task and line, when the task begins, every second, and when it ends.
    pub fn json() -> Self {
        Progress::Reports(Reports::start(Form::Json, Some(Duration::from_secs(1)), report), false)
    }

    /// Progress that another thread asks for.
    pub fn asked() -> (Self, Arc<Reports>) {
        let reports = Reports::start(Form::Polled, None, |_| ());
        (Progress::Reports(Arc::clone(&reports), true), reports)
    }

    /// Whether notes are printed: not if bars are hidden, and not for a part of a longer task.
    pub(crate) fn has_notes(&self) -> bool {
        match self {
            Progress::Bar => true,
            Progress::Stoppable(_, shown) => shown.has_notes(),
            Progress::Reports(_, is_part) => !is_part,
            Progress::Below(_) | Progress::Hidden => false,
        }
    }

    /// Prints a warning, if there is one, on standard error, above the bars, also within a longer task.
    pub fn warn(&self, text: Option<&str>) {
        if let Some(text) = text.filter(|_| !matches!(self, Progress::Hidden)) {
            let _ = BARS.suspend(|| writeln!(std::io::stderr().lock(), "warning: {text}"));
        }
    }

    /// Prints a note on standard error, above the bars.
    pub(crate) fn note(&self, text: &str) {
        if self.has_notes() {
            // A note that cannot be printed does not stop the work.
            let _ = BARS.suspend(|| writeln!(std::io::stderr().lock(), "{text}"));
        }
    }

    /// A bar for `n` images.
    pub fn images(&self, n: u64) -> Bar {
        self.bar(n, "images")
    }

    /// A bar for work of which a share is known to be done ([`Bar::set_share`]).
    pub fn percent(&self, of: &'static str) -> Bar {
        self.bar(100, of)
    }

    /// A bar for the `n` cases of a sweep, and the progress within a case, shown below it.
    pub fn cases(&self, n: u64) -> (Bar, Progress) {
        match self {
            Progress::Hidden => (Bar::default(), Progress::Hidden),
            // The parts would only interrupt it.
            Progress::Reports(reports, _) if reports.are_polled() => (self.bar(n, "cases"), Progress::Hidden),
            Progress::Reports(reports, _) => {
                (self.bar(n, "cases"), Progress::Reports(Arc::clone(reports), true))
            }
            Progress::Stoppable(stop, shown) => {
                let (bar, within) = shown.cases(n);
                (bar, Progress::Stoppable(stop.clone(), Box::new(within)))
            }
            Progress::Bar | Progress::Below(_) => {
                let within = Progress::Below(BARS.clone());
                (within.bar(n, "cases"), within)
            }
        }
    }

    /// A spinner with the elapsed time, for work of unknown duration.
    pub fn spinner(&self, what: &'static str) -> Bar {
        let bar = match self {
            Progress::Hidden => return Bar::default(),
            Progress::Stoppable(_, shown) => return shown.spinner(what),
            Progress::Reports(reports, _) => return Bar::reported(reports, 0, what),
            Progress::Bar => BARS.add(ProgressBar::new_spinner()),
            Progress::Below(bars) => bars.add(ProgressBar::new_spinner()),
        };
        if let Ok(style) = ProgressStyle::with_template("{spinner} {msg} {elapsed}") {
            bar.set_style(style);
        }
        bar.set_message(what);
        bar.enable_steady_tick(Duration::from_millis(200));
        Bar { bar, reported: None }
    }

    fn bar(&self, n: u64, what: &'static str) -> Bar {
        let bar = match self {
            Progress::Hidden => return Bar::default(),
            Progress::Stoppable(_, shown) => return shown.bar(n, what),
            Progress::Reports(reports, _) => return Bar::reported(reports, n, what),
            Progress::Bar => BARS.add(ProgressBar::new(n)),
            Progress::Below(bars) => bars.add(ProgressBar::new(n)),
        };
        let template = format!("{{pos}}/{{len}} {what} {{msg}} {{wide_bar}} {{rate}}{{left}}");
        if let Ok(style) = ProgressStyle::with_template(&template) {
            bar.set_style(style.with_key("rate", rate).with_key("left", left));
        }
        // Keeps the bar moving while no part is finished.
        bar.enable_steady_tick(Duration::from_millis(500));
        Bar { bar, reported: None }
    }
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

impl Default for Bar {
    /// A bar that is not shown.
    fn default() -> Self {
        Bar { bar: ProgressBar::hidden(), reported: None }
    }
}

impl Bar {
    fn reported(reports: &Arc<Reports>, n: u64, what: &'static str) -> Self {
        let bar = ProgressBar::with_draw_target(Some(n), ProgressDrawTarget::hidden());
        let reported = Some(reports.task(what, bar.clone()));
        Bar { bar, reported }
    }

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
            let bar = self.progress.bar(0, "image tables");
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
