//! Selection of a renderer; no other module distinguishes between them.
//!
//! To add a renderer, implement [`Render`] in a file of its own and add a variant to [`RendererSpec`].

use std::ops::Deref;
use std::sync::Arc;

use super::expected::ExpectedRenderer;
use super::gaussian::{GaussianRenderer, GaussianSpot};
use super::interface::{Render, Tables};
use super::rays::RayRenderer;
use super::store::Context;
use super::waves::{WaveOptics, WavesRenderer};
use crate::emission::SpheroidLaw;
use crate::error::Error;
use crate::particle::Particle;
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
    /// The renderer for these settings; `context` is what it works with.
    ///
    /// # Errors
    /// [`Error::Malformed`] if a setting or option is out of range, [`Error::Unsupported`] if the renderer
    /// cannot draw with these settings.
    pub fn build(self, settings: &Settings, context: &Context) -> Result<Renderer, Error> {
        Ok(match self {
            RendererSpec::Rays { spheroids } => RayRenderer::new(settings, spheroids)?.into(),
            RendererSpec::Expected { spheroids, tolerance } => {
                ExpectedRenderer::new(settings, spheroids, tolerance)?.within(context).into()
            }
            RendererSpec::Waves { optics, tolerance } => {
                WavesRenderer::new(settings, &optics, tolerance)?.within(context).into()
            }
            RendererSpec::Gaussian(spot) => GaussianRenderer::new(settings, spot)?.into(),
        })
    }

    /// Light and optics of images by wave optics; `None` for other renderers.
    pub fn wave_optics(&self) -> Option<&WaveOptics> {
        match self {
            RendererSpec::Waves { optics, .. } => Some(optics),
            _ => None,
        }
    }

    /// The parameters of Gaussian spots; `None` for renderers of an optical model.
    pub fn spot(&self) -> Option<GaussianSpot> {
        match self {
            RendererSpec::Gaussian(spot) => Some(*spot),
            _ => None,
        }
    }

    /// Which points of a spheroid shine; all, where there is no choice.
    pub fn spheroid_law(&self) -> SpheroidLaw {
        match self {
            RendererSpec::Rays { spheroids } | RendererSpec::Expected { spheroids, .. } => *spheroids,
            RendererSpec::Waves { .. } | RendererSpec::Gaussian(_) => SpheroidLaw::Uniform,
        }
    }

    /// The error of images relative to their peaks, where it is a choice.
    pub fn tolerance(&self) -> Option<f64> {
        match self {
            RendererSpec::Expected { tolerance, .. } | RendererSpec::Waves { tolerance, .. } => {
                Some(*tolerance)
            }
            RendererSpec::Rays { .. } | RendererSpec::Gaussian(_) => None,
        }
    }

    /// The renderer of noise-free images of spheres with derivatives that comes nearest to this one.
    pub fn with_derivatives(self, tolerance: f64) -> RendererSpec {
        match self {
            RendererSpec::Waves { optics, .. } => RendererSpec::Waves { optics, tolerance },
            _ => RendererSpec::Expected { spheroids: SpheroidLaw::Original, tolerance },
        }
    }

    /// What the numerical aperture must stay below: 1, or the refractive index of the immersion.
    pub fn largest_aperture(&self) -> f64 {
        self.wave_optics().map_or(1.0, |optics| optics.lens.largest_aperture(optics.layers.as_ref()))
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

impl Renderer {
    /// [`super::Traits::name`].
    pub fn name(&self) -> &'static str {
        self.traits().name
    }

    /// [`super::Traits::depends_on_depth`].
    pub fn depends_on_depth(&self) -> bool {
        self.traits().depends_on_depth
    }

    /// [`super::Traits::has_ray_noise`].
    pub fn has_ray_noise(&self) -> bool {
        self.traits().has_ray_noise
    }

    /// [`super::Traits::is_diffracted`].
    pub fn is_diffracted(&self) -> bool {
        self.traits().is_diffracted
    }

    /// [`super::Traits::spheroid_law`].
    pub fn spheroid_law(&self) -> Option<SpheroidLaw> {
        self.traits().spheroid_law
    }

    /// Whether images are drawn from tables that take long to make.
    pub fn needs_tables(&self) -> bool {
        self.tables().is_some()
    }

    /// [`Tables::missing`]; 0 without tables.
    pub fn missing_tables(&self, particles: &[Particle]) -> usize {
        self.tables().map_or(0, |tables| tables.missing(particles))
    }

    /// [`Tables::prepare`]; nothing without tables.
    pub fn prepare(&self, particles: &[&[Particle]]) {
        self.tables().into_iter().for_each(|tables| tables.prepare(particles));
    }

    /// [`Tables::shortfall`]; `None` without tables.
    pub fn shortfall(&self) -> Option<String> {
        self.tables().and_then(Tables::shortfall)
    }
}
