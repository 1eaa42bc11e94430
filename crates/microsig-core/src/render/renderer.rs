//! What all ways of making light have in common.

use super::expected::ExpectedRenderer;
use super::gaussian::GaussianRenderer;
use super::rays::RayRenderer;
use crate::error::Error;
use crate::particle::Particle;
use crate::sensor::Light;
use crate::settings::Settings;
use crate::stream::{Purpose, Streams};

/// A way of drawing particles.
#[derive(Debug, Clone)]
pub enum Renderer {
    /// Counts of discrete rays, the paper's method.
    Rays(RayRenderer),
    /// The limit of many rays, without their noise.
    Expected(ExpectedRenderer),
    /// Gaussian spots, all in focus.
    Gaussian(GaussianRenderer),
}

macro_rules! ask {
    ($self:ident.$question:ident($($argument:ident),*)) => {
        match $self {
            Renderer::Rays(renderer) => renderer.$question($($argument),*),
            Renderer::Expected(renderer) => renderer.$question($($argument),*),
            Renderer::Gaussian(renderer) => renderer.$question($($argument),*),
        }
    };
}

impl Renderer {
    /// Its name in scenarios and manifests.
    pub fn name(&self) -> &'static str {
        match self {
            Renderer::Rays(_) => "rays",
            Renderer::Expected(_) => "expected",
            Renderer::Gaussian(_) => "gaussian",
        }
    }

    /// The settings.
    pub fn settings(&self) -> &Settings {
        ask!(self.settings())
    }

    /// Whether this particle can be drawn, and what should be known about its image if so.
    ///
    /// # Errors
    /// [`Error::Unsupported`] with the reason why not.
    pub fn check(&self, particle: &Particle) -> Result<Option<String>, Error> {
        ask!(self.check(particle))
    }

    /// What should be known about all images of these settings.
    pub fn warning(&self) -> Option<String> {
        match self {
            Renderer::Rays(rays) => rays.warning(),
            Renderer::Expected(_) | Renderer::Gaussian(_) => None,
        }
    }

    /// How the images drawn so far fall short of what was asked for.
    pub fn shortfall(&self) -> Option<String> {
        match self {
            Renderer::Expected(expected) => expected.shortfall(),
            Renderer::Rays(_) | Renderer::Gaussian(_) => None,
        }
    }

    /// Half width and half height of a particle's image, px, with some margin.
    pub fn image_extent(&self, particle: &Particle) -> (f64, f64) {
        ask!(self.image_extent(particle))
    }

    /// Whether some of a particle's light may fall on the sensor.
    pub fn reaches_sensor(&self, particle: &Particle) -> bool {
        ask!(self.reaches_sensor(particle))
    }

    /// Adds up the light of all particles of one image; what is random in it comes from the streams of `purpose`.
    pub fn light(&self, particles: &[Particle], streams: &Streams, purpose: Purpose, frame: u32) -> Light {
        match self {
            Renderer::Rays(rays) => rays.light(particles, streams, purpose, frame),
            Renderer::Expected(expected) => expected.light(particles),
            Renderer::Gaussian(gaussian) => gaussian.light(particles),
        }
    }
}
