//! The scores by which results are ranked: value, interval, and which is better.

use scenario::Metric;

use crate::evaluate::Score;
use crate::evaluate::statistics::Interval;

/// Which values of a score are better.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Better {
    /// Larger values.
    Greater,
    /// Smaller values: an error.
    Smaller,
    /// Values nearer to 1.
    NearOne,
}

/// Which values of a score are better.
pub fn better(metric: Metric) -> Better {
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

/// Value and 95 % interval of a score of an evaluation.
pub fn measured(metric: Metric, score: &Score) -> (Option<f64>, Interval) {
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
