//! Trackers and scores over the cases of a sweep: `microsig sweep --track --evaluate --plot`.
//!
//! Results are `results/METHOD/CASE.csv` in the sweep's folder, scores `scores/METHOD/CASE/`, and plots of
//! the scores against the axes `comparison/`. They equal those of `microsig track`, `evaluate` and `compare`.

use std::path::{Path, PathBuf};

use clap::Args;

use super::Common;
use super::output::{progress, say, warn};
use super::track::methods;
use crate::report;
use generator::runner::{SweepOptions, Swept};
use scenario::Case;
use scoring::evaluate::{EvaluateOptions, evaluate_files};
use storage::checksums::SHA256SUMS;
use storage::error::{Error, Result};
use tracking::{TrackOptions, track};

/// What is done with the cases of a sweep.
#[derive(Debug, Args)]
pub(super) struct SweepScores {
    /// Run these trackers on every case of the shard; results go to results/METHOD/CASE.csv in the sweep's
    /// folder
    #[arg(long, value_name = "METHOD", value_delimiter = ',', value_parser = methods())]
    track: Vec<String>,
    /// Score the results into scores/METHOD/CASE/
    #[arg(long, requires = "track")]
    evaluate: bool,
    /// Plot the scores against the axes of the sweep into comparison/leaderboard.html, once all shards are
    /// done
    #[arg(long, requires = "evaluate")]
    plot: bool,
}

/// A result of a tracker on a case, and its scores.
struct Entry<'a> {
    method: &'a str,
    dataset: PathBuf,
    result: PathBuf,
    scores: PathBuf,
}

impl SweepScores {
    /// Checks, before cases are generated, that results can be written below the sweep's folder.
    ///
    /// # Errors
    /// A folder in a dataset.
    pub(super) fn check(&self, out: &Path) -> Result<()> {
        if self.track.is_empty() { Ok(()) } else { storage::outside_datasets(&out.join("results")) }
    }

    /// Tracks, scores and plots the cases of a shard; failed cases are left out.
    ///
    /// # Errors
    /// Existing results, unless they are replaced or, with `resume`, kept if they are newer than what they
    /// are made of; a tracker that cannot be run.
    pub(super) fn run(
        &self,
        cases: &[&Case],
        swept: &Swept,
        options: &SweepOptions,
        seed: u64,
        common: &Common,
    ) -> Result<()> {
        let (resume, replace) = (options.resume, options.force || options.resume);
        let entries: Vec<Entry> =
            self.track.iter().flat_map(|method| self.entries(method, &swept.out, cases)).collect();
        let is_new = |made: &Path, of: &Path| resume && !is_older(made, of);
        for entry in entries.iter().filter(|entry| !is_new(&entry.result, &entry.dataset.join(SHA256SUMS))) {
            let options =
                TrackOptions { seed, force: replace, ..TrackOptions::of(entry.method, progress(common)) };
            create_parent(&entry.result)?;
            let tracked = track(&entry.dataset, &entry.result, &options)?;
            warn(&tracked.warnings, common);
            say(&format!("{} rows in {}", tracked.rows, tracked.out.display()), common);
        }
        if !self.evaluate {
            return Ok(());
        }
        if swept.done + swept.failed < swept.cases {
            let hint = "scores and plots need all cases: run again with --resume and --shard 1/1";
            say(hint, common);
            return Ok(());
        }
        for entry in entries.iter().filter(|entry| !is_new(&entry.scores.join(report::SCORE), &entry.result))
        {
            let evaluation = evaluate_files(&entry.dataset, &entry.result, &EvaluateOptions::default())?;
            warn(&evaluation.score.warnings, common);
            create_parent(&entry.scores)?;
            report::write(&entry.scores, &evaluation, false, replace)?;
        }
        if self.plot {
            let scores: Vec<PathBuf> = entries.into_iter().map(|entry| entry.scores).collect();
            let out = swept.out.join("comparison");
            // The comparison depends on the scores only, so an existing one may be replaced.
            report::compare(&scores, &out, replace)?;
            say(&format!("scores over the sweep in {}", out.join("leaderboard.html").display()), common);
        }
        Ok(())
    }

    fn entries<'a>(&self, method: &'a str, out: &Path, cases: &[&Case]) -> Vec<Entry<'a>> {
        let of = |case: &Case| Entry {
            method,
            dataset: out.join(&case.name),
            result: out.join("results").join(method).join(format!("{}.csv", case.name)),
            scores: out.join("scores").join(method).join(&case.name),
        };
        cases.iter().copied().map(of).filter(|entry| entry.dataset.is_dir()).collect()
    }
}

/// Whether a file is missing or was written before another one.
fn is_older(file: &Path, than: &Path) -> bool {
    let written = |path: &Path| path.metadata().and_then(|metadata| metadata.modified()).ok();
    written(file).zip(written(than)).is_none_or(|(file, than)| file < than)
}

fn create_parent(path: &Path) -> Result<()> {
    let folder = path.parent().unwrap_or(Path::new("."));
    std::fs::create_dir_all(folder).map_err(Error::write(folder))
}
