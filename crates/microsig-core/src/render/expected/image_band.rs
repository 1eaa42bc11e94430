//! A band of rows of an image in f32, to which particles are added.

use super::depth_table::DepthTable;
use super::quadrant_layout::LANES;
use crate::render::patch::Window;

/// A sphere to draw.
#[derive(Debug, Clone, Copy)]
pub(super) struct SphereImage<'a> {
    pub(super) table: &'a DepthTable,
    pub(super) window: Window,
    pub(super) x_px: f64,
    pub(super) y_px: f64,
    pub(super) z_um: f64,
    pub(super) radius_um: f64,
    /// Total light, in rays.
    pub(super) light: f64,
}

/// A rectangle of the image.
pub(super) struct ImageBand<'a> {
    /// Numbers of the leftmost column and of the topmost row.
    pub(super) x0: i64,
    pub(super) y0: i64,
    /// Distance in memory between rows (see [`stride`]).
    pub(super) stride: usize,
    pub(super) pixels: &'a mut [f32],
}

/// Distance in memory between rows of `columns` pixels: spheres are drawn in groups of pixels, the last of
/// which may extend beyond the row.
pub(super) fn stride(columns: usize) -> usize {
    columns + LANES
}

/// Copies the rows of a band of `columns` pixels each until `pixels` is full.
pub(super) fn copy(band: &[f32], columns: usize, pixels: &mut [f64]) {
    for (from, to) in band.chunks_exact(stride(columns)).zip(pixels.chunks_exact_mut(columns)) {
        to.iter_mut().zip(from).for_each(|(to, from)| *to = f64::from(*from));
    }
}

impl ImageBand<'_> {
    /// The rows of a window that are in the band.
    pub(super) fn rows(&self, window: &Window) -> std::ops::Range<i64> {
        let end = self.y0 + (self.pixels.len() / self.stride) as i64;
        window.y0.max(self.y0)..(window.y0 + window.height as i64).min(end)
    }

    /// Index of the first pixel of a window's row.
    pub(super) fn first(&self, window: &Window, row: i64) -> usize {
        (row - self.y0) as usize * self.stride + (window.x0 - self.x0) as usize
    }

    #[inline(always)]
    pub(super) fn add(&mut self, window: Window, counts: &[f32], factor: f32) {
        for y in self.rows(&window) {
            let counts = &counts[(y - window.y0) as usize * window.width..];
            let first = self.first(&window, y);
            for (pixel, &count) in self.pixels[first..][..window.width].iter_mut().zip(counts) {
                *pixel += factor * count;
            }
        }
    }
}
