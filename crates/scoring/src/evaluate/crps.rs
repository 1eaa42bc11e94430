//! Continuous ranked probability score (CRPS) of positions with claimed uncertainties.
//!
//! A position x with standard uncertainty U is a normal distribution, compared with the true position:
//! with z = e / U for an error e,
//!
//! CRPS = U (z erf(z / sqrt 2) + sqrt(2 / pi) exp(-z² / 2) - 1 / sqrt pi)
//!
//! (Gneiting and Raftery, J. Am. Stat. Assoc. 102, 359, 2007, section 4.2, with the sign of an error). This is
//! a strictly proper scoring rule: the expected score is least for the U that the errors really have, so neither
//! large nor small claims lower it. It has the unit of the error and tends to |e| for U to 0, which is thus the
//! score of a position without a claim. The logarithmic score, also proper, would be decided by the few largest
//! errors in units of U, and has no value without a claim.
//!
//! Missed particles and ghosts count as the gate, and no position counts more. This limit keeps the rule proper
//! for errors within the gate: a score above the gate needs U > 3.8 gates, where it is at least 0.88 gates
//! for any error, while U = 1 gate has at most 0.61.

use std::f64::consts::{FRAC_2_PI, PI, SQRT_2};

use super::detection::error;
use super::matching::Matching;
use super::statistics::{Interval, ratio};
use super::track_set::TrackSet;
use super::units::{Matched, Units};

scores! {
    /// Continuous ranked probability score of positions with claimed uncertainties.
    pub struct Crps {
        /// Number of true particles and ghosts.
        pub n: usize,
        /// Mean over all true particles and ghosts of the score of x and y (their mean). A position without a
        /// claimed uncertainty counts with its error |e|; missed particles, those with a ghost in their gate,
        /// and ghosts count with the gate.
        not_negative xy_px: Option<f64>,
        /// The same for z; null without depth.
        not_negative z_um: Option<f64>,
        /// 95 % interval of xy_px.
        not_negative interval_xy_px: Interval,
        /// 95 % interval of z_um.
        not_negative interval_z_um: Interval,
    }
}

/// The score of an error with claimed standard uncertainty; without a positive one, |error|.
pub fn crps(error: f64, claimed: f64) -> f64 {
    if !(claimed > 0.0 && claimed.is_finite()) {
        return error.abs();
    }
    let z = error / claimed;
    let bell = FRAC_2_PI.sqrt() * (-0.5 * z * z).exp();
    // Not claimed z, which is infinite for tiny claims.
    error * libm::erf(z / SQRT_2) + claimed * (bell - 1.0 / PI.sqrt())
}

impl Crps {
    /// The score of a matched result, and the sums over units of true particles and ghosts, and of their scores of
    /// x and y (px) and of z (um). `sigma` are the claims of the rows
    /// of the result, empty if it has none; `ambiguous` marks the true particles with a ghost within their gate;
    /// `gates`: in x and y, px, and in z, um, `None` without depth.
    pub(super) fn of(
        (truth, result): (&TrackSet, &TrackSet),
        sigma: &[[f64; 3]],
        (matching, ambiguous): (&Matching, &[bool]),
        gates: (f64, Option<f64>),
        units: &Units,
    ) -> (Self, Vec<[f64; 3]>) {
        let unfound = [gates.0, gates.1.unwrap_or(0.0)];
        let sums = units.sums(units.matched(matching).map(|(unit, point)| {
            let [xy, z] = match point {
                Matched::Pair(i, j) if !ambiguous[i] => {
                    let errors = error(truth, result, (i, j));
                    let claims =
                        sigma.get(result.points[j].source as usize).copied().unwrap_or([f64::NAN; 3]);
                    let [x, y, z] = std::array::from_fn(|k| crps(errors[k], claims[k]).min(unfound[k / 2]));
                    [0.5 * (x + y), z]
                }
                _ => unfound,
            };
            (unit, [1.0, xy, z])
        }));
        let means = |s: &[f64; 3]| [ratio(s[1], s[0]), gates.1.and_then(|_| ratio(s[2], s[0]))];
        let total = sums.iter().fold([0.0; 3], |t: [f64; 3], u| std::array::from_fn(|k| t[k] + u[k]));
        let [interval_xy_px, interval_z_um] = units.intervals(&sums, means);
        let [xy_px, z_um] = means(&total);
        (Crps { n: total[0] as usize, xy_px, z_um, interval_xy_px, interval_z_um }, sums)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Mean score of normal errors of standard deviation 1, at quantiles, for a claim.
    fn expected(claimed: f64) -> f64 {
        // Trapezoidal rule over 12 standard deviations: its error is far below 1e-9 for a smooth integrand.
        let (n, width) = (4000, 24.0);
        let step = width / f64::from(n);
        let density = |e: f64| (-0.5 * e * e).exp() / (2.0 * PI).sqrt();
        (0..=n).map(|i| f64::from(i) * step - 0.5 * width).map(|e| step * density(e) * crps(e, claimed)).sum()
    }

    #[test]
    fn the_score_is_the_integral_that_defines_it() {
        // CRPS = integral of (F(x) - [x >= e])²; the step at e splits it.
        let (error, claimed) = (0.7, 0.4);
        let f = |x: f64| 0.5 * (1.0 + libm::erf(x / claimed / SQRT_2));
        let n = 100_000;
        let integral = |from: f64, to: f64, of: &dyn Fn(f64) -> f64| {
            let step = (to - from) / f64::from(n);
            (0..n).map(|i| of(from + (f64::from(i) + 0.5) * step)).sum::<f64>() * step
        };
        let exact =
            integral(-5.0, error, &|x| f(x).powi(2)) + integral(error, 5.0, &|x| (1.0 - f(x)).powi(2));
        assert!((crps(error, claimed) - exact).abs() < 1e-8);
        assert_eq!([crps(-0.7, 0.0), crps(0.7, f64::NAN), crps(0.7, f64::INFINITY)], [0.7; 3]);
        assert!((crps(0.7, 1e-9) - 0.7).abs() < 1e-8);
        assert_eq!([crps(0.7, 5e-324), crps(-0.7, 5e-324), crps(0.0, 5e-324)], [0.7, 0.7, 0.0]);
    }

    #[test]
    fn the_true_uncertainty_scores_best() {
        // E|X - Y| - E|X - X'| / 2 for normal X and Y of standard deviations k and 1.
        let exact = |k: f64| (FRAC_2_PI * (1.0 + k * k)).sqrt() - k / PI.sqrt();
        for k in [0.01, 1.0 / 3.0, 0.9, 1.0, 1.1, 3.0, 30.0] {
            assert!((expected(k) - exact(k)).abs() < 1e-6, "{k}");
            assert!(expected(k) >= expected(1.0), "{k}");
        }
        assert!(expected(3.0) > 1.4 * expected(1.0) && expected(1.0 / 3.0) > 1.1 * expected(1.0));
    }

    #[test]
    fn the_limit_rewards_no_claim() {
        // A gate of 1: claims whose score can exceed it are worse than U = 1 for every error within it.
        let errors = || (0..=100).map(|i| f64::from(i) / 100.0);
        let largest = |claimed: f64| errors().map(|e| crps(e, claimed)).fold(0.0, f64::max);
        let least = |claimed: f64| errors().map(|e| crps(e, claimed)).fold(f64::MAX, f64::min);
        assert!(largest(3.7) < 1.0 && largest(3.9) > 1.0);
        assert!(largest(1.0) < 0.61 && [3.8, 5.0, 100.0].iter().all(|u| least(*u) > 0.88));
    }
}
