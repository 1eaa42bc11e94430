//! From light to counts.
//!
//! MicroSIG's own sensor is gain, background, Gaussian noise and rounding to 16 bit: I = gain sum_i c_int_i counts_i +
//! background_mean + round(N(0, background_noise)), rounded and clamped to
//! [0, 65535]. The original truncates and wraps (-5 becomes 65531), which is a bug and is not followed. A [`Detector`] puts a
//! camera's own chain between light and counts.

mod detector;
#[cfg(target_arch = "x86_64")]
mod registers;
mod response;
mod rounded_normal;

pub use detector::{Detector, HotPixels};
pub use response::Response;
pub use rounded_normal::RoundedNormal;

use rayon::prelude::*;

use crate::error::Error;
use crate::settings::Settings;
use crate::shelf::Shelf;
use crate::stream::{Purpose, Stream, Streams};
use detector::FixedPattern;

/// A grey image of 8 to 16 bit, rows from top to bottom.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Image {
    /// Width, px.
    pub width: u32,
    /// Height, px.
    pub height: u32,
    /// Bits of a count, 8 to 16.
    pub bits: u8,
    /// Counts, `width * height` of them, row by row.
    pub counts: Vec<u16>,
}

/// Ray counts per pixel weighted with the particles' c_int, rows from top to bottom.
#[derive(Debug, Clone, PartialEq)]
pub struct Light {
    /// Width, px.
    pub width: u32,
    /// Height, px.
    pub height: u32,
    /// Weighted counts, `width * height` of them, row by row.
    pub values: Vec<f64>,
}

impl Light {
    /// A dark sensor.
    pub fn dark(settings: &Settings) -> Self {
        let (width, height) = (settings.pixel_dim_x, settings.pixel_dim_y);
        Light { width, height, values: vec![0.0; width as usize * height as usize] }
    }
}

/// The sensor's response to light.
#[derive(Debug, Clone)]
pub struct Sensor {
    gain: f64,
    background_mean: f64,
    background_noise: f64,
    noise: Option<RoundedNormal>,
    detector: Option<(Detector, FixedPattern)>,
    /// Memory for light that is exposed where it is made, kept from image to image.
    bands: Shelf<Vec<f64>>,
}

impl Sensor {
    /// MicroSIG's sensor of these settings.
    pub fn new(settings: &Settings) -> Self {
        Sensor {
            gain: settings.gain,
            background_mean: settings.background_mean,
            background_noise: settings.background_noise,
            noise: (settings.background_noise > 0.0).then(|| RoundedNormal::new(settings.background_noise)),
            detector: None,
            bands: Shelf::default(),
        }
    }

    /// The sensor of these settings with a camera's chain behind it, whose fixed pattern comes from `streams`.
    ///
    /// # Errors
    /// [`Error::Malformed`] if a value of the detector is out of range.
    pub fn with_detector(settings: &Settings, detector: Detector, streams: &Streams) -> Result<Self, Error> {
        detector.validate(settings)?;
        let pattern = FixedPattern::new(&detector, settings, streams);
        Ok(Sensor { detector: Some((detector, pattern)), ..Sensor::new(settings) })
    }

    /// The image of `light`, with the noise of `frame` from the streams of `purpose`.
    pub fn expose(&self, light: &Light, streams: &Streams, purpose: Purpose, frame: u32) -> Image {
        let width = light.width as usize;
        self.image((light.width, light.height), |counts| {
            let rows = counts.par_chunks_mut(width).zip(light.values.par_chunks(width)).enumerate();
            rows.with_min_len(16).for_each_init(
                || Buffers::new(width),
                |buffers, (row, (counts, values))| {
                    let stream = streams.stream(purpose, frame, row as u32);
                    self.expose_row(row, values, stream, buffers, counts);
                },
            );
        })
    }

    /// The same image of light that is made while it is exposed: `make` is called with the first row, from 0, of each band of
    /// `rows` rows (the last one may have fewer) and writes what light falls on all of the band's pixels. The size is width and
    /// height, px.
    pub fn expose_bands(
        &self,
        (width, height): (u32, u32),
        rows: usize,
        streams: &Streams,
        purpose: Purpose,
        frame: u32,
        make: impl Fn(usize, &mut [f64]) + Sync,
    ) -> Image {
        let columns = width as usize;
        self.image((width, height), |counts| {
            let bands = counts.par_chunks_mut(rows * columns).enumerate();
            let buffers = || {
                let mut light = self.bands.lend();
                light.resize(rows * columns, 0.0);
                (light, Buffers::new(columns))
            };
            bands.for_each_init(buffers, |(light, buffers), (band, counts)| {
                let (first, light) = (band * rows, &mut light[..counts.len()]);
                make(first, light);
                let of_rows = counts.chunks_exact_mut(columns).zip(light.chunks_exact(columns));
                for (row, (counts, values)) in (first..).zip(of_rows) {
                    let stream = streams.stream(purpose, frame, row as u32);
                    self.expose_row(row, values, stream, buffers, counts);
                }
            });
        })
    }

    fn image(&self, (width, height): (u32, u32), fill: impl FnOnce(&mut [u16])) -> Image {
        let mut counts = vec![0; width as usize * height as usize];
        fill(&mut counts);
        Image {
            width,
            height,
            bits: self.detector.as_ref().map_or(16, |(detector, _)| detector.bits),
            counts,
        }
    }

    fn expose_row(
        &self,
        row: usize,
        values: &[f64],
        mut stream: Stream,
        buffers: &mut Buffers,
        counts: &mut [u16],
    ) {
        if let Some((detector, pattern)) = &self.detector {
            let largest = f64::from((1u32 << detector.bits) - 1);
            for (column, (count, value)) in counts.iter_mut().zip(values).enumerate() {
                let ideal = self.gain * value + self.background_mean;
                let pixel = pattern.at(row * values.len() + column);
                let level = detector.respond(ideal, pixel, &mut stream);
                let noise = self.noise.as_ref().map_or(0, |noise| noise.sample(stream.next_u32()));
                *count = libm::rint(level + f64::from(noise)).clamp(0.0, largest) as u16;
            }
            return;
        }
        let Buffers { random, noise } = buffers;
        if let Some(law) = &self.noise {
            stream.fill(random);
            law.sample_all(random, noise);
        }
        // Without noise they are still zero.
        pulp::Arch::new().dispatch(Row { sensor: self, values, noise, counts });
    }
}

/// Random numbers and noise of a row.
struct Buffers {
    random: Vec<u32>,
    noise: Vec<i32>,
}

impl Buffers {
    fn new(width: usize) -> Self {
        Buffers { random: vec![0; width], noise: vec![0; width] }
    }
}

/// A row of MicroSIG's own sensor, compiled for every instruction set.
struct Row<'a> {
    sensor: &'a Sensor,
    values: &'a [f64],
    noise: &'a [i32],
    counts: &'a mut [u16],
}

impl pulp::WithSimd for Row<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: pulp::Simd>(self, _: S) {
        /// 2^52: added to a number of [0, 2^52) it leaves the nearest integer (ties to even) in the low bits.
        const ROUND: f64 = 4_503_599_627_370_496.0;
        let (gain, background) = (self.sensor.gain, self.sensor.background_mean);
        for ((count, value), noise) in self.counts.iter_mut().zip(self.values).zip(self.noise) {
            let level = gain * value + background + f64::from(*noise);
            *count = (level.clamp(0.0, 65_535.0) + ROUND).to_bits() as u16;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn flat(value: f64, n: usize) -> Light {
        Light { width: n as u32, height: 1, values: vec![value; n] }
    }

    #[test]
    fn counts_clamp_and_never_wrap() {
        let settings =
            Settings { background_mean: 0.0, background_noise: 0.0, gain: 1.0, ..Settings::setting1() };
        let sensor = Sensor::new(&settings);
        let expose = |v| sensor.expose(&flat(v, 1), &Streams::new(0), Purpose::BackgroundNoise, 0).counts[0];
        assert_eq!([expose(-5.0), expose(0.4), expose(0.6), expose(70_000.0)], [0, 0, 1, 65_535]);
    }

    #[test]
    fn rows_and_frames_have_noise_of_their_own() {
        let settings = Settings { pixel_dim_x: 64, pixel_dim_y: 64, ..Settings::setting1() };
        let sensor = Sensor::new(&settings);
        let dark = Light::dark(&settings);
        let image = |frame| sensor.expose(&dark, &Streams::new(1), Purpose::BackgroundNoise, frame);
        assert_eq!(image(0), image(0));
        assert_ne!(image(0), image(1));
        let first = image(0);
        assert_ne!(first.counts[..64], first.counts[64..128]);
    }
}
