//! Scores of trackers on a suite: one table of all cases, ranked case by case.
//!
//! Results are in `RESULTS/TRACKER/TRACK/CASE/results.csv`; each is scored by `evaluate` against the test
//! split of its case. Scores of different cases are never averaged: the standing in a track is the mean of
//! the ranks in its cases, in which a missing or refused result has the last rank.

mod anchors;
mod metrics;
mod page;
mod participants;
mod site;
mod table;

use std::path::{Path, PathBuf};

use rayon::prelude::*;
use serde::{Deserialize, Serialize};

pub use anchors::AnchorResult;
pub use metrics::MetricValue;
pub use page::{Annotations, DepthErrors, Picture, page, unmeasured};

use crate::report;
use dataset::manifest::GENERATOR_VERSION;
use generator::runner::{SuiteRecord, SuiteSelection};
use scenario::{Metric, Size, Split, Suite, SuiteCase, TrackSpec};
use scoring::evaluate::{EvaluateOptions, Evaluation, Truth, evaluate_files};
use scoring::ranking::{Contestant, ScoreDef, rank, ranks_fields};
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
    /// Degenerate results (`--anchors`), which are not ranked among the trackers.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub anchors: Vec<AnchorResult>,
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
    /// Rank from 1, shared by results that the intervals do not separate; null without scores.
    pub rank: Option<usize>,
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
    /// Mean rank over all cases of the track; a case without scores counts with the last rank, the number of
    /// trackers that have entered the track.
    pub mean_rank: f64,
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
    /// Also score degenerate results.
    pub anchors: bool,
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
        standings: standings(suite, &all),
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
    /// The anchors that do not rank behind the trackers as they should, one line each.
    pub fn misplaced_anchors(&self) -> Vec<String> {
        let all = self.cases.iter().flat_map(|case| case.anchors.iter().map(move |anchor| (case, anchor)));
        let misplaced = all.filter(|(_, anchor)| !anchor.not_behind.is_empty());
        misplaced
            .map(|(case, anchor)| {
                let (place, name) = (format!("{}/{}", case.track, case.case), &anchor.result.tracker);
                format!("{place}: the anchor {name} does not rank behind {}", anchor.not_behind.join(", "))
            })
            .collect()
    }

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
    let order = rank(&contestants, &case.rank_by, options.seed);
    for (i, place) in &order {
        results.push(CaseResult { rank: Some(*place), ..scored[*i].0.clone() });
    }
    let mut anchors = Vec::new();
    if options.anchors {
        let ranked: Vec<(&CaseResult, &Evaluation)> =
            order.iter().map(|(i, _)| (&scored[*i].0, &scored[*i].1)).collect();
        let file = |tracker: &str| options.results.join(tracker).join(case.folder()).join(RESULT);
        anchors = anchors::of_case(case, datasets, &rules, &ranked, &file)?;
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
        anchors,
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
    if score.field.is_some() != ranks_fields {
        let kind = if score.field.is_some() { "a displacement field" } else { "particles" };
        return none(
            Status::Refused,
            Some(format!("{kind}; track {} ranks results of another kind", case.track)),
        );
    }
    CaseResult {
        scores,
        missing: score.missing(),
        warnings: score.caveats().map(str::to_owned).collect(),
        ..none(Status::Scored, None)
    }
}

/// The standing of every tracker in every track, best first.
fn standings(suite: &Suite, cases: &[CaseScores]) -> Vec<Standing> {
    let mut all = Vec::new();
    for track in &suite.spec.tracks {
        let of_track: Vec<&CaseScores> = cases.iter().filter(|case| case.track == track.name).collect();
        let mut trackers: Vec<&String> =
            of_track.iter().flat_map(|case| case.results.iter().map(|result| &result.tracker)).collect();
        trackers.sort();
        trackers.dedup();
        let last = trackers.len();
        let mut standings: Vec<Standing> = trackers
            .iter()
            .map(|tracker| {
                let own: Vec<&CaseResult> = of_track
                    .iter()
                    .flat_map(|case| case.results.iter().filter(|r| r.tracker == **tracker))
                    .collect();
                let count = |status| own.iter().filter(|result| result.status == status).count();
                let ranks = own.iter().map(|result| result.rank.unwrap_or(last) as f64);
                Standing {
                    track: track.name.clone(),
                    tracker: (*tracker).clone(),
                    cases: of_track.len(),
                    scored: count(Status::Scored),
                    refused: count(Status::Refused),
                    mean_rank: ranks.sum::<f64>() / own.len().max(1) as f64,
                    first: own.iter().filter(|result| result.rank == Some(1)).count(),
                }
            })
            .collect();
        standings.sort_by(|a, b| a.mean_rank.total_cmp(&b.mean_rank).then_with(|| a.tracker.cmp(&b.tracker)));
        all.extend(standings);
    }
    all
}
