//! Fourier transforms of planes.

use std::sync::Arc;

use rustfft::num_complex::Complex32;
use rustfft::{Fft, FftPlanner};

/// Transforms of planes of one size, stored row by row.
pub(super) struct Plane {
    width: usize,
    height: usize,
    rows: [Arc<dyn Fft<f32>>; 2],
    columns: [Arc<dyn Fft<f32>>; 2],
}

/// Which way.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Way {
    /// To wave numbers.
    Forward,
    /// Back again, times the number of pixels.
    Backward,
}

impl Plane {
    pub(super) fn new((width, height): (usize, usize)) -> Self {
        let mut planner = FftPlanner::new();
        let mut both = |n| [planner.plan_fft_forward(n), planner.plan_fft_inverse(n)];
        Plane { width, height, rows: both(width), columns: both(height) }
    }

    /// Memory for [`Self::transform`].
    pub(super) fn scratch(&self) -> Vec<Complex32> {
        let all = self.rows.iter().chain(&self.columns);
        let most = all.map(|fft| fft.get_inplace_scratch_len()).max().unwrap_or(0);
        vec![Complex32::default(); self.width * self.height + most]
    }

    /// Transforms a plane in place.
    pub(super) fn transform(&self, plane: &mut [Complex32], way: Way, scratch: &mut [Complex32]) {
        let (turned, scratch) = scratch.split_at_mut(self.width * self.height);
        self.rows[way as usize].process_with_scratch(plane, scratch);
        transpose(plane, turned, self.width);
        self.columns[way as usize].process_with_scratch(turned, scratch);
        transpose(turned, plane, self.height);
    }
}

/// Rows of `width` become columns.
fn transpose(from: &[Complex32], to: &mut [Complex32], width: usize) {
    let height = from.len() / width;
    for (y, row) in from.chunks(width).enumerate() {
        for (x, value) in row.iter().enumerate() {
            to[x * height + y] = *value;
        }
    }
}
