//! The light of a particle that the aperture accepts, and wave optics of the same lens.

use microsig_core::render::RendererSpec;
use microsig_core::render::expected::TOLERANCES;
use microsig_core::render::waves::{WaveOptics, WavesRenderer};
use microsig_core::{Particle, Settings, emission};

use scenario::Scenario;
use storage::error::Result;

/// Wavelength for effects that rays neglect, um: green.
pub(super) const GREEN_UM: f64 = 0.55;

/// The light of a particle that the aperture accepts.
pub(super) enum Accepted {
    Rays(Box<Settings>),
    Waves(Box<WavesRenderer>),
    /// Gaussian spots have no aperture.
    Spots,
}

impl Accepted {
    pub(super) fn new(scenario: &Scenario) -> Result<Self> {
        Ok(match scenario.spec.renderer() {
            RendererSpec::Waves { optics, tolerance } => {
                Accepted::Waves(Box::new(WavesRenderer::new(&scenario.settings, &optics, tolerance)?))
            }
            RendererSpec::Gaussian(_) => Accepted::Spots,
            _ => Accepted::Rays(Box::new(scenario.settings.clone())),
        })
    }

    /// Wave optics of the lens, even if images are rendered with rays; `None` if it does not support these
    /// settings.
    pub(super) fn waves(&self) -> Option<WavesRenderer> {
        match self {
            Accepted::Waves(waves) => Some((**waves).clone()),
            // It renders nothing.
            Accepted::Rays(settings) => {
                WavesRenderer::new(settings, &WaveOptics::new(GREEN_UM), *TOLERANCES.end()).ok()
            }
            Accepted::Spots => None,
        }
    }

    /// As in [`microsig_core::sensor::Light`], of a sphere of brightness 1.
    pub(super) fn of(&self, sphere: &Particle) -> Option<f64> {
        match self {
            Accepted::Spots => None,
            Accepted::Waves(waves) => Some(waves.accepted(sphere)),
            Accepted::Rays(settings) => {
                let Settings { numerical_aperture: na, focal_length, magnification, .. } = **settings;
                let distance = focal_length * (1.0 + 1.0 / magnification);
                // The source points of a sphere, on the half that faces the lens, are nearer by half its
                // radius on average.
                let of_points = distance + sphere.z_um - 0.25 * sphere.d_um;
                let tangent = na / (1.0 - na * na).sqrt() * distance / of_points;
                let rays = emission::sphere_points(settings, sphere.d_um) as f64
                    * (f64::from(settings.n_rays) + 1.0);
                Some(rays * (1.0 - 1.0 / (1.0 + tangent * tangent).sqrt()))
            }
        }
    }
}
