//! `microsig sweep`: generates the datasets of a sweep.

use std::path::{Path, PathBuf};

use clap::Args;

use super::Common;
use super::output::{progress, report};
use super::shard::ShardOption;
use super::sweep_scores::SweepScores;
use generator::runner::{SweepOptions, collect, sweep};
use scenario;
use storage::error::{Error, Result};

/// Generate many datasets over the axes of a sweep
#[derive(Debug, Args)]
#[command(
    after_help = "Example: microsig sweep scenarios/noise_density_sweep.ron --out sweeps/noise --shard 1/4"
)]
pub(super) struct Sweep {
    /// The sweep (RON)
    sweep: PathBuf,
    /// Folder of the sweep [default: datasets/NAME]
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Print the cases of the shard without running them
    #[arg(long)]
    list: bool,
    #[command(flatten)]
    shard: ShardOption,
    /// Continue an interrupted run; failed cases are tried again
    #[arg(long)]
    resume: bool,
    /// Write the table of all cases once all shards are done, without running any case
    #[arg(long)]
    collect: bool,
    #[command(flatten)]
    scores: SweepScores,
}

impl Sweep {
    pub(super) fn run(&self, common: &Common) -> Result<()> {
        let path = &self.sweep;
        let text = scenario::read_text(path)?;
        let folder = path.parent().unwrap_or(Path::new("."));
        let plan = scenario::parse_sweep(&text, &path.display().to_string(), folder, common.seed)?;
        if self.list {
            return self.list(&plan, common);
        }
        let out = self.out.clone().unwrap_or_else(|| Path::new("datasets").join(&plan.spec.name));
        self.scores.check(&out)?;
        if self.collect {
            return collected(&plan, &out, common);
        }
        let shard = self.shard.read(common)?;
        // Paths are relative to the base scenario, which may be in another folder.
        let inputs = folder.join(&plan.spec.base).parent().unwrap_or(folder).to_owned();
        let (force, resume, progress) = (common.force, self.resume, progress(common));
        let swept = sweep(&plan, &SweepOptions { out, inputs, shard, force, resume, progress })?;
        let text = format!(
            "sweep {}{}: {} of {} cases done, {} failed, {} generated now in {:.2} s, in {}",
            plan.spec.name,
            shard.in_title(),
            swept.done,
            swept.cases,
            swept.failed,
            swept.made,
            swept.seconds,
            swept.out.display()
        );
        report(&text, &swept, common)?;
        self.scores.run(&plan, shard, &swept, self.resume, common)?;
        if swept.failed > 0 {
            return Err(Error::Failed(vec![format!("{} cases failed; see *.failed", swept.failed)]));
        }
        Ok(())
    }

    fn list(&self, plan: &scenario::Sweep, common: &Common) -> Result<()> {
        let shard = self.shard.read(common)?;
        let cases: Vec<&scenario::Case> = plan.cases.iter().filter(|case| shard.has(case.index)).collect();
        let line = |c: &&scenario::Case| {
            let values = plan.spec.axes.iter().zip(&c.values).map(|(a, v)| format!("{}={v}", a.path));
            format!("{}  seed={}  {}", c.name, c.seed, values.collect::<Vec<_>>().join("  "))
        };
        report(&cases.iter().map(line).collect::<Vec<_>>().join("\n"), &cases, common)
    }
}

/// Writes the table of all cases of a finished sweep.
fn collected(plan: &scenario::Sweep, out: &Path, common: &Common) -> Result<()> {
    let (done, failed) = collect(plan, out)?;
    let missing = plan.cases.len() - done - failed;
    if missing > 0 {
        return Err(Error::Failed(vec![format!(
            "{}: {missing} cases are missing, so no table is written",
            out.display()
        )]));
    }
    let text = format!("{}: {done} cases done, {failed} failed", out.join("cases.csv").display());
    report(&text, &serde_json::json!({ "out": out, "done": done, "failed": failed }), common)
}
