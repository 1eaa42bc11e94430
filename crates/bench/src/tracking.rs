//! The verb `track`: its arguments, and what is said about it.

use std::path::PathBuf;

use bench::track::{Method, Options, track};
use bench::{Error, Result};
use clap::Args;

use crate::cli::Common;
use crate::{report, warn};

/// Arguments of `track`.
#[derive(Debug, Args)]
pub(crate) struct Track {
    /// The dataset's folder, or a split of a challenge
    dataset: PathBuf,
    /// The method
    #[arg(long, value_enum)]
    method: Method,
    /// The result's file (CSV)
    #[arg(long, value_name = "RESULT")]
    out: PathBuf,
    /// Longest way from frame to frame
    #[arg(long, value_name = "PX", default_value_t = 15.0)]
    max_displacement: f64,
    /// Diameter of a spot (spots)
    #[arg(long, value_name = "PX", default_value_t = 3.0)]
    diameter: f64,
    /// Standard deviation of the noise in x and y (truth-noise)
    #[arg(long, value_name = "PX", default_value_t = 0.1)]
    noise_xy: f64,
    /// Standard deviation of the noise in z (truth-noise)
    #[arg(long, value_name = "UM", default_value_t = 1.0)]
    noise_z: f64,
}

/// Runs a baseline tracker.
pub(crate) fn run_track(arguments: &Track, common: &Common) -> Result<()> {
    let wrong: Vec<String> = [
        ("--max-displacement", arguments.max_displacement, f64::MIN_POSITIVE, "a length > 0 px"),
        ("--diameter", arguments.diameter, 0.5, "0.5 to 1000 px"),
        ("--noise-xy", arguments.noise_xy, 0.0, "0 to 1000 px"),
        ("--noise-z", arguments.noise_z, 0.0, "0 to 1000 um"),
    ]
    .into_iter()
    .filter(|(_, value, least, _)| !(*least..=1e3).contains(value))
    .map(|(name, value, _, allowed)| format!("{name} {value}: expected {allowed}"))
    .collect();
    if !wrong.is_empty() {
        return Err(Error::Input(wrong));
    }
    let tracked = track(
        &arguments.dataset,
        &arguments.out,
        &Options {
            method: arguments.method,
            max_displacement_px: arguments.max_displacement,
            diameter_px: arguments.diameter,
            noise_px: arguments.noise_xy,
            noise_um: arguments.noise_z,
            seed: common.seed.unwrap_or(0),
            force: common.force,
        },
    )?;
    warn(&tracked.warnings, common);
    let text = format!(
        "{} rows from {} frames in {:.2} s, in {}; score it with `microsig evaluate {} {}`",
        tracked.rows,
        tracked.frames,
        tracked.seconds,
        tracked.out.display(),
        arguments.dataset.display(),
        tracked.out.display()
    );
    report(&text, &tracked, common)
}
