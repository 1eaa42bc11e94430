//! `cargo xtask peers`: classical in-focus image pairs, ours against other generators on the same work and machine.
//!
//! All run on one core, in turns, five times; medians are kept. The peers tell the CPU time of their own loop, without imports
//! and compilation; ours is that of the whole process.

pub(crate) mod ours;

use std::collections::BTreeMap;
use std::fmt::Write;
use std::path::Path;
use std::process::Command;

use serde_json::Value;

use crate::process::{machine, median, run};
use crate::python::Python;

/// The work: particles per pixel, and the e^-2 diameter of spots, px.
const WORK: [(f64, f64); 2] = [(0.03, 2.75), (0.05, 4.2)];

/// The peers: name, script, pairs of a run.
const PEERS: [(&str, &str, u32); 2] =
    [("SynthPix", "synthpix_pairs.py", 50), ("synpivimage", "synpivimage_pairs.py", 2)];

/// Pairs of a run of ours.
const OURS: u32 = 400;

const REPEATS: usize = 5;

/// What is kept of all runs of a program on a piece of work.
#[derive(Default)]
struct Runs {
    cpu_ms_per_pair: Vec<f64>,
    said: Value,
    failure: Option<String>,
}

/// Measures and writes `runs.csv` and README.md into a folder.
pub(crate) fn main(out: &Path) -> anyhow::Result<()> {
    std::fs::create_dir_all(out)?;
    let machine = machine();
    let python = Python::with("peers").map_err(|e| format!("{e:#}"));
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
                        .run(script, &[&pairs.to_string(), &ppp, &diameter])
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
    let side = ours::SIDE;
    let mut text = format!(
        "# Classical in-focus image pairs: ours and other generators\n\n\
         Made by `cargo xtask peers --out {}` with version {} of this workspace.\nOn {machine}.\n\n\
         The work: particles at random in {side} x {side} px, moved by a vortex given on every pixel, two images with Gaussian noise, \
         kept in memory. One core each, in turns, medians of {REPEATS} runs; `runs.csv` has them all. The peers' scripts are in \
         `xtask/python`, their versions in `xtask/python/peers.txt`.\n\n\
         What differs: SynthPix samples the Gaussian at pixel centres on a fixed square, pushes particles at the rim inward, and gives \
         f32 images; synpivimage integrates over pixels and gives 8 bit; ours integrates over pixels out to 0.05 counts and gives \
         16 bit. Peaks are spread from 50 to 250 counts and diameters by 9 % for SynthPix and ours, all equal for synpivimage. \
         SynthPix's diameter is 2 sigma; the e^-2 diameter here is 4 sigma.\n\n\
         | particles per pixel | e^-2 diameter, px | program | CPU ms per pair | pairs per CPU s | ours is faster by |\n\
         |---|---|---|---|---|---|\n",
        out.display(),
        env!("CARGO_PKG_VERSION"),
    );
    let ms = |of_it: &Runs| median(of_it.cpu_ms_per_pair.iter().copied());
    for ((work, name), of_it) in runs {
        let (ppp, diameter) = WORK[*work];
        if let Some(reason) = &of_it.failure {
            let reason = reason.lines().next_back().unwrap_or_default();
            writeln!(text, "| {ppp} | {diameter} | {name} | not measured: {reason} | | |")?;
            continue;
        }
        let support = of_it.said["support_px"].as_u64().map(|n| format!(", {n} x {n} px a particle"));
        writeln!(
            text,
            "| {ppp} | {diameter} | {name}{} | {:.3} | {:.1} | {:.1} |",
            support.unwrap_or_default(),
            ms(of_it),
            1e3 / ms(of_it),
            ms(of_it) / ms(&runs[&(*work, "microsig")])
        )?;
    }
    writeln!(text, "\nThe goal is 10 times SynthPix.")?;
    Ok(text)
}
