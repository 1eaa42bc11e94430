//! Grayscale images of the baseline trackers: counts, filters, and spline interpolation.

use microsig_core::bspline;

/// A grayscale image. Pixels are indexed from 0 here, from 1 in datasets; [`super`] converts.
#[derive(Debug, Clone, PartialEq)]
pub struct GrayImage {
    /// Width, px.
    pub width: usize,
    /// Height, px.
    pub height: usize,
    /// Counts, row by row.
    pub counts: Vec<f32>,
}

impl GrayImage {
    /// Whether a point, relative to the center of the first pixel, lies on a pixel.
    pub(super) fn contains(&self, at: [f64; 2]) -> bool {
        at.iter().zip([self.width, self.height]).all(|(c, n)| (-0.5..n as f64 - 0.5).contains(c))
    }

    /// The image whose pixel at column `x` and row `y` is `count(x, y)`.
    pub fn from_fn((width, height): (usize, usize), count: impl Fn(usize, usize) -> f32) -> Self {
        let counts = (0..width * height).map(|i| count(i % width, i / width)).collect();
        GrayImage { width, height, counts }
    }

    /// Median of all counts: the background level if particles cover little of the image.
    pub(super) fn median(&self) -> f32 {
        quantile_half(&mut self.counts.clone())
    }

    /// Standard deviation of the background noise, from the median absolute deviation, which is robust
    /// against bright particles.
    pub(super) fn noise(&self) -> f32 {
        /// Ratio of standard deviation to median absolute deviation of a normal distribution.
        const NORMAL: f32 = 1.4826;
        let median = self.median();
        NORMAL * quantile_half(&mut self.counts.iter().map(|c| (c - median).abs()).collect::<Vec<_>>())
    }

    /// Level and standard deviation of the background if particles may cover much of the image: bright pixels
    /// are clipped iteratively, and the statistics come from the darker half of the rest.
    pub fn background(&self) -> (f32, f32) {
        let mut kept = self.counts.clone();
        let (mut level, mut noise) = (self.median(), self.noise());
        for _ in 0..20 {
            let limit = level + 2.5 * noise;
            let before = kept.len();
            kept.retain(|c| *c <= limit);
            level = quantile_half(&mut kept);
            let mut below: Vec<f32> = kept.iter().filter(|c| **c < level).map(|c| level - c).collect();
            if below.is_empty() {
                return (level, 0.0);
            }
            noise = 1.4826 * quantile_half(&mut below);
            if kept.len() == before {
                break;
            }
        }
        (level, noise)
    }

    /// The image convolved with a Gaussian of this standard deviation, px; edge pixels are replicated.
    pub fn smoothed(&self, sigma_px: f32) -> GrayImage {
        let half = (3.0 * sigma_px).ceil() as isize;
        let weights: Vec<f32> =
            (-half..=half).map(|k| (-0.5 * (k as f32 / sigma_px).powi(2)).exp()).collect();
        let sum: f32 = weights.iter().sum();
        let along = |image: &GrayImage, (dx, dy): (isize, isize)| {
            let (w, h) = (image.width as isize, image.height as isize);
            GrayImage::from_fn((image.width, image.height), |x, y| {
                let taps = weights.iter().zip(-half..=half);
                let total: f32 = taps
                    .map(|(weight, k)| {
                        let x = (x as isize + k * dx).clamp(0, w - 1) as usize;
                        let y = (y as isize + k * dy).clamp(0, h - 1) as usize;
                        weight * image.counts[y * image.width + x]
                    })
                    .sum();
                total / sum
            })
        };
        along(&along(self, (1, 0)), (0, 1))
    }

    /// Means over squares of `factor` x `factor` pixels, smaller at the right and lower edges.
    pub(super) fn binned(&self, factor: usize) -> GrayImage {
        if factor == 1 {
            return self.clone();
        }
        let size = (self.width.div_ceil(factor), self.height.div_ceil(factor));
        GrayImage::from_fn(size, |x, y| self.mean_of((x * factor, y * factor), factor))
    }

    /// `n` x `n` means over squares of `factor` pixels, starting at the pixel (`first`, `first`).
    pub(super) fn binned_from(&self, first: usize, n: usize, factor: usize) -> GrayImage {
        GrayImage::from_fn((n, n), |x, y| self.mean_of((first + x * factor, first + y * factor), factor))
    }

    fn mean_of(&self, (x0, y0): (usize, usize), side: usize) -> f32 {
        let (columns, rows) = (x0..(x0 + side).min(self.width), y0..(y0 + side).min(self.height));
        let n = columns.len() * rows.len();
        let sum: f32 = rows.map(|y| self.counts[y * self.width..][columns.clone()].iter().sum::<f32>()).sum();
        sum / n as f32
    }
}

fn quantile_half(values: &mut [f32]) -> f32 {
    let middle = values.len() / 2;
    *values.select_nth_unstable_by(middle, f32::total_cmp).1
}

/// Pole of the filter that makes the coefficients of a cubic spline of pixels.
pub(super) const CUBIC: [f64; 1] = [-0.267_949_192_431_122_7];

/// Interpolating cubic B-spline of an image (Unser 1999, IEEE Signal Process. Mag. 16(6), 22), mirrored at
/// the edges.
#[derive(Debug)]
pub struct Spline {
    coefficients: GrayImage,
}

impl Spline {
    /// The spline of an image.
    pub fn new(image: &GrayImage) -> Self {
        Spline { coefficients: prefiltered(image, &CUBIC) }
    }

    /// The spline coefficients, one per pixel.
    pub(super) fn into_coefficients(self) -> GrayImage {
        self.coefficients
    }

    /// The interpolated value at a position, px from 0.
    pub fn at(&self, x: f32, y: f32) -> f32 {
        let c = &self.coefficients;
        let (x0, y0) = (x.floor(), y.floor());
        let ((wx, _), (wy, _)) = (weights(x - x0), weights(y - y0));
        let columns: [usize; 4] = std::array::from_fn(|i| mirrored(x0 as isize + i as isize - 1, c.width));
        let mut value = 0.0;
        for (j, weight) in wy.into_iter().enumerate() {
            let row = mirrored(y0 as isize + j as isize - 1, c.height) * c.width;
            let taps = columns.iter().zip(wx).map(|(&column, w)| w * c.counts[row + column]);
            value += weight * taps.sum::<f32>();
        }
        value
    }
}

/// Weights of the four coefficients around a position at a distance `t` (0 to 1) beyond a pixel, and their
/// derivatives.
pub(super) fn weights(t: f32) -> ([f32; 4], [f32; 4]) {
    let (weights, slopes) = bspline::cubic(f64::from(t));
    (weights.map(|w| w as f32), slopes.map(|s| s as f32))
}

/// The pixel that corresponds to index `i` of a line of `n` pixels mirrored at its ends.
pub(super) fn mirrored(i: isize, n: usize) -> usize {
    if n == 1 {
        return 0;
    }
    let period = 2 * (n as isize - 1);
    let i = i.rem_euclid(period);
    i.min(period - i) as usize
}

/// The coefficients of the B-spline through all pixels whose filter has these poles.
pub(super) fn prefiltered(image: &GrayImage, poles: &[f64]) -> GrayImage {
    let mut coefficients = image.clone();
    for row in coefficients.counts.chunks_mut(image.width) {
        prefilter(row, poles);
    }
    let mut column = vec![0.0; image.height];
    for x in 0..image.width {
        for (value, row) in column.iter_mut().zip(coefficients.counts.chunks(image.width)) {
            *value = row[x];
        }
        prefilter(&mut column, poles);
        for (value, row) in column.iter().zip(coefficients.counts.chunks_mut(image.width)) {
            row[x] = *value;
        }
    }
    coefficients
}

/// Replaces a line of values by the coefficients of the B-spline through them, mirrored at its ends.
pub(super) fn prefilter(line: &mut [f32], poles: &[f64]) {
    /// Powers of a pole below this are negligible.
    const NEGLIGIBLE: f64 = 1e-7;
    let n = line.len();
    if n < 2 {
        return;
    }
    for &pole in poles {
        let reach = (NEGLIGIBLE.ln() / pole.abs().ln()) as usize;
        let (gain, pole) = (((1.0 - pole) * (1.0 - 1.0 / pole)) as f32, pole as f32);
        // Sum over the mirrored line.
        let first: f32 = (0..n.min(reach)).rev().fold(0.0, |sum, i| sum * pole + line[i]);
        line[0] = first;
        for i in 1..n {
            line[i] += pole * line[i - 1];
        }
        line[n - 1] = pole / (pole * pole - 1.0) * (line[n - 1] + pole * line[n - 2]);
        for i in (0..n - 1).rev() {
            line[i] = pole * (line[i + 1] - line[i]);
        }
        line.iter_mut().for_each(|value| *value *= gain);
    }
}

/// Three-point Gaussian peak fit: sub-pixel offset from the middle value, px.
pub(super) fn three_points(low: f32, middle: f32, high: f32) -> f32 {
    // Noise may make a neighbor negative, where the logarithm is undefined.
    let log = |value: f32| value.max(1e-3 * middle).ln();
    let (low, middle, high) = (log(low), log(middle), log(high));
    let curvature = low - 2.0 * middle + high;
    if curvature < 0.0 { (0.5 * (low - high) / curvature).clamp(-0.5, 0.5) } else { 0.0 }
}

/// Approximately normal noise of unit variance for tests, a function of its number.
#[cfg(test)]
pub(super) fn normal(number: usize) -> f32 {
    let uniform = |k: u64| {
        let mut bits = number as u64 * 12 + k + 1;
        for _ in 0..3 {
            bits = (bits ^ (bits >> 31)).wrapping_mul(0x9E37_79B9_7F4A_7C15);
        }
        (bits >> 40) as f32 / (1u64 << 24) as f32 - 0.5
    };
    (0..12).map(uniform).sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn wave(x: f32, y: f32) -> f32 {
        100.0 + 30.0 * (0.5 * x).sin() * (0.35 * y + 1.0).cos()
    }

    #[test]
    fn the_spline_goes_through_all_pixels_and_is_smooth_between_them() {
        let image = GrayImage::from_fn((40, 30), |x, y| wave(x as f32, y as f32));
        let spline = Spline::new(&image);
        for y in 0..30 {
            for x in 0..40 {
                assert!((spline.at(x as f32, y as f32) - image.counts[y * 40 + x]).abs() < 2e-3);
            }
        }
        for (x, y) in [(10.5, 12.5), (20.3, 7.8), (31.9, 22.1)] {
            assert!((spline.at(x, y) - wave(x, y)).abs() < 0.05, "{x} {y}");
        }
    }

    #[test]
    fn noise_is_that_of_the_background() {
        // A uniform distribution on [0, 1] has a median absolute deviation of 1/4; a few bright pixels have
        // little effect.
        let image =
            GrayImage::from_fn(
                (100, 100),
                |x, y| if x + y < 10 { 1e4 } else { ((x * 37 + y * 101) % 1000) as f32 },
            );
        assert!((image.median() - 500.0).abs() < 10.0, "{}", image.median());
        assert!((image.noise() - 1.4826 * 250.0).abs() < 10.0, "{}", image.noise());
    }
}
