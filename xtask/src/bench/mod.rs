//! `cargo xtask bench`: run time and memory of the command as a whole process, compared with lower limits.
//!
//! Every workload runs several times, interleaved with the others of its group, so that load on the computer
//! affects all equally; medians are reported. The floors (memory, random numbers, files) and the yardstick (a
//! NumPy loop over all rays) are interleaved with the first group. CPU time is user and system time of all
//! threads, as reported by the system for a finished process. Results are written after every group, so that
//! an interrupted benchmark leaves a record.

pub(crate) mod floors;
pub(crate) mod instructions;
pub(crate) mod peers;
mod plot;
mod report;
pub(crate) mod scoring;
mod workload;

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::Command;

use anyhow::Context;
use serde_json::Value;

use floors::LowerLimit;
use suite::process::{Usage, machine, median, microsig, run};
use suite::python::Python;
use workload::Workload;

/// A timed workload.
struct Measured {
    workload: Workload,
    images: f64,
    particles: f64,
    bytes: f64,
    usage: Usage,
}

/// Medians of several runs.
fn middle(runs: &[Usage]) -> Usage {
    Usage {
        wall_s: median(runs.iter().map(|u| u.wall_s)),
        cpu_s: median(runs.iter().map(|u| u.cpu_s)),
        peak_mb: median(runs.iter().map(|u| u.peak_mb)),
    }
}

/// All measurements.
struct Record {
    machine: String,
    version: String,
    measured: Vec<Measured>,
    /// Workloads that this version cannot run, with the error message.
    refused: Vec<(String, String)>,
    floors: Vec<(LowerLimit, Usage)>,
    yardstick: Yardstick,
    /// Cost of starting and ending the command.
    startup: Usage,
    /// Runs of each workload, except long ones.
    repeats: usize,
}

/// Folder of the sources and Python scripts of this module.
fn sources() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("src/bench")
}

/// Number of timed starts of the command.
const STARTS: usize = 25;

/// Results of the yardstick for each of its data files, or the reason why it was not run.
type Yardstick = Result<BTreeMap<&'static str, Value>, String>;

/// Measures and writes `runs.csv`, plots and README.md into a folder; each workload runs at most `repeats`
/// times. With `only`, other groups are skipped. Workloads write below `scratch`, or below `out` if it is
/// `None`.
pub(crate) fn main(
    out: &Path,
    only: Option<&str>,
    repeats: usize,
    scratch: Option<&Path>,
) -> anyhow::Result<()> {
    std::fs::create_dir_all(out)?;
    let program = microsig()?;
    let machine = machine();
    let place = scratch.unwrap_or(out);
    std::fs::create_dir_all(place)?;
    let scratch = tempfile::Builder::new().prefix("bench").tempdir_in(place)?;
    let scratch = scratch.path();
    let (_, version) = run(Command::new(&program).arg("--version"))?;
    let mut record = Record {
        machine,
        version: version.trim().to_owned(),
        measured: Vec::new(),
        refused: Vec::new(),
        floors: Vec::new(),
        yardstick: Err("it only takes part in throughput".to_owned()),
        startup: startup(&program)?,
        repeats,
    };
    let mut workloads = workload::all(scratch)?;
    workloads.retain(|w| only.is_none_or(|group| w.group.contains(group)));
    workloads.iter_mut().for_each(|w| w.repeats = w.repeats.min(repeats));
    for group in workloads.chunk_by(|a, b| a.group == b.group) {
        measure(&program, group, scratch, &mut record)?;
        report::write(out, &record)?;
        plot::write(out, &record)?;
    }
    println!("{}: {} workloads", out.display(), record.measured.len());
    Ok(())
}

/// Measures a group; for the throughput group also floors and yardstick.
fn measure(program: &Path, group: &[Workload], scratch: &Path, record: &mut Record) -> anyhow::Result<()> {
    let compared = group.iter().any(|w| w.group == workload::THROUGHPUT);
    let python = compared.then(|| {
        Python::with("yardstick", &sources().join("yardstick_requirements.txt")).map_err(|e| format!("{e:#}"))
    });
    let mut runs: Vec<Vec<(Usage, Value, f64)>> = group.iter().map(|_| Vec::new()).collect();
    let mut floor_runs: Vec<Vec<Usage>> = vec![Vec::new(); LowerLimit::ALL.len()];
    let mut yardsticks: Vec<Yardstick> = Vec::new();
    for repeat in 0..record.repeats {
        for (workload, runs) in group.iter().zip(&mut runs).filter(|(w, _)| repeat < w.repeats) {
            if record.refused.iter().any(|(name, _)| *name == workload.name) {
                continue;
            }
            println!("{}/{}  {}: {}", repeat + 1, workload.repeats, workload.group, workload.name);
            match time(program, workload, scratch) {
                Ok(result) => runs.push(result),
                // Older versions lack this mode; any other failure ends the benchmark.
                Err(e) if workload.name == workload::EXPECTED => {
                    record.refused.push((workload.name.clone(), format!("{:#}", e.root_cause())));
                }
                Err(e) => return Err(e),
            }
        }
        let Some(python) = &python else { continue };
        for (floor, runs) in LowerLimit::ALL.into_iter().zip(&mut floor_runs) {
            runs.push(time_floor(floor, scratch)?);
        }
        yardsticks.push(python.as_ref().map_err(Clone::clone).and_then(|p| yardstick(p, scratch)));
    }
    for (workload, runs) in group.iter().zip(runs).filter(|(_, runs)| !runs.is_empty()) {
        let number = |key: &str| runs[0].1[key].as_f64().unwrap_or(f64::NAN);
        let usages: Vec<Usage> = runs.iter().map(|r| r.0).collect();
        record.measured.push(Measured {
            images: number("images"),
            particles: number("particles"),
            bytes: runs[0].2,
            usage: middle(&usages),
            workload: workload.clone(),
        });
    }
    if compared {
        record.floors = LowerLimit::ALL.into_iter().zip(floor_runs.iter().map(|runs| middle(runs))).collect();
        record.yardstick = middle_yardstick(yardsticks);
    }
    Ok(())
}

/// Cost of `microsig --version`.
fn startup(program: &Path) -> anyhow::Result<Usage> {
    let starts: anyhow::Result<Vec<Usage>> =
        (0..STARTS).map(|_| Ok(run(Command::new(program).arg("--version"))?.0)).collect();
    Ok(middle(&starts?))
}

/// Runs a workload once; returns usage, JSON output and the number of bytes written.
fn time(program: &Path, workload: &Workload, scratch: &Path) -> anyhow::Result<(Usage, Value, f64)> {
    let out = scratch.join("out");
    let mut command = Command::new(program);
    command.args(["--quiet", "--json", "--threads", &workload.threads.to_string()]).args(&workload.arguments);
    if workload.arguments[0] == "render" {
        command.arg(&out);
    } else {
        command.arg("--out").arg(&out);
    }
    let (usage, said) = run(&mut command)?;
    let bytes = bytes_below(&out)?;
    std::fs::remove_dir_all(&out)?;
    Ok((usage, serde_json::from_str(&said).context(said)?, bytes))
}

fn bytes_below(folder: &Path) -> std::io::Result<f64> {
    let mut bytes = 0.0;
    for entry in std::fs::read_dir(folder)? {
        let entry = entry?;
        let facts = entry.metadata()?;
        bytes += if facts.is_dir() { bytes_below(&entry.path())? } else { facts.len() as f64 };
    }
    Ok(bytes)
}

fn time_floor(floor: LowerLimit, scratch: &Path) -> anyhow::Result<Usage> {
    let folder = scratch.join("floor");
    std::fs::create_dir_all(&folder)?;
    let name = clap::ValueEnum::to_possible_value(&floor).context("a floor has a name")?;
    let mut command = Command::new(std::env::current_exe()?);
    let (usage, _) = run(command.args(["floor", name.get_name()]).arg(&folder))?;
    std::fs::remove_dir_all(&folder)?;
    Ok(usage)
}

/// Runs the yardstick on the first particles of the workloads with goals.
fn yardstick(python: &Python, scratch: &Path) -> Yardstick {
    const PARTICLES: [(&str, usize); 3] =
        [("setting 1, one size", 20), ("setting 1, several sizes", 20), ("setting 2", 3)];
    let run = |name: &str, particles: usize| -> anyhow::Result<Value> {
        let folder = scratch.join("inputs").join(format!("throughput {name}").replace(' ', "_"));
        let rows = std::fs::read_to_string(folder.join("particles/B00000.txt"))?;
        let data = scratch.join("yardstick.txt");
        std::fs::write(&data, rows.lines().take(particles).collect::<Vec<_>>().join("\n"))?;
        let settings = folder.join("settings.txt");
        Ok(python
            .run(&sources().join("yardstick.py"), &[&settings.to_string_lossy(), &data.to_string_lossy()])?
            .1)
    };
    PARTICLES.into_iter().map(|(name, n)| Ok((name, run(name, n).map_err(|e| format!("{e:#}"))?))).collect()
}

/// The result with the median time for each data file.
fn middle_yardstick(results: Vec<Yardstick>) -> Yardstick {
    let results: Vec<BTreeMap<&'static str, Value>> = results.into_iter().collect::<Result<_, String>>()?;
    let names: Vec<&'static str> = results.first().into_iter().flat_map(|r| r.keys().copied()).collect();
    let of = |name: &'static str| {
        let mut runs: Vec<Value> = results.iter().map(|r| r[name].clone()).collect();
        runs.sort_by(|a, b| cpu_ms(a).total_cmp(&cpu_ms(b)));
        (name, runs.swap_remove(runs.len() / 2))
    };
    Ok(names.into_iter().map(of).collect())
}

fn cpu_ms(result: &Value) -> f64 {
    result["cpu_ms_per_particle"].as_f64().unwrap_or(f64::NAN)
}
