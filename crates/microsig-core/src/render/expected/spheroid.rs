//! Spheroids: each has its own shape, orientation and image, which is computed directly, without tables.

use super::accumulator::Grid;
use super::aperture_integral::{Fineness, PupilPart};
use super::model::Model;
use super::surface::EmittingSurface;
use crate::emission::{self, GoldenAzimuths, SpheroidLaw};
use crate::particle::Particle;
use crate::render::patch::Window;
use crate::settings::Settings;

/// Source points on a spheroid whose image is coarse.
const COARSE_POINTS: usize = 2048;

/// The emitting surface of a spheroid: those among `n` source points that `law` selects.
fn surface(n: usize, law: SpheroidLaw, particle: &Particle) -> EmittingSurface {
    let (mut azimuths, mut points) = (GoldenAzimuths::default(), Vec::new());
    emission::shining_points(particle, n, law, &mut azimuths, &mut points);
    let e_p = particle.spheroid.map_or(1.0, |spheroid| spheroid.e_p);
    EmittingSurface::new(points, 0.5 * particle.d_um * e_p.min(1.0))
}

/// Light on the pixels of a window, in rays.
pub(super) fn patch(
    model: &Model,
    settings: &Settings,
    law: SpheroidLaw,
    particle: &Particle,
    window: Window,
) -> Vec<f32> {
    let fineness = Fineness::for_spheroid(model.tolerance);
    let all = emission::surface_points(settings, particle);
    let n = if fineness.is_coarse() { all.min(COARSE_POINTS) } else { all };
    let surface = surface(n, law, particle);
    let first_px = [window.x0 as f64 - particle.x_px, window.y0 as f64 - particle.y_px];
    let grid = Grid { per_px: 1, first_px, columns: window.width, rows: window.height };
    let integral = model.integral(particle.z_um, &surface, grid);
    let mut light = integral.light(PupilPart::Whole, fineness, model.instructions);
    let shining = surface.points.len() as f64 * (all as f64 / n.max(1) as f64);
    let rays = (shining * (f64::from(settings.n_rays) + 1.0)) as f32;
    light.iter_mut().for_each(|v| *v *= rays);
    light
}

#[cfg(test)]
mod tests {
    use super::super::pupil::{Pupil, density};
    use super::super::{DEFAULT_TOLERANCE, ExpectedRenderer};
    use super::*;
    use crate::optics::OpticalSystem;
    use crate::particle::Spheroid;

    /// Centroid (px) and variances (px^2) along columns and rows of exact rays from the source points through
    /// a grid of lens points.
    fn exact_moments(settings: &Settings, law: SpheroidLaw, particle: &Particle) -> [[f64; 2]; 2] {
        let pupil = Pupil { system: OpticalSystem::new(settings), pixel_size: settings.pixel_size };
        let (rings, azimuths) = (24, 48);
        let mut sums = [0.0; 5];
        for point in surface(emission::surface_points(settings, particle), law, particle).points {
            for ring in 0..rings {
                let q = pupil.aperture() * (f64::from(ring) + 0.5) / f64::from(rings);
                for azimuth in 0..azimuths {
                    let (sine, cosine) = libm::sincos(
                        (f64::from(azimuth) + 0.5) * std::f64::consts::TAU / f64::from(azimuths),
                    );
                    let [x, y] = pupil.landing(particle.z_um, point, [q * cosine, q * sine]).unwrap();
                    let (dx, dy) = (q * cosine - point[1], q * sine - point[2]);
                    let light = q * density(pupil.distance(particle.z_um) + point[0], dx * dx + dy * dy);
                    let terms = [1.0, x, y, x * x, y * y];
                    sums.iter_mut().zip(terms).for_each(|(sum, term)| *sum += light * term);
                }
            }
        }
        moments(sums)
    }

    /// Images at a coarse tolerance, which fits draw on their way: their RMS difference from those at the default one is below
    /// half of it, and they have the same light.
    #[test]
    fn coarse_images_are_near_the_others() {
        let settings = Settings { pixel_dim_x: 121, pixel_dim_y: 121, ..Settings::setting1() };
        for (e_p, z_um) in [(2.0, -30.0), (2.0, -5.0), (0.4, -50.0), (5.0, 5.0)] {
            let spheroid = Some(Spheroid { e_p, alpha_rad: 0.785, beta_rad: 0.9 });
            let particle = Particle { spheroid, ..Particle::sphere(60.7, 61.2, z_um, 4.0) };
            let [fine, coarse] = [DEFAULT_TOLERANCE, 0.02].map(|tolerance| {
                let renderer = ExpectedRenderer::new(&settings, SpheroidLaw::Uniform, tolerance).unwrap();
                renderer.patch(&particle).unwrap()
            });
            let peak = fine.counts.iter().copied().fold(0.0, f64::max);
            let off: Vec<f64> =
                fine.counts.iter().zip(coarse.on(fine.window)).map(|(a, b)| (a - b).abs() / peak).collect();
            let off = (off.iter().map(|off| off * off).sum::<f64>() / off.len() as f64).sqrt();
            let light = coarse.counts.iter().sum::<f64>() / fine.counts.iter().sum::<f64>();
            assert!(off < 0.01 && (light - 1.0).abs() < 2e-3, "e_p {e_p}, z {z_um}: {off}, {light}");
        }
    }

    fn moments([light, x, y, xx, yy]: [f64; 5]) -> [[f64; 2]; 2] {
        let (x, y) = (x / light, y / light);
        [[x, y], [xx / light - x * x, yy / light - y * y]]
    }

    /// The magnification of a source point far off the optical axis depends on its own depth: with a
    /// first-order expansion in the offset, the centroid of the first case would be off by 0.1 px.
    #[test]
    fn tilted_rods_lie_where_exact_rays_put_them() {
        let settings =
            Settings { pixel_dim_x: 201, pixel_dim_y: 201, points_per_pixel: 1.5, ..Settings::setting1() };
        let cases = [
            (8.0, 4.0, 0.785, 0.785, -60.0),
            (4.0, 3.0, 0.785, 0.785, -60.0),
            (8.0, 4.0, 0.3, 1.2, 20.0),
            (8.0, 0.25, 0.785, 0.785, -60.0),
        ];
        for law in [SpheroidLaw::Original, SpheroidLaw::Uniform] {
            let renderer = ExpectedRenderer::new(&settings, law, DEFAULT_TOLERANCE).unwrap();
            for (d_um, e_p, alpha_rad, beta_rad, z_um) in cases {
                let spheroid = Some(Spheroid { e_p, alpha_rad, beta_rad });
                let particle = Particle { spheroid, ..Particle::sphere(101.0, 101.0, z_um, d_um) };
                let patch = renderer.patch(&particle).unwrap();
                let mut sums = [0.0; 5];
                for (i, &counts) in patch.counts.iter().enumerate() {
                    let x = (patch.window.x0 + (i % patch.window.width) as i64) as f64 - 101.0;
                    let y = (patch.window.y0 + (i / patch.window.width) as i64) as f64 - 101.0;
                    let terms = [1.0, x, y, x * x, y * y];
                    sums.iter_mut().zip(terms).for_each(|(sum, term)| *sum += counts * term);
                }
                let (ours, exact) = (moments(sums), exact_moments(&settings, law, &particle));
                for axis in 0..2 {
                    let off = (ours[0][axis] - exact[0][axis]).abs();
                    let wide = ours[1][axis] / exact[1][axis] - 1.0;
                    let what =
                        format!("{law:?}, d {d_um}, e_p {e_p}, z {z_um}, axis {axis}: {off} px, {wide}");
                    assert!(off < 0.003 && wide.abs() < 0.004, "{what}");
                }
            }
        }
    }
}
