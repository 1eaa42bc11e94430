//! The interface of a renderer.

use std::fmt::Debug;

use super::gradient::Gradient;
use super::patch::{ExpectedPatch, Window};
use super::shape::ShapeGradient;
use super::tables::TablesState;
use crate::emission::SpheroidLaw;
use crate::error::Error;
use crate::particle::Particle;
use crate::sensor::{Image, Light, Sensor};
use crate::settings::Settings;
use crate::stream::{Purpose, Streams};

/// The random streams of one image.
#[derive(Debug, Clone, Copy)]
pub struct ImageStreams<'a> {
    /// All streams of the dataset.
    pub streams: &'a Streams,
    /// Purpose of the streams of the rays' random angles.
    pub rays: Purpose,
    /// Purpose of the streams of the sensor noise.
    pub noise: Purpose,
    /// Frame number.
    pub frame: u32,
}

/// Description of a renderer for the documentation of a dataset.
#[derive(Debug, Clone, PartialEq)]
pub struct Description {
    /// The optics in one phrase.
    pub optics: String,
    /// How the image is computed; a sentence without its subject.
    pub method: &'static str,
}

/// In what the images of renderers differ.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Traits {
    /// Name of the renderer in scenarios and manifests.
    pub name: &'static str,
    /// Whether the image of a particle depends on its depth.
    pub depends_on_depth: bool,
    /// Whether ray counts fluctuate as in a Poisson process (variance = mean, before gain), in addition to
    /// sensor noise.
    pub has_ray_noise: bool,
    /// Whether light is diffracted at the lens.
    pub is_diffracted: bool,
    /// Whether the optics are round: a turn of a particle about the optical axis turns its image.
    pub is_round: bool,
    /// Selection of the source points of a spheroid. `None`: there is no choice.
    pub spheroid_law: Option<SpheroidLaw>,
}

/// A method of computing particle images.
pub trait Render: Debug + Send + Sync {
    /// How its images differ from other renderers'.
    fn traits(&self) -> Traits;

    /// The settings of the renderer.
    fn settings(&self) -> &Settings;

    /// Optics and method as text.
    fn description(&self) -> Description;

    /// Checks that this particle can be drawn, and returns a warning about its image, if any.
    fn check(&self, particle: &Particle) -> Result<Option<String>, Error>;

    /// A warning about all images with these settings, if any.
    fn warning(&self) -> Option<String> {
        None
    }

    /// Half width and half height of the image of a particle, px, with some margin.
    fn image_extent(&self, particle: &Particle) -> (f64, f64);

    /// The pixels on which [`Render::mean_patch`] draws a particle, or a part of the sensor that contains
    /// them; fast once tables are made ([`Tables::prepare`]).
    fn patch_window(&self, particle: &Particle) -> Window;

    /// Whether light of a particle may reach the sensor.
    fn reaches_sensor(&self, particle: &Particle) -> bool;

    /// The light of a particle that the aperture accepts, which an infinite sensor would record without a
    /// pupil mask, in the unit of [`Light`] at brightness 1; `None` if there is no aperture.
    fn accepted_light(&self, particle: &Particle) -> Option<f64> {
        let _ = particle;
        None
    }

    /// The tables that images are drawn from, if any.
    fn tables(&self) -> Option<&dyn Tables> {
        None
    }

    /// The light of all particles of one image; `particles` are in the order of the rows of the data file.
    /// Random angles come from the streams of `purpose` and `frame`.
    fn light(&self, particles: &[Particle], streams: &Streams, purpose: Purpose, frame: u32) -> Light;

    /// The image of these particles: [`Render::light`] exposed by `sensor`, which must have the settings of
    /// the renderer.
    fn image(&self, particles: &[Particle], sensor: &Sensor, random: ImageStreams<'_>) -> Image;

    /// The light of one particle with little or no ray noise, from which values per particle (peak, area) are
    /// computed.
    fn mean_light(&self, particle: &Particle) -> Light {
        self.light(std::slice::from_ref(particle), &Streams::new(0), Purpose::CalibrationRays, 0)
    }

    /// The mean light of one particle on the pixels that it illuminates, with its brightness and at its
    /// sub-pixel position; `None` if no light reaches the sensor.
    fn mean_patch(&self, particle: &Particle) -> Option<ExpectedPatch>;

    /// The noise-free image of one particle at brightness 1 with its derivatives: on the pixels that it
    /// illuminates, or, for a sphere, in a window, which may extend beyond the sensor. `None` if
    /// there are no such pixels, and from renderers that do not compute derivatives.
    fn gradient(&self, particle: &Particle, window: Option<Window>) -> Option<Gradient> {
        let _ = (particle, window);
        None
    }

    /// The noise-free image of one spheroid at brightness 1 with its derivatives with respect to position, axis and
    /// aspect ratio: on the pixels that it illuminates or in a window, which may extend
    /// beyond the sensor. `None` if there are no such pixels, for spheres, and from renderers that do not compute it.
    fn shape_gradient(&self, particle: &Particle, window: Option<Window>) -> Option<ShapeGradient> {
        let _ = (particle, window);
        None
    }
}

/// Tables that take long to make; those that are missing are made while images are drawn.
pub trait Tables {
    /// Number of tables that images of these particles need and that are not made yet.
    fn missing(&self, particles: &[Particle]) -> usize;

    /// Makes the tables that images of these particles take, once for all of them.
    fn prepare(&self, particles: &[&[Particle]]);

    /// Number, memory and accuracy of the tables made so far.
    fn state(&self) -> TablesState;

    /// How far the images drawn so far miss the requested accuracy; `None` if they meet it. Errors:
    /// [`Error::Unsupported`] if they err by more than ten tolerances.
    fn shortfall(&self) -> Result<Option<String>, Error>;
}
