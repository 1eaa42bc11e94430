//! Standard deviations and correlations of the parameters.
//!
//! The covariance is the inverse C of the normal matrix, times chi2 if that exceeds 1, or the sandwich
//! estimator `C (sum of s s^T) C` over the scores s of G groups of windows (White 1982, Econometrica 50, 1),
//! whichever is wider. Groups are particles if there are at least five, otherwise groups of three consecutive
//! planes. The scores of all groups sum to zero at the minimum, so their sum of squares is scaled by G/(G -
//! 1).

use rand::{RngExt, SeedableRng};

use super::normal::Normal;
use microsig_core::linear::Symmetric;

/// Minimum number of particles for which each group is a particle.
const PARTICLES_AS_GROUPS: usize = 5;

/// Number of planes in a group otherwise.
const PLANES_OF_GROUP: usize = 3;

/// Covariance of all parameters of a fit.
#[derive(Debug, Clone)]
pub(super) struct Covariance {
    matrix: Symmetric,
    /// Factor on the standard deviation from `matrix`, for each parameter.
    widening: Vec<f64>,
}

impl Covariance {
    /// `None` if the normal matrix is singular.
    pub(super) fn of(normal: &Normal, particles: usize, chi2: f64) -> Option<Covariance> {
        let inverse = normal.matrix.inverse()?;
        let n = inverse.n();
        let group = |bead: usize, plane: usize| {
            if particles >= PARTICLES_AS_GROUPS { bead } else { plane / PLANES_OF_GROUP }
        };
        let groups = 1 + normal.windows.iter().map(|w| group(w.bead, w.plane)).max()?;
        let mut sums = vec![vec![0.0; n]; groups];
        for window in &normal.windows {
            for (&i, score) in window.entries.iter().zip(&window.right) {
                sums[group(window.bead, window.plane)][i] += score;
            }
        }
        let influence: Vec<Vec<f64>> = sums.iter().map(|score| inverse.times(score)).collect();
        let scale = groups as f64 / (groups as f64 - 1.0).max(1.0);
        let widening = (0..n)
            .map(|i| {
                let own = inverse.at(i, i);
                let sandwich = scale * influence.iter().map(|s| s[i] * s[i]).sum::<f64>();
                libm::sqrt((sandwich / own).max(chi2).max(1.0))
            })
            .collect();
        Some(Covariance { matrix: inverse, widening })
    }

    /// Standard deviation of a linear combination of parameters.
    pub(super) fn sd(&self, combination: &[(usize, f64)]) -> f64 {
        let mut variance = 0.0;
        for &(i, a) in combination {
            for &(j, b) in combination {
                variance += a * b * self.matrix.at(i, j) * self.widening[i] * self.widening[j];
            }
        }
        libm::sqrt(variance.max(0.0))
    }

    /// Correlation of two parameters.
    pub(super) fn correlation(&self, i: usize, j: usize) -> f64 {
        self.matrix.at(i, j) / libm::sqrt(self.matrix.at(i, i) * self.matrix.at(j, j))
    }
}

/// Changes of all parameters for resampled particles, each from one step of Newton's method.
pub(super) fn bootstrap(normal: &Normal, particles: usize, resamples: usize, seed: u64) -> Vec<Vec<f64>> {
    let mut rng = rand::rngs::Xoshiro256PlusPlus::seed_from_u64(seed);
    let n = normal.right.len();
    (0..resamples)
        .filter_map(|_| {
            let mut times = vec![0.0; particles];
            for _ in 0..particles {
                times[rng.random_range(0..particles)] += 1.0;
            }
            let (mut matrix, mut right) = (Symmetric::zeros(n), vec![0.0; n]);
            for window in &normal.windows {
                window.add_to(&mut matrix, &mut right, times[window.bead]);
            }
            // Regularizes the parameters of particles that were not drawn, which then do not change.
            for i in 0..n {
                matrix.add(i, i, 1e-9 * normal.matrix.at(i, i));
            }
            normal.gauge.iter().for_each(|&(i, j, value)| matrix.add(i, j, value));
            matrix.solve(&right)
        })
        .collect()
}
