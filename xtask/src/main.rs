//! Tasks of the repository: `cargo xtask <task>`.
#![expect(clippy::print_stdout, reason = "a task tells what it did")]

mod baselines;
mod bench;
mod expected;
mod export_check;
mod figures;
mod golden;
mod instructions;
mod leak_search;
mod peers;
mod picture;
mod process;
mod python;
mod reference;
mod robustness;
mod scoring;
mod shipped;
mod speed_table;

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
    /// Measures speed and memory of whole runs of the command, against floors and a yardstick; some 20 minutes.
    Bench {
        /// Where runs.csv, plots and README.md go.
        #[arg(long, default_value = "target/bench")]
        out: PathBuf,
        /// Only the groups of workloads with this in their name.
        #[arg(long)]
        only: Option<String>,
        /// Runs of each workload.
        #[arg(long, default_value_t = 5)]
        repeats: usize,
        /// Where workloads write; in memory (/dev/shm) the disk takes no part. Default: below OUT.
        #[arg(long)]
        scratch: Option<PathBuf>,
    },
    /// Counts the instructions of small runs under valgrind, and compares them with an earlier count; exit code 1 if one has
    /// grown.
    Instructions {
        /// Where counts.csv and README.md go.
        #[arg(long, default_value = "target/instructions")]
        out: PathBuf,
        /// The counts.csv to compare with.
        #[arg(long)]
        against: Option<PathBuf>,
        /// The growth that is let pass.
        #[arg(long, default_value_t = 0.02)]
        tolerance: f64,
    },
    /// Lets the baseline trackers loose on datasets of growing density and noise, and scores them; some minutes.
    Baselines {
        /// Where runs.csv, a plot and README.md go.
        #[arg(long, default_value = "target/baselines")]
        out: PathBuf,
    },
    /// Compares expected images with the mean of very many images of rays; exit code 1 if one differs.
    Expected(expected::Comparison),
    /// Times the scores of a million points and of dense frames; exit code 1 if a bar is missed.
    Scoring {
        /// Where README.md goes.
        #[arg(long, default_value = "target/scoring")]
        out: PathBuf,
    },
    /// Times other generators of in-focus images and ours on the same work.
    Peers {
        /// Where runs.csv and README.md go.
        #[arg(long, default_value = "target/peers")]
        out: PathBuf,
    },
    /// Writes the table of speed in README.md from the records of `bench` and `peers`.
    SpeedTable {
        /// The record of `bench`.
        performance: PathBuf,
        /// The record of `peers`.
        peers: PathBuf,
    },
    /// Does one of the things that no program can do faster; `bench` times it.
    #[command(hide = true)]
    Floor { floor: bench::floors::Floor, folder: PathBuf },
    /// Draws in-focus image pairs in memory; `peers` times it.
    #[command(hide = true)]
    Pairs { pairs: u32, ppp: f64, diameter_px: f64 },
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
    /// Makes the golden hashes of datasets anew; see "Image bits changed" in CHANGELOG.md.
    Golden,
    /// Opens exports, images and a release with the programs they are for, in a Python environment of its own.
    ExportCheck {
        /// Where README.md goes.
        #[arg(long, default_value = "target/export-check")]
        out: PathBuf,
        /// ImageJ's archive, to open images with it (needs `java`, a JDK).
        #[arg(long, value_name = "ij.jar")]
        imagej: Option<PathBuf>,
    },
    /// Tries to find out the truth of a test split: all seeds of 20 bits, all numbers of the truth; exit code 1 if it does.
    LeakSearch {
        /// Where README.md goes.
        #[arg(long, default_value = "target/leak-search")]
        out: PathBuf,
    },
    /// Kills runs at random moments, resumes them and compares; exit code 1 if one differs.
    Kill {
        /// Where kill.md and kill.csv go.
        #[arg(long, default_value = "target/robustness")]
        out: PathBuf,
        /// Kills of each kind of run.
        #[arg(long, default_value_t = 50)]
        kills: u32,
    },
    /// Lets every verb that writes meet a full disk (needs to be root).
    Disk {
        /// Where disk.md goes.
        #[arg(long, default_value = "target/robustness")]
        out: PathBuf,
    },
    /// Compares the peak memory of a long sequence with that of 100 frames; exit code 1 if it grows.
    Memory {
        /// Where memory.md goes.
        #[arg(long, default_value = "target/robustness")]
        out: PathBuf,
        /// Frames of the long sequence.
        #[arg(long, default_value_t = 10_000)]
        frames: u32,
    },
    /// Makes every shipped scenario and sweep at its full size, and again; exit code 1 if one differs.
    Scenarios {
        /// Where scenarios.csv and README.md go.
        #[arg(long, default_value = "target/scenarios")]
        out: PathBuf,
    },
    /// Runs a sweep as job arrays on a real Slurm of this machine (needs to be root, and Slurm installed).
    Slurm {
        /// Where README.md goes.
        #[arg(long, default_value = "target/slurm")]
        out: PathBuf,
    },
    /// Draws the pictures of the documentation: the paper's figures, all velocity fields, what the keys of scenarios do.
    Figures {
        /// Only these.
        kind: Option<figures::Kind>,
        /// Another folder for them than the documentation's.
        #[arg(long, requires = "kind")]
        out: Option<PathBuf>,
        /// Draw pictures of keys that are there again.
        #[arg(long)]
        redraw: bool,
    },
}

fn main() -> anyhow::Result<ExitCode> {
    match Cli::parse().task {
        Task::Baselines { out } => baselines::main(&out).map(|()| ExitCode::SUCCESS),
        Task::Scoring { out } => {
            scoring::main(&out).map(|met| if met { ExitCode::SUCCESS } else { ExitCode::FAILURE })
        }
        Task::Bench { out, only, repeats, scratch } => {
            bench::main(&out, only.as_deref(), repeats, scratch.as_deref()).map(|()| ExitCode::SUCCESS)
        }
        Task::Expected(comparison) => expected::run(&comparison),
        Task::Instructions { out, against, tolerance } => {
            instructions::run(&out, against.as_deref(), tolerance)
        }
        Task::Peers { out } => peers::main(&out).map(|()| ExitCode::SUCCESS),
        Task::SpeedTable { performance, peers } => {
            speed_table::run(&performance, &peers).map(|()| ExitCode::SUCCESS)
        }
        Task::Floor { floor, folder } => floor.run(&folder).map(|()| ExitCode::SUCCESS),
        Task::Pairs { pairs, ppp, diameter_px } => {
            peers::ours::draw(pairs, ppp, diameter_px).map(|()| ExitCode::SUCCESS)
        }
        Task::Reference { dir, out, images } => reference::run(&dir, &out, images),
        Task::Golden => golden::run().map(|()| ExitCode::SUCCESS),
        Task::ExportCheck { out, imagej } => {
            export_check::run(&out, imagej.as_deref()).map(|()| ExitCode::SUCCESS)
        }
        Task::LeakSearch { out } => leak_search::run(&out),
        Task::Kill { out, kills } => robustness::kill::run(&out, kills),
        Task::Disk { out } => robustness::disk::run(&out),
        Task::Memory { out, frames } => robustness::memory::run(&out, frames),
        Task::Scenarios { out } => shipped::run(&out),
        Task::Slurm { out } => robustness::slurm::run(&out),
        Task::Figures { kind, out, redraw } => {
            figures::run(kind, out.as_deref(), redraw).map(|()| ExitCode::SUCCESS)
        }
    }
}
