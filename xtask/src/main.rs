//! Tasks of the repository: `cargo xtask <task>`.
#![expect(clippy::print_stdout, reason = "a task tells what it did")]

mod figures;
mod gallery;
mod golden;
mod picture;
mod reference;

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
    /// Compares our images with all images of the original in a folder; exit code 1 if a bar is missed.
    Reference {
        /// Folder with summary.csv and a folder of settings, data files and mean images for each case.
        dir: PathBuf,
        /// Where checks.csv and README.md go.
        #[arg(long, default_value = "target/reference")]
        out: PathBuf,
        /// Images to average for each case.
        #[arg(long, default_value_t = 200)]
        images: u32,
    },
    /// Draws all velocity fields for the documentation.
    Gallery {
        /// Where the pictures and README.md go.
        #[arg(long, default_value = "docs/flows")]
        out: PathBuf,
    },
    /// Makes the golden hashes of datasets anew; see "Image bits changed" in CHANGELOG.md.
    Golden,
    /// Draws the figures of Rossi 2020 with our renderer.
    Figures {
        /// Where the figures, their numbers and README.md go.
        #[arg(long, default_value = "target/figures")]
        out: PathBuf,
    },
}

fn main() -> anyhow::Result<ExitCode> {
    match Cli::parse().task {
        Task::Reference { dir, out, images } => reference::run(&dir, &out, images),
        Task::Gallery { out } => gallery::run(&out).map(|()| ExitCode::SUCCESS),
        Task::Golden => golden::run().map(|()| ExitCode::SUCCESS),
        Task::Figures { out } => figures::run(&out).map(|()| ExitCode::SUCCESS),
    }
}
