//! From light to counts: gain, background, Gaussian noise, rounding to 16 bit.
//!
//! I = gain sum_i c_int_i counts_i + background_mean + round(N(0, background_noise)), rounded and clamped to
//! [0, 65535]. The original truncates and wraps (-5 becomes 65531), which is a bug and is not followed.

use rayon::prelude::*;

use crate::settings::Settings;
use crate::stream::{Purpose, Stream, Streams};

/// A grey image of 16 bit, rows from top to bottom.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Image {
    /// Width, px.
    pub width: u32,
    /// Height, px.
    pub height: u32,
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
    noise: Option<RoundedNormal>,
}

impl Sensor {
    /// The sensor of these settings.
    pub fn new(settings: &Settings) -> Self {
        Sensor {
            gain: settings.gain,
            background_mean: settings.background_mean,
            noise: (settings.background_noise > 0.0).then(|| RoundedNormal::new(settings.background_noise)),
        }
    }

    /// The image of `light`, with the noise of `frame` from the streams of `purpose`.
    pub fn expose(&self, light: &Light, streams: &Streams, purpose: Purpose, frame: u32) -> Image {
        let mut counts = vec![0u16; light.values.len()];
        let width = light.width as usize;
        counts
            .par_chunks_mut(width)
            .zip(light.values.par_chunks(width))
            .enumerate()
            .with_min_len(16)
            .for_each(|(row, (counts, values))| {
                let mut stream = streams.stream(purpose, frame, row as u32);
                for (count, value) in counts.iter_mut().zip(values) {
                    let noise = self.noise.as_ref().map_or(0.0, |noise| f64::from(noise.sample(&mut stream)));
                    let level = self.gain * value + self.background_mean + noise;
                    // `as` clamps to the range of 16 bit.
                    *count = libm::rint(level) as u16;
                }
            });
        Image { width: light.width, height: light.height, counts }
    }
}

/// round(N(0, sigma)) by Walker's alias method (Vose 1991): one 64-bit random number a sample.
///
/// The probabilities are those of the rounded normal, cut where a tail holds less than 1e-15.
#[derive(Debug, Clone)]
pub struct RoundedNormal {
    lowest: i32,
    /// Per column: the share of 2^32 that stays in the column, and where the rest goes.
    columns: Vec<(u32, u32)>,
}

impl RoundedNormal {
    /// The distribution for a standard deviation > 0, counts.
    pub fn new(sigma: f64) -> Self {
        // Beyond 16 bit every value clamps to the same count, so the table never grows past that.
        let reach = libm::ceil(8.0 * sigma + 1.0).min(f64::from(1 << 17)) as i32;
        let below = |x: f64| 0.5 * libm::erfc(-x / (sigma * std::f64::consts::SQRT_2));
        let n = (2 * reach + 1) as usize;
        let weights: Vec<f64> = (-reach..=reach)
            .map(|k| {
                // By symmetry from the lower tail, where differences of erfc keep their digits.
                let k = -f64::from(k.abs());
                below(k + 0.5) - below(k - 0.5)
            })
            .collect();
        let total: f64 = weights.iter().sum();

        let mut scaled: Vec<f64> = weights.iter().map(|w| w / total * n as f64).collect();
        let mut columns = vec![(u32::MAX, 0u32); n];
        let (mut small, mut large): (Vec<usize>, Vec<usize>) = (0..n).partition(|&i| scaled[i] < 1.0);
        while let (Some(&poor), Some(&rich)) = (small.last(), large.last()) {
            small.pop();
            columns[poor] = ((scaled[poor] * 4_294_967_296.0) as u32, rich as u32);
            scaled[rich] -= 1.0 - scaled[poor];
            if scaled[rich] < 1.0 {
                large.pop();
                small.push(rich);
            }
        }
        for full in small.into_iter().chain(large) {
            columns[full] = (u32::MAX, full as u32);
        }
        RoundedNormal { lowest: -reach, columns }
    }

    /// One value, counts.
    pub fn sample(&self, stream: &mut Stream) -> i32 {
        let column = (u64::from(stream.next_u32()) * self.columns.len() as u64) >> 32;
        let (share, alias) = self.columns[column as usize];
        let chosen = if stream.next_u32() < share { column as u32 } else { alias };
        self.lowest + chosen as i32
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

    /// Chi-square of a million samples against the probabilities of the rounded normal.
    #[test]
    fn noise_has_the_law_of_a_rounded_normal() {
        for sigma in [0.3, 5.0, 10.0] {
            let noise = RoundedNormal::new(sigma);
            let n = 1_000_000;
            let reach = (4.0 * sigma) as i32 + 1;
            let mut histogram = vec![0.0; (2 * reach + 1) as usize];
            let mut stream = Streams::new(3).stream(Purpose::BackgroundNoise, 0, 0);
            for _ in 0..n {
                let k = noise.sample(&mut stream).clamp(-reach, reach);
                histogram[(k + reach) as usize] += 1.0;
            }
            let below = |x: f64| 0.5 * libm::erfc(-x / (sigma * std::f64::consts::SQRT_2));
            let (mut chi2, mut bins) = (0.0, 0);
            for (i, &count) in histogram.iter().enumerate() {
                let k = f64::from(i as i32 - reach);
                let low = if i == 0 { 0.0 } else { below(k - 0.5) };
                let high = if i + 1 == histogram.len() { 1.0 } else { below(k + 0.5) };
                let expected = (high - low) * f64::from(n);
                if expected > 5.0 {
                    chi2 += (count - expected) * (count - expected) / expected;
                    bins += 1;
                }
            }
            // Mean bins - 1, standard deviation sqrt(2 bins): 4 of them is one false alarm in 10,000 seeds.
            let limit = f64::from(bins) + 4.0 * (2.0 * f64::from(bins)).sqrt();
            assert!(chi2 < limit, "sigma {sigma}: chi2 {chi2}, {bins} bins");
        }
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
