//! Options that several verbs share; each verb flattens those that it uses.

use clap::{Args, ValueEnum};

use super::Common;
use super::output::{announce, warn};
use generator::runner::Shard;
use scenario::{Assignment, Scenario, ScenarioText};
use storage::error::Result;
use storage::{InputFile, argument};

/// A scenario, with changes.
#[derive(Debug, Args)]
pub(super) struct ScenarioOptions {
    /// The scenario (RON or JSON): a file, `-` for standard input, or the name of a shipped one
    #[arg(value_name = "SCENARIO", value_parser = argument::input())]
    file: InputFile,
    /// Override a value of the scenario, written as in the file; may be repeated
    #[arg(long, value_name = "PATH=VALUE")]
    set: Vec<String>,
    #[command(flatten)]
    random: Random,
}

impl ScenarioOptions {
    /// The scenario.
    pub(super) fn load(&self, common: &Common) -> Result<Scenario> {
        scenario::load(&self.file, &Assignment::all(&self.set)?, self.random.seed, &common.context)
    }

    /// The scenario, then other ones with the same changes, and variants of the first with one more change (`PATH=VALUE`),
    /// each with its name.
    pub(super) fn load_all(
        &self,
        others: &[InputFile],
        variants: &[String],
        common: &Common,
    ) -> Result<Vec<(String, Scenario)>> {
        let (set, first) = (Assignment::all(&self.set)?, ScenarioText::open(&self.file)?);
        let load = |text: &ScenarioText, set: &[Assignment]| {
            let place = (text.name.as_str(), text.folder.as_path());
            scenario::load_text(&text.text, place, set, self.random.seed, &common.context)
        };
        let named = |scenario: Scenario| (scenario.spec.name.clone(), scenario);
        let mut all = vec![named(load(&first, &set)?)];
        for other in others {
            all.push(named(load(&ScenarioText::open(other)?, &set)?));
        }
        for variant in Assignment::all(variants)? {
            let key = variant.path.rsplit('.').next().unwrap_or_default();
            let name = format!("{key} = {}", variant.value);
            all.push((name, load(&first, &[set.as_slice(), &[variant]].concat())?));
        }
        Ok(all)
    }
}

/// The seed of verbs that generate a scenario or sweep.
#[derive(Debug, Args)]
pub(super) struct Random {
    /// Seed of all random numbers [default: the seed of the scenario or sweep, otherwise 0]
    #[arg(long, value_name = "N", value_parser = argument::seed)]
    pub(super) seed: Option<u64>,
}

/// The seed of verbs that draw random numbers for something else.
#[derive(Debug, Args)]
pub(super) struct Drawing {
    /// Seed of all random numbers
    #[arg(long, value_name = "N", value_parser = argument::seed, default_value_t = 0)]
    pub(super) seed: u64,
}

/// What verbs do that write files.
#[derive(Debug, Args)]
pub(super) struct Replace {
    /// Replace existing output
    #[arg(long, short)]
    pub(super) force: bool,
}

/// The cache of verbs that compute images.
#[derive(Debug, Args)]
pub(super) struct ImageTables {
    /// Recompute the image tables of `expected` and `waves`, and do not store them (see MICROSIG_CACHE)
    #[arg(long)]
    no_cache: bool,
}

/// How progress is reported.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, ValueEnum)]
pub(super) enum ProgressStyle {
    /// Bars on a terminal, otherwise lines
    #[default]
    Auto,
    /// A line every minute, with the time left
    Lines,
    /// A JSON object per line, at most one a second for each task
    Json,
}

/// The share of the cases or datasets that one process handles.
#[derive(Debug, Args)]
pub(super) struct ShardOption {
    /// Only every N-th one, starting at the K-th; `slurm`: the share of this task of a Slurm array [default:
    /// all]
    #[arg(long, value_name = "K/N|slurm")]
    shard: Option<String>,
}

impl ShardOption {
    /// The shard, which is announced even with `--quiet`: a share must not be mistaken for the whole.
    pub(super) fn read(&self, common: &Common) -> Result<Shard> {
        let variable = |name: &str| std::env::var(name).ok();
        let shard = match self.shard.as_deref() {
            Some("slurm") => Shard::of_slurm(variable)?,
            Some(text) => Shard::parse(text)?,
            None => {
                let tasks = variable("SLURM_ARRAY_TASK_COUNT").filter(|tasks| tasks.trim() != "1");
                let note = tasks.map(|tasks| {
                    format!(
                        "this is one of {tasks} tasks of a Slurm array but does all of the work; --shard slurm does only its share"
                    )
                });
                warn(note.as_slice(), common);
                Shard::ALL
            }
        };
        if shard != Shard::ALL {
            announce(&format!("shard {shard}"));
        }
        Ok(shard)
    }
}
