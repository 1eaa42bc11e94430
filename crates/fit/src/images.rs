//! The image fit: fits expected images to all windows of all planes, by Levenberg-Marquardt.
//!
//! For particle k in plane i at stage position s
//! ```text
//! z = direction s / depth_factor + z_k        x = x_k + d_x (s - mean s), y alike
//! mean count = b_k + A_i P_k E(x, y, z)       variance = noise^2 + g max(mean - b_k, 0)
//! ```
//! with E the fraction of the light emitted toward the lens that falls on a pixel. Microscope and drift are
//! common to all particles, the brightness A_i (mean 1) to all particles in a plane. Weights come from the
//! previous step; the loss is linear for residuals beyond five standard deviations (Huber).

use rayon::prelude::*;

use super::background::Background;
use super::imager::Imager;
use super::optics::{Microscope, Shared};
use super::particles::Windows;
use super::scan::Scan;
use super::state::{Count, Misfit, State, huber};
use storage::error::Result;

/// Receives short descriptions of what a fit is doing, and the share of the work that is done, if it is known.
pub type Watch<'a> = &'a (dyn Fn(&str, Option<f64>) + Sync);

/// Accuracy of images and of their derivatives.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Accuracy {
    /// Error of images, as a fraction of their peaks.
    pub(super) tolerance: f64,
    /// Error of the images of which differences are taken.
    pub(super) of_sides: f64,
    /// Whether differences are central; otherwise only the upper image is new.
    pub(super) central: bool,
    /// Steps of differences, relative to [`Shared::step`].
    pub(super) steps: f64,
}

/// The data of a fit and its free parameters.
pub(super) struct Problem<'a> {
    pub(super) scan: &'a Scan,
    pub(super) background: Background,
    pub(super) windows: &'a Windows,
    /// Fitted quantities that are common to all particles.
    pub(super) shared: Vec<Shared>,
    /// Whether the brightness of each plane is fitted.
    pub(super) free_flux: bool,
    /// Whether a window is rejected, by particle and plane.
    pub(super) rejected: Vec<Vec<bool>>,
    pub(super) accuracy: Accuracy,
    /// Current stage of the fit, and the receiver of progress messages.
    pub(super) stage: String,
    pub(super) watch: Watch<'a>,
    /// The fit has converged when the predicted decrease of chi2, summed over all pixels, is less than this.
    pub(super) converged: f64,
}

impl Problem<'_> {
    /// Whether quantities are free for which others can nearly compensate.
    pub(super) fn is_nearly_degenerate(&self) -> bool {
        let extra = [Shared::RiLens, Shared::PixelSize, Shared::DepthFactor];
        self.shared.iter().any(|shared| extra.contains(shared))
    }

    pub(super) fn n_beads(&self) -> usize {
        self.windows.particles.len()
    }

    /// Number of parameters: shared ones, two of drift, five for each particle, brightness of planes.
    pub(super) fn n_parameters(&self) -> usize {
        self.shared.len() + 2 + 5 * self.n_beads() + if self.free_flux { self.scan.planes.len() } else { 0 }
    }

    pub(super) fn bead_parameter(&self, bead: usize) -> usize {
        self.shared.len() + 2 + 5 * bead
    }

    pub(super) fn flux_parameter(&self, plane: usize) -> usize {
        self.shared.len() + 2 + 5 * self.n_beads() + plane
    }

    pub(super) fn depth(&self, state: &State, microscope: &Microscope, bead: usize, plane: usize) -> f64 {
        state.direction * self.scan.stage_um[plane] / microscope.depth_factor + state.beads[bead].z_um
    }

    pub(super) fn position(&self, state: &State, bead: usize, plane: usize) -> [f64; 2] {
        let s = self.scan.stage_um[plane] - self.scan.mean_stage_um();
        [state.beads[bead].x + state.drift[0] * s, state.beads[bead].y + state.drift[1] * s]
    }

    pub(super) fn edge_px(&self) -> usize {
        2 * self.windows.half + 1
    }

    pub(super) fn renderer(&self, state: &State) -> Result<Imager> {
        self.imager(&state.microscope, self.accuracy.tolerance)
    }

    /// The images of a microscope.
    pub(super) fn imager(&self, microscope: &Microscope, tolerance: f64) -> Result<Imager> {
        Imager::new(microscope, tolerance, self.edge_px())
    }

    /// Particles and planes whose windows are used.
    pub(super) fn used(&self) -> impl Iterator<Item = (usize, usize)> + '_ {
        (0..self.n_beads())
            .flat_map(|k| (0..self.scan.planes.len()).map(move |i| (k, i)))
            .filter(|&(k, i)| !self.rejected[k][i])
    }

    /// Positions of the pixels of a window relative to the particle, px.
    pub(super) fn places(&self, state: &State, k: usize, i: usize) -> Vec<[f64; 2]> {
        let [x, y] = self.position(state, k, i);
        self.windows.particles[k].pixels.iter().map(|&(_, [px, py])| [px - x, py - y]).collect()
    }

    /// Fractions of the light on the pixels of a window.
    pub(super) fn values(
        &self,
        imager: &Imager,
        state: &State,
        microscope: &Microscope,
        k: usize,
        i: usize,
    ) -> Vec<f64> {
        imager.values(microscope, self.depth(state, microscope, k, i), &self.places(state, k, i))
    }

    /// The count of a pixel on which this fraction of the light falls.
    pub(super) fn count(&self, state: &State, k: usize, i: usize, share: f64) -> Count {
        let light = state.flux[i] * state.beads[k].light * share;
        Count::of(state.beads[k].background + light, state.noise.variance(light))
    }

    /// Misfit of each window, by particle and plane. The loss has the given variances of pixels, or the
    /// state's own.
    pub(super) fn misfits(
        &self,
        state: &State,
        variances: Option<&[Vec<f32>]>,
    ) -> Result<Vec<(usize, usize, Misfit)>> {
        let renderer = self.renderer(state)?;
        let windows: Vec<(usize, usize)> = self.used().collect();
        Ok(windows
            .into_par_iter()
            .enumerate()
            .map(|(window, (k, i))| {
                let values = self.values(&renderer, state, &state.microscope, k, i);
                let mut misfit = Misfit { pixels: values.len(), ..Misfit::default() };
                let own = &self.windows.particles[k];
                let mut seen = Vec::with_capacity(values.len());
                for (n, (&(at, _), &value)) in own.pixels.iter().zip(&values).enumerate() {
                    let Count { mean, variance, .. } = self.count(state, k, i, value);
                    let weighed = variances.map_or(variance, |given| f64::from(given[window][n]));
                    let data = f64::from(self.scan.planes[i][at]);
                    let r = data - mean;
                    misfit.loss += huber(r / libm::sqrt(weighed));
                    misfit.chi2 += r * r / variance;
                    misfit.minus_two_log_likelihood += huber(r / libm::sqrt(variance)) + libm::log(variance);
                    seen.push((r, data - state.beads[k].background));
                }
                for &(a, b) in &own.neighbors {
                    misfit.unexplained += seen[a].0 * seen[b].0;
                    misfit.signal += seen[a].1 * seen[b].1;
                }
                (k, i, misfit)
            })
            .collect())
    }

    /// -2 ln(likelihood) of all used windows.
    pub(super) fn likelihood(&self, state: &State) -> Result<f64> {
        Ok(self.misfits(state, None)?.iter().map(|(_, _, m)| m.minus_two_log_likelihood).sum())
    }

    /// Fits brightness and background of each particle by linear regression, with everything else fixed.
    pub(super) fn with_light(&self, mut state: State) -> Result<State> {
        let renderer = self.renderer(&state)?;
        for k in 0..self.n_beads() {
            let mut sums = [0.0; 5];
            for i in (0..self.scan.planes.len()).filter(|&i| !self.rejected[k][i]) {
                let values = self.values(&renderer, &state, &state.microscope, k, i);
                for (&(at, _), &value) in self.windows.particles[k].pixels.iter().zip(&values) {
                    let data = f64::from(self.scan.planes[i][at]) - self.background.mean;
                    let value = state.flux[i] * value;
                    [1.0, value, value * value, data, data * value]
                        .iter()
                        .zip(&mut sums)
                        .for_each(|(v, s)| *s += v);
                }
            }
            let [n, e, ee, d, de] = sums;
            let slope = (n * de - e * d) / (n * ee - e * e);
            let slope = if slope.is_finite() && slope > 0.0 { slope } else { d.max(1.0) / e.max(1e-12) };
            state.beads[k].light = slope;
            state.beads[k].background = self.background.mean + (d - slope * e) / n;
        }
        Ok(state)
    }

    /// Calls `visit` for each plane in order, with the pixels of all windows: index in the plane, mean count,
    /// residual in standard deviations.
    pub(super) fn each_plane(
        &self,
        state: &State,
        mut visit: impl FnMut(Vec<(usize, f64, f64)>) -> Result<()>,
    ) -> Result<()> {
        let renderer = self.renderer(state)?;
        for (i, plane) in self.scan.planes.iter().enumerate() {
            let mut pixels = Vec::new();
            for (k, window) in self.windows.particles.iter().enumerate() {
                let values = self.values(&renderer, state, &state.microscope, k, i);
                for (&(at, _), &value) in window.pixels.iter().zip(&values) {
                    let Count { mean, variance, .. } = self.count(state, k, i, value);
                    pixels.push((at, mean, (f64::from(plane[at]) - mean) / libm::sqrt(variance)));
                }
            }
            visit(pixels)?;
        }
        Ok(())
    }
}
