//! Spheroids: each has a shape, an orientation and so an image of its own, which is computed directly, without tables.

use super::build::Model;
use super::exposure::{Exposed, Fineness, Grid, Part};
use super::surface::Surface;
use crate::emission::{self, GoldenAzimuths, SpheroidLaw};
use crate::particle::Particle;
use crate::render::patch::Window;
use crate::settings::Settings;

/// The shining surface of a spheroid: the points of the law of emission themselves. Also their number.
pub(super) fn surface(settings: &Settings, law: SpheroidLaw, particle: &Particle) -> Surface {
    let (mut azimuths, mut points) = (GoldenAzimuths::default(), Vec::new());
    let n = emission::surface_points(settings, particle);
    emission::shining_points(particle, n, law, &mut azimuths, &mut points);
    let e_p = particle.spheroid.map_or(1.0, |spheroid| spheroid.e_p);
    Surface::new(points, 0.5 * particle.d_um * e_p.min(1.0))
}

/// Light on the pixels of a window, rays.
pub(super) fn patch(
    model: &Model,
    settings: &Settings,
    surface: &Surface,
    [x_px, y_px, z_um]: [f64; 3],
    window: Window,
) -> Vec<f32> {
    let first_px = [window.x0 as f64 - x_px, window.y0 as f64 - y_px];
    let grid = Grid { per_px: 1, first_px, columns: window.width, rows: window.height };
    let fineness = Fineness(2.0 * (1e-3 / model.tolerance).clamp(0.3, 4.0));
    let exposed = Exposed { pupil: &model.pupil, z_um, surface, grid };
    let mut light = exposed.light(Part::Whole, fineness, model.instructions);
    let rays = (surface.points.len() as f64 * (f64::from(settings.n_rays) + 1.0)) as f32;
    light.iter_mut().for_each(|v| *v *= rays);
    light
}
