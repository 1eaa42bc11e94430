//! `cargo xtask golden`: stores the hashes of the datasets of `tests/data/golden`, generated with a release
//! build.

use std::path::Path;
use std::process::Command;

use anyhow::{Context, ensure};
use suite::golden::{Golden, Hashes};

use suite::process;

/// Generates every dataset of the folder and stores its hashes; refuses changed bytes for a released version.
pub(crate) fn run() -> anyhow::Result<()> {
    let program = process::microsig()?;
    let place = tempfile::tempdir()?;
    let before = Golden::read()?;
    let mut now = Golden { version: env!("CARGO_PKG_VERSION").to_owned(), ..Golden::default() };
    for entry in std::fs::read_dir(Golden::folder())? {
        let scenario = entry?.path();
        if scenario.extension().is_some_and(|e| e == "ron") {
            let name = scenario.file_stem().context("a file has a name")?.to_string_lossy().into_owned();
            let out = place.path().join(&name);
            generate(&program, &scenario, &out)?;
            now.datasets.insert(name, Hashes::of(&out)?);
        }
    }
    if let Some(refusal) = before.refusal(&now) {
        anyhow::bail!(refusal);
    }
    let (images, others) = before.changed(&now);
    now.write()?;
    println!("{} datasets of version {}, {} before", now.datasets.len(), now.version, before.version);
    println!("image bits changed: {}", images.join(", "));
    println!("only other files changed: {}", others.join(", "));
    Ok(())
}

fn generate(program: &Path, scenario: &Path, out: &Path) -> anyhow::Result<()> {
    let status =
        Command::new(program).args(["generate", "--quiet"]).arg(scenario).arg("--out").arg(out).status()?;
    ensure!(status.success(), "{} could not be generated", scenario.display());
    Ok(())
}
