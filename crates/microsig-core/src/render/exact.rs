//! Reference implementation: every ray of every source point traced individually in f64.
//!
//! Given the random angles of the original program it reproduces its ray counts exactly. It is slow and
//! serves to check the fast kernel.

use crate::emission::{self, Point};
use crate::optics::{OpticalSystem, Ray};
use crate::particle::Particle;
use crate::settings::Settings;

/// Ray counts of one particle on the whole sensor, row by row; its source points `points` emit fans rotated
/// by `angles` (rad, one per point).
pub fn count_rays(settings: &Settings, particle: &Particle, points: &[Point], angles: &[f64]) -> Vec<u32> {
    let system = OpticalSystem::new(settings);
    let (width, height) = (settings.pixel_dim_x as usize, settings.pixel_dim_y as usize);
    let mut counts = vec![0u32; width * height];
    let fan: Vec<[f64; 3]> = emission::fan(settings.n_rays).collect();
    let distance = system.objective.object_distance(particle.z_um);

    for (&[e1, e2, e3], &angle) in points.iter().zip(angles) {
        let (sine, cosine) = libm::sincos(angle);
        for &[d1, d2, d3] in &fan {
            let (turned1, turned2) = (d1 * cosine - d2 * sine, d1 * sine + d2 * cosine);
            // Reflection into the half space toward the lens changes the sign of the depth component only, so
            // its magnitude is used.
            let toward_lens = turned1.abs();
            let ray = Ray { q_x: e2, q_y: e3, p_x: turned2 / toward_lens, p_y: d3 / toward_lens };
            if let Some((x, y)) = system.trace(ray, distance + e1) {
                let column = libm::rint(x / settings.pixel_size + particle.x_px);
                let row = libm::rint(y / settings.pixel_size + particle.y_px);
                if column >= 1.0 && column <= width as f64 && row >= 1.0 && row <= height as f64 {
                    counts[(row as usize - 1) * width + column as usize - 1] += 1;
                }
            }
        }
    }
    counts
}
