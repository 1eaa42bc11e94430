//! Scores of trackers on a suite: one table of all cases, ranked case by case.
//!
//! Results are in `RESULTS/TRACKER/TRACK/CASE/results.csv`, or in an archive `RESULTS/TRACKER.zip`; each is scored by
//! `evaluate` against the test split of its case. Scores of different cases are never averaged: of two trackers, the one that is better in more
//! cases of a track is ahead in its standing; a missing or refused result is behind all others.

mod check;
mod entry;
mod page;
mod participants;
mod release;
mod site;
mod table;

use std::path::{Path, PathBuf};

use clap::Args;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

pub use check::{Checked, check};
pub use page::{Annotations, page};
pub use release::{BASELINES, SuiteReleaseOptions, published_test, release, suite_template};

use crate::report;
use entry::Entry;
use generator::runner::{SuiteRecord, SuiteSelection, check_rules};
use scenario::{AxisValue, Metric, Size, Split, Suite, SuiteCase};
use scoring::evaluate::{EvaluateOptions, Evaluation, Score, Truth, UnitScores, evaluate_files};
use scoring::ranking::{Contestant, Pairs, ScoreDef, pairs, ranks_fields};
use site::{Site, rules};
use storage::dataset::manifest::GENERATOR_VERSION;
use storage::error::{Error, Result};
use storage::folder::{Earlier, Partial, check_replaceable};
use storage::{OutputFolder, argument, walk};

/// Name of the table of all scores.
pub const SUITE_SCORES_CSV: &str = "suite_scores.csv";
/// Name of the same table as JSON, with standings.
pub const SUITE_SCORES: &str = "suite_scores.json";
/// Name of the page with tables and curves.
pub const PAGE: &str = "index.html";
/// Folder of the complete scores: `TRACKER/TRACK/CASE/score.json` and its tables.
pub const SCORES: &str = "scores";
/// Folder of a published leaderboard with an archive `TRACKER.zip` of the results of each tracker.
pub const PUBLISHED: &str = "results";
/// Name of a tracker's result for a case.
pub const RESULT: &str = "results.csv";

/// Scores of all trackers on a suite.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct SuiteScores {
    pub suite: String,
    pub version: String,
    pub size: Size,
    /// Version of the program that scored.
    pub microsig: String,
    /// The standing of each tracker in each track it has entered.
    pub standings: Vec<Standing>,
    /// Every case with the results of all trackers that have entered its track.
    pub cases: Vec<CaseScores>,
    /// Trackers of a published leaderboard with which the others are compared.
    #[serde(skip)]
    pub published: Vec<String>,
    /// Cases without a test split, which are left out, and a file system without locks.
    #[serde(skip)]
    pub warnings: Vec<String>,
}

#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct CaseScores {
    pub track: String,
    pub ladder: String,
    pub case: String,
    pub dataset: String,
    /// The values that distinguish the case from others of its ladder.
    pub axes: Vec<AxisValue>,
    /// The scores by which the case is ranked.
    pub rank_by: Vec<Metric>,
    /// The results, best first; missing ones last.
    pub results: Vec<CaseResult>,
    /// Number of independent units of the truth, which the comparisons resample: true tracks, or squares of nodes.
    #[serde(default)]
    pub units: usize,
}

/// Status of a tracker's result for a case.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Status {
    Scored,
    /// There is no result.
    #[default]
    Missing,
    /// It cannot be scored.
    Refused,
}

/// A tracker's result for a case.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct CaseResult {
    pub tracker: String,
    pub status: Status,
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

#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Standing {
    pub track: String,
    pub tracker: String,
    pub cases: usize,
    pub scored: usize,
    pub refused: usize,
    /// 1 + the number of trackers that are ahead, directly or through others. Of two trackers, the one that is better in
    /// more cases is ahead.
    pub rank: usize,
    /// Number of cases in which no tracker is better.
    pub first: usize,
}

#[derive(Debug, Clone, Args)]
pub struct ScoreOptions {
    /// The results: RESULTS/TRACKER/TRACK/CASE/results.csv, or RESULTS/TRACKER.zip; may be repeated
    #[arg(long, value_name = "RESULTS", required = true)]
    pub results: Vec<PathBuf>,
    /// Also rank the results of a published leaderboard, DIR/results/TRACKER.zip, and compare each with them
    #[arg(long, value_name = "DIR")]
    pub against: Option<PathBuf>,
    /// Output folder of the scores
    #[arg(long, short, value_name = "OUT", value_parser = argument::folder())]
    pub out: PathBuf,
    /// Also write a site of the leaderboard with rules and reports, to be copied to any server or opened from
    /// disk
    #[arg(long, value_name = "DIR", value_parser = argument::folder())]
    pub site: Option<PathBuf>,
    #[arg(skip)]
    pub selection: SuiteSelection,
    /// Also score submissions whose files are newer than the deadline
    #[arg(long)]
    pub late: bool,
    /// Seed of all random numbers
    #[arg(long, value_name = "N", value_parser = argument::seed, default_value_t = 0)]
    pub seed: u64,
    /// Replace existing output
    #[arg(long, short)]
    pub force: bool,
}

#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct MetricValue {
    pub metric: Metric,
    /// Its value; null if it is undefined.
    pub value: Option<f64>,
    /// Lower end of the 95 % interval.
    pub low: Option<f64>,
    /// Upper end of the 95 % interval.
    pub high: Option<f64>,
}

impl MetricValue {
    pub fn of(metric: Metric, score: &Score) -> Self {
        let (value, interval) = ScoreDef::of(metric).measured(score);
        MetricValue { metric, value, low: interval.map(|i| i[0]), high: interval.map(|i| i[1]) }
    }
}

type Scored = (String, std::result::Result<Option<Evaluation>, String>);

/// Scores all results, and writes `suite_scores.csv`, `suite_scores.json`, `index.html` and the complete
/// scores of each.
/// Errors: a folder of another suite or version; a test split that is missing though there are results; existing scores, unless `force`; an I/O error.
pub fn score(suite: &Suite, datasets: &Path, options: &ScoreOptions) -> Result<SuiteScores> {
    let record = SuiteRecord::read(datasets)?;
    record.matches(suite, datasets)?;
    let is_released = !record.images_sha256.is_empty();
    let earlier = Earlier::new(SUITE_SCORES, options.force);
    check_replaceable(&options.out, earlier)?;
    let chosen = SuiteSelection { split: Some(Split::Test), ..options.selection.clone() };
    let cases: Vec<SuiteCase> = chosen.of(suite, record.size)?.into_iter().map(|(case, _)| case).collect();
    let known: Vec<String> = suite.cases(record.size)?.iter().map(SuiteCase::folder).collect();
    let published = options.against.as_ref().map(|folder| folder.join(PUBLISHED));
    let folders: Vec<PathBuf> = options.results.iter().chain(&published).cloned().collect();
    let mut entries = entries(&folders, (&record, datasets, &known), options.late)?;
    let names = published.as_deref().map(entries_of).transpose()?.unwrap_or_default();
    let more = participants::annotations(&mut entries, &known)?;
    let mut site = options.site.as_deref().map(|folder| Site::start(folder, options.force)).transpose()?;
    let partial = Partial::start(&options.out)?;
    let (mut all, mut warnings) = (Vec::new(), Vec::new());
    for track in &suite.spec.tracks {
        // Of a submission that cannot be read, the tracks are not known.
        let has_entered = |entry: &&Entry| entry.fault.is_some() || entry.folder.join(&track.name).is_dir();
        let entered: Vec<&Entry> = entries.iter().filter(has_entered).collect();
        let (mut absent, mut n) = (Vec::new(), 0);
        for case in cases.iter().filter(|case| case.track == track.name) {
            n += 1;
            let Some(dataset) = record.test_split(datasets, &case.folder()) else {
                if entered.iter().any(|entry| entry.folder.join(case.folder()).join(RESULT).exists()) {
                    let hint = "missing; `microsig suite generate --resume` generates it";
                    let dataset = datasets.join(case.split_folder(Split::Test));
                    return Err(Error::input(format!("{}: {hint}", dataset.display())));
                }
                absent.push(case.name.as_str());
                continue;
            };
            let folders = (dataset.as_path(), partial.folder(), site.as_mut());
            all.push(scored_case(&record, case, &entered, folders, options)?);
        }
        // A track that has not been generated is left out.
        if !absent.is_empty() && absent.len() < n {
            let (some, name) = (absent.join(", "), &track.name);
            warnings.push(format!("track {name}: without test split, and left out: {some}"));
        }
    }
    warnings.extend(partial.warning().map(str::to_owned));
    let scores = SuiteScores {
        suite: record.name,
        version: record.version,
        size: record.size,
        microsig: GENERATOR_VERSION.to_owned(),
        standings: standings(&suite.spec.tracks.iter().map(|track| &*track.name).collect::<Vec<_>>(), &all),
        cases: all,
        warnings,
        published: names
            .iter()
            .filter_map(|path| Some(path.file_stem()?.to_string_lossy().into_owned()))
            .collect(),
    };
    let csv = table::csv(&scores)?;
    partial.folder().save_bytes(SUITE_SCORES_CSV, &csv)?;
    let json = serde_json::to_string_pretty(&scores).map_err(|e| Error::input(e.to_string()))? + "\n";
    partial.folder().save_bytes(SUITE_SCORES, &json)?;
    partial.folder().save_bytes(PAGE, page(&scores, &more)?)?;
    let place_scores = || partial.finish(earlier);
    match site {
        None => place_scores()?,
        Some(site) => {
            let more = Annotations { reports: site.reports().clone(), is_site: true, ..more };
            let index = page(&scores, &more)?;
            let rules = rules(suite, &scores, is_released);
            site.finish(&rules, &index, [&csv, json.as_bytes()], place_scores)?;
        }
    }
    Ok(scores)
}

impl SuiteScores {
    /// The standings and all cases as text.
    pub fn text(&self) -> String {
        table::text(self)
    }

    /// Reads `suite_scores.json`.
    pub fn read(path: &Path) -> Result<Self> {
        storage::json::parse(&storage::read_text(path)?)
            .map_err(|e| Error::input(format!("{}: {e}", path.display())))
    }
}

impl CaseScores {
    /// 1 if the first of two trackers is better, -1 if the second is.
    fn difference(&self, a: &str, b: &str) -> i32 {
        let of = |tracker: &str| self.results.iter().find(|result| result.tracker == tracker);
        let is_behind = |one: Option<&CaseResult>, other: Option<&CaseResult>| {
            let is_scored = |of: Option<&CaseResult>| of.is_some_and(|of| of.status == Status::Scored);
            let other_name = other.map_or("", |other| &other.tracker);
            is_scored(other)
                && (!is_scored(one) || one.is_some_and(|one| one.behind.iter().any(|of| of == other_name)))
        };
        i32::from(is_behind(of(b), of(a))) - i32::from(is_behind(of(a), of(b)))
    }
}

impl CaseResult {
    pub fn value(&self, metric: Metric) -> Option<MetricValue> {
        self.scores.iter().find(|score| score.metric == metric).copied()
    }
}

fn folders(folder: &Path) -> Result<Vec<String>> {
    walk::names(folder, |name| !name.starts_with('.') && folder.join(name).is_dir())
}

/// The folders and archives in a folder, sorted.
fn entries_of(folder: &Path) -> Result<Vec<PathBuf>> {
    let is_archive = |path: &Path| path.extension().is_some_and(|end| end.eq_ignore_ascii_case("zip"));
    let archives = walk::names(folder, |name| is_archive(Path::new(name)) && folder.join(name).is_file())?;
    let names = [folders(folder)?, archives].concat();
    let mut paths: Vec<PathBuf> = names.iter().map(|name| folder.join(name)).collect();
    paths.sort();
    Ok(paths)
}

/// The folders and archives of trackers.
/// Errors: no results; of folders that are no submissions, results for tracks and cases that the suite does not have.
fn entries(results: &[PathBuf], suite: (&SuiteRecord, &Path, &[String]), late: bool) -> Result<Vec<Entry>> {
    let (record, _, cases) = suite;
    let paths: Vec<Vec<PathBuf>> = results.iter().map(|folder| entries_of(folder)).collect::<Result<_>>()?;
    let paths = paths.concat();
    let (mut entries, mut problems) = (Vec::<Entry>::new(), Vec::new());
    for path in &paths {
        let name = path.file_name().unwrap_or_default();
        let mut entry = Entry::open(path, name.into(), suite)?;
        let unknown = if entry.fault.is_none() { entry.unknown(record, cases)? } else { Vec::new() };
        match unknown[..] {
            [] => {}
            _ if entry.is_submission() => entry.fault = Some(unknown.join("; ")),
            _ => problems.extend(unknown),
        }
        if !late {
            entry.refuse_late(record.deadline.as_deref(), path);
        }
        if let Some(other) = entries.iter().position(|other| other.name == entry.name) {
            // An archive that was sent rather than a folder, such as a baseline's.
            let n = entries.len() + 1;
            let again = if entry.is_archive() { &mut entry } else { &mut entries[other] };
            let problem = format!("{}: another tracker has this name; rename it", again.given.display());
            if again.is_archive() {
                again.name = format!("{} ({n})", again.name);
                again.fault = Some(problem);
            } else {
                problems.push(problem);
            }
        }
        entries.push(entry);
    }
    if entries.is_empty() {
        let expected = format!("TRACKER/TRACK/CASE/{RESULT}, or archives TRACKER.zip");
        let folders: Vec<String> = results.iter().map(|folder| folder.display().to_string()).collect();
        return Err(Error::input(format!("{}: no results; expected {expected}", folders.join(", "))));
    }
    if problems.is_empty() { Ok(entries) } else { Err(Error::Input(problems)) }
}

fn scored_case(
    record: &SuiteRecord,
    case: &SuiteCase,
    entered: &[&Entry],
    (dataset, out, mut site): (&Path, &OutputFolder, Option<&mut Site>),
    options: &ScoreOptions,
) -> Result<CaseScores> {
    check_rules(case, dataset, false)?;
    // Datasets of earlier versions do not state the rules.
    let rules = EvaluateOptions {
        gate_xy_px: case.rules.gate_xy_px,
        gate_z_um: case.rules.gate_z_um,
        dims: case.rules.dims,
        seed: options.seed,
        ..EvaluateOptions::default()
    };
    // A truth that cannot be read is no fault of a tracker.
    let is_of_fields = ranks_fields(&case.rules.rank_by);
    Truth::read(dataset, is_of_fields, &rules)?;
    let evaluated: Vec<Scored> = entered
        .par_iter()
        .map(|entry| {
            // Reasons are published: paths begin at the folder of the results.
            let evaluation = entry.result(record, &case.folder(), dataset).and_then(|found| {
                let Some((result, _)) = found else { return Ok(None) };
                let mut evaluation = evaluate_files(dataset, result, &rules)?;
                // Datasets of earlier versions do not state them.
                evaluation.score.definitions.rank_by.clone_from(&case.rules.rank_by);
                Ok(Some(evaluation))
            });
            (entry.name.clone(), evaluation.map_err(|e| e.to_string()))
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
    let better = pairs(&contestants, &case.rules.rank_by, options.seed);
    for (i, rank) in better.ranks() {
        let ahead = (0..scored.len()).filter(|j| better.is_better(*j, i));
        let behind = ahead.map(|j| scored[j].0.tracker.clone()).collect();
        results.push(CaseResult { rank: Some(rank), behind, ..scored[i].0.clone() });
    }
    results.extend(others);
    Ok(CaseScores {
        track: case.track.clone(),
        ladder: case.ladder.clone(),
        case: case.name.clone(),
        dataset: format!("{}-test", case.dataset()),
        axes: case.axes.clone(),
        rank_by: case.rules.rank_by.clone(),
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
    let none =
        |status, reason| CaseResult { tracker: tracker.clone(), status, reason, ..CaseResult::default() };
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
        case.rules.rank_by.iter().map(|metric| MetricValue::of(*metric, score)).collect();
    let others = ScoreDef::metrics().filter(|metric| !case.rules.rank_by.contains(metric));
    scores.extend(others.map(|metric| MetricValue::of(metric, score)).filter(|value| value.value.is_some()));
    // Fields have no scores of particles, and vice versa.
    let ranks_fields = ranks_fields(&case.rules.rank_by);
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
        let track_cases: Vec<&CaseScores> = cases.iter().filter(|case| case.track == *track).collect();
        let mut trackers: Vec<&String> =
            track_cases.iter().flat_map(|case| case.results.iter().map(|result| &result.tracker)).collect();
        trackers.sort();
        trackers.dedup();
        let better = Pairs::new(trackers.len(), |a, b| {
            (track_cases.iter().map(|case| case.difference(trackers[b], trackers[a])).sum::<i32>().cmp(&0), 0)
        });
        let mut ranks = vec![0; trackers.len()];
        better.ranks().into_iter().for_each(|(i, rank)| ranks[i] = rank);
        let mut standings: Vec<Standing> = trackers
            .iter()
            .zip(ranks)
            .map(|(tracker, rank)| {
                let own: Vec<&CaseResult> = track_cases
                    .iter()
                    .flat_map(|case| case.results.iter().filter(|r| r.tracker == **tracker))
                    .collect();
                let count = |status| own.iter().filter(|result| result.status == status).count();
                Standing {
                    track: (*track).to_owned(),
                    tracker: (*tracker).clone(),
                    cases: track_cases.len(),
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
            ..CaseResult::default()
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
