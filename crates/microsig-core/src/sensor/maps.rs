//! Offset, gain and read noise of every pixel, as measured for scientific CMOS cameras.
//!
//! Conventions as in Huang et al. 2013 (Nature Methods 10, 653): the counts of pixel i without light
//! have mean o_i (counts) and variance var_i (counts^2), and n electrons add g_i n, with a gain g_i in counts
//! per electron.

use std::sync::Arc;

use super::Detector;
use crate::error::Error;
use crate::problem::Problem;
use crate::settings::Settings;

/// One value per pixel, row by row from the top.
pub type PixelMap = Arc<[f64]>;

/// The quantities of which pixels may have values of their own; `None`: all pixels have the value of the
/// [`Detector`].
#[derive(Debug, Clone, Default, PartialEq)]
pub struct PixelMaps {
    /// Offsets, counts.
    pub offset_counts: Option<PixelMap>,
    /// Gains, counts per electron.
    pub gain_counts_per_e: Option<PixelMap>,
    /// Variances of the read noise, counts^2.
    pub variance_counts2: Option<PixelMap>,
}

/// A quantity of which pixels may have values of their own.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum PixelQuantity {
    /// The offset, counts.
    Offset,
    /// The gain, counts per electron.
    Gain,
    /// The variance of the read noise, counts^2.
    Variance,
}

impl PixelQuantity {
    fn allowed(self) -> (&'static str, fn(f64) -> bool) {
        match self {
            PixelQuantity::Offset => ("-65535 to 65535 counts", |v| v.abs() <= 65_535.0),
            PixelQuantity::Gain => ("counts per electron > 0, at most 1e12", |v| v > 0.0 && v <= 1e12),
            PixelQuantity::Variance => ("counts^2 >= 0, at most 1e12", |v| (0.0..=1e12).contains(&v)),
        }
    }

    /// Checks the values of a map of this width (px); `name` is its name in errors. Errors:
    /// [`Error::Malformed`] with the first value out of range.
    pub fn check(self, map: &[f64], width: u32, name: &str) -> Result<(), Error> {
        let (allowed, fits) = self.allowed();
        let mut wrong = map.iter().enumerate().filter(|(_, value)| !fits(**value));
        let Some((at, value)) = wrong.next() else { return Ok(()) };
        let (column, row) = (at % width as usize + 1, at / width as usize + 1);
        let more = match wrong.count() {
            0 => String::new(),
            n => format!(" ({n} more of {} pixels)", map.len()),
        };
        let message = format!("{value} in column {column}, row {row}{more}: expected {allowed}");
        Err(Error::malformed(name, message))
    }
}

/// Offset, gain and read noise of a pixel.
#[derive(Debug, Clone, Copy)]
pub(super) struct Electronics {
    pub(super) offset_counts: f64,
    pub(super) gain_counts_per_e: f64,
    pub(super) read_noise_e: f64,
}

impl PixelMaps {
    fn all(&self) -> [(PixelQuantity, &Option<PixelMap>); 3] {
        [
            (PixelQuantity::Offset, &self.offset_counts),
            (PixelQuantity::Gain, &self.gain_counts_per_e),
            (PixelQuantity::Variance, &self.variance_counts2),
        ]
    }

    /// What is wrong with the maps for the sensor of these settings.
    pub(super) fn problems(&self, settings: &Settings) -> Vec<Problem> {
        let (width, height) = (settings.pixel_dim_x, settings.pixel_dim_y);
        let pixels = width as usize * height as usize;
        let mut problems = Vec::new();
        for (quantity, map) in self.all() {
            let Some(map) = map else { continue };
            let name = format!("detector: map of {quantity:?}");
            if map.len() != pixels {
                let (found, allowed) = (format!("{} values", map.len()), format!("{pixels}, one per pixel"));
                problems.push(Problem::value("", found, &allowed).within(name));
            } else if let Err(Error::Malformed(found)) = quantity.check(map, width, &name) {
                problems.extend(found);
            }
        }
        problems
    }
}

/// The part of a map of the sensor `whole` that the sensor `part` at this corner (left and top, px from 0)
/// sees.
fn cropped(map: &[f64], whole: &Settings, part: &Settings, [left, top]: [u32; 2]) -> Vec<f64> {
    let (from, width) = (left as usize, part.pixel_dim_x as usize);
    let rows = map.chunks(whole.pixel_dim_x as usize).skip(top as usize).take(part.pixel_dim_y as usize);
    rows.flat_map(|row| row[from..from + width].iter().copied()).collect()
}

impl Detector {
    /// The detector with pixels of their own; the values that the maps replace become their means (of the
    /// variance, for the read noise).
    pub fn with_maps(self, maps: PixelMaps) -> Self {
        let mean =
            |map: &Option<PixelMap>| Some(map.as_ref()?.iter().sum::<f64>() / map.as_ref()?.len() as f64);
        let gain_counts_per_e = mean(&maps.gain_counts_per_e).unwrap_or(self.gain_counts_per_e);
        let read_noise_e = mean(&maps.variance_counts2)
            .map_or(self.read_noise_e, |variance| libm::sqrt(variance) / gain_counts_per_e);
        let offset_counts = mean(&maps.offset_counts).unwrap_or(self.offset_counts);
        Detector { offset_counts, gain_counts_per_e, read_noise_e, maps, ..self }
    }

    /// The detector with the background image and the maps of the part of its sensor at this corner (left and
    /// top, px from 0).
    pub fn cropped(&self, whole: &Settings, part: &Settings, corner: [u32; 2]) -> Self {
        let of = |map: &Option<PixelMap>| map.as_ref().map(|map| cropped(map, whole, part, corner).into());
        let maps = PixelMaps {
            offset_counts: of(&self.maps.offset_counts),
            gain_counts_per_e: of(&self.maps.gain_counts_per_e),
            variance_counts2: of(&self.maps.variance_counts2),
        };
        let background = self.background.as_ref().map(|counts| cropped(counts, whole, part, corner));
        Detector { background, maps, ..self.clone() }
    }

    /// Offset, gain and read noise of a pixel.
    pub(super) fn electronics(&self, index: usize) -> Electronics {
        let PixelMaps { offset_counts, gain_counts_per_e, variance_counts2 } = &self.maps;
        let gain = gain_counts_per_e.as_ref().map_or(self.gain_counts_per_e, |map| map[index]);
        Electronics {
            offset_counts: offset_counts.as_ref().map_or(self.offset_counts, |map| map[index]),
            gain_counts_per_e: gain,
            read_noise_e: variance_counts2
                .as_ref()
                .map_or(self.read_noise_e, |map| libm::sqrt(map[index]) / gain),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::detector::tests::without_background;
    use super::super::{Light, Sensor};
    use super::*;
    use crate::stream::{Purpose, Streams};

    const SIDE: u32 = 24;
    const PIXELS: usize = (SIDE * SIDE) as usize;
    const FRAMES: u32 = 600;
    /// Variance of rounding to whole counts.
    const ROUNDING: f64 = 1.0 / 12.0;

    /// Maps in which no two quantities are correlated.
    fn maps() -> PixelMaps {
        let map = |of: fn(usize) -> f64| Some((0..PIXELS).map(of).collect());
        PixelMaps {
            offset_counts: map(|i| 100.0 + (i % 37) as f64 * 0.3),
            gain_counts_per_e: map(|i| 1.5 + (i % 23) as f64 * 0.05),
            variance_counts2: map(|i| 2.0 + (i % 31) as f64 + if i % 97 == 0 { 400.0 } else { 0.0 }),
        }
    }

    /// Mean and variance of each pixel over many frames of this light.
    fn statistics(detector: &Detector, light: f64) -> Vec<(f64, f64)> {
        let streams = Streams::new(11);
        let sensor = Sensor::with_detector(&without_background(SIDE), detector.clone(), &streams).unwrap();
        let light = Light { width: SIDE, height: SIDE, values: vec![light; PIXELS] };
        let mut sums = vec![(0.0, 0.0); PIXELS];
        for frame in 0..FRAMES {
            let image = sensor.expose(&light, &streams, Purpose::BackgroundNoise, frame);
            for (sum, count) in sums.iter_mut().zip(image.counts.values()) {
                *sum = (sum.0 + count, sum.1 + count * count);
            }
        }
        let n = f64::from(FRAMES);
        sums.iter().map(|(a, b)| (a / n, (b - a * a / n) / (n - 1.0))).collect()
    }

    /// Means by their standard errors and variances by chi-square: of each pixel, and of all together.
    fn assert_agree(found: &[(f64, f64)], expected: impl Iterator<Item = (f64, f64)>) {
        let n = f64::from(FRAMES);
        let (mut chi2_of_means, mut chi2_of_variances) = (0.0, 0.0);
        for (at, (found, (mean, variance))) in found.iter().zip(expected).enumerate() {
            let off = (found.0 - mean) / (variance / n).sqrt();
            let chi2 = (n - 1.0) * found.1 / variance;
            // One false alarm in 3000 choices of the seed for the mean, and somewhat more for the variance,
            // whose distribution is skewed.
            assert!(off.abs() < 5.0, "pixel {at}: mean {} instead of {mean}", found.0);
            assert!(
                (chi2 - n + 1.0).abs() < 5.5 * (2.0 * n).sqrt(),
                "pixel {at}: {} for {variance}",
                found.1
            );
            chi2_of_means += off * off;
            chi2_of_variances += chi2;
        }
        let (means, variances) = (found.len() as f64, found.len() as f64 * (n - 1.0));
        assert!((chi2_of_means - means).abs() < 4.0 * (2.0 * means).sqrt(), "{chi2_of_means} of {means}");
        let off = (chi2_of_variances - variances).abs();
        assert!(off < 4.0 * (2.0 * variances).sqrt(), "{chi2_of_variances} of {variances}");
    }

    /// The offset is not a whole number and the noise is well above one count, so that rounding neither shifts
    /// the mean nor changes the variance by more than 1/12.
    #[test]
    fn dark_frames_have_the_offset_and_the_variance_of_each_pixel() {
        let maps = maps();
        let (offset, variance) =
            (maps.offset_counts.clone().unwrap(), maps.variance_counts2.clone().unwrap());
        let dark = statistics(&Detector::default().with_maps(maps), 0.0);
        assert_agree(&dark, offset.iter().zip(&*variance).map(|(o, v)| (*o, v + ROUNDING)));
    }

    /// The mean of flat frames rises with the gain, and the variance of shot noise with its square: the photon
    /// transfer by which gains are measured.
    #[test]
    fn flat_frames_have_the_gain_of_each_pixel() {
        let maps = maps();
        let [offset, gain, variance] = [&maps.offset_counts, &maps.gain_counts_per_e, &maps.variance_counts2]
            .map(|m| m.clone().unwrap());
        let camera = Detector { shot_noise: true, ..Detector::default() }.with_maps(maps);
        let flat = statistics(&camera, 900.0);
        let expected = (0..PIXELS)
            .map(|i| (offset[i] + 900.0 * gain[i], variance[i] + 900.0 * gain[i] * gain[i] + ROUNDING));
        assert_agree(&flat, expected.clone());
        let sensor = Sensor::with_detector(&without_background(SIDE), camera, &Streams::new(11)).unwrap();
        for (i, (mean, _)) in expected.enumerate() {
            let response = sensor.response(i);
            assert!((response.background + 900.0 * response.slope - mean).abs() < 1e-9);
            assert!((response.background_noise * response.background_noise - variance[i]).abs() < 1e-9);
        }
    }

    #[test]
    fn equal_pixels_make_the_images_of_a_camera_without_maps() {
        let equal = |value: f64| Some(vec![value; PIXELS].into());
        let maps = PixelMaps {
            offset_counts: equal(100.0),
            gain_counts_per_e: equal(0.5),
            variance_counts2: equal(4.0),
        };
        let camera = Detector { shot_noise: true, full_well_e: 1e4, prnu: 0.02, ..Detector::default() };
        let without =
            Detector { offset_counts: 100.0, gain_counts_per_e: 0.5, read_noise_e: 4.0, ..camera.clone() };
        let with = camera.with_maps(maps);
        assert_eq!(Detector { maps: PixelMaps::default(), ..with.clone() }, without);
        let streams = Streams::new(2);
        let [with, without] =
            [with, without].map(|d| Sensor::with_detector(&without_background(SIDE), d, &streams).unwrap());
        let light =
            Light { width: SIDE, height: SIDE, values: (0..PIXELS).map(|i| 40.0 * i as f64).collect() };
        let image = |sensor: &Sensor| sensor.expose(&light, &streams, Purpose::BackgroundNoise, 0);
        assert_eq!(image(&with), image(&without));
        assert_eq!(with.response(7), without.response(7));
    }

    #[test]
    fn a_pixel_saturates_at_its_own_full_well() {
        let maps = maps();
        let (offset, gain) = (maps.offset_counts.clone().unwrap(), maps.gain_counts_per_e.clone().unwrap());
        let camera = Detector { full_well_e: 1000.0, ..Detector::default() }
            .with_maps(PixelMaps { variance_counts2: None, ..maps });
        let full = statistics(&camera, 1e5);
        let sensor = Sensor::with_detector(&without_background(SIDE), camera, &Streams::new(0)).unwrap();
        for (i, (mean, _)) in full.iter().enumerate() {
            assert!((mean - offset[i] - 1000.0 * gain[i]).abs() <= 0.5);
            assert!((sensor.response(i).saturation_counts - offset[i] - 1000.0 * gain[i]).abs() < 1e-9);
        }
    }

    #[test]
    fn a_part_of_the_sensor_keeps_its_pixels() {
        let part = Settings { pixel_dim_x: 3, pixel_dim_y: 2, ..without_background(SIDE) };
        let camera = Detector::default().with_maps(maps());
        let cropped = camera.cropped(&without_background(SIDE), &part, [5, 7]);
        for (i, whole) in [(0, 7 * 24 + 5), (2, 7 * 24 + 7), (3, 8 * 24 + 5), (5, 8 * 24 + 7)] {
            let [a, b] = [cropped.electronics(i), camera.electronics(whole)];
            assert_eq!((a.offset_counts, a.gain_counts_per_e), (b.offset_counts, b.gain_counts_per_e));
            assert_eq!(a.read_noise_e, b.read_noise_e);
        }
        assert!(Sensor::with_detector(&part, cropped, &Streams::new(0)).is_ok());
    }

    #[test]
    fn wrong_maps_are_told_with_pixel_value_and_range() {
        let small = Settings { pixel_dim_x: 3, pixel_dim_y: 2, ..without_background(SIDE) };
        let gain = |map: Vec<f64>| {
            let maps = PixelMaps { gain_counts_per_e: Some(map.into()), ..PixelMaps::default() };
            Detector::default().with_maps(maps).validate(&small).unwrap_err().to_string()
        };
        let message = gain(vec![1.0, 1.0, 1.0, 1.0, 0.0, -0.5]);
        let expected = "map of Gain: 0 in column 2, row 2 (1 more of 6 pixels): expected counts per electron > 0, at most 1e12";
        assert!(message.contains(expected), "{message}");
        assert!(gain(vec![1.0; 5]).contains("5 values: expected 6, one per pixel"));
        for (quantity, value) in [
            (PixelQuantity::Offset, 7e4),
            (PixelQuantity::Offset, f64::NAN),
            (PixelQuantity::Gain, f64::INFINITY),
            (PixelQuantity::Variance, -1e-9),
        ] {
            let message = quantity.check(&[1.0, value], 2, "m.tif").unwrap_err().to_string();
            assert!(
                message.starts_with(&format!("m.tif: {value} in column 2, row 1: expected ")),
                "{message}"
            );
        }
    }
}
