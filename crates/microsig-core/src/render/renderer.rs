//! Selection of a renderer.
//!
//! To add a renderer, implement [`Render`] in a file of its own and add a variant to [`RenderMethod`].

use std::ops::Deref;
use std::sync::Arc;

use super::expected::ExpectedRenderer;
use super::field::FieldRenderer;
use super::gaussian::{GaussianRenderer, GaussianSpot};
use super::interface::{Render, Tables};
use super::rays::RayRenderer;
use super::store::Context;
use super::waves::{WaveOptics, WavesRenderer};
use crate::emission::SpheroidLaw;
use crate::error::Error;
use crate::optics::FieldOptics;
use crate::particle::Particle;
use crate::settings::Settings;

/// How images are computed, with options that are independent of the settings.
#[derive(Debug, Clone, PartialEq)]
#[expect(clippy::large_enum_variant, reason = "there is one per renderer")]
pub enum RenderMethod {
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

/// A renderer with its options, independent of the settings.
#[derive(Debug, Clone, PartialEq)]
pub struct RendererSpec {
    method: RenderMethod,
    blur_um: f64,
    field: FieldOptics,
    is_single: bool,
}

impl From<RenderMethod> for RendererSpec {
    /// With the blur and the field of wave optics, without any for other methods.
    fn from(method: RenderMethod) -> Self {
        let (blur_um, field) = match &method {
            RenderMethod::Waves { optics, .. } => (optics.blur_um, optics.field),
            _ => (0.0, FieldOptics::default()),
        };
        RendererSpec { method, blur_um, field, is_single: false }
    }
}

impl RendererSpec {
    /// The same with a blur by detector and relay optics (standard deviation in the particles' space, um),
    /// and optics that vary over the field.
    pub fn through(self, blur_um: f64, field: FieldOptics) -> RendererSpec {
        let method = match self.method {
            RenderMethod::Waves { optics, tolerance } => {
                RenderMethod::Waves { optics: WaveOptics { blur_um, field, ..optics }, tolerance }
            }
            other => other,
        };
        RendererSpec { method, blur_um, field, ..self }
    }

    /// The same, which computes each image for itself instead of from tables, or not.
    pub fn with_single_images(self, is_single: bool) -> RendererSpec {
        RendererSpec { is_single, ..self }
    }

    /// How images are computed.
    pub fn method(&self) -> &RenderMethod {
        &self.method
    }

    /// How the optics vary over the field of view.
    pub fn field(&self) -> &FieldOptics {
        &self.field
    }

    /// Standard deviation of the blur by detector and relay optics, in the particles' space, um.
    pub fn blur_um(&self) -> f64 {
        self.blur_um
    }

    /// The renderer for these settings; `context` is what it works with. Errors: [`Error::Malformed`] if a
    /// setting or option is out of range, [`Error::Unsupported`] if the renderer cannot draw with these
    /// settings.
    pub fn build(self, settings: &Settings, context: &Context) -> Result<Renderer, Error> {
        let RendererSpec { method, blur_um, field, is_single } = self;
        field.validate(settings)?;
        if !(0.0..=1e3).contains(&blur_um) {
            return Err(Error::Unsupported(format!("blur_um = {blur_um}: expected 0 to 1000 um")));
        }
        let blurs = matches!(method, RenderMethod::Waves { .. });
        if field.has_aberrations() && !blurs {
            return Err(Error::Unsupported(
                "coma, astigmatism and vignetting of optics.field need wave optics (mode: waves)".to_owned(),
            ));
        }
        let renderer: Renderer = match method {
            RenderMethod::Rays { spheroids } => RayRenderer::new(settings, spheroids)?.into(),
            RenderMethod::Expected { spheroids, tolerance } => {
                let renderer = ExpectedRenderer::new(settings, spheroids, tolerance)?.within(context);
                if is_single { renderer.without_tables().into() } else { renderer.into() }
            }
            RenderMethod::Waves { optics, tolerance } => {
                let renderer = WavesRenderer::new(settings, &optics, tolerance)?.within(context);
                if is_single { renderer.without_tables().into() } else { renderer.into() }
            }
            RenderMethod::Gaussian(spot) => GaussianRenderer::new(settings, spot)?.into(),
        };
        let blur_um = if blurs { 0.0 } else { blur_um };
        if field.is_uniform() && blur_um == 0.0 {
            return Ok(renderer);
        }
        Ok(FieldRenderer::new(renderer, field, blur_um).into())
    }

    /// Light and optics of images by wave optics; `None` for other renderers.
    pub fn wave_optics(&self) -> Option<&WaveOptics> {
        match &self.method {
            RenderMethod::Waves { optics, .. } => Some(optics),
            _ => None,
        }
    }

    /// The parameters of Gaussian spots; `None` for renderers of an optical model.
    pub fn spot(&self) -> Option<GaussianSpot> {
        match &self.method {
            RenderMethod::Gaussian(spot) => Some(*spot),
            _ => None,
        }
    }

    /// Which points of a spheroid shine; all, where there is no choice.
    pub fn spheroid_law(&self) -> SpheroidLaw {
        match &self.method {
            RenderMethod::Rays { spheroids } | RenderMethod::Expected { spheroids, .. } => *spheroids,
            RenderMethod::Waves { .. } | RenderMethod::Gaussian(_) => SpheroidLaw::Uniform,
        }
    }

    /// The error of images relative to their peaks, where it is a choice.
    pub fn tolerance(&self) -> Option<f64> {
        match &self.method {
            RenderMethod::Expected { tolerance, .. } | RenderMethod::Waves { tolerance, .. } => {
                Some(*tolerance)
            }
            RenderMethod::Rays { .. } | RenderMethod::Gaussian(_) => None,
        }
    }

    /// The renderer of noise-free images of spheres with derivatives that comes nearest to this one.
    pub fn with_derivatives(self, tolerance: f64) -> RendererSpec {
        self.with(|method| match method {
            RenderMethod::Waves { optics, .. } => RenderMethod::Waves { optics, tolerance },
            _ => RenderMethod::Expected { spheroids: SpheroidLaw::Original, tolerance },
        })
    }

    /// What the numerical aperture must stay below: 1, or the refractive index of the immersion.
    pub fn largest_aperture(&self) -> f64 {
        self.wave_optics().map_or(1.0, |optics| optics.lens.largest_aperture(optics.layers.as_ref()))
    }

    /// The renderer of the same images without ray noise: for rays the limit of infinitely many, with this
    /// tolerance.
    pub fn without_ray_noise(self, tolerance: f64) -> RendererSpec {
        self.with(|method| match method {
            RenderMethod::Rays { spheroids } => RenderMethod::Expected { spheroids, tolerance },
            other => other,
        })
    }

    /// The renderer used for single particles at many depths, where building tables of expected images would
    /// cost more than averaging ray images.
    pub fn for_depth_scans(self) -> RendererSpec {
        self.with(|method| match method {
            RenderMethod::Expected { spheroids, .. } => RenderMethod::Rays { spheroids },
            other => other,
        })
    }

    fn with(self, change: impl FnOnce(RenderMethod) -> RenderMethod) -> RendererSpec {
        RendererSpec { method: change(self.method), ..self }
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
    pub fn shortfall(&self) -> Result<Option<String>, Error> {
        self.tables().map_or(Ok(None), Tables::shortfall)
    }
}
