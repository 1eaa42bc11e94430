//! Hostile inputs: files of every kind, changed at random and given to the command that reads them. A run
//! must end in time with exit code 0, 1 or 2, without a panic, in bounded memory, and leave nothing behind if
//! it fails.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::io::{Cursor, Read, Write as _};
use std::path::{Path, PathBuf};
use std::process::{Command, ExitCode, Stdio};
use std::time::{Duration, Instant};

use anyhow::Context;
use microsig_core::stream::{Purpose, Stream, Streams};
use serde_json::Value;
use suite::process;
use zip::write::SimpleFileOptions;
use zip::{ZipArchive, ZipWriter};

use super::record;

/// A run that takes longer is a finding.
const LONGEST: Duration = Duration::from_secs(60);

/// Limit of a run's address space, KiB.
const MEMORY_KIB: u64 = 6 << 20;

const SCENARIO: &str = r#"(
    name: "hostile",
    optics: (pixel_dim_x: 96, pixel_dim_y: 64, depth_factor: 1.0),
    motion: flow(field: poiseuille(max_speed_um_s: 1290)),
    particles: (number: count(6), diameter_um: normal(mean: 2, sd: 0.1, min: 1, max: 3)),
    boundaries: (z_um: (-40, 20)),
    timing: pairs(count: 1, dt_s: 0.005),
    truth: (gradient: true, boxes: true),
)"#;

const SWEEP: &str = r#"(
    name: "hostile",
    base: "base.ron",
    axes: [(path: "optics.background_noise", values: list([0, 10])), (path: "seed", values: linear(from: 1, to: 2, count: 2))],
)"#;

/// Replacements for a number or word.
const HOSTILE: [&str; 22] = [
    "1e308",
    "-1e308",
    "1e-320",
    "NaN",
    "inf",
    "-1",
    "0",
    "4294967296",
    "18446744073709551615",
    "99999999999999999999",
    "\"\"",
    "()",
    "[",
    ")",
    "{}",
    "\u{0}",
    "\u{feff}",
    "None",
    "../../x",
    "=1+1",
    "true",
    "1e9",
];

/// An input that is changed, and the command that reads it.
struct Target {
    name: &'static str,
    file: PathBuf,
    original: Vec<u8>,
    /// Arguments; `OUT` is replaced by the output.
    arguments: Vec<String>,
}

/// Counts of a target's runs.
#[derive(Default)]
struct Tally {
    codes: BTreeMap<i32, u32>,
    slowest: Duration,
    findings: Vec<String>,
}

/// Runs `mutations` changed inputs of each kind and writes `mutations.md`.
pub(crate) fn run(out: &Path, mutations: u32, seed: u64) -> anyhow::Result<ExitCode> {
    let microsig = process::microsig()?;
    let place = tempfile::tempdir()?;
    let mut text = format!(
        "# Hostile inputs\n\nMade by `cargo xtask robustness --mutations {mutations} --seed {seed}`: 1 to 4 random changes of \
         each input; {MEMORY_KIB} KiB of address space and {} s for a run.\n\n| input | runs | exit code 0 | 1 | 2 | slowest, s | \
         findings |\n|---|---|---|---|---|---|---|\n",
        LONGEST.as_secs()
    );
    let mut findings = Vec::new();
    for (number, target) in targets(&microsig, place.path())?.into_iter().enumerate() {
        let mut tally = Tally::default();
        // Otherwise the changes would only test the refusal.
        one(&microsig, &target, &target.original, place.path(), &mut tally)
            .and_then(|()| {
                anyhow::ensure!(tally.codes.contains_key(&0), "the unchanged input is refused");
                Ok(())
            })
            .with_context(|| format!("{} without changes", target.name))?;
        tally.codes.clear();
        for run in 0..mutations {
            let mut random = Streams::new(seed).stream(Purpose::Rays, number as u32, run);
            let changed = mutated(&target.original, &mut random);
            if let Err(why) = one(&microsig, &target, &changed, place.path(), &mut tally) {
                let kept = out.join(format!("{}-{run}", target.name.replace(' ', "-")));
                std::fs::create_dir_all(out)?;
                std::fs::write(&kept, &changed)?;
                tally.findings.push(format!("{}, run {run} ({}): {why}", target.name, kept.display()));
            }
        }
        std::fs::write(&target.file, &target.original)?;
        let of = |code| tally.codes.get(&code).copied().unwrap_or(0);
        writeln!(
            text,
            "| {} | {mutations} | {} | {} | {} | {:.1} | {} |",
            target.name,
            of(0),
            of(1),
            of(2),
            tally.slowest.as_secs_f64(),
            tally.findings.len()
        )?;
        findings.extend(tally.findings);
    }
    for finding in &findings {
        writeln!(text, "\n- {finding}")?;
    }
    record(out, "mutations.md", &text)?;
    print!("{text}");
    Ok(if findings.is_empty() { ExitCode::SUCCESS } else { ExitCode::FAILURE })
}

fn targets(microsig: &Path, place: &Path) -> anyhow::Result<Vec<Target>> {
    let at = |path: &str| place.join(path);
    std::fs::write(at("base.ron"), SCENARIO)?;
    std::fs::write(at("sweep.ron"), SWEEP)?;
    let words = |of: &[&str]| of.iter().map(|word| (*word).to_owned()).collect::<Vec<_>>();
    let text = |path: &str| at(path).display().to_string();
    process::run(Command::new(microsig).args([
        "generate",
        &text("base.ron"),
        "--out",
        &text("dataset"),
        "--quiet",
    ]))?;
    process::run(Command::new(microsig).args([
        "release",
        &text("dataset"),
        "--out",
        &text("challenge"),
        "--quiet",
    ]))?;
    std::fs::copy(at("dataset/truth/tracks.csv"), at("result.csv"))?;
    std::fs::write(
        at("found.json"),
        r#"[{"image_id": 0, "category_id": 0, "bbox": [1, 2, 9, 8], "score": 0.5}]"#,
    )?;
    let (results, about) = submission(&at("challenge"))?;
    std::fs::create_dir(at("submission"))?;
    std::fs::write(at("submission/results.csv"), &results)?;
    std::fs::write(at("submission/submission.json"), &about)?;
    std::fs::write(at("submission.zip"), zipped(&[("results.csv", &results), ("submission.json", &about)])?)?;
    let target = |name, file: &str, arguments: &[&str]| {
        let file = at(file);
        let original = std::fs::read(&file).with_context(|| file.display().to_string())?;
        anyhow::Ok(Target { name, file, original, arguments: words(arguments) })
    };
    let (dataset, withheld) = (text("dataset"), text("challenge/withheld/test"));
    Ok(vec![
        target("scenario", "base.ron", &["generate", &text("base.ron"), "--out", "OUT"])?,
        target("sweep", "sweep.ron", &["sweep", &text("sweep.ron"), "--out", "OUT"])?,
        target(
            "settings",
            "dataset/settings.txt",
            &["render", &text("dataset/settings.txt"), &text("dataset/particles"), "OUT"],
        )?,
        target(
            "data file",
            "dataset/particles/pair_00000_a.txt",
            &["render", &text("dataset/settings.txt"), &text("dataset/particles/pair_00000_a.txt"), "OUT"],
        )?,
        target("result", "result.csv", &["evaluate", &dataset, &text("result.csv"), "--out", "OUT"])?,
        target("boxes", "found.json", &["evaluate", &dataset, &text("found.json"), "--out", "OUT"])?,
        target(
            "truth",
            "dataset/truth/tracks.csv",
            &["evaluate", &dataset, &text("result.csv"), "--out", "OUT"],
        )?,
        target(
            "manifest",
            "dataset/datapackage.json",
            &["evaluate", &dataset, &text("result.csv"), "--out", "OUT"],
        )?,
        target(
            "image",
            "dataset/images/pair_00000_a.tif",
            &["track", &dataset, "--method", "spots", "--out", "OUT"],
        )?,
        target(
            "calibration",
            "dataset/calibration/calibration.csv",
            &["track", &dataset, "--method", "aptv", "--out", "OUT"],
        )?,
        target(
            "boxes of the truth",
            "dataset/truth/boxes.csv",
            &["export", &dataset, "--format", "masks", "--out", "OUT"],
        )?,
        target(
            "submission",
            "submission.zip",
            &["evaluate", &withheld, &text("submission.zip"), "--out", "OUT"],
        )?,
        // Changes of an archive are mostly caught by its checksums; changes of a folder reach the scorer.
        target(
            "results of a submission",
            "submission/results.csv",
            &["evaluate", &withheld, &text("submission"), "--out", "OUT"],
        )?,
        target(
            "submission.json",
            "submission/submission.json",
            &["evaluate", &withheld, &text("submission"), "--out", "OUT"],
        )?,
    ])
}

/// `results.csv` and `submission.json` of a valid submission to the challenge: the withheld truth, and the
/// filled-in template of the public test split.
fn submission(challenge: &Path) -> anyhow::Result<(Vec<u8>, Vec<u8>)> {
    let public = std::fs::read_dir(challenge.join("public"))?.filter_map(|entry| Some(entry.ok()?.path()));
    let test = public.into_iter().find(|path| path.to_string_lossy().ends_with("-test.zip"));
    let mut test = ZipArchive::new(std::fs::File::open(test.context("the public test split")?)?)?;
    let mut read = |end: &str| -> anyhow::Result<String> {
        let names = test.file_names().filter_map(|name| Some(name.ok()?.into_owned()));
        let name = names.into_iter().find(|name| name.ends_with(end));
        let mut text = String::new();
        test.by_name(&name.with_context(|| end.to_owned())?)?.read_to_string(&mut text)?;
        Ok(text)
    };
    let mut about: Value = serde_json::from_str(&read("submission/submission.json")?)?;
    for key in ["team", "method", "version", "hardware"] {
        about[key] = "a".into();
    }
    let sums = read("SHA256SUMS")?;
    let images = sums.lines().filter(|line| line.contains("  images/")).map(|line| format!("{line}\n"));
    about["images_sha256"] = suite::sha256_of(images.collect::<String>().as_bytes()).into();
    let results = std::fs::read(challenge.join("withheld/test/truth/tracks.csv"))?;
    Ok((results, about.to_string().into_bytes()))
}

/// A zip archive of files.
fn zipped(files: &[(&str, &[u8])]) -> anyhow::Result<Vec<u8>> {
    let mut zip = ZipWriter::new(Cursor::new(Vec::new()));
    for (name, bytes) in files {
        zip.start_file(*name, SimpleFileOptions::default())?;
        zip.write_all(bytes)?;
    }
    Ok(zip.finish()?.into_inner())
}

/// Applies one to four changes.
fn mutated(original: &[u8], random: &mut Stream) -> Vec<u8> {
    let mut bytes = original.to_vec();
    let mut below = |n: usize| ((random.uniform() * n as f64) as usize).min(n.saturating_sub(1));
    for _ in 0..=below(4) {
        if bytes.is_empty() {
            break;
        }
        let at = below(bytes.len());
        match below(7) {
            0 => bytes[at] ^= 1 << below(8),
            1 => bytes.truncate(at),
            2 => drop(bytes.drain(at..(at + 1 + below(20)).min(bytes.len()))),
            3 => {
                let part = bytes[at..(at + 1 + below(200)).min(bytes.len())].to_vec();
                let to = below(bytes.len());
                bytes.splice(to..to, part);
            }
            4 => {
                let hostile = HOSTILE[below(HOSTILE.len())].bytes();
                bytes.splice(at..at, hostile);
            }
            // Instead of a number or word.
            _ => {
                let part_of = |byte: &u8| byte.is_ascii_alphanumeric() || b"._-+".contains(byte);
                let start = bytes[..at].iter().rposition(|byte| !part_of(byte)).map_or(0, |i| i + 1);
                let end = bytes[at..].iter().position(|byte| !part_of(byte)).map_or(bytes.len(), |i| at + i);
                let hostile = HOSTILE[below(HOSTILE.len())].bytes();
                bytes.splice(start..end.max(start), hostile);
            }
        }
    }
    bytes
}

/// One run. `Err`: what is wrong with it.
fn one(
    microsig: &Path,
    target: &Target,
    changed: &[u8],
    place: &Path,
    tally: &mut Tally,
) -> anyhow::Result<()> {
    std::fs::write(&target.file, changed)?;
    let out = place.join("out");
    let arguments = target
        .arguments
        .iter()
        .map(|word| if word == "OUT" { out.display().to_string() } else { word.clone() });
    let mut command = Command::new("sh");
    command.args(["-c", &format!("ulimit -v {MEMORY_KIB}; exec \"$@\""), "sh"]).arg(microsig).args(arguments);
    command.args(["--threads", "1", "--no-cache"].into_iter().take(if target.name == "scenario" {
        3
    } else {
        2
    }));
    let begun = Instant::now();
    let mut child = command.stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::piped()).spawn()?;
    let mut stderr = child.stderr.take().context("standard error")?;
    let reader = std::thread::spawn(move || {
        let mut text = Vec::new();
        stderr.read_to_end(&mut text).map(|_| String::from_utf8_lossy(&text).into_owned())
    });
    let status = loop {
        if let Some(status) = child.try_wait()? {
            break status;
        }
        if begun.elapsed() > LONGEST {
            child.kill()?;
            child.wait()?;
            clear(&out, place)?;
            anyhow::bail!("no end after {} s", LONGEST.as_secs());
        }
        std::thread::sleep(Duration::from_millis(5));
    };
    tally.slowest = tally.slowest.max(begun.elapsed());
    let message = reader.join().map_err(|_| anyhow::anyhow!("standard error"))??;
    let left = clear(&out, place)?;
    let Some(code) = status.code().filter(|code| (0..=2).contains(code)) else {
        anyhow::bail!("{status}: {message}");
    };
    *tally.codes.entry(code).or_default() += 1;
    anyhow::ensure!(!message.contains("panicked"), "{message}");
    // A sweep keeps the reasons why its cases failed.
    let may_keep = code == 0 || (code == 1 && target.name == "sweep");
    anyhow::ensure!(may_keep || left.is_empty(), "exit code {code}, but {left:?} is left: {message}");
    anyhow::ensure!(code == 0 || !message.trim().is_empty(), "exit code {code} without a message");
    Ok(())
}

/// Removes the output and files beside it; returns what existed.
fn clear(out: &Path, place: &Path) -> anyhow::Result<Vec<String>> {
    let mut left = Vec::new();
    for entry in std::fs::read_dir(place)? {
        let path = entry?.path();
        let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        if path == out
            || name.starts_with("out.")
            || name.starts_with(".out")
            || name.starts_with(".unfinished")
        {
            if path.is_dir() {
                std::fs::remove_dir_all(&path)?
            } else {
                std::fs::remove_file(&path)?
            }
            left.push(name);
        }
    }
    Ok(left)
}
