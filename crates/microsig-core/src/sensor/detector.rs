//! The signal chain of a camera: photons, electrons, counts (terms as in EMVA 1288).
//!
//! The ideal image (MicroSIG's counts without noise) times `photons_per_count`, attenuated by vignetting, is
//! the mean number of photons of a pixel. Quantum efficiency and the sensitivity of the pixel convert photons
//! to electrons, to which dark electrons are added; the number of electrons is Poisson-distributed (shot
//! noise). Read noise is added, the sum is limited to the full-well capacity, the system gain converts it to
//! counts, and the offset is added; `image.rs` rounds the result and clamps it to the bit depth. MicroSIG's
//! `background_mean` is treated as light; its `background_noise` is added to the counts. Offset, gain and read
//! noise are the same for all pixels, or vary as in [`PixelMaps`].
//!
//! All effects are off in [`Detector::default`]: one photon per count, one electron per photon, no noise, 16
//! bit.

use super::maps::{Electronics, PixelMaps};
use crate::error::Error;
use crate::problem::Problems;
use crate::random::{normal, poisson};
use crate::settings::Settings;
use crate::stream::{Purpose, Stream, Streams};

/// Parameters of a camera.
#[derive(Debug, Clone, PartialEq)]
pub struct Detector {
    /// Photons per count of the ideal image, > 0.
    pub photons_per_count: f64,
    /// Quantum efficiency, electrons per photon, in (0, 1].
    pub quantum_efficiency: f64,
    /// Whether the number of electrons is Poisson-distributed.
    pub shot_noise: bool,
    /// Mean number of dark electrons per pixel and frame (dark current times exposure time), >= 0.
    pub dark_e: f64,
    /// Standard deviation of the read noise, electrons, >= 0.
    pub read_noise_e: f64,
    /// Full-well capacity, electrons, > 0, may be infinite.
    pub full_well_e: f64,
    /// System gain, counts per electron, > 0.
    pub gain_counts_per_e: f64,
    /// Offset: counts of a pixel without electrons.
    pub offset_counts: f64,
    /// Bit depth: 8, 10, 12, 14 or 16.
    pub bits: u8,
    /// Photo-response non-uniformity: relative standard deviation of the pixels' sensitivities, 0 to 0.3.
    pub prnu: f64,
    /// Dark-signal non-uniformity: standard deviation of the pixels' dark electrons, >= 0.
    pub dsnu_e: f64,
    /// Pixels with a large dark signal.
    pub hot_pixels: Option<HotPixels>,
    /// Fraction of light lost in the corners, 0 to 1; the loss is proportional to the squared distance from
    /// the center.
    pub vignetting: f64,
    /// Counts added to the ideal image, one value per pixel, row by row.
    pub background: Option<Vec<f64>>,
    /// Offset, gain and read noise of pixels that have their own, see [`Detector::with_maps`].
    pub maps: PixelMaps,
}

/// Pixels with a large dark signal.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize, schemars::JsonSchema)]
pub struct HotPixels {
    /// Fraction of hot pixels.
    #[schemars(range(min = 0.0, max = 1.0))]
    pub fraction: f64,
    /// Dark electrons of a hot pixel per frame, in addition to `dark_e`.
    #[schemars(range(min = 0.0, max = 1e12))]
    pub dark_e: f64,
}

impl Default for Detector {
    fn default() -> Self {
        Detector {
            photons_per_count: 1.0,
            quantum_efficiency: 1.0,
            shot_noise: false,
            dark_e: 0.0,
            read_noise_e: 0.0,
            full_well_e: f64::INFINITY,
            gain_counts_per_e: 1.0,
            offset_counts: 0.0,
            bits: 16,
            prnu: 0.0,
            dsnu_e: 0.0,
            hot_pixels: None,
            vignetting: 0.0,
            background: None,
            maps: PixelMaps::default(),
        }
    }
}

impl Detector {
    /// Checks all values. Errors: [`Error::Malformed`] with every value out of range.
    pub fn validate(&self, settings: &Settings) -> Result<(), Error> {
        let mut problems = Problems::default();
        let mut check = |name: &str, value: f64, fits: bool, allowed: &str| {
            problems.unless(fits && !value.is_nan(), name, value, allowed);
        };
        let finite = |v: f64| (0.0..=1e12).contains(&v);
        let positive = |v: f64| v > 0.0 && v <= 1e12;
        check("photons_per_count", self.photons_per_count, positive(self.photons_per_count), "a number > 0");
        let qe = self.quantum_efficiency;
        check("quantum_efficiency", qe, qe > 0.0 && qe <= 1.0, "a number > 0, at most 1");
        check("dark_e", self.dark_e, finite(self.dark_e), "a number >= 0");
        check("read_noise_e", self.read_noise_e, finite(self.read_noise_e), "a number >= 0");
        check("full_well_e", self.full_well_e, self.full_well_e > 0.0, "a number > 0, or inf");
        check("gain_counts_per_e", self.gain_counts_per_e, positive(self.gain_counts_per_e), "a number > 0");
        check("offset_counts", self.offset_counts, self.offset_counts.abs() <= 65_535.0, "-65535 to 65535");
        check("bits", f64::from(self.bits), [8, 10, 12, 14, 16].contains(&self.bits), "8, 10, 12, 14 or 16");
        check("prnu", self.prnu, (0.0..=0.3).contains(&self.prnu), "0 to 0.3");
        check("dsnu_e", self.dsnu_e, finite(self.dsnu_e), "a number >= 0");
        check("vignetting", self.vignetting, (0.0..=1.0).contains(&self.vignetting), "0 to 1");
        if let Some(hot) = self.hot_pixels {
            check("hot_pixels.fraction", hot.fraction, (0.0..=1.0).contains(&hot.fraction), "0 to 1");
            check("hot_pixels.dark_e", hot.dark_e, finite(hot.dark_e), "a number >= 0");
        }
        if let Some(background) = &self.background {
            let pixels = settings.pixel_dim_x as usize * settings.pixel_dim_y as usize;
            let fits = background.len() == pixels && background.iter().all(|v| v.is_finite());
            let allowed = format!("{pixels} finite values, one per pixel");
            check("background", background.len() as f64, fits, &allowed);
            let mean = background.iter().sum::<f64>() / pixels as f64;
            check("mean of the background", mean, !fits || mean >= 0.0, "0 counts or more");
        }
        let mut problems = problems.within("detector");
        problems.0.extend(self.maps.problems(settings));
        problems.finish(Error::Malformed)
    }

    /// Counts, before rounding, of a pixel with `ideal` counts in the ideal image.
    pub(super) fn respond(
        &self,
        ideal: f64,
        pixel: PixelResponse,
        electronics: Electronics,
        stream: &mut Stream,
    ) -> f64 {
        let Electronics { offset_counts, gain_counts_per_e, read_noise_e } = electronics;
        let photons = (ideal + pixel.background).max(0.0) * self.photons_per_count;
        let mean = (photons * self.quantum_efficiency * pixel.sensitivity + pixel.dark_e).max(0.0);
        let mut electrons = mean;
        if self.shot_noise {
            electrons = fluctuating(mean, stream);
        }
        if read_noise_e > 0.0 {
            electrons += read_noise_e * normal(stream);
        }
        electrons.min(self.full_well_e) * gain_counts_per_e + offset_counts
    }
}

/// A Poisson-distributed number; above a mean of 1e7, where the skewness is below 3.2e-4, a normal
/// approximation.
fn fluctuating(mean: f64, stream: &mut Stream) -> f64 {
    if mean <= crate::random::MAX_POISSON_MEAN {
        poisson(stream, mean) as f64
    } else {
        mean + libm::sqrt(mean) * normal(stream)
    }
}

/// The fixed-pattern parameters of a pixel.
#[derive(Debug, Clone, Copy)]
pub(super) struct PixelResponse {
    /// Vignetting times sensitivity, relative to the ideal pixel.
    pub(super) sensitivity: f64,
    dark_e: f64,
    pub(super) background: f64,
}

/// The fixed pattern of all pixels of a camera.
#[derive(Debug, Clone)]
pub(super) struct FixedPattern {
    pixels: Vec<PixelResponse>,
}

impl FixedPattern {
    pub(super) fn new(detector: &Detector, settings: &Settings, streams: &Streams) -> Self {
        let (width, height) = (settings.pixel_dim_x, settings.pixel_dim_y);
        let (half_x, half_y) = (f64::from(width) / 2.0, f64::from(height) / 2.0);
        let corner2 = half_x * half_x + half_y * half_y;
        let mut pixels = Vec::with_capacity(width as usize * height as usize);
        for row in 0..height {
            let mut stream = streams.stream(Purpose::FixedPattern, 0, row);
            for column in 0..width {
                // All numbers are drawn even if not used, so that switching one effect on does not change the
                // others.
                let (response, dark, hot) = (normal(&mut stream), normal(&mut stream), stream.uniform());
                let (x, y) = (f64::from(column) + 0.5 - half_x, f64::from(row) + 0.5 - half_y);
                let vignetting = 1.0 - detector.vignetting * (x * x + y * y) / corner2;
                let hot_e = detector.hot_pixels.filter(|h| hot < h.fraction).map_or(0.0, |h| h.dark_e);
                let index = pixels.len();
                pixels.push(PixelResponse {
                    sensitivity: (1.0 + detector.prnu * response).max(0.0) * vignetting,
                    dark_e: detector.dark_e + detector.dsnu_e * dark + hot_e,
                    background: detector.background.as_ref().map_or(0.0, |b| b[index]),
                });
            }
        }
        FixedPattern { pixels }
    }

    pub(super) fn at(&self, index: usize) -> PixelResponse {
        self.pixels[index]
    }
}

#[cfg(test)]
pub(super) mod tests {
    use super::super::{Image, Light, Sensor};
    use super::*;

    const SIDE: u32 = 200;

    /// Settings of a sensor of this side without a background of MicroSIG's.
    pub(in super::super) fn without_background(side: u32) -> Settings {
        Settings {
            pixel_dim_x: side,
            pixel_dim_y: side,
            background_mean: 0.0,
            background_noise: 0.0,
            gain: 1.0,
            ..Settings::setting1()
        }
    }

    fn image(detector: Detector, level: f64, frame: u32) -> Image {
        let streams = Streams::new(5);
        let sensor = Sensor::with_detector(&without_background(SIDE), detector, &streams).unwrap();
        let light = Light { width: SIDE, height: SIDE, values: vec![level; (SIDE * SIDE) as usize] };
        sensor.expose(&light, &streams, Purpose::BackgroundNoise, frame)
    }

    fn mean_variance(values: impl Iterator<Item = f64> + Clone) -> (f64, f64) {
        let n = values.clone().count() as f64;
        let mean = values.clone().sum::<f64>() / n;
        (mean, values.map(|v| (v - mean) * (v - mean)).sum::<f64>() / (n - 1.0))
    }

    fn counts(image: &Image) -> impl Iterator<Item = f64> + Clone {
        image.counts.values()
    }

    #[test]
    fn the_default_detector_is_microsigs_sensor() {
        let plain = Sensor::new(&without_background(SIDE));
        let light = Light { width: SIDE, height: SIDE, values: (0..SIDE * SIDE).map(f64::from).collect() };
        let expose = |s: &Sensor| s.expose(&light, &Streams::new(5), Purpose::BackgroundNoise, 0);
        let with =
            Sensor::with_detector(&without_background(SIDE), Detector::default(), &Streams::new(5)).unwrap();
        assert_eq!(expose(&with), expose(&plain));
    }

    /// Photon transfer curve: the slope of variance over mean is the system gain, the intercept gives the
    /// read noise.
    #[test]
    fn the_photon_transfer_curve_has_the_set_gain() {
        let camera = Detector {
            shot_noise: true,
            read_noise_e: 8.0,
            gain_counts_per_e: 0.45,
            offset_counts: 100.0,
            ..Default::default()
        };
        let dark = mean_variance(counts(&image(camera.clone(), 0.0, 0)));
        // Rounding to integer counts adds 1/12. The standard error of a variance from 40,000 pixels is 0.7 %.
        let read_noise_e = (dark.1 - 1.0 / 12.0).sqrt() / 0.45;
        assert!((read_noise_e / 8.0 - 1.0).abs() < 0.02, "{read_noise_e}");
        let (mut xy, mut xx) = (0.0, 0.0);
        for (frame, level) in [2e3, 5e3, 1e4, 2e4, 4e4, 8e4].into_iter().enumerate() {
            let (mean, variance) = mean_variance(counts(&image(camera.clone(), level, frame as u32)));
            // Least squares through the dark point with weights 1/mean^2 (the error of a variance is
            // proportional to it).
            xy += (variance - dark.1) / (mean - dark.0);
            xx += 1.0;
        }
        assert!((xy / xx / 0.45 - 1.0).abs() < 0.01, "{}", xy / xx);
    }

    #[test]
    fn the_fixed_pattern_stays_from_frame_to_frame() {
        let camera = Detector { prnu: 0.02, dsnu_e: 30.0, ..Default::default() };
        let (dark, bright) = (image(camera.clone(), 1000.0, 0), image(camera.clone(), 20_000.0, 1));
        assert_eq!(dark, image(camera, 1000.0, 7), "no other noise, so frames are equal");
        let difference = counts(&bright).zip(counts(&dark)).map(|(b, d)| (b - d) / 19_000.0);
        let prnu = mean_variance(difference).1.sqrt();
        // The standard error of a standard deviation from 40,000 pixels is 0.35 %.
        assert!((prnu / 0.02 - 1.0).abs() < 0.02, "{prnu}");
    }

    #[test]
    fn the_full_well_cuts_and_bit_depths_use_their_full_range() {
        let full = Detector { full_well_e: 9000.0, ..Default::default() };
        let largest =
            |detector, level| image(detector, level, 0).counts.whole().iter().copied().max().unwrap();
        // Without noise the full well is recovered exactly.
        assert_eq!(largest(full, 50_000.0), 9000);
        for (bits, top) in [(8, 255), (10, 1023), (12, 4095), (14, 16_383), (16, 65_535)] {
            let camera = Detector { bits, shot_noise: true, ..Default::default() };
            let ramp: Vec<f64> = (0..SIDE * SIDE)
                .map(|i| f64::from(i) / f64::from(SIDE * SIDE) * 1.5 * f64::from(top))
                .collect();
            let sensor = Sensor::with_detector(&without_background(SIDE), camera, &Streams::new(1)).unwrap();
            let light = Light { width: SIDE, height: SIDE, values: ramp };
            let image = sensor.expose(&light, &Streams::new(1), Purpose::BackgroundNoise, 0);
            let counts = image.counts.whole();
            assert_eq!((counts.iter().min(), counts.iter().max()), (Some(&0), Some(&top)));
            // The last quarter is at 1.125 to 1.5 times the top of the scale; a value that wrapped around
            // would be dark.
            assert!(counts[(SIDE * SIDE * 3 / 4) as usize..].iter().all(|&c| c > top / 2), "{bits} bit");
        }
    }

    #[test]
    fn light_falls_off_toward_the_corners_and_hot_pixels_glow() {
        let image = image(Detector { vignetting: 0.4, ..Default::default() }, 10_000.0, 0);
        let at = |x: u32, y: u32| f64::from(image.counts.whole()[(y * SIDE + x) as usize]);
        assert!((at(SIDE / 2, SIDE / 2) / 10_000.0 - 1.0).abs() < 0.001);
        // The center of the corner pixel is 1 % closer to the center of the image than the corner.
        assert!((at(0, 0) / 6000.0 - 1.0).abs() < 0.01);
        let hot = HotPixels { fraction: 0.01, dark_e: 5000.0 };
        let dark = super::tests::image(Detector { hot_pixels: Some(hot), ..Default::default() }, 0.0, 0);
        let share =
            dark.counts.whole().iter().filter(|&&c| c == 5000).count() as f64 / f64::from(SIDE * SIDE);
        // The standard deviation of a fraction of 1 % of 40,000 pixels is 0.0005.
        assert!((share - 0.01).abs() < 0.002, "{share}");
    }

    #[test]
    fn wrong_values_are_named_with_their_range() {
        let wrong = Detector {
            quantum_efficiency: 1.5,
            bits: 9,
            full_well_e: f64::NAN,
            background: Some(vec![1.0]),
            ..Default::default()
        };
        let message = wrong.validate(&without_background(SIDE)).unwrap_err().to_string();
        assert_eq!(message.lines().count(), 4, "{message}");
        assert!(message.contains("bits = 9: expected 8, 10, 12, 14 or 16"), "{message}");
    }

    #[test]
    fn a_background_is_not_negative_on_average() {
        let settings = Settings { pixel_dim_x: 2, pixel_dim_y: 1, ..Settings::setting1() };
        let validated = |background: [f64; 2]| {
            Detector { background: Some(background.to_vec()), ..Detector::default() }.validate(&settings)
        };
        assert!(validated([-1.0, 3.0]).is_ok());
        let message = validated([-3.0, 1.0]).unwrap_err().to_string();
        assert!(message.contains("mean of the background = -1"), "{message}");
    }
}
