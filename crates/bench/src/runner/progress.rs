//! Progress bars with rate and remaining time, on standard error and only if that is a terminal.

use indicatif::{HumanDuration, MultiProgress, ProgressBar, ProgressState, ProgressStyle};

/// Whether progress is shown at all.
#[derive(Debug, Clone)]
pub enum Progress {
    /// On a terminal.
    Bar,
    /// Below the bars that are there.
    Below(MultiProgress),
    /// Never.
    Hidden,
}

impl Progress {
    /// A bar over this many images.
    pub(crate) fn images(&self, n: u64) -> ProgressBar {
        self.bar(n, "images")
    }

    /// A bar over the cases of a sweep, and the progress of what is done within a case, shown below it.
    pub(crate) fn cases(&self, n: u64) -> (ProgressBar, Progress) {
        match self {
            Progress::Hidden => (ProgressBar::hidden(), Progress::Hidden),
            Progress::Bar | Progress::Below(_) => {
                let within = Progress::Below(MultiProgress::new());
                (within.bar(n, "cases"), within)
            }
        }
    }

    fn bar(&self, n: u64, what: &str) -> ProgressBar {
        // indicatif draws on standard error, and nothing at all where that is no terminal.
        let bar = match self {
            Progress::Hidden => return ProgressBar::hidden(),
            Progress::Bar => ProgressBar::new(n),
            Progress::Below(bars) => bars.add(ProgressBar::new(n)),
        };
        let template = format!("{{pos}}/{{len}} {what} {{msg}} {{wide_bar}} {{rate}}{{left}}");
        if let Ok(style) = ProgressStyle::with_template(&template) {
            bar.set_style(style.with_key("rate", rate).with_key("left", left));
        }
        bar.tick();
        bar
    }
}

/// Work done in a second; nothing before the first piece is done.
fn rate(state: &ProgressState, out: &mut dyn std::fmt::Write) {
    if state.pos() > 0 {
        // A bar that cannot be drawn is no reason to stop.
        let _ = match state.per_sec() {
            rate if rate < 10.0 => write!(out, "{rate:.1}/s, "),
            rate => write!(out, "{rate:.0}/s, "),
        };
    }
}

/// Remaining time; unknown before the first piece is done.
fn left(state: &ProgressState, out: &mut dyn std::fmt::Write) {
    let _ = match state.pos() {
        0 => write!(out, "time left unknown"),
        _ => write!(out, "{} left", HumanDuration(state.eta())),
    };
}
