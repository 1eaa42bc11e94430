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

/// Half the distance between the two images of a difference: px, px, um.
const STEPS: [f64; 3] = [0.25, 0.25, 0.5];

impl Gradient {
    /// By differences over half a pixel and 1 um. `draw`: light of a particle on the pixels of the window.
    pub(super) fn by_differences(
        window: Window,
        particle: &Particle,
        draw: impl Fn(&Particle) -> Vec<f32>,
    ) -> Self {
        let mut pixels: Vec<[f64; 4]> =
            draw(particle).into_iter().map(|v| [f64::from(v), 0.0, 0.0, 0.0]).collect();
        for axis in 0..3 {
            let [low, high] = Self::displaced(particle, axis).map(|displaced| draw(&displaced));
            for ((pixel, low), high) in pixels.iter_mut().zip(low).zip(high) {
                pixel[axis + 1] = f64::from(high - low) / (2.0 * STEPS[axis]);
            }
        }
        Gradient { window, pixels }
    }

    /// The two places of a particle for a difference along an axis: x, y, z.
    pub(super) fn displaced(particle: &Particle, axis: usize) -> [Particle; 2] {
        [-STEPS[axis], STEPS[axis]].map(|by| {
            let mut displaced = *particle;
            *[&mut displaced.x_px, &mut displaced.y_px, &mut displaced.z_um][axis] += by;
            displaced
        })
    }

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
