//! Tasks of the repository: `cargo xtask <task>`.
#![expect(clippy::print_stdout, reason = "a task reports what it did")]

mod emulation;
mod figures;
mod golden;
mod leaderboard;
mod pairs;

use std::path::PathBuf;
use std::process::ExitCode;

use clap::{Parser, Subcommand};

/// Tasks of the repository.
#[derive(Parser)]
#[command(name = "cargo xtask")]
struct Cli {
    #[command(subcommand)]
    task: Task,
}

#[derive(Subcommand)]
enum Task {
    /// Runs all trackers on a suite, third-party ones in separate environments, and writes the page of the
    /// results. Runs whose inputs have not changed are skipped.
    Leaderboard(leaderboard::Arguments),
    /// Renders in-focus image pairs in memory; timed by `results/records.py peers`.
    #[command(hide = true)]
    Pairs { pairs: u32, ppp: f64, diameter_px: f64 },
    /// Updates the golden hashes of datasets; see "Bytes" in CHANGELOG.md.
    Golden,
    /// Generates the golden scenarios on emulated processors (qemu-user), takes a few minutes; exit code 1 if
    /// bytes differ.
    Emulation {
        /// Output folder of emulation.md.
        #[arg(long, default_value = "target/robustness")]
        out: PathBuf,
        /// Only these scenarios.
        #[arg(long, value_delimiter = ',')]
        only: Vec<String>,
    },
    /// Tests `microsig view` in Chromium with Playwright (tests/web); installs what is missing: Chromium and
    /// Node.js with apt-get (which then needs root), Playwright with npm.
    WebTest {
        /// Make screenshots of all pages in this folder instead.
        #[arg(long, value_name = "DIR")]
        shots: Option<PathBuf>,
    },
    /// Draws the figures of the documentation: those of the paper, all velocity fields, the effects of
    /// scenario keys.
    Figures {
        /// Kind of figures; default all.
        kind: Option<figures::Kind>,
        /// Output folder; default that of the documentation.
        #[arg(long, requires = "kind")]
        out: Option<PathBuf>,
        /// Redraw existing pictures of keys.
        #[arg(long)]
        redraw: bool,
    },
}

fn main() -> anyhow::Result<ExitCode> {
    match Cli::parse().task {
        Task::Leaderboard(arguments) => leaderboard::run(&arguments).map(|()| ExitCode::SUCCESS),
        Task::Pairs { pairs, ppp, diameter_px } => {
            pairs::draw(pairs, ppp, diameter_px).map(|()| ExitCode::SUCCESS)
        }
        Task::Golden => golden::run().map(|()| ExitCode::SUCCESS),
        Task::Emulation { out, only } => emulation::run(&out, &only),
        Task::WebTest { shots } => {
            suite::web::run(&suite::process::microsig()?, shots.as_deref()).map(|()| ExitCode::SUCCESS)
        }
        Task::Figures { kind, out, redraw } => {
            figures::run(kind, out.as_deref(), redraw).map(|()| ExitCode::SUCCESS)
        }
    }
}
