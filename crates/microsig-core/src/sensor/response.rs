//! The mean response of a pixel: the noise-free counterpart of an exposure, for ground truth and expected
//! values.

use super::{ImageFormat, Sensor};

/// The mean response of a pixel to light, and the noise of its background.
///
/// Mean counts before rounding are `background + slope * light`, up to saturation. Dark-signal non-uniformity
/// and hot pixels are not included: they are a fixed pattern, not noise, which a tracker may subtract.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Response {
    /// Counts per unit of [`super::Light`].
    pub slope: f64,
    /// Mean counts without particles.
    pub background: f64,
    /// Standard deviation of the counts without particles, before rounding; 0 without noise.
    pub background_noise: f64,
    /// The counts at which the pixel saturates: full well or top of the scale, whichever is lower. Images of
    /// unrounded counts have no top of the scale; without a full well, the result is infinite.
    pub saturation_counts: f64,
}

impl Sensor {
    /// The response of a pixel, by its index in rows from the top.
    pub fn response(&self, index: usize) -> Response {
        let Some((detector, pattern)) = &self.detector else {
            return Response {
                slope: self.gain,
                background: self.background_mean,
                background_noise: self.background_noise,
                saturation_counts: self.saturation_counts(),
            };
        };
        let (pixel, own) = (pattern.at(index), detector.electronics(index));
        let electrons_per_count =
            detector.photons_per_count * detector.quantum_efficiency * pixel.sensitivity;
        let ideal = (self.background_mean + pixel.background).max(0.0);
        let electrons = ideal * electrons_per_count + detector.dark_e;
        let shot = if detector.shot_noise { electrons } else { 0.0 };
        let variance_e = shot + own.read_noise_e * own.read_noise_e;
        let camera_variance = own.gain_counts_per_e * own.gain_counts_per_e * variance_e;
        Response {
            slope: self.gain * electrons_per_count * own.gain_counts_per_e,
            background: electrons.min(detector.full_well_e) * own.gain_counts_per_e + own.offset_counts,
            background_noise: libm::sqrt(camera_variance + self.background_noise * self.background_noise),
            saturation_counts: self
                .end(detector.bits, detector.full_well_e * own.gain_counts_per_e + own.offset_counts),
        }
    }

    /// Whether any pixel may have a mean of `counts` at this light: a quick test before pixels are examined
    /// one by one.
    pub fn may_reach(&self, counts: f64, light: f64) -> bool {
        let response = self.response(0);
        self.detector.is_some() || response.background + response.slope * light >= counts
    }

    /// The counts at which a pixel saturates whose offset and gain are the means of all pixels, see
    /// [`Response::saturation_counts`].
    pub fn saturation_counts(&self) -> f64 {
        let (bits, well) = self.detector.as_ref().map_or((16, f64::INFINITY), |(detector, _)| {
            (detector.bits, detector.full_well_e * detector.gain_counts_per_e + detector.offset_counts)
        });
        self.end(bits, well)
    }

    /// The largest count of an image of this bit depth from pixels with a full well of `well` counts.
    fn end(&self, bits: u8, well: f64) -> f64 {
        match self.format {
            ImageFormat::Integer => f64::from((1u32 << bits) - 1).min(well),
            ImageFormat::Float32 => well,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::{Detector, Image, Light};
    use super::*;
    use crate::settings::Settings;
    use crate::stream::{Purpose, Streams};

    const SIDE: u32 = 160;

    fn mean_and_deviation(image: &Image) -> (f64, f64) {
        let n = image.counts.len() as f64;
        let mean = image.counts.values().sum::<f64>() / n;
        let square = |c: f64| (c - mean) * (c - mean);
        (mean, libm::sqrt(image.counts.values().map(square).sum::<f64>() / n))
    }

    /// Mean and noise of exposures of a dark and of an illuminated sensor agree with the response.
    #[test]
    fn a_response_is_the_mean_of_exposures() {
        let settings =
            Settings { pixel_dim_x: SIDE, pixel_dim_y: SIDE, background_noise: 6.0, ..Settings::setting1() };
        let streams = Streams::new(5);
        let detector = Detector {
            photons_per_count: 5.0,
            quantum_efficiency: 0.6,
            shot_noise: true,
            dark_e: 20.0,
            read_noise_e: 8.0,
            gain_counts_per_e: 0.5,
            offset_counts: 100.0,
            ..Detector::default()
        };
        let sensors = [Sensor::new(&settings), Sensor::with_detector(&settings, detector, &streams).unwrap()];
        for sensor in sensors {
            let response = sensor.response(0);
            let image = |value: f64| {
                let light = Light { width: SIDE, height: SIDE, values: vec![value; (SIDE * SIDE) as usize] };
                mean_and_deviation(&sensor.expose(&light, &streams, Purpose::BackgroundNoise, 0))
            };
            let ((dark, noise), (lit, _)) = (image(0.0), image(100.0));
            // 25,600 pixels with a noise of about 25 counts: standard errors of 0.16 for a mean and 0.5 % for
            // a standard deviation; four of each.
            assert!((dark - response.background).abs() < 0.64, "{dark} {response:?}");
            let expected = libm::sqrt(response.background_noise * response.background_noise + 1.0 / 12.0);
            assert!((noise / expected - 1.0).abs() < 0.02, "{noise} {response:?}");
            assert!((lit - dark - 100.0 * response.slope).abs() < 1.5, "{lit} {dark} {response:?}");
        }
    }

    #[test]
    fn the_full_well_or_the_scale_is_the_end() {
        let settings = Settings { pixel_dim_x: 4, pixel_dim_y: 4, ..Settings::setting1() };
        let end = |detector: Detector| {
            Sensor::with_detector(&settings, detector, &Streams::new(0)).unwrap().saturation_counts()
        };
        assert_eq!(Sensor::new(&settings).saturation_counts(), 65_535.0);
        assert_eq!(end(Detector { bits: 12, ..Detector::default() }), 4_095.0);
        assert_eq!(end(Detector { bits: 12, full_well_e: 3000.0, ..Detector::default() }), 3_000.0);
        let float = Sensor::new(&settings).with_format(ImageFormat::Float32);
        assert_eq!(float.saturation_counts(), f64::INFINITY);
    }
}
