//! `microsig sweep`: generates the datasets of a sweep.

use std::path::{Path, PathBuf};

use clap::Args;

use super::Common;
use super::options::{ImageTables, Random, Replace, ShardOption};
use super::output::{progress, report, summarize};
use super::sweep_scores::SweepScores;
use generator::runner::{SweepOptions, collect, sweep};
use scenario::ScenarioText;
use storage::InputFile;
use storage::argument::{folder, input};
use storage::error::{Error, Result};

/// Generate many datasets over the axes of a sweep
#[derive(Debug, Args)]
#[command(after_help = "Example: microsig sweep noise_density_sweep --out sweeps/noise --shard 1/4")]
pub(super) struct Sweep {
    /// The sweep (RON or JSON): a file, `-` for standard input, or the name of a shipped one
    #[arg(value_parser = input())]
    sweep: InputFile,
    /// Folder of the sweep [default: datasets/NAME]
    #[arg(long, short, value_name = "DIR", value_parser = folder())]
    out: Option<PathBuf>,
    /// Print the cases of the shard without running them
    #[arg(long)]
    list: bool,
    #[command(flatten)]
    shard: ShardOption,
    /// Only this case, such as case_00003; for workflow managers
    #[arg(long, value_name = "NAME", conflicts_with_all = ["shard", "list", "collect"])]
    case: Option<String>,
    /// Continue an interrupted run; failed cases are tried again
    #[arg(long)]
    resume: bool,
    /// Write the table of all cases once all shards are done, without running any case
    #[arg(long)]
    collect: bool,
    #[command(flatten)]
    scores: SweepScores,
    #[command(flatten)]
    random: Random,
    #[command(flatten)]
    replace: Replace,
    #[command(flatten)]
    tables: ImageTables,
}

impl Sweep {
    pub(super) fn run(&self, common: &Common) -> Result<()> {
        let ScenarioText { text, name, folder, .. } = &ScenarioText::open(&self.sweep)?;
        let plan = scenario::parse_sweep(text, name, folder, self.random.seed)?;
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
        let options = SweepOptions {
            out,
            inputs,
            shard,
            case: self.case.clone(),
            force: self.replace.force,
            resume: self.resume,
            progress: progress(common),
            context: common.context.clone(),
        };
        let swept = sweep(&plan, &options)?;
        let only = self.case.as_ref().map_or_else(|| shard.in_title(), |case| format!(", {case}"));
        let text = format!(
            "sweep {}{only}: {} of {} cases done, {} failed, {} generated now in {:.2} s, in {}",
            plan.spec.name,
            swept.done,
            swept.cases,
            swept.failed,
            swept.made,
            swept.seconds,
            swept.out.display()
        );
        summarize(&text, &swept, common)?;
        let seed = self.random.seed.unwrap_or(0);
        self.scores.run(&options.cases(&plan)?, &swept, &options, seed, common)?;
        // Of a single case, the failures of others are not its own.
        match (&self.case, swept.failed_now, swept.failed) {
            (Some(case), 1.., _) => Err(Error::Failed(vec![format!("{case} failed; see {case}.failed")])),
            (None, _, failed @ 1..) => {
                Err(Error::Failed(vec![format!("{failed} cases failed; see *.failed")]))
            }
            _ => Ok(()),
        }
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
    summarize(&text, &serde_json::json!({ "out": out, "done": done, "failed": failed }), common)
}
