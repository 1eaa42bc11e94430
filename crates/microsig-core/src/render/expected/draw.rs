//! Pixels of one sphere from its block, in f32, many at a time.
//!
//! Only + - * / sqrt and comparisons occur, each correctly rounded and never fused, so that every instruction set gives
//! the same bits.

use super::block::{Block, Layout};
use crate::render::patch::Window;

/// Pixels computed in one stroke.
const WIDE: usize = 16;

/// A sphere's image, ready to be evaluated row by row.
#[derive(Debug, Clone)]
pub(super) struct Drawing {
    pub(super) window: Window,
    x_px: f64,
    y_px: f64,
    /// Nodes per px.
    per_px: f32,
    image: Shape,
}

#[derive(Debug, Clone)]
enum Shape {
    /// For each order of the azimuth the cubic polynomials of the cells between nodes, and a last one that is zero.
    Round { orders: usize, cells: Vec<[f32; 4]> },
    /// Spline coefficients of a quadrant, row by row.
    Quadrant { columns: usize, rows: usize, coefficients: Vec<f32> },
}

impl Drawing {
    /// The image of a sphere whose total light is `light`, on the pixels of `window`.
    pub(super) fn new(block: &Block, place: [f64; 3], radius_um: f64, light: f64, window: Window) -> Self {
        let [x_px, y_px, z_um] = place;
        let layout = block.layout;
        let mut blended = vec![0.0f32; layout.columns * layout.rows];
        let mut step_px = 0.0;
        for plane in block.around(z_um, radius_um) {
            step_px += plane.weight * plane.step_px;
            let weight = (plane.weight * light) as f32;
            blended.iter_mut().zip(plane.coefficients).for_each(|(sum, c)| *sum += weight * c);
        }
        let Layout { columns, rows, .. } = layout;
        let image = if layout.round {
            Shape::Round { orders: rows, cells: blended.chunks(columns).flat_map(polynomials).collect() }
        } else {
            Shape::Quadrant { columns, rows, coefficients: blended }
        };
        Drawing { window, x_px, y_px, per_px: (1.0 / step_px) as f32, image }
    }

    /// Adds the image to row `row` (from 0) of the sensor.
    pub(super) fn add_row(&self, row: usize, pixels: &mut [f64]) {
        let line = row as i64 + 1 - self.window.y0;
        if line < 0 || line >= self.window.height as i64 {
            return;
        }
        let first = (self.window.x0 - 1) as usize;
        self.add_line(line as usize, &mut pixels[first..first + self.window.width]);
    }

    /// Adds the image to all pixels of its window.
    pub(super) fn add_to(&self, pixels: &mut [f64]) {
        for (line, pixels) in pixels.chunks_mut(self.window.width).enumerate() {
            self.add_line(line, pixels);
        }
    }

    fn add_line(&self, line: usize, pixels: &mut [f64]) {
        let dx = (self.window.x0 as f64 - self.x_px) as f32;
        let dy = ((self.window.y0 + line as i64) as f64 - self.y_px) as f32;
        match &self.image {
            Shape::Round { orders, cells } => self.add_round(*orders, cells, dx, dy, pixels),
            Shape::Quadrant { columns, rows, coefficients } => {
                self.add_quadrant(*columns, *rows, coefficients, dx, dy, pixels);
            }
        }
    }

    fn add_quadrant(
        &self,
        columns: usize,
        rows: usize,
        coefficients: &[f32],
        dx: f32,
        dy: f32,
        pixels: &mut [f64],
    ) {
        // The spline along rows first: the line of coefficients that this row of pixels sees, mirrored to both sides.
        let (first_row, weights) = place(dy.abs() * self.per_px);
        let mut line = vec![0.0f32; columns];
        for (j, weight) in weights.into_iter().enumerate() {
            let row = (first_row + j as isize).unsigned_abs();
            if row < rows {
                let source = &coefficients[row * columns..][..columns];
                line.iter_mut().zip(source).for_each(|(sum, c)| *sum += weight * c);
            }
        }
        for (i, pixel) in pixels.iter_mut().enumerate() {
            let (first, weights) = place((dx + i as f32).abs() * self.per_px);
            let mut value = 0.0;
            for (k, weight) in weights.into_iter().enumerate() {
                value += weight * line.get((first + k as isize).unsigned_abs()).copied().unwrap_or(0.0);
            }
            *pixel += f64::from(value);
        }
    }

    fn add_round(&self, orders: usize, cells: &[[f32; 4]], dx: f32, dy: f32, pixels: &mut [f64]) {
        let scale = self.per_px;
        let cells_each = cells.len() / orders;
        let last = (cells_each - 1) as u32;
        let dy2 = dy * dy;
        for (chunk, pixels) in pixels.chunks_mut(WIDE).enumerate() {
            let start = dx + (chunk * WIDE) as f32;
            let mut values = [0.0f32; WIDE];
            for (i, value) in values.iter_mut().enumerate() {
                let x = start + i as f32;
                let r2 = x * x + dy2;
                let nodes = r2.sqrt() * scale;
                let cell = (nodes as u32).min(last);
                let t = nodes - cell as f32;
                let at = |order: usize| {
                    let [a, b, c, d] = cells[order * cells_each + cell as usize];
                    ((d * t + c) * t + b) * t + a
                };
                // Clenshaw's sum of the harmonics of the azimuth.
                let cross = x * dy / r2.max(f32::MIN_POSITIVE);
                let cos4 = 1.0 - 8.0 * cross * cross;
                let (mut next, mut after) = (0.0, 0.0);
                for order in (1..orders).rev() {
                    (next, after) = (at(order) + 2.0 * cos4 * next - after, next);
                }
                *value = at(0) + cos4 * next - after;
            }
            for (pixel, value) in pixels.iter_mut().zip(values) {
                *pixel += f64::from(value);
            }
        }
    }
}

/// The first of the four coefficients around a place on an axis of nodes, and their weights.
fn place(nodes: f32) -> (isize, [f32; 4]) {
    let cell = nodes as isize;
    let t = nodes - cell as f32;
    let s = 1.0 - t;
    const SIXTH: f32 = 1.0 / 6.0;
    let (t2, s2) = (t * t, s * s);
    let weights = [
        s2 * s * SIXTH,
        (4.0 - 6.0 * t2 + 3.0 * t2 * t) * SIXTH,
        (4.0 - 6.0 * s2 + 3.0 * s2 * s) * SIXTH,
        t2 * t * SIXTH,
    ];
    (cell - 1, weights)
}

/// The polynomial of each cell of a spline that is even about its first node, and a last one that is zero.
fn polynomials(c: &[f32]) -> Vec<[f32; 4]> {
    let at = |k: isize| c.get(k.unsigned_abs()).copied().unwrap_or(0.0);
    (0..=c.len() as isize)
        .map(|k| {
            let (a, b, c, d) = (at(k - 1), at(k), at(k + 1), at(k + 2));
            const SIXTH: f32 = 1.0 / 6.0;
            [
                (a + 4.0 * b + c) * SIXTH,
                (c - a) * 0.5,
                (a - 2.0 * b + c) * 0.5,
                (d - a + 3.0 * (b - c)) * SIXTH,
            ]
        })
        .chain([[0.0; 4]])
        .collect()
}
