//! Comparisons with third-party programs and with independent Monte Carlo: `cargo validate <what>`.
#![expect(clippy::print_stdout, reason = "a comparison reports its result")]

mod curves;
mod expected;
mod fit;
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
}

fn main() -> anyhow::Result<ExitCode> {
    match Cli::parse().comparison {
        Comparison::Expected(comparison) => expected::run(&comparison),
        Comparison::Waves { out } => waves::run(&out),
        Comparison::Fit(comparison) => fit::run(&comparison),
    }
}
