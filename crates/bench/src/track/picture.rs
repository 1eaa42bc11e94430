//! A grey image as the baseline trackers see it: counts, row by row, and smooth values between pixels.

/// An image. Pixels are addressed from 0 in here; [`super`] adds the 1 of the datasets.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Picture {
    /// Width, px.
    pub(super) width: usize,
    /// Height, px.
    pub(super) height: usize,
    /// Counts, row by row.
    pub(super) counts: Vec<f32>,
}

impl Picture {
    /// The image whose pixel at column `x` and row `y` is `count(x, y)`.
    pub(super) fn from_fn((width, height): (usize, usize), count: impl Fn(usize, usize) -> f32) -> Self {
        let counts = (0..width * height).map(|i| count(i % width, i / width)).collect();
        Picture { width, height, counts }
    }

    /// The median of all counts: the background of an image that is mostly background.
    pub(super) fn median(&self) -> f32 {
        quantile_half(&mut self.counts.clone())
    }

    /// Standard deviation of the background noise, from the median distance to the median: bright particles count little.
    pub(super) fn noise(&self) -> f32 {
        /// Of the normal distribution: its standard deviation over its median distance.
        const NORMAL: f32 = 1.4826;
        let median = self.median();
        NORMAL * quantile_half(&mut self.counts.iter().map(|c| (c - median).abs()).collect::<Vec<_>>())
    }

    /// Level and standard deviation of the background where particles may cover much of the image: from the darker half of
    /// what is left when bright pixels are taken out again and again.
    pub(super) fn background(&self) -> (f32, f32) {
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

    /// Smoothed by a normal distribution of the given standard deviation, px; beyond the edge the edge goes on.
    pub(super) fn smoothed(&self, sigma_px: f32) -> Picture {
        let half = (3.0 * sigma_px).ceil() as isize;
        let weights: Vec<f32> =
            (-half..=half).map(|k| (-0.5 * (k as f32 / sigma_px).powi(2)).exp()).collect();
        let sum: f32 = weights.iter().sum();
        let along = |picture: &Picture, (dx, dy): (isize, isize)| {
            let (w, h) = (picture.width as isize, picture.height as isize);
            Picture::from_fn((picture.width, picture.height), |x, y| {
                let taps = weights.iter().zip(-half..=half);
                let total: f32 = taps
                    .map(|(weight, k)| {
                        let x = (x as isize + k * dx).clamp(0, w - 1) as usize;
                        let y = (y as isize + k * dy).clamp(0, h - 1) as usize;
                        weight * picture.counts[y * picture.width + x]
                    })
                    .sum();
                total / sum
            })
        };
        along(&along(self, (1, 0)), (0, 1))
    }
}

fn quantile_half(values: &mut [f32]) -> f32 {
    let middle = values.len() / 2;
    *values.select_nth_unstable_by(middle, f32::total_cmp).1
}

/// The cubic B-spline through all pixels of an image (Unser 1999, IEEE Signal Process. Mag. 16(6), 22): smooth values
/// between pixels, mirrored beyond the edges.
#[derive(Debug)]
pub(super) struct Spline {
    coefficients: Picture,
}

impl Spline {
    /// The spline of an image.
    pub(super) fn new(picture: &Picture) -> Self {
        let mut coefficients = picture.clone();
        let (w, h) = (picture.width, picture.height);
        for row in coefficients.counts.chunks_mut(w) {
            prefilter(row);
        }
        let mut column = vec![0.0; h];
        for x in 0..w {
            for (value, row) in column.iter_mut().zip(coefficients.counts.chunks(w)) {
                *value = row[x];
            }
            prefilter(&mut column);
            for (value, row) in column.iter().zip(coefficients.counts.chunks_mut(w)) {
                row[x] = *value;
            }
        }
        Spline { coefficients }
    }

    /// The spline's coefficients, pixel by pixel.
    pub(super) fn coefficients(&self) -> &Picture {
        &self.coefficients
    }

    /// The value at a place in pixels.
    pub(super) fn at(&self, x: f32, y: f32) -> f32 {
        let c = &self.coefficients;
        let (x0, y0) = (x.floor(), y.floor());
        let (wx, wy) = (weights(x - x0), weights(y - y0));
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

/// Weights of the four coefficients around a place `t` beyond a pixel.
pub(super) fn weights(t: f32) -> [f32; 4] {
    let s = 1.0 - t;
    [
        s * s * s / 6.0,
        2.0 / 3.0 - 0.5 * t * t * (2.0 - t),
        2.0 / 3.0 - 0.5 * s * s * (2.0 - s),
        t * t * t / 6.0,
    ]
}

/// Derivatives of [`weights`].
pub(super) fn weights_slope(t: f32) -> [f32; 4] {
    let s = 1.0 - t;
    [-0.5 * s * s, 0.5 * t * (3.0 * t - 4.0), -0.5 * s * (3.0 * s - 4.0), 0.5 * t * t]
}

fn mirrored(i: isize, n: usize) -> usize {
    if n == 1 {
        return 0;
    }
    let period = 2 * (n as isize - 1);
    let i = i.rem_euclid(period);
    i.min(period - i) as usize
}

/// Coefficients of the cubic B-spline through a line of values.
fn prefilter(line: &mut [f32]) {
    let n = line.len();
    if n < 2 {
        return;
    }
    let pole = 3.0f32.sqrt() - 2.0;
    // The mirrored line, as far as the pole's powers matter.
    let first: f32 = (0..n.min(12)).rev().fold(0.0, |sum, i| sum * pole + line[i]);
    line[0] = first;
    for i in 1..n {
        line[i] += pole * line[i - 1];
    }
    line[n - 1] = pole / (pole * pole - 1.0) * (line[n - 1] + pole * line[n - 2]);
    for i in (0..n - 1).rev() {
        line[i] = pole * (line[i + 1] - line[i]);
    }
    for value in line {
        *value *= 6.0;
    }
}

/// Where a Gaussian through three neighbouring values has its top, from the middle one.
pub(super) fn three_points(low: f32, middle: f32, high: f32) -> f32 {
    // Noise may push a neighbour below zero, where there is no logarithm.
    let log = |value: f32| value.max(1e-3 * middle).ln();
    let (low, middle, high) = (log(low), log(middle), log(high));
    let curvature = low - 2.0 * middle + high;
    if curvature < 0.0 { (0.5 * (low - high) / curvature).clamp(-0.5, 0.5) } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn wave(x: f32, y: f32) -> f32 {
        100.0 + 30.0 * (0.5 * x).sin() * (0.35 * y + 1.0).cos()
    }

    #[test]
    fn the_spline_goes_through_all_pixels_and_is_smooth_between_them() {
        let picture = Picture::from_fn((40, 30), |x, y| wave(x as f32, y as f32));
        let spline = Spline::new(&picture);
        for y in 0..30 {
            for x in 0..40 {
                assert!((spline.at(x as f32, y as f32) - picture.counts[y * 40 + x]).abs() < 2e-3);
            }
        }
        for (x, y) in [(10.5, 12.5), (20.3, 7.8), (31.9, 22.1)] {
            assert!((spline.at(x, y) - wave(x, y)).abs() < 0.05, "{x} {y}");
        }
    }

    #[test]
    fn noise_is_that_of_the_background() {
        // A sawtooth between 0 and 1 has its median distance from the middle at 1/4; a few bright pixels change little.
        let picture =
            Picture::from_fn(
                (100, 100),
                |x, y| if x + y < 10 { 1e4 } else { ((x * 37 + y * 101) % 1000) as f32 },
            );
        assert!((picture.median() - 500.0).abs() < 10.0, "{}", picture.median());
        assert!((picture.noise() - 1.4826 * 250.0).abs() < 10.0, "{}", picture.noise());
    }
}
