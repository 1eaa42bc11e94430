//! The scores that rank suites, with their 95 % intervals.

use serde::{Deserialize, Serialize};

use scenario::Metric;
use scoring::evaluate::Score;
use scoring::ranking::{Better, better, measured};

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

/// Whether the score is an error: 0 is perfect.
pub(super) fn is_error(metric: Metric) -> bool {
    better(metric) == Better::Smaller
}

/// The name of the score in tables.
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
        let (value, interval) = measured(metric, score);
        MetricValue { metric, value, low: interval.map(|i| i[0]), high: interval.map(|i| i[1]) }
    }
}
