//! Kills runs at random times and resumes them: the result must be identical to that of an undisturbed run.

use std::fmt::Write;
use std::path::{Path, PathBuf};
use std::process::{Command, ExitCode, Stdio};
use std::time::{Duration, Instant};

use anyhow::{Context, ensure};
use microsig_core::stream::{Purpose, Streams};

use suite::tree;

use super::record;
use suite::process::{self, median};

const SCENARIO: &str = r#"(
    name: "killed",
    seed: 5,
    motion: flow(field: poiseuille()),
    timing: pairs(count: 60),
)"#;

const SWEEP: &str = r#"(
    name: "killed",
    base: "base.ron",
    axes: [
        (path: "optics.background_noise", values: list([0, 10, 50])),
        (path: "timing.pairs.count", values: list([6, 10])),
    ],
)"#;

/// Kinds of runs: a dataset in one process, or a sweep in two concurrent shards.
#[derive(Clone, Copy, PartialEq)]
enum Run {
    Generate,
    Sweep,
}

/// State after a kill.
#[derive(Clone, Copy, PartialEq, Debug)]
enum Left {
    Nothing,
    Partial,
    Whole,
}

struct Bench {
    microsig: PathBuf,
    place: tempfile::TempDir,
    run: Run,
}

/// Kills `kills` runs of each kind and writes `kill.md` and `kill.csv`.
pub(crate) fn run(out: &Path, kills: u32) -> anyhow::Result<ExitCode> {
    let microsig = process::microsig()?;
    let mut text = format!("# Killed runs\n\nMade by `cargo xtask robustness --kills {kills}`.\n\n");
    let mut rows = String::from("run,kill,run_s,moment_s,left,files,resumed\n");
    let mut all_well = true;
    for (run, what) in [(Run::Generate, "generate"), (Run::Sweep, "sweep in 2 shards")] {
        let bench = Bench { microsig: microsig.clone(), place: tempfile::tempdir()?, run };
        let (well, counts, typical) = bench.kill_many(kills, what, &mut rows)?;
        all_well &= well == kills;
        writeln!(
            text,
            "- **{what}**: {kills} kills (SIGKILL), uniform over the run time of an undisturbed run measured just before (median {typical:.2} s); {} left an \
             unfinished dataset, {} left nothing, {} came after the end. No unfinished dataset passed `verify`, under any name. \
             What was left was resumed, killed at a random time again, and resumed once more: {well} of {kills} trees were byte-identical to the undisturbed one.",
            counts[1], counts[0], counts[2]
        )?;
    }
    record(out, "kill.csv", &rows)?;
    record(out, "kill.md", &text)?;
    print!("{text}");
    Ok(if all_well { ExitCode::SUCCESS } else { ExitCode::FAILURE })
}

impl Bench {
    fn kill_many(&self, kills: u32, what: &str, rows: &mut String) -> anyhow::Result<(u32, [u32; 3], f64)> {
        let place = self.place.path();
        std::fs::write(place.join("base.ron"), SCENARIO)?;
        std::fs::write(place.join("sweep.ron"), SWEEP)?;
        let whole = place.join("whole");
        self.finish(&whole, false)?;
        let expected = tree(&whole)?;
        // The load of the machine may change: the run time is measured again before every tenth kill.
        let undisturbed = || -> anyhow::Result<f64> {
            let (out, start) = (place.join("again"), Instant::now());
            self.finish(&out, false)?;
            let seconds = start.elapsed().as_secs_f64();
            ensure!(tree(&out)? == expected, "two undisturbed runs differ");
            std::fs::remove_dir_all(&out)?;
            Ok(seconds)
        };

        let mut moments = Streams::new(u64::from(kills)).stream(Purpose::Rays, 0, 0);
        let (mut well, mut counts, mut times) = (0, [0; 3], Vec::new());
        for kill in 0..kills {
            if kill % 10 == 0 {
                times.push(undisturbed()?);
            }
            let typical = times[times.len() - 1];
            let out = place.join("out");
            let moment = moments.uniform() * typical;
            self.kill_after(&out, moment, false)?;
            let left = self.left(&out)?;
            counts[left as usize] += 1;
            let files = self.files(&out)?;
            self.nothing_torn_passes(&out)?;
            // The run that resumes it is killed as well.
            if left != Left::Whole {
                self.kill_after(&out, moments.uniform() * typical, true)?;
                self.nothing_torn_passes(&out)?;
            }
            self.finish(&out, true)?;
            let same = tree(&out)? == expected;
            well += u32::from(same);
            writeln!(
                rows,
                "{what},{kill},{typical:.3},{moment:.4},{left:?},{files},{}",
                if same { "identical" } else { "DIFFERENT" }
            )?;
            std::fs::remove_dir_all(&out)?;
        }
        Ok((well, counts, median(times)))
    }

    /// The processes of a run, started.
    fn start(&self, out: &Path, resume: bool) -> anyhow::Result<Vec<std::process::Child>> {
        let place = self.place.path();
        let spawn = |arguments: &[&str]| {
            let mut command = Command::new(&self.microsig);
            command.arg("--quiet").args(arguments).arg("--out").arg(out).args(resume.then_some("--resume"));
            command.stdout(Stdio::null()).stderr(Stdio::piped()).spawn().context("microsig runs")
        };
        let (scenario, sweep) = (place.join("base.ron"), place.join("sweep.ron"));
        let (scenario, sweep) = (scenario.to_str().context("UTF-8")?, sweep.to_str().context("UTF-8")?);
        match self.run {
            Run::Generate => Ok(vec![spawn(&["generate", scenario])?]),
            Run::Sweep => Ok(vec![
                spawn(&["sweep", sweep, "--shard", "1/2"])?,
                spawn(&["sweep", sweep, "--shard", "2/2"])?,
            ]),
        }
    }

    fn finish(&self, out: &Path, resume: bool) -> anyhow::Result<()> {
        // A complete dataset need not be resumed.
        if resume && self.run == Run::Generate && out.exists() {
            return Ok(());
        }
        for child in self.start(out, resume)? {
            let output = child.wait_with_output()?;
            ensure!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        }
        Ok(())
    }

    fn kill_after(&self, out: &Path, moment_s: f64, resume: bool) -> anyhow::Result<()> {
        let start = Instant::now();
        let mut children = self.start(out, resume)?;
        std::thread::sleep(Duration::from_secs_f64(moment_s).saturating_sub(start.elapsed()));
        for child in &mut children {
            // SIGKILL; fails if the process has already ended.
            let _ = child.kill();
        }
        for mut child in children {
            child.wait()?;
        }
        Ok(())
    }

    /// Finished and unfinished datasets below `out`.
    fn datasets(&self, out: &Path) -> anyhow::Result<(Vec<PathBuf>, Vec<PathBuf>)> {
        let folder = match self.run {
            Run::Generate => out.parent().context("a folder")?,
            Run::Sweep => out,
        };
        let own = |path: &Path| self.run == Run::Sweep || path.file_stem() == out.file_name();
        let mut found = (Vec::new(), Vec::new());
        if folder.is_dir() {
            for entry in std::fs::read_dir(folder)? {
                let path = entry?.path();
                if path.is_dir() && own(&path) {
                    let unfinished = path.extension().is_some_and(|e| e == "partial");
                    if unfinished { found.1.push(path) } else { found.0.push(path) }
                }
            }
        }
        Ok(found)
    }

    /// Number of files left by a run.
    fn files(&self, out: &Path) -> anyhow::Result<usize> {
        let (whole, unfinished) = self.datasets(out)?;
        whole.iter().chain(&unfinished).map(|dataset| Ok(tree(dataset)?.len())).sum()
    }

    fn left(&self, out: &Path) -> anyhow::Result<Left> {
        let (whole, unfinished) = self.datasets(out)?;
        let all = match self.run {
            Run::Generate => !whole.is_empty(),
            Run::Sweep => out.join("cases.csv").exists(),
        };
        Ok(match (all, unfinished.is_empty() && whole.is_empty()) {
            (true, _) => Left::Whole,
            (_, true) => Left::Nothing,
            _ => Left::Partial,
        })
    }

    /// Checks that finished datasets pass `verify`, and that unfinished ones do not, not even under another
    /// name, unless they are complete.
    fn nothing_torn_passes(&self, out: &Path) -> anyhow::Result<()> {
        let passes = |dataset: &Path| -> anyhow::Result<bool> {
            let mut verify = Command::new(&self.microsig);
            let verify = verify.arg("verify").arg(dataset).stdout(Stdio::null()).stderr(Stdio::null());
            Ok(verify.status()?.success())
        };
        let (whole, unfinished) = self.datasets(out)?;
        for dataset in whole {
            ensure!(passes(&dataset)?, "{} has its name but does not pass", dataset.display());
        }
        for dataset in unfinished {
            ensure!(!passes(&dataset)?, "{} passes", dataset.display());
            let torn = self.place.path().join("torn");
            std::fs::rename(&dataset, &torn)?;
            let complete = torn.join("SHA256SUMS").exists();
            ensure!(complete || !passes(&torn)?, "{} passes under another name", dataset.display());
            std::fs::rename(&torn, &dataset)?;
        }
        Ok(())
    }
}
