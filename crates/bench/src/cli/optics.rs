//! `microsig optics`: predicts particle images of a scenario's optics, without generating a dataset.

use std::path::PathBuf;

use clap::Args;

use super::Common;
use super::argument::plot_file;
use super::output::{progress, report, warn};
use super::spheroid_maps;
use generator::preview::{Preview, svg, text};
use scenario;
use storage::error::Result;
use storage::{may_write, save_result};

/// Compute particle images of a scenario's optics over depth: focus, size, light
#[derive(Debug, Args)]
#[command(after_help = "Example: microsig optics scenarios/objective_20x.ron --plot optics.svg")]
pub(super) struct Optics {
    /// The scenario (RON)
    scenario: PathBuf,
    /// Override a value of the scenario, written as in the file; may be repeated
    #[arg(long, value_name = "PATH=VALUE")]
    set: Vec<String>,
    /// Plot one particle of each size over depth, with curves of peak and size (SVG)
    #[arg(long, value_name = "FILE", value_parser = plot_file())]
    plot: Option<PathBuf>,
    /// Tabulate the Cramer-Rao bounds of spheroids over depth and tilt (CSV)
    #[arg(long, value_name = "FILE")]
    spheroids: Option<PathBuf>,
    /// Their aspect ratios, polar over equatorial diameter, separated by commas [default: that of the scenario]
    #[arg(long, value_name = "RATIOS", value_delimiter = ',', requires = "spheroids")]
    aspect_ratios: Vec<f64>,
}

impl Optics {
    pub(super) fn run(&self, common: &Common) -> Result<()> {
        let scenario = scenario::load(&self.scenario, &self.set, common.seed)?;
        warn(&scenario.warnings, common);
        if let Some(file) = &self.spheroids {
            may_write(file, common.force)?;
            let table = spheroid_maps::table(&scenario, &self.aspect_ratios, &progress(common))?;
            return save_result(file, common.force, table.csv().as_bytes());
        }
        let preview = Preview::of(&scenario)?;
        warn(&preview.warnings, common);
        if let Some(file) = &self.plot {
            save_result(file, common.force, svg(&preview)?.as_bytes())?;
        }
        report(&text(&preview), &preview, common)
    }
}
