//! `cargo xtask peers`: speed of in-focus image pairs compared with other generators on the same task and
//! machine.
//!
//! All run on one core, interleaved, five times; medians are reported. The peers report the CPU time of their
//! main loop, without imports and compilation; for microsig, it is that of the whole process.

pub(crate) mod microsig;

use std::collections::BTreeMap;
use std::fmt::Write;
use std::path::Path;
use std::process::Command;

use serde_json::Value;

use suite::process::{machine, median, run};
use suite::python::Python;
use suite::template::fill;

/// The tasks: particles per pixel, and e^-2 diameter of particle images, px.
const WORK: [(f64, f64); 2] = [(0.03, 2.75), (0.05, 4.2)];

/// The peers: name, script, pairs per run.
const PEERS: [(&str, &str, u32); 2] =
    [("SynthPix", "synthpix_pairs.py", 50), ("synpivimage", "synpivimage_pairs.py", 2)];

/// Pairs per run of microsig.
const OURS: u32 = 400;

const REPEATS: usize = 5;

/// Results of all runs of a program on a task.
#[derive(Default)]
struct Runs {
    cpu_ms_per_pair: Vec<f64>,
    said: Value,
    failure: Option<String>,
}

/// Measures and writes `runs.csv` and README.md into a folder.
pub(crate) fn main(out: &Path) -> anyhow::Result<()> {
    std::fs::create_dir_all(out)?;
    let (machine, folder) = (machine(), super::sources().join("peers"));
    let python = Python::with("peers", &folder.join("requirements.txt")).map_err(|e| format!("{e:#}"));
    let mut runs: BTreeMap<(usize, &str), Runs> = BTreeMap::new();
    for repeat in 0..REPEATS {
        for (work, (ppp, diameter)) in WORK.into_iter().enumerate() {
            println!("{}/{REPEATS}  {ppp} ppp, {diameter} px", repeat + 1);
            let [ppp, diameter] = [ppp, diameter].map(|v| v.to_string());
            let mut command = Command::new(std::env::current_exe()?);
            let (usage, _) = run(command.args(["pairs", &OURS.to_string(), &ppp, &diameter]))?;
            let ours = runs.entry((work, "microsig")).or_default();
            ours.cpu_ms_per_pair.push(1e3 * usage.cpu_s / f64::from(OURS));
            for (name, script, pairs) in PEERS {
                let theirs = runs.entry((work, name)).or_default();
                let result = match &python {
                    Ok(python) => python
                        .run(&folder.join(script), &[&pairs.to_string(), &ppp, &diameter])
                        .map(|(_, said)| said)
                        .map_err(|e| format!("{e:#}")),
                    Err(reason) => Err(format!("no Python environment: {reason}")),
                };
                match result {
                    Ok(said) => {
                        let cpu_s = said["cpu_s"].as_f64().unwrap_or(f64::NAN);
                        theirs.cpu_ms_per_pair.push(1e3 * cpu_s / said["pairs"].as_f64().unwrap_or(f64::NAN));
                        theirs.said = said;
                    }
                    Err(reason) => theirs.failure = Some(reason),
                }
            }
        }
    }
    let mut table = csv::Writer::from_path(out.join("runs.csv"))?;
    table.write_record(["ppp", "diameter_px", "program", "run", "cpu_ms_per_pair"])?;
    for ((work, name), of_it) in &runs {
        for (i, ms) in of_it.cpu_ms_per_pair.iter().enumerate() {
            let (ppp, diameter) = WORK[*work];
            let cells = [ppp.to_string(), diameter.to_string(), (*name).to_owned(), (i + 1).to_string()];
            table.write_record(cells.into_iter().chain([format!("{ms:.4}")]))?;
        }
    }
    table.flush()?;
    let text = readme(out, &machine, &runs)?;
    println!("{text}");
    Ok(std::fs::write(out.join("README.md"), text)?)
}

fn readme(
    out: &Path,
    machine: &str,
    runs: &BTreeMap<(usize, &str), Runs>,
) -> Result<String, std::fmt::Error> {
    let mut rows = String::new();
    let ms = |of_it: &Runs| median(of_it.cpu_ms_per_pair.iter().copied());
    for ((work, name), of_it) in runs {
        let (ppp, diameter) = WORK[*work];
        if let Some(reason) = &of_it.failure {
            let reason = reason.lines().next_back().unwrap_or_default();
            writeln!(rows, "| {ppp} | {diameter} | {name} | not measured: {reason} | | |")?;
            continue;
        }
        let support = of_it.said["support_px"].as_u64().map(|n| format!(", {n} x {n} px a particle"));
        writeln!(
            rows,
            "| {ppp} | {diameter} | {name}{} | {:.3} | {:.1} | {:.1} |",
            support.unwrap_or_default(),
            ms(of_it),
            1e3 / ms(of_it),
            ms(of_it) / ms(&runs[&(*work, "microsig")])
        )?;
    }
    Ok(fill(
        include_str!("README.md"),
        &[
            ("out", &out.display().to_string()),
            ("version", env!("CARGO_PKG_VERSION")),
            ("machine", machine),
            ("side", &microsig::SIDE.to_string()),
            ("repeats", &REPEATS.to_string()),
            ("rows", &rows),
        ],
    ))
}
