//! Figures 3 and 4 of Rossi (2020), reproduced.

mod maxima;
mod scenes;
mod strips;

use std::path::Path;

use anyhow::Context;

/// Draws the figures into a folder, with their data and README.md.
pub(super) fn run(out: &Path) -> anyhow::Result<()> {
    std::fs::create_dir_all(out).with_context(|| out.display().to_string())?;
    strips::draw(out)?;
    maxima::draw(out)?;
    scenes::draw(out)?;
    let command = format!("cargo xtask figures paper --out {}", out.display());
    let readme = include_str!("paper/README.md")
        .replace("{command}", &command)
        .replace("{version}", env!("CARGO_PKG_VERSION"));
    std::fs::write(out.join("README.md"), readme)?;
    println!("{}", out.display());
    Ok(())
}
