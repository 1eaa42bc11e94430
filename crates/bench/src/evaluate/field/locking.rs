//! Whether displacements prefer whole pixels.

use serde::Serialize;

use super::Compared;
use crate::evaluate::statistics::Errors;

/// Whether displacements prefer whole pixels.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
#[allow(missing_docs)]
pub struct PeakLocking {
    /// Numbers of vectors with the fraction of u in tenths.
    pub histogram_u: Vec<usize>,
    /// 1 - least / greatest number; null for fewer than 50 vectors per tenth on average.
    pub degree: Option<f64>,
    /// Bias of u of inliers over the fraction of the true u, in twentieths, and half its range.
    pub bias_curve_px: Vec<Option<f64>>,
    pub amplitude_px: Option<f64>,
}

impl PeakLocking {
    /// Of vectors beside their truth.
    pub fn of(all: &[Compared]) -> Self {
        let cell = |u: f64, n: usize| ((u.rem_euclid(1.0) * n as f64) as usize).min(n - 1);
        let mut histogram_u = vec![0; 10];
        let mut errors = vec![Vec::new(); 20];
        for c in all {
            histogram_u[cell(c.found.moved[0], 10)] += 1;
            // One outlier would outweigh a class.
            if c.endpoint() < super::INLIER_PX {
                errors[cell(c.exact[0], 20)].push(c.error()[0]);
            }
        }
        let (least, most) = histogram_u.iter().fold((usize::MAX, 0), |(l, m), &n| (l.min(n), m.max(n)));
        let bias_curve_px: Vec<Option<f64>> =
            errors.iter().map(|e| Errors::of(e.iter().copied()).bias).collect();
        let known = || bias_curve_px.iter().flatten().copied();
        let range = known().reduce(f64::max).zip(known().reduce(f64::min));
        PeakLocking {
            degree: (all.len() >= 500).then(|| 1.0 - least as f64 / most as f64),
            amplitude_px: range.map(|(high, low)| (high - low) / 2.0),
            histogram_u,
            bias_curve_px,
        }
    }
}
