use serde::{Deserialize, Serialize};

use scenario::Metric;
use scoring::evaluate::Score;
use scoring::ranking::ScoreDef;

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

impl MetricValue {
    /// Reads one score of an evaluation.
    pub fn of(metric: Metric, score: &Score) -> Self {
        let (value, interval) = ScoreDef::of(metric).measured(score);
        MetricValue { metric, value, low: interval.map(|i| i[0]), high: interval.map(|i| i[1]) }
    }
}
