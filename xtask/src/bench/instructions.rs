//! `cargo xtask instructions`: instruction counts of small runs of the command, by callgrind.
//!
//! Counts do not depend on the load of the computer, so they reveal changes of a few percent that timings do
//! not resolve. Valgrind emulates a processor with AVX2 and without AVX-512; counts ignore caches and depend
//! on the compiler.

use std::collections::BTreeMap;
use std::fmt::Write;
use std::path::{Path, PathBuf};
use std::process::{Command, ExitCode, Stdio};

use anyhow::{Context, ensure};
use microsig_core::{Settings, formats::settings_file};

use suite::process::{machine, microsig};
use suite::template::fill;

/// A small run: its name, and the arguments except threads and output.
struct Run {
    name: &'static str,
    arguments: Vec<String>,
}

/// Counts the instructions of all runs and compares them with earlier counts; fails if one grew by more
/// than `tolerance`.
pub(crate) fn run(out: &Path, against: Option<&Path>, tolerance: f64) -> anyhow::Result<ExitCode> {
    if Command::new("valgrind").arg("--version").stdout(Stdio::null()).status().is_err() {
        println!("skipped: valgrind is not installed");
        return Ok(ExitCode::SUCCESS);
    }
    let before = against.map(read).transpose()?.unwrap_or_default();
    std::fs::create_dir_all(out)?;
    let (program, machine) = (microsig()?, machine());
    let scratch = tempfile::tempdir()?;
    let mut table = csv::Writer::from_path(out.join("counts.csv"))?;
    table.write_record(["run", "instructions"])?;
    let mut rows = String::new();
    let mut grown = false;
    for run in runs(&program, scratch.path())? {
        let count = count(&program, &run, scratch.path())?;
        table.write_record([run.name, &count.to_string()])?;
        let known = before.get(run.name).map(|before| (*before as f64, count as f64 / *before as f64 - 1.0));
        grown |= known.is_some_and(|(_, change)| change > tolerance);
        let (before, change) = known.map_or_else(Default::default, |(before, change)| {
            (format!("{:.1}", before / 1e6), format!("{:+.1} %", 100.0 * change))
        });
        writeln!(rows, "| {} | {:.1} | {before} | {change} |", run.name, count as f64 / 1e6)?;
        println!("{}: {count} {change}", run.name);
    }
    table.flush()?;
    let values = [("machine", machine.as_str()), ("rows", rows.trim_end())];
    std::fs::write(out.join("README.md"), fill(include_str!("instructions.md"), &values))?;
    if grown {
        println!("more than {} % above {}", 100.0 * tolerance, against.unwrap_or(out).display());
    }
    Ok(if grown { ExitCode::FAILURE } else { ExitCode::SUCCESS })
}

/// The counts of an earlier run.
fn read(path: &Path) -> anyhow::Result<BTreeMap<String, u64>> {
    let mut reader = csv::Reader::from_path(path).with_context(|| path.display().to_string())?;
    reader.deserialize().map(|row| Ok(row?)).collect()
}

/// The runs; their inputs are written below `scratch`.
fn runs(program: &Path, scratch: &Path) -> anyhow::Result<Vec<Run>> {
    let settings = Settings { pixel_dim_x: 256, pixel_dim_y: 256, ..Settings::setting1() };
    let mut bytes = Vec::new();
    settings_file::write(&mut bytes, &settings)?;
    let file = scratch.join("settings.txt");
    std::fs::write(&file, bytes)?;
    let row =
        |k: u32| format!("{} {} {} 2\n", 20 + 37 * k % 211, 20 + 53 * k % 211, f64::from(k * 17 % 80) - 60.0);
    let render = |name: &'static str, images: u32, particles: u32| -> anyhow::Result<Run> {
        let data = scratch.join(name.replace(' ', "_"));
        std::fs::create_dir_all(&data)?;
        for image in 0..images {
            let rows: String = (0..particles).map(|k| row(k + image)).collect();
            std::fs::write(data.join(format!("{image}.txt")), format!("# particles\n{rows}"))?;
        }
        Ok(Run { name, arguments: vec!["render".to_owned(), text(&file), text(&data)] })
    };
    let scenario = scratch.join("spots.ron");
    std::fs::write(
        &scenario,
        "(name: \"spots\", optics: (gaussian: (diameter_px: 2.75), pixel_dim_x: 256, pixel_dim_y: 256), motion: flow(field: \
         lamb_oseen()), particles: (number: ppp(0.03)), boundaries: (z_um: (-5, 5)), timing: pairs(count: 4))",
    )?;
    let dataset = scratch.join("spots");
    let arguments = |first: &[&str], paths: &[&Path]| {
        first.iter().map(|&word| word.to_owned()).chain(paths.iter().map(|path| text(path))).collect()
    };
    let result = scratch.join("result.csv");
    let spots =
        Run { name: "spots tracked", arguments: arguments(&["track", "--method", "spots"], &[&dataset]) };
    for run in [
        Run { name: "", arguments: arguments(&["generate", "--out"], &[&dataset, &scenario]) },
        Run { name: "", arguments: [spots.arguments.clone(), arguments(&["--out"], &[&result])].concat() },
    ] {
        let output = Command::new(program).args(&run.arguments).arg("--quiet").output()?;
        ensure!(output.status.success(), "{:?}: {}", run.arguments, String::from_utf8_lossy(&output.stderr));
    }
    Ok(vec![
        Run { name: "start", arguments: vec!["--version".to_owned()] },
        render("8 images of noise", 8, 0)?,
        render("rays of 20 particles", 1, 20)?,
        Run { name: "4 pairs of spots", arguments: arguments(&["generate"], &[&scenario]) },
        spots,
        Run { name: "spots evaluated", arguments: arguments(&["evaluate", "--json"], &[&dataset, &result]) },
    ])
}

fn text(path: &Path) -> String {
    path.to_string_lossy().into_owned()
}

/// Instructions of a run.
fn count(program: &Path, run: &Run, scratch: &Path) -> anyhow::Result<u64> {
    let out: PathBuf = scratch.join("out");
    let mut command = Command::new("valgrind");
    command.args(["--tool=callgrind", "--callgrind-out-file=/dev/null"]).arg(program).args(&run.arguments);
    match run.arguments[0].as_str() {
        "render" => drop(command.args(["--quiet", "--threads", "1"]).arg(&out)),
        "generate" | "track" => drop(command.args(["--quiet", "--threads", "1", "--out"]).arg(&out)),
        "evaluate" => drop(command.args(["--quiet", "--threads", "1"])),
        _ => {}
    }
    let output = command.output()?;
    let said = String::from_utf8_lossy(&output.stderr);
    ensure!(output.status.success(), "{command:?}: {said}");
    if out.is_dir() {
        std::fs::remove_dir_all(&out)?;
    } else if out.exists() {
        std::fs::remove_file(&out)?;
    }
    // ==7== Collected : 123456
    let collected = said.lines().find_map(|line| line.split_once("Collected :")?.1.trim().parse().ok());
    collected.context("callgrind reports the number of instructions")
}
