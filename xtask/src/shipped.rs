//! `cargo xtask scenarios`: generates and verifies every scenario and sweep of `scenarios/` at full size, and
//! records the cost.

use std::fmt::Write;
use std::path::{Path, PathBuf};
use std::process::{Command, ExitCode};

use anyhow::Context;

use suite::process::{self, Usage, machine};

/// Results for one file.
struct Row {
    name: String,
    datasets: usize,
    images: usize,
    bytes: u64,
    generate: Usage,
    verify: Usage,
}

/// Runs all files sequentially, each on all cores, and writes `scenarios.csv` and `README.md`.
pub(crate) fn run(out: &Path) -> anyhow::Result<ExitCode> {
    let microsig = process::microsig()?;
    let mut files = Vec::new();
    for entry in std::fs::read_dir("scenarios").context("scenarios: run this in the repository's folder")? {
        let path = entry?.path();
        if path.extension().is_some_and(|e| e == "ron") {
            files.push(path);
        }
    }
    files.sort();
    let machine = machine();
    let (mut rows, mut failures) = (Vec::new(), Vec::new());
    for file in &files {
        match row(&microsig, file) {
            Ok(row) => {
                println!("{}: {:.1} s", row.name, row.generate.cpu_s);
                rows.push(row);
            }
            Err(e) => failures.push(format!("{}: {e:#}", file.display())),
        }
    }
    std::fs::create_dir_all(out)?;
    std::fs::write(out.join("scenarios.csv"), table(&rows))?;
    std::fs::write(out.join("README.md"), page(&rows, &failures, &machine)?)?;
    failures.iter().for_each(|failure| println!("{failure}"));
    Ok(if failures.is_empty() { ExitCode::SUCCESS } else { ExitCode::FAILURE })
}

fn row(microsig: &Path, file: &Path) -> anyhow::Result<Row> {
    let place = tempfile::tempdir()?;
    let out = place.path().join("out");
    let is_sweep = std::fs::read_to_string(file)?.contains("axes:");
    let verb = if is_sweep { "sweep" } else { "generate" };
    let mut command = Command::new(microsig);
    let (generate, _) = process::run(command.args(["--quiet", verb]).arg(file).arg("--out").arg(&out))?;
    let datasets = if is_sweep { cases(&out)? } else { vec![out.clone()] };
    let mut verify = Usage { wall_s: 0.0, cpu_s: 0.0, peak_mb: 0.0 };
    let mut images = 0;
    for dataset in &datasets {
        let mut command = Command::new(microsig);
        let (used, _) = process::run(command.args(["--quiet", "verify", "--regenerate"]).arg(dataset))?;
        verify.wall_s += used.wall_s;
        verify.cpu_s += used.cpu_s;
        images += std::fs::read_dir(dataset.join("images"))?.count();
    }
    let bytes = suite::tree(&out)?
        .keys()
        .map(|path| Ok(std::fs::metadata(out.join(path))?.len()))
        .sum::<anyhow::Result<u64>>()?;
    let name = file.file_stem().context("a file has a name")?.to_string_lossy().into_owned();
    Ok(Row { name, datasets: datasets.len(), images, bytes, generate, verify })
}

/// The datasets of a sweep, all of its cases.
fn cases(out: &Path) -> anyhow::Result<Vec<PathBuf>> {
    let mut datasets = Vec::new();
    for record in csv::Reader::from_path(out.join("cases.csv"))?.records() {
        let record = record?;
        datasets.push(out.join(&record[1]));
    }
    Ok(datasets)
}

fn table(rows: &[Row]) -> String {
    let mut text = String::from(
        "scenario,datasets,images,bytes,generate_cpu_s,generate_wall_s,verify_cpu_s,verify_wall_s\n",
    );
    for r in rows {
        text += &format!(
            "{},{},{},{},{:.2},{:.2},{:.2},{:.2}\n",
            r.name,
            r.datasets,
            r.images,
            r.bytes,
            r.generate.cpu_s,
            r.generate.wall_s,
            r.verify.cpu_s,
            r.verify.wall_s
        );
    }
    text
}

fn page(rows: &[Row], failures: &[String], machine: &str) -> anyhow::Result<String> {
    let mut text = format!(
        "# Cost of the shipped scenarios\n\nMade by `cargo xtask scenarios`: every file of `scenarios/` at its full size, \
         generated and then checked with `microsig verify --regenerate`, which generates it again and compares all bytes (for a sweep: \
         every case). CPU time of all threads.\n\n{machine}.\n\n\
         {} of {} files pass.\n\n\
         | scenario | datasets | images | size, MB | generate, CPU s | verify, CPU s |\n\
         |---|---|---|---|---|---|\n",
        rows.len(),
        rows.len() + failures.len()
    );
    for r in rows {
        writeln!(
            text,
            "| [`{0}`](../../scenarios/{0}.ron) | {1} | {2} | {3:.1} | {4:.1} | {5:.1} |",
            r.name,
            r.datasets,
            r.images,
            r.bytes as f64 / 1e6,
            r.generate.cpu_s,
            r.verify.cpu_s
        )?;
    }
    for failure in failures {
        writeln!(text, "\nFailed: {failure}")?;
    }
    Ok(text)
}
