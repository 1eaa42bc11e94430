//! Entries of a leaderboard: ranking criteria, and the table for terminals and CSV.

use std::cmp::Ordering;
use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use serde::{Serialize, Serializer};
use serde_json::Value;

use scenario::Metric;
use scoring::evaluate::Score;
use scoring::evaluate::UnitScores;
use scoring::evaluate::statistics::Interval;
use scoring::ranking::{Contestant, SCORES, ScoreDef, Subject, rank};

/// Bias above which an entry is marked, px: a wrong origin shifts positions by 0.5 or 1 px, which a gate of
/// 2 px does not detect.
const BIAS_PX: f64 = 0.25;

#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct Entry {
    /// Rank among the scores of its kind (within one dataset for cases of a sweep).
    pub rank: usize,
    /// Whether another score has this rank.
    #[serde(skip)]
    pub is_tied: bool,
    /// Name of the score, from its folder.
    pub name: String,
    /// Name of the tracker, the same for all its cases of a sweep.
    #[serde(skip)]
    pub tracker: String,
    pub dataset: String,
    /// particles_3d, particles_2d, field or planes
    pub kind: ResultKind,
    /// Values of [`SCORES`] in their order, each with its 95 % interval.
    #[serde(flatten, serialize_with = "by_name")]
    pub scores: Vec<(Option<f64>, Interval)>,
    /// Lower end of the 95 % interval of the first criterion.
    pub low: Option<f64>,
    /// Upper end of the same interval.
    pub high: Option<f64>,
    /// Frames or image pairs that the result leaves out: counts.frames_missing, or field.n_pairs_missing
    pub missing: usize,
    /// Whether the bias in the image plane exceeds 0.25 px (particles only).
    pub biased: bool,
    /// Parameter values of the sweep.
    #[serde(skip)]
    pub axes: BTreeMap<String, Value>,
    /// Bias of particles in the image plane.
    #[serde(skip)]
    bias_px: Option<(f64, f64)>,
    /// Input of the paired comparison; scores of earlier versions have none.
    #[serde(skip)]
    pub(super) units: Option<Arc<UnitScores>>,
    /// Scores of the same group are ranked together.
    #[serde(skip)]
    group: String,
}

fn by_name<S: Serializer>(scores: &[(Option<f64>, Interval)], serializer: S) -> Result<S::Ok, S::Error> {
    serializer.collect_map(SCORES.iter().zip(scores).map(|(def, (value, _))| (def.name, value)))
}

/// Kind of result. Kinds are ranked separately: the gate in the image plane is easier to meet than that in
/// three dimensions, and neither compares with fields.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, PartialOrd, Ord, Serialize)]
pub enum ResultKind {
    /// Particles scored with depth.
    #[default]
    #[serde(rename = "particles_3d")]
    Particles3D,
    /// Particles scored in the image plane.
    #[serde(rename = "particles_2d")]
    Particles2D,
    /// A displacement field.
    #[serde(rename = "field")]
    Field,
    /// Depths in recordings, of which planes are known and positions are not.
    #[serde(rename = "planes")]
    Planes,
}

impl ResultKind {
    /// What its scores describe.
    fn subject(self) -> Subject {
        match self {
            ResultKind::Particles3D | ResultKind::Particles2D => Subject::Particles,
            ResultKind::Field => Subject::Field,
            ResultKind::Planes => Subject::Planes,
        }
    }

    /// Heading of the table.
    pub(super) fn title(self) -> &'static str {
        match self {
            ResultKind::Particles3D => "Particles in three dimensions",
            ResultKind::Particles2D => "Particles in the image plane",
            ResultKind::Field => "Fields",
            ResultKind::Planes => "Depths in planes of known height",
        }
    }
}

impl Entry {
    pub(super) fn of(name: String, score: &Score, units: Option<Arc<UnitScores>>) -> Self {
        // Scores of few particles or vectors may be withheld, but not their kind.
        let kind = match (score.detection.is_some(), score.definitions.dims) {
            (false, _) if score.planes.is_some() && score.field.is_none() => ResultKind::Planes,
            (false, 0) => ResultKind::Field,
            (_, 2) => ResultKind::Particles2D,
            _ => ResultKind::Particles3D,
        };
        let scores: Vec<_> = SCORES.iter().map(|def| def.measured(score)).collect();
        let criteria =
            criteria(kind.subject(), &score.definitions.rank_by, |index| scores[index].0.is_some());
        let ends = criteria.first().and_then(|index| scores[*index].1);
        let bias_px = score.detection.as_ref().and_then(|d| d.bias_x_px.zip(d.bias_y_px));
        let axes = score.definitions.axes.clone();
        // Each case of a sweep is ranked separately.
        let truth = score.definitions.truth_sha256.as_ref().filter(|_| !axes.is_empty());
        Entry {
            name,
            dataset: score.dataset.clone(),
            kind,
            scores,
            low: ends.map(|ends| ends[0]),
            high: ends.map(|ends| ends[1]),
            missing: score.missing(),
            biased: bias_px.is_some_and(|(x, y)| x.hypot(y) > BIAS_PX),
            group: truth.cloned().unwrap_or_default(),
            axes,
            bias_px,
            units,
            ..Entry::default()
        }
    }

    pub(super) fn score(&self, index: usize) -> (Option<f64>, Interval) {
        self.scores.get(index).copied().unwrap_or_default()
    }

    /// The parameter values on one line.
    pub(super) fn case(&self) -> String {
        let keys: BTreeSet<&str> = self.axes.keys().map(String::as_str).collect();
        let values =
            self.axes.iter().map(|(axis, value)| format!("{} {}", short_key(axis, &keys), axis_text(value)));
        values.collect::<Vec<_>>().join(", ")
    }
}

/// The shortest end of a key's path that distinguishes it from other keys.
pub(super) fn short_key<'k>(key: &'k str, all: &BTreeSet<&str>) -> &'k str {
    let ends = key.rmatch_indices('.').map(|(at, _)| &key[at + 1..]);
    let is_own = |end: &&str| {
        all.iter()
            .filter(|other| other.strip_suffix(*end).is_some_and(|a| a.is_empty() || a.ends_with('.')))
            .count()
            < 2
    };
    ends.into_iter().find(is_own).unwrap_or(key)
}

/// A parameter value as text; in scores every number is a float, even for integer keys.
pub(super) fn axis_text(value: &Value) -> String {
    match value {
        Value::String(text) => text.clone(),
        Value::Number(number) => number.as_f64().filter(|_| number.is_f64()).map_or_else(
            || number.to_string(),
            |v| if v == 0.0 || (1e-5..1e15).contains(&v.abs()) { v.to_string() } else { format!("{v:e}") },
        ),
        other => other.to_string(),
    }
}

/// Sort key of parameter values: for each, its axis, its text with `#` for each number, its numbers, the whole
/// text. Numbers are sorted by size and texts so that `constant(2)` comes before `constant(10)`.
pub(super) type AxesOrder<'a> = Vec<(&'a str, String, Vec<f64>, &'a str)>;

/// See [`AxesOrder`].
pub(super) fn order_of_axes<'a>(axes: impl Iterator<Item = (&'a String, &'a Value)>) -> AxesOrder<'a> {
    let of = |(axis, value): (&'a String, &'a Value)| match value.as_str() {
        Some(text) => {
            let (form, numbers) = form_and_numbers(text);
            (axis.as_str(), form, numbers, text)
        }
        None => (axis.as_str(), "#".to_owned(), value.as_f64().into_iter().collect(), ""),
    };
    axes.map(of).collect()
}

/// The text with `#` for each finite number, and the numbers. Digits in a word, as in `setting1a`, are part of it.
fn form_and_numbers(text: &str) -> (String, Vec<f64>) {
    let (mut form, mut numbers) = (String::new(), Vec::new());
    let is_separator = |c: char| !(c.is_ascii_alphanumeric() || "+-._".contains(c));
    for part in text.split_inclusive(is_separator) {
        let (word, separator) = part.split_at(part.trim_end_matches(is_separator).len());
        match scenario::number(word) {
            Some(number) => {
                form.push('#');
                numbers.push(number);
            }
            None => form.push_str(word),
        }
        form.push_str(separator);
    }
    (form, numbers)
}

/// Sort key of scores that are ranked together: kind, case of a sweep, its dataset, its truth.
type Case<'a> = (ResultKind, AxesOrder<'a>, Option<&'a String>, &'a str);

fn case<'a>(e: &'a Entry, datasets: &'a BTreeMap<String, String>) -> Case<'a> {
    (e.kind, order_of_axes(e.axes.iter()), datasets.get(&e.group), &e.group)
}

/// Sorts the scores of each kind (and sweep case) by rank.
pub(super) fn ranked(mut scores: Vec<(Entry, Score)>) -> Vec<(Entry, Score)> {
    // Repetitions are in the order of their datasets; those with the same truth count as one.
    let mut datasets: BTreeMap<String, String> = BTreeMap::new();
    for (e, _) in scores.iter().filter(|s| !s.0.group.is_empty()) {
        let first = datasets.entry(e.group.clone()).or_insert_with(|| e.dataset.clone());
        if e.dataset < *first {
            first.clone_from(&e.dataset);
        }
    }
    scores.sort_by(|(a, _), (b, _)| {
        // All numbers are finite.
        let cases = case(a, &datasets).partial_cmp(&case(b, &datasets)).unwrap_or(Ordering::Equal);
        cases.then_with(|| a.name.cmp(&b.name))
    });
    let mut ranked = Vec::with_capacity(scores.len());
    for same in scores.chunk_by(|a, b| case(&a.0, &datasets) == case(&b.0, &datasets)) {
        let order = in_order(same);
        ranked.extend(order.iter().map(|&(i, rank)| {
            let (entry, score) = &same[i];
            let is_tied = order.iter().filter(|other| other.1 == rank).count() > 1;
            (Entry { rank, is_tied, ..entry.clone() }, score.clone())
        }));
    }
    ranked
}

/// Places in [`SCORES`] of the scores that rank results: by the dataset's rules, otherwise by the subject that
/// some result has. Fields of versions without reference nodes only have scores at their own vectors.
fn criteria(subject: Subject, rules: &[Metric], has: impl Fn(usize) -> bool) -> Vec<usize> {
    let place = |metric: &Metric| SCORES.iter().position(|def| def.metric == Some(*metric));
    let ruled: Vec<usize> =
        rules.iter().filter_map(place).filter(|at| SCORES[*at].subject == subject).collect();
    if !ruled.is_empty() {
        return ruled;
    }
    let of = |ranks: fn(&ScoreDef) -> bool| -> Vec<usize> {
        let is = |index: &usize| {
            let def = &SCORES[*index];
            def.subject == subject && def.metric.is_some() && ranks(def) && has(*index)
        };
        (0..SCORES.len()).filter(is).collect()
    };
    let own = of(|def| def.is_criterion);
    if own.is_empty() { of(|def| def.is_headline) } else { own }
}

/// Indices of scores of one kind and case in order, each with its rank.
fn in_order(same: &[(Entry, Score)]) -> Vec<(usize, usize)> {
    if same[0].0.kind == ResultKind::Planes {
        return by_depth(same);
    }
    let has = |index| same.iter().any(|(entry, _)| entry.score(index).0.is_some());
    let rules = &same[0].1.definitions.rank_by;
    // Scores by different rules, about which `compare` warns, are ranked by none of them.
    let are_shared = same.iter().all(|(_, score)| score.definitions.rank_by == *rules);
    let criteria = criteria(same[0].0.kind.subject(), if are_shared { rules } else { &[] }, has);
    let criteria: Vec<Metric> = criteria.into_iter().filter_map(|index| SCORES[index].metric).collect();
    let contestants: Vec<Contestant<'_>> =
        same.iter().map(|(entry, score)| Contestant { score, units: entry.units.as_deref() }).collect();
    rank(&contestants, &criteria, 0)
}

/// Recordings whose planes are known: by the distance from the plane that 68 % of all points keep, which
/// points on the wrong side of the focus increase.
fn by_depth(same: &[(Entry, Score)]) -> Vec<(usize, usize)> {
    let of = |i: &usize| same[*i].1.planes.as_ref().and_then(|p| p.p68_z_um).unwrap_or(f64::INFINITY);
    let mut order: Vec<usize> = (0..same.len()).collect();
    order.sort_by(|a, b| of(a).total_cmp(&of(b)));
    let rank = |i: &usize| 1 + order.iter().filter(|other| of(other) < of(i)).count();
    order.iter().map(|i| (*i, rank(i))).collect()
}

/// Warning about a bias that does not affect the rank of an entry.
pub(super) fn caution(entry: &Entry) -> Option<String> {
    let (x, y) = entry.bias_px.filter(|_| entry.biased)?;
    Some(format!(
        "{}: positions are biased by ({x:+.3}, {y:+.3}) px on average, which F1 and therefore the rank do not show",
        entry.name
    ))
}

/// Width of all columns after the first score.
const WIDTH: usize = 36;

/// The leaderboard in 80 columns.
pub(super) fn text(entries: &[Entry], warnings: &[String]) -> String {
    let rank = |e: &Entry| {
        format!("{}{}{}", e.rank, if e.is_tied { "=" } else { "" }, if e.biased { "!" } else { "" })
    };
    let name = |e: &Entry| {
        let whole = storage::shown::name(&e.name);
        // The case is the heading of its rows.
        let is_short = whole.chars().count() <= 14 || e.axes.is_empty() || e.tracker.is_empty();
        let whole = if is_short { whole } else { storage::shown::name(&e.tracker) };
        let name: String = whole.chars().take(14).collect();
        if name.len() < whole.len() { name + "~" } else { name }
    };
    let short = |v: Option<f64>| v.map_or("-".to_owned(), |v| format!("{v:.4}"));
    let mut lines = Vec::new();
    for of_kind in entries.chunk_by(|a, b| a.kind == b.kind) {
        let kind = of_kind[0].kind;
        if of_kind.len() < entries.len() {
            lines.push(format!("{}:", kind.title()));
        }
        let of_kind_shown = SCORES.iter().enumerate().filter(|(_, def)| def.subject == kind.subject());
        let columns: Vec<(usize, &str)> =
            of_kind_shown.filter_map(|(i, def)| Some((i, def.heading?))).collect();
        let width = WIDTH / columns.len().saturating_sub(1).max(1) - 1;
        let has_ends = of_kind.iter().any(|e| e.low.is_some());
        let row = |rank: &str, name: &str, cells: Vec<String>, ends: &str| {
            let mut cells = cells.iter();
            let mut row = format!("{rank:<4} {name:<15} {:>6}", cells.next().map_or("", String::as_str));
            row += &if has_ends { format!(" {ends:<16}") } else { String::new() };
            cells.for_each(|cell| row += &format!(" {cell:>width$}"));
            row.trim_end().to_owned()
        };
        lines.push(row(
            "rank",
            "name",
            columns.iter().map(|(_, heading)| (*heading).to_owned()).collect(),
            "95 %",
        ));
        for same in of_kind.chunk_by(|a, b| a.axes == b.axes) {
            lines.extend(Some(same[0].case()).filter(|case| !case.is_empty()));
            lines.extend(same.iter().map(|e| {
                let ends = e.low.zip(e.high).map_or("-".to_owned(), |(l, h)| format!("[{l:.4}, {h:.4}]"));
                let cells = columns.iter().map(|(index, _)| short(e.score(*index).0)).collect();
                row(&rank(e), &name(e), cells, &ends)
            }));
        }
        if kind == ResultKind::Planes {
            lines.push(
                "Ranked by the distance from their plane within which 68 % of all points are.".to_owned(),
            );
        }
    }
    if entries.iter().any(|e| e.kind != ResultKind::Planes) {
        lines.push(
            "Ranked by F1, then errors, links, HOTA (fields: valid nodes, RMS at nodes): where the paired comparison of one does not \
             separate two results, the next decides. =: separated by none."
                .to_owned(),
        );
    }
    if entries.iter().any(|e| e.biased) {
        lines.push(format!("!: positions are biased by more than {BIAS_PX} px."));
    }
    lines.extend(warnings.iter().map(|w| format!("WARNING {w}")));
    lines.join("\n")
}

#[cfg(test)]
mod tests {
    use scoring::evaluate::Definitions;
    use scoring::evaluate::detection::Detection;
    use serde_json::json;

    use super::*;

    #[test]
    fn numbers_in_words_and_with_underscores() {
        let of = |text: &str| form_and_numbers(text);
        assert_eq!(of("(12.9, 0, 1_000)"), ("(#, #, #)".to_owned(), vec![12.9, 0.0, 1000.0]));
        assert_eq!(of("count(-4e2)"), ("count(#)".to_owned(), vec![-400.0]));
        // Presets are not repetitions of each other.
        assert_eq!(of("setting1a"), ("setting1a".to_owned(), Vec::new()));
        assert_eq!(of("inf"), ("inf".to_owned(), Vec::new()));
    }

    #[test]
    fn cases_are_in_the_order_of_their_numbers_and_repetitions_in_that_of_their_datasets() {
        let case = |noise: Value, repetition: u32, size: &str| {
            let axes = BTreeMap::from([("o.noise".to_owned(), noise), ("p.size".to_owned(), json!(size))]);
            // Hashes are in a different order than the repetitions.
            let (dataset, group) = (format!("case_{repetition}"), format!("{}{axes:?}", 9 - repetition));
            (Entry { axes, dataset, group, ..Entry::default() }, Score::default())
        };
        let small = "constant(2)";
        let scores = vec![
            case(json!(0.0), 0, "constant(10)"),
            case(json!(100.0), 0, small),
            case(json!(20), 1, small),
            case(json!(400.0), 0, small),
            case(json!(20.0), 0, small),
            case(json!(0.0), 0, small),
        ];
        let ranked = ranked(scores);
        let found: Vec<String> = ranked.iter().map(|(e, _)| format!("{} {}", e.case(), e.dataset)).collect();
        let expected = [
            "noise 0, size constant(2) case_0",
            "noise 0, size constant(10) case_0",
            "noise 20, size constant(2) case_0",
            "noise 20, size constant(2) case_1",
            "noise 100, size constant(2) case_0",
            "noise 400, size constant(2) case_0",
        ];
        assert_eq!(found, expected);
    }

    #[test]
    fn results_with_and_without_depth_are_ranked_separately() {
        let entry = |name: &str, dims: u8, f1: f64| {
            let interval_f1 = Some([f1 - 0.02, f1 + 0.02]);
            let detection = Some(Detection { f1: Some(f1), interval_f1, ..Detection::default() });
            let definitions = Definitions { dims, ..Definitions::default() };
            let score = Score { detection, definitions, ..Score::default() };
            (Entry::of(name.to_owned(), &score, None), score)
        };
        let scores = ["deep", "same"]
            .map(|name| entry(name, 3, 0.6))
            .into_iter()
            .chain([entry("flat", 2, 0.99), entry("deeper", 3, 0.7)]);
        let ranked = ranked(scores.collect());
        let found: Vec<_> = ranked.iter().map(|(e, _)| (e.name.as_str(), e.rank, e.is_tied)).collect();
        assert_eq!(found, [("deeper", 1, false), ("deep", 2, true), ("same", 2, true), ("flat", 1, false)]);
        // The scores of fields with few vectors are withheld.
        assert_eq!(Entry::of("few".to_owned(), &Score::default(), None).kind, ResultKind::Field);
    }

    #[test]
    fn keys_with_the_same_end_are_told_apart() {
        let axes =
            ["particles.number.count", "timing.pairs.count", "seed"].map(|key| (key.to_owned(), json!(5)));
        let entry = Entry { axes: axes.into(), ..Entry::default() };
        assert_eq!(entry.case(), "number.count 5, seed 5, pairs.count 5");
    }

    #[test]
    fn values_of_parameters_are_short() {
        for (value, expected) in [
            (json!(16.0), "16"),
            (json!(16), "16"),
            (json!(0.25), "0.25"),
            (json!(-0.5), "-0.5"),
            (json!(1e-9), "1e-9"),
            (json!(1e20), "1e20"),
            (json!("constant(2)"), "constant(2)"),
        ] {
            assert_eq!(axis_text(&value), expected);
        }
    }
}
