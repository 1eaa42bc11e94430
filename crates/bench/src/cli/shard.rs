//! `--shard`: the share of the cases or datasets that one process handles.

use clap::Args;

use super::Common;
use super::output::{announce, warn};
use generator::runner::Shard;
use storage::error::Result;

/// The option `--shard`.
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
