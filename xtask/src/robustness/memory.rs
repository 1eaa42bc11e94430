//! Peak memory for a long sequence compared with a short one: it must not grow with the number of frames.
//!
//! `verify` keeps all checksums in memory, which therefore grows; it is measured but not limited.

use std::fmt::Write;
use std::path::Path;
use std::process::{Command, ExitCode, Stdio};
use std::time::{Duration, Instant};

use anyhow::{Context, ensure};

use super::record;
use suite::process;

const SCENARIO: &str = r#"(
    name: "long",
    optics: (pixel_dim_x: 200, pixel_dim_y: 100, points_per_pixel: 4),
    motion: flow(field: poiseuille()),
    particles: (number: count(10)),
    timing: sequence(frames: 100),
    calibration: none,
)"#;

/// Greatest allowed ratio.
const BAR: f64 = 1.2;

/// Measures both and writes `memory.md`; exit code 1 if the limit is exceeded.
pub(crate) fn run(out: &Path, frames: u32) -> anyhow::Result<ExitCode> {
    let microsig = process::microsig()?;
    let place = tempfile::tempdir()?;
    let scenario = place.path().join("long.ron");
    std::fs::write(&scenario, SCENARIO)?;
    let mut text = String::from(
        "# Memory of long sequences\n\nMade by `cargo xtask memory`: peak resident memory (VmHWM of /proc) of `microsig generate` and \
         `microsig verify`, with images of 200 x 100 px, which are small enough not to hide growth with the number of frames.\n\n\
         | frames | generate, MB | verify, MB | duration of generate, s |\n|---|---|---|---|\n",
    );
    let mut peaks = Vec::new();
    for n in [100, frames] {
        let dataset = place.path().join(format!("dataset{n}"));
        let mut generate = Command::new(&microsig);
        generate.arg("--quiet").arg("generate").arg(&scenario).arg("--out").arg(&dataset);
        generate.arg("--set").arg(format!("timing.sequence.frames={n}"));
        let start = Instant::now();
        let generated = peak_kb(&mut generate)?;
        let seconds = start.elapsed().as_secs_f64();
        let mut verify = Command::new(&microsig);
        let verified = peak_kb(verify.arg("--quiet").arg("verify").arg(&dataset))?;
        std::fs::remove_dir_all(&dataset)?;
        let mb = |kb: u64| kb as f64 / 1024.0;
        writeln!(text, "| {n} | {:.1} | {:.1} | {seconds:.1} |", mb(generated), mb(verified))?;
        peaks.push([generated as f64, verified as f64]);
    }
    let [generate, verify] = [0, 1].map(|i| peaks[1][i] / peaks[0][i]);
    writeln!(
        text,
        "\nRatio: {generate:.3} (generate; allowed: {BAR}), {verify:.3} (verify, which holds all checksums)."
    )?;
    record(out, "memory.md", &text)?;
    print!("{text}");
    Ok(if generate <= BAR { ExitCode::SUCCESS } else { ExitCode::FAILURE })
}

/// Runs a command and returns its peak memory, kB.
fn peak_kb(command: &mut Command) -> anyhow::Result<u64> {
    let mut child = command.stdout(Stdio::null()).spawn()?;
    let status = format!("/proc/{}/status", child.id());
    let mut peak = 0;
    // The kernel keeps the high-water mark, so the last reading before the end suffices.
    let result = loop {
        let text = std::fs::read_to_string(&status).context("needs Linux's /proc")?;
        let mark = text.lines().find_map(|line| line.strip_prefix("VmHWM:"));
        peak = mark.and_then(|m| m.trim().trim_end_matches(" kB").parse().ok()).unwrap_or(peak);
        if let Some(result) = child.try_wait()? {
            break result;
        }
        std::thread::sleep(Duration::from_millis(5));
    };
    ensure!(result.success() && peak > 0, "{command:?} failed");
    Ok(peak)
}
