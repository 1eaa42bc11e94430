//! The image fit: fits expected images to all windows of all planes, by Levenberg-Marquardt.
//!
//! For particle k in plane i at stage position s
//! ```text
//! z = direction s / depth_factor + z_k        x = x_k + d_x (s - mean s), y alike
//! mean count = b_k + A_i P_k E(x, y, z)       variance = noise^2 + 1/12 + g max(mean - b_k, 0)
//! ```
//! with E the fraction of the light emitted toward the lens that falls on a pixel. Microscope and drift are
//! common to all particles, the brightness A_i (mean 1) to all particles in a plane. Weights are those of the
//! previous step; the loss is linear for residuals beyond five standard deviations (Huber).

use rayon::prelude::*;

use microsig_core::Particle;
use microsig_core::emission::SpheroidLaw;
use microsig_core::render::expected::ExpectedRenderer;

use super::background::Background;
use super::linear::Symmetric;
use super::optics::{Microscope, Shared};
use super::particles::Windows;
use super::scan::Scan;
use super::state::{HUBER, Misfit, State, huber};
use storage::error::Result;

/// Variance of rounding to whole counts.
const ROUNDING: f64 = 1.0 / 12.0;

/// The fit has converged when the predicted decrease of chi2, summed over all pixels, is less than this.
const CONVERGED: f64 = 0.1;

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
    /// Tolerance of expected images, as a fraction of their peaks.
    pub(super) tolerance: f64,
}

/// The normal equations at a state.
pub(super) struct Normal {
    pub(super) matrix: Symmetric,
    pub(super) right: Vec<f64>,
    pub(super) windows: Vec<WindowNormal>,
    /// Entries of the matrix that constrain the mean brightness of planes to 1.
    pub(super) gauge: Vec<(usize, usize, f64)>,
    pub(super) loss: f64,
}

/// Contribution of one window to the normal equations.
pub(super) struct WindowNormal {
    pub(super) bead: usize,
    pub(super) plane: usize,
    /// Parameters that the window depends on.
    pub(super) entries: Vec<usize>,
    matrix: Vec<f64>,
    /// Negative gradient of half the loss.
    pub(super) right: Vec<f64>,
    loss: f64,
}

impl WindowNormal {
    /// Adds the window `times` times.
    pub(super) fn add_to(&self, matrix: &mut Symmetric, right: &mut [f64], times: f64) {
        for (a, &i) in self.entries.iter().enumerate() {
            for (b, &j) in self.entries.iter().enumerate() {
                matrix.add(i, j, times * self.matrix[a * self.entries.len() + b]);
            }
            right[i] += times * self.right[a];
        }
    }
}

/// The renderers of a step: that of the state and, for each shared quantity with a numerical derivative, one
/// on either side.
struct Renderers {
    own: ExpectedRenderer,
    sides: Vec<Option<Sides>>,
}

/// A shared quantity one step below and above its value.
struct Sides {
    microscopes: [Microscope; 2],
    renderers: [ExpectedRenderer; 2],
    step: f64,
}

impl Problem<'_> {
    fn n_beads(&self) -> usize {
        self.windows.particles.len()
    }

    /// Number of parameters: shared ones, two of drift, five for each particle, brightness of planes.
    pub(super) fn n_parameters(&self) -> usize {
        self.shared.len() + 2 + 5 * self.n_beads() + if self.free_flux { self.scan.planes.len() } else { 0 }
    }

    pub(super) fn bead_parameter(&self, bead: usize) -> usize {
        self.shared.len() + 2 + 5 * bead
    }

    fn flux_parameter(&self, plane: usize) -> usize {
        self.shared.len() + 2 + 5 * self.n_beads() + plane
    }

    fn depth(&self, state: &State, microscope: &Microscope, bead: usize, plane: usize) -> f64 {
        state.direction * self.scan.stage_um[plane] / microscope.depth_factor + state.beads[bead].z_um
    }

    fn position(&self, state: &State, bead: usize, plane: usize) -> [f64; 2] {
        let s = self.scan.stage_um[plane] - self.scan.mean_stage_um();
        [state.beads[bead].x + state.drift[0] * s, state.beads[bead].y + state.drift[1] * s]
    }

    fn renderer(&self, microscope: &Microscope) -> Result<ExpectedRenderer> {
        let settings = microscope.settings(2 * self.windows.half + 1);
        Ok(ExpectedRenderer::new(&settings, SpheroidLaw::Original, self.tolerance)?)
    }

    /// Computes the renderer's tables for all windows.
    fn prepare(&self, renderer: &ExpectedRenderer, state: &State, microscope: &Microscope) {
        let spheres: Vec<Particle> = self
            .used()
            .map(|(k, i)| {
                Particle::sphere(1.0, 1.0, self.depth(state, microscope, k, i), microscope.diameter_um)
            })
            .collect();
        renderer.prepare(&spheres);
    }

    /// Particles and planes whose windows are used.
    fn used(&self) -> impl Iterator<Item = (usize, usize)> + '_ {
        (0..self.n_beads())
            .flat_map(|k| (0..self.scan.planes.len()).map(move |i| (k, i)))
            .filter(|&(k, i)| !self.rejected[k][i])
    }

    /// Fractions of light on the pixels of a window, with their derivatives with respect to x, y (1/px), z
    /// (1/um) and the angle (1/rad).
    fn shares(
        &self,
        renderer: &ExpectedRenderer,
        state: &State,
        microscope: &Microscope,
        k: usize,
        i: usize,
    ) -> Vec<[f64; 5]> {
        let [x, y] = self.position(state, k, i);
        let z_um = self.depth(state, microscope, k, i);
        let (c, s) = (libm::cos(microscope.angle), libm::sin(microscope.angle));
        let places: Vec<[f64; 2]> = self.windows.particles[k]
            .pixels
            .iter()
            .map(|&(_, [px, py])| {
                let (dx, dy) = (px - x, py - y);
                [c * dx + s * dy, c * dy - s * dx]
            })
            .collect();
        renderer
            .shares(z_um, microscope.diameter_um, &places)
            .into_iter()
            .zip(&places)
            .map(|([value, by_u, by_v, by_z], [u, v])| {
                // A displacement of the particle moves the pixel relative to it in the opposite direction.
                [value, -(c * by_u - s * by_v), -(s * by_u + c * by_v), by_z, by_u * v - by_v * u]
            })
            .collect()
    }

    /// Mean count, its derivative with respect to the fraction of light, and the variance (counts^2).
    fn count(&self, state: &State, k: usize, i: usize, share: f64) -> (f64, f64, f64) {
        let factor = state.flux[i] * state.beads[k].light;
        let light = factor * share;
        let noise2 = self.background.noise * self.background.noise + ROUNDING;
        (state.beads[k].background + light, factor, noise2 + state.variance_per_count * light.max(0.0))
    }

    /// Misfit of each window, by particle and plane; weights are those of the state `weights`, or the state's
    /// own.
    pub(super) fn misfits(
        &self,
        state: &State,
        weights: Option<&State>,
    ) -> Result<Vec<(usize, usize, Misfit)>> {
        let renderer = self.renderer(&state.microscope)?;
        self.prepare(&renderer, state, &state.microscope);
        let of_weights = match weights {
            Some(other) => {
                let renderer = self.renderer(&other.microscope)?;
                self.prepare(&renderer, other, &other.microscope);
                Some((renderer, other))
            }
            None => None,
        };
        let windows: Vec<(usize, usize)> = self.used().collect();
        Ok(windows
            .into_par_iter()
            .map(|(k, i)| {
                let shares = self.shares(&renderer, state, &state.microscope, k, i);
                let weighing = of_weights
                    .as_ref()
                    .map(|(renderer, other)| (self.shares(renderer, other, &other.microscope, k, i), *other));
                let mut misfit = Misfit { pixels: shares.len(), ..Misfit::default() };
                for (n, (&(at, _), share)) in self.windows.particles[k].pixels.iter().zip(&shares).enumerate()
                {
                    let (mean, _, variance) = self.count(state, k, i, share[0]);
                    let weighed = weighing
                        .as_ref()
                        .map_or(variance, |(shares, other)| self.count(other, k, i, shares[n][0]).2);
                    let data = f64::from(self.scan.planes[i][at]);
                    let r = data - mean;
                    misfit.loss += huber(r / libm::sqrt(weighed));
                    misfit.chi2 += r * r / variance;
                    misfit.minus_two_log_likelihood += huber(r / libm::sqrt(variance)) + libm::log(variance);
                    misfit.residual2 += r * r;
                    misfit.noise2 += variance;
                    let signal = data - state.beads[k].background;
                    misfit.signal2 += signal * signal;
                }
                (k, i, misfit)
            })
            .collect())
    }

    /// The normal equations at a state, with the state's own weights.
    pub(super) fn normal(&self, state: &State) -> Result<Normal> {
        let own = self.renderer(&state.microscope)?;
        self.prepare(&own, state, &state.microscope);
        let mut sides = Vec::new();
        for shared in &self.shared {
            let Some(step) = shared.step(&state.microscope) else {
                sides.push(None);
                continue;
            };
            let microscopes = [-step, step].map(|by| shared.moved(state.microscope, by));
            let [low, high] = [self.renderer(&microscopes[0])?, self.renderer(&microscopes[1])?];
            self.prepare(&low, state, &microscopes[0]);
            self.prepare(&high, state, &microscopes[1]);
            sides.push(Some(Sides { microscopes, renderers: [low, high], step }));
        }
        let renderers = Renderers { own, sides };
        let windows: Vec<(usize, usize)> = self.used().collect();
        let windows: Vec<WindowNormal> =
            windows.into_par_iter().map(|(k, i)| self.window_normal(state, &renderers, k, i)).collect();
        let n = self.n_parameters();
        let (mut matrix, mut right) = (Symmetric::zeros(n), vec![0.0; n]);
        // Added in the order of windows, so that sums do not depend on the number of threads.
        windows.iter().for_each(|window| window.add_to(&mut matrix, &mut right, 1.0));
        let loss = windows.iter().map(|window| window.loss).sum();
        let mut gauge = Vec::new();
        if self.free_flux {
            // Constrains the mean brightness of planes to 1, as a common factor of planes and particles is
            // undetermined.
            let scale = matrix.at(self.flux_parameter(0), self.flux_parameter(0)).max(1.0);
            let planes = self.scan.planes.len();
            let off = state.flux.iter().sum::<f64>() - planes as f64;
            for i in 0..planes {
                gauge.extend((0..planes).map(|j| (self.flux_parameter(i), self.flux_parameter(j), scale)));
                right[self.flux_parameter(i)] -= scale * off;
            }
            gauge.iter().for_each(|&(i, j, value)| matrix.add(i, j, value));
        }
        Ok(Normal { matrix, right, windows, gauge, loss })
    }

    fn window_normal(&self, state: &State, renderers: &Renderers, k: usize, i: usize) -> WindowNormal {
        let shares = self.shares(&renderers.own, state, &state.microscope, k, i);
        let derivatives: Vec<Option<Vec<f64>>> = renderers
            .sides
            .iter()
            .map(|side| {
                side.as_ref().map(|Sides { renderers: [low, high], microscopes, step }| {
                    let low = self.shares(low, state, &microscopes[0], k, i);
                    let high = self.shares(high, state, &microscopes[1], k, i);
                    low.iter().zip(&high).map(|(l, h)| (h[0] - l[0]) / (2.0 * step)).collect()
                })
            })
            .collect();
        let s = self.scan.stage_um[i];
        let from_mean = s - self.scan.mean_stage_um();
        let n_shared = self.shared.len();
        let bead = self.bead_parameter(k);
        let mut entries: Vec<usize> = (0..n_shared + 2).chain(bead..bead + 5).collect();
        if self.free_flux {
            entries.push(self.flux_parameter(i));
        }
        let n = entries.len();
        let (matrix, right) = (vec![0.0; n * n], vec![0.0; n]);
        let mut part = WindowNormal { bead: k, plane: i, entries, matrix, right, loss: 0.0 };
        let mut row = vec![0.0; n];
        for (pixel, (&(at, _), share)) in self.windows.particles[k].pixels.iter().zip(&shares).enumerate() {
            let [value, by_x, by_y, by_z, by_angle] = *share;
            let (mean, factor, variance) = self.count(state, k, i, value);
            for (entry, (shared, derivative)) in row.iter_mut().zip(self.shared.iter().zip(&derivatives)) {
                *entry = factor
                    * match (shared, derivative) {
                        (_, Some(values)) => values[pixel],
                        (Shared::Angle, None) => by_angle,
                        (_, None) => -by_z * state.direction * s / state.microscope.depth_factor,
                    };
            }
            row[n_shared] = factor * by_x * from_mean;
            row[n_shared + 1] = factor * by_y * from_mean;
            row[n_shared + 2] = factor * by_x;
            row[n_shared + 3] = factor * by_y;
            row[n_shared + 4] = factor * by_z;
            row[n_shared + 5] = state.flux[i] * value;
            row[n_shared + 6] = 1.0;
            if self.free_flux {
                row[n_shared + 7] = state.beads[k].light * value;
            }
            let r = f64::from(self.scan.planes[i][at]) - mean;
            let size = r.abs() / libm::sqrt(variance);
            let weight = if size > HUBER { HUBER / size } else { 1.0 } / variance;
            part.loss += huber(size);
            for a in 0..n {
                let weighed = weight * row[a];
                part.right[a] += weighed * r;
                for (slot, other) in part.matrix[a * n..].iter_mut().zip(&row[..=a]) {
                    *slot += weighed * other;
                }
            }
        }
        for a in 0..n {
            for b in 0..a {
                part.matrix[b * n + a] = part.matrix[a * n + b];
            }
        }
        part
    }

    /// The state moved by a step of the parameters.
    pub(super) fn moved(&self, state: &State, step: &[f64]) -> State {
        let mut to = state.clone();
        for (shared, &by) in self.shared.iter().zip(step) {
            let longest = shared.longest(&state.microscope);
            to.microscope = shared.moved(to.microscope, by.clamp(-longest, longest));
        }
        to.microscope = to.microscope.bounded();
        let n = self.shared.len();
        to.drift = [state.drift[0] + step[n], state.drift[1] + step[n + 1]];
        for (k, bead) in to.beads.iter_mut().enumerate() {
            let step = &step[self.bead_parameter(k)..];
            bead.x += step[0].clamp(-2.0, 2.0);
            bead.y += step[1].clamp(-2.0, 2.0);
            bead.z_um += step[2].clamp(-20.0, 20.0);
            bead.light = (bead.light + step[3]).max(0.1 * bead.light);
            bead.background += step[4];
        }
        if self.free_flux {
            for (i, flux) in to.flux.iter_mut().enumerate() {
                *flux = (*flux + step[self.flux_parameter(i)]).max(0.1 * *flux);
            }
        }
        to
    }

    /// Fits brightness and background of each particle by linear regression, with everything else fixed.
    pub(super) fn with_light(&self, mut state: State) -> Result<State> {
        let renderer = self.renderer(&state.microscope)?;
        self.prepare(&renderer, &state, &state.microscope);
        for k in 0..self.n_beads() {
            let mut sums = [0.0; 5];
            for i in (0..self.scan.planes.len()).filter(|&i| !self.rejected[k][i]) {
                let shares = self.shares(&renderer, &state, &state.microscope, k, i);
                for (&(at, _), share) in self.windows.particles[k].pixels.iter().zip(&shares) {
                    let data = f64::from(self.scan.planes[i][at]) - self.background.mean;
                    let value = state.flux[i] * share[0];
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

    /// Variance per count of light (counts), from the squared residuals of the brighter half of the lit
    /// pixels.
    pub(super) fn variance_per_count(&self, state: &State) -> Result<f64> {
        let renderer = self.renderer(&state.microscope)?;
        self.prepare(&renderer, state, &state.microscope);
        let windows: Vec<(usize, usize)> = self.used().collect();
        let pixels: Vec<Vec<(f64, f64)>> = windows
            .into_par_iter()
            .map(|(k, i)| {
                let shares = self.shares(&renderer, state, &state.microscope, k, i);
                let pixels = self.windows.particles[k].pixels.iter().zip(shares);
                pixels
                    .map(|(&(at, _), share)| {
                        let (mean, _, _) = self.count(state, k, i, share[0]);
                        (mean - state.beads[k].background, f64::from(self.scan.planes[i][at]) - mean)
                    })
                    .filter(|(light, _)| *light > self.background.noise.max(0.5))
                    .collect()
            })
            .collect();
        let mut pixels: Vec<(f64, f64)> = pixels.concat();
        pixels.sort_by(|a, b| b.0.total_cmp(&a.0));
        pixels.truncate(pixels.len() / 2);
        let noise2 = self.background.noise * self.background.noise + ROUNDING;
        let mut g = state.variance_per_count;
        for _ in 0..20 {
            let (mut above, mut below) = (0.0, 0.0);
            for &(light, r) in &pixels {
                let variance = noise2 + g * light;
                let weight = light / (variance * variance);
                // Limits the effect of outliers, which are not noise.
                let r2 = (r * r).min(HUBER * HUBER * variance);
                above += weight * (r2 - noise2);
                below += weight * light;
            }
            let next = if below > 0.0 { (above / below).max(0.0) } else { 0.0 };
            let done = (next - g).abs() < 1e-4 * (g + 1e-3);
            g = next;
            if done {
                break;
            }
        }
        Ok(g)
    }

    /// Calls `visit` for each plane in order, with the pixels of all windows: index in the plane, mean count,
    /// residual in standard deviations.
    pub(super) fn each_plane(
        &self,
        state: &State,
        mut visit: impl FnMut(Vec<(usize, f64, f64)>) -> Result<()>,
    ) -> Result<()> {
        let renderer = self.renderer(&state.microscope)?;
        self.prepare(&renderer, state, &state.microscope);
        for (i, plane) in self.scan.planes.iter().enumerate() {
            let mut pixels = Vec::new();
            for (k, window) in self.windows.particles.iter().enumerate() {
                let shares = self.shares(&renderer, state, &state.microscope, k, i);
                for (&(at, _), share) in window.pixels.iter().zip(&shares) {
                    let (mean, _, variance) = self.count(state, k, i, share[0]);
                    pixels.push((at, mean, (f64::from(plane[at]) - mean) / libm::sqrt(variance)));
                }
            }
            visit(pixels)?;
        }
        Ok(())
    }

    /// Levenberg-Marquardt minimization from a state, with at most `steps` steps.
    pub(super) fn minimize(&self, mut state: State, steps: usize, damping: f64) -> Result<State> {
        let mut damping = damping;
        for _ in 0..steps {
            let normal = self.normal(&state)?;
            let n = normal.right.len();
            let mut accepted = None;
            while damping < 1e8 {
                let mut damped = normal.matrix.clone();
                (0..n).for_each(|i| damped.add(i, i, damping * normal.matrix.at(i, i) + 1e-12));
                let Some(step) = damped.solve(&normal.right) else {
                    damping *= 10.0;
                    continue;
                };
                let predicted = step.iter().zip(&normal.right).map(|(s, r)| s * r).sum::<f64>();
                let next = self.moved(&state, &step);
                let misfits = self.misfits(&next, Some(&state))?;
                let loss: f64 = misfits.iter().map(|(_, _, m)| m.loss).sum();
                if loss < normal.loss {
                    damping = (0.2 * damping).max(1e-7);
                    accepted = Some((next, predicted));
                    break;
                }
                if predicted < CONVERGED {
                    return Ok(state);
                }
                damping = (5.0 * damping).max(1e-4);
            }
            let Some((next, predicted)) = accepted else { break };
            state = next;
            if predicted < CONVERGED {
                break;
            }
        }
        Ok(state)
    }
}
