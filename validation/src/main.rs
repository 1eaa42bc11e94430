//! Comparisons with third-party programs and with independent Monte Carlo: `cargo validate <what>`.
#![expect(clippy::print_stdout, reason = "a comparison reports its result")]

mod curves;
mod expected;
mod exports;
mod fit;
mod original;
mod waves;

use std::path::PathBuf;
use std::process::ExitCode;

use clap::{Parser, Subcommand};

/// Comparisons with third-party programs and with independent Monte Carlo.
#[derive(Parser)]
#[command(name = "cargo validate")]
struct Cli {
    #[command(subcommand)]
    comparison: Comparison,
}

#[derive(Subcommand)]
enum Comparison {
    /// Compares images with those of the original MicroSIG in a folder; exit code 1 if a limit is exceeded.
    Original {
        /// Folder with summary.csv and a folder of settings, data files and mean images for each case.
        dir: PathBuf,
        /// Output folder of checks.csv and README.md.
        #[arg(long, default_value = "target/original")]
        out: PathBuf,
        /// Number of images to average for each case.
        #[arg(long, default_value_t = 200)]
        images: u32,
    },
    /// Compares expected images with the mean of very many rays; exit code 1 if one differs.
    Expected(expected::Comparison),
    /// Compares wave optics with rays at short wavelengths and with theory in focus; exit code 1 if a limit
    /// is missed.
    Waves {
        /// Output folder of pictures and README.md.
        #[arg(long, default_value = "target/waves")]
        out: PathBuf,
    },
    /// Fits calibration scans with known truth, many simulated scans, and real beads; exit code 1 if a limit
    /// is exceeded.
    Fit(fit::Comparison),
    /// Opens exports, images and a release with the programs they are intended for, in a separate Python
    /// environment.
    Exports {
        /// Output folder of README.md.
        #[arg(long, default_value = "target/exports")]
        out: PathBuf,
        /// ImageJ's `ij.jar`, to open images with ImageJ too (needs `java`, a JDK).
        #[arg(long, value_name = "ij.jar")]
        imagej: Option<PathBuf>,
    },
}

fn main() -> anyhow::Result<ExitCode> {
    match Cli::parse().comparison {
        Comparison::Original { dir, out, images } => original::run(&dir, &out, images),
        Comparison::Expected(comparison) => expected::run(&comparison),
        Comparison::Waves { out } => waves::run(&out),
        Comparison::Fit(comparison) => fit::run(&comparison),
        Comparison::Exports { out, imagej } => {
            exports::run(&out, imagej.as_deref()).map(|()| ExitCode::SUCCESS)
        }
    }
}
