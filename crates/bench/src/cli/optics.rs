//! `microsig optics`: predicts what the optics of scenarios can measure, without generating a dataset.

use clap::Args;

use super::Common;
use super::options::{ImageTables, Replace, ScenarioOptions};
use super::output::{progress, report, save_picture, warn, written};
use super::spheroid_maps;
use crate::optics::{self, MOST, svg};
use serde::Serialize;
use storage::argument::{input, output, plot_file};
use storage::error::{Error, Result};
use storage::{InputFile, OutputFile};

/// Compute what the optics of scenarios can measure: images over depth, bounds of the position, usable depths and densities
#[derive(Debug, Args)]
#[command(
    after_help = "Example: microsig optics objective_20x --plot optics.svg\n\
                  Example: microsig optics objective_20x objective_20x_cylinder --plot both.png\n\
                  Example: microsig optics mine.ron --variant 'optics.cylinder=lens(focal_length_mm: 1000, to_sensor_mm: 70)'",
    group = clap::ArgGroup::new("written").args(["plot", "spheroids"]).multiple(true)
)]
pub(super) struct Optics {
    #[command(flatten)]
    scenario: ScenarioOptions,
    /// Further scenarios to compare with the first one
    #[arg(value_name = "OTHER", value_parser = input(), conflicts_with = "spheroids")]
    others: Vec<InputFile>,
    /// Compare with the first scenario with another value; may be repeated
    #[arg(long, value_name = "PATH=VALUE", conflicts_with = "spheroids")]
    variant: Vec<String>,
    /// Plot particle images over depth, with curves of peak, size and bounds: SVG, or PNG for a column of 85 mm
    #[arg(long, value_name = "FILE", value_parser = plot_file())]
    plot: Option<OutputFile>,
    /// Tabulate the Cramer-Rao bounds of spheroids over depth and tilt (CSV)
    #[arg(long, value_name = "FILE", value_parser = output())]
    spheroids: Option<OutputFile>,
    /// Their aspect ratios, polar over equatorial diameter, separated by commas [default: the scenario's]
    #[arg(long, value_name = "RATIOS", value_delimiter = ',', requires = "spheroids")]
    aspect_ratios: Vec<f64>,
    #[command(flatten)]
    replace: Replace,
    #[command(flatten)]
    tables: ImageTables,
}

impl Optics {
    pub(super) fn run(&self, common: &Common) -> Result<()> {
        let scenarios = self.scenario.load_all(&self.others, &self.variant, common)?;
        if let (Some(file), [(_, scenario), ..]) = (&self.spheroids, &scenarios[..]) {
            warn(&scenario.warnings, common);
            file.may_write(self.replace.force)?;
            let table = spheroid_maps::table(scenario, &self.aspect_ratios, &progress(common))?;
            return file.save(self.replace.force, table.csv());
        }
        if scenarios.len() > MOST {
            return Err(Error::input(format!("{} scenarios: expected at most {MOST}", scenarios.len())));
        }
        let mut all = Vec::new();
        for (label, scenario) in &scenarios {
            let found = optics::Optics { label: label.clone(), ..optics::Optics::of(scenario)? };
            let own = scenario.warnings.iter().map(ToString::to_string);
            let named = |text: String| if scenarios.len() > 1 { format!("{label}: {text}") } else { text };
            warn(own.chain(found.preview.warnings.iter().cloned()).map(named), common);
            all.push(found);
        }
        let (text, value) = match &all[..] {
            [one] => (optics::text(one), serde_json::to_value(one)),
            several => {
                (optics::side_by_side(several), serde_json::to_value(Scenarios { scenarios: several }))
            }
        };
        let value = value.map_err(|e| Error::input(e.to_string()))?;
        let Some(file) = &self.plot else { return report(&text, &value, common) };
        save_picture(file, self.replace.force, &svg(&all)?)?;
        written(file, &text, &value, common)
    }
}

/// Several scenarios as JSON.
#[derive(Serialize)]
struct Scenarios<'a> {
    scenarios: &'a [optics::Optics],
}
