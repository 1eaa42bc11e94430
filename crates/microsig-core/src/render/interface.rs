//! The interface of a renderer.

use std::fmt::Debug;

use super::gradient::Gradient;
use super::patch::{ExpectedPatch, Window};
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

/// A method of computing particle images.
pub trait Render: Debug + Send + Sync {
    /// Its name in scenarios and manifests.
    fn name(&self) -> &'static str;

    /// The settings of the renderer.
    fn settings(&self) -> &Settings;

    /// Optics and method as text.
    fn description(&self) -> Description;

    /// Whether the image of a particle depends on its depth.
    fn depends_on_depth(&self) -> bool {
        true
    }

    /// Whether ray counts fluctuate as in a Poisson process (variance = mean, before gain), in addition to
    /// sensor noise.
    fn has_ray_noise(&self) -> bool {
        false
    }

    /// Selection of the source points of a spheroid. `None`: there is no choice.
    fn spheroid_law(&self) -> Option<SpheroidLaw>;

    /// Checks that this particle can be drawn, and returns a warning about its image, if any.
    ///
    /// # Errors
    /// [`Error::Unsupported`] with the reason.
    fn check(&self, particle: &Particle) -> Result<Option<String>, Error>;

    /// A warning about all images with these settings, if any.
    fn warning(&self) -> Option<String> {
        None
    }

    /// How far the images drawn so far miss the requested accuracy; `None` if they meet it.
    fn shortfall(&self) -> Option<String> {
        None
    }

    /// Half width and half height of the image of a particle, px, with some margin.
    fn image_extent(&self, particle: &Particle) -> (f64, f64);

    /// The pixels on which [`Render::mean_patch`] draws a particle, or a part of the sensor that contains
    /// them; fast once tables are made ([`Render::prepare`]).
    fn patch_window(&self, particle: &Particle) -> Window;

    /// Whether light of a particle may reach the sensor.
    fn reaches_sensor(&self, particle: &Particle) -> bool;

    /// Whether images are drawn from tables that take long to make.
    fn needs_tables(&self) -> bool {
        false
    }

    /// Number of tables that images of these particles need and that are not made yet.
    fn missing_tables(&self, particles: &[Particle]) -> usize {
        let _ = particles;
        0
    }

    /// Makes the tables that images of these particles take, once for all of them; else they are made while
    /// images are drawn.
    fn prepare(&self, particles: &[&[Particle]]) {
        let _ = particles;
    }

    /// The light of all particles of one image; `particles` are in the order of the rows of the data file.
    /// Random angles come from the streams of `purpose` and `frame`.
    fn light(&self, particles: &[Particle], streams: &Streams, purpose: Purpose, frame: u32) -> Light;

    /// The image of these particles: [`Render::light`] exposed by `sensor`, which must have the settings of
    /// the renderer.
    fn image(&self, particles: &[Particle], sensor: &Sensor, random: ImageStreams<'_>) -> Image {
        let light = self.light(particles, random.streams, random.rays, random.frame);
        sensor.expose(&light, random.streams, random.noise, random.frame)
    }

    /// The light of one particle with little or no ray noise, from which values per particle (peak, area) are
    /// computed.
    fn mean_light(&self, particle: &Particle) -> Light {
        self.light(std::slice::from_ref(particle), &Streams::new(0), Purpose::CalibrationRays, 0)
    }

    /// The mean light of one particle on the pixels that it illuminates, with its brightness and at its
    /// sub-pixel position; `None` if no light reaches the sensor.
    fn mean_patch(&self, particle: &Particle) -> Option<ExpectedPatch>;

    /// The noise-free image of one particle with its derivatives; `None` if no light reaches the sensor, and
    /// from renderers that do not compute derivatives.
    fn gradient(&self, particle: &Particle) -> Option<Gradient> {
        let _ = particle;
        None
    }

    /// The same for a sphere on the pixels of a window, which may extend beyond the sensor; `None` from
    /// renderers that do not compute derivatives.
    fn gradient_within(&self, sphere: &Particle, window: Window) -> Option<Gradient> {
        let _ = (sphere, window);
        None
    }
}
