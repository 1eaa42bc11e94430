//! Peak locking: the bias of displacements toward integer pixels.
//!
//! The degree of peak locking, 1 - min / max over ten bins of the fractional part of u, is above 0 even
//! without peak locking: the count of each bin scatters by sqrt(n / 10), and the expected extremes of ten
//! normal variates lie 1.539 standard deviations from their mean (Harter, Biometrika 48, 1961).

use super::vectors::{ComparedVector, INLIER_PX};
use crate::evaluate::statistics::Errors;

scores! {
    /// Peak locking: bias of displacements toward integer pixels.
    pub struct PeakLocking {
        /// Histogram of the fractional part of u: number of vectors in ten bins.
        pub histogram_u: Vec<usize>,
        /// 1 - min / max of the histogram; null for fewer than 500 vectors.
        fraction degree: Option<f64>,
        /// Expected degree without peak locking, which depends only on the number of vectors.
        fraction degree_unlocked: Option<f64>,
        /// (degree - degree_unlocked) / (1 - degree_unlocked), at least 0.
        fraction degree_corrected: Option<f64>,
        /// Degree of the true u at the same positions: the contribution of the flow itself.
        fraction degree_true: Option<f64>,
        /// Bias of u over inliers as a function of the fractional part of the true u, 20 bins.
        pub bias_curve_px: Vec<Option<f64>>,
        /// Amplitude of peak locking: half the range of the bias curve.
        not_negative amplitude_px: Option<f64>,
    }
}

/// Bins of the fractional part of u.
const BINS: usize = 10;

/// Expected maximum of ten standard normal variates.
const GREATEST_OF_TEN: f64 = 1.538_753;

/// Smallest number of vectors for which a degree is reported: 50 per bin.
const FEWEST: usize = 50 * BINS;

/// Expected degree of `n` vectors whose fractional parts are uniformly distributed.
fn unlocked(n: usize) -> f64 {
    let mean = n as f64 / BINS as f64;
    let reach = GREATEST_OF_TEN * mean.sqrt();
    1.0 - (mean - reach) / (mean + reach)
}

fn bin(u: f64, n: usize) -> usize {
    ((u.rem_euclid(1.0) * n as f64) as usize).min(n - 1)
}

fn degree(histogram: &[usize]) -> f64 {
    let (least, most) = histogram.iter().fold((usize::MAX, 0), |(l, m), &n| (l.min(n), m.max(n)));
    1.0 - least as f64 / most as f64
}

impl PeakLocking {
    /// Peak locking of valid vectors.
    pub fn of(all: &[ComparedVector]) -> Self {
        let (mut histogram_u, mut histogram_true) = (vec![0; BINS], vec![0; BINS]);
        let mut errors = vec![Vec::new(); 20];
        for c in all {
            histogram_u[bin(c.measured.moved[0], BINS)] += 1;
            histogram_true[bin(c.truth[0], BINS)] += 1;
            // A single outlier would dominate a bin.
            if c.endpoint() < INLIER_PX {
                errors[bin(c.truth[0], 20)].push(c.error()[0]);
            }
        }
        let bias_curve_px: Vec<Option<f64>> =
            errors.iter().map(|e| Errors::of(e.iter().copied()).bias).collect();
        let known = || bias_curve_px.iter().flatten().copied();
        let range = known().reduce(f64::max).zip(known().reduce(f64::min));
        let enough = |degree: f64| (all.len() >= FEWEST).then_some(degree);
        let (found, chance) = (degree(&histogram_u), unlocked(all.len()));
        PeakLocking {
            degree: enough(found),
            degree_unlocked: enough(chance),
            degree_corrected: enough(((found - chance) / (1.0 - chance)).max(0.0)),
            degree_true: enough(degree(&histogram_true)),
            amplitude_px: range.map(|(high, low)| (high - low) / 2.0),
            histogram_u,
            bias_curve_px,
        }
    }
}

#[cfg(test)]
mod tests {
    use rand::rngs::Xoshiro256PlusPlus;
    use rand::{Rng, SeedableRng};

    use super::*;
    use crate::results::FlowVector;

    fn vectors(n: usize, seed: u64, locked: f64) -> Vec<ComparedVector> {
        let mut rng = Xoshiro256PlusPlus::seed_from_u64(seed);
        let mut uniform = || (rng.next_u64() >> 11) as f64 / (1u64 << 53) as f64;
        let vector = |u: f64| {
            let found = u - locked * (2.0 * std::f64::consts::PI * u).sin();
            let found = FlowVector { moved: [found, 0.0, f64::NAN], ..FlowVector::default() };
            ComparedVector { measured: found, truth: [u, 0.0, 0.0] }
        };
        (0..n).map(|_| vector(10.0 * uniform())).collect()
    }

    #[test]
    fn unlocked_vectors_have_no_corrected_degree_whatever_their_number() {
        for n in [500, 580, 2000, 20_000] {
            let degrees = |f: fn(&PeakLocking) -> Option<f64>| -> f64 {
                (0..100).map(|seed| f(&PeakLocking::of(&vectors(n, seed, 0.0))).unwrap()).sum::<f64>() / 100.0
            };
            let (mean, expected) = (degrees(|p| p.degree), degrees(|p| p.degree_unlocked));
            // Normal approximation of multinomial counts; the mean of 100 runs has a standard error of 2.5 %.
            assert!((mean / expected - 1.0).abs() < 0.1, "{n}: {mean} {expected}");
            assert!(degrees(|p| p.degree_corrected) < 0.06, "{n}");
        }
        let locked = PeakLocking::of(&vectors(2000, 1, 0.1));
        assert!(locked.degree_corrected.unwrap() > 0.4, "{locked:?}");
        assert!(locked.degree_true.unwrap() < 0.3, "{locked:?}");
    }
}
