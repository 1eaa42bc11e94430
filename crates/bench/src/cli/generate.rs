//! `microsig generate`: generates a dataset from a scenario.

use std::path::{Path, PathBuf};

use clap::Args;

use super::Common;
use super::options::{ImageTables, Replace, ScenarioOptions};
use super::output::{progress, report, summarize, warn};
use generator::runner::{Cost, GenerateOptions, generate_or_find};
use storage::argument::folder;
use storage::error::Result;

/// Generate a dataset from a scenario: particles, images, ground truth, manifest
#[derive(Debug, Args)]
#[command(
    after_help = "Example: microsig generate quickstart --set optics.background_noise=50 --out datasets/noisy"
)]
pub(super) struct Generate {
    #[command(flatten)]
    scenario: ScenarioOptions,
    /// Folder of the dataset [default: datasets/NAME]
    #[arg(long, short, value_name = "DIR", value_parser = folder())]
    out: Option<PathBuf>,
    /// Continue an interrupted run; a finished dataset is left unchanged
    #[arg(long)]
    resume: bool,
    /// Print the expected frames, particles, run time, memory and disk space without writing anything
    #[arg(long)]
    dry_run: bool,
    #[command(flatten)]
    replace: Replace,
    #[command(flatten)]
    tables: ImageTables,
}

impl Generate {
    pub(super) fn run(&self, common: &Common) -> Result<()> {
        let scenario = self.scenario.load(common)?;
        warn(&scenario.warnings, common);
        let out = self.out.clone().unwrap_or_else(|| Path::new("datasets").join(&scenario.spec.name));
        if self.dry_run {
            let cost = Cost::of(&scenario, &out)?;
            cost.check_resources(&scenario)?;
            let cost = cost.timed(&scenario)?;
            return report(&cost.text(), &cost, common);
        }
        let options = GenerateOptions {
            out,
            force: self.replace.force,
            resume: self.resume,
            progress: progress(common),
        };
        let Some(generated) = generate_or_find(&scenario, &options)? else {
            let (name, out) = (&scenario.spec.name, &options.out);
            let text = format!("dataset {name} already exists in {}", out.display());
            return summarize(&text, &serde_json::json!({ "name": name, "out": out }), common);
        };
        // The scenario's own warnings have been printed already; only later ones remain.
        warn(&generated.warnings[scenario.warnings.len()..], common);
        let streaks = match generated.max_streak_px {
            px if px >= 0.01 => format!(", streaks of up to {px:.2} px"),
            _ => String::new(),
        };
        let text = format!(
            "dataset {}: {} images, {:.1} particles in view on average, {} displacements of up to {:.2} px{streaks}, in {:.2} s, in {}\n{}\n{}",
            generated.name,
            generated.images,
            generated.particles as f64 / f64::from(generated.images.max(1)),
            generated.displacements,
            generated.max_displacement_px,
            generated.seconds,
            generated.out.display(),
            generated.optics[0],
            generated.optics[1]
        );
        summarize(&text, &generated, common)
    }
}
