//! The gallery of velocity fields in the documentation: a plot by `microsig flows` of every field.

use std::fmt::Write;
use std::path::Path;
use std::process::Command;

use anyhow::{Context, ensure};
use serde_json::Value;

use suite::process;

/// Draws all fields into a folder and writes its README.md.
pub(super) fn run(out: &Path) -> anyhow::Result<()> {
    std::fs::create_dir_all(out)?;
    let program = process::microsig()?;
    let list: Value = serde_json::from_str(&said(&program, &["flows", "--json"])?)?;
    let mut text = String::from(
        "# The velocity fields\n\nMade by `cargo xtask figures flows`: speed and streamlines of every field's default in the default \
         scene, a channel 100 um deep seen under setting 1. Compositions show an example. `microsig flows NAME` says the same.\n",
    );
    let entries = list.as_array().context("microsig flows lists fields")?;
    for entry in entries {
        let field = |key: &str| entry[key].as_str().unwrap_or_default().to_owned();
        let name = field("name");
        let file = out.join(format!("{name}.svg"));
        said(&program, &["flows", &name, "--force", "--plot", file.to_str().context("a path in UTF-8")?])?;
        writeln!(text, "\n## {name}\n\n`{}`\n\nSource: {}\n", field("formula"), field("source"))?;
        let parameters = entry["parameters"].as_array().map(Vec::as_slice).unwrap_or_default();
        if !parameters.is_empty() {
            writeln!(text, "| parameter | default | range | meaning |\n|---|---|---|---|")?;
        }
        for parameter in parameters {
            let cell = |key: &str| parameter[key].as_str().unwrap_or_default().replace('|', "\\|");
            let (name, default) = (cell("name"), cell("default"));
            writeln!(text, "| `{name}` | {default} | {} | {} |", cell("range"), cell("meaning"))?;
        }
        writeln!(text, "\n![{name}]({name}.svg)")?;
    }
    std::fs::write(out.join("README.md"), text)?;
    println!("{}: {} fields", out.display(), entries.len());
    Ok(())
}

/// Runs the command and returns its standard output.
fn said(program: &Path, arguments: &[&str]) -> anyhow::Result<String> {
    let output = Command::new(program).args(arguments).output()?;
    ensure!(output.status.success(), "microsig {arguments:?}: {}", String::from_utf8_lossy(&output.stderr));
    Ok(String::from_utf8(output.stdout)?)
}
