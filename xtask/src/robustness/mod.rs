//! Robustness: killed runs, full disks, long sequences, a cluster scheduler. Each task writes a record, with
//! the exact commands, for `results/`.

pub(crate) mod disk;
pub(crate) mod kill;
pub(crate) mod memory;
pub(crate) mod pairs;
pub(crate) mod slurm;

use std::path::Path;

use anyhow::Context;

/// Writes a record.
fn record(out: &Path, name: &str, text: &str) -> anyhow::Result<()> {
    std::fs::create_dir_all(out)?;
    let path = out.join(name);
    std::fs::write(&path, text).with_context(|| path.display().to_string())?;
    println!("{}", path.display());
    Ok(())
}
