//! Scores of trackers on a suite: one table of all cases, ranked case by case.
//!
//! Results are in `RESULTS/TRACKER/TRACK/CASE/results.csv`; each is scored by `evaluate` against the test
//! split of its case. Scores of different cases are never averaged: of two trackers, the one that is better in more
//! cases of a track is ahead in its standing; a missing or refused result is behind all others.

mod metrics;
mod page;
mod participants;
mod site;
mod table;

use std::path::{Path, PathBuf};

use rayon::prelude::*;
use serde::{Deserialize, Serialize};

pub use metrics::MetricValue;
pub use page::{Annotations, page};

use crate::report;
use dataset::manifest::GENERATOR_VERSION;
use generator::runner::{SuiteRecord, SuiteSelection};
use scenario::{Metric, Size, Split, Suite, SuiteCase, TrackSpec};
use scoring::evaluate::{EvaluateOptions, Evaluation, Truth, UnitScores, evaluate_files};
use scoring::ranking::{Contestant, Pairs, ScoreDef, pairs, ranks_fields};
use site::Site;
use storage::error::{Error, Result};
use storage::folder::{Earlier, Partial, check_replaceable};
use storage::{InputFile, OutputFolder};

/// Name of the table of all scores.
pub const SUITE_SCORES_CSV: &str = "suite_scores.csv";
/// Name of the same table as JSON, with standings.
pub const SUITE_SCORES: &str = "suite_scores.json";
/// Name of the page with tables and curves.
pub const PAGE: &str = "index.html";
/// Folder of the complete scores: `TRACKER/TRACK/CASE/score.json` and its tables.
pub const SCORES: &str = "scores";
/// Name of a tracker's result for a case.
pub const RESULT: &str = "results.csv";

/// Scores of all trackers on a suite.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct SuiteScores {
    /// Name of the suite.
    pub suite: String,
    /// Version of the suite.
    pub version: String,
    /// Size.
    pub size: Size,
    /// Version of the program that scored.
    pub microsig: String,
    /// The standing of each tracker in each track it has entered.
    pub standings: Vec<Standing>,
    /// Every case with the results of all trackers that have entered its track.
    pub cases: Vec<CaseScores>,
    /// Warning of a file system without locks.
    #[serde(skip)]
    pub warning: Option<String>,
}

/// Results for a case.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct CaseScores {
    /// Track.
    pub track: String,
    /// Ladder.
    pub ladder: String,
    /// Case.
    pub case: String,
    /// Name of the dataset.
    pub dataset: String,
    /// The values that distinguish the case from others of its ladder.
    pub axes: Vec<CaseAxis>,
    /// The scores by which the case is ranked.
    pub rank_by: Vec<Metric>,
    /// The results, best first; missing ones last.
    pub results: Vec<CaseResult>,
    /// Number of independent units of the truth, which the comparisons resample: true tracks, or squares of nodes.
    #[serde(default)]
    pub units: usize,
}

/// Value of an axis of a case.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct CaseAxis {
    /// Name of the quantity.
    pub label: String,
    /// Its value, as shown.
    pub shown: String,
    /// Its value, if it is a number.
    pub number: Option<f64>,
}

/// Status of a tracker's result for a case.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Status {
    /// It has scores.
    Scored,
    /// There is no result.
    Missing,
    /// It cannot be scored.
    Refused,
}

/// A tracker's result for a case.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct CaseResult {
    /// Tracker.
    pub tracker: String,
    /// Whether it is scored.
    pub status: Status,
    /// Why it is refused.
    pub reason: Option<String>,
    /// 1 + the number of results that are better, directly or through others; null without scores.
    pub rank: Option<usize>,
    /// Trackers whose results are significantly better.
    #[serde(default)]
    pub behind: Vec<String>,
    /// Its scores: those that rank first, then all others that are defined.
    pub scores: Vec<MetricValue>,
    /// Number of frames or image pairs that it leaves out.
    #[serde(default)]
    pub missing: usize,
    /// Caveats of the evaluation.
    pub warnings: Vec<String>,
}

/// Standing of a tracker in a track.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Standing {
    /// Track.
    pub track: String,
    /// Tracker.
    pub tracker: String,
    /// Cases of the track.
    pub cases: usize,
    /// Cases with scores.
    pub scored: usize,
    /// Cases whose result is refused.
    pub refused: usize,
    /// 1 + the number of trackers that are ahead, directly or through others. Of two trackers, the one that is better in
    /// more cases is ahead.
    pub rank: usize,
    /// Number of cases in which no tracker is better.
    pub first: usize,
}

/// Options of [`score`].
#[derive(Debug, Clone)]
pub struct ScoreOptions {
    /// The results, a folder for each tracker.
    pub results: PathBuf,
    /// Folder of the scores.
    pub out: PathBuf,
    /// Folder of a site of the leaderboard.
    pub site: Option<PathBuf>,
    /// Replace existing scores.
    pub force: bool,
    /// Only these tracks and cases.
    pub selection: SuiteSelection,
    /// Seed of the bootstrap.
    pub seed: u64,
}

/// A result and its evaluation.
type Scored = (String, std::result::Result<Option<Evaluation>, String>);

/// Scores all results, and writes `suite_scores.csv`, `suite_scores.json`, `index.html` and the complete
/// scores of each.
///
/// # Errors
/// A folder of another suite or version; a missing test split; existing scores, unless `force`; an I/O error.
pub fn score(suite: &Suite, datasets: &Path, options: &ScoreOptions) -> Result<SuiteScores> {
    let record = SuiteRecord::read(datasets)?;
    record.matches(suite, datasets)?;
    let earlier = Earlier::new(SUITE_SCORES, options.force);
    check_replaceable(&options.out, earlier)?;
    let chosen = SuiteSelection { split: Some(Split::Test), ..options.selection.clone() };
    let cases: Vec<SuiteCase> = chosen.of(suite, record.size)?.into_iter().map(|(case, _)| case).collect();
    let trackers = trackers(&options.results)?;
    refuse_unknown(suite, record.size, &trackers, &options.results)?;
    let more = participants::annotations(&options.results, &trackers, &suite.cases(record.size)?)?;
    let mut site = options.site.as_deref().map(|folder| Site::start(folder, options.force)).transpose()?;
    let partial = Partial::start(&options.out)?;
    let mut all = Vec::new();
    for track in &suite.spec.tracks {
        let of_track: Vec<&SuiteCase> = cases.iter().filter(|case| case.track == track.name).collect();
        let has_entered = |tracker: &&String| options.results.join(tracker).join(&track.name).is_dir();
        let entered: Vec<&String> = trackers.iter().filter(has_entered).collect();
        // A track that has not been generated is left out, unless there are results for it.
        if entered.is_empty() && !datasets.join(&track.name).is_dir() {
            continue;
        }
        for case in of_track {
            all.push(scored_case(
                track,
                case,
                &entered,
                (datasets, partial.folder(), site.as_mut()),
                options,
            )?);
        }
    }
    let scores = SuiteScores {
        suite: record.name,
        version: record.version,
        size: record.size,
        microsig: GENERATOR_VERSION.to_owned(),
        standings: standings(&suite.spec.tracks.iter().map(|track| &*track.name).collect::<Vec<_>>(), &all),
        cases: all,
        warning: partial.warning().map(str::to_owned),
    };
    let csv = table::csv(&scores)?;
    partial.folder().save_bytes(SUITE_SCORES_CSV, &csv)?;
    let json = serde_json::to_string_pretty(&scores).map_err(|e| Error::input(e.to_string()))? + "\n";
    partial.folder().save_bytes(SUITE_SCORES, &json)?;
    partial.folder().save_bytes(PAGE, page(&scores, &more)?)?;
    if let Some(site) = site {
        let more = Annotations { reports: site.reports().clone(), is_site: true, ..more };
        site.finish(suite, &scores, &page(&scores, &more)?, [&csv, json.as_bytes()])?;
    }
    partial.finish(earlier)?;
    Ok(scores)
}

impl SuiteScores {
    /// The standings and all cases as text.
    pub fn text(&self) -> String {
        table::text(self)
    }

    /// Reads `suite_scores.json`.
    ///
    /// # Errors
    /// A file that is not a score file of a suite.
    pub fn read(path: &Path) -> Result<Self> {
        storage::json::parse(&storage::read_text(path)?)
            .map_err(|e| Error::input(format!("{}: {e}", path.display())))
    }
}

impl CaseResult {
    /// The value of a score.
    pub fn value(&self, metric: Metric) -> Option<MetricValue> {
        self.scores.iter().find(|score| score.metric == metric).copied()
    }
}

/// The folders of a folder, sorted.
fn folders(folder: &Path) -> Result<Vec<String>> {
    let mut names = Vec::new();
    for entry in std::fs::read_dir(folder).map_err(|e| Error::read(folder, e))? {
        let path = entry.map_err(|e| Error::read(folder, e))?.path();
        let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        if path.is_dir() && !name.starts_with('.') {
            names.push(name);
        }
    }
    names.sort();
    Ok(names)
}

fn trackers(results: &Path) -> Result<Vec<String>> {
    let names = folders(results)?;
    if names.is_empty() {
        let expected = format!("TRACKER/TRACK/CASE/{RESULT}");
        return Err(Error::input(format!("{}: no results; expected {expected}", results.display())));
    }
    Ok(names)
}

/// Refuses results for tracks and cases that the suite does not have: a misspelled name would otherwise count
/// as a missing result.
fn refuse_unknown(suite: &Suite, size: Size, trackers: &[String], results: &Path) -> Result<()> {
    let cases = suite.cases(size)?;
    let mut unknown = Vec::new();
    for tracker in trackers {
        let of_tracker = results.join(tracker);
        for track in folders(&of_tracker)? {
            let of_track = of_tracker.join(&track);
            if !suite.spec.tracks.iter().any(|known| known.name == track) {
                unknown.push(format!("{}: suite {} has no such track", of_track.display(), suite.spec.name));
                continue;
            }
            for case in folders(&of_track)? {
                if !cases.iter().any(|known| known.track == track && known.name == case) {
                    let (path, size) = (of_track.join(&case), size.name());
                    unknown
                        .push(format!("{}: track {track} has no such case at size {size}", path.display()));
                }
            }
        }
    }
    if unknown.is_empty() { Ok(()) } else { Err(Error::Input(unknown)) }
}

fn scored_case(
    track: &TrackSpec,
    case: &SuiteCase,
    entered: &[&String],
    (datasets, out, mut site): (&Path, &OutputFolder, Option<&mut Site>),
    options: &ScoreOptions,
) -> Result<CaseScores> {
    let dataset = datasets.join(case.split_folder(Split::Test));
    if !dataset.is_dir() {
        let hint = "missing; `microsig suite generate --resume` generates it";
        return Err(Error::input(format!("{}: {hint}", dataset.display())));
    }
    let rules = EvaluateOptions {
        gate_xy_px: track.gate_xy_px,
        gate_z_um: track.gate_z_um,
        dims: case.dims,
        seed: options.seed,
        ..EvaluateOptions::default()
    };
    // A truth that cannot be read is no fault of a tracker.
    let is_of_fields = ranks_fields(&case.rank_by);
    Truth::read(&dataset, is_of_fields, &rules)?;
    let evaluated: Vec<Scored> = entered
        .par_iter()
        .map(|tracker| {
            // Reasons are published: paths begin at the folder of the results.
            let shown = Path::new(tracker).join(case.folder()).join(RESULT);
            let result = options.results.join(&shown);
            let found = result.exists().then(|| {
                let result = InputFile::shown_as(result, shown);
                evaluate_files(&dataset, result, &rules).map_err(|e| e.to_string())
            });
            ((*tracker).clone(), found.transpose())
        })
        .collect();
    let (mut results, mut scored, mut others) = (Vec::new(), Vec::new(), Vec::new());
    for (tracker, evaluation) in evaluated {
        if let Ok(Some(evaluation)) = &evaluation {
            let folder = out.subfolder(&format!("{SCORES}/{tracker}/{}", case.folder()))?;
            report::write_into(&folder, evaluation, false)?;
            if let Some(site) = &mut site {
                site.add(&format!("{tracker}/{}", case.folder()), evaluation)?;
            }
        }
        match result(case, tracker, &evaluation) {
            result if result.status == Status::Scored => {
                scored.extend(evaluation.ok().flatten().map(|e| (result, e)))
            }
            result => others.push(result),
        }
    }
    let contestants: Vec<Contestant<'_>> = scored
        .iter()
        .map(|(_, evaluation)| Contestant { score: &evaluation.score, units: Some(&evaluation.units) })
        .collect();
    let units = contestants.iter().filter_map(|of| of.units).map(UnitScores::n_units).max().unwrap_or(0);
    let better = pairs(&contestants, &case.rank_by, options.seed);
    for (i, rank) in better.ranks() {
        let ahead = (0..scored.len()).filter(|j| better.is_better(*j, i));
        let behind = ahead.map(|j| scored[j].0.tracker.clone()).collect();
        results.push(CaseResult { rank: Some(rank), behind, ..scored[i].0.clone() });
    }
    results.extend(others);
    let axes = case.axes.iter().cloned();
    Ok(CaseScores {
        track: track.name.clone(),
        ladder: case.ladder.clone(),
        case: case.name.clone(),
        dataset: format!("{}-test", case.dataset()),
        axes: axes.map(|a| CaseAxis { label: a.label, shown: a.shown, number: a.number }).collect(),
        rank_by: case.rank_by.clone(),
        results,
        units,
    })
}

/// The result of a tracker without its rank.
fn result(
    case: &SuiteCase,
    tracker: String,
    evaluation: &std::result::Result<Option<Evaluation>, String>,
) -> CaseResult {
    let none = |status, reason| CaseResult {
        tracker: tracker.clone(),
        status,
        reason,
        rank: None,
        behind: Vec::new(),
        scores: Vec::new(),
        missing: 0,
        warnings: Vec::new(),
    };
    let evaluation = match evaluation {
        Ok(Some(evaluation)) => evaluation,
        Ok(None) => return none(Status::Missing, None),
        Err(reason) => return none(Status::Refused, Some(reason.clone())),
    };
    let score = &match report::redacted(&evaluation.score) {
        Ok(released) => released,
        Err(e) => return none(Status::Refused, Some(e.to_string())),
    };
    let mut scores: Vec<MetricValue> =
        case.rank_by.iter().map(|metric| MetricValue::of(*metric, score)).collect();
    let others = ScoreDef::metrics().filter(|metric| !case.rank_by.contains(metric));
    scores.extend(others.map(|metric| MetricValue::of(metric, score)).filter(|value| value.value.is_some()));
    // Fields have no scores of particles, and vice versa.
    let ranks_fields = ranks_fields(&case.rank_by);
    if evaluation.score.field.is_some() != ranks_fields {
        let kind = if evaluation.score.field.is_some() { "a displacement field" } else { "particles" };
        return none(
            Status::Refused,
            Some(format!("{kind}; track {} ranks results of another kind", case.track)),
        );
    }
    CaseResult {
        scores,
        missing: evaluation.score.missing(),
        warnings: score.caveats().map(str::to_owned).collect(),
        ..none(Status::Scored, None)
    }
}

/// The standing of every tracker in every track, best first.
fn standings(tracks: &[&str], cases: &[CaseScores]) -> Vec<Standing> {
    let mut all = Vec::new();
    for track in tracks {
        let of_track: Vec<&CaseScores> = cases.iter().filter(|case| case.track == *track).collect();
        let mut trackers: Vec<&String> =
            of_track.iter().flat_map(|case| case.results.iter().map(|result| &result.tracker)).collect();
        trackers.sort();
        trackers.dedup();
        // 1 for a case in which the first is better, -1 for one in which the second is.
        let difference = |case: &&CaseScores, a: &String, b: &String| {
            let of = |tracker: &String| case.results.iter().find(|result| result.tracker == *tracker);
            let is_behind = |one: Option<&CaseResult>, other: Option<&CaseResult>| {
                let is_scored = |of: Option<&CaseResult>| of.is_some_and(|of| of.status == Status::Scored);
                let other_name = other.map_or("", |other| &other.tracker);
                is_scored(other)
                    && (!is_scored(one)
                        || one.is_some_and(|one| one.behind.iter().any(|of| of == other_name)))
            };
            i32::from(is_behind(of(b), of(a))) - i32::from(is_behind(of(a), of(b)))
        };
        let better = Pairs::new(trackers.len(), |a, b| {
            of_track.iter().map(|case| difference(case, trackers[b], trackers[a])).sum::<i32>().cmp(&0)
        });
        let mut ranks = vec![0; trackers.len()];
        better.ranks().into_iter().for_each(|(i, rank)| ranks[i] = rank);
        let mut standings: Vec<Standing> = trackers
            .iter()
            .zip(ranks)
            .map(|(tracker, rank)| {
                let own: Vec<&CaseResult> = of_track
                    .iter()
                    .flat_map(|case| case.results.iter().filter(|r| r.tracker == **tracker))
                    .collect();
                let count = |status| own.iter().filter(|result| result.status == status).count();
                Standing {
                    track: (*track).to_owned(),
                    tracker: (*tracker).clone(),
                    cases: of_track.len(),
                    scored: count(Status::Scored),
                    refused: count(Status::Refused),
                    rank,
                    first: own.iter().filter(|result| result.rank == Some(1)).count(),
                }
            })
            .collect();
        standings.sort_by(|a, b| a.rank.cmp(&b.rank).then_with(|| a.tracker.cmp(&b.tracker)));
        all.extend(standings);
    }
    all
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Cases with (tracker, those it is behind); `-` for a result that is missing.
    fn standing(cases: &[&[(&str, &[&str])]]) -> Vec<(String, usize)> {
        let of = |(tracker, behind): &(&str, &[&str])| CaseResult {
            tracker: (*tracker).to_owned(),
            status: if *behind == ["-"] { Status::Missing } else { Status::Scored },
            behind: behind.iter().map(|name| (*name).to_owned()).collect(),
            reason: None,
            rank: None,
            scores: Vec::new(),
            missing: 0,
            warnings: Vec::new(),
        };
        let cases: Vec<CaseScores> = cases
            .iter()
            .map(|results| CaseScores {
                track: "T".to_owned(),
                ladder: String::new(),
                case: String::new(),
                dataset: String::new(),
                axes: Vec::new(),
                rank_by: vec![Metric::F1],
                results: results.iter().map(of).collect(),
                units: 0,
            })
            .collect();
        standings(&["T"], &cases).into_iter().map(|s| (s.tracker, s.rank)).collect()
    }

    #[test]
    fn the_order_of_two_trackers_does_not_depend_on_others() {
        let rank =
            |of: &[(String, usize)], name: &str| of.iter().find(|(tracker, _)| tracker == name).unwrap().1;
        // Each is better in one case.
        let two = standing(&[&[("A", &[]), ("B", &["A"])], &[("A", &["B"]), ("B", &[])]]);
        assert_eq!((rank(&two, "A"), rank(&two, "B")), (1, 1));
        // Copies of A, and a folder without results.
        let more = standing(&[
            &[("A", &[]), ("A2", &[]), ("A3", &[]), ("B", &["A", "A2", "A3"]), ("none", &["-"])],
            &[("A", &["B"]), ("A2", &["B"]), ("A3", &["B"]), ("B", &[]), ("none", &["-"])],
        ]);
        assert_eq!((rank(&more, "A"), rank(&more, "B"), rank(&more, "none")), (1, 1, 5));
        // A missing case counts as behind the others, as often with more folders without results.
        let missing = standing(&[&[("A", &[]), ("B", &["-"])], &[("A", &[]), ("B", &[])]]);
        assert_eq!((rank(&missing, "A"), rank(&missing, "B")), (1, 2));
        let missing = standing(&[
            &[("A", &[]), ("B", &["-"]), ("x", &["-"]), ("y", &["-"])],
            &[("A", &[]), ("B", &[]), ("x", &["-"]), ("y", &["-"])],
        ]);
        assert_eq!((rank(&missing, "A"), rank(&missing, "B")), (1, 2));
    }
}
