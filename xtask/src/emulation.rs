//! Other processors: the golden scenarios give the same bytes on processors with fewer instructions, emulated
//! by qemu's user mode.

use std::fmt::Write;
use std::path::Path;
use std::process::{Command, ExitCode};
use std::time::Instant;

use anyhow::Context;
use suite::golden::Golden;
use suite::process;

const QEMU: &str = "qemu-x86_64";

/// Processors with all that qemu emulates, with AVX2, and with SSE4.2 only.
const PROCESSORS: [&str; 3] = ["max", "Haswell", "Nehalem"];

/// Generates the golden scenarios on this processor and on emulated ones, and writes `emulation.md`.
pub(crate) fn run(out: &Path, only: &[String]) -> anyhow::Result<ExitCode> {
    let microsig = process::microsig()?;
    let place = tempfile::tempdir()?;
    let version =
        Command::new(QEMU).arg("--version").output().with_context(|| format!("{QEMU} (qemu-user)"))?;
    let version = String::from_utf8(version.stdout)?;
    let mut text = format!(
        "# Other processors\n\nMade by `cargo xtask emulation`, {}: seconds of `generate` on one thread, without stored \
         tables.\n\n| scenario | here |",
        version.lines().next().unwrap_or_default()
    );
    for processor in PROCESSORS {
        write!(text, " {processor} |")?;
    }
    writeln!(text, "\n|---|---|---|---|---|")?;
    let mut different = 0;
    let golden = Golden::read()?;
    let chosen = golden.datasets.keys().filter(|name| only.is_empty() || only.contains(name));
    for name in chosen {
        let scenario = Golden::folder().join(format!("{name}.ron"));
        let generate = |command: &mut Command, folder: &str| -> anyhow::Result<(String, f64)> {
            let (begun, folder) = (Instant::now(), place.path().join(folder));
            command.arg("generate").arg(&scenario).arg("--out").arg(&folder);
            process::run(command.args(["--quiet", "--threads", "1", "--no-cache"]))?;
            let sums = std::fs::read_to_string(folder.join("SHA256SUMS"))?;
            std::fs::remove_dir_all(&folder)?;
            Ok((sums, begun.elapsed().as_secs_f64()))
        };
        let (here, took_s) = generate(&mut Command::new(&microsig), "here")?;
        write!(text, "| {name} | {took_s:.1} |")?;
        for processor in PROCESSORS {
            let mut command = Command::new(QEMU);
            let (there, took_s) = generate(command.args(["-cpu", processor]).arg(&microsig), processor)?;
            let same = there == here;
            different += u32::from(!same);
            write!(text, " {took_s:.1}{} |", if same { "" } else { " **other bytes**" })?;
        }
        writeln!(text)?;
        println!("{}", text.lines().last().unwrap_or_default());
    }
    writeln!(text, "\n**{different} folders differ.**")?;
    std::fs::create_dir_all(out)?;
    std::fs::write(out.join("emulation.md"), &text)?;
    println!("{different} folders differ");
    Ok(if different == 0 { ExitCode::SUCCESS } else { ExitCode::FAILURE })
}
