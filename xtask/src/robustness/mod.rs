//! Robustness: killed runs, full disks, other processors, long sequences, a cluster scheduler. Each task
//! writes a record, with the exact commands, for `results/`.

pub(crate) mod disk;
pub(crate) mod emulation;
pub(crate) mod kill;
pub(crate) mod memory;
pub(crate) mod mutations;
pub(crate) mod pairs;
pub(crate) mod slurm;

use std::path::Path;
use std::process::ExitCode;

use anyhow::Context;

/// Runs the parts of the campaign with these numbers of changed inputs, pairs and kills.
pub(crate) fn run(
    out: &Path,
    (mutations, pairs, kills): (u32, u32, u32),
    seed: u64,
) -> anyhow::Result<ExitCode> {
    let mut codes = Vec::new();
    if mutations > 0 {
        codes.push(mutations::run(out, mutations, seed)?);
    }
    if pairs > 0 {
        codes.push(pairs::run(out, pairs, seed)?);
    }
    if kills > 0 {
        codes.push(kill::run(out, kills)?);
    }
    let found = codes.contains(&ExitCode::FAILURE);
    Ok(if found { ExitCode::FAILURE } else { ExitCode::SUCCESS })
}

/// Writes a record.
fn record(out: &Path, name: &str, text: &str) -> anyhow::Result<()> {
    std::fs::create_dir_all(out)?;
    let path = out.join(name);
    std::fs::write(&path, text).with_context(|| path.display().to_string())?;
    println!("{}", path.display());
    Ok(())
}
