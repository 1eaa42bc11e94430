//! Trackers and scores over the cases of a sweep: `microsig sweep --track --evaluate --plot`.
//!
//! Results are `results/METHOD/CASE.csv` in the sweep's folder, also of other programs, scores
//! `scores/METHOD/CASE/`, and plots of the scores against the axes `comparison/`. They equal what `microsig track`, `evaluate` and `compare` write.

use std::path::{Path, PathBuf};

use clap::Args;

use super::Common;
use super::output::{say, warn};
use super::track::{TrackerOptions, methods};
use arena::report;
use generator::runner::{SweepOptions, Swept};
use scenario::Case;
use scoring::evaluate::{EvaluateOptions, evaluate_files};
use storage::InputFile;
use storage::checksums::SHA256SUMS;
use storage::dataset::RecordingFacts;
use storage::error::{Error, Result};
use tracking::{TrackOptions, track};

/// What is done with the cases of a sweep.
#[derive(Debug, Args)]
pub(super) struct SweepScores {
    /// Run these trackers on every case of the shard; results go to results/METHOD/CASE.csv in the sweep's
    /// folder
    #[arg(long, value_name = "METHOD", value_delimiter = ',', value_parser = methods())]
    track: Vec<String>,
    /// Score all results, also of other programs in results/NAME/CASE.csv, into scores/NAME/CASE/
    #[arg(long)]
    evaluate: bool,
    /// Add the Cramér-Rao bound of each case to its scores (takes a while)
    #[arg(long, requires = "evaluate")]
    crlb: bool,
    /// Plot the scores against the axes of the sweep into comparison/leaderboard.html, once all shards are
    /// done
    #[arg(long, requires = "evaluate")]
    plot: bool,
    #[command(flatten)]
    tracker: TrackerOptions,
}

/// Warnings of many cases: the first of those that differ in numbers only, with their count.
#[derive(Default)]
struct Warnings(Vec<(String, String, usize)>);

impl Warnings {
    fn add(&mut self, texts: impl IntoIterator<Item = impl ToString>) {
        for text in texts {
            let text = text.to_string();
            let form = text.replace(|c: char| c.is_ascii_digit() || c == '.', "");
            match self.0.iter_mut().find(|known| known.0 == form) {
                Some((_, _, count)) => *count += 1,
                None => self.0.push((form, text, 1)),
            }
        }
    }

    fn print(&self, common: &Common) {
        let text = |(_, first, count): &(String, String, usize)| match count {
            1 => first.clone(),
            count => format!("{first} (in {count} cases, here the first)"),
        };
        warn(self.0.iter().map(text), common);
    }
}

/// A result of a tracker on a case, and its scores.
struct Entry {
    tracker: String,
    dataset: PathBuf,
    result: PathBuf,
    scores: PathBuf,
}

impl SweepScores {
    /// Checks, before cases are generated, that results can be written below the sweep's folder.
    pub(super) fn check(&self, out: &Path) -> Result<()> {
        if self.track.is_empty() && self.tracker.are_given() {
            let why = "options of trackers (--max-displacement, ...): expected with --track METHOD";
            return Err(Error::input(why));
        }
        let has_results = self.evaluate || !self.track.is_empty();
        if has_results { storage::outside_datasets(&out.join("results")) } else { Ok(()) }
    }

    /// Tracks, scores and plots the cases of a shard; failed cases are left out.
    pub(super) fn run(
        &self,
        cases: &[&Case],
        swept: &Swept,
        options: &SweepOptions,
        seed: u64,
        common: &Common,
    ) -> Result<()> {
        let mut warnings = Warnings::default();
        let done = self.all(cases, swept, options, seed, (&mut warnings, common));
        warnings.print(common);
        done
    }

    fn all(
        &self,
        cases: &[&Case],
        swept: &Swept,
        options: &SweepOptions,
        seed: u64,
        (warnings, common): (&mut Warnings, &Common),
    ) -> Result<()> {
        let (resume, replace) = (options.resume, options.force || options.resume);
        let mut entries: Vec<Entry> =
            self.track.iter().flat_map(|method| entries_of(method, &swept.out, cases)).collect();
        let is_new = |made: &Path, of: &Path| resume && !is_older(made, of);
        for entry in entries.iter().filter(|entry| !is_new(&entry.result, &entry.dataset.join(SHA256SUMS))) {
            let options = TrackOptions { seed, force: replace, ..self.tracker.of(&entry.tracker, common)? };
            create_parent(&entry.result)?;
            let tracked = track(&entry.dataset, &entry.result, &options)?;
            warnings.add(tracked.warnings);
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
        for name in self.others(&swept.out)? {
            let of_all = entries_of(&name, &swept.out, cases);
            let all = of_all.len();
            let given: Vec<Entry> = of_all.into_iter().filter(|entry| entry.result.is_file()).collect();
            if given.len() < all {
                let missing = all - given.len();
                warnings.add([format!(
                    "results/{name}: {missing} of {all} cases have no CASE.csv and are not scored"
                )]);
            }
            entries.extend(given);
        }
        if entries.is_empty() {
            let results = swept.out.join("results");
            return Err(Error::input(format!(
                "--evaluate: expected --track METHOD, or results of another program as {}/NAME/CASE.csv",
                results.display()
            )));
        }
        for entry in entries.iter().filter(|entry| !is_new(&entry.scores.join(report::SCORE), &entry.result))
        {
            let options = EvaluateOptions {
                crlb: self.crlb,
                context: common.context.clone(),
                ..EvaluateOptions::default()
            };
            let evaluation = evaluate_files(&entry.dataset, &entry.result, &options)?;
            warnings.add(evaluation.score.caveats());
            create_parent(&entry.scores)?;
            let written = report::write(&entry.scores, &evaluation, false, replace)?;
            warnings.add(written.warning);
        }
        if self.plot {
            let px_per_um_s = px_per_um_s(&entries)?;
            let scores: Vec<InputFile> = entries.into_iter().map(|entry| entry.scores.into()).collect();
            let out = swept.out.join("comparison");
            // The comparison depends on the scores only, so an existing one may be replaced.
            report::compare_sweep(&scores, &out, replace, px_per_um_s)?;
            say(&format!("scores over the sweep in {}", out.join("leaderboard.html").display()), common);
        }
        Ok(())
    }

    /// Folders of results that are not of `--track`, in the order of their names.
    fn others(&self, out: &Path) -> Result<Vec<String>> {
        let folder = out.join("results");
        if !folder.is_dir() {
            return Ok(Vec::new());
        }
        storage::walk::names(&folder, |name| {
            folder.join(name).is_dir() && !self.track.iter().any(|own| own == name)
        })
    }
}

/// The results and scores of a tracker on the cases that were generated.
fn entries_of(tracker: &str, out: &Path, cases: &[&Case]) -> Vec<Entry> {
    let of = |case: &Case| Entry {
        tracker: tracker.to_owned(),
        dataset: out.join(&case.name),
        result: out.join("results").join(tracker).join(format!("{}.csv", case.name)),
        scores: out.join("scores").join(tracker).join(&case.name),
    };
    cases.iter().copied().map(of).filter(|entry| entry.dataset.is_dir()).collect()
}

/// The displacement (px) of 1 um/s, if it is the same in all cases.
fn px_per_um_s(entries: &[Entry]) -> Result<Option<f64>> {
    let of = |entry: &Entry| {
        let facts = RecordingFacts::read(&entry.dataset)?;
        Ok(facts.dt_s.zip(facts.um_per_px).map(|(dt_s, um_per_px)| dt_s / um_per_px))
    };
    let all: Vec<Option<f64>> = entries.iter().map(of).collect::<Result<_>>()?;
    Ok(all.first().copied().flatten().filter(|first| all.iter().all(|of| *of == Some(*first))))
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_warning_of_many_cases_is_one() {
        let mut warnings = Warnings::default();
        warnings.add(["moves by 1.5 px", "other", "moves by 12.25 px"]);
        let counted: Vec<(&str, usize)> = warnings.0.iter().map(|w| (w.1.as_str(), w.2)).collect();
        assert_eq!(counted, [("moves by 1.5 px", 2), ("other", 1)]);
    }
}
