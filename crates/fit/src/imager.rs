//! Images of single particles for a fit, by rays or by waves. They are computed directly, without tables: a
//! fit draws most images only once.

use microsig_core::emission::SpheroidLaw;
use microsig_core::render::expected::ExpectedRenderer;
use microsig_core::render::waves::{SingleImages, WavesRenderer};

use super::optics::Microscope;
use storage::error::Result;

/// Margin of images by waves beyond the window, px, for the particle's distance from its middle.
const MARGIN_PX: usize = 3;

/// Images of the particles of a microscope.
#[derive(Debug)]
pub(super) enum Imager {
    /// Infinitely many rays.
    Rays(Box<ExpectedRenderer>),
    /// Scalar wave optics.
    Waves(Box<SingleImages>),
}

impl Imager {
    /// Images on windows of `edge_px` px of particles at these depths (um, from and to); `tolerance` is their
    /// error relative to the peak.
    pub(super) fn new(
        microscope: &Microscope,
        tolerance: f64,
        edge_px: usize,
        depths_um: [f64; 2],
    ) -> Result<Imager> {
        let settings = microscope.settings(edge_px);
        Ok(match &microscope.waves {
            None => {
                let renderer = ExpectedRenderer::new(&settings, SpheroidLaw::Original, tolerance)?;
                Imager::Rays(Box::new(renderer))
            }
            Some(waves) => {
                let renderer = WavesRenderer::new(&settings, &waves.optics(), tolerance)?;
                let edge_px = [edge_px / 2 + MARGIN_PX; 2];
                Imager::Waves(Box::new(renderer.single_images(depths_um, microscope.diameter_um, edge_px)))
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
            Imager::Waves(images) => images.shares(z_um, places),
        }
    }

    /// Fractions of the light on pixels at these positions relative to the particle (px), with their
    /// derivatives with respect to the particle's x, y (1/px), z (1/um), and the angle of the cylindrical
    /// lens (1/rad).
    pub(super) fn gradients(&self, microscope: &Microscope, z_um: f64, places: &[[f64; 2]]) -> Vec<[f64; 5]> {
        match self {
            Imager::Rays(renderer) => by_rays(renderer, microscope, z_um, places),
            Imager::Waves(images) => {
                let gradients = images.share_gradients(z_um, places);
                gradients.into_iter().map(|[value, x, y, z]| [value, -x, -y, z, 0.0]).collect()
            }
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
