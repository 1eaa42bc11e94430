//! The scores: where they are in `score.json`, their labels and units, which values are better, and how they
//! are read. Rankings, tables and pages refer to this list.

use scenario::Metric;
use serde::Serialize;

use crate::evaluate::Score;
use crate::evaluate::field::FieldScore;
use crate::evaluate::statistics::Interval;

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
}

impl Better {
    /// The value transformed so that larger is better.
    pub(super) fn merit(self, value: f64) -> f64 {
        match self {
            Better::Greater => value,
            Better::Smaller => -value,
            Better::NearOne => -(value - 1.0).abs(),
        }
    }
}

/// Value and 95 % interval.
type Measured = (Option<f64>, Interval);

/// A score of an evaluation.
#[derive(Debug, Clone, Copy)]
pub struct ScoreDef {
    /// Path in `score.json`; empty if it is computed from several values there.
    pub path: &'static str,
    /// Name in tables.
    pub label: &'static str,
    /// Unit; empty for numbers.
    pub unit: &'static str,
    /// Which values are better.
    pub better: Better,
    /// The metric by which suites can rank; `None` for scores that are only shown.
    pub metric: Option<Metric>,
    /// Whether short tables show it.
    pub is_headline: bool,
    get: fn(&Score) -> Option<Measured>,
}

impl ScoreDef {
    /// The definition of a metric.
    pub fn of(metric: Metric) -> &'static ScoreDef {
        let index = SCORES.iter().position(|def| def.metric == Some(metric));
        &SCORES[index.unwrap_or_default()]
    }

    /// Label and unit.
    pub fn title(&self) -> String {
        if self.unit.is_empty() { self.label.to_owned() } else { format!("{}, {}", self.label, self.unit) }
    }

    /// Value and 95 % interval in an evaluation.
    pub fn measured(&self, score: &Score) -> (Option<f64>, Interval) {
        (self.get)(score).unwrap_or_default()
    }

    /// Whether it is a score of displacement fields; the others are scores of particles.
    pub fn is_of_fields(&self) -> bool {
        self.path.starts_with("field.") || self.metric.is_some_and(Metric::is_of_fields)
    }
}

/// Columns of [`SCORES`]: path, label, unit, better, metric, headline, value and interval.
const fn def(
    (path, label, unit): (&'static str, &'static str, &'static str),
    better: Better,
    (metric, is_headline): (Option<Metric>, bool),
    get: fn(&Score) -> Option<Measured>,
) -> ScoreDef {
    ScoreDef { path, label, unit, better, metric, is_headline, get }
}

use Better::{Greater, NearOne, Smaller};

/// All scores of tables and rankings.
pub static SCORES: [ScoreDef; 24] = [
    def(("detection.f1", "F1", ""), Greater, (Some(Metric::F1), true), |s| {
        s.detection.as_ref().map(|d| (d.f1, d.interval.f1))
    }),
    def(("detection.recall", "recall", ""), Greater, (Some(Metric::Recall), true), |s| {
        s.detection.as_ref().map(|d| (d.recall, d.interval.recall))
    }),
    def(("detection.precision", "precision", ""), Greater, (Some(Metric::Precision), true), |s| {
        s.detection.as_ref().map(|d| (d.precision, d.interval.precision))
    }),
    def(("detection.rmse_xy_px", "RMSE xy", "px"), Smaller, (Some(Metric::RmseXyPx), true), |s| {
        s.detection.as_ref().map(|d| (d.rmse_xy_px, d.interval.rmse_xy_px))
    }),
    def(("detection.rmse_z_um", "RMSE z", "um"), Smaller, (None, false), |s| {
        s.detection.as_ref().map(|d| (d.rmse_z_um, None))
    }),
    def(("gdpt.sigma_z_over_h", "sigma z / h", ""), Smaller, (Some(Metric::SigmaZOverH), true), |s| {
        s.gdpt.as_ref().map(|g| (g.sigma_z_over_h, g.interval.sigma_z_over_h))
    }),
    def(("crps.xy_px", "CRPS xy", "px"), Smaller, (Some(Metric::CrpsXyPx), false), |s| {
        s.crps.as_ref().map(|c| (c.xy_px, c.interval_xy_px))
    }),
    def(("crps.z_um", "CRPS z", "um"), Smaller, (Some(Metric::CrpsZUm), false), |s| {
        s.crps.as_ref().map(|c| (c.z_um, c.interval_z_um))
    }),
    def(("links.f1", "link F1", ""), Greater, (Some(Metric::LinkF1), true), |s| {
        s.links.as_ref().map(|l| (l.f1, l.interval_f1))
    }),
    def(("hota.hota", "HOTA", ""), Greater, (Some(Metric::Hota), true), |s| {
        s.hota.as_ref().map(|h| (h.hota, h.interval_hota))
    }),
    def(("clear.mota", "MOTA", ""), Greater, (None, false), |s| s.clear.as_ref().map(|c| (c.mota, None))),
    def(("isbi.jsc", "ISBI JSC", ""), Greater, (None, false), |s| s.isbi.as_ref().map(|i| (i.jsc, None))),
    def(("isbi.beta", "ISBI beta", ""), Greater, (Some(Metric::IsbiBeta), false), |s| {
        s.isbi.as_ref().map(|i| (i.beta, i.interval.beta))
    }),
    def(("lpt.correct", "correct", ""), Greater, (Some(Metric::LptCorrect), false), |s| {
        s.lpt.as_ref().map(|l| (l.correct, l.interval.correct))
    }),
    def(("lpt.ghost", "ghosts", ""), Smaller, (Some(Metric::LptGhost), false), |s| {
        s.lpt.as_ref().map(|l| (l.ghost, l.interval.ghost))
    }),
    def(
        ("lpt.velocity_rms_um_s", "velocity RMS", "um/s"),
        Smaller,
        (Some(Metric::VelocityRmsUmS), false),
        |s| s.lpt.as_ref().map(|l| (l.motion.velocity_rms_um_s, l.interval.velocity_rms_um_s)),
    ),
    def(
        ("orientation.mean_all_deg", "mean angle of all", "deg"),
        Smaller,
        (Some(Metric::AngleMeanAllDeg), false),
        |s| s.orientation.as_ref().map(|o| (o.mean_all_deg, o.interval_mean_all_deg)),
    ),
    def(("field.nodes.valid", "valid nodes", ""), Greater, (Some(Metric::ValidNodes), true), |s| {
        s.field.as_ref().map(|f| (f.nodes.valid, f.nodes.interval_valid))
    }),
    def(("field.nodes.rms_px", "RMS at nodes", "px"), Smaller, (Some(Metric::RmsNodesPx), true), |s| {
        s.field.as_ref().map(|f| (f.nodes.rms_px, f.nodes.interval_rms_px))
    }),
    def(
        ("field.nodes.response", "amplitude response", ""),
        NearOne,
        (Some(Metric::ResponseNodes), true),
        |s| s.field.as_ref().map(|f| (f.nodes.response, f.nodes.interval_response)),
    ),
    def(
        ("field.valid_vector_probability", "valid vectors", ""),
        Greater,
        (Some(Metric::ValidVectorProbability), true),
        |s| {
            s.field
                .as_ref()
                .map(|f| (f.main.valid_vector_probability, f.main.interval_valid_vector_probability))
        },
    ),
    def(("", "RMS of inliers", "px"), Smaller, (Some(Metric::RmsInliersPx), false), |s| {
        s.field.as_ref().map(rms_of_inliers)
    }),
    def(
        ("field.modulation_u", "amplitude response of inliers", ""),
        NearOne,
        (Some(Metric::ModulationU), false),
        |s| s.field.as_ref().map(|f| (f.main.modulation_u, None)),
    ),
    def(("field.aee_px", "AEE", "px"), Smaller, (None, true), |s| {
        s.field.as_ref().map(|f| (f.main.aee_px, None))
    }),
];

/// RMS error of displacement of inliers, from those along x and y. Its interval is at least as wide as that of
/// the combined error.
fn rms_of_inliers(field: &FieldScore) -> Measured {
    let errors = &field.main;
    let both = errors.u_inliers.rms_px.zip(errors.v_inliers.rms_px).map(|(u, v)| u.hypot(v));
    let ends = errors.interval_rms_u_inliers_px.zip(errors.interval_rms_v_inliers_px);
    (both, ends.map(|(u, v)| [u[0].hypot(v[0]), u[1].hypot(v[1])]))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_metric_has_a_definition() {
        for metric in Metric::ALL {
            assert_eq!(ScoreDef::of(metric).metric, Some(metric));
        }
    }
}
