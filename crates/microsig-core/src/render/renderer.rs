//! Selection of a renderer; no other module distinguishes between them.
//!
//! To add a renderer, implement [`Render`] in a file of its own and add a variant to [`RendererSpec`].

use std::ops::Deref;
use std::sync::Arc;

use super::expected::ExpectedRenderer;
use super::gaussian::{GaussianRenderer, GaussianSpot};
use super::interface::Render;
use super::rays::RayRenderer;
use super::waves::{WaveOptics, WavesRenderer};
use crate::emission::SpheroidLaw;
use crate::error::Error;
use crate::settings::Settings;

/// A renderer with its options, independent of the settings.
#[derive(Debug, Clone, PartialEq)]
pub enum RendererSpec {
    /// Counts of discrete rays, the paper's method.
    Rays {
        /// Which points of a spheroid shine.
        spheroids: SpheroidLaw,
    },
    /// The limit of infinitely many rays, without ray noise.
    Expected {
        /// Which points of a spheroid shine.
        spheroids: SpheroidLaw,
        /// Error relative to the peak of an image (see [`super::expected::DEFAULT_TOLERANCE`]).
        tolerance: f64,
    },
    /// Wave optics with diffraction at the lens, without ray noise.
    Waves {
        /// Light and optics.
        optics: WaveOptics,
        /// The largest error relative to the peak of an image.
        tolerance: f64,
    },
    /// Gaussian spots, all in focus.
    Gaussian(GaussianSpot),
}

impl RendererSpec {
    /// The renderer for these settings.
    ///
    /// # Errors
    /// [`Error::Malformed`] if a setting or option is out of range, [`Error::Unsupported`] if the renderer
    /// cannot draw with these settings.
    pub fn build(self, settings: &Settings) -> Result<Renderer, Error> {
        Ok(match self {
            RendererSpec::Rays { spheroids } => RayRenderer::new(settings, spheroids)?.into(),
            RendererSpec::Expected { spheroids, tolerance } => {
                ExpectedRenderer::new(settings, spheroids, tolerance)?.into()
            }
            RendererSpec::Waves { optics, tolerance } => {
                WavesRenderer::new(settings, &optics, tolerance)?.into()
            }
            RendererSpec::Gaussian(spot) => GaussianRenderer::new(settings, spot)?.into(),
        })
    }

    /// What the numerical aperture must stay below: 1, or the refractive index of the immersion.
    pub fn largest_aperture(&self) -> f64 {
        match self {
            RendererSpec::Waves { optics, .. } => optics.lens.largest_aperture(optics.layers.as_ref()),
            _ => 1.0,
        }
    }

    /// The renderer of the same images without ray noise: for rays the limit of infinitely many, with this
    /// tolerance.
    pub fn without_ray_noise(self, tolerance: f64) -> RendererSpec {
        match self {
            RendererSpec::Rays { spheroids } => RendererSpec::Expected { spheroids, tolerance },
            other => other,
        }
    }

    /// The renderer used for single particles at many depths, where building tables of expected images would
    /// cost more than averaging ray images.
    pub fn for_depth_scans(self) -> RendererSpec {
        match self {
            RendererSpec::Expected { spheroids, .. } => RendererSpec::Rays { spheroids },
            other => other,
        }
    }
}

/// Any renderer; clones share its tables and working memory.
#[derive(Debug, Clone)]
pub struct Renderer(Arc<dyn Render>);

impl<R: Render + 'static> From<R> for Renderer {
    fn from(renderer: R) -> Self {
        Renderer(Arc::new(renderer))
    }
}

impl Deref for Renderer {
    type Target = dyn Render;

    fn deref(&self) -> &(dyn Render + 'static) {
        &*self.0
    }
}
