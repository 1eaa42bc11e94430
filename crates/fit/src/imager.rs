//! Images of single particles for a fit, by rays or by waves. They are computed directly, without tables: a
//! fit draws most images only once.

use microsig_core::emission::SpheroidLaw;
use microsig_core::render::expected::ExpectedRenderer;
use microsig_core::render::waves::WavesRenderer;

use super::optics::Microscope;
use storage::error::Result;

/// Steps of differences of images by waves: across, px; along z in units of lambda / NA^2.
const STEP_PX: f64 = 0.05;
const STEP_DEPTHS: f64 = 0.05;

/// Images of the particles of a microscope.
#[derive(Debug, Clone)]
pub(super) enum Imager {
    /// Infinitely many rays.
    Rays(Box<ExpectedRenderer>),
    /// Scalar wave optics.
    Waves(Box<WavesRenderer>),
}

impl Imager {
    /// Images on windows of `edge_px` px; `tolerance` is their error relative to the peak.
    pub(super) fn new(microscope: &Microscope, tolerance: f64, edge_px: usize) -> Result<Imager> {
        let settings = microscope.settings(edge_px);
        Ok(match &microscope.waves {
            None => {
                let renderer = ExpectedRenderer::new(&settings, SpheroidLaw::Original, tolerance)?;
                Imager::Rays(Box::new(renderer))
            }
            Some(waves) => {
                Imager::Waves(Box::new(WavesRenderer::new(&settings, &waves.optics(), tolerance)?))
            }
        })
    }

    /// Fractions of the light on pixels at these positions relative to the particle (px), without
    /// derivatives.
    pub(super) fn values(&self, microscope: &Microscope, z_um: f64, places: &[[f64; 2]]) -> Vec<f64> {
        match self {
            Imager::Rays(renderer) => {
                renderer.shares(z_um, microscope.diameter_um, &in_cylinder_frame(microscope, places))
            }
            Imager::Waves(renderer) => renderer.share_at(z_um, microscope.diameter_um, places),
        }
    }

    /// Fractions of the light on pixels at these positions relative to the particle (px), with their
    /// derivatives with respect to the particle's x, y (1/px), z (1/um), and the angle of the cylindrical
    /// lens (1/rad).
    pub(super) fn gradients(
        &self,
        microscope: &Microscope,
        z_um: f64,
        places: &[[f64; 2]],
    ) -> Vec<[f64; 5]> {
        match self {
            Imager::Rays(renderer) => by_rays(renderer, microscope, z_um, places),
            Imager::Waves(renderer) => by_waves(renderer, microscope, z_um, places),
        }
    }
}

/// Positions of pixels in the frame of the cylindrical lens.
fn in_cylinder_frame(microscope: &Microscope, places: &[[f64; 2]]) -> Vec<[f64; 2]> {
    let (c, s) = (libm::cos(microscope.angle), libm::sin(microscope.angle));
    places.iter().map(|[x, y]| [c * x + s * y, c * y - s * x]).collect()
}

fn by_rays(
    renderer: &ExpectedRenderer,
    microscope: &Microscope,
    z_um: f64,
    places: &[[f64; 2]],
) -> Vec<[f64; 5]> {
    let (c, s) = (libm::cos(microscope.angle), libm::sin(microscope.angle));
    let turned = in_cylinder_frame(microscope, places);
    renderer
        .share_gradients(z_um, microscope.diameter_um, &turned)
        .into_iter()
        .zip(&turned)
        .map(|([value, by_u, by_v, by_z], [u, v])| {
            // A displacement of the particle moves the pixel relative to it in the opposite direction.
            [value, -(c * by_u - s * by_v), -(s * by_u + c * by_v), by_z, by_u * v - by_v * u]
        })
        .collect()
}

fn by_waves(
    renderer: &WavesRenderer,
    microscope: &Microscope,
    z_um: f64,
    places: &[[f64; 2]],
) -> Vec<[f64; 5]> {
    let n = places.len();
    let shifts = [[0.0, 0.0], [-STEP_PX, 0.0], [STEP_PX, 0.0], [0.0, -STEP_PX], [0.0, STEP_PX]];
    let shifted: Vec<[f64; 2]> =
        shifts.iter().flat_map(|[dx, dy]| places.iter().map(move |[x, y]| [x + dx, y + dy])).collect();
    let drawn = renderer.share_at(z_um, microscope.diameter_um, &shifted);
    let na = microscope.numerical_aperture();
    let step = STEP_DEPTHS * renderer.optics().wavelength_um / (na * na);
    let [low, high] = [-step, step].map(|by| renderer.share_at(z_um + by, microscope.diameter_um, places));
    (0..n)
        .map(|i| {
            let across =
                |low: usize, high: usize| (drawn[high * n + i] - drawn[low * n + i]) / (2.0 * STEP_PX);
            [drawn[i], -across(1, 2), -across(3, 4), (high[i] - low[i]) / (2.0 * step), 0.0]
        })
        .collect()
}
