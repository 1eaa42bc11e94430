//! The sum of particle images on the sensor in f32: threads add to bands of rows.

use rayon::prelude::*;

use super::depth_table::DepthTable;
use super::interface::ImageStreams;
use super::patch::{ExpectedPatch, Window};
use crate::pool::{BufferPool, Pooled};
use crate::sensor::{Image, Light, Sensor};
use crate::settings::Settings;

/// Number of pixels that are drawn at a time.
pub(super) const LANES: usize = 8;

/// One group of values.
pub(super) type Group = [f32; LANES];

/// Rows per exposed band, and minimum number of rows of a band.
const ROWS: usize = 64;

/// A sphere to draw from a table.
#[derive(Debug)]
pub struct SphereImage<'a, L> {
    pub(super) table: &'a DepthTable<L>,
    pub(super) window: Window,
    pub(super) x_px: f64,
    pub(super) y_px: f64,
    pub(super) z_um: f64,
    pub(super) radius_um: f64,
    /// Light emitted toward the lens, in rays.
    pub(super) light: f64,
}

impl<L> SphereImage<'_, L> {
    /// Its position, px.
    pub(super) fn at_px(&self) -> [f64; 2] {
        [self.x_px, self.y_px]
    }
}

/// A rectangle of the image.
pub struct ImageBand<'a> {
    /// Leftmost column and topmost row, px.
    pub(super) x0: i64,
    pub(super) y0: i64,
    /// Distance between rows in memory, numbers (see [`stride`]).
    pub(super) stride: usize,
    pub(super) pixels: &'a mut [f32],
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

/// The sum of particle images on a sensor.
pub(super) struct ImageSum<'p> {
    pixels: Pooled<'p, Vec<f32>>,
    columns: u32,
    rows: u32,
}

impl<'p> ImageSum<'p> {
    /// A dark image.
    pub(super) fn new(settings: &Settings, pool: &'p BufferPool<Vec<f32>>) -> Self {
        let (columns, rows) = (settings.pixel_dim_x, settings.pixel_dim_y);
        let mut pixels = pool.get();
        pixels.resize(rows as usize * stride(columns as usize), 0.0);
        ImageSum { pixels, columns, rows }
    }

    /// Draws on all bands in parallel. Sums do not depend on the number of threads if `draw` adds particles
    /// to every band in the same order.
    pub(super) fn add(&mut self, draw: impl Fn(ImageBand) + Sync) {
        let stride = stride(self.columns as usize);
        let rows = (self.rows as usize).div_ceil(rayon::current_num_threads()).max(ROWS);
        self.pixels.par_chunks_mut(rows * stride).enumerate().for_each(|(i, pixels)| {
            draw(ImageBand { x0: 1, y0: (i * rows) as i64 + 1, stride, pixels });
        });
    }

    pub(super) fn light(&self, settings: &Settings) -> Light {
        let mut light = Light::dark(settings);
        copy(&self.pixels, self.columns as usize, &mut light.values);
        light
    }

    pub(super) fn exposed(&self, sensor: &Sensor, random: ImageStreams<'_>) -> Image {
        let columns = self.columns as usize;
        let size = (self.columns, self.rows);
        sensor.expose_bands(size, ROWS, random.streams, random.noise, random.frame, |first, light| {
            copy(&self.pixels[first * stride(columns)..], columns, light);
        })
    }
}

/// The pixels of one window; `None` if it has none.
pub(super) fn patch(window: Window, draw: impl FnOnce(ImageBand)) -> Option<ExpectedPatch> {
    if window.area() == 0 {
        return None;
    }
    let stride = stride(window.width);
    let mut pixels = vec![0.0; window.height * stride];
    draw(ImageBand { x0: window.x0, y0: window.y0, stride, pixels: &mut pixels });
    let mut counts = Vec::with_capacity(window.area());
    let rows = pixels.chunks_exact(stride).map(|row| &row[..window.width]);
    rows.for_each(|row| counts.extend(row.iter().copied().map(f64::from)));
    Some(ExpectedPatch { window, counts })
}

/// Distance in memory between rows of `columns` pixels: spheres are drawn in groups of pixels, the last of
/// which may extend beyond the row.
fn stride(columns: usize) -> usize {
    columns + LANES
}

/// Copies rows of `columns` pixels, as many as fit into `pixels`.
fn copy(band: &[f32], columns: usize, pixels: &mut [f64]) {
    for (from, to) in band.chunks_exact(stride(columns)).zip(pixels.chunks_exact_mut(columns)) {
        to.iter_mut().zip(from).for_each(|(to, from)| *to = f64::from(*from));
    }
}
