//! The scores by which suites rank, with their 95 % intervals.

use serde::{Deserialize, Serialize};

use crate::report::Criterion;
use scenario::Metric;
use scoring::evaluate::Score;
use scoring::evaluate::statistics::Interval;

/// A score and its interval.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct MetricValue {
    /// Which score.
    pub metric: Metric,
    /// Its value; null if it is undefined.
    pub value: Option<f64>,
    /// Lower end of the 95 % interval.
    pub low: Option<f64>,
    /// Upper end of the 95 % interval.
    pub high: Option<f64>,
}

/// Which values of a score are better.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Better {
    Greater,
    Smaller,
    NearOne,
}

fn better(metric: Metric) -> Better {
    match metric {
        Metric::F1
        | Metric::Recall
        | Metric::Precision
        | Metric::LinkF1
        | Metric::Hota
        | Metric::IsbiBeta
        | Metric::LptCorrect
        | Metric::ValidVectorProbability
        | Metric::ValidNodes => Better::Greater,
        Metric::RmseXyPx
        | Metric::SigmaZOverH
        | Metric::LptGhost
        | Metric::VelocityRmsUmS
        | Metric::AngleMeanAllDeg
        | Metric::RmsInliersPx
        | Metric::RmsNodesPx => Better::Smaller,
        Metric::ModulationU | Metric::ResponseNodes => Better::NearOne,
    }
}

/// Whether the score is an error: 0 is perfect.
pub(super) fn is_error(metric: Metric) -> bool {
    better(metric) == Better::Smaller
}

/// Whether particles in frames, or nodes in image pairs, that a result leaves out count against it in this
/// score.
pub(super) fn counts_missing(metric: Metric) -> bool {
    match metric {
        Metric::Precision | Metric::ValidVectorProbability => false,
        Metric::RmsNodesPx | Metric::ResponseNodes => true,
        _ => better(metric) == Better::Greater,
    }
}

/// The score as tables name it.
pub fn label(metric: Metric) -> &'static str {
    match metric {
        Metric::F1 => "F1",
        Metric::Recall => "recall",
        Metric::Precision => "precision",
        Metric::RmseXyPx => "RMSE xy, px",
        Metric::SigmaZOverH => "sigma z / h",
        Metric::LinkF1 => "link F1",
        Metric::Hota => "HOTA",
        Metric::IsbiBeta => "ISBI beta",
        Metric::LptCorrect => "correct",
        Metric::LptGhost => "ghosts",
        Metric::VelocityRmsUmS => "velocity RMS, um/s",
        Metric::AngleMeanAllDeg => "mean angle of all, deg",
        Metric::ValidVectorProbability => "valid vectors",
        Metric::RmsInliersPx => "RMS of inliers, px",
        Metric::ModulationU => "amplitude response of inliers",
        Metric::ValidNodes => "valid nodes",
        Metric::RmsNodesPx => "RMS at nodes, px",
        Metric::ResponseNodes => "amplitude response",
    }
}

impl MetricValue {
    /// Reads a score from those of an evaluation.
    pub fn of(metric: Metric, score: &Score) -> Self {
        let (value, interval) = found(metric, score);
        MetricValue { metric, value, low: interval.map(|i| i[0]), high: interval.map(|i| i[1]) }
    }

    /// It as a criterion of a ranking.
    pub(super) fn criterion(&self) -> Criterion {
        let interval = self.low.zip(self.high).map(|(low, high)| [low, high]);
        match better(self.metric) {
            Better::Greater => Criterion::rate(self.value, interval),
            Better::Smaller => Criterion::error(self.value, interval),
            Better::NearOne => Criterion::error(self.value.map(|v| (v - 1.0).abs()), None),
        }
    }
}

fn found(metric: Metric, score: &Score) -> (Option<f64>, Interval) {
    let detection = score.detection.as_ref();
    let of = |value: Option<(Option<f64>, Interval)>| value.unwrap_or_default();
    match metric {
        Metric::F1 => of(detection.map(|d| (d.f1, d.interval.f1))),
        Metric::Recall => of(detection.map(|d| (d.recall, d.interval.recall))),
        Metric::Precision => of(detection.map(|d| (d.precision, d.interval.precision))),
        Metric::RmseXyPx => of(detection.map(|d| (d.rmse_xy_px, d.interval.rmse_xy_px))),
        Metric::SigmaZOverH => of(score.gdpt.as_ref().map(|g| (g.sigma_z_over_h, g.interval.sigma_z_over_h))),
        Metric::LinkF1 => of(score.links.as_ref().map(|l| (l.f1, l.interval_f1))),
        Metric::Hota => of(score.hota.as_ref().map(|h| (h.hota, h.interval_hota))),
        Metric::IsbiBeta => of(score.isbi.as_ref().map(|i| (i.beta, i.interval.beta))),
        Metric::LptCorrect => of(score.lpt.as_ref().map(|l| (l.correct, l.interval.correct))),
        Metric::LptGhost => of(score.lpt.as_ref().map(|l| (l.ghost, l.interval.ghost))),
        Metric::VelocityRmsUmS => {
            of(score.lpt.as_ref().map(|l| (l.motion.velocity_rms_um_s, l.interval.velocity_rms_um_s)))
        }
        Metric::AngleMeanAllDeg => {
            of(score.orientation.as_ref().map(|o| (o.mean_all_deg, o.interval_mean_all_deg)))
        }
        Metric::ValidVectorProbability => of(score
            .field
            .as_ref()
            .map(|f| (f.main.valid_vector_probability, f.main.interval_valid_vector_probability))),
        Metric::RmsInliersPx => of(score.field.as_ref().map(|f| {
            let errors = &f.main;
            let both = errors.u_inliers.rms_px.zip(errors.v_inliers.rms_px).map(|(u, v)| u.hypot(v));
            // At least as wide as the interval of the combined error.
            let ends = errors.interval_rms_u_inliers_px.zip(errors.interval_rms_v_inliers_px);
            (both, ends.map(|(u, v)| [u[0].hypot(v[0]), u[1].hypot(v[1])]))
        })),
        Metric::ModulationU => of(score.field.as_ref().map(|f| (f.main.modulation_u, None))),
        Metric::ValidNodes => of(score.field.as_ref().map(|f| (f.nodes.valid, f.nodes.interval_valid))),
        Metric::RmsNodesPx => of(score.field.as_ref().map(|f| (f.nodes.rms_px, f.nodes.interval_rms_px))),
        Metric::ResponseNodes => {
            of(score.field.as_ref().map(|f| (f.nodes.response, f.nodes.interval_response)))
        }
    }
}
