//! Programs that tasks run.

use std::path::PathBuf;
use std::process::{Command, Stdio};

use anyhow::{Context, ensure};

/// The release build of the command: $MICROSIG, or built if necessary.
pub fn microsig() -> anyhow::Result<PathBuf> {
    if let Some(path) = std::env::var_os("MICROSIG") {
        return Ok(path.into());
    }
    let build = ["build", "--release", "--quiet", "--package", "microsig", "--message-format", "json"];
    // The cargo that runs this task, to avoid a rebuild by another toolchain.
    let cargo = std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into());
    let output = Command::new(cargo).args(build).stderr(Stdio::inherit()).output()?;
    ensure!(output.status.success(), "the command could not be built");
    // Cargo reports its target directory.
    String::from_utf8(output.stdout)?
        .lines()
        .filter_map(|line| serde_json::from_str::<serde_json::Value>(line).ok())
        .filter_map(|message| message["executable"].as_str().map(Into::into))
        .next_back()
        .context("cargo names the executable")
}
