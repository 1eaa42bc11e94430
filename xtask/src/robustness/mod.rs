//! What happens when things go wrong: killed runs, full disks, long sequences, a cluster's scheduler. Each task writes its
//! record, with the exact commands, into a folder of `results/`.

pub(crate) mod disk;
pub(crate) mod kill;
pub(crate) mod memory;
pub(crate) mod slurm;

use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use anyhow::{Context, ensure};

/// The command in release: that of $MICROSIG, or built.
fn release_build() -> anyhow::Result<PathBuf> {
    if let Some(path) = std::env::var_os("MICROSIG") {
        return Ok(path.into());
    }
    let output = Command::new(env!("CARGO"))
        .args([
            "build",
            "--release",
            "--quiet",
            "--package",
            "bench",
            "--bin",
            "microsig",
            "--message-format=json",
        ])
        .stderr(Stdio::inherit())
        .output()?;
    ensure!(output.status.success(), "microsig does not build");
    String::from_utf8(output.stdout)?
        .lines()
        .filter_map(|line| serde_json::from_str::<serde_json::Value>(line).ok())
        .find_map(|message| message["executable"].as_str().map(PathBuf::from))
        .context("cargo names the binary")
}

/// Writes a record.
fn record(out: &Path, name: &str, text: &str) -> anyhow::Result<()> {
    std::fs::create_dir_all(out)?;
    let path = out.join(name);
    std::fs::write(&path, text).with_context(|| path.display().to_string())?;
    println!("{}", path.display());
    Ok(())
}
