//! `cargo xtask speed-table`: the table of speed in README.md, from the records of `bench` and `peers`.

use std::collections::BTreeMap;
use std::fmt::Write;
use std::path::Path;

use anyhow::Context;

use crate::process::median;

/// What stands around the table in README.md.
const MARKS: [&str; 2] = ["<!-- speed: made by `cargo xtask speed-table` -->\n", "<!-- end of speed -->"];

/// Replaces the table by that of the records in two folders.
pub(crate) fn run(performance: &Path, peers: &Path) -> anyhow::Result<()> {
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("../README.md");
    let readme = std::fs::read_to_string(&file)?;
    let (before, rest) = readme.split_once(MARKS[0]).context("README.md has a place for the table")?;
    let (_, after) = rest.split_once(MARKS[1]).context("README.md says where the table ends")?;
    let mut table = "| | measured | bar or goal |\n|---|---|---|\n".to_owned();
    promises(&mut table, &performance.join("summary.csv"))?;
    pairs(&mut table, &peers.join("runs.csv"))?;
    let record = std::fs::read_to_string(performance.join("README.md"))?;
    let machine = record.lines().find(|line| line.starts_with("On ")).unwrap_or_default();
    writeln!(table, "\n{machine}")?;
    std::fs::write(&file, format!("{before}{}{table}{}{after}", MARKS[0], MARKS[1]))?;
    Ok(())
}

/// The rows that `bench` wrote.
fn promises(table: &mut String, summary: &Path) -> anyhow::Result<()> {
    for row in csv::Reader::from_path(summary).with_context(|| summary.display().to_string())?.deserialize() {
        let (what, measured, unit, bar, met): (String, f64, String, f64, String) = row?;
        let missed = if met == "yes" { "" } else { " (missed)" };
        writeln!(table, "| {what} | {measured:.3}{unit}{missed} | {bar}{unit} |")?;
    }
    Ok(())
}

/// In-focus pairs against other generators, by medians of all runs.
fn pairs(table: &mut String, runs: &Path) -> anyhow::Result<()> {
    let mut ms: BTreeMap<(String, String), Vec<f64>> = BTreeMap::new();
    for row in csv::Reader::from_path(runs).with_context(|| runs.display().to_string())?.deserialize() {
        let (ppp, _, program, _, cpu_ms): (String, f64, String, u32, f64) = row?;
        ms.entry((ppp, program)).or_default().push(cpu_ms);
    }
    let of = |ppp: &str, program: &str| {
        ms.get(&(ppp.to_owned(), program.to_owned())).map(|runs| median(runs.iter().copied()))
    };
    for ppp in ms.keys().filter(|(_, program)| program == "microsig").map(|(ppp, _)| ppp) {
        let Some(ours) = of(ppp, "microsig") else { continue };
        for peer in ["SynthPix", "synpivimage"] {
            let Some(theirs) = of(ppp, peer) else { continue };
            let goal = if peer == "SynthPix" { "10 times" } else { "" };
            writeln!(
                table,
                "| in-focus pairs, 512 x 512 px, {ppp} particles per px, {:.0} per CPU s | {:.1} times {peer} | {goal} |",
                1e3 / ours,
                theirs / ours
            )?;
        }
    }
    Ok(())
}
