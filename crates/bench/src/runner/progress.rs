//! A progress bar with rate and remaining time, on standard error and only if that is a terminal.

use indicatif::{ProgressBar, ProgressStyle};

/// Whether progress is shown at all.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Progress {
    /// On a terminal.
    Bar,
    /// Never.
    Hidden,
}

impl Progress {
    /// A bar over this many images.
    pub(crate) fn images(self, n: u64) -> ProgressBar {
        self.bar(n, "images")
    }

    /// A bar over this many cases.
    pub(crate) fn cases(self, n: u64) -> ProgressBar {
        self.bar(n, "cases")
    }

    fn bar(self, n: u64, what: &str) -> ProgressBar {
        if self == Progress::Hidden {
            return ProgressBar::hidden();
        }
        // indicatif draws on standard error, and nothing at all where that is no terminal.
        let bar = ProgressBar::new(n);
        let style = ProgressStyle::with_template(&format!(
            "{{bar:40}} {{pos}}/{{len}} {what}  {{per_sec}}  {{eta}} left"
        ));
        if let Ok(style) = style {
            bar.set_style(style);
        }
        bar
    }
}
