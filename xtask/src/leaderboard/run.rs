//! A run of a tracker on a case.

use std::path::{Path, PathBuf};
use std::process::{Child, Command, ExitStatus, Stdio};
use std::time::{Duration, Instant};

use anyhow::Context;
use serde_json::{Value, json};

use super::Case;
use super::trackers::{How, Tracker};

/// Inputs of a run.
pub(super) struct Job<'a> {
    pub(super) microsig: &'a Path,
    pub(super) work: &'a Path,
    pub(super) tracker: &'a Tracker,
    pub(super) case: &'a Case,
    pub(super) limit_s: u64,
}

/// Files of a test split that its trackers do not see.
const HIDDEN: [&str; 9] = [
    "truth/tracks.csv",
    "truth/displacements.csv",
    "truth/field.csv",
    "truth/depth.csv",
    "particles",
    "scenario.ron",
    "preview.png",
    "README.md",
    "SHA256SUMS",
];

/// Number of bytes of a tracker's messages that are kept.
const KEPT: usize = 2000;

/// Name of the record of a run.
pub(super) const RECORD: &str = "run.json";

impl Job<'_> {
    /// Runs the tracker, unless the inputs of its last run were the same; returns what happened.
    pub(super) fn run(&self) -> anyhow::Result<String> {
        let dataset = self.work.join("datasets").join(self.case.folder()).join("test");
        let out = self.work.join("results").join(&self.tracker.name).join(self.case.folder());
        let inputs = self.inputs(&dataset)?;
        let (record, result) = (out.join(RECORD), out.join("results.csv"));
        let before = std::fs::read_to_string(&record).ok();
        let before = before.and_then(|text| serde_json::from_str::<Value>(&text).ok());
        if before.is_some_and(|before| before["inputs"] == inputs.as_str()) {
            return Ok("already done".to_owned());
        }
        std::fs::create_dir_all(&out)?;
        for old in [&record, &result] {
            if old.exists() {
                std::fs::remove_file(old)?;
            }
        }
        let blind = self.blind(&dataset)?;
        let frames = std::fs::read_dir(dataset.join("images"))?.count();
        let temporary = out.join("results.csv.part");
        let (stdout, stderr) = (tempfile::NamedTempFile::new()?, tempfile::NamedTempFile::new()?);
        let mut command = self.command(&blind, &temporary);
        command.stdin(Stdio::null()).stdout(stdout.reopen()?).stderr(stderr.reopen()?);
        let start = Instant::now();
        let child = command.spawn().with_context(|| format!("{command:?}"))?;
        let status = wait(child, Duration::from_secs(self.limit_s))?;
        let seconds = start.elapsed().as_secs_f64();
        let said = std::fs::read_to_string(stdout.path())? + &std::fs::read_to_string(stderr.path())?;
        let failure = match status {
            None => Some(format!("not finished after {} s", self.limit_s)),
            Some(status) if !status.success() => Some(last_line(&said).unwrap_or_else(|| status.to_string())),
            Some(_) if !temporary.is_file() => Some("wrote no result".to_owned()),
            Some(_) => None,
        };
        if failure.is_none() {
            std::fs::rename(&temporary, &result)?;
        } else if temporary.exists() {
            std::fs::remove_file(&temporary)?;
        }
        let each = reported_time(&said).unwrap_or(seconds / frames.max(1) as f64);
        let from = said.len().saturating_sub(KEPT);
        let from = (from..said.len()).find(|at| said.is_char_boundary(*at)).unwrap_or(said.len());
        let run = json!({
            "inputs": inputs, "frames": frames, "seconds": seconds, "seconds_per_frame": each,
            "failure": failure, "said": said[from..],
        });
        std::fs::write(&record, format!("{run:#}\n"))?;
        Ok(failure.map_or_else(|| format!("{seconds:.1} s"), |failure| format!("failed: {failure}")))
    }

    /// The command of the run.
    fn command(&self, dataset: &Path, out: &Path) -> Command {
        match &self.tracker.how {
            How::Own(arguments) => {
                let mut command = Command::new(self.microsig);
                command.arg("track").arg(dataset).args(arguments).arg("--out").arg(out);
                command.args(["--force", "--quiet", "--json"]);
                command
            }
            How::Command { folder, command: words, python } => {
                let first = words.first().map_or("python", String::as_str);
                let program = if first == "python" { python.clone() } else { PathBuf::from(first) };
                let mut command = Command::new(program);
                command.current_dir(folder).args(words.iter().skip(1)).arg(dataset).arg("--out").arg(out);
                if let Some(params) = self.tracker.params(self.case) {
                    command.arg("--params").arg(params);
                }
                command
            }
        }
    }

    /// A hash of everything that determines the result: images, program, parameters.
    fn inputs(&self, dataset: &Path) -> anyhow::Result<String> {
        let sums = dataset.join("SHA256SUMS");
        let sums = std::fs::read_to_string(&sums).with_context(|| sums.display().to_string())?;
        // The result does not depend on the truth, whose hashes are in the manifest.
        let seen = ["  images/", "  calibration/", "  settings.txt", "  truth/frames.csv"];
        let mut parts: Vec<String> = sums
            .lines()
            .filter(|line| seen.iter().any(|path| line.contains(path)))
            .map(str::to_owned)
            .collect();
        match &self.tracker.how {
            How::Own(arguments) => {
                let said = Command::new(self.microsig).args(["--version", "--json"]).output()?.stdout;
                parts.extend([String::from_utf8_lossy(&said).into_owned(), arguments.join(" ")]);
            }
            How::Command { folder, command, .. } => {
                let common = folder.with_file_name("common");
                for folder in [folder, &common] {
                    for (path, hash) in suite::tree(folder).unwrap_or_default() {
                        if is_input(&path) {
                            parts.push(format!("{path} {hash}"));
                        }
                    }
                }
                parts.push(command.join(" "));
                if let Some(params) = self.tracker.params(self.case) {
                    parts.push(suite::sha256(&params)?);
                }
            }
        }
        Ok(suite::sha256_of(parts.join("\n").as_bytes()))
    }

    /// The test split without its truth: links to the files that trackers may read.
    fn blind(&self, dataset: &Path) -> anyhow::Result<PathBuf> {
        let blind = self.work.join("blind").join(self.case.folder());
        if blind.exists() {
            std::fs::remove_dir_all(&blind)?;
        }
        for path in suite::tree(dataset)?.into_keys() {
            if HIDDEN.iter().any(|hidden| path == *hidden || path.starts_with(&format!("{hidden}/"))) {
                continue;
            }
            let to = blind.join(&path);
            std::fs::create_dir_all(to.parent().context("a file is in a folder")?)?;
            let from = dataset.join(&path);
            if std::fs::hard_link(&from, &to).is_err() {
                std::fs::copy(&from, &to)?;
            }
        }
        Ok(blind)
    }
}

/// Whether a run depends on this file of a tracker's folder or of the shared folder: not on searches and
/// training, nor on parameters of other cases, nor on the description.
fn is_input(path: &str) -> bool {
    let is_source = [".py", ".json", ".txt", ".onnx"].iter().any(|end| path.ends_with(end));
    is_source && !path.starts_with("params") && !["tune.py", "tuning.py", "train.py"].contains(&path)
}

/// Waits for a process; if it exceeds the limit, it is stopped and the result is `None`.
fn wait(mut child: Child, limit: Duration) -> anyhow::Result<Option<ExitStatus>> {
    let start = Instant::now();
    loop {
        if let Some(status) = child.try_wait()? {
            return Ok(Some(status));
        }
        if start.elapsed() > limit {
            child.kill()?;
            child.wait()?;
            return Ok(None);
        }
        std::thread::sleep(Duration::from_millis(20));
    }
}

/// The time per frame that a tracker reports in a line of JSON, excluding startup and reading.
fn reported_time(said: &str) -> Option<f64> {
    let reported = |line: &str| serde_json::from_str::<Value>(line).ok()?["seconds_per_frame"].as_f64();
    said.lines().rev().find_map(reported)
}

fn last_line(said: &str) -> Option<String> {
    said.lines().rev().map(str::trim).find(|line| !line.is_empty()).map(str::to_owned)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn searches_of_parameters_are_no_input_of_a_run() {
        for path in ["track.py", "cli.py", "requirements.txt", "model.onnx"] {
            assert!(is_input(path), "{path}");
        }
        for path in [
            "tune.py",
            "tuning.py",
            "train.py",
            "tuning.csv",
            "tracker.toml",
            "params/P2/snr_2.json",
            "README.md",
        ] {
            assert!(!is_input(path), "{path}");
        }
    }
}
