//! Runs a command and measures its time and memory.

use std::path::PathBuf;
use std::process::{Command, Stdio};
use std::time::Instant;

use anyhow::{Context, ensure};
use wait4::Wait4;

/// Time and memory used by a finished process.
#[derive(Debug, Clone, Copy)]
pub struct Usage {
    /// Elapsed time, s.
    pub wall_s: f64,
    /// User and system time of all its threads, s.
    pub cpu_s: f64,
    /// Peak resident memory, MB.
    pub peak_mb: f64,
}

/// Runs a command to completion; returns usage and standard output, which must be short.
pub fn run(command: &mut Command) -> anyhow::Result<(Usage, String)> {
    let said = tempfile::NamedTempFile::new()?;
    let complained = tempfile::NamedTempFile::new()?;
    command.stdin(Stdio::null()).stdout(said.reopen()?).stderr(complained.reopen()?);
    let start = Instant::now();
    let used = command.spawn().with_context(|| format!("{command:?}"))?.wait4()?;
    let wall_s = start.elapsed().as_secs_f64();
    ensure!(used.status.success(), "{command:?}: {}", std::fs::read_to_string(complained.path())?);
    let usage = Usage {
        wall_s,
        cpu_s: (used.rusage.utime + used.rusage.stime).as_secs_f64(),
        peak_mb: used.rusage.maxrss as f64 / 1e6,
    };
    Ok((usage, std::fs::read_to_string(said.path())?))
}

/// The median of some numbers.
pub fn median(numbers: impl IntoIterator<Item = f64>) -> f64 {
    let mut sorted: Vec<f64> = numbers.into_iter().collect();
    sorted.sort_by(f64::total_cmp);
    sorted.get(sorted.len() / 2).copied().unwrap_or(f64::NAN)
}

/// The release build of the command: $MICROSIG, or built if necessary.
pub fn microsig() -> anyhow::Result<PathBuf> {
    if let Some(path) = std::env::var_os("MICROSIG") {
        return Ok(path.into());
    }
    let build = ["build", "--release", "--quiet", "--package", "microsig", "--message-format", "json"];
    // The cargo that runs this task, to avoid a rebuild by another toolchain.
    let cargo = std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into());
    let output = Command::new(cargo).args(build).stderr(Stdio::inherit()).output()?;
    ensure!(output.status.success(), "the command could not be built");
    // Cargo reports its target directory.
    String::from_utf8(output.stdout)?
        .lines()
        .filter_map(|line| serde_json::from_str::<serde_json::Value>(line).ok())
        .filter_map(|message| message["executable"].as_str().map(Into::into))
        .next_back()
        .context("cargo names the executable")
}

/// Processor, its number of cores, system, compiler and build of [`microsig`], for records.
pub fn machine() -> String {
    let read = |path: &str| std::fs::read_to_string(path).unwrap_or_default();
    let cpuinfo = read("/proc/cpuinfo");
    let field = |name: &str| {
        let line = cpuinfo.lines().find(|line| line.starts_with(name))?;
        Some(line.split_once(':')?.1.trim().to_owned())
    };
    let cores = std::thread::available_parallelism().map_or(0, usize::from);
    let wide = if field("flags").is_some_and(|f| f.contains("avx512f")) { " with AVX-512" } else { "" };
    let rustc = Command::new("rustc").arg("--version").output();
    let rustc = rustc.map(|o| String::from_utf8_lossy(&o.stdout).trim().to_owned()).unwrap_or_default();
    let load = read("/proc/loadavg");
    let is_given = std::env::var_os("MICROSIG").is_some();
    let build = if is_given { "the build given by $MICROSIG" } else { "default release build" };
    // Without the suffix after the version.
    let kernel = read("/proc/sys/kernel/osrelease");
    format!(
        "{}{wide}, {cores} cores, {} {}, {rustc}, {build}; load when it began {}",
        field("model name").unwrap_or_else(|| std::env::consts::ARCH.to_owned()),
        std::env::consts::OS,
        kernel.split(['-', '\n']).next().unwrap_or_default(),
        load.split(' ').next().unwrap_or("unknown"),
    )
}
