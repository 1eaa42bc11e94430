//! Tasks of the repository: `cargo xtask <task>`.
#![expect(clippy::print_stdout, reason = "a task reports what it did")]

mod baselines;
mod bench;
mod emulation;
mod figures;
mod golden;
mod leaderboard;
mod shipped;

use std::path::{Path, PathBuf};
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
    /// Measures speed and memory of whole runs, compared with lower limits and a yardstick; about 20 minutes.
    Bench {
        /// Output folder of runs.csv, plots and README.md.
        #[arg(long, default_value = "target/bench")]
        out: PathBuf,
        /// Only groups whose name contains this text.
        #[arg(long)]
        only: Option<String>,
        /// Number of runs of each workload.
        #[arg(long, default_value_t = 5)]
        repeats: usize,
        /// Folder for the output of workloads, for example /dev/shm to exclude the disk. Default: below OUT
        #[arg(long)]
        scratch: Option<PathBuf>,
    },
    /// Makes all records of speed anew, one after the other: `bench`, `instructions`, `peers` (other generators)
    /// and `scoring`; 20 to 40 minutes of an otherwise idle machine.
    Records {
        /// Folder of the records.
        #[arg(long, default_value = "results")]
        out: PathBuf,
    },
    /// Counts instructions of small runs with valgrind and compares them with earlier counts; exit code 1 if
    /// one has grown.
    Instructions {
        /// Output folder of counts.csv and README.md.
        #[arg(long, default_value = "target/instructions")]
        out: PathBuf,
        /// The counts.csv to compare with.
        #[arg(long)]
        against: Option<PathBuf>,
        /// Allowed relative growth.
        #[arg(long, default_value_t = 0.02)]
        tolerance: f64,
    },
    /// Scores the baseline trackers on datasets of increasing density and noise; takes a few minutes.
    Baselines {
        /// Output folder of runs.csv, a plot and README.md.
        #[arg(long, default_value = "target/baselines")]
        out: PathBuf,
    },
    /// Runs all trackers on a suite, third-party ones in separate environments, and writes the page of the
    /// results. Runs whose inputs have not changed are skipped.
    Leaderboard(leaderboard::Arguments),
    /// Times the scoring of a million points and of dense frames; exit code 1 if a limit is exceeded.
    Scoring {
        /// Output folder of README.md.
        #[arg(long, default_value = "target/scoring")]
        out: PathBuf,
    },
    /// Times microsig and other generators of in-focus images on the same task.
    Peers {
        /// Output folder of runs.csv and README.md.
        #[arg(long, default_value = "target/peers")]
        out: PathBuf,
    },
    /// Runs one of the lower limits; timed by `bench`.
    #[command(hide = true)]
    Floor { floor: bench::floors::LowerLimit, folder: PathBuf },
    /// Renders in-focus image pairs in memory; timed by `peers`.
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
    /// Generates every shipped scenario and sweep twice at full size; exit code 1 if one differs.
    Scenarios {
        /// Output folder of scenarios.csv and README.md.
        #[arg(long, default_value = "target/scenarios")]
        out: PathBuf,
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
        Task::Baselines { out } => baselines::main(&out).map(|()| ExitCode::SUCCESS),
        Task::Leaderboard(arguments) => leaderboard::run(&arguments).map(|()| ExitCode::SUCCESS),
        Task::Scoring { out } => {
            bench::scoring::main(&out).map(|met| if met { ExitCode::SUCCESS } else { ExitCode::FAILURE })
        }
        Task::Bench { out, only, repeats, scratch } => {
            bench::main(&out, only.as_deref(), repeats, scratch.as_deref()).map(|()| ExitCode::SUCCESS)
        }
        Task::Records { out } => records(&out),
        Task::Instructions { out, against, tolerance } => {
            bench::instructions::run(&out, against.as_deref(), tolerance)
        }
        Task::Peers { out } => bench::peers::main(&out).map(|()| ExitCode::SUCCESS),
        Task::Floor { floor, folder } => floor.run(&folder).map(|()| ExitCode::SUCCESS),
        Task::Pairs { pairs, ppp, diameter_px } => {
            bench::peers::microsig::draw(pairs, ppp, diameter_px).map(|()| ExitCode::SUCCESS)
        }
        Task::Golden => golden::run().map(|()| ExitCode::SUCCESS),
        Task::Emulation { out, only } => emulation::run(&out, &only),
        Task::Scenarios { out } => shipped::run(&out),
        Task::WebTest { shots } => {
            suite::web::run(&suite::process::microsig()?, shots.as_deref()).map(|()| ExitCode::SUCCESS)
        }
        Task::Figures { kind, out, redraw } => {
            figures::run(kind, out.as_deref(), redraw).map(|()| ExitCode::SUCCESS)
        }
    }
}

/// All records of speed. Limits that are exceeded are in the records; only failures end the run.
fn records(out: &Path) -> anyhow::Result<ExitCode> {
    let speed = out.join("performance");
    bench::main(&speed, None, 5, None)?;
    bench::instructions::run(&speed.join("instructions"), None, 0.0)?;
    bench::peers::main(&out.join("peers"))?;
    bench::scoring::main(&out.join("scoring"))?;
    Ok(ExitCode::SUCCESS)
}
