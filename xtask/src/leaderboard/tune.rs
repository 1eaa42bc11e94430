//! `cargo xtask leaderboard --tune`: searches parameters of third-party trackers on the splits whose truth
//! participants have.
//!
//! `tune` in `tracker.toml` lists tracks or cases with separate parameters, `tune_once` single cases whose
//! parameters apply to their whole track (for trackers too slow to be tuned on each case). The tracker's
//! `tune.py` contains the values to try and the number of evaluations. Existing parameters are kept.

use std::path::{Path, PathBuf};
use std::process::Command;

use anyhow::Context;

use super::Case;
use super::trackers::{How, Tracker};
use suite::process;

/// Searches parameters of a tracker for a case; returns what happened, or `None` if it is not tuned there.
pub(super) fn search(
    microsig: &Path,
    datasets: &Path,
    tracker: &Tracker,
    case: &Case,
) -> anyhow::Result<Option<String>> {
    let How::Command { folder, python, .. } = &tracker.how else { return Ok(None) };
    let Some(params) = tracker.tuning.params(case) else { return Ok(None) };
    if folder.join(&params).is_file() {
        return Ok(Some(format!("{} already exists", params.display())));
    }
    let dataset = datasets.join(case.folder());
    let start = PathBuf::from(format!("params/start/{}.json", case.track));
    let mut command = Command::new(python);
    command.current_dir(folder).env("MICROSIG", microsig).arg("tune.py").arg(dataset.join("train"));
    command.arg("--val").arg(dataset.join("val")).arg("--out").arg(&params).args(["--log", "tuning.csv"]);
    if folder.join(&start).is_file() {
        command.arg("--start").arg(&start);
    }
    if !case.rules.is_empty() {
        command.arg(format!("--evaluate={}", case.rules.join(" ")));
    }
    let (usage, _) = process::run(&mut command).context("tune.py")?;
    Ok(Some(format!("{} after {:.0} s", params.display(), usage.wall_s)))
}
