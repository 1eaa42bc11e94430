//! Comparison of an expected image with the mean of many ray-traced images.

use crate::ensemble::Ensemble;

/// Differences between an expected image and a mean, in units of the tolerance.
#[derive(Debug, Clone, Copy)]
pub struct Agreement {
    /// Relative difference of total counts, in units of 0.1 % plus 4 standard errors.
    pub total: f64,
    /// Largest difference of a pixel, in units of 4 tolerances plus 5 standard errors.
    pub worst: f64,
    /// Root mean square difference beyond the statistical error over all lit pixels, in units of the
    /// tolerance.
    pub rms: f64,
}

impl Agreement {
    /// Compares both; `tolerance` of the expected image, relative to the peak.
    pub fn of(expected: &[f64], rays: &Ensemble, tolerance: f64) -> Agreement {
        let images = f64::from(rays.images);
        let peak = expected.iter().copied().fold(0.0, f64::max);
        let sum = |v: &[f64]| v.iter().sum::<f64>();
        let (ours, theirs) = (sum(expected), sum(&rays.mean));
        let (mut worst, mut squares, mut noise, mut noise_squares, mut lit) = (0.0f64, 0.0, 0.0, 0.0, 0.0);
        for (&a, &b) in expected.iter().zip(&rays.mean) {
            // Counts of a pixel are nearly Poisson distributed (Fano factor 0.84 to 1); without counts the
            // uncertainty is one.
            let variance = (a.max(b) + 1.0 / images) / images;
            worst = worst.max((a - b).abs() / (4.0 * tolerance * peak + 5.0 * variance.sqrt()));
            if a > 0.0 || b > 0.0 {
                squares += (a - b) * (a - b);
                noise += variance;
                noise_squares += 2.0 * variance * variance;
                lit += 1.0;
            }
        }
        // Three standard errors of the sum of squares are allowed on top of its expectation.
        let excess = (squares - noise - 3.0 * f64::sqrt(noise_squares)).max(0.0) / lit;
        Agreement {
            total: (ours - theirs).abs() / (1e-3 * theirs + 4.0 * rays.standard_errors.total),
            worst,
            rms: excess.sqrt() / (tolerance * peak),
        }
    }

    /// Whether all differences are within the tolerance.
    pub fn holds(&self) -> bool {
        self.total <= 1.0 && self.worst <= 1.0 && self.rms <= 1.0
    }
}
