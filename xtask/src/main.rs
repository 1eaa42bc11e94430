//! Tasks of the repository: `cargo xtask <task>`.
#![expect(clippy::print_stdout, reason = "a task reports what it did")]

mod figures;
mod pairs;

use std::path::PathBuf;

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
    /// Renders in-focus image pairs in memory; timed by `results/records.py peers`.
    #[command(hide = true)]
    Pairs { pairs: u32, ppp: f64, diameter_px: f64 },
    /// Draws the figures of the documentation: of the paper, all velocity fields, the effects of
    /// scenario keys.
    Figures {
        /// Kind of figures; default all.
        kind: Option<figures::Kind>,
        /// Output folder; default: the documentation's.
        #[arg(long, requires = "kind")]
        out: Option<PathBuf>,
        /// Redraw existing pictures of keys.
        #[arg(long)]
        redraw: bool,
    },
}

fn main() -> anyhow::Result<()> {
    match Cli::parse().task {
        Task::Pairs { pairs, ppp, diameter_px } => pairs::draw(pairs, ppp, diameter_px),
        Task::Figures { kind, out, redraw } => figures::run(kind, out.as_deref(), redraw),
    }
}
