//! `microsig compare`: a leaderboard of several scores, their curves in common plots, and scores against the
//! parameters of a sweep.
//!
//! Particles scored with depth and particles scored in the image plane are ranked separately. They are ranked
//! by detection F1; where the paired comparison (`scoring::ranking`) does not separate them, by the errors in
//! the image plane and in depth, then by link F1, then by HOTA. Fields are ranked separately, by the fraction
//! of valid nodes, then by the RMS error at nodes. Scores that no criterion separates share a rank. Errors
//! are always shown together with recall.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use maud::{Markup, html};
use serde::Serialize;
use serde_json::Value;

use super::figure::{figure_of, names};
use super::files::{SCORE, UNITS};
use super::for_team::redacted;
use super::leaderboard::{Entry, axis_text, caution, ranked, text};
use super::page::document;
use super::particle_plots::axis;
use super::plots::{AxisLabels, Series, lines};
use super::score_file;
use super::sweep_plots::axis_plots;
use super::table::number;
use scoring::evaluate::curves::Bin;
use scoring::evaluate::statistics::Interval;
use scoring::evaluate::{Score, UnitScores};
use scoring::ranking::{SCORES, ScoreDef};
use storage::error::{Error, Result};
use storage::folder::{Earlier, Partial, check_replaceable};
use storage::shown::cell;
use storage::{InputFile, outside_datasets};

#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Comparison {
    /// The leaderboard, best first: particles, then fields.
    pub entries: Vec<Entry>,
    /// Caveats for reading the leaderboard.
    pub warnings: Vec<String>,
    pub out: PathBuf,
    #[serde(skip)]
    pub text: String,
}

/// Compares scores and writes `leaderboard.csv`, `curves.csv` and `leaderboard.html`.
/// Errors: files that are not scores; an existing folder, unless `force`; an I/O error.
pub fn compare(paths: &[InputFile], out: &Path, force: bool) -> Result<Comparison> {
    compare_sweep(paths, out, force, None)
}

/// [`compare`] for the cases of a sweep in which 1 um/s is a displacement of `px_per_um_s` px.
pub fn compare_sweep(
    paths: &[InputFile],
    out: &Path,
    force: bool,
    px_per_um_s: Option<f64>,
) -> Result<Comparison> {
    let earlier = Earlier::new("leaderboard.csv", force);
    check_replaceable(out, earlier)?;
    outside_datasets(out)?;
    let Ranking { scores, entries, mut warnings, text } = ranking(named(paths)?)?;
    let partial = Partial::start(out)?;
    partial.folder().save_bytes("leaderboard.csv", leaderboard_csv(&entries)?)?;
    partial.folder().save_bytes("curves.csv", curves_csv(&scores)?)?;
    partial.folder().save_bytes("leaderboard.html", page(&scores, &warnings, px_per_um_s)?)?;
    warnings.extend(partial.warning().map(str::to_owned));
    partial.finish(earlier)?;
    Ok(Comparison { entries, warnings, out: out.to_owned(), text })
}

#[derive(Debug, Clone)]
pub struct Ranking {
    /// The leaderboard, best first: particles, then fields.
    pub entries: Vec<Entry>,
    pub warnings: Vec<String>,
    pub text: String,
    scores: Vec<(Entry, Score)>,
}

/// A score that is compared.
#[derive(Debug, Clone)]
pub struct Named {
    pub name: String,
    /// Name of the tracker, the same for all its cases of a sweep.
    pub tracker: String,
    pub score: Score,
    /// Input of the paired comparison.
    pub units: Option<Arc<UnitScores>>,
}

pub fn ranking(scores: Vec<Named>) -> Result<Ranking> {
    let of = |Named { name, tracker, score, units }: Named| {
        let mut entry = Entry::of(name, &score, units);
        entry.tracker = tracker;
        (entry, score)
    };
    let scores = ranked(scores.into_iter().map(of).collect());
    let shown = |(entry, score): (Entry, Score)| -> Result<(Entry, Score)> {
        // Ranks use all digits.
        let released = redacted(&score)?;
        let mut shown = Entry::of(entry.name, &released, entry.units);
        (shown.rank, shown.is_tied, shown.tracker) = (entry.rank, entry.is_tied, entry.tracker);
        (shown.kind, shown.missing) = (entry.kind, entry.missing);
        Ok((shown, released))
    };
    let scores: Vec<(Entry, Score)> = scores.into_iter().map(shown).collect::<Result<_>>()?;
    let entries: Vec<Entry> = scores.iter().map(|s| s.0.clone()).collect();
    let mut warnings = differences(&scores);
    let unpaired: Vec<&str> = entries.iter().filter(|e| e.units.is_none()).map(|e| e.name.as_str()).collect();
    if entries.len() > 1 && !unpaired.is_empty() {
        warnings.push(format!(
            "no {UNITS} beside the scores of {}: their confidence intervals are compared instead, which a result that leaves out \
            frames can widen; run `microsig evaluate --out` again",
            unpaired.join(", ")
        ));
    }
    warnings.extend(entries.iter().filter_map(caution));
    warnings.extend(shared(&scores));
    let text = text(&entries, &warnings);
    Ok(Ranking { entries, warnings, text, scores })
}

/// The warnings of scores, each once with the names of its scores.
fn shared(scores: &[(Entry, Score)]) -> impl Iterator<Item = String> {
    let mut named: Vec<(&str, Vec<&str>)> = Vec::new();
    for (entry, score) in scores {
        for warning in score.caveats() {
            match named.iter_mut().find(|(text, _)| *text == warning) {
                Some((_, names)) => names.push(&entry.name),
                None => named.push((warning, vec![&entry.name])),
            }
        }
    }
    named.into_iter().map(|(text, names)| match names[..] {
        [first, second, _, ..] => {
            format!("{first}, {second} and {} more: {text}", names.len() - 2)
        }
        _ => format!("{}: {text}", names.join(", ")),
    })
}

/// Reads scores; each is named after its folder.
fn named(paths: &[InputFile]) -> Result<Vec<Named>> {
    let (mut scores, mut problems) = (Vec::new(), Vec::new());
    for path in paths {
        match score_file::read(path).and_then(|score| Ok((score, score_file::read_units(path)?))) {
            Ok((score, units)) => scores.push((score, units.map(Arc::new))),
            Err(e) => problems.extend(e.problems()),
        }
    }
    if !problems.is_empty() {
        return Err(Error::Input(problems));
    }
    let names = names_of(paths).into_iter().zip(scores);
    Ok(names.map(|((name, tracker), (score, units))| Named { name, tracker, score, units }).collect())
}

/// Names of the scores at these paths, and of their trackers. Folders of the same name in different locations are
/// different trackers: the first has the short name, the others are named by their paths.
fn names_of(paths: &[InputFile]) -> Vec<(String, String)> {
    let mut trackers: BTreeMap<PathBuf, String> = BTreeMap::new();
    let mut names: Vec<(String, String)> = Vec::new();
    for path in paths {
        let ScorePlace { name, tracker, root } = ScorePlace::of(path);
        let place = absolute(&root).join(&tracker);
        let is_taken =
            |label: &String| trackers.iter().any(|(other, taken)| taken == label && *other != place);
        let longer = [root.join(&tracker), place.clone()].map(|path| path.display().to_string());
        let free = [tracker.clone()].into_iter().chain(longer).find(|label| !is_taken(label));
        let label = trackers.entry(place.clone()).or_insert_with(|| free.unwrap_or_default()).clone();
        // A path as short as a name is completed.
        let given = [Some(name).filter(|_| label == tracker), Some(path.display().to_string())];
        let is_free = |name: &String| names.iter().all(|(other, _)| other != name);
        let name = given.into_iter().flatten().find(is_free);
        names.push((name.unwrap_or_else(|| absolute(path).display().to_string()), label));
    }
    names
}

/// The path from the root of the file system.
fn absolute(path: &Path) -> PathBuf {
    let path = if path.as_os_str().is_empty() { Path::new(".") } else { path };
    std::path::absolute(path).unwrap_or_else(|_| path.to_owned())
}

/// What the path of a score says about it.
struct ScorePlace {
    /// Name of its folder, which is usually named after the tracker. If this folder or the one above is a sweep case, the
    /// name has both: `ncc/case_00001`, `case_00001/ncc`. The path of a file that is not called `score.json`.
    name: String,
    /// The part of the name without the case.
    tracker: String,
    /// The folder that contains folders of trackers or cases.
    root: PathBuf,
}

impl ScorePlace {
    fn of(path: &Path) -> Self {
        let file = if path.is_dir() { path.join(SCORE) } else { path.to_owned() };
        let parent = |path: &Path| path.parent().unwrap_or(Path::new("")).to_owned();
        let text = |path: &Path| path.file_name().map(|n| n.to_string_lossy().into_owned());
        let in_folder = file.ends_with(SCORE);
        let place = if in_folder { parent(&file) } else { file.with_extension("") };
        let whole = file.display().to_string();
        let around = parent(&place);
        let Some(own) = text(&place) else {
            return ScorePlace { tracker: whole.clone(), name: whole, root: around };
        };
        let (short, tracker, root) = match text(&around) {
            Some(above) if is_sweep_case(&own) => (format!("{above}/{own}"), above, parent(&around)),
            Some(above) if is_sweep_case(&above) => (format!("{above}/{own}"), own, parent(&around)),
            _ => {
                // Scores of cases side by side: `case_00001-ncc`.
                let tracker = match own.split_once('-') {
                    _ if is_sweep_case(&own) => "result".to_owned(),
                    Some((case, tracker)) if is_sweep_case(case) => tracker.to_owned(),
                    _ => own.clone(),
                };
                (own, tracker, around)
            }
        };
        ScorePlace { name: if in_folder { short } else { whole }, tracker, root }
    }
}

/// Whether a folder has the name of a sweep's case.
fn is_sweep_case(name: &str) -> bool {
    name.strip_prefix("case_").is_some_and(|n| !n.is_empty() && n.bytes().all(|b| b.is_ascii_digit()))
}

/// Warnings about differences that make scores incomparable.
fn differences(scores: &[(Entry, Score)]) -> Vec<String> {
    let mut warnings = Vec::new();
    fn differ<T: PartialEq>(scores: &[(Entry, Score)], of: impl Fn(&Score) -> T) -> bool {
        scores.iter().any(|s| of(&s.1) != of(&scores[0].1))
    }
    // The hash of the truth distinguishes datasets of the same name; old scores only have the name.
    let hashed = scores.iter().all(|s| s.1.definitions.truth_sha256.is_some());
    let truth = |s: &Score| if hashed { s.definitions.truth_sha256.clone() } else { Some(s.dataset.clone()) };
    let are_cases = scores.iter().all(|s| !s.0.axes.is_empty());
    if !are_cases && differ(scores, truth) {
        let mut names: Vec<&str> = scores.iter().map(|s| s.0.dataset.as_str()).collect();
        names.sort_unstable();
        names.dedup();
        let what = match names[..] {
            [one] => {
                format!("of different datasets that are all named {one} (with different seeds or particles)")
            }
            _ => format!("of different datasets ({})", names.join(", ")),
        };
        warnings.push(format!("the scores are {what}: their ranks are not comparable"));
    }
    for same in scores.chunk_by(|a, b| a.0.kind == b.0.kind) {
        let field = |s: &Score| s.field.as_ref().map(|f| (f.plane_um, f.against.clone()));
        for (what, differs) in [
            ("gates", differ(same, |s| s.definitions.gate)),
            ("gates of ISBI", differ(same, |s| s.definitions.isbi_gate_px)),
            ("rules of ranking", differ(same, |s| s.definitions.rank_by.clone())),
            ("borders", differ(same, |s| s.definitions.border_px)),
            ("planes", differ(same, |s| field(s).map(|f| f.0))),
            ("true fields", differ(same, |s| field(s).map(|f| f.1))),
        ] {
            if differs {
                warnings.push(format!(
                    "the scores are based on different {what}: their ranks are not comparable"
                ));
            }
        }
    }
    warnings
}

fn unwritable(e: impl std::fmt::Display) -> Error {
    Error::input(format!("table: {e}"))
}

/// The leaderboard as CSV: the fields of an entry, then the parameters of sweeps.
fn leaderboard_csv(entries: &[Entry]) -> Result<Vec<u8>> {
    let mut axes: Vec<&String> = entries.iter().flat_map(|e| e.axes.keys()).collect();
    axes.sort_unstable();
    axes.dedup();
    let mut writer = csv::Writer::from_writer(Vec::new());
    for (i, entry) in entries.iter().enumerate() {
        let Value::Object(columns) = serde_json::to_value(entry).map_err(unwritable)? else { continue };
        if i == 0 {
            writer
                .write_record(columns.keys().cloned().chain(axes.iter().map(|a| cell(a))))
                .map_err(unwritable)?;
        }
        let of = |value: &Value| match value {
            Value::Null => String::new(),
            Value::String(text) => cell(text),
            number => number.to_string(),
        };
        let on_axis = |value: &Value| if value.is_number() { axis_text(value) } else { of(value) };
        let values = axes.iter().map(|axis| entry.axes.get(*axis).map_or(String::new(), on_axis));
        writer.write_record(columns.values().map(of).chain(values)).map_err(unwritable)?;
    }
    writer.into_inner().map_err(unwritable)
}

/// The curves of all scores as CSV. Open bin edges and undefined errors are empty cells.
fn curves_csv(scores: &[(Entry, Score)]) -> Result<Vec<u8>> {
    let mut writer = csv::Writer::from_writer(Vec::new());
    let header = ["name", "against", "from", "to", "recall", "rms_x_px", "rms_y_px", "rms_z_um"];
    writer.write_record(header).map_err(unwritable)?;
    for (entry, score) in scores {
        for curve in &score.curves {
            for b in &curve.bins {
                let numbers = [Some(b.from), Some(b.to), b.recall, b.rms_x_px, b.rms_y_px, b.rms_z_um];
                let numbers =
                    numbers.map(|v| v.filter(|v| v.is_finite()).map_or(String::new(), |v| format!("{v:?}")));
                let row = [cell(&entry.name), cell(&curve.against)].into_iter().chain(numbers);
                writer.write_record(row).map_err(unwritable)?;
            }
        }
    }
    writer.into_inner().map_err(unwritable)
}

/// A plot of several series; `None` if no series has points.
fn plot_of(x: &str, y: &str, mut series: Vec<Series>) -> Result<Option<Markup>> {
    // Scores of the other kind have no points and do not appear in the legend.
    series.retain(Series::has_points);
    if series.is_empty() {
        return Ok(None);
    }
    let svg = lines(&AxisLabels { x, y, title: y }, &series)?;
    let mut caption = format!("{y} against {x}.");
    caption[..1].make_ascii_uppercase();
    Ok(Some(figure_of(svg, &names(&series), &caption)))
}

/// The curves of all scores, one plot for each property and quantity.
fn curve_plots(scores: &[(Entry, Score)]) -> Result<Vec<Markup>> {
    let mut against: Vec<&str> =
        scores.iter().flat_map(|s| s.1.curves.iter().map(|c| c.against.as_str())).collect();
    against.sort_unstable();
    against.dedup();
    type Quantity = fn(&Bin) -> Option<f64>;
    let quantities: [(&str, Quantity); 3] =
        [("recall", |b| b.recall), ("RMS error x, px", |b| b.rms_x_px), ("RMS error z, um", |b| b.rms_z_um)];
    let mut plots = Vec::new();
    for x in against {
        for (y, value) in quantities {
            let series = scores.iter().map(|(entry, score)| {
                let bins = score.curves.iter().filter(|c| c.against == x).flat_map(|c| &c.bins);
                let closed = bins.filter(|b| b.to.is_finite());
                let points =
                    closed.map(|b| (f64::midpoint(b.from, b.to), value(b).unwrap_or(f64::NAN))).collect();
                Series::new(&entry.name, points)
            });
            plots.extend(plot_of(axis(x), y, series.collect())?);
        }
    }
    Ok(plots)
}

/// A value with its 95 % interval.
fn measured((value, ends): (Option<f64>, Interval)) -> Markup {
    html! {
        (number(value))
        @if let Some([low, high]) = ends { " " span.soft { "[" (number(Some(low))) ", " (number(Some(high))) "]" } }
    }
}

fn page(scores: &[(Entry, Score)], warnings: &[String], px_per_um_s: Option<f64>) -> Result<String> {
    let with_axes = scores.iter().any(|s| !s.0.axes.is_empty());
    // The cases of a sweep differ by its parameters, over which their scores are drawn.
    let curves = if with_axes { Vec::new() } else { curve_plots(scores)? };
    let axis_plots = axis_plots(scores, px_per_um_s)?;
    let body = html! {
        h1 { "Leaderboard" }
        p.soft { "Particles scored with depth and particles scored in the image plane are ranked separately, by detection F1, then by \
        errors in the image plane and in depth, link F1, HOTA; \
        fields are ranked by the fraction of valid nodes, then by the RMS error at nodes. If the paired comparison of two results does not \
        separate them by one criterion, the next one decides. Scores of equal rank are not separated by any criterion. Errors cover found \
        particles only: read them together with recall. Brackets are 95 % intervals. A ! marks positions with a bias that F1 does not show." }
        @for warning in warnings { p.warning { (warning) } }
        @if !axis_plots.is_empty() { h2 { "Scores over the sweep" } div.plots { @for plot in &axis_plots { (plot) } } }
        @for same in scores.chunk_by(|a, b| a.0.kind == b.0.kind) {
            h2 { (same[0].0.kind.title()) }
            // Only columns with a value: particles and fields have different scores.
            @let is_used = |index: usize| same.iter().any(|(e, _)| e.score(index).0.is_some());
            @let columns: Vec<(usize, &ScoreDef)> = SCORES.iter().enumerate().filter(|(i, _)| is_used(*i)).collect();
            div.scroll { table.board {
                tr { th { "rank" } th { "name" } @if with_axes { th { "case" } } @for (_, def) in &columns { th { (def.title()) } } }
                @for (e, _) in same { tr {
                    td { (e.rank) @if e.biased { "!" } } td { (e.name) } @if with_axes { td { (e.case()) } }
                    @for (index, _) in &columns { td { (measured(e.score(*index))) } }
                } }
            } }
        }
        @if !curves.is_empty() { h2 { "Curves" } div.plots { @for plot in &curves { (plot) } } }
    };
    Ok(document("Leaderboard", &body))
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use super::*;

    #[test]
    fn a_warning_of_many_scores_is_listed_once() {
        let of = |name: &str, warnings: &[&str]| {
            let warnings = warnings.iter().map(|w| (*w).to_owned()).collect();
            let mut entry = Entry::default();
            name.clone_into(&mut entry.name);
            (entry, Score { warnings, ..Score::default() })
        };
        let scores = [of("a", &["x", "y"]), of("b", &["x"]), of("c", &["y", "x"]), of("d", &["x"])];
        assert_eq!(shared(&scores).collect::<Vec<_>>(), ["a, b and 2 more: x", "a, c: y"]);
    }

    #[test]
    fn a_tracker_has_the_name_of_its_folder_in_all_cases() {
        let names = |paths: [&str; 4]| names_of(&paths.map(|path| Path::new(path).join(SCORE).into()));
        let of =
            |pairs: [(&str, &str); 4]| pairs.map(|(name, tracker)| (name.to_owned(), tracker.to_owned()));
        // Names with the name of a case are not taken apart.
        let trackers =
            names(["s/net-case_0/case_0", "s/net-case_1/case_0", "s/my-net.v2/case_0", "s/case_3/case_0"]);
        assert_eq!(
            trackers,
            of([
                ("net-case_0/case_0", "net-case_0"),
                ("net-case_1/case_0", "net-case_1"),
                ("my-net.v2/case_0", "my-net.v2"),
                ("case_3/case_0", "case_3"),
            ])
        );
        // In two sweeps, also in cases that only the second has.
        let sweeps = names(["a/mine/case_0", "a/mine/case_1", "b/mine/case_1", "b/mine/case_2"]);
        assert_eq!(
            sweeps,
            of([
                ("mine/case_0", "mine"),
                ("mine/case_1", "mine"),
                ("b/mine/case_1/score.json", "b/mine"),
                ("b/mine/case_2/score.json", "b/mine"),
            ])
        );
        // The second is in the current folder; a folder may be written in two ways.
        let nearer = names(["a/ncc/case_0", "ncc/case_0", "./ncc/case_1", "a/mle/case_0"]);
        assert_eq!(nearer.iter().map(|(_, tracker)| tracker).collect::<BTreeSet<_>>().len(), 3);
        assert_eq!((&nearer[0].1[..], &nearer[1].1), ("ncc", &nearer[2].1));
        let files = names_of(&["s/ncc/case_0.json", "s/ncc/case_1.json", "s/mle.json"].map(InputFile::from));
        assert_eq!(files[0], ("s/ncc/case_0.json".to_owned(), "ncc".to_owned()));
        assert_eq!(files.into_iter().map(|(_, tracker)| tracker).collect::<Vec<_>>(), ["ncc", "ncc", "mle"]);
        let sides = names(["case_0/ncc", "case_1/ncc", "case_1-mle", "case_2"]);
        assert_eq!(
            sides,
            of([("case_0/ncc", "ncc"), ("case_1/ncc", "ncc"), ("case_1-mle", "mle"), ("case_2", "result")])
        );
    }

    #[test]
    fn names_are_no_formulas_and_no_control_sequences() {
        assert_eq!(cell("=1+1"), "'=1+1");
        assert_eq!(cell("@SUM(A1)"), "'@SUM(A1)");
        assert_eq!(cell("\u{1b}[31mred\u{9b}2J"), "\u{fffd}[31mred\u{fffd}2J");
        assert_eq!(cell("ncc-2"), "ncc-2");
    }
}
