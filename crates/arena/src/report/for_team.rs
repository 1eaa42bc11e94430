//! What participants may see of scores against a withheld truth: averages over many particles, rounded.
//!
//! The error of a single particle, combined with its submitted position, reveals its true position. Errors
//! that depend on a single particle (medians, extremes, bins with few particles) are therefore left out.
//! Averages are rounded to three digits, and to a step that is at least the change that one particle can
//! cause: the gate divided by the number of matches, or 1 divided by it for rates. With all digits, two
//! submissions that differ in one row would reveal its true position exactly.
//!
//! Everything that is published passes through [`redacted`]: `for_team`, the scoring program of Codabench
//! (which passes on `for_team/score.json`), the leaderboards of `compare` and of suites.

use serde_json::{Number, Value};

use super::files::SCORE;
use super::{REPORT, page};
use scoring::evaluate::orientation::Orientation;
use scoring::evaluate::{Evaluation, Hint, Score};
use storage::OutputFolder;
use storage::error::{Error, Result};

/// Name of the folder.
pub(super) const FOLDER: &str = "for_team";

/// Minimum number of particles or vectors over which errors are averaged.
const FEWEST: usize = 20;

/// Number of significant digits.
const DIGITS: usize = 3;

/// Prefixes of keys whose value depends on a single particle.
const OF_ONE: [&str; 5] = ["p50", "p95", "median", "min_distance", "max_distance"];

/// Keys that are not results: definitions, counts, edges of bins.
const EXACT: [&str; 6] = ["definitions", "counts", "from", "to", "z_over_h", "wavelength_px"];

/// Rules among the results. The gate of reference nodes is none of them: it follows from the true field.
const RULES: [&str; 3] = ["gate_xy_px", "gate_z_um", "plane_um"];

/// Distances in px, as those whose keys end with `_px`.
const DISTANCES: [&str; 4] = ["rmse", "std_distance", "motp", "interval_motp"];

/// Scores with a gate of their own, `gate_px`, which is a rule.
const ISBI: [&str; 2] = ["isbi", "isbi_2d"];

/// Writes `score.json`, and `report.html` if asked for, into the folder `for_team`; returns their names.
pub(super) fn write(folder: &OutputFolder, evaluation: &Evaluation, html: bool) -> Result<Vec<String>> {
    let folder = folder.subfolder(FOLDER)?;
    let mut names = Vec::new();
    for (name, text) in published(evaluation, html)? {
        folder.save_bytes(name, text)?;
        names.push(format!("{FOLDER}/{name}"));
    }
    Ok(names)
}

/// Names and contents of the files of an evaluation that may be published: `score.json`, and `report.html` without
/// true positions if asked for.
///
/// # Errors
/// A plot that cannot be drawn.
pub(crate) fn published(evaluation: &Evaluation, html: bool) -> Result<Vec<(&'static str, String)>> {
    let score = redacted(&evaluation.score)?;
    let text = serde_json::to_string_pretty(&score).map_err(|e| Error::input(e.to_string()))?;
    let mut files = vec![(SCORE, text + "\n")];
    let has_few = evaluation.score.truth_is_secret && averaged(&evaluation.score) < FEWEST;
    if html && !has_few {
        let evaluation = Evaluation { score, ..evaluation.clone() };
        files.push((REPORT, page::page(&evaluation, false)?));
    }
    Ok(files)
}

/// The publishable part of a score: all of it, unless the truth is withheld.
///
/// # Errors
/// A score that cannot be serialized; never observed.
pub(crate) fn redacted(score: &Score) -> Result<Score> {
    if !score.truth_is_secret {
        return Ok(score.clone());
    }
    let n = averaged(score);
    let score = &with_questions(score);
    let kept = if n >= FEWEST { without_details(score) } else { without_scores(score) };
    let value = serde_json::to_value(&kept).map_err(|e| Error::input(e.to_string()))?;
    let gate = score.definitions.gate.map_or((1.0, f64::INFINITY), |gate| (gate.xy_px, gate.z_um));
    let value = Rounding { n: n.max(FEWEST), links: links(score).max(FEWEST), gate }.of("", value);
    serde_json::from_value(value).map_err(|e| Error::input(e.to_string()))
}

/// Number of particles or vectors over which overall errors are averaged.
fn averaged(score: &Score) -> usize {
    let of_fields = || score.field.as_ref().map_or(0, |field| field.n_reported);
    score.detection.as_ref().map_or_else(of_fields, |detection| detection.tp)
}

/// Number of correct links, over which errors of displacements are averaged.
fn links(score: &Score) -> usize {
    score.links.as_ref().map_or(0, |links| links.tp)
}

/// The score without what a few rows decide. In bins of depth (also of the Cramer-Rao bound, whose efficiency is
/// the bound over the RMS error of the bin), and by uncertainties that a result claims, one
/// submission could ask about many particles at once; the mean score of claims (CRPS) is limited to the gate
/// for each particle, as errors are. The errors of points in one frame give the height of its plane. Errors of
/// velocity have no upper limit: velocities that are wrong by 1, 2, 4, ... would be weights, and the RMS error
/// would tell which of many moved rows are matched. HOTA at each threshold is a score at another gate. What is another
/// score times a known factor would have other digits.
fn without_details(score: &Score) -> Score {
    let whole = score.clone();
    // Each group is named, so that a new one is withheld or published on purpose.
    let mut score = Score {
        curves: Vec::new(),
        gates: Vec::new(),
        uncertainty: None,
        crlb: None,
        planes: None,
        dataset: whole.dataset,
        result: whole.result,
        detection: whole.detection,
        links: whole.links,
        isbi: whole.isbi,
        isbi_2d: whole.isbi_2d,
        hota: whole.hota,
        clear: whole.clear,
        identity: whole.identity,
        ctc: whole.ctc,
        gdpt: whole.gdpt,
        crps: whole.crps,
        lpt: whole.lpt,
        boxes: whole.boxes,
        orientation: whole.orientation,
        field: whole.field,
        counts: whole.counts,
        offset: whole.offset,
        definitions: whole.definitions,
        assumptions: whole.assumptions,
        hints: whole.hints,
        unknown: whole.unknown,
        warnings: whole.warnings,
        truth_is_secret: whole.truth_is_secret,
    };
    if let Some(orientation) = score.orientation.as_mut().filter(|orientation| orientation.n < FEWEST) {
        let Orientation { n_true, n, mean_all_deg, guess_deg, .. } = *orientation;
        *orientation = Orientation { n_true, n, mean_all_deg, guess_deg, ..Orientation::default() };
    }
    if let Some(hota) = &mut score.hota {
        hota.curve.clear();
    }
    let few_links = links(&score) < FEWEST;
    if let Some(lpt) = &mut score.lpt {
        if few_links {
            (lpt.motion, lpt.interval) = Default::default();
        }
        let motion = &mut lpt.motion;
        (motion.velocity_rms_um_s, motion.velocity_rms_relative, motion.velocity_rms_z_um_s) =
            Default::default();
        (motion.acceleration_rms_um_s2, motion.acceleration_rms_relative) = Default::default();
        lpt.interval.velocity_rms_um_s = None;
    }
    if let Some(field) = &mut score.field {
        for errors in field.truths.values_mut().chain([&mut field.main]) {
            (errors.uncertainty, errors.uncertainty_ratio_u) = Default::default();
            (errors.coverage_1s_u, errors.coverage_2s_u, errors.coverage_1s_u_inliers) = Default::default();
            errors.peak_locking.bias_curve_px.clear();
            errors.aee_per_100px = None;
            errors.spectra.clear();
        }
    }
    if let Some(gdpt) = &mut score.gdpt {
        gdpt.curve.clear();
    }
    score
}

/// The score with the questions of its hints only; the rest of a hint quotes scores, also of a sample. A hint
/// without a question is left out.
fn with_questions(score: &Score) -> Score {
    let mut score = score.clone();
    for hint in std::mem::take(&mut score.hints) {
        if !hint.question.is_empty() {
            score.hints.push(Hint::new(hint.question, ""));
        }
    }
    score
}

/// The score of a result that hardly overlaps with the truth: counts only.
fn without_scores(score: &Score) -> Score {
    let mut warnings = score.warnings.clone();
    let why = format!("fewer than {FEWEST} particles or vectors could be compared: scores are withheld");
    // A score that was published may be compared.
    if !warnings.contains(&why) {
        warnings.push(why);
    }
    Score {
        truth_is_secret: score.truth_is_secret,
        dataset: score.dataset.clone(),
        result: score.result.clone(),
        counts: score.counts.clone(),
        definitions: score.definitions.clone(),
        assumptions: score.assumptions.clone(),
        hints: score.hints.clone(),
        warnings,
        ..Score::default()
    }
}

/// How averages are rounded.
#[derive(Clone, Copy)]
struct Rounding {
    /// Number of particles or vectors that are averaged.
    n: usize,
    /// Number of correct links, over which errors of motion are averaged.
    links: usize,
    /// Gate in the image plane, px, and along z, um.
    gate: (f64, f64),
}

impl Rounding {
    /// Rounds a value, with everything it contains, according to its key.
    fn of(self, key: &str, value: Value) -> Value {
        if OF_ONE.iter().any(|beginning| key.starts_with(beginning)) {
            return Value::Null;
        }
        match value {
            Value::Number(number) if number.is_f64() && !RULES.contains(&key) => {
                let exact = number.as_f64().unwrap_or_default();
                let step = if EXACT.contains(&key) { 0.0 } else { self.step(key, exact) };
                Number::from_f64(rounded(exact, step)).map_or(Value::Null, Value::Number)
            }
            Value::Array(values) => values.into_iter().map(|value| self.of(key, value)).collect(),
            Value::Object(fields) if ["definitions", "counts"].contains(&key) => Value::Object(fields),
            Value::Object(fields) => {
                let of = |count: &str| fields.get(count).and_then(Value::as_u64).map(|n| n as usize);
                let own = if key == "lpt" { Some(self.links) } else { of("tp").or_else(|| of("n")) };
                let own_gate = fields.get("gate_px").filter(|_| ISBI.contains(&key)).cloned();
                let gate_px = own_gate.as_ref().and_then(Value::as_f64).unwrap_or(self.gate.0);
                let inner = Rounding {
                    n: own.map_or(self.n, |n| n.max(FEWEST)),
                    gate: (gate_px, self.gate.1),
                    ..self
                };
                let rounded = fields.into_iter().map(|(key, value)| match (&own_gate, key.as_str()) {
                    (Some(gate), "gate_px") => (key, gate.clone()),
                    _ => (key.clone(), inner.of(&key, value)),
                });
                rounded.collect()
            }
            other => other,
        }
    }

    /// Approximately the largest change of an average that one particle can cause.
    fn step(self, key: &str, value: f64) -> f64 {
        let size = match key {
            key if key.ends_with("_px") || DISTANCES.contains(&key) => self.gate.0,
            key if key.ends_with("_um") && self.gate.1.is_finite() => self.gate.1,
            key if key.ends_with("_deg") => 90.0,
            // The gate is a tenth of the depth range.
            key if key.ends_with("_over_h") => 0.1,
            _ => value.abs().max(1.0),
        };
        size / self.n as f64
    }
}

/// A number with three digits, rounded to a step of 1, 2 or 5 times a power of ten that is at least the given
/// one.
fn rounded(exact: f64, least: f64) -> f64 {
    let digits: f64 = format!("{exact:.*e}", DIGITS - 1).parse().unwrap_or(exact);
    if least <= 0.0 || !digits.is_finite() {
        return digits;
    }
    let power = least.log10().floor();
    let step = [1.0, 2.0, 5.0, 10.0].map(|k| k * 10f64.powf(power)).into_iter().find(|step| *step >= least);
    let step = step.unwrap_or(least);
    // Formatted, so that no digits beyond the step remain.
    let places = (-power).clamp(0.0, 300.0) as usize;
    format!("{:.places$}", (digits / step).round() * step).parse::<f64>().unwrap_or(digits) + 0.0
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;
    use scoring::evaluate::PositionUncertainty;
    use scoring::evaluate::crlb::Crlb;
    use scoring::evaluate::crps::Crps;
    use scoring::evaluate::curves::{Bin, Curve};
    use scoring::evaluate::hota::Hota;
    use scoring::evaluate::links::Links;
    use scoring::evaluate::lpt::Lpt;
    use scoring::evaluate::motion::Motion;
    use scoring::evaluate::planes::PlaneScore;
    use scoring::evaluate::score_keys::{ScoreKey, score_keys};
    use scoring::evaluate::uncertainty::Uncertainty;

    #[test]
    fn what_a_few_rows_decide_is_withheld() {
        let claimed = Uncertainty { n: 400, coverage_1s: Some(0.995), ..Uncertainty::default() };
        let mean = Crps { n: 500, xy_px: Some(0.123_456), ..Crps::default() };
        let curve = Curve { against: "z_um".to_owned(), bins: vec![Bin { tp: 400, ..Bin::default() }] };
        let kept = without_details(&Score {
            uncertainty: Some(PositionUncertainty { x: Some(claimed), ..PositionUncertainty::default() }),
            crps: Some(mean),
            curves: vec![curve],
            crlb: Some(Crlb { efficiency_axis: Some(0.9), ..Crlb::default() }),
            planes: Some(PlaneScore { bias_z_um: Some(1.5), ..PlaneScore::default() }),
            orientation: Some(Orientation {
                n: 1,
                mean_deg: Some(39.8),
                rms_deg: Some(39.8),
                ..Orientation::default()
            }),
            links: Some(Links { tp: 1, ..Links::default() }),
            lpt: Some(Lpt {
                motion: Motion { displacement_bias_x_px: Some(0.1502), ..Motion::default() },
                ..Lpt::default()
            }),
            ..Score::default()
        });
        assert!(kept.uncertainty.is_none() && kept.curves.is_empty());
        assert!(kept.crlb.is_none() && kept.planes.is_none());
        let crps = serde_json::to_value(kept.crps).unwrap();
        assert_eq!(kept.orientation.map(|o| (o.mean_deg, o.rms_deg)), Some((None, None)));
        assert_eq!(kept.lpt.unwrap().motion, Motion::default());
        let rounding = Rounding { n: 400, links: 20, gate: (2.0, 10.0) };
        // A particle changes the mean of 500 by at most 2 px / 500.
        assert_eq!(rounding.of("crps", crps)["xy_px"], 0.125);
        assert_eq!(
            rounding.of("lpt", serde_json::json!({ "displacement_bias_x_px": 0.17 }))["displacement_bias_x_px"],
            0.2
        );
    }

    /// Scores without a unit, which one particle changes by at most its share, or which are withheld: a new one is added on
    /// purpose.
    #[test]
    fn no_distance_is_published_with_the_digits_of_a_share() {
        let rounding = Rounding { n: 60, links: 60, gate: (2.0, 10.0) };
        let isbi = json!({ "gate_px": 5.432, "rmse": 0.2778, "std_distance": 0.1234, "interval": { "rmse": [0.2511, 0.3149] } });
        assert_eq!(
            rounding.of("isbi_2d", isbi),
            json!({ "gate_px": 5.432, "rmse": 0.3, "std_distance": 0.1, "interval": { "rmse": [0.3, 0.3] } })
        );
        assert_eq!(rounding.of("motp", json!(0.2778)), json!(0.3));
        let group = |path: &str| path.split(['.', '[']).next().unwrap_or_default().to_owned();
        let withheld =
            ["curves", "gates", "uncertainty", "crlb", "planes", "definitions", "counts", "hints", "offset"];
        let is_share = |key: &ScoreKey| key.range.1.is_some();
        let mut others: Vec<String> = score_keys()
            .into_iter()
            .filter(|key| key.is_float && key.unit().is_empty() && !is_share(key))
            .filter(|key| !withheld.contains(&group(&key.path).as_str()))
            .map(|key| key.path.rsplit('.').next().unwrap_or_default().to_owned())
            .filter(|name| !DISTANCES.contains(&name.as_str()))
            .collect();
        others.sort_unstable();
        others.dedup();
        let known = [
            "acceleration_rms_relative",
            "aogm",
            "claimed_rms",
            "divergence_rms",
            "error_rms",
            "fragments_per_truth",
            "ghost",
            "interval_mota",
            "interval_response",
            "max_distance",
            "mean_length",
            "mean_repeats",
            "median_length",
            "min_distance",
            "modulation_u",
            "modulation_v",
            "mota",
            "nepe",
            "ratio",
            "response",
            "sigma_z_over_h",
            "strain_rms",
            "true_divergence_rms",
            "true_strain_rms",
            "true_vorticity_rms",
            "truths_per_result",
            "uncertainty_ratio_u",
            "velocity_rms_relative",
            "vorticity_rms",
        ];
        assert_eq!(others, known);
    }

    #[test]
    fn velocities_and_thresholds_are_no_questions_about_many_rows() {
        let motion = Motion {
            velocity_rms_um_s: Some(75_800.0),
            velocity_rms_relative: Some(233.0),
            velocity_rms_z_um_s: Some(12.0),
            displacement_rms_px: Some(0.3),
            ..Motion::default()
        };
        let mut lpt = Lpt { motion, ..Lpt::default() };
        lpt.interval.velocity_rms_um_s = Some([17_200.0, 124_000.0]);
        let kept = without_details(&Score {
            links: Some(Links { tp: 400, ..Links::default() }),
            lpt: Some(lpt),
            hota: Some(Hota { hota: Some(0.9), curve: vec![0.9; 19], ..Hota::default() }),
            ..Score::default()
        });
        let (lpt, hota) = (kept.lpt.unwrap(), kept.hota.unwrap());
        assert_eq!(lpt.motion, Motion { displacement_rms_px: Some(0.3), ..Motion::default() });
        assert_eq!((lpt.interval.velocity_rms_um_s, hota.hota), (None, Some(0.9)));
        assert!(hota.curve.is_empty());
    }

    #[test]
    fn hints_ask_without_scores() {
        let hint =
            Hint { f1: Some(0.91), ..Hint::new("origin mismatch?", "F1 would be 0.91 instead of 0.25") };
        let warnings = vec!["fewer rows".to_owned()];
        let asked = with_questions(&Score { hints: vec![hint.clone()], warnings, ..Score::default() });
        assert_eq!(asked.warnings, ["fewer rows"]);
        assert_eq!(asked.hints, [Hint::new("origin mismatch?", "")]);
        let read = serde_json::from_value(serde_json::to_value(&hint).unwrap()).unwrap();
        assert_eq!(with_questions(&Score { hints: vec![read], ..Score::default() }).hints, asked.hints);
        let unasked = Hint { question: String::new(), ..hint };
        let asked = with_questions(&Score { hints: vec![unasked], ..Score::default() });
        assert!(asked.hints.is_empty());
    }

    #[test]
    fn one_particle_changes_no_digit_for_certain() {
        // One particle of 400 changes a bias by at most 2 px / 400 = 0.005 px.
        let rounding = Rounding { n: 400, links: 30, gate: (2.0, 10.0) };
        let of = |key: &str, value: f64| rounding.of(key, value.into()).as_f64().unwrap();
        assert_eq!(of("bias_x_px", 0.012_345), 0.01);
        assert_eq!(of("bias_z_um", -0.987_654), -1.0);
        assert_eq!(of("f1", 0.912_345), 0.91);
        assert_eq!(of("mota", -1234.56), -1230.0);
        assert!(rounding.of("p95_xy_px", 1.5.into()).is_null());
        assert_eq!(of("from", 0.123_456), 0.123);
        assert_eq!((of("gate_z_um", 4.0251), of("gate_px", 0.6184)), (4.0251, 0.62));
        for (exact, least, expected) in
            [(0.0, 0.1, 0.0), (0.26, 0.03, 0.25), (123.4, 30.0, 100.0), (-0.004, 0.01, 0.0), (5.0, 1e-9, 5.0)]
        {
            assert_eq!(rounded(exact, least), expected, "{exact} {least}");
        }
        let bins = serde_json::json!({ "tp": 20, "bias_x_px": 0.04 });
        assert_eq!(rounding.of("", bins)["bias_x_px"], 0.0);
    }
}
