//! Comparison of the fits of geometrical and of wave optics.

use serde::Serialize;

use super::derivatives::Derivatives;
use super::images::Problem;
use super::state::{Misfit, Noise, State};
use storage::error::Result;

/// A converged fit.
pub(super) struct Run<'a> {
    pub(super) problem: Problem<'a>,
    pub(super) state: State,
    /// Derivatives of the last step.
    pub(super) derivatives: Option<Derivatives>,
    /// Difference of -2 ln(likelihood) from the other direction of the stage; `None` if that was not tried.
    pub(super) direction_margin: Option<f64>,
    /// Comparison of a fit by waves with one by geometrical optics.
    pub(super) comparison: Option<Comparison>,
}

/// How well a model describes a scan.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Score {
    /// Sum of squared residuals over variance, per pixel.
    pub chi2: f64,
    /// The same with a variance per count of light that is fitted to the residuals, so that errors of the
    /// model count as noise.
    pub chi2_of_fitted_noise: f64,
    /// Fraction of the squared signal above the noise that the model explains.
    pub r2: f64,
    /// Number of fitted quantities.
    pub parameters: usize,
    /// -2 ln(likelihood) + parameters x ln(pixels) (Schwarz 1978); smaller is better.
    pub bic: f64,
}

/// Both models on the windows that neither rejects.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Comparison {
    /// Geometrical optics.
    pub geometric: Score,
    /// Wave optics.
    pub waves: Score,
}

impl Comparison {
    pub(super) fn of(geometric: &Run, waves: &Run) -> Result<Comparison> {
        let both = |k: usize, i: usize| !(geometric.problem.rejected[k][i] || waves.problem.rejected[k][i]);
        let score = |run: &Run| -> Result<Score> {
            let misfits = |noise: Noise| -> Result<_> {
                let mut misfits = run.problem.misfits(&State { noise, ..run.state.clone() }, None)?;
                misfits.retain(|(k, i, _)| both(*k, *i));
                Ok(misfits)
            };
            let noises = run.problem.noises(&run.state)?;
            let misfits_of_fitted_noise = misfits(noises.of_residuals)?;
            let misfits = misfits(noises.pure)?;
            // The variance per count of light is fitted, too.
            let parameters = run.problem.n_parameters() + 1;
            let pixels: usize = misfits.iter().map(|(_, _, m)| m.pixels).sum();
            let likelihood: f64 = misfits.iter().map(|(_, _, m)| m.minus_two_log_likelihood).sum();
            Ok(Score {
                chi2: chi2(&misfits),
                chi2_of_fitted_noise: chi2(&misfits_of_fitted_noise),
                r2: r2(&misfits),
                parameters,
                bic: likelihood + parameters as f64 * libm::log(pixels.max(1) as f64),
            })
        };
        Ok(Comparison { geometric: score(geometric)?, waves: score(waves)? })
    }

    /// Whether waves describe the scan better, taking the number of fitted quantities into account.
    pub fn recommends_waves(&self) -> bool {
        self.waves.bic < self.geometric.bic
    }
}

/// Sum of squared residuals over variance, per pixel.
pub(super) fn chi2(misfits: &[(usize, usize, Misfit)]) -> f64 {
    let (chi2, n) = misfits.iter().fold((0.0, 0), |(c, n), (_, _, m)| (c + m.chi2, n + m.pixels));
    chi2 / (n.max(1) as f64)
}

/// Fraction of the squared signal above the noise that the model explains.
pub(super) fn r2(misfits: &[(usize, usize, Misfit)]) -> f64 {
    let sum = |value: &dyn Fn(&Misfit) -> f64| misfits.iter().map(|(_, _, m)| value(m)).sum::<f64>();
    let signal = sum(&|m| m.signal);
    if signal > 0.0 { 1.0 - sum(&|m| m.unexplained) / signal } else { 0.0 }
}
