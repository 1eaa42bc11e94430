//! `microsig view` in a real browser: Playwright on Chromium (`tests/web`).

use std::path::{Path, PathBuf};
use std::process::Command;

use anyhow::{Context, bail, ensure};

/// Tests the pages of a build of the command, or makes screenshots of them in a folder; installs what is
/// missing.
///
/// # Errors
/// What cannot be installed; tests that fail.
pub fn run(microsig: &Path, shots: Option<&Path>) -> anyhow::Result<()> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("web");
    let chromium = chromium()?;
    // Debian's packages; other sources of Node.js bring npm along.
    install("node", "nodejs")?;
    install("npm", "npm")?;
    if !folder.join("node_modules/playwright-core/package.json").is_file() {
        succeed(Command::new("npm").arg("ci").current_dir(&folder))?;
    }
    let mut node = Command::new("node");
    match shots {
        Some(out) => node.arg("shots.mjs").arg(std::path::absolute(out)?),
        None => node.args(["--test", "--test-reporter=spec"]),
    };
    let status = node.current_dir(&folder).env("MICROSIG", microsig).env("CHROMIUM", chromium).status()?;
    ensure!(status.success(), "tests of the pages failed");
    Ok(())
}

/// The browser: as `CHROMIUM` says, or Debian's.
fn chromium() -> anyhow::Result<PathBuf> {
    if let Some(path) = std::env::var_os("CHROMIUM") {
        return Ok(path.into());
    }
    install("chromium", "chromium")?;
    find("chromium").context("no chromium after its package was installed")
}

/// Installs a package if a program is missing.
fn install(program: &str, package: &str) -> anyhow::Result<()> {
    if find(program).is_some() {
        return Ok(());
    }
    succeed(Command::new("apt-get").args(["update", "--quiet"]))?;
    succeed(
        Command::new("apt-get")
            .args(["install", "--yes", "--quiet", "--no-install-recommends", package])
            .env("DEBIAN_FRONTEND", "noninteractive"),
    )
}

fn find(program: &str) -> Option<PathBuf> {
    let path = std::env::var_os("PATH")?;
    std::env::split_paths(&path).map(|folder| folder.join(program)).find(|file| file.is_file())
}

fn succeed(command: &mut Command) -> anyhow::Result<()> {
    let status = command.status().with_context(|| format!("{:?}", command.get_program()))?;
    if !status.success() {
        bail!("{command:?}: {status}");
    }
    Ok(())
}
