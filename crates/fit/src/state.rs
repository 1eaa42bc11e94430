//! The state of an image fit (microscope and particles), and its misfit.

use super::optics::Microscope;

/// The loss is linear for residuals beyond this many standard deviations.
pub(super) const HUBER: f64 = 5.0;

/// One particle of a fit.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Bead {
    /// Position at the mean stage position, relative to the middle of its window, px.
    pub(super) x: f64,
    pub(super) y: f64,
    /// Depth at stage position 0, um of the model.
    pub(super) z_um: f64,
    /// Light emitted toward the lens, counts.
    pub(super) light: f64,
    /// Background, counts.
    pub(super) background: f64,
}

/// Variance of a count: that of the background, rounding included (counts^2), that per count of light
/// (counts), and that per squared count of light, by which errors of the model grow.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Noise {
    pub(super) background2: f64,
    pub(super) per_count: f64,
    pub(super) per_count2: f64,
}

impl Noise {
    pub(super) fn variance(self, light: f64) -> f64 {
        let light = light.max(0.0);
        self.background2 + (self.per_count + self.per_count2 * light) * light
    }
}

/// All quantities that the fit changes.
#[derive(Debug, Clone)]
pub(super) struct State {
    pub(super) microscope: Microscope,
    pub(super) direction: f64,
    /// Lateral drift, px per um of stage position.
    pub(super) drift: [f64; 2],
    pub(super) beads: Vec<Bead>,
    /// Brightness of each plane, mean 1.
    pub(super) flux: Vec<f64>,
    /// Variance of counts.
    pub(super) noise: Noise,
}

/// Misfit of one window.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(super) struct Misfit {
    pub(super) pixels: usize,
    /// Huber loss with fixed weights, which a step decreases.
    pub(super) loss: f64,
    /// Sum of squared residuals over variance.
    pub(super) chi2: f64,
    /// Sum of the Huber loss of r/sd plus ln(variance).
    pub(super) minus_two_log_likelihood: f64,
    /// Sums over pairs of neighboring pixels of products of residuals, and of data minus background,
    /// counts^2: without noise, which neighbors do not share.
    pub(super) unexplained: f64,
    pub(super) signal: f64,
}

/// Huber loss of a residual in standard deviations: quadratic, and linear beyond [`HUBER`].
pub(super) fn huber(r: f64) -> f64 {
    let size = r.abs();
    if size > HUBER { HUBER * (2.0 * size - HUBER) } else { size * size }
}
