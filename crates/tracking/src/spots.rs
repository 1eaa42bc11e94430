//! In-focus particle images of similar size, located in the image plane.
//!
//! The Laplacian of a Gaussian of standard deviation r / sqrt(2) responds most strongly to discs of radius r
//! (Lindeberg 1998, Int. J. Comput. Vis. 30, 79). Its local maxima above the noise are particles, refined by
//! three-point Gaussian fits along x and y. Strongly defocused images break up into pieces of their rings, so
//! the method is suitable for images in focus only.

use super::gray_image::{GrayImage, three_points};
use super::{Localization, Method};

/// Detection threshold, in standard deviations of the noise of the filter response: 0.03 ghosts in an image of
/// 256 x 256 px.
const ABOVE_NOISE: f32 = 4.5;

/// Images larger than this many times --diameter count as defocused for this method.
const MUCH_LARGER: f64 = 2.0;

pub(super) const METHOD: Method = Method {
    name: "spots",
    about: "Particles in focus, in the image plane (Laplacian of Gaussian), linked",
    run: |job| {
        let (images_px, diameter_px) = (job.recording.image_diameter_px(), job.options.diameter_px);
        images_px.and_then(|px| defocused(px, diameter_px)).into_iter().for_each(|w| job.warn(w));
        let detector = LogDetector::new(job.options.diameter_px);
        let output = job.particles(|_, image| detector.find(image))?;
        if output.rows() == 0 {
            job.warn(format!(
                "no particles found: nothing of {} px in diameter exceeds {ABOVE_NOISE} standard deviations of \
                 the noise; defocused images need `ncc`, `mle` or `aptv`",
                job.options.diameter_px
            ));
        }
        Ok(output)
    },
};

/// A warning if particle images have this diameter (px) on average, more than the method is designed for.
fn defocused(images_px: f64, diameter_px: f64) -> Option<String> {
    (images_px > MUCH_LARGER * diameter_px).then(|| {
        format!(
            "particle images of this dataset are {images_px:.0} px in diameter on average over depth, and images of \
            {diameter_px} px are searched for: this method detects a defocused image as several spots or not at all, and measures no depth; use \
            `ncc`, `mle` or `aptv`"
        )
    })
}

/// Detects particle images of a given size.
#[derive(Debug)]
pub(super) struct LogDetector {
    sigma_px: f32,
}

impl LogDetector {
    pub(super) fn new(diameter_px: f64) -> Self {
        LogDetector { sigma_px: (0.5 * diameter_px / 2.0f64.sqrt()).max(0.5) as f32 }
    }

    pub(super) fn find(&self, image: &GrayImage) -> Vec<Localization> {
        let (w, h) = (image.width, image.height);
        if w < 3 || h < 3 {
            return Vec::new();
        }
        let smooth = image.smoothed(self.sigma_px);
        let value = |x: usize, y: usize| smooth.counts[y * w + x];
        let answer = laplacian(&smooth);
        // Where particle images touch, they dominate the median response of this filter, less the finest
        // detail of the image.
        let gain = self.noise_gain();
        let noise = rounded_noise(image)
            .map_or_else(|| answer.noise().min(gain * pixel_noise(image)), |noise| gain * noise);
        // Lower limit for noise-free images, above rounding errors.
        let threshold = (ABOVE_NOISE * noise).max(1e-3);
        let (level, _) = image.background();
        let mut found = Vec::new();
        for y in 1..h - 1 {
            for x in 1..w - 1 {
                let here = answer.counts[y * w + x];
                if here <= threshold || !is_maximum(&answer, x, y) {
                    continue;
                }
                let peak = |x: usize, y: usize| value(x, y) - level;
                let dx = three_points(peak(x - 1, y), peak(x, y), peak(x + 1, y));
                let dy = three_points(peak(x, y - 1), peak(x, y), peak(x, y + 1));
                found.push(Localization {
                    x_px: x as f64 + 1.0 + f64::from(dx),
                    y_px: y as f64 + 1.0 + f64::from(dy),
                    ..Localization::default()
                });
            }
        }
        found
    }

    /// Standard deviation of the filter response relative to white noise in the image.
    fn noise_gain(&self) -> f32 {
        let center = (6.0 * self.sigma_px).ceil() as usize + 2;
        let side = 2 * center + 1;
        let point = GrayImage::from_fn((side, side), |x, y| f32::from(u8::from((x, y) == (center, center))));
        let response = laplacian(&point.smoothed(self.sigma_px));
        response.counts.iter().map(|v| v * v).sum::<f32>().sqrt()
    }
}

/// The negative Laplacian, of second differences.
fn laplacian(image: &GrayImage) -> GrayImage {
    let (w, h) = (image.width, image.height);
    let value = |x: usize, y: usize| image.counts[y * w + x];
    GrayImage::from_fn((w, h), |x, y| {
        let (left, right) = (value(x.saturating_sub(1), y), value((x + 1).min(w - 1), y));
        let (up, down) = (value(x, y.saturating_sub(1)), value(x, (y + 1).min(h - 1)));
        4.0 * value(x, y) - left - right - up - down
    })
}

/// Second differences along x of those along y: a pattern without the finest detail has none.
fn differences(image: &GrayImage) -> GrayImage {
    let w = image.width;
    GrayImage::from_fn((w - 2, image.height - 2), |x, y| {
        let row = |v: usize| {
            let at = v * w + x;
            image.counts[at] - 2.0 * image.counts[at + 1] + image.counts[at + 2]
        };
        row(y) - 2.0 * row(y + 1) + row(y + 2)
    })
}

/// Standard deviation of white noise relative to its [`differences`]: the squares of their weights sum to 36.
const OF_DIFFERENCES: f32 = 1.0 / 6.0;

/// Standard deviation of white noise (Immerkaer 1996, Comput. Vis. Image Underst. 64, 300; here with a median).
fn pixel_noise(image: &GrayImage) -> f32 {
    OF_DIFFERENCES * differences(image).noise()
}

/// Noise of less than one count in an image of whole counts, whose median tells little or nothing: most pixels do not show
/// it. From the mean square of small differences, and no less than the error of rounding.
fn rounded_noise(image: &GrayImage) -> Option<f32> {
    let least = 1.0 / 12.0f32.sqrt();
    let median = pixel_noise(image);
    if median >= 1.0 || image.counts.iter().any(|count| count.fract() != 0.0) {
        return None;
    }
    let limit = ABOVE_NOISE * median.max(least) / OF_DIFFERENCES;
    let squares = differences(image).counts.into_iter().filter(|d| d.abs() <= limit).map(|d| d * d);
    let (sum, n) = squares.fold((0.0, 0.0), |(sum, n), square| (sum + square, n + 1.0));
    Some((OF_DIFFERENCES * (sum / f32::max(n, 1.0)).sqrt()).max(least))
}

/// Whether a pixel is a local maximum; of equal pixels the first one is.
fn is_maximum(image: &GrayImage, x: usize, y: usize) -> bool {
    let w = image.width;
    let here = image.counts[y * w + x];
    (y - 1..=y + 1).all(|v| {
        (x - 1..=x + 1).all(|u| {
            let other = image.counts[v * w + u];
            if (v, u) < (y, x) { other < here } else { other <= here }
        })
    })
}

#[cfg(test)]
mod tests {
    use microsig_core::random::normal;
    use microsig_core::stream::{Purpose, Streams};

    use super::*;

    #[test]
    fn defocused_images_are_warned_of_unless_the_diameter_is_theirs() {
        assert!(
            defocused(36.2, 3.0)
                .unwrap()
                .contains("36 px in diameter on average over depth, and images of 3 px are searched for")
        );
        assert_eq!((defocused(2.9, 3.0), defocused(36.2, 30.0)), (None, None));
    }

    /// Before, up to 2,600 ghosts: more than half of the pixels have the same count.
    #[test]
    fn noise_of_less_than_a_count_makes_few_ghosts() {
        let mut stream = Streams::new(3).stream(Purpose::Rays, 0, 0);
        for (mean, noise) in [(100.0, 0.2), (100.2, 0.15), (100.2, 0.2), (100.3, 0.1), (100.5, 0.3)] {
            let mut count = || (mean + noise * normal(&mut stream)).round() as f32;
            let image =
                GrayImage { width: 240, height: 240, counts: (0..240 * 240).map(|_| count()).collect() };
            let found = LogDetector::new(3.0).find(&image).len();
            assert!(found <= 25, "{mean} +- {noise}: {found}");
        }
    }

    #[test]
    fn spots_are_found_to_a_few_hundredths_of_a_pixel() {
        let spots = [(12.3, 20.7), (40.0, 11.5), (31.8, 33.1)];
        let image = GrayImage::from_fn((60, 50), |x, y| {
            let light = |(cx, cy): (f32, f32)| {
                let r2 = (x as f32 + 1.0 - cx).powi(2) + (y as f32 + 1.0 - cy).powi(2);
                800.0 * (-r2 / (2.0 * 0.8f32.powi(2))).exp()
            };
            // A fixed pattern of a few counts instead of noise.
            100.0 + ((x * 7 + y * 13) % 5) as f32 + spots.map(light).iter().sum::<f32>()
        });
        let mut found = LogDetector::new(3.0).find(&image);
        found.sort_by(|a, b| a.x_px.total_cmp(&b.x_px));
        assert_eq!(found.len(), 3, "{found:?}");
        for (found, spot) in found.iter().zip([spots[0], spots[2], spots[1]]) {
            let error = (found.x_px - f64::from(spot.0)).hypot(found.y_px - f64::from(spot.1));
            assert!(error < 0.05, "{found:?} for {spot:?}");
        }
    }
}
