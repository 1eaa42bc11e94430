//! `cargo validate original DIR`: compares images with all those of the original MicroSIG in a folder.

use std::fmt::Write;
use std::path::Path;
use std::process::ExitCode;

use anyhow::Context;
use suite::reference::{self, Check};
use suite::template::fill;

pub(crate) fn run(folder: &Path, out: &Path, images: u32) -> anyhow::Result<ExitCode> {
    let cases = reference::cases(folder)?;
    std::fs::create_dir_all(out).with_context(|| out.display().to_string())?;
    let mut table = csv::Writer::from_path(out.join("checks.csv"))?;
    table.write_record(["case", "name", "quantity", "ours", "theirs", "allowed", "used"])?;

    let mut checks: Vec<(String, Check)> = Vec::new();
    let mut pictures = 0;
    for case in &cases {
        let ours = case.draw(images)?;
        let mut of_case = case.check_measures(&ours);
        if let Some(theirs) = case.mean_image()? {
            of_case.extend(case.check_image(&ours, &theirs)?);
            pictures += 1;
        }
        for check in of_case {
            let used = check.used();
            let number = |v: f64| format!("{v:.6}");
            table.write_record([
                &case.case,
                &case.name,
                check.quantity,
                &number(check.ours),
                &number(check.theirs),
                &number(check.allowed),
                &format!("{used:.3}"),
            ])?;
            if used > 1.0 {
                println!("{}/{}: {check:?}", case.case, case.name);
            }
            checks.push((format!("{}/{}", case.case, case.name), check));
        }
    }
    table.flush()?;

    let failed = checks.iter().filter(|(_, c)| c.used() > 1.0).count();
    let summary = format!(
        "{} of {} checks hold: {} images, {pictures} of them also pixel by pixel; {images} of ours averaged for each.",
        checks.len() - failed,
        checks.len(),
        cases.len(),
    );
    println!("{summary}");
    std::fs::write(out.join("README.md"), readme(&summary, &checks, out))?;
    Ok(if failed == 0 { ExitCode::SUCCESS } else { ExitCode::FAILURE })
}

fn readme(summary: &str, checks: &[(String, Check)], out: &Path) -> String {
    let mut text = fill(
        include_str!("original.md"),
        &[("summary", summary), ("out", &out.display().to_string()), ("version", env!("CARGO_PKG_VERSION"))],
    );
    let mut quantities: Vec<&str> = Vec::new();
    for (_, check) in checks {
        if !quantities.contains(&check.quantity) {
            quantities.push(check.quantity);
        }
    }
    for quantity in quantities {
        let of_it = || checks.iter().filter(move |(_, c)| c.quantity == quantity);
        let n = of_it().count();
        let mean = of_it().map(|(_, c)| c.used()).sum::<f64>() / n as f64;
        if let Some((place, worst)) = of_it().max_by(|a, b| a.1.used().total_cmp(&b.1.used())) {
            let _ = writeln!(text, "| {quantity} | {n} | {:.2} | {place} | {mean:.2} |", worst.used());
        }
    }
    text
}
