//! `cargo validate`: fits calibration scans with known truth, many simulated scans, and real beads.

mod beads;
mod cases;
mod coverage;
mod montage;
mod quantity;
mod trackers;

use std::path::PathBuf;
use std::process::ExitCode;

use anyhow::Context;
use clap::{Parser, ValueEnum};
use suite::process;
use suite::template::fill;

/// Fits calibration scans with known truth, many simulated scans, and real beads; exit code 1 if a limit is exceeded.
#[derive(Parser)]
#[command(name = "cargo validate")]
pub(crate) struct Comparison {
    /// Folder with `own` (scans with truth) and `real` (scans of single beads).
    dir: PathBuf,
    /// Output folder of the tables and README.md. Seeds in its `coverage.csv` are not fitted again: remove it
    /// after a change of the fit.
    #[arg(long, default_value = "target/fit")]
    out: PathBuf,
    /// Number of simulated scans of each case of the coverage.
    #[arg(long, default_value_t = 40)]
    seeds: u64,
    /// Cases of the coverage to fit [default: all].
    #[arg(long, value_delimiter = ',')]
    only: Vec<String>,
    /// Parts to run; the tables of the others are taken from the output folder.
    #[arg(long, value_enum, value_delimiter = ',', default_value = "cases,coverage,beads,trackers")]
    parts: Vec<Part>,
}

/// A part of the comparison.
#[derive(Clone, Copy, PartialEq, ValueEnum)]
enum Part {
    /// Scans with truth.
    Cases,
    /// Coverage of the truth by intervals over many seeds.
    Coverage,
    /// Real beads, by waves.
    Beads,
    /// Trackers on real beads.
    Trackers,
}

pub(crate) fn run(comparison: &Comparison) -> anyhow::Result<ExitCode> {
    let Comparison { dir, out, seeds, only, parts } = comparison;
    std::fs::create_dir_all(out).with_context(|| out.display().to_string())?;
    let program = process::microsig()?;
    if parts.contains(&Part::Cases) {
        cases::run(&program, &dir.join("own"), &out.join("cases.csv"), &out.join("runs.csv"))?;
    }
    if parts.contains(&Part::Coverage) {
        coverage::run(&dir.join("own"), *seeds, only, &out.join("coverage.csv"))?;
    }
    if parts.contains(&Part::Beads) {
        beads::run(&program, &dir.join("real"), out)?;
    }
    if parts.contains(&Part::Trackers) {
        trackers::run(&program, &dir.join("real"), out)?;
    }
    let (cases, missed) = cases::table(&out.join("cases.csv"))?;
    let (coverage, outside) = coverage::table(&out.join("coverage.csv"))?;
    let (beads, above) = beads::table(&out.join("beads.csv"))?;
    let values = [
        ("version", env!("CARGO_PKG_VERSION")),
        ("machine", &process::machine()),
        ("missed", &missed.to_string()),
        ("cases", &cases),
        ("runs", &cases::runs(&out.join("runs.csv"))?),
        ("coverage", &coverage),
        ("outside", &outside.to_string()),
        ("beads", &beads),
        ("above", &above.to_string()),
        ("trackers", &trackers::table(&out.join("trackers.csv"))?),
    ];
    std::fs::write(out.join("README.md"), fill(include_str!("fit.md"), &values))?;
    println!("limits exceeded: {missed} in cases, {outside} in coverage, {above} for beads");
    Ok(if missed + outside + above == 0 { ExitCode::SUCCESS } else { ExitCode::FAILURE })
}
