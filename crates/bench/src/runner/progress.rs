//! Progress bars with rate and remaining time, on standard error and only if that is a terminal.

use indicatif::{MultiProgress, ProgressBar, ProgressStyle};

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
        let style = ProgressStyle::with_template(&format!(
            "{{bar:40}} {{pos}}/{{len}} {what}  {{msg}}  {{per_sec}}  {{eta}} left"
        ));
        if let Ok(style) = style {
            bar.set_style(style);
        }
        bar.tick();
        bar
    }
}
