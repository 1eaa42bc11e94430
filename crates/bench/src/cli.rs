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
#[command(next_help_heading = "Options of every verb")]
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
        after_help = "Example: microsig sweep scenarios/noise_density_sweep.ron --out sweeps/noise --shard 1/4"
    )]
    Sweep(Sweep),
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
    /// The truth of a dataset in another tool's format
    #[command(after_help = "Example: microsig export datasets/quickstart --format trackpy --out truth.csv")]
    Export(Export),
    /// A public challenge package and its withheld truth
    #[command(
        long_about = "A public challenge package and its withheld truth.\n\nTrain is DATASET as it is. Val is the same scenario \
drawn from a public seed made from the dataset's, with truth. Test is the same scenario drawn from a secret key of 256 bits from the \
operating system: its package holds images, calibration and a template for submissions, no truth. OUT/public is to be \
published as it is, OUT/withheld to be kept: submissions are scored on OUT/withheld/test, and its truth is published after the \
deadline and verifies against public/commitment.sha256.",
        after_help = "Example: microsig release datasets/quickstart --out challenges/quickstart --creator 'Doe, Jane'"
    )]
    Release(Release),
    /// The velocity fields on offer, or one of them: formula, parameters, units, defaults, source
    #[command(after_help = "Example: microsig flows lamb_oseen --plot lamb_oseen.svg")]
    Flows(Flows),
    /// A commented scenario to start from
    #[command(after_help = "Example: microsig new mine.ron && microsig generate mine.ron")]
    New(New),
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
    /// Go on with an interrupted run; a dataset that is finished is left as it is
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

/// Arguments of `export`.
#[derive(Debug, Args)]
pub(crate) struct Export {
    /// The dataset's folder
    pub(crate) dataset: PathBuf,
    /// The format
    #[arg(long, value_enum, value_name = "F")]
    pub(crate) format: ExportFormat,
    /// The file to write
    #[arg(long, value_name = "PATH")]
    pub(crate) out: PathBuf,
    /// Image pair, of a displacement field that changes with time
    #[arg(long, value_name = "N")]
    pub(crate) pair: Option<u32>,
    /// Which displacement field
    #[arg(long, value_enum, value_name = "KIND", default_value_t = Displacement::Central)]
    pub(crate) displacement: Displacement,
}

/// Formats of the truth: of particles, and (flo, openpiv) of the displacement field.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(crate) enum ExportFormat {
    /// XML of the ISBI challenge
    Isbi,
    /// trackpy's data frame as CSV
    Trackpy,
    /// DefocusTracker's table as CSV
    Defocustracker,
    /// TrackMate's table of spots
    TrackmateSpots,
    /// napari's tracks as CSV
    Napari,
    /// Middlebury's dense flow
    Flo,
    /// OpenPIV's text file
    Openpiv,
}

/// Definitions of a displacement field.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(crate) enum Displacement {
    /// Of what is at the place half-way in time
    Central,
    /// Of what is at the place in the first frame
    Forward,
    /// The central one averaged over depth
    Weighted,
}

/// Arguments of `release`.
#[derive(Debug, Args)]
pub(crate) struct Release {
    /// The dataset's folder; it becomes the train split
    pub(crate) dataset: PathBuf,
    /// The release's folder
    #[arg(long, value_name = "DIR")]
    pub(crate) out: PathBuf,
    /// Pairs or frames of the validation split [default: as many as the dataset has]
    #[arg(long, value_name = "N")]
    pub(crate) val: Option<u32>,
    /// Pairs or frames of the test split [default: as many as the dataset has]
    #[arg(long, value_name = "N")]
    pub(crate) test: Option<u32>,
    /// A value of motion or particles that is another one in the test split; may be given several times
    #[arg(long, value_name = "PATH=VALUE")]
    pub(crate) test_set: Vec<String>,
    /// Tell the exact times of the test split's frames [default: the nominal ones, without jitter]
    #[arg(long)]
    pub(crate) exact_times: bool,
    /// Title of the challenge [default: the dataset's]
    #[arg(long)]
    pub(crate) title: Option<String>,
    /// Who is cited, `Family, Given` or a group's name; may be given several times
    #[arg(long, value_name = "NAME")]
    pub(crate) creator: Vec<String>,
    /// Version of the challenge
    #[arg(long, value_name = "TEXT", default_value = "1.0.0")]
    pub(crate) release_version: String,
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
