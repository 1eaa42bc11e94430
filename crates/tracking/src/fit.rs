//! Weighted least-squares fit of position, depth and brightness of one particle (Levenberg-Marquardt).

use glam::{DMat4, DVec4};

use super::OtherSide;
use super::gray_image::GrayImage;
use super::images::{ImagePatch, ParticleImages};
use super::positions::{Position, REACH_PX};

/// Maximum number of iterations.
const MAX_ITERATIONS: usize = 12;

/// Convergence: step size relative to a pixel and to the depth step.
const CONVERGED: f64 = 0.005;

/// The residual of a frame during the search for particles.
#[derive(Debug)]
pub(super) struct Residual {
    /// Counts above the background, minus the light of the particles found so far.
    pub(super) image: GrayImage,
    /// Inverse variance of each pixel.
    pub(super) weight: Vec<f32>,
}

/// A fitted particle; brightness relative to the template's.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(super) struct ParticleFit {
    /// Index of its size among the calibrated particle sizes.
    pub(super) size: usize,
    /// Position relative to the center of the first pixel, px.
    pub(super) at: [f64; 2],
    pub(super) z_um: f64,
    /// A depth on the other side of the focus whose image resembles the data nearly as well, then the fit there.
    pub(super) other_z_um: Option<f64>,
    pub(super) other: Option<OtherSide>,
    pub(super) amplitude: f64,
    /// Reduction of chi^2 (the weighted sum of squares) by the particle.
    pub(super) chi2_reduction: f64,
    /// Weighted correlation of the particle's image with the light of the residual, see [`Agreement`].
    pub(super) correlation: f64,
    /// What is left of chi^2, per pixel.
    pub(super) misfit: f64,
    /// Standard deviations of x, y (px) and z (um) due to noise, from the joint fit.
    pub(super) deviations: Option<[f64; 3]>,
    /// Diameter, um, if it is fitted.
    pub(super) d_um: Option<f64>,
    /// The known position near which it is.
    pub(super) given: Option<Position>,
}

/// Light beyond the expected noise counts only above this many standard deviations of that noise.
const BEYOND_NOISE: f64 = 3.0;

/// Agreement of an image with data: weighted sums over pixels, weights being inverse variances.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Agreement {
    /// Sum of squares of the image.
    own: f64,
    /// Sum of the image times the data.
    both: f64,
    /// Sum of squares of the data.
    seen: f64,
    pixels: usize,
}

impl Agreement {
    pub(super) fn add(&mut self, weight: f32, data: f32, image: f32) {
        self.own += f64::from(weight * image * image);
        self.both += f64::from(weight * image * data);
        self.seen += f64::from(weight * data * data);
        self.pixels += 1;
    }

    /// Whether image and data correlate at all.
    pub(super) fn is_positive(&self) -> bool {
        self.own > 0.0 && self.both > 0.0
    }

    /// Brightness of the image that fits best.
    pub(super) fn amplitude(&self) -> f64 {
        self.both / self.own
    }

    /// Reduction of chi^2 by the image of that brightness.
    pub(super) fn chi2_reduction(&self) -> f64 {
        self.both * self.both / self.own
    }

    /// What the image leaves of chi^2, per pixel.
    pub(super) fn misfit(&self) -> f64 {
        (self.seen - self.chi2_reduction()) / self.pixels as f64
    }

    /// Weighted correlation of the image with the light in the data. Faint images extend over many pixels
    /// whose counts are mostly noise, which is not light: it adds one per pixel to the squares of the data.
    pub(super) fn correlation(&self) -> f64 {
        let (n, explained) = (self.pixels as f64, self.chi2_reduction());
        let light = self.seen - n - BEYOND_NOISE * (2.0 * n).sqrt();
        (explained / light.max(explained)).sqrt()
    }
}

impl Residual {
    pub(super) fn size(&self) -> (usize, usize) {
        (self.image.width, self.image.height)
    }

    /// Adds `sign` times the image of the particle to the residual.
    pub(super) fn add(&mut self, images: &[impl ParticleImages], fit: &ParticleFit, sign: f64) {
        let images = &images[fit.size];
        let patch = images.patch(fit.at, fit.z_um, images.radius_px(fit.z_um, 0.0));
        let amplitude = (sign * fit.amplitude) as f32;
        for (i, light) in patch.pixels(self.size()) {
            self.image.counts[i] += amplitude * light[0];
        }
    }
}

impl ParticleFit {
    /// In other coordinates of the image.
    pub(super) fn mapped(self, map: impl Fn([f64; 2]) -> [f64; 2]) -> Self {
        ParticleFit { at: map(self.at), given: self.given.map(|given| given.mapped(&map)), ..self }
    }

    /// After a step in the image of at most 1 px along each axis, which does not leave the surroundings of a known position.
    pub(super) fn shifted(self, step: [f64; 2]) -> Self {
        let at = std::array::from_fn(|axis| {
            let moved = self.at[axis] + step[axis].clamp(-1.0, 1.0);
            self.given
                .map_or(moved, |given| moved.clamp(given.at[axis] - REACH_PX, given.at[axis] + REACH_PX))
        });
        ParticleFit { at, ..self }
    }

    /// The best fit near the position and depth of another; `step_um` is the scale of depth changes. `None` if the
    /// start has no positive correlation with the residual.
    pub(super) fn near(
        residual: &Residual,
        images: &dyn ParticleImages,
        ParticleFit { size, at, z_um, given, .. }: ParticleFit,
        step_um: f64,
    ) -> Option<ParticleFit> {
        let radius = images.radius_px(z_um, 3.0 * step_um);
        let [low, high] = images.depths_um();
        let mut best = ParticleFit { size, at, z_um, given, ..ParticleFit::default() };
        let (mut next, mut damping) = (best, 1e-3f64);
        let mut normal = (DMat4::ZERO, DVec4::ZERO);
        for k in 0..MAX_ITERATIONS {
            let patch = images.patch(next.at, next.z_um, radius);
            let mut agreement = Agreement::default();
            for (i, light) in patch.pixels(residual.size()) {
                agreement.add(residual.weight[i], residual.image.counts[i], light[0]);
            }
            if !agreement.is_positive() {
                return (k > 0).then_some(best);
            }
            let chi2_reduction = agreement.chi2_reduction();
            if chi2_reduction > best.chi2_reduction {
                let amplitude = agreement.amplitude();
                next =
                    ParticleFit { amplitude, chi2_reduction, correlation: agreement.correlation(), ..next };
                best = next;
                damping = (0.3 * damping).max(1e-4);
                normal = equations(residual, &patch, amplitude);
            } else {
                damping *= 10.0;
            }
            let (matrix, right) = normal;
            let diagonal = DMat4::from_diagonal(matrix.diagonal() * damping);
            let change = (matrix + diagonal).inverse() * right;
            if !change.is_finite() {
                return Some(best);
            }
            next = best.shifted([change.y, change.z]);
            next.z_um = (best.z_um + change.w.clamp(-1.5 * step_um, 1.5 * step_um)).clamp(low, high);
            let moved = [next.at[0] - best.at[0], next.at[1] - best.at[1], (next.z_um - best.z_um) / step_um];
            if moved.iter().all(|m| m.abs() < CONVERGED) {
                return Some(best);
            }
        }
        Some(best)
    }
}

/// Normal equations for changes in brightness, x, y and depth.
fn equations(residual: &Residual, patch: &ImagePatch, amplitude: f64) -> (DMat4, DVec4) {
    let (mut matrix, mut right) = (DMat4::ZERO, DVec4::ZERO);
    for (i, [t, x, y, z]) in patch.pixels(residual.size()) {
        let w = f64::from(residual.weight[i]);
        let slope = DVec4::new(
            f64::from(t),
            amplitude * f64::from(x),
            amplitude * f64::from(y),
            amplitude * f64::from(z),
        );
        let off = f64::from(residual.image.counts[i]) - amplitude * f64::from(t);
        let weighted = slope * w;
        right += weighted * off;
        matrix +=
            DMat4::from_cols(weighted * slope.x, weighted * slope.y, weighted * slope.z, weighted * slope.w);
    }
    (matrix, right)
}
