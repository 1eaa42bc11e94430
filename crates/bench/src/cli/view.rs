//! `microsig view`: shows a scenario, dataset or results in the browser.

use std::path::PathBuf;
use std::process::{Command, Stdio};

use clap::Args;
use serde_json::json;

use super::Common;
use super::options::{ImageTables, Replace};
use super::output::{report, say, warn, written};
use crate::view::{ExportOptions, Served, Subject, ViewOptions, export, serve};
use storage::OutputFile;
use storage::argument::output;
use storage::error::Result;

/// Show a scenario, a dataset or the errors of results in the browser
#[derive(Debug, Args)]
#[command(
    long_about = "Show a page in the browser: a scenario before it is generated, a dataset with its truth, the errors of a result, \
    the leaderboard of a sweep.\n\nThis command serves the page on the loopback address only and needs no network. It ends on \
    Ctrl-C, or a few seconds after the last page is closed.",
    after_help = "Example: microsig view quickstart\n\
         Example: microsig view datasets/quickstart result.csv\n\
         Example: microsig view datasets/quickstart result.csv --export result.html"
)]
pub(super) struct View {
    /// A scenario (the file need not exist yet) or the name of a shipped one, or the folder of a dataset or a
    /// sweep [default: a new scenario]
    path: Option<PathBuf>,
    /// Results for the dataset; for a sweep, folders with a result for each case, CASE.csv or CASE/result.csv
    results: Vec<PathBuf>,
    #[command(flatten)]
    options: ViewOptions,
    /// Print the address but do not open a browser
    #[arg(long)]
    no_browser: bool,
    /// Write dataset, results and leaderboard to a single page that opens without the program (at most 64
    /// MB), instead of serving
    #[arg(long, value_name = "FILE.html", value_parser = output())]
    export: Option<OutputFile>,
    /// The frames to export [default: the first 4]
    #[arg(long, value_name = "K,K...", value_delimiter = ',', requires = "export")]
    frames: Vec<u32>,
    #[command(flatten)]
    replace: Replace,
    #[command(flatten)]
    tables: ImageTables,
}

impl View {
    pub(super) fn run(&self, common: &Common) -> Result<()> {
        let subject = Subject::of(self.path.as_deref(), &self.results)?;
        let subject = Subject { context: common.context.clone(), ..subject };
        if let Some(out) = &self.export {
            let options =
                ExportOptions { out: out.clone(), force: self.replace.force, frames: self.frames.clone() };
            let exported = export(subject, &options)?;
            if !exported.left_out.is_empty() {
                let (limit, left_out) = (exported.limit_bytes >> 20, &exported.left_out);
                warn(
                    &[format!("frames {left_out:?} are left out: the page is limited to {limit} MiB")],
                    common,
                );
            }
            let (mb, frames) = (exported.bytes as f64 / 1e6, exported.frames.len());
            let text = format!("{}: {frames} frames, {mb:.1} MB", exported.out.display());
            return written(out, &text, &exported, common);
        }
        serve(subject, self.options, |Served { address, title }| {
            report(&format!("{title}: {address}"), &json!({ "address": address, "title": title }), common)?;
            if !self.no_browser {
                open_browser(address);
            }
            say("press Ctrl-C to stop", common);
            Ok(())
        })
    }
}

/// Asks the system to open the address. Failure is ignored, as the address is printed.
fn open_browser(address: &str) {
    let mut command = if cfg!(target_os = "macos") {
        Command::new("open")
    } else if cfg!(windows) {
        Command::new("explorer")
    } else {
        Command::new("xdg-open")
    };
    let _ = command.arg(address).stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::null()).spawn();
}
