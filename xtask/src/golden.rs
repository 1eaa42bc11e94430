//! Golden hashes: what the datasets of `tests/data/golden` are, byte for byte, made with a release build.

use std::path::Path;
use std::process::Command;

use anyhow::{Context, ensure};

use crate::process;

/// Makes every dataset of the folder and writes the hashes of their SHA256SUMS.
pub(crate) fn run() -> anyhow::Result<()> {
    let folder = suite::data().join("golden");
    let program = process::microsig()?;
    let place = tempfile::tempdir()?;
    let mut lines = Vec::new();
    for entry in std::fs::read_dir(&folder)? {
        let scenario = entry?.path();
        if scenario.extension().is_some_and(|e| e == "ron") {
            let name = scenario.file_stem().context("a file has a name")?.to_string_lossy().into_owned();
            let out = place.path().join(&name);
            generate(&program, &scenario, &out)?;
            lines.push(format!("{}  {name}\n", suite::sha256(&out.join("SHA256SUMS"))?));
        }
    }
    lines.sort_by(|a, b| a[64..].cmp(&b[64..]));
    let path = folder.join("golden.txt");
    std::fs::write(&path, lines.concat())?;
    println!("{}: {} hashes", path.display(), lines.len());
    Ok(())
}

fn generate(program: &Path, scenario: &Path, out: &Path) -> anyhow::Result<()> {
    let status =
        Command::new(program).args(["generate", "--quiet"]).arg(scenario).arg("--out").arg(out).status()?;
    ensure!(status.success(), "{} could not be generated", scenario.display());
    Ok(())
}
