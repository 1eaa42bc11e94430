//! `cargo xtask leaderboard`: runs trackers on a suite, scores them, and writes the page of the results.
//!
//! ```text
//! WORK/SIZE/datasets/    the suite
//! WORK/SIZE/blind/       its test splits as trackers see them: images, calibration, optics, times
//! WORK/SIZE/results/     TRACKER/TRACK/CASE/results.csv with run.json, which names the inputs by hash
//! WORK/SIZE/scores/      those of `microsig suite score`
//! WORK/venvs/TRACKER/    the environment of a third-party tracker
//! ```
//!
//! Runs whose inputs have not changed are skipped.

mod example;
mod output;
mod run;
mod trackers;
mod tune;

use std::path::{Path, PathBuf};
use std::process::Command;

use anyhow::{Context, ensure};
use serde_json::Value;

use suite::process;
use trackers::Tracker;

/// What to run.
#[derive(Debug, clap::Args)]
pub(crate) struct Arguments {
    /// The suite.
    #[arg(long, default_value = "scenarios/odpc1")]
    suite: PathBuf,
    /// smoke, small or full.
    #[arg(long, default_value = "small")]
    size: String,
    /// Only these tracks, separated by commas.
    #[arg(long, value_delimiter = ',')]
    tracks: Vec<String>,
    /// Only these trackers, separated by commas.
    #[arg(long, value_delimiter = ',')]
    trackers: Vec<String>,
    /// Folder of datasets, environments and results.
    #[arg(long, default_value = "target/leaderboard")]
    work: PathBuf,
    /// Output folder of SIZE/README.md, scores.csv, index.html and versions.
    #[arg(long, default_value = "results/leaderboard")]
    out: PathBuf,
    /// First search missing parameters of third-party trackers, on train and val.
    #[arg(long)]
    tune: bool,
    /// Run no tracker; score the results of earlier runs and write the page.
    #[arg(long, conflicts_with = "tune")]
    page_only: bool,
    /// Time limit of a run on one case, s.
    #[arg(long, default_value_t = 900)]
    limit_s: u64,
}

/// A case of the suite, and whether it is among the chosen tracks.
#[derive(Debug, Clone)]
struct Case {
    track: String,
    name: String,
    /// Whether particles are scored with their depth.
    has_depth: bool,
    /// The options of `microsig evaluate` by which it is scored.
    rules: Vec<String>,
}

impl Case {
    fn folder(&self) -> String {
        format!("{}/{}", self.track, self.name)
    }
}

/// Generates, runs, scores, and writes the page.
pub(crate) fn run(arguments: &Arguments) -> anyhow::Result<()> {
    let microsig = process::microsig()?;
    let work = std::path::absolute(arguments.work.join(&arguments.size))?;
    std::fs::create_dir_all(&work)?;
    let cases = cases(&microsig, arguments)?;
    let datasets = work.join("datasets");
    for track in tracks(arguments, &cases) {
        println!("datasets of {track}");
        let mut command = Command::new(&microsig);
        command.args(["suite", "generate"]).arg(&arguments.suite).args(["--size", &arguments.size]);
        command.args(["--resume", "--quiet", "--track", &track, "--out"]).arg(&datasets);
        process::run(&mut command)?;
    }
    let mut all = trackers::all(Path::new("examples/trackers"))?;
    for name in &arguments.trackers {
        ensure!(all.iter().any(|tracker| tracker.name == *name), "--trackers {name}: no such tracker");
    }
    all.retain(|tracker| arguments.trackers.is_empty() || arguments.trackers.contains(&tracker.name));
    let venvs = std::path::absolute(arguments.work.join("venvs"))?;
    let mut unusable = Vec::new();
    for tracker in &mut all {
        if let Err(e) = tracker.install(&venvs) {
            println!("{}: {e:#}", tracker.name);
            unusable.push((tracker.name.clone(), format!("cannot be installed: {e:#}")));
        }
    }
    all.retain(|tracker| !unusable.iter().any(|(name, _)| *name == tracker.name));
    let chosen = tracks(arguments, &cases);
    let running = if arguments.page_only { &[][..] } else { &all[..] };
    for tracker in running {
        let entered: Vec<&Case> =
            cases.iter().filter(|case| chosen.contains(&case.track) && tracker.enters(case)).collect();
        for case in entered.iter().filter(|_| arguments.tune) {
            match tune::search(&microsig, &datasets, tracker, case) {
                Ok(None) => {}
                Ok(Some(said)) => println!("{} on {}: {said}", tracker.name, case.folder()),
                Err(e) => println!("{} on {}: no parameters found: {e:#}", tracker.name, case.folder()),
            }
        }
        for case in entered {
            let job =
                run::Job { microsig: &microsig, work: &work, tracker, case, limit_s: arguments.limit_s };
            println!("{} on {}: {}", tracker.name, case.folder(), job.run()?);
        }
    }
    let results = work.join("results");
    forget(&results, &all, &cases)?;
    let scores = work.join("scores");
    let mut command = Command::new(&microsig);
    command.args(["suite", "score"]).arg(&arguments.suite).arg(&datasets).arg("--results").arg(&results);
    command.arg("--out").arg(&scores).args(["--force", "--quiet", "--json"]);
    if let [track] = &arguments.tracks[..] {
        command.args(["--track", track]);
    }
    process::run(&mut command)?;
    output::write(
        &arguments.out.join(&arguments.size),
        &work,
        &all,
        &unusable,
        &description(arguments, &microsig)?,
    )
}

/// Removes results for cases that no longer exist or that their tracker does not enter.
fn forget(results: &Path, trackers: &[Tracker], cases: &[Case]) -> anyhow::Result<()> {
    for tracker in trackers {
        let of_tracker = results.join(&tracker.name);
        for entry in std::fs::read_dir(&of_tracker).into_iter().flatten() {
            let track = entry?.path();
            for entry in std::fs::read_dir(&track).into_iter().flatten() {
                let case = entry?.path();
                let is_known = (cases.iter())
                    .any(|known| case == of_tracker.join(known.folder()) && tracker.enters(known));
                if !is_known {
                    std::fs::remove_dir_all(&case)?;
                }
            }
        }
    }
    Ok(())
}

/// The command that reproduces the results, and the computer on which it ran.
fn description(arguments: &Arguments, microsig: &Path) -> anyhow::Result<Vec<String>> {
    let said = Command::new(microsig).arg("--version").output()?.stdout;
    let mut command = format!("cargo xtask leaderboard --size {}", arguments.size);
    if !arguments.tracks.is_empty() {
        command += &format!(" --tracks {}", arguments.tracks.join(","));
    }
    if !arguments.trackers.is_empty() {
        command += &format!(" --trackers {}", arguments.trackers.join(","));
    }
    let machine = process::machine();
    let program = String::from_utf8_lossy(&said);
    Ok(vec![
        format!(
            "Made by `{command}` with {}; suite, scripts and parameters: {}.",
            program.trim(),
            revision(arguments)
        ),
        format!("{machine}."),
    ])
}

/// The commit of the files that are read here, and whether they have uncommitted changes; results do not
/// count.
fn revision(arguments: &Arguments) -> String {
    let git = |words: &[&str]| {
        let output =
            Command::new("git").args(words).output().ok().filter(|output| output.status.success())?;
        Some(String::from_utf8_lossy(&output.stdout).trim().to_owned())
    };
    let Some(commit) = git(&["rev-parse", "--short=12", "HEAD"]) else { return "unknown commit".to_owned() };
    let suite = arguments.suite.to_string_lossy();
    match git(&["status", "--porcelain", "--", &suite, "examples/trackers"]) {
        Some(changed) if changed.is_empty() => format!("commit {commit}"),
        _ => format!("commit {commit} with changes"),
    }
}

/// The chosen tracks in the order of the suite.
fn tracks(arguments: &Arguments, cases: &[Case]) -> Vec<String> {
    let mut tracks: Vec<String> = cases.iter().map(|case| case.track.clone()).collect();
    tracks.dedup();
    tracks.retain(|track| arguments.tracks.is_empty() || arguments.tracks.contains(track));
    tracks
}

/// All cases of the suite.
fn cases(microsig: &Path, arguments: &Arguments) -> anyhow::Result<Vec<Case>> {
    let mut command = Command::new(microsig);
    command.args(["suite", "list"]).arg(&arguments.suite).args(["--size", &arguments.size, "--json"]);
    let (_, said) = process::run(&mut command)?;
    let listed: Value = serde_json::from_str(&said)?;
    let mut cases = Vec::new();
    for track in listed["tracks"].as_array().context("a suite has tracks")? {
        let name = track["track"].as_str().context("a track has a name")?;
        for case in track["cases"].as_array().context("a track has cases")? {
            let has_depth = case["dims"] == 3;
            let rules = [
                ("--gate-xy", &track["gate_xy_px"]),
                ("--gate-z", &track["gate_z_um"]),
                ("--dims", &case["dims"]),
            ];
            let rules = rules.iter().filter(|(_, value)| !value.is_null());
            let rules = rules.map(|(option, value)| format!("{option} {value}")).collect();
            let case = case["case"].as_str().context("a case has a name")?;
            cases.push(Case { track: name.to_owned(), name: case.to_owned(), has_depth, rules });
        }
    }
    for track in &arguments.tracks {
        ensure!(cases.iter().any(|case| case.track == *track), "--tracks {track}: no such track");
    }
    Ok(cases)
}
