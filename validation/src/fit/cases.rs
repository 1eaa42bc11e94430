//! Scans with known truth: every quantity against its limit.

use std::fmt::Write as _;
use std::fs::File;
use std::path::Path;
use std::process::Command;

use anyhow::Context;
use serde_json::Value;
use suite::process;
use suite::scan::SimulatedScan;

use super::quantity::{Quantity, camera, quantities};

/// Fits all scans below `own`; writes one row for each quantity, and one for each run.
pub(super) fn run(program: &Path, own: &Path, cases: &Path, runs: &Path) -> anyhow::Result<()> {
    let mut folders: Vec<_> = std::fs::read_dir(own)
        .with_context(|| own.display().to_string())?
        .filter_map(|entry| Some(entry.ok()?.path()))
        .filter(|path| path.is_dir())
        .collect();
    folders.sort();
    let mut table = csv::Writer::from_path(cases)?;
    table.write_record(["case", "quantity", "truth", "value", "sd", "bar", "within", "covered"])?;
    let mut usages = csv::Writer::from_path(runs)?;
    usages.write_record(["case", "particles", "planes", "cpu_s", "peak_mb", "chi2", "r2", "rejected"])?;
    let place = tempfile::tempdir()?;
    for folder in folders {
        let name = folder.file_name().and_then(|n| n.to_str()).context("a name")?.to_owned();
        let scan = SimulatedScan::read(&folder)?;
        let out = place.path().join(&name);
        let mut command = Command::new(program);
        command.arg("fit").arg(folder.join("scan.tif")).arg("--z").arg(folder.join("z.csv"));
        for (option, value) in [
            ("--magnification", scan.settings.magnification),
            ("--pixel-size", scan.settings.pixel_size),
            ("--depth-factor", scan.depth_factor),
        ] {
            command.arg(option).arg(value.to_string());
        }
        let (usage, _) = process::run(command.arg("--out").arg(&out))?;
        let fit: Value = serde_json::from_reader(File::open(out.join("fit.json"))?)?;
        let mut found = quantities(&scan, &fit);
        found.extend(camera(&scan, &fit, &suite::settings(&out.join("settings.txt"))?));
        for q in &found {
            let row = [q.truth, q.value, q.sd, q.bar].map(|v| format!("{v:.6}"));
            let flags = [q.is_within(), q.is_covered()].map(|flag| flag.to_string());
            let head = [name.clone(), q.name.clone()];
            table.write_record(head.into_iter().chain(row).chain(flags))?;
        }
        let missed = found.iter().filter(|q| !q.is_within()).count();
        println!("case {name}: {missed} of {} limits exceeded, {:.1} CPU s", found.len(), usage.cpu_s);
        let count = |key: &str| fit[key].as_array().map_or(0, Vec::len).to_string();
        let number = |key: &str| fit[key].as_f64().unwrap_or(f64::NAN);
        usages.write_record([
            name,
            count("particles"),
            count("planes"),
            format!("{:.1}", usage.cpu_s),
            format!("{:.0}", usage.peak_mb),
            format!("{:.3}", number("chi2")),
            format!("{:.4}", number("r2")),
            count("rejected"),
        ])?;
    }
    table.flush()?;
    Ok(usages.flush()?)
}

/// The rows of a table as Markdown: all shared quantities, and for particles the largest error in units of
/// the limit; and the number of limits exceeded.
pub(super) fn table(cases: &Path) -> anyhow::Result<(String, usize)> {
    let mut lines = String::new();
    let mut missed = 0;
    let mut worst: Vec<(String, Quantity)> = Vec::new();
    let line = |case: &str, q: &Quantity| {
        let error = q.value - q.truth;
        let in_sd = if q.sd > 0.0 { format!("{:+.1}", error / q.sd) } else { String::new() };
        let sd = if q.sd.is_finite() { format!("{:.5}", q.sd) } else { String::new() };
        let verdict = if q.is_within() { "yes" } else { "**no**" };
        format!(
            "| {case} | {} | {:.5} | {:.5} | {sd} | {in_sd} | {error:+.5} | {:.5} | {verdict} |\n",
            q.name, q.truth, q.value, q.bar
        )
    };
    for row in csv::Reader::from_path(cases)?.deserialize() {
        let (case, name, truth, value, sd, bar, within, _): (String, String, f64, f64, f64, f64, bool, bool) =
            row?;
        missed += usize::from(!within);
        let q = Quantity { name, truth, value, sd, interval: [f64::NAN; 2], bar, counts: false };
        let Some((axis, _)) = q.name.split_once(" of particle") else {
            lines += &line(&case, &q);
            continue;
        };
        let size = |q: &Quantity| ((q.value - q.truth) / q.bar).abs();
        let axis = axis.to_owned();
        match worst.iter_mut().find(|(c, known)| *c == case && known.name.starts_with(&axis)) {
            Some((_, known)) if size(&q) > size(known) => *known = q,
            Some(_) => {}
            None => worst.push((case, q)),
        }
    }
    for (case, q) in &worst {
        lines += &line(case, q);
    }
    Ok((lines, missed))
}

/// The runs as Markdown.
pub(super) fn runs(runs: &Path) -> anyhow::Result<String> {
    let mut lines = String::new();
    for row in csv::Reader::from_path(runs)?.records() {
        writeln!(lines, "| {} |", row?.iter().collect::<Vec<_>>().join(" | "))?;
    }
    Ok(lines)
}
