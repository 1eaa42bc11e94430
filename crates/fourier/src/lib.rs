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

/// Two-dimensional transforms of images of one size, stored row by row.
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
        let all = self.rows.iter().chain(&self.columns);
        let most = all.map(|fft| fft.get_inplace_scratch_len()).max().unwrap_or(0);
        vec![Complex32::default(); self.width * self.height + most]
    }

    /// Transforms an image of `height` rows of `width` values in place; `scratch` is the memory from
    /// [`Self::scratch`]. Panics if `image` or `scratch` is shorter than that.
    pub fn transform(&self, image: &mut [Complex32], way: Direction, scratch: &mut [Complex32]) {
        let (transposed, scratch) = scratch.split_at_mut(self.width * self.height);
        self.rows[way as usize].process_with_scratch(image, scratch);
        transpose(image, transposed, self.width);
        self.columns[way as usize].process_with_scratch(transposed, scratch);
        transpose(transposed, image, self.height);
    }
}

/// Transposes an image with rows of `width` values.
fn transpose(from: &[Complex32], to: &mut [Complex32], width: usize) {
    let height = from.len() / width;
    for (y, row) in from.chunks(width).enumerate() {
        for (x, value) in row.iter().enumerate() {
            to[x * height + y] = *value;
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
}
