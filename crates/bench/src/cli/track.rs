//! `microsig track`: runs a baseline tracker.

use std::path::{Path, PathBuf};

use clap::builder::{PossibleValue, PossibleValuesParser};
use clap::{Args, ValueEnum};

use super::Common;
use super::options::{Drawing, ImageTables, Replace};
use super::output::{progress, warn, written};
use storage::advice;
use storage::advice::option;
use storage::argument::{input, output};
use storage::error::{Error, Result};
use storage::{InputFile, OutputFile};
use tracking::{AspectRatio, METHODS, ParticleShape, TrackOptions, track};

/// Run a baseline tracker
#[derive(Debug, Args)]
#[command(after_help = "Example: microsig track datasets/quickstart --method ncc")]
pub(super) struct Track {
    /// The dataset's folder, or a split of a challenge
    dataset: PathBuf,
    /// Tracking method
    #[arg(long, value_parser = methods())]
    method: String,
    /// Output file (CSV), `-` for standard output [default: DATASET-METHOD.csv, beside the dataset]
    #[arg(long, short, value_name = "RESULT", value_parser = output())]
    out: Option<OutputFile>,
    #[command(flatten)]
    tracker: TrackerOptions,
    #[command(flatten)]
    drawing: Drawing,
    #[command(flatten)]
    replace: Replace,
    #[command(flatten)]
    tables: ImageTables,
}

/// Options of the methods.
#[derive(Debug, Args)]
pub(super) struct TrackerOptions {
    /// Largest displacement from frame to frame
    #[arg(long, value_name = "PX", default_value_t = TrackOptions::MAX_DISPLACEMENT_PX)]
    max_displacement: f64,
    /// Diameter of a particle image (spots)
    #[arg(long, value_name = "PX", default_value_t = TrackOptions::DIAMETER_PX)]
    diameter: f64,
    /// One field for all pairs of a steady flow, from the average of their correlations (piv)
    #[arg(long)]
    ensemble: bool,
    /// Shape of the particles: of spheroids, ncc and mle also measure the axis
    #[arg(long, value_enum, default_value_t = ShapeChoice::Sphere)]
    shape: ShapeChoice,
    /// Polar over equatorial diameter of spheroids: a number; `common`, measured by the clearest particles; or `each`
    /// particle its own [default: common]
    #[arg(long, value_name = "RATIO")]
    aspect_ratio: Option<AspectRatio>,
    /// Fit the diameter of each sphere, from half the smallest to twice the largest calibrated one (mle)
    #[arg(long)]
    fit_diameter: bool,
    /// CSV file with the columns `x_px` and `y_px` of particles whose depth is measured in all frames, or only in those of
    /// its column `frame`; other particles are not searched for (ncc, mle)
    #[arg(long, value_name = "FILE", value_parser = input())]
    positions: Option<InputFile>,
    /// Standard deviation of the noise in x and y (truth-noise)
    #[arg(long, value_name = "PX", default_value_t = TrackOptions::NOISE_PX)]
    noise_xy: f64,
    /// Standard deviation of the noise in z (truth-noise)
    #[arg(long, value_name = "UM", default_value_t = TrackOptions::NOISE_UM)]
    noise_z: f64,
}

impl TrackerOptions {
    /// Whether an option differs from its default.
    pub(super) fn are_given(&self) -> bool {
        self.max_displacement != TrackOptions::MAX_DISPLACEMENT_PX
            || self.diameter != TrackOptions::DIAMETER_PX
            || self.noise_xy != TrackOptions::NOISE_PX
            || self.noise_z != TrackOptions::NOISE_UM
            || self.ensemble
            || self.shape != ShapeChoice::Sphere
            || self.aspect_ratio.is_some()
            || self.fit_diameter
            || self.positions.is_some()
    }

    /// The options of a method.
    pub(super) fn of(&self, method: &str, common: &Common) -> Result<TrackOptions> {
        if self.aspect_ratio.is_some() && self.shape != ShapeChoice::Spheroid {
            let (ratio, shape) = (option("aspect_ratio"), option("shape").is("spheroid"));
            return Err(Error::option(advice!(ratio, ": expected with ", shape)));
        }
        Ok(TrackOptions {
            max_displacement_px: self.max_displacement,
            diameter_px: self.diameter,
            noise_xy_px: self.noise_xy,
            noise_z_um: self.noise_z,
            ensemble: self.ensemble,
            fit_diameter: self.fit_diameter,
            positions: self.positions.clone(),
            shape: match self.shape {
                ShapeChoice::Sphere => ParticleShape::Sphere,
                ShapeChoice::Spheroid => {
                    ParticleShape::Spheroid { aspect: self.aspect_ratio.unwrap_or(AspectRatio::Common) }
                }
            },
            context: common.context.clone(),
            ..TrackOptions::of(method, progress(common))
        })
    }
}

/// The shapes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum ShapeChoice {
    Sphere,
    Spheroid,
}

/// The methods with their help.
pub(super) fn methods() -> PossibleValuesParser {
    PossibleValuesParser::new(METHODS.iter().map(|m| PossibleValue::new(m.name).help(m.about)))
}

impl Track {
    pub(super) fn run(&self, common: &Common) -> Result<()> {
        let options = self.tracker.of(&self.method, common)?;
        let out =
            self.out.clone().map_or_else(|| beside(&self.dataset, &self.method).map(OutputFile::from), Ok)?;
        // Checked first, because tracking may take a long time.
        out.outside_datasets()?;
        let tracked = track(
            &self.dataset,
            out.clone(),
            &TrackOptions { seed: self.drawing.seed, force: self.replace.force, ..options },
        )?;
        warn(&tracked.warnings, common);
        let each =
            tracked.seconds_per_frame.map_or(String::new(), |s| format!(" ({s:.3} s of CPU time per frame)"));
        let (dataset, shown) = (self.dataset.display(), out.display());
        let next = if out.is_standard() {
            String::new()
        } else {
            format!(", in {shown}; score it with `microsig evaluate {dataset} {shown}`")
        };
        let notes: String = tracked.notes.iter().map(|note| format!(", {note}")).collect();
        let text = format!(
            "{} rows from {} frames in {:.2} s{each}{notes}{next}",
            tracked.rows, tracked.frames, tracked.seconds
        );
        written(&out, &text, &tracked, common)
    }
}

/// The default result of a method on a dataset.
fn beside(dataset: &Path, method: &str) -> Result<PathBuf> {
    // Resolves `.` and links, so that there is a name.
    let whole = dataset.canonicalize().map_err(|e| Error::read(dataset, e))?;
    let is_named = dataset.file_name().is_some() && !dataset.is_symlink();
    let folder = if is_named { dataset } else { &whole };
    let mut name = folder.file_name().unwrap_or_default().to_owned();
    name.push(format!("-{method}.csv"));
    Ok(folder.with_file_name(name))
}
