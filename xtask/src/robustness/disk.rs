//! Full disks: a clear message, exit code 1, and nothing incomplete under a final name.

use std::fmt::Write;
use std::path::{Path, PathBuf};
use std::process::{Command, ExitCode};

use anyhow::{Context, ensure};

use super::record;
use suite::process;

const SCENARIO: &str = r#"(
    name: "full",
    optics: (pixel_dim_x: 200, pixel_dim_y: 100, points_per_pixel: 6),
    motion: flow(field: poiseuille()),
    particles: (number: count(8)),
    timing: pairs(count: 10),
)"#;

const SWEEP: &str = r#"(
    name: "full",
    base: "base.ron",
    axes: [(path: "seed", values: list([1, 2, 3, 4]))],
)"#;

/// A tmpfs of a given size, unmounted at the end.
struct Disk(tempfile::TempDir);

impl Disk {
    /// `None` if this user may not mount.
    fn mount(kilobytes: u64) -> anyhow::Result<Option<Disk>> {
        let folder = tempfile::tempdir()?;
        let size = format!("size={kilobytes}k");
        let mount =
            Command::new("mount").args(["-t", "tmpfs", "-o", &size, "tmpfs"]).arg(folder.path()).output();
        Ok(mount.is_ok_and(|m| m.status.success()).then_some(Disk(folder)))
    }
}

impl Drop for Disk {
    fn drop(&mut self) {
        // Best effort.
        let _ = Command::new("umount").arg(self.0.path()).status();
    }
}

/// Runs every verb that writes on disks that fill up at different stages, and writes `disk.md`.
pub(crate) fn run(out: &Path) -> anyhow::Result<ExitCode> {
    let microsig = process::microsig()?;
    let place = tempfile::tempdir()?;
    std::fs::write(place.path().join("base.ron"), SCENARIO)?;
    std::fs::write(place.path().join("sweep.ron"), SWEEP)?;
    let path = |name: &str| place.path().join(name).to_string_lossy().into_owned();
    let plain = |arguments: &[&str]| -> anyhow::Result<()> {
        let output = Command::new(&microsig).arg("--quiet").args(arguments).output()?;
        ensure!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        Ok(())
    };
    let (dataset, sweep) = (path("dataset"), path("sweep"));
    let (base, sweep_file) = (path("base.ron"), path("sweep.ron"));
    plain(&["generate", &base, "--out", &dataset])?;
    plain(&["sweep", &sweep_file, "--out", &sweep])?;
    let (settings, particles) = (format!("{dataset}/settings.txt"), format!("{dataset}/particles"));
    plain(&["render", &settings, &particles, &path("images")])?;
    let (tracks, score) = (format!("{dataset}/truth/tracks.csv"), path("score"));
    plain(&["evaluate", &dataset, &tracks, "--out", &score, "--report"])?;

    // Verb, arguments before the output folder, and a complete output folder.
    let verbs: [(&str, Vec<&str>, String); 4] = [
        ("generate", vec!["generate", &base, "--out"], dataset.clone()),
        ("sweep", vec!["sweep", &sweep_file, "--out"], sweep.clone()),
        ("render", vec!["render", &settings, &particles], path("images")),
        ("evaluate", vec!["evaluate", &dataset, &tracks, "--report", "--out"], score.clone()),
    ];
    let mut text = String::from(
        "# Full disks\n\nMade by `cargo xtask disk`: the output goes to tmpfs file systems that are too small by different amounts, so that they are \
         full at different stages.\n\n| verb | needs | sizes of the disk, kB | exit code | message (of the last) | left behind |\n\
         |---|---|---|---|---|---|\n",
    );
    for (verb, arguments, whole) in verbs {
        let needed = size_kb(Path::new(&whole))?;
        let (mut sizes, mut message, mut left) = (Vec::new(), String::new(), Vec::new());
        for tenth in 0..10 {
            let size = (needed * tenth / 10).max(8);
            let Some(disk) = Disk::mount(size)? else {
                println!("skipped: mounting a tmpfs needs to be root");
                return Ok(ExitCode::SUCCESS);
            };
            let target = disk.0.path().join("out");
            let output = Command::new(&microsig).arg("--quiet").args(&arguments).arg(&target).output()?;
            message = String::from_utf8_lossy(&output.stderr).trim().to_owned();
            ensure!(
                output.status.code() == Some(1),
                "{verb}, {size} kB: {:?}: {message}",
                output.status.code()
            );
            ensure!(message.contains("No space left on device"), "{verb}, {size} kB: {message}");
            ensure!(message.contains("out"), "{verb}, {size} kB: no path in {message}");
            left = behind(&microsig, disk.0.path(), verb)?;
            sizes.push(size.to_string());
            message = message.replace(&disk.0.path().display().to_string(), "DISK");
        }
        writeln!(
            text,
            "| {verb} | {needed} kB | {} | 1 | `{message}` | {} |",
            sizes.join(", "),
            left.join(", ")
        )?;
    }
    text += "\nNothing incomplete had its final name (finished cases of the sweep pass `verify`).\n";
    record(out, "disk.md", &text)?;
    print!("{text}");
    Ok(ExitCode::SUCCESS)
}

/// Files left on the disk; anything with a final name must be complete.
fn behind(microsig: &Path, disk: &Path, verb: &str) -> anyhow::Result<Vec<String>> {
    let names = |folder: &Path| -> anyhow::Result<Vec<PathBuf>> {
        Ok(std::fs::read_dir(folder)?.map(|e| e.map(|e| e.path())).collect::<Result<_, _>>()?)
    };
    let mut found = names(disk)?;
    if verb == "sweep" {
        // The results of a sweep are its cases, not its folder.
        let cases = disk.join("out");
        found = if cases.is_dir() { names(&cases)? } else { Vec::new() };
    }
    for path in found.iter().filter(|path| path.extension().is_none_or(|e| e != "partial")) {
        ensure!(verb == "sweep" && path.is_dir(), "{verb} left {}", path.display());
        let status = Command::new(microsig).arg("--quiet").arg("verify").arg(path).output()?.status;
        ensure!(status.success(), "{} is not complete", path.display());
    }
    let name = |path: &PathBuf| path.file_name().map(|n| format!("`{}`", n.to_string_lossy()));
    let mut left: Vec<String> = found.iter().filter_map(name).collect();
    left.sort();
    Ok(if left.is_empty() { vec!["nothing".to_owned()] } else { left })
}

/// Disk usage by `du`, kB.
fn size_kb(folder: &Path) -> anyhow::Result<u64> {
    let output = Command::new("du").arg("-sk").arg(folder).output()?;
    let text = String::from_utf8(output.stdout)?;
    Ok(text.split_whitespace().next().context("du gives a size")?.parse()?)
}
