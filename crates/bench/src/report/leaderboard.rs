//! Entries of a leaderboard: ranking criteria, and the table for terminals and CSV.

use std::cmp::Ordering;
use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use serde::Serialize;
use serde_json::Value;

use super::table::number;
use scenario::Metric;
use scoring::evaluate::Score;
use scoring::evaluate::UnitScores;
use scoring::evaluate::statistics::Interval;
use scoring::ranking::{Contestant, rank};

/// Bias above which an entry is marked, px: a wrong origin shifts positions by 0.5 or 1 px, which a gate of
/// 2 px does not detect.
const BIAS_PX: f64 = 0.25;

/// An entry of the leaderboard. Scores are named after their keys in `score.json`.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct Entry {
    /// Rank among the scores of its kind (within one dataset for cases of a sweep).
    pub rank: usize,
    /// Name of the score, from its folder.
    pub name: String,
    /// Name of the tracker, the same for all its cases of a sweep.
    #[serde(skip)]
    pub tracker: String,
    /// Name of the dataset.
    pub dataset: String,
    /// detection.f1
    pub f1: Option<f64>,
    /// Lower end of the 95 % interval of the first criterion.
    pub low: Option<f64>,
    /// Upper end of the same interval.
    pub high: Option<f64>,
    /// detection.recall
    pub recall: Option<f64>,
    /// detection.precision
    pub precision: Option<f64>,
    /// detection.rmse_xy_px
    pub rmse_xy_px: Option<f64>,
    /// gdpt.sigma_z_over_h
    pub sigma_z_over_h: Option<f64>,
    /// links.f1
    pub link_f1: Option<f64>,
    /// hota.hota
    pub hota: Option<f64>,
    /// isbi.alpha
    pub alpha: Option<f64>,
    /// isbi.beta
    pub beta: Option<f64>,
    /// isbi.jsc
    pub jsc: Option<f64>,
    /// isbi.jsc_theta
    pub jsc_theta: Option<f64>,
    /// field.nodes.valid
    pub valid_nodes: Option<f64>,
    /// field.valid_vector_probability
    pub valid_vector_probability: Option<f64>,
    /// field.aee_px
    pub aee_px: Option<f64>,
    /// field.u_inliers.rms_px
    pub rms_u_inliers_px: Option<f64>,
    /// field.v_inliers.rms_px
    pub rms_v_inliers_px: Option<f64>,
    /// particles_3d, particles_2d or field
    pub kind: ResultKind,
    /// detection.bias_x_px, or field.u.bias_px
    pub bias_x_px: Option<f64>,
    /// detection.bias_y_px, or field.v.bias_px
    pub bias_y_px: Option<f64>,
    /// Frames or image pairs that the result leaves out: counts.frames_missing, or field.n_pairs_missing
    pub missing: usize,
    /// planes.share_within
    pub share_within: Option<f64>,
    /// planes.rmse_z_um
    pub rmse_z_um: Option<f64>,
    /// planes.bias_z_um
    pub bias_z_um: Option<f64>,
    /// planes.p68_z_um
    pub p68_z_um: Option<f64>,
    /// Whether the bias in the image plane exceeds 0.25 px (particles only).
    pub biased: bool,
    /// Parameter values of the sweep.
    #[serde(skip)]
    pub axes: BTreeMap<String, Value>,
    /// Input of the paired comparison; scores of earlier versions have none.
    #[serde(skip)]
    pub(super) units: Option<Arc<UnitScores>>,
    /// Scores of the same group are ranked together.
    #[serde(skip)]
    group: String,
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
        let mut entry = Entry {
            name,
            dataset: score.dataset.clone(),
            axes: score.definitions.axes.clone(),
            missing: score.missing(),
            units,
            ..Entry::default()
        };
        if !entry.axes.is_empty() {
            // Each case of a sweep is ranked separately.
            entry.group = score.definitions.truth_sha256.clone().unwrap_or_default();
        }
        match &score.field {
            Some(field) if score.detection.is_none() => entry.of_field(field),
            None if score.detection.is_none() && score.planes.is_some() => entry.kind = ResultKind::Planes,
            _ => entry.of_particles(score),
        }
        if let Some(planes) = &score.planes {
            (entry.share_within, entry.p68_z_um) = (planes.share_within, planes.p68_z_um);
            (entry.rmse_z_um, entry.bias_z_um) = (planes.rmse_z_um, planes.bias_z_um);
        }
        let bias = entry.bias_x_px.zip(entry.bias_y_px).map(|(x, y)| x.hypot(y));
        entry.biased = entry.kind != ResultKind::Field && bias.is_some_and(|bias| bias > BIAS_PX);
        entry
    }

    fn of_particles(&mut self, score: &Score) {
        let mut first = None;
        if score.definitions.dims == 2 {
            self.kind = ResultKind::Particles2D;
        }
        if let Some(d) = &score.detection {
            (self.f1, self.recall, self.precision) = (d.f1, d.recall, d.precision);
            (self.rmse_xy_px, self.bias_x_px, self.bias_y_px) = (d.rmse_xy_px, d.bias_x_px, d.bias_y_px);
            first = d.interval.f1;
        }
        let gdpt = score.gdpt.as_ref();
        self.sigma_z_over_h = gdpt.and_then(|g| g.sigma_z_over_h);
        let (links, hota) = (score.links.as_ref(), score.hota.as_ref());
        self.link_f1 = links.and_then(|l| l.f1);
        self.hota = hota.and_then(|h| h.hota);
        if let Some(i) = &score.isbi {
            (self.alpha, self.beta, self.jsc, self.jsc_theta) = (i.alpha, i.beta, i.jsc, i.jsc_theta);
        }
        self.ends(first);
    }

    fn of_field(&mut self, field: &scoring::evaluate::field::FieldScore) {
        let errors = &field.main;
        self.kind = ResultKind::Field;
        (self.valid_nodes, self.valid_vector_probability) =
            (field.nodes.valid, errors.valid_vector_probability);
        self.aee_px = errors.aee_px;
        (self.rms_u_inliers_px, self.rms_v_inliers_px) = (errors.u_inliers.rms_px, errors.v_inliers.rms_px);
        (self.bias_x_px, self.bias_y_px) = (errors.u.bias_px, errors.v.bias_px);
        let nodes = field.nodes.interval_valid;
        let vectors = errors.interval_valid_vector_probability;
        // Scores of versions without reference nodes only have the fraction of valid vectors.
        let first = if field.nodes.valid.is_some() { nodes } else { vectors };
        self.ends(first);
    }

    fn ends(&mut self, first: Interval) {
        (self.low, self.high) = (first.map(|e| e[0]), first.map(|e| e[1]));
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
        ranked.extend(in_order(same).into_iter().map(|(i, rank)| {
            let (entry, score) = &same[i];
            (Entry { rank, ..entry.clone() }, score.clone())
        }));
    }
    ranked
}

/// Indices of scores of one kind and case in order, each with its rank.
fn in_order(same: &[(Entry, Score)]) -> Vec<(usize, usize)> {
    let criteria: &[Metric] = match same[0].0.kind {
        ResultKind::Planes => return by_depth(same),
        ResultKind::Particles3D | ResultKind::Particles2D => {
            &[Metric::F1, Metric::RmseXyPx, Metric::SigmaZOverH, Metric::LinkF1, Metric::Hota]
        }
        // Scores of versions without reference nodes only have those at their own vectors.
        ResultKind::Field if same.iter().all(|s| s.0.valid_nodes.is_none()) => {
            &[Metric::ValidVectorProbability, Metric::RmsInliersPx]
        }
        ResultKind::Field => &[Metric::ValidNodes, Metric::RmsNodesPx],
    };
    let contestants: Vec<Contestant<'_>> =
        same.iter().map(|(entry, score)| Contestant { score, units: entry.units.as_deref() }).collect();
    rank(&contestants, criteria, 0)
}

/// Recordings whose planes are known: by the distance from the plane that 68 % of all points keep, which
/// points on the wrong side of the focus increase.
fn by_depth(same: &[(Entry, Score)]) -> Vec<(usize, usize)> {
    let of = |i: &usize| same[*i].0.p68_z_um.unwrap_or(f64::INFINITY);
    let mut order: Vec<usize> = (0..same.len()).collect();
    order.sort_by(|a, b| of(a).total_cmp(&of(b)));
    let rank = |i: &usize| 1 + order.iter().filter(|other| of(other) < of(i)).count();
    order.iter().map(|i| (*i, rank(i))).collect()
}

/// Warning about a bias that does not affect the rank of an entry.
pub(super) fn caution(entry: &Entry) -> Option<String> {
    let (x, y) = entry.bias_x_px.zip(entry.bias_y_px).filter(|_| entry.biased)?;
    Some(format!(
        "{}: positions are biased by ({x:+.3}, {y:+.3}) px on average, which F1 and therefore the rank do not show",
        entry.name
    ))
}

/// The leaderboard in 80 columns.
pub(super) fn text(entries: &[Entry], warnings: &[String]) -> String {
    let n = number;
    let tied = |e: &Entry| {
        entries.iter().filter(|o| (o.kind, o.rank, &o.group) == (e.kind, e.rank, &e.group)).count() > 1
    };
    let rank = |e: &Entry| {
        format!("{}{}{}", e.rank, if tied(e) { "=" } else { "" }, if e.biased { "!" } else { "" })
    };
    let name = |e: &Entry| {
        let whole = storage::shown::name(&e.name);
        let name: String = whole.chars().take(14).collect();
        if name.len() < whole.len() { name + "~" } else { name }
    };
    let ends = |e: &Entry| e.low.zip(e.high).map_or("-".to_owned(), |(l, h)| format!("[{l:.4}, {h:.4}]"));
    let mut lines = Vec::new();
    let of = |kind: ResultKind| entries.iter().filter(move |e| e.kind == kind).collect::<Vec<_>>();
    let with_depth = of(ResultKind::Particles3D);
    let in_plane = of(ResultKind::Particles2D);
    let are_both = !with_depth.is_empty() && !in_plane.is_empty();
    let short = |v: Option<f64>| v.map_or("-".to_owned(), |v| format!("{v:.4}"));
    for particles in [with_depth, in_plane] {
        let Some(first) = particles.first() else { continue };
        if are_both {
            lines.push(format!("{}:", first.kind.title()));
        }
        lines.push(format!(
            "{:<4} {:<15} {:>6}  {:<16} {:>6} {:>6} {:>6} {:>6} {:>6}",
            "rank", "name", "F1", "95 %", "recall", "xy px", "z / h", "links", "HOTA"
        ));
        for same in particles.chunk_by(|a, b| a.axes == b.axes) {
            lines.extend(Some(same[0].case()).filter(|case| !case.is_empty()));
            lines.extend(same.iter().map(|e| {
                format!(
                    "{:<4} {:<15} {:>6}  {:<16} {:>6} {:>6} {:>6} {:>6} {:>6}",
                    rank(e),
                    name(e),
                    short(e.f1),
                    ends(e),
                    short(e.recall),
                    short(e.rmse_xy_px),
                    short(e.sigma_z_over_h),
                    short(e.link_f1),
                    short(e.hota)
                )
            }));
        }
    }
    let fields = of(ResultKind::Field);
    if !fields.is_empty() {
        lines.push(format!(
            "{:<4} {:<15} {:>8}  {:<16} {:>8} {:>9} {:>8}",
            "rank", "name", "nodes", "95 %", "vectors", "RMS in px", "AEE px"
        ));
    }
    for same in fields.chunk_by(|a, b| a.axes == b.axes) {
        lines.extend(Some(same[0].case()).filter(|case| !case.is_empty()));
        lines.extend(same.iter().map(|e| {
            format!(
                "{:<4} {:<15} {:>8}  {:<16} {:>8} {:>9} {:>8}",
                rank(e),
                name(e),
                n(e.valid_nodes),
                ends(e),
                n(e.valid_vector_probability),
                n(e.rms_u_inliers_px.zip(e.rms_v_inliers_px).map(|(u, v)| u.hypot(v))),
                n(e.aee_px)
            )
        }));
    }
    let planes = of(ResultKind::Planes);
    if !planes.is_empty() {
        lines.push(format!(
            "{:<4} {:<15} {:>11} {:>9} {:>9} {:>9}  (ranked by 68 %)",
            "rank", "name", "68 % z um", "in gate", "RMS z um", "bias z"
        ));
    }
    lines.extend(planes.iter().map(|e| {
        format!(
            "{:<4} {:<15} {:>11} {:>9} {:>9} {:>9}",
            rank(e),
            name(e),
            short(e.p68_z_um),
            short(e.share_within),
            short(e.rmse_z_um),
            short(e.bias_z_um)
        )
    }));
    lines.push(
        "Ranked by F1, then errors, links, HOTA (fields: valid nodes, RMS at nodes): where the paired comparison of one does not \
         separate two results, the next decides. =: separated by none."
            .to_owned(),
    );
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
            let detection = Some(Detection { f1: Some(f1), ..Detection::default() });
            let definitions = Definitions { dims, ..Definitions::default() };
            let score = Score { detection, definitions, ..Score::default() };
            (Entry::of(name.to_owned(), &score, None), score)
        };
        let ranked = ranked(vec![entry("flat", 2, 0.99), entry("deep", 3, 0.6), entry("deeper", 3, 0.7)]);
        let found: Vec<(&str, usize)> = ranked.iter().map(|(e, _)| (e.name.as_str(), e.rank)).collect();
        assert_eq!(found, [("deeper", 1), ("deep", 2), ("flat", 1)]);
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
