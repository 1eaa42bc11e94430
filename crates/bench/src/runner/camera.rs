//! From particles to an image file.

use std::io::Cursor;
use std::path::Path;

use microsig_core::Particle;
use microsig_core::formats::tiff::{self, PixelScale};
use microsig_core::render::Renderer;
use microsig_core::sensor::{Detector, Image, Sensor};
use microsig_core::shelf::{Lent, Shelf};
use microsig_core::stream::{Purpose, Streams};

use crate::dataset::save_bytes;
use crate::error::Result;

/// Renderer, sensor and random streams: all that turns particles into an image.
#[derive(Debug)]
pub struct Camera {
    renderer: Renderer,
    sensor: Sensor,
    scale: PixelScale,
    streams: Streams,
    rays: Purpose,
    noise: Purpose,
    files: Shelf<Vec<u8>>,
}

impl Camera {
    /// The camera of a measurement; without a detector it is MicroSIG's own sensor.
    pub fn new(renderer: Renderer, detector: Option<&Detector>, streams: Streams) -> Result<Self> {
        let settings = renderer.settings();
        Ok(Camera {
            sensor: match detector {
                None => Sensor::new(settings),
                Some(detector) => Sensor::with_detector(settings, detector.clone(), &streams)?,
            },
            scale: PixelScale { um_per_px: settings.um_per_px(), frame_interval_s: None },
            renderer,
            streams,
            rays: Purpose::Rays,
            noise: Purpose::BackgroundNoise,
            files: Shelf::default(),
        })
    }

    /// The same camera with the random streams of a calibration.
    pub fn calibrating(self) -> Self {
        Camera { rays: Purpose::CalibrationRays, noise: Purpose::CalibrationNoise, ..self }
    }

    /// The same camera, taking frames at an interval, which its image files tell.
    pub fn every(self, interval_s: f64) -> Self {
        Camera { scale: PixelScale { frame_interval_s: Some(interval_s), ..self.scale }, ..self }
    }

    /// The renderer.
    pub fn renderer(&self) -> &Renderer {
        &self.renderer
    }

    /// The image of one frame; the particles are the rows of its data file, in their order.
    pub fn image(&self, particles: &[Particle], frame: u32) -> Image {
        match &self.renderer {
            // The same image, without memory for the light of all of it.
            Renderer::Gaussian(spots) => {
                spots.image(particles, &self.sensor, &self.streams, self.noise, frame)
            }
            Renderer::Expected(expected) => {
                expected.image(particles, &self.sensor, &self.streams, self.noise, frame)
            }
            Renderer::Rays(rays) => {
                let light = rays.light(particles, &self.streams, self.rays, frame);
                self.sensor.expose(&light, &self.streams, self.noise, frame)
            }
        }
    }

    /// Writes an image as TIFF with its scale, and gives the file's bytes.
    pub(crate) fn save(&self, path: &Path, image: &Image) -> Result<Lent<'_, Vec<u8>>> {
        let mut bytes = self.files.lend();
        tiff::write(Cursor::new(&mut *bytes), image, &self.scale, &path.display().to_string())?;
        save_bytes(path, &bytes)?;
        Ok(bytes)
    }
}
