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
        let mut counts = Vec::with_capacity(width * height);
        (0..height).for_each(|y| counts.extend((0..width).map(|x| count(x, y))));
        GrayImage { width, height, counts }
    }

    /// Standard deviation of the background noise, from the median absolute deviation, which is robust
    /// against bright particles.
    pub(super) fn noise(&self) -> f32 {
        deviation(&sorted(&self.counts))
    }

    /// Level and standard deviation of the background if particles may cover much of the image: bright pixels
    /// are clipped iteratively, and the statistics come from the darker half of the rest.
    pub fn background(&self) -> (f32, f32) {
        let sorted = sorted(&self.counts);
        let mut kept = sorted.len();
        let (mut level, mut noise) = (sorted[kept / 2], deviation(&sorted));
        for _ in 0..20 {
            let limit = level + 2.5 * noise;
            let before = kept;
            kept = sorted.partition_point(|c| *c <= limit).min(kept);
            level = sorted[kept / 2];
            let below = sorted[..kept].partition_point(|c| *c < level);
            if below == 0 {
                return (level, 0.0);
            }
            noise = NORMAL * (level - sorted[below - 1 - below / 2]);
            if kept == before {
                break;
            }
        }
        (level, noise)
    }

    /// The image convolved with a Gaussian of this standard deviation, px; edge pixels are replicated.
    pub fn smoothed(&self, sigma_px: f32) -> GrayImage {
        if self.counts.is_empty() {
            return self.clone();
        }
        let half = (3.0 * sigma_px).ceil() as usize;
        let weights: Vec<f32> =
            (0..=2 * half).map(|k| (-0.5 * ((k as f32 - half as f32) / sigma_px).powi(2)).exp()).collect();
        let sum: f32 = weights.iter().sum();
        let (w, h) = (self.width, self.height);
        let blank = GrayImage { counts: vec![0.0; w * h], ..*self };
        let (mut across, mut smooth) = (blank.clone(), blank);
        let mut line = vec![0.0; w + 2 * half];
        for (row, out) in self.counts.chunks(w).zip(across.counts.chunks_mut(w)) {
            line[..half].fill(row[0]);
            line[half..half + w].copy_from_slice(row);
            line[half + w..].fill(row[w - 1]);
            weights.iter().enumerate().for_each(|(k, weight)| add(out, *weight, &line[k..]));
            out.iter_mut().for_each(|value| *value /= sum);
        }
        for (y, out) in smooth.counts.chunks_mut(w).enumerate() {
            for (k, weight) in weights.iter().enumerate() {
                add(out, *weight, &across.counts[(y + k).saturating_sub(half).min(h - 1) * w..]);
            }
            out.iter_mut().for_each(|value| *value /= sum);
        }
        smooth
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

/// Ratio of standard deviation to median absolute deviation of a normal distribution.
const NORMAL: f32 = 1.4826;

/// Standard deviation of sorted values, from their median absolute deviation.
fn deviation(sorted: &[f32]) -> f32 {
    let middle = sorted.len() / 2;
    let median = sorted[middle];
    // The nearest half of the values: `i` of them below the median, the others from it on.
    let below = |i: usize| if i == 0 { 0.0 } else { median - sorted[middle - i] };
    let above = |i: usize| sorted.get(2 * middle - i).map_or(f32::INFINITY, |value| value - median);
    let (mut low, mut high) = (0, middle);
    while low < high {
        let i = (low + high) / 2;
        if below(i) < above(i) { low = i + 1 } else { high = i }
    }
    NORMAL * if low == 0 { below(0) } else { below(low).min(above(low - 1)) }
}

/// Values in increasing order ([`f32::total_cmp`]), by radix sort.
fn sorted(values: &[f32]) -> Vec<f32> {
    const BITS: u32 = 11;
    // Integers in the same order as the numbers.
    let key = |value: &f32| {
        let bits = value.to_bits();
        if bits >> 31 == 0 { bits | 1 << 31 } else { !bits }
    };
    let mut keys: Vec<u32> = values.iter().map(key).collect();
    let mut ordered = vec![0; keys.len()];
    for shift in [0, BITS, 2 * BITS] {
        let digit = |key: u32| (key >> shift) as usize % (1 << BITS);
        let mut places = [0; 1 << BITS];
        keys.iter().for_each(|key| places[digit(*key)] += 1);
        if places.contains(&keys.len()) {
            continue;
        }
        let mut next = 0;
        places.iter_mut().for_each(|place| (*place, next) = (next, next + *place));
        for key in &keys {
            let place = &mut places[digit(*key)];
            ordered[*place] = *key;
            *place += 1;
        }
        std::mem::swap(&mut keys, &mut ordered);
    }
    let value = |key: u32| f32::from_bits(if key >> 31 == 1 { key ^ 1 << 31 } else { !key });
    keys.into_iter().map(value).collect()
}

pub(super) fn add(sums: &mut [f32], weight: f32, row: &[f32]) {
    sums.iter_mut().zip(row).for_each(|(sum, value)| *sum += weight * value);
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
    /// Number of rows that are filtered together, as columns of their transpose.
    const TOGETHER: usize = 16;
    let mut coefficients = image.clone();
    let width = image.width;
    let mut turned = vec![0.0; TOGETHER.min(image.height) * width];
    for rows in coefficients.counts.chunks_mut(TOGETHER * width) {
        let n = rows.len() / width;
        let turned = &mut turned[..rows.len()];
        rows.chunks(width).enumerate().for_each(|(i, row)| {
            turned[i..].iter_mut().step_by(n).zip(row).for_each(|(to, from)| *to = *from);
        });
        filter(turned, n, poles);
        rows.chunks_mut(width).enumerate().for_each(|(i, row)| {
            turned[i..].iter().step_by(n).zip(row).for_each(|(from, to)| *to = *from);
        });
    }
    filter(&mut coefficients.counts, width, poles);
    coefficients
}

/// Replaces a line of values by the coefficients of the B-spline through them, mirrored at its ends.
pub(super) fn prefilter(line: &mut [f32], poles: &[f64]) {
    filter(line, 1, poles);
}

/// Replaces each column of rows of `width` values by the coefficients of the B-spline through them, mirrored at its ends.
pub(super) fn filter(values: &mut [f32], width: usize, poles: &[f64]) {
    /// Powers of a pole below this are negligible.
    const NEGLIGIBLE: f64 = 1e-7;
    if values.len() < 2 * width {
        return;
    }
    let n = values.len() / width;
    for &pole in poles {
        let reach = (NEGLIGIBLE.ln() / pole.abs().ln()) as usize;
        let (gain, pole) = (((1.0 - pole) * (1.0 - 1.0 / pole)) as f32, pole as f32);
        // Sum over the mirrored line.
        let mut first = vec![0.0; width];
        for row in values.chunks(width).take(reach).rev() {
            first.iter_mut().zip(row).for_each(|(sum, value)| *sum = *sum * pole + value);
        }
        values[..width].copy_from_slice(&first);
        for i in 1..n {
            let (before, row) = values.split_at_mut(i * width);
            add(&mut row[..width], pole, &before[(i - 1) * width..]);
        }
        let (before, last) = values.split_at_mut((n - 1) * width);
        for (value, before) in last.iter_mut().zip(&before[(n - 2) * width..]) {
            *value = pole / (pole * pole - 1.0) * (*value + pole * before);
        }
        for i in (0..n - 1).rev() {
            let (row, after) = values.split_at_mut((i + 1) * width);
            row[i * width..]
                .iter_mut()
                .zip(after)
                .for_each(|(value, after)| *value = pole * (*after - *value));
        }
        values.iter_mut().for_each(|value| *value *= gain);
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
    fn statistics_of_sorted_values_are_those_of_selection() {
        for n in [1, 2, 3, 10, 501, 1000] {
            let value =
                |i: usize| (3.0 * normal(i)).mul_add(if i.is_multiple_of(3) { 1.0 } else { 1e-3 }, -0.5);
            let values: Vec<f32> =
                (0..n).map(|i| if i % 7 == 0 { value(i).round() } else { value(i) }).collect();
            let mut expected = values.clone();
            expected.sort_by(f32::total_cmp);
            let found = sorted(&values);
            assert!(found.iter().zip(&expected).all(|(a, b)| a.to_bits() == b.to_bits()), "{n}");
            let median = expected[n / 2];
            let mut off: Vec<f32> = values.iter().map(|value| (value - median).abs()).collect();
            off.sort_by(f32::total_cmp);
            assert_eq!(deviation(&found), 1.4826 * off[n / 2], "{n}");
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

        assert!((image.noise() - 1.4826 * 250.0).abs() < 10.0, "{}", image.noise());
    }
}
