//! `microsig optics`: predicts particle images of a scenario's optics, without generating a dataset.

use clap::Args;

use super::Common;
use super::argument::{output, plot_file};
use super::options::{ImageTables, Replace, ScenarioOptions};
use super::output::{progress, report, warn, written};
use super::spheroid_maps;
use generator::preview::{Preview, svg, text};
use storage::OutputFile;
use storage::error::Result;

/// Compute particle images of a scenario's optics over depth: focus, size, light
#[derive(Debug, Args)]
#[command(
    after_help = "Example: microsig optics objective_20x --plot optics.svg",
    group = clap::ArgGroup::new("written").args(["plot", "spheroids"]).multiple(true)
)]
pub(super) struct Optics {
    #[command(flatten)]
    scenario: ScenarioOptions,
    /// Plot one particle of each size over depth, with curves of peak and size (SVG)
    #[arg(long, value_name = "FILE", value_parser = plot_file())]
    plot: Option<OutputFile>,
    /// Tabulate the Cramer-Rao bounds of spheroids over depth and tilt (CSV)
    #[arg(long, value_name = "FILE", value_parser = output())]
    spheroids: Option<OutputFile>,
    /// Their aspect ratios, polar over equatorial diameter, separated by commas [default: that of the scenario]
    #[arg(long, value_name = "RATIOS", value_delimiter = ',', requires = "spheroids")]
    aspect_ratios: Vec<f64>,
    #[command(flatten)]
    replace: Replace,
    #[command(flatten)]
    pub(super) tables: ImageTables,
}

impl Optics {
    pub(super) fn run(&self, common: &Common) -> Result<()> {
        let scenario = self.scenario.load(common)?;
        warn(&scenario.warnings, common);
        if let Some(file) = &self.spheroids {
            file.may_write(self.replace.force)?;
            let table = spheroid_maps::table(&scenario, &self.aspect_ratios, &progress(common))?;
            return file.save(self.replace.force, table.csv());
        }
        let preview = Preview::of(&scenario)?;
        warn(&preview.warnings, common);
        if let Some(file) = &self.plot {
            file.save(self.replace.force, svg(&preview)?)?;
            return written(file, &text(&preview), &preview, common);
        }
        report(&text(&preview), &preview, common)
    }
}
