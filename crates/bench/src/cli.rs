//! The arguments as typed.

use std::path::PathBuf;

use clap::{Args, Parser, Subcommand, ValueEnum};

use crate::scoring::{Compare, Evaluate};
use crate::tracking::Track;

/// Benchmark datasets for defocusing and astigmatic PIV/PTV.
#[derive(Debug, Parser)]
#[command(name = "microsig", version = VERSION, about, long_about = None, subcommand_required = true)]
pub(crate) struct Cli {
    /// What to do.
    #[command(subcommand)]
    pub(crate) verb: Verb,
    #[allow(missing_docs)]
    #[command(flatten)]
    pub(crate) common: Common,
}

const VERSION: &str = concat!(env!("CARGO_PKG_VERSION"), " (", env!("MICROSIG_COMMIT"), ")");

/// Options of every verb.
#[derive(Debug, Args)]
pub(crate) struct Common {
    /// Number of threads; 0 uses all cores
    #[arg(long, global = true, default_value_t = 0, value_name = "N")]
    pub(crate) threads: usize,
    /// Seed of all random numbers [default: the scenario's; 0 for render]
    #[arg(long, global = true, value_name = "N")]
    pub(crate) seed: Option<u64>,
    /// No progress and no warnings
    #[arg(long, global = true)]
    pub(crate) quiet: bool,
    /// Print the result as one JSON object
    #[arg(long, global = true)]
    pub(crate) json: bool,
    /// Replace what exists
    #[arg(long, global = true)]
    pub(crate) force: bool,
}

/// The verbs.
#[derive(Debug, Subcommand)]
pub(crate) enum Verb {
    /// Images from MicroSIG's own settings file and data files
    #[command(after_help = "Example: microsig render settings.txt particles/ images/ --seed 1")]
    Render(Render),
    /// A dataset from a scenario: particles, images, ground truth, manifest
    #[command(
        after_help = "Example: microsig generate scenarios/quickstart.ron --set optics.background_noise=50 --out datasets/noisy"
    )]
    Generate(Generate),
    /// Many datasets over the axes of a sweep
    #[command(
        after_help = "Example: microsig sweep scenarios/noise_sweep.ron --out sweeps/noise --shard 1/4"
    )]
    Sweep(Sweep),
    /// The velocity fields on offer, or one of them: formula, parameters, units, defaults, source
    #[command(after_help = "Example: microsig flows lamb_oseen --plot lamb_oseen.svg")]
    Flows(Flows),
    /// A commented scenario to start from
    #[command(after_help = "Example: microsig new mine.ron && microsig generate mine.ron")]
    New(New),
    /// Check a dataset: checksums, manifest, tables
    #[command(after_help = "Example: microsig verify datasets/quickstart --regenerate")]
    Verify(Verify),
    /// A baseline tracker's result
    #[command(after_help = "Example: microsig track datasets/quickstart --method ncc --out ncc.csv")]
    Track(Track),
    /// Scores of a tracker's result against the truth
    #[command(
        after_help = "Example: microsig evaluate datasets/quickstart result.csv --out scores/mine --report"
    )]
    Evaluate(Evaluate),
    /// A leaderboard of several scores
    #[command(after_help = "Example: microsig compare scores/mine scores/theirs --out scores/leaderboard")]
    Compare(Compare),
}

/// Arguments of `render`.
#[derive(Debug, Args)]
pub(crate) struct Render {
    /// MicroSIG settings file
    pub(crate) settings: PathBuf,
    /// A data file, or a folder of them (*.txt)
    pub(crate) data: PathBuf,
    /// Folder for the images (STEM.tif)
    pub(crate) out: PathBuf,
    /// How light is computed
    #[arg(long, value_enum, default_value_t = Mode::Rays)]
    pub(crate) mode: Mode,
    /// Number of the first frame, which addresses its random numbers
    #[arg(long, default_value_t = 0, value_name = "N")]
    pub(crate) first_frame: u32,
    /// Which points of a spheroid shine: as in MicroSIG's program, or uniform in area
    #[arg(long, value_enum, default_value_t = Spheroids::Original)]
    pub(crate) spheroids: Spheroids,
}

/// Renderers.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(crate) enum Mode {
    /// Counts of discrete rays, the paper's method
    Rays,
    /// Their limit of many rays: no noise of the rays, fast
    Expected,
}

/// Laws of emission of spheroids.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(crate) enum Spheroids {
    /// As in MicroSIG's program
    Original,
    /// Uniform in area
    Uniform,
}

/// Arguments of `generate`.
#[derive(Debug, Args)]
pub(crate) struct Generate {
    /// The scenario (RON)
    pub(crate) scenario: PathBuf,
    /// The dataset's folder [default: datasets/NAME]
    #[arg(long, value_name = "DIR")]
    pub(crate) out: Option<PathBuf>,
    /// Replace a value of the scenario, written as in the file; may be given several times
    #[arg(long, value_name = "PATH=VALUE")]
    pub(crate) set: Vec<String>,
    /// Go on with an interrupted run
    #[arg(long)]
    pub(crate) resume: bool,
}

/// Arguments of `sweep`.
#[derive(Debug, Args)]
pub(crate) struct Sweep {
    /// The sweep (RON)
    pub(crate) sweep: PathBuf,
    /// The sweep's folder [default: datasets/NAME]
    #[arg(long, value_name = "DIR")]
    pub(crate) out: Option<PathBuf>,
    /// Print the cases without running them
    #[arg(long)]
    pub(crate) list: bool,
    /// Run only every N-th case, from the K-th [default: from SLURM_ARRAY_TASK_*, else all]
    #[arg(long, value_name = "K/N")]
    pub(crate) shard: Option<String>,
    /// Go on with an interrupted run; cases that failed are tried again
    #[arg(long)]
    pub(crate) resume: bool,
    /// Write the table of all cases of a sweep whose shards are done, without running any
    #[arg(long)]
    pub(crate) collect: bool,
}

/// Arguments of `flows`.
#[derive(Debug, Args)]
pub(crate) struct Flows {
    /// Name of a field
    pub(crate) name: Option<String>,
    /// Draw the field's speed and streamlines in the default scene (SVG)
    #[arg(long, value_name = "FILE", requires = "name")]
    pub(crate) plot: Option<PathBuf>,
}

/// Arguments of `new`.
#[derive(Debug, Args)]
pub(crate) struct New {
    /// The file to write
    pub(crate) file: PathBuf,
}

/// Arguments of `verify`.
#[derive(Debug, Args)]
pub(crate) struct Verify {
    /// The dataset's folder
    pub(crate) dataset: PathBuf,
    /// Make the dataset again from its scenario and compare all bytes
    #[arg(long)]
    pub(crate) regenerate: bool,
}
