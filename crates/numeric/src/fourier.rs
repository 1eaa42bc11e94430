//! Fourier transforms of images (f32) and of lines (f64).
//!
//! `rustfft` is generic, so that every crate that calls it compiles it anew, which takes half a minute. This crate
//! instantiates it once, for f32 images and f64 lines. Images use the fastest instruction set of the machine; lines
//! are short and few, so a scalar transform is sufficient.

use std::sync::Arc;

pub use rustfft::num_complex::{Complex32, Complex64};
use rustfft::{Fft, FftPlanner, FftPlannerScalar};

/// Direction of a transform.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Direction {
    /// Forward: sum over x of f(x) exp(-2 pi i k x / n).
    Forward,
    /// Backward, not normalized: forward and backward together multiply by the number of pixels.
    Backward,
}

/// The least length from `n` on that is a product of 2, 3, 5 and 7, whose transforms are fast.
pub fn fast_length(n: usize) -> usize {
    let is_smooth = |n: &usize| {
        let rest = [2, 3, 5, 7].into_iter().fold(*n, |rest, prime| {
            let mut rest = rest;
            while rest % prime == 0 {
                rest /= prime;
            }
            rest
        });
        rest == 1
    };
    (n.max(1)..).find(is_smooth).unwrap_or(n)
}

/// Two-dimensional transforms of images of one size, stored row by row. Spectra are stored column by column.
#[derive(Clone)]
pub struct ImageFft {
    width: usize,
    height: usize,
    rows: [Arc<dyn Fft<f32>>; 2],
    columns: [Arc<dyn Fft<f32>>; 2],
}

impl ImageFft {
    /// Plans the transforms of images of (`width`, `height`) px.
    pub fn new((width, height): (usize, usize)) -> Self {
        let mut planner = FftPlanner::new();
        let mut both = |n| [planner.plan_fft_forward(n), planner.plan_fft_inverse(n)];
        ImageFft { width, height, rows: both(width), columns: both(height) }
    }

    /// Working memory for [`Self::transform`].
    pub fn scratch(&self) -> Vec<Complex32> {
        let rows = self.rows.iter().map(|fft| fft.get_inplace_scratch_len());
        let most = rows.chain(self.columns.iter().map(|fft| fft.get_outofplace_scratch_len())).max();
        vec![Complex32::default(); self.width * self.height + most.unwrap_or(0)]
    }

    /// Transforms an image of `height` rows of `width` values in place to its spectrum or back; `scratch` is the memory
    /// from [`Self::scratch`]. Panics if `image` or `scratch` is shorter than that.
    pub fn transform(&self, image: &mut [Complex32], way: Direction, scratch: &mut [Complex32]) {
        let (transposed, scratch) = scratch.split_at_mut(self.width * self.height);
        let (rows, columns) = (&self.rows[way as usize], &self.columns[way as usize]);
        match way {
            Direction::Forward => {
                rows.process_with_scratch(image, scratch);
                transpose(image, transposed, self.width);
                columns.process_outofplace_with_scratch(transposed, image, scratch);
            }
            Direction::Backward => {
                columns.process_outofplace_with_scratch(image, transposed, scratch);
                transpose(transposed, image, self.height);
                rows.process_with_scratch(image, scratch);
            }
        }
    }

    /// Replaces the spectrum of an image f + i g of real f and g by what `combined` makes of the spectra of f and g.
    pub fn combine(
        &self,
        spectrum: &mut [Complex32],
        mut combined: impl FnMut(usize, [Complex32; 2]) -> Complex32,
    ) {
        let (w, h) = (self.width, self.height);
        // Spectra of real images are Hermitian: F = (S(k) + S*(-k)) / 2, G = (S(k) - S*(-k)) / 2i.
        let parts = |here: Complex32, there: Complex32| {
            let (here, there) = (here * 0.5, there.conj() * 0.5);
            [here + there, (here - there) * Complex32::new(0.0, -1.0)]
        };
        for u in 0..=w / 2 {
            let across = (w - u) % w;
            for v in 0..h {
                let (k, opposite) = (u * h + v, across * h + (h - v) % h);
                if u == across && opposite < k {
                    continue;
                }
                let (here, there) = (spectrum[k], spectrum[opposite]);
                spectrum[k] = combined(k, parts(here, there));
                if opposite != k {
                    spectrum[opposite] = combined(opposite, parts(there, here));
                }
            }
        }
    }
}

/// Transposes an image with rows of `width` values, by squares that fit into the cache.
fn transpose(from: &[Complex32], to: &mut [Complex32], width: usize) {
    const SIDE: usize = 16;
    let height = from.len() / width;
    for (y0, x0) in (0..height).step_by(SIDE).flat_map(|y0| (0..width).step_by(SIDE).map(move |x0| (y0, x0)))
    {
        for x in x0..(x0 + SIDE).min(width) {
            for y in y0..(y0 + SIDE).min(height) {
                to[x * height + y] = from[y * width + x];
            }
        }
    }
}

/// Forward transforms of real lines of one length.
pub struct LineFft {
    line: Arc<dyn Fft<f64>>,
}

impl LineFft {
    /// Plans the transforms of lines of `n` values.
    pub fn new(n: usize) -> Self {
        LineFft { line: FftPlannerScalar::new().plan_fft_forward(n) }
    }

    /// The Fourier coefficients of wave numbers 0 to n / 2 of a line of n values, not normalized.
    pub fn forward(&self, line: &[f64]) -> Vec<Complex64> {
        let mut values: Vec<Complex64> = line.iter().map(|&value| value.into()).collect();
        self.line.process(&mut values);
        values.truncate(line.len() / 2 + 1);
        values
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::TAU;

    #[test]
    fn a_wave_has_one_coefficient() {
        for n in [8, 31, 100] {
            let line: Vec<f64> = (0..n).map(|i| (TAU * 3.0 * i as f64 / n as f64).cos()).collect();
            let found = LineFft::new(n).forward(&line);
            assert_eq!(found.len(), n / 2 + 1);
            for (k, value) in found.iter().enumerate() {
                let expected = if k == 3 { n as f64 / 2.0 } else { 0.0 };
                assert!((value - expected).norm() < 1e-10, "n = {n}, k = {k}: {value}");
            }
        }
    }

    #[test]
    fn images_come_back_times_their_number_of_pixels() {
        let size = (12, 7);
        let fft = ImageFft::new(size);
        let image: Vec<Complex32> = (0..84).map(|i| Complex32::new((i * i % 17) as f32, 0.0)).collect();
        let (mut plane, mut scratch) = (image.clone(), fft.scratch());
        fft.transform(&mut plane, Direction::Forward, &mut scratch);
        let sum: f32 = image.iter().map(|value| value.re).sum();
        assert!((plane[0].re - sum).abs() < 1e-3 * sum);
        fft.transform(&mut plane, Direction::Backward, &mut scratch);
        assert!(plane.iter().zip(&image).all(|(a, b)| (a / 84.0 - b).norm() < 1e-4));
    }

    #[test]
    fn two_real_images_share_a_transform() {
        for size in [(12, 7), (9, 10), (1, 4)] {
            let (fft, n) = (ImageFft::new(size), size.0 * size.1);
            let real = |i: usize, seed: usize| ((i * i * seed + 3 * i) % 17) as f32;
            let mut scratch = fft.scratch();
            let mut spectrum = |value: &dyn Fn(usize) -> Complex32| {
                let mut plane: Vec<Complex32> = (0..n).map(value).collect();
                fft.transform(&mut plane, Direction::Forward, &mut scratch);
                plane
            };
            let [f, g] = [5, 11].map(|seed| spectrum(&|i| real(i, seed).into()));
            let mut both = spectrum(&|i| Complex32::new(real(i, 5), real(i, 11)));
            let mut seen = vec![0; n];
            fft.combine(&mut both, |k, [f_term, g_term]| {
                seen[k] += 1;
                assert!((f_term - f[k]).norm() < 1e-3 && (g_term - g[k]).norm() < 1e-3, "{size:?} {k}");
                f_term
            });
            assert!(seen.iter().all(|n| *n == 1) && both.iter().zip(&f).all(|(a, b)| (a - b).norm() < 1e-3));
        }
    }

    #[test]
    fn fast_lengths_have_small_factors() {
        assert_eq!([1, 11, 13, 191, 366, 752, 1361].map(fast_length), [1, 12, 14, 192, 375, 756, 1372]);
    }
}
