//! Renders particles to images and image files.

use std::io::{Seek, Write};
use std::path::Path;

use microsig_core::formats::tiff::{self, PixelScale, StackPlane};
use microsig_core::render::{ImageStreams, Renderer};
use microsig_core::sensor::{Detector, Image, Light, Sensor};
use microsig_core::stream::{Purpose, Streams};
use microsig_core::{Particle, Settings};

use scenario::{Scenario, sensor};
use storage::error::Result;

/// Renderer, sensor and random streams: everything needed to make an image of particles.
#[derive(Debug)]
pub struct Camera {
    renderer: Renderer,
    sensor: Sensor,
    scale: PixelScale,
    streams: Streams,
    rays: Purpose,
    noise: Purpose,
}

impl Camera {
    /// The camera of a dataset with this renderer and detector; without a detector, its sensor is MicroSIG's
    /// own.
    pub fn of_dataset(scenario: &Scenario, renderer: Renderer, detector: Option<&Detector>) -> Result<Self> {
        let streams = scenario.streams;
        let sensor = sensor(renderer.settings(), detector, scenario.spec.image_format(), &streams)?;
        Ok(Camera::new(renderer, sensor, streams))
    }

    /// A camera with the given sensor.
    pub fn new(renderer: Renderer, sensor: Sensor, streams: Streams) -> Self {
        Camera {
            sensor,
            scale: PixelScale::um_per_px(renderer.settings().um_per_px()),
            renderer,
            streams,
            rays: Purpose::Rays,
            noise: Purpose::BackgroundNoise,
        }
    }

    /// The camera with the random streams of the calibration stack.
    pub fn calibrating(self) -> Self {
        Camera { rays: Purpose::CalibrationRays, noise: Purpose::CalibrationNoise, ..self }
    }

    /// The camera with a frame interval (s), which is written to its image files.
    pub fn every(self, interval_s: f64) -> Self {
        Camera { scale: PixelScale { frame_interval_s: Some(interval_s), ..self.scale }, ..self }
    }

    /// The renderer.
    pub fn renderer(&self) -> &Renderer {
        &self.renderer
    }

    /// The image of one frame; the particles are the rows of its data file, in their order.
    pub fn image(&self, particles: &[Particle], frame: u32) -> Image {
        let random = ImageStreams { streams: &self.streams, rays: self.rays, noise: self.noise, frame };
        self.renderer.image(particles, &self.sensor, random)
    }

    /// The part of one frame that a sensor of this size at this corner (left and top, px from 0) sees;
    /// particles are at their places in the whole frame, on which the optics may depend.
    pub fn part(
        &self,
        particles: &[Particle],
        frame: u32,
        (sensor, size): (&Sensor, &Settings),
        [left, top]: [u32; 2],
    ) -> Image {
        let whole = self.renderer.light(particles, &self.streams, self.rays, frame);
        let mut part = Light::dark(size);
        let (from, width) = (left as usize, part.width as usize);
        let rows = whole.values.chunks(whole.width as usize).skip(top as usize);
        for (own, row) in part.values.chunks_mut(width).zip(rows) {
            own.copy_from_slice(&row[from..from + width]);
        }
        sensor.expose(&part, &self.streams, self.noise, frame)
    }

    /// Writes an image as TIFF with its scale. `plane`: its place in a stack; `name`: of the file, for
    /// messages.
    pub fn write_tiff(
        &self,
        writer: impl Write + Seek,
        image: &Image,
        plane: Option<StackPlane>,
        name: &Path,
    ) -> Result<()> {
        let scale = PixelScale { plane, ..self.scale };
        Ok(tiff::write(writer, image, &scale, &name.display().to_string())?)
    }
}
