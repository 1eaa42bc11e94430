//! Noise-free images with their derivatives, for fits and bounds of precision.

use super::patch::Window;
use crate::particle::Particle;

/// Expected ray counts of one particle and their derivatives with respect to its position.
#[derive(Debug, Clone, PartialEq)]
pub struct Gradient {
    /// Where on the sensor.
    pub window: Window,
    /// For each pixel, row by row: counts, and their derivatives with respect to x (1/px), y (1/px) and z
    /// (1/um).
    pub pixels: Vec<[f64; 4]>,
}

impl Gradient {
    /// From light on a pixel at this distance from the particle (px) and its derivatives with respect to that
    /// distance and the depth of the particle, times `light`.
    pub(super) fn new(
        window: Window,
        particle: &Particle,
        light: f64,
        at: impl Fn(f64, f64) -> [f64; 4],
    ) -> Self {
        let pixels = (0..window.area())
            .map(|i| {
                let dx = (window.x0 + (i % window.width) as i64) as f64 - particle.x_px;
                let dy = (window.y0 + (i / window.width) as i64) as f64 - particle.y_px;
                let [value, by_x, by_y, by_z] = at(dx, dy);
                // Moving the particle to the right is equivalent to moving the pixel to the left.
                [light * value, -light * by_x, -light * by_y, light * by_z]
            })
            .collect();
        Gradient { window, pixels }
    }
}
