//! The mean of several ray images of one particle.

use super::{RayRenderer, Scratch};
use crate::particle::Particle;
use crate::render::patch::{ExpectedPatch, Window};
use crate::sensor::Light;
use crate::stream::{Purpose, Streams};

/// Number of ray images averaged.
const IMAGES: u32 = 32;

/// The sum of the ray counts of [`IMAGES`] images on all pixels of the sensor, and the pixels they reach;
/// `None` if no light reaches the sensor.
fn sum(renderer: &RayRenderer, particle: &Particle) -> Option<(Vec<u32>, Window)> {
    let streams = Streams::new(0);
    let mut scratch = Scratch::default();
    let columns = renderer.settings.pixel_dim_x as usize;
    let mut sum = vec![0u32; columns * renderer.settings.pixel_dim_y as usize];
    let mut largest = Window::default();
    for image in 0..IMAGES {
        let patch = renderer.patch(particle, &streams, Purpose::CalibrationRays, image, 0, &mut scratch)?;
        let window = patch.window;
        for (row, counts) in patch.counts.chunks(window.width).enumerate() {
            let first = (window.y0 as usize - 1 + row) * columns + window.x0 as usize - 1;
            sum[first..][..counts.len()].iter_mut().zip(counts).for_each(|(s, c)| *s += c);
        }
        // Windows have a common center, so the largest contains the others.
        if window.area() > largest.area() {
            largest = window;
        }
    }
    Some((sum, largest))
}

/// The mean light of a particle on the pixels it reaches.
pub(super) fn mean_patch(renderer: &RayRenderer, particle: &Particle) -> Option<ExpectedPatch> {
    let (sum, window) = sum(renderer, particle)?;
    let columns = renderer.settings.pixel_dim_x as usize;
    let factor = particle.c_int / f64::from(IMAGES);
    let row = |row: usize| {
        let first = (window.y0 as usize - 1 + row) * columns + window.x0 as usize - 1;
        sum[first..][..window.width].iter().map(move |count| factor * f64::from(*count))
    };
    Some(ExpectedPatch { window, counts: (0..window.height).flat_map(row).collect() })
}

/// The mean light of a particle. The image of a sphere at the center of the sensor has mirror symmetries
/// (left-right, top-bottom and, without a cylindrical lens, about the diagonals), so its mirror images are
/// averaged too: 32 images then have the noise of 128 or 256.
pub(super) fn mean_light(renderer: &RayRenderer, particle: &Particle) -> Light {
    let dark = Light::dark(&renderer.settings);
    let Some((sum, _)) = sum(renderer, particle) else { return dark };
    let Light { width, height, .. } = dark;
    let (columns, rows) = (width as usize, height as usize);
    let at = |x: usize, y: usize| u64::from(sum[y * columns + x]);
    let in_middle = |at: f64, size: u32| at == 0.5 * f64::from(size + 1);
    let symmetric =
        particle.spheroid.is_none() && in_middle(particle.x_px, width) && in_middle(particle.y_px, height);
    let transposable = symmetric && width == height && renderer.system.cylinder.is_none();
    let (last_x, last_y) = (columns - 1, rows - 1);
    // Sums of integers do not depend on their order.
    let mirrored =
        |x: usize, y: usize| at(x, y) + at(last_x - x, y) + at(x, last_y - y) + at(last_x - x, last_y - y);
    let values = (0..columns * rows)
        .map(|i| {
            let (x, y) = (i % columns, i / columns);
            let (total, copies) = match (symmetric, transposable) {
                (_, true) => (mirrored(x, y) + mirrored(y, x), 8),
                (true, false) => (mirrored(x, y), 4),
                (false, false) => (at(x, y), 1),
            };
            particle.c_int * (total as f64 / f64::from(copies * IMAGES))
        })
        .collect();
    Light { width, height, values }
}
