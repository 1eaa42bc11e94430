//! The sensor: conversion of light to counts.
//!
//! MicroSIG's sensor model consists of gain, background, Gaussian noise and rounding to 16 bit: I = gain
//! sum_i c_int_i counts_i + background_mean + round(N(0, background_noise)), rounded and clamped to [0,
//! 65535]. Rounded noise does not dither: light below half a count is lost. With [`NoiseRounding::AfterSum`]
//! the noise is added before rounding, so that counts are unbiased. The original program truncates and wraps
//! around (-5 becomes 65531), which is a bug and is not reproduced. A [`Detector`] adds the signal chain of a
//! camera. With [`ImageFormat::Float32`] an image holds what would be rounded and clamped.

mod detector;
mod image;
mod maps;
#[cfg(target_arch = "x86_64")]
mod registers;
mod response;
mod rounded_normal;

pub use detector::{Detector, HotPixels};
pub use image::{Counts, Image, ImageFormat};
pub use maps::{PixelMap, PixelMaps, PixelQuantity};
pub use response::Response;
use rounded_normal::NormalSteps;
pub use rounded_normal::RoundedNormal;

use std::ops::Range;

use rayon::prelude::*;

use crate::error::Error;
use crate::pool::BufferPool;
use crate::settings::Settings;
use crate::stream::{Purpose, Stream, Streams};
use detector::FixedPattern;
use image::Pixel;

/// Light on the sensor: ray counts per pixel, weighted with the particles' c_int.
#[derive(Debug, Clone, PartialEq)]
pub struct Light {
    /// Width, px.
    pub width: u32,
    /// Height, px.
    pub height: u32,
    /// Weighted ray counts of `width * height` pixels, row by row from the top.
    pub values: Vec<f64>,
}

impl Light {
    /// Zero light on the sensor of these settings.
    pub fn dark(settings: &Settings) -> Self {
        let (width, height) = (settings.pixel_dim_x, settings.pixel_dim_y);
        Light { width, height, values: vec![0.0; width as usize * height as usize] }
    }
}

/// When the background noise of a pixel is rounded to integer counts.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum NoiseRounding {
    /// Before it is added, as in MicroSIG; the sum is rounded again.
    #[default]
    BeforeSum,
    /// Only in the sum of light, background and noise: counts are unbiased.
    AfterSum,
}

/// The distribution of the background noise.
#[derive(Debug, Clone)]
enum Noise {
    Rounded(RoundedNormal),
    Unrounded(NormalSteps),
}

/// A sensor, which converts [`Light`] to an [`Image`].
#[derive(Debug, Clone)]
pub struct Sensor {
    gain: f64,
    background_mean: f64,
    background_noise: f64,
    noise: Option<Noise>,
    detector: Option<(Detector, FixedPattern)>,
    format: ImageFormat,
    /// Working memory for [`Sensor::expose_bands`], reused from image to image.
    bands: BufferPool<Vec<f64>>,
}

impl Sensor {
    /// MicroSIG's sensor with these settings.
    pub fn new(settings: &Settings) -> Self {
        Sensor {
            gain: settings.gain,
            background_mean: settings.background_mean,
            background_noise: settings.background_noise,
            noise: (settings.background_noise > 0.0)
                .then(|| Noise::Rounded(RoundedNormal::new(settings.background_noise))),
            detector: None,
            format: ImageFormat::Integer,
            bands: BufferPool::default(),
        }
    }

    /// The sensor with these settings and the signal chain of a camera, whose fixed pattern is drawn from
    /// `streams`.
    pub fn with_detector(settings: &Settings, detector: Detector, streams: &Streams) -> Result<Self, Error> {
        detector.validate(settings)?;
        let pattern = FixedPattern::new(&detector, settings, streams);
        Ok(Sensor { detector: Some((detector, pattern)), ..Sensor::new(settings) })
    }

    /// The same sensor with this rounding of its background noise.
    pub fn with_rounding(self, rounding: NoiseRounding) -> Self {
        let sigma = self.background_noise;
        let noise = (sigma > 0.0).then(|| match rounding {
            NoiseRounding::BeforeSum => Noise::Rounded(RoundedNormal::new(sigma)),
            NoiseRounding::AfterSum => Noise::Unrounded(NormalSteps::new(sigma)),
        });
        Sensor { noise, ..self }
    }

    /// The same sensor with images in this format.
    pub fn with_format(self, format: ImageFormat) -> Self {
        Sensor { format, ..self }
    }

    /// The image of `light`, with the noise of `frame` from the streams of `purpose`.
    pub fn expose(&self, light: &Light, streams: &Streams, purpose: Purpose, frame: u32) -> Image {
        let (size, rows) = ((light.width, light.height), light.height as usize);
        self.expose_parts(size, rows, streams, purpose, frame, |_| &light.values)
    }

    /// The same for light of a large image: `make` is called with the rows (from 0) of one part after the
    /// other, of `rows` rows (the last may have fewer), and returns their light. The size is (width, height),
    /// px.
    pub fn expose_parts<L: AsRef<[f64]>>(
        &self,
        size: (u32, u32),
        rows: usize,
        streams: &Streams,
        purpose: Purpose,
        frame: u32,
        make: impl FnMut(Range<usize>) -> L,
    ) -> Image {
        let row_stream = |row: usize| streams.stream(purpose, frame, row as u32);
        match self.format {
            ImageFormat::Integer => self.image(size, Counts::Whole(self.parts(size, rows, row_stream, make))),
            ImageFormat::Float32 => {
                self.image(size, Counts::Unrounded(self.parts(size, rows, row_stream, make)))
            }
        }
    }

    fn parts<P: Pixel, L: AsRef<[f64]>>(
        &self,
        (width, height): (u32, u32),
        rows: usize,
        stream: impl Fn(usize) -> Stream + Sync,
        mut make: impl FnMut(Range<usize>) -> L,
    ) -> Vec<P> {
        let width = width as usize;
        let mut counts = vec![P::default(); width * height as usize];
        for (part, counts) in counts.chunks_mut((rows * width).max(1)).enumerate() {
            let first = part * rows;
            let light = make(first..first + counts.len() / width);
            let rows = counts.par_chunks_mut(width).zip(light.as_ref().par_chunks(width)).enumerate();
            rows.with_min_len(16).for_each_init(
                || RowBuffers::new(width),
                |buffers, (row, (counts, values))| {
                    self.expose_row(first + row, values, stream(first + row), buffers, counts);
                },
            );
        }
        counts
    }

    /// The same for light that is computed band by band in parallel: `make` is called with the
    /// first row (from 0) of each band of `rows` rows (the last may have fewer) and writes the light on all
    /// pixels of the band. The size is (width, height), px.
    pub fn expose_bands(
        &self,
        size: (u32, u32),
        rows: usize,
        streams: &Streams,
        purpose: Purpose,
        frame: u32,
        make: impl Fn(usize, &mut [f64]) + Sync,
    ) -> Image {
        let row_stream = |row: usize| streams.stream(purpose, frame, row as u32);
        match self.format {
            ImageFormat::Integer => self.image(size, Counts::Whole(self.bands(size, rows, row_stream, make))),
            ImageFormat::Float32 => {
                self.image(size, Counts::Unrounded(self.bands(size, rows, row_stream, make)))
            }
        }
    }

    fn bands<P: Pixel>(
        &self,
        (width, height): (u32, u32),
        rows: usize,
        stream: impl Fn(usize) -> Stream + Sync,
        make: impl Fn(usize, &mut [f64]) + Sync,
    ) -> Vec<P> {
        let columns = width as usize;
        let mut counts = vec![P::default(); columns * height as usize];
        let bands = counts.par_chunks_mut(rows * columns).enumerate();
        let buffers = || {
            let mut light = self.bands.get();
            light.resize(rows * columns, 0.0);
            (light, RowBuffers::new(columns))
        };
        bands.for_each_init(buffers, |(light, buffers), (band, counts)| {
            let (first, light) = (band * rows, &mut light[..counts.len()]);
            make(first, light);
            let row_pairs = counts.chunks_exact_mut(columns).zip(light.chunks_exact(columns));
            for (row, (counts, values)) in (first..).zip(row_pairs) {
                self.expose_row(row, values, stream(row), buffers, counts);
            }
        });
        counts
    }

    fn image(&self, (width, height): (u32, u32), counts: Counts) -> Image {
        let bits = match counts {
            Counts::Whole(_) => self.detector.as_ref().map_or(16, |(detector, _)| detector.bits),
            Counts::Unrounded(_) => Image::FLOAT_BITS,
        };
        Image { width, height, bits, counts }
    }

    fn expose_row<P: Pixel>(
        &self,
        row: usize,
        values: &[f64],
        mut stream: Stream,
        buffers: &mut RowBuffers,
        counts: &mut [P],
    ) {
        if let Some((detector, pattern)) = &self.detector {
            let largest = f64::from((1u32 << detector.bits) - 1);
            for (column, (count, value)) in counts.iter_mut().zip(values).enumerate() {
                let ideal = self.gain * value + self.background_mean;
                let index = row * values.len() + column;
                let (pixel, electronics) = (pattern.at(index), detector.electronics(index));
                let level = detector.respond(ideal, pixel, electronics, &mut stream);
                let noise = match &self.noise {
                    None => 0.0,
                    Some(Noise::Rounded(law)) => f64::from(law.sample(stream.next_u32())),
                    Some(Noise::Unrounded(law)) => law.sample([stream.next_u32(), stream.next_u32()]),
                };
                *count = P::of(level + noise, largest);
            }
            return;
        }
        let RowBuffers { random, noise } = buffers;
        let width = values.len();
        let mut unrounded = None;
        match &self.noise {
            // The noise buffer is zero.
            None => {}
            Some(Noise::Rounded(law)) => {
                stream.fill(&mut random[..width]);
                law.sample_all(&random[..width], noise);
            }
            Some(Noise::Unrounded(law)) => {
                stream.fill(random);
                law.sample_steps(&random[..width], noise);
                unrounded = Some((law.step(), &random[width..]));
            }
        }
        match unrounded {
            None => pulp::Arch::new().dispatch(MicrosigRow { sensor: self, values, noise, counts }),
            Some((step, within)) => {
                pulp::Arch::new().dispatch(UnroundedRow {
                    sensor: self,
                    values,
                    noise,
                    step,
                    within,
                    counts,
                });
            }
        }
    }
}

/// Buffers for the random numbers and the noise of a row.
struct RowBuffers {
    random: Vec<u32>,
    noise: Vec<i32>,
}

impl RowBuffers {
    fn new(width: usize) -> Self {
        RowBuffers { random: vec![0; 2 * width], noise: vec![0; width] }
    }
}

/// Largest count of MicroSIG's sensor.
const LARGEST: f64 = 65_535.0;

/// Exposure of a row by MicroSIG's sensor, compiled for every instruction set.
struct MicrosigRow<'a, P> {
    sensor: &'a Sensor,
    values: &'a [f64],
    noise: &'a [i32],
    counts: &'a mut [P],
}

impl<P: Pixel> pulp::WithSimd for MicrosigRow<'_, P> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: pulp::Simd>(self, _: S) {
        let (gain, background) = (self.sensor.gain, self.sensor.background_mean);
        for ((count, value), noise) in self.counts.iter_mut().zip(self.values).zip(self.noise) {
            let level = gain * value + background + f64::from(*noise);
            *count = P::of(level, LARGEST);
        }
    }
}

/// Exposure of a row with noise rounded in the sum: noise in steps, and positions within a step in units of
/// 2^-32.
struct UnroundedRow<'a, P> {
    sensor: &'a Sensor,
    values: &'a [f64],
    noise: &'a [i32],
    step: f64,
    within: &'a [u32],
    counts: &'a mut [P],
}

impl<P: Pixel> pulp::WithSimd for UnroundedRow<'_, P> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: pulp::Simd>(self, _: S) {
        let (gain, background) = (self.sensor.gain, self.sensor.background_mean);
        let random = self.noise.iter().zip(self.within);
        for ((count, value), (&noise, &within)) in self.counts.iter_mut().zip(self.values).zip(random) {
            let level = gain * value + background + self.step * rounded_normal::place(noise, within);
            *count = P::of(level, LARGEST);
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
        let expose =
            |v| sensor.expose(&flat(v, 1), &Streams::new(0), Purpose::BackgroundNoise, 0).counts.whole()[0];
        assert_eq!([expose(-5.0), expose(0.4), expose(0.6), expose(70_000.0)], [0, 0, 1, 65_535]);
    }

    /// Rounding and clamping are all that is between the two formats, whatever the noise and the camera.
    #[test]
    fn whole_counts_are_rounded_unrounded_ones() {
        let settings =
            Settings { pixel_dim_x: 64, pixel_dim_y: 64, background_mean: -1.0, ..Settings::setting1() };
        let light =
            Light { width: 64, height: 64, values: (0..64 * 64).map(|i| 6.0 * f64::from(i)).collect() };
        let camera = Detector { shot_noise: true, read_noise_e: 2.0, bits: 12, ..Detector::default() };
        let streams = Streams::new(3);
        let plain = Sensor::new(&settings);
        let quiet = Sensor::new(&Settings { background_noise: 0.0, ..settings.clone() });
        let with_camera = Sensor::with_detector(&settings, camera, &streams).unwrap();
        for (sensor, largest) in [(plain, 65_535.0), (quiet, 65_535.0), (with_camera, 4_095.0)] {
            for rounding in [NoiseRounding::BeforeSum, NoiseRounding::AfterSum] {
                let sensor = sensor.clone().with_rounding(rounding);
                let of = |format| {
                    let sensor = sensor.clone().with_format(format);
                    let image = sensor.expose(&light, &streams, Purpose::BackgroundNoise, 0);
                    let rows = |first: usize, out: &mut [f64]| {
                        out.copy_from_slice(&light.values[64 * first..][..out.len()]);
                    };
                    let banded =
                        sensor.expose_bands((64, 64), 5, &streams, Purpose::BackgroundNoise, 0, rows);
                    assert_eq!(image, banded);
                    let part = |rows: Range<usize>| &light.values[64 * rows.start..64 * rows.end];
                    let in_parts =
                        sensor.expose_parts((64, 64), 5, &streams, Purpose::BackgroundNoise, 0, part);
                    assert_eq!(image, in_parts);
                    image
                };
                let (whole, unrounded) = (of(ImageFormat::Integer), of(ImageFormat::Float32));
                assert_eq!(unrounded.bits, 32);
                let differ = |(whole, unrounded): (f64, f64)| {
                    let rounded = unrounded.clamp(0.0, largest);
                    // Numbers of f32 near ties may round to the other side.
                    (whole - rounded).abs() > 0.5 + 4e-3
                };
                assert!(!whole.counts.values().zip(unrounded.counts.values()).any(differ), "{rounding:?}");
                assert!(unrounded.counts.values().any(|count| count > largest || largest == 65_535.0));
            }
        }
    }

    /// The mean of exposures follows the light in steps far below one count.
    #[test]
    fn noise_rounded_with_the_sum_dithers() {
        const N: usize = 400_000;
        for sigma in [0.5, 3.0, 10.0] {
            let settings = Settings {
                background_mean: 100.0,
                background_noise: sigma,
                gain: 1.0,
                ..Settings::setting1()
            };
            let sensor = Sensor::new(&settings).with_rounding(NoiseRounding::AfterSum);
            for value in [0.0, 0.2, 0.4, 0.5, 0.7] {
                let image = sensor.expose(&flat(value, N), &Streams::new(2), Purpose::BackgroundNoise, 0);
                let counts = image.counts.values().map(|count| count - 100.0);
                let mean = counts.clone().sum::<f64>() / N as f64;
                let variance = counts.map(|c| (c - mean) * (c - mean)).sum::<f64>() / N as f64;
                // The exact distribution of a rounded sum: normal probabilities of the intervals about
                // integer counts.
                let below = |x: f64| 0.5 * libm::erfc((value - x) / (sigma * std::f64::consts::SQRT_2));
                let law = (-100..=100)
                    .map(|k| (f64::from(k), below(f64::from(k) + 0.5) - below(f64::from(k) - 0.5)));
                let exact: f64 = law.clone().map(|(k, p)| k * p).sum();
                let exact_variance: f64 = law.map(|(k, p)| (k - exact) * (k - exact) * p).sum();
                // Five standard errors; the error of the histogram approximation is far below.
                let error = 5.0 * (exact_variance / N as f64).sqrt();
                assert!((mean - exact).abs() < error, "{sigma} {value}: {mean} {exact}");
                let error = 5.0 * exact_variance * (2.0 / N as f64).sqrt();
                assert!(
                    (variance - exact_variance).abs() < error,
                    "{sigma} {value}: {variance} {exact_variance}"
                );
                // Half a count is dithered.
                assert!((exact - value).abs() < 0.003, "{sigma} {value}: {exact}");
            }
        }
    }
}
