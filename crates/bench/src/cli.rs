//! The arguments as typed.

use std::path::PathBuf;

use clap::{Args, Parser, Subcommand, ValueEnum};

/// Benchmark datasets for defocusing and astigmatic PIV/PTV.
#[derive(Debug, Parser)]
#[command(name = "microsig", version = VERSION, about, long_about = None, subcommand_required = true)]
pub struct Cli {
    /// What to do.
    #[command(subcommand)]
    pub verb: Verb,
    #[allow(missing_docs)]
    #[command(flatten)]
    pub common: Common,
}

const VERSION: &str = concat!(env!("CARGO_PKG_VERSION"), " (", env!("MICROSIG_COMMIT"), ")");

/// Options of every verb.
#[derive(Debug, Args)]
pub struct Common {
    /// Number of threads; 0 uses all cores
    #[arg(long, global = true, default_value_t = 0, value_name = "N")]
    pub threads: usize,
    /// Seed of all random numbers [default: the scenario's; 0 for render]
    #[arg(long, global = true, value_name = "N")]
    pub seed: Option<u64>,
    /// No progress and no warnings
    #[arg(long, global = true)]
    pub quiet: bool,
    /// Print the result as one JSON object
    #[arg(long, global = true)]
    pub json: bool,
    /// Replace what exists
    #[arg(long, global = true)]
    pub force: bool,
}

/// The verbs.
#[derive(Debug, Subcommand)]
pub enum Verb {
    /// Images from MicroSIG's own settings file and data files
    #[command(after_help = "Example: microsig render settings.txt particles/ images/ --seed 1")]
    Render(Render),
    /// A dataset from a scenario: particles, images, ground truth, manifest
    #[command(after_help = "Example: microsig generate scenarios/quickstart.ron --out datasets/quickstart")]
    Generate(Generate),
    /// Check a dataset: checksums, manifest, tables
    #[command(after_help = "Example: microsig verify datasets/quickstart --regenerate")]
    Verify(Verify),
}

/// Arguments of `render`.
#[derive(Debug, Args)]
pub struct Render {
    /// MicroSIG settings file
    pub settings: PathBuf,
    /// A data file, or a folder of them (*.txt)
    pub data: PathBuf,
    /// Folder for the images (STEM.tif)
    pub out: PathBuf,
    /// How light is computed
    #[arg(long, value_enum, default_value_t = Mode::Rays)]
    pub mode: Mode,
    /// Number of the first frame, which addresses its random numbers
    #[arg(long, default_value_t = 0, value_name = "N")]
    pub first_frame: u32,
    /// Which points of a spheroid shine: as in MicroSIG's program, or uniform in area
    #[arg(long, value_enum, default_value_t = Spheroids::Original)]
    pub spheroids: Spheroids,
}

/// Renderers.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum Mode {
    /// Counts of discrete rays, the paper's method
    Rays,
    /// The noise-free limit of many rays (not supported yet)
    Expected,
}

/// Laws of emission of spheroids.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum Spheroids {
    /// As in MicroSIG's program
    Original,
    /// Uniform in area
    Uniform,
}

/// Arguments of `generate`.
#[derive(Debug, Args)]
pub struct Generate {
    /// The scenario (RON)
    pub scenario: PathBuf,
    /// The dataset's folder [default: datasets/NAME]
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
    /// Go on with an interrupted run
    #[arg(long)]
    pub resume: bool,
}

/// Arguments of `verify`.
#[derive(Debug, Args)]
pub struct Verify {
    /// The dataset's folder
    pub dataset: PathBuf,
    /// Make the dataset again from its scenario and compare all bytes
    #[arg(long)]
    pub regenerate: bool,
}
