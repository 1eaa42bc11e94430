//! `microsig track`: runs a baseline tracker.

use std::path::PathBuf;

use clap::builder::{PossibleValue, PossibleValuesParser};
use clap::{Args, ValueEnum};

use super::Common;
use super::output::{progress, report, warn};
use storage::error::{Error, Result};
use storage::outside_datasets;
use tracking::{METHODS, ParticleShape, TrackOptions, track};

/// Run a baseline tracker
#[derive(Debug, Args)]
#[command(after_help = "Example: microsig track datasets/quickstart --method ncc --out ncc.csv")]
pub(super) struct Track {
    /// The dataset's folder, or a split of a challenge
    dataset: PathBuf,
    /// Tracking method
    #[arg(long, value_parser = methods())]
    method: String,
    /// Output file (CSV)
    #[arg(long, value_name = "RESULT")]
    out: PathBuf,
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
    /// Polar over equatorial diameter of spheroids [default: fitted (mle), 1/4 to 4 (ncc)]
    #[arg(long, value_name = "RATIO")]
    aspect_ratio: Option<f64>,
    /// Standard deviation of the noise in x and y (truth-noise)
    #[arg(long, value_name = "PX", default_value_t = TrackOptions::NOISE_PX)]
    noise_xy: f64,
    /// Standard deviation of the noise in z (truth-noise)
    #[arg(long, value_name = "UM", default_value_t = TrackOptions::NOISE_UM)]
    noise_z: f64,
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
        let mut wrong: Vec<String> = [
            ("--max-displacement", self.max_displacement, 0.001, 1e5, "px"),
            ("--diameter", self.diameter, 0.5, 1e3, "px"),
            ("--noise-xy", self.noise_xy, 0.0, 1e3, "px"),
            ("--noise-z", self.noise_z, 0.0, 1e3, "um"),
        ]
        .into_iter()
        .filter(|(_, value, least, most, _)| !(*least..=*most).contains(value))
        .map(|(name, value, least, most, unit)| format!("{name} {value}: expected {least} to {most} {unit}"))
        .collect();
        if self.ensemble && self.method != "piv" {
            wrong.push(format!("--ensemble: expected with --method piv, not {}", self.method));
        }
        if self.aspect_ratio.is_some() && self.shape != ShapeChoice::Spheroid {
            wrong.push("--aspect-ratio: expected with --shape spheroid".to_owned());
        }
        if !wrong.is_empty() {
            return Err(Error::Input(wrong));
        }
        // Checked first, because tracking may take a long time.
        outside_datasets(&self.out)?;
        let tracked = track(
            &self.dataset,
            &self.out,
            &TrackOptions {
                method: self.method.clone(),
                max_displacement_px: self.max_displacement,
                diameter_px: self.diameter,
                noise_px: self.noise_xy,
                noise_um: self.noise_z,
                ensemble: self.ensemble,
                shape: match self.shape {
                    ShapeChoice::Sphere => ParticleShape::Sphere,
                    ShapeChoice::Spheroid => ParticleShape::Spheroid { aspect: self.aspect_ratio },
                },
                seed: common.seed.unwrap_or(0),
                force: common.force,
                progress: progress(common),
            },
        )?;
        warn(&tracked.warnings, common);
        let each =
            tracked.seconds_per_frame.map_or(String::new(), |s| format!(" ({s:.3} s of CPU time per frame)"));
        let notes: String = tracked.notes.iter().map(|note| format!(", {note}")).collect();
        let text = format!(
            "{} rows from {} frames in {:.2} s{each}{notes}, in {}; score it with `microsig evaluate {} {}`",
            tracked.rows,
            tracked.frames,
            tracked.seconds,
            tracked.out.display(),
            self.dataset.display(),
            tracked.out.display()
        );
        report(&text, &tracked, common)
    }
}
