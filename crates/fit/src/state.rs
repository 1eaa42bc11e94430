//! The state of an image fit, the microscope and the particles, and how well it describes the images.

use super::optics::Microscope;

/// Residuals beyond this many standard deviations count linearly.
pub(super) const HUBER: f64 = 5.0;

/// One particle of a fit.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Bead {
    /// Place at the mean stage position, from the middle of its window, px.
    pub(super) x: f64,
    pub(super) y: f64,
    /// Depth at stage position 0, um of the model.
    pub(super) z_um: f64,
    /// Light sent toward the lens, counts of the camera.
    pub(super) light: f64,
    /// Background, counts.
    pub(super) background: f64,
}

/// Everything that a fit moves.
#[derive(Debug, Clone)]
pub(super) struct State {
    pub(super) microscope: Microscope,
    pub(super) direction: f64,
    /// px per um of stage.
    pub(super) drift: [f64; 2],
    pub(super) beads: Vec<Bead>,
    /// Brightness of each plane, mean 1.
    pub(super) flux: Vec<f64>,
    /// Variance per count of light.
    pub(super) variance_per_count: f64,
}

/// How well one window is described.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(super) struct Misfit {
    pub(super) pixels: usize,
    /// Huber's loss with fixed weights: what a step lowers.
    pub(super) loss: f64,
    /// Sum of squared residuals over variance.
    pub(super) chi2: f64,
    /// Sum of r^2/var + ln var.
    pub(super) minus_two_log_likelihood: f64,
    /// Squares of residuals, of data less background, and of the noise, counts^2.
    pub(super) residual2: f64,
    pub(super) signal2: f64,
    pub(super) noise2: f64,
}

/// Huber's loss of a residual in standard deviations: its square, and straight beyond [`HUBER`].
pub(super) fn huber(r: f64) -> f64 {
    let size = r.abs();
    if size > HUBER { HUBER * (2.0 * size - HUBER) } else { size * size }
}
