//! `microsig twin`: how accurate trackers are on a recording, by its digital twin.

use std::path::PathBuf;

use clap::Args;

use super::Common;
use super::options::{Drawing, ImageTables, Replace};
use super::output::{progress, summarize, warn};
use crate::twin::{TwinOptions, TwinTracker, twin};
use storage::InputFile;
use storage::argument::{folder, input};
use storage::error::Result;

/// Predict how accurate trackers are on a recording: they run on it and on its digital twin
#[derive(Debug, Args)]
#[command(
    after_help = "Example: microsig twin recording --optics fitted/scenario.ron --run ncc,mle,'python mine.py {images} {out}' --out twin"
)]
pub(super) struct Twin {
    /// The folder of a recording, as `microsig import` makes it
    recording: PathBuf,
    /// A scenario with optics and camera: `scenario.ron` of `microsig fit --field`, or one with the values of a data
    /// sheet
    #[arg(long, value_name = "SCENARIO", value_parser = input())]
    optics: InputFile,
    /// Trackers, separated by commas: methods of `microsig track`, and at the end a command of the shell, in which `{images}` is the
    /// folder of the images, `{dataset}` the folder of the recording and `{out}` the CSV file to write; may be repeated [default: ncc,
    /// and mle if the recording was imported with optics]
    #[arg(long, value_name = "TRACKERS", value_parser = TwinTracker::list)]
    run: Vec<Vec<TwinTracker>>,
    /// Output folder: report.html, twin.json, the twin and the results
    #[arg(long, short, value_name = "DIR", value_parser = folder())]
    out: PathBuf,
    #[command(flatten)]
    drawing: Drawing,
    #[command(flatten)]
    replace: Replace,
    #[command(flatten)]
    tables: ImageTables,
}

impl Twin {
    pub(super) fn run(&self, common: &Common) -> Result<()> {
        let made = twin(&TwinOptions {
            recording: self.recording.clone(),
            optics: self.optics.clone(),
            run: self.run.concat(),
            out: self.out.clone(),
            force: self.replace.force,
            seed: self.drawing.seed,
            progress: progress(common),
            context: common.context.clone(),
        })?;
        warn(&made.warnings, common);
        let mut text: String = made.trackers.iter().map(|of| format!("{}\n", of.sentence)).collect();
        made.notes.iter().for_each(|note| text += &format!("{note}\n"));
        text += &format!("in {}", self.out.join("report.html").display());
        summarize(&text, &made, common)
    }
}
