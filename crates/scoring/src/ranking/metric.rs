//! The scores of tables and rankings: where they are in `score.json`, their labels and units, which values are better, how they
//! are read and how two results are compared by them. Leaderboards, pages, suites and bundles iterate over this list.

use serde::Serialize;
use storage::dataset::manifest::Metric;

use super::paired::{Draws, OfResamples, resampled};
use crate::evaluate::field::FieldScore;
use crate::evaluate::hota::{self, SUMS};
use crate::evaluate::statistics::{Interval, ratio};
use crate::evaluate::{Score, UnitScores};

/// Which values of a score are better.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Better {
    /// Larger values.
    Greater,
    /// Smaller values: an error.
    Smaller,
    /// Values nearer to 1.
    NearOne,
    /// Values nearer to 0: a bias.
    NearZero,
}

impl Better {
    /// The value transformed so that larger is better.
    pub(super) fn merit(self, value: f64) -> f64 {
        match self {
            Better::Greater => value,
            Better::Smaller => -value,
            Better::NearOne => -(value - 1.0).abs(),
            Better::NearZero => -value.abs(),
        }
    }
}

/// What a score describes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Subject {
    /// Particles and their tracks.
    Particles,
    /// A displacement field.
    Field,
    /// Depths in recordings, of which planes are known and positions are not.
    Planes,
}

/// How the average of a published score changes with a single particle.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Published {
    /// By 1 / n.
    Rate,
    /// By the gate in the image plane / n (1 px for fields).
    Px,
    /// By the gate along z / n.
    Um,
    /// By a tenth / n: the gate is a tenth of the depth range.
    DepthShare,
    /// By 90 degrees / n.
    Degrees,
}

/// Value and 95 % interval.
type Measured = (Option<f64>, Interval);

/// What of two results is compared.
#[derive(Debug, Clone, Copy)]
pub(super) enum Compared {
    /// Value and interval: scores over particles or vectors that a result chose itself.
    Interval,
    /// The score of each resample of the units that all results share; `None` without units.
    Resamples(fn(&UnitScores, &Draws) -> Option<OfResamples>),
    /// The squared errors of every true particle.
    Errors(fn(&UnitScores) -> &[f32]),
}

/// A score of an evaluation.
#[derive(Debug, Clone, Copy)]
pub struct ScoreDef {
    /// Name as a column of tables; of scores that rank, also in the files of suites.
    pub name: &'static str,
    /// Path in `score.json`; empty if it is computed from several values there.
    pub path: &'static str,
    /// Name for readers.
    pub label: &'static str,
    /// Unit; empty for numbers.
    pub unit: &'static str,
    /// Which values are better.
    pub better: Better,
    /// What it describes.
    pub subject: Subject,
    /// The metric by which suites can rank; `None` for scores that are only shown.
    pub metric: Option<Metric>,
    /// Whether leaderboards for challenges and plots over sweeps show it.
    pub is_headline: bool,
    /// Heading in terminals; `None` for scores that are not shown there.
    pub heading: Option<&'static str>,
    /// Whether `compare` ranks by it; in the order of this list.
    pub is_criterion: bool,
    /// How it is rounded where the truth is withheld; `None` if it is withheld, too.
    pub published: Option<Published>,
    get: fn(&Score) -> Option<Measured>,
    pub(super) compared: Compared,
}

impl ScoreDef {
    /// The definition of a metric.
    pub fn of(metric: Metric) -> &'static ScoreDef {
        let index = SCORES.iter().position(|def| def.metric == Some(metric));
        &SCORES[index.unwrap_or_default()]
    }

    /// The metrics by which suites can rank.
    pub fn metrics() -> impl Iterator<Item = Metric> {
        SCORES.iter().filter_map(|def| def.metric)
    }

    /// Label and unit.
    pub fn title(&self) -> String {
        if self.unit.is_empty() { self.label.to_owned() } else { format!("{}, {}", self.label, self.unit) }
    }

    /// Value and 95 % interval in an evaluation.
    pub fn measured(&self, score: &Score) -> (Option<f64>, Interval) {
        (self.get)(score).unwrap_or_default()
    }

    const fn new(
        subject: Subject,
        [name, path, label, unit]: [&'static str; 4],
        better: Better,
        get: fn(&Score) -> Option<Measured>,
    ) -> Self {
        let (metric, is_headline, heading, is_criterion) = (None, false, None, false);
        let compared = Compared::Interval;
        ScoreDef {
            name,
            path,
            label,
            unit,
            better,
            subject,
            metric,
            is_headline,
            heading,
            is_criterion,
            published: None,
            get,
            compared,
        }
    }

    /// Suites can rank by it.
    const fn ranks(mut self, metric: Metric, compared: Compared) -> Self {
        (self.metric, self.compared) = (Some(metric), compared);
        self
    }

    const fn headline(mut self) -> Self {
        self.is_headline = true;
        self
    }

    /// A headline, and in terminals.
    const fn heading(mut self, heading: &'static str) -> Self {
        self.heading = Some(heading);
        self.headline()
    }

    /// An average over particles or reference nodes, of which each contributes a limited amount.
    const fn published(mut self, by: Published) -> Self {
        self.published = Some(by);
        self
    }

    const fn criterion(mut self) -> Self {
        self.is_criterion = true;
        self
    }
}

/// Whether criteria are scores of displacement fields; a suite ranks either these or particles.
pub fn ranks_fields(criteria: &[Metric]) -> bool {
    criteria.first().is_some_and(|metric| ScoreDef::of(*metric).subject == Subject::Field)
}

/// A score: what it describes, the part of [`Score`] that has it, its name, path, label and unit, which values are better,
/// value and interval.
macro_rules! score {
    ($subject:ident $of:ident in $part:ident: $texts:expr, $better:expr, $value:expr, $ends:expr) => {
        ScoreDef::new(Subject::$subject, $texts, $better, |score| {
            score.$part.as_ref().map(|$of| ($value, $ends))
        })
    };
}

/// Compares by a statistic of sums over units.
macro_rules! sums {
    ($part:ident: $sums:pat => $statistic:expr) => {
        Resamples(|units, draws| resampled(&units.$part, draws, |$sums| $statistic))
    };
}

use Better::{Greater, NearOne, NearZero, Smaller};
use Compared::{Errors, Interval as Ends, Resamples};

/// All scores of tables and rankings.
pub static SCORES: &[ScoreDef] = &[
    score!(Particles d in detection: ["f1", "detection.f1", "F1", ""], Greater, d.f1, d.interval_f1)
        .ranks(Metric::F1, Resamples(f1))
        .heading("F1")
        .criterion()
    .published(Published::Rate),
    score!(Particles d in detection: ["recall", "detection.recall", "recall", ""], Greater,
        d.recall, d.interval_recall)
    .ranks(Metric::Recall, Resamples(found_per_true))
    .heading("recall")
    .published(Published::Rate),
    score!(Particles d in detection: ["precision", "detection.precision", "precision", ""], Greater,
        d.precision, d.interval_precision)
    .ranks(Metric::Precision, sums!(detection: [tp, _, fp] => ratio(tp, tp + fp)))
    .headline()
    .published(Published::Rate),
    score!(Particles d in detection: ["rmse_xy_px", "detection.rmse_xy_px", "RMSE xy", "px"], Smaller,
        d.rmse_xy_px, d.interval_rmse_xy_px)
    .ranks(Metric::RmseXyPx, Errors(|u| &u.xy))
    .heading("xy px")
    .criterion()
    .published(Published::Px),
    score!(Particles d in detection: ["rmse_z_um", "detection.rmse_z_um", "RMSE z", "um"], Smaller,
        d.rmse_z_um, d.interval_rmse_z_um)
    .published(Published::Um),
    score!(Particles d in detection: ["bias_x_px", "detection.bias_x_px", "bias x", "px"], NearZero,
        d.bias_x_px, d.interval_bias_x_px)
    .headline()
    .published(Published::Px),
    score!(Particles d in detection: ["bias_y_px", "detection.bias_y_px", "bias y", "px"], NearZero,
        d.bias_y_px, d.interval_bias_y_px)
    .published(Published::Px),
    score!(Particles g in gdpt: ["sigma_z_over_h", "gdpt.sigma_z_over_h", "sigma z / h", ""], Smaller,
        g.sigma_z_over_h, g.interval_sigma_z_over_h)
    .ranks(Metric::SigmaZOverH, Errors(|u| &u.z))
    .heading("z / h")
    .criterion()
    .published(Published::DepthShare),
    score!(Particles c in crps: ["crps_xy_px", "crps.xy_px", "CRPS xy", "px"], Smaller,
        c.xy_px, c.interval_xy_px)
    .ranks(Metric::CrpsXyPx, sums!(crps: [n, xy, _] => ratio(xy, n)))
    .published(Published::Px),
    score!(Particles c in crps: ["crps_z_um", "crps.z_um", "CRPS z", "um"], Smaller,
        c.z_um, c.interval_z_um)
        .ranks(Metric::CrpsZUm, sums!(crps: [n, _, z] => ratio(z, n)))
    .published(Published::Um),
    score!(Particles l in links: ["link_f1", "links.f1", "link F1", ""], Greater, l.f1, l.interval_f1)
        .ranks(Metric::LinkF1, sums!(links: [tp, n, m] => ratio(2.0 * tp, n + m)))
        .heading("links")
        .criterion()
    .published(Published::Rate),
    score!(Particles h in hota: ["hota", "hota.hota", "HOTA", ""], Greater, h.hota, h.interval_hota)
        .ranks(Metric::Hota, Resamples(hota))
        .heading("HOTA")
        .criterion()
    .published(Published::Rate),
    score!(Particles c in clear: ["mota", "clear.mota", "MOTA", ""], Greater, c.mota, c.interval_mota)
    .published(Published::Rate),
    score!(Particles i in isbi: ["isbi_alpha", "isbi.alpha", "ISBI alpha", ""], Greater,
        i.alpha, i.interval_alpha)
    .published(Published::Rate),
    score!(Particles i in isbi: ["isbi_beta", "isbi.beta", "ISBI beta", ""], Greater,
        i.beta, i.interval_beta)
        .ranks(Metric::IsbiBeta, sums!(isbi: [gain, length, others] => ratio(gain, length + others)))
    .published(Published::Rate),
    score!(Particles i in isbi: ["isbi_jsc", "isbi.jsc", "ISBI JSC", ""], Greater, i.jsc, i.interval_jsc)
    .published(Published::Rate),
    score!(Particles i in isbi: ["isbi_jsc_theta", "isbi.jsc_theta", "ISBI JSC_theta", ""], Greater,
        i.jsc_theta, i.interval_jsc_theta)
    .published(Published::Rate),
    score!(Particles l in lpt: ["lpt_correct", "lpt.correct", "correct", ""], Greater,
        l.correct, l.interval_correct)
    .ranks(Metric::LptCorrect, Resamples(found_per_true))
    .published(Published::Rate),
    score!(Particles l in lpt: ["lpt_ghost", "lpt.ghost", "ghosts", ""], Smaller, l.ghost, l.interval_ghost)
        .ranks(Metric::LptGhost, sums!(detection: [tp, missed, fp] => ratio(fp, tp + missed)))
    .published(Published::Rate),
    score!(Particles l in lpt: ["velocity_rms_um_s", "lpt.velocity_rms_um_s", "velocity RMS", "um/s"], Smaller,
        l.motion.velocity_rms_um_s, l.interval_velocity_rms_um_s)
    .ranks(Metric::VelocityRmsUmS, Errors(|u| &u.velocity)),
    score!(Particles o in orientation: ["angle_mean_all_deg", "orientation.mean_all_deg", "mean angle of all", "deg"], Smaller,
        o.mean_all_deg, o.interval_mean_all_deg)
    .ranks(Metric::AngleMeanAllDeg, sums!(angles: [n, sum] => ratio(sum, n)))
    .published(Published::Degrees),
    score!(Particles s in size: ["size_right", "size.right", "right size of all", ""], Greater, s.right, s.interval_right)
        .ranks(Metric::SizeRight, sums!(sizes: [n, right] => ratio(right, n)))
        .published(Published::Rate),
    score!(Particles s in size: ["size_rms_um", "size.rms_um", "RMSE diameter", "um"], Smaller,
        s.rms_um, s.interval_rms_um),
    score!(Field f in field: ["valid_nodes", "field.nodes.valid", "valid nodes", ""], Greater,
        f.nodes.valid, f.nodes.interval_valid)
    .ranks(Metric::ValidNodes, sums!(nodes: [n, _, valid, ..] => ratio(valid, n)))
    .heading("nodes")
    .criterion()
    .published(Published::Rate),
    score!(Field f in field: ["rms_nodes_px", "field.nodes.rms_px", "RMS at nodes", "px"], Smaller,
        f.nodes.rms_px, f.nodes.interval_rms_px)
    .ranks(Metric::RmsNodesPx, sums!(nodes: [n, _, _, squares, ..] => ratio(squares, n).map(f64::sqrt)))
    .heading("RMS px")
    .criterion()
    .published(Published::Px),
    score!(Field f in field: ["response_nodes", "field.nodes.response", "amplitude response", ""], NearOne,
        f.nodes.response, f.nodes.interval_response)
    .ranks(Metric::ResponseNodes, sums!(nodes: [.., product, exact] => ratio(product, exact)))
    .heading("response"),
    score!(Field f in field: ["valid_vector_probability", "field.valid_vector_probability", "valid vectors", ""], Greater,
        f.main.valid_vector_probability, f.main.interval_valid_vector_probability)
    .ranks(Metric::ValidVectorProbability, Ends)
    .heading("vectors"),
    score!(Field f in field: ["rms_inliers_px", "", "RMS of inliers", "px"], Smaller,
        rms_of_inliers(f).0, rms_of_inliers(f).1)
    .ranks(Metric::RmsInliersPx, Ends)
    .headline(),
    score!(Field f in field: ["modulation_u", "field.modulation_u", "amplitude response of inliers", ""], NearOne,
        f.main.modulation_u, None),
    score!(Field f in field: ["aee_px", "field.aee_px", "AEE", "px"], Smaller, f.main.aee_px, f.main.interval_aee_px)
        .heading("AEE px"),
    score!(Field f in field: ["bias_u_px", "field.u.bias_px", "bias u", "px"], NearZero,
        f.main.u.bias_px, None)
    .headline(),
    score!(Field f in field: ["bias_v_px", "field.v.bias_px", "bias v", "px"], NearZero,
        f.main.v.bias_px, None),
    score!(Planes p in planes: ["p68_z_um", "planes.p68_z_um", "68 % of z within", "um"], Smaller,
        p.p68_z_um, None)
    .heading("68% um"),
    score!(Planes p in planes: ["share_within", "planes.share_within", "points near their plane", ""], Greater,
        p.share_within, None)
    .heading("in gate"),
    score!(Planes p in planes: ["plane_rmse_z_um", "planes.rmse_z_um", "RMS z", "um"], Smaller,
        p.rmse_z_um, None)
    .heading("RMS z um"),
    score!(Planes p in planes: ["plane_bias_z_um", "planes.bias_z_um", "bias z", "um"], NearZero,
        p.bias_z_um, None)
    .heading("bias z"),
];

/// A true positive with a ghost beside it does not count as found: see `evaluate/units.rs`.
fn f1(units: &UnitScores, draws: &Draws) -> Option<OfResamples> {
    let beside = units.beside.iter().copied().chain(std::iter::repeat(0.0));
    let of_unit = |([tp, missed, fp], beside): (&[f64; 3], f64)| [tp - beside, 2.0 * tp + missed + fp];
    let sums: Vec<[f64; 2]> = units.detection.iter().zip(beside).map(of_unit).collect();
    resampled(&sums, draws, |[found, all]| ratio(2.0 * found, all))
}

fn found_per_true(units: &UnitScores, draws: &Draws) -> Option<OfResamples> {
    resampled(&units.detection, draws, |[tp, missed, _]| ratio(tp, tp + missed))
}

fn hota(units: &UnitScores, draws: &Draws) -> Option<OfResamples> {
    let sums: Option<Vec<[f64; SUMS]>> =
        units.hota.iter().map(|sums| sums.as_slice().try_into().ok()).collect();
    resampled(&sums?, draws, |sums| hota::means(&sums)[0])
}

/// RMS error of displacement of inliers, from the errors along x and y. Its interval is at least as wide as for
/// the combined error.
fn rms_of_inliers(field: &FieldScore) -> Measured {
    let errors = &field.main;
    let both = errors.u_inliers.rms_px.zip(errors.v_inliers.rms_px).map(|(u, v)| u.hypot(v));
    let ends = errors.interval_rms_u_inliers_px.zip(errors.interval_rms_v_inliers_px);
    (both, ends.map(|(u, v)| [u[0].hypot(v[0]), u[1].hypot(v[1])]))
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use schemars::schema_for;

    use super::*;

    /// As in the files of suites, and no name twice.
    #[test]
    fn every_metric_has_a_definition_of_its_name() {
        let written = |metric| serde_json::to_value(metric).unwrap();
        for metric in ScoreDef::metrics() {
            assert_eq!(written(metric), ScoreDef::of(metric).name);
        }
        let variants = serde_json::to_value(schema_for!(Metric)).unwrap()["oneOf"].as_array().unwrap().len();
        assert_eq!(ScoreDef::metrics().count(), variants);
        assert_eq!(SCORES.iter().map(|def| def.name).collect::<BTreeSet<_>>().len(), SCORES.len());
    }
}
