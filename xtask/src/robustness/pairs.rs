//! Two concurrent runs into one folder, the second started at a random time: the result must be complete, and
//! the later run must be refused with a message.

use std::fmt::Write;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, ExitCode, Stdio};
use std::time::{Duration, Instant};

use anyhow::{Context, ensure};
use microsig_core::stream::{Purpose, Streams};
use suite::{process, tree};

use super::record;

const SCENARIO: &str = r#"(
    name: "pairs",
    seed: 5,
    optics: (pixel_dim_x: 200, pixel_dim_y: 150),
    motion: flow(field: poiseuille()),
    timing: pairs(count: 20),
)"#;

const SWEEP: &str = r#"(
    name: "pairs",
    base: "base.ron",
    axes: [(path: "optics.background_noise", values: list([0, 10, 50]))],
)"#;

/// A verb that writes a folder: arguments except the folder, option of the second run, and option that names
/// the folder.
struct Verb {
    name: &'static str,
    arguments: Vec<String>,
    second: &'static str,
    out: &'static [&'static str],
}

fn verbs(place: &Path) -> Vec<Verb> {
    let at = |path: &str| place.join(path).display().to_string();
    let owned = |arguments: &[&str]| arguments.iter().map(|a| (*a).to_owned()).collect::<Vec<_>>();
    let dataset = at("dataset");
    let scores = owned(&["evaluate", &dataset, &at("dataset/truth/tracks.csv")]);
    let suite = owned(&["suite", "generate", "odpc1", "--size", "smoke", "--track", "P2"]);
    let mut fit = owned(&["fit", &at("dataset/calibration/images"), "--z-step", "2", "--planes", "10-30"]);
    fit.extend(owned(&[
        "--magnification",
        "10",
        "--pixel-size",
        "6.45",
        "--diameter",
        "2",
        "--astigmatic",
        "no",
    ]));
    let out: &[&str] = &["--out"];
    let verb = |name, arguments, second| Verb { name, arguments, second, out };
    vec![
        verb("generate, second --resume", owned(&["generate", &at("base.ron")]), "--resume"),
        verb("generate, second --force", owned(&["generate", &at("base.ron")]), "--force"),
        verb("sweep, second --resume", owned(&["sweep", &at("sweep.ron")]), "--resume"),
        verb("suite generate, second --resume", suite, "--resume"),
        verb("fit, second --force", fit, "--force"),
        verb("release, second --force", owned(&["release", &dataset, "--new-keys"]), "--force"),
        verb("evaluate, second --force", scores, "--force"),
        verb("compare, second --force", owned(&["compare", &at("score")]), "--force"),
        Verb {
            name: "render, second --force",
            arguments: owned(&["render", &at("dataset/settings.txt"), &at("dataset/particles")]),
            second: "--force",
            out: &[],
        },
    ]
}

/// Starts `pairs` pairs of runs of each verb and writes `pairs.md`.
pub(crate) fn run(out: &Path, pairs: u32, seed: u64) -> anyhow::Result<ExitCode> {
    let microsig = process::microsig()?;
    let place = tempfile::tempdir()?;
    let at = |path: &str| place.path().join(path);
    std::fs::write(at("base.ron"), SCENARIO)?;
    std::fs::write(at("sweep.ron"), SWEEP)?;
    for arguments in [
        vec![
            "generate".to_owned(),
            at("base.ron").display().to_string(),
            "--out".to_owned(),
            at("dataset").display().to_string(),
        ],
        vec![
            "evaluate".to_owned(),
            at("dataset").display().to_string(),
            at("dataset/truth/tracks.csv").display().to_string(),
            "--out".to_owned(),
            at("score").display().to_string(),
        ],
    ] {
        process::run(Command::new(&microsig).args(arguments))?;
    }
    let mut text = format!(
        "# Two runs into one folder\n\nMade by `cargo xtask robustness --pairs {pairs} --seed {seed}`.\n\n"
    );
    let mut all_well = true;
    for (number, verb) in verbs(place.path()).iter().enumerate() {
        let mut moments = Streams::new(seed).stream(Purpose::Rays, number as u32, 0);
        let (alone, took) = alone(&microsig, verb, &at("out"))?;
        let (mut refused, mut wrong) = (0, Vec::new());
        for pair in 0..pairs {
            let offset = Duration::from_secs_f64(moments.uniform() * took.as_secs_f64());
            match one_pair(&microsig, verb, &at("out"), offset, &alone) {
                Ok(n) => refused += n,
                Err(e) => {
                    wrong.push(format!("pair {pair}, offset {:.4} s: {e}", offset.as_secs_f64()));
                    // Leftovers must not count against the next pair.
                    if at("out").exists() {
                        std::fs::remove_dir_all(at("out"))?;
                    }
                }
            }
        }
        all_well &= wrong.is_empty();
        writeln!(
            text,
            "- **{}**: {pairs} pairs, offsets uniform over {:.2} s; {refused} runs were refused with exit code 2; {} folders \
             were not whole.",
            verb.name,
            took.as_secs_f64(),
            wrong.len()
        )?;
        for case in wrong {
            writeln!(text, "  - {case}")?;
        }
    }
    record(out, "pairs.md", &text)?;
    print!("{text}");
    Ok(if all_well { ExitCode::SUCCESS } else { ExitCode::FAILURE })
}

fn start(microsig: &Path, verb: &Verb, out: &Path, option: Option<&str>) -> anyhow::Result<Child> {
    let mut command = Command::new(microsig);
    command.args(&verb.arguments).args(verb.out).arg(out).args(option);
    command.args(["--quiet", "--threads", "1"]).stdin(Stdio::null()).stdout(Stdio::null());
    Ok(command.stderr(Stdio::piped()).spawn()?)
}

/// The files of an undisturbed run (only their names for a release, which draws a new key each time), and its
/// duration.
fn alone(microsig: &Path, verb: &Verb, out: &Path) -> anyhow::Result<(Vec<String>, Duration)> {
    let begun = Instant::now();
    let output = start(microsig, verb, out, None)?.wait_with_output()?;
    ensure!(output.status.success(), "{}: {}", verb.name, String::from_utf8_lossy(&output.stderr));
    let took = begun.elapsed();
    let files = files(verb, out)?;
    std::fs::remove_dir_all(out)?;
    Ok((files, took))
}

fn files(verb: &Verb, out: &Path) -> anyhow::Result<Vec<String>> {
    let by_name = verb.name.starts_with("release");
    Ok(tree(out)?
        .into_iter()
        .map(|(file, hash)| if by_name { file } else { format!("{hash}  {file}") })
        .collect())
}

/// Runs one pair; returns how many of the two runs were refused.
fn one_pair(
    microsig: &Path,
    verb: &Verb,
    out: &Path,
    offset: Duration,
    alone: &[String],
) -> anyhow::Result<u32> {
    let first = start(microsig, verb, out, None)?;
    std::thread::sleep(offset);
    let second = start(microsig, verb, out, Some(verb.second))?;
    let outputs = [first.wait_with_output()?, second.wait_with_output()?];
    let mut refused = 0;
    for output in outputs.iter().filter(|output| !output.status.success()) {
        let message = String::from_utf8_lossy(&output.stderr);
        ensure!(output.status.code() == Some(2), "exit code {:?}: {message}", output.status.code());
        let expected = ["is writing it", "already exists", "left by an interrupted run"];
        ensure!(expected.iter().any(|text| message.contains(text)), "{message}");
        refused += 1;
    }
    ensure!(refused < 2, "both runs were refused");
    let found = files(verb, out)?;
    ensure!(found == alone, "{} files, expected {}, or other bytes", found.len(), alone.len());
    if verb.name.starts_with("generate") {
        process::run(Command::new(microsig).arg("verify").arg(out))?;
    }
    std::fs::remove_dir_all(out).with_context(|| out.display().to_string())?;
    let rest = left_beside(out)?;
    ensure!(rest.is_empty(), "left behind: {rest:?}");
    Ok(refused)
}

/// Remaining locks and unfinished folders.
fn left_beside(out: &Path) -> anyhow::Result<Vec<PathBuf>> {
    let mut left = Vec::new();
    for entry in std::fs::read_dir(out.parent().unwrap_or(Path::new(".")))? {
        let entry = entry?;
        let name = entry.file_name().to_string_lossy().into_owned();
        if name.starts_with('.') || name.ends_with(".partial") {
            left.push(entry.path());
        }
    }
    Ok(left)
}
