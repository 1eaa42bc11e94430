//! Drawing round images: every pixel finds its place along the radius.
//!
//! Planes are blended into one line of coefficients for each order of the azimuth. A row of pixels goes through three
//! passes: places along the radius, many at a time; the three coefficients around each, one pixel after the other; and their
//! sums, many at a time again.

use super::draw::{Canvas, Sphere};
use super::layout::LANES;
use super::rings::Rings;
use crate::render::patch::Window;

/// Added to a number below 2^22 and taken away again it leaves the nearest whole one.
const WHOLE: f32 = 8_388_608.0;

/// Working memory.
#[derive(Default)]
pub(super) struct RoundBrush {
    /// Coefficients by order: that of node 1, which stands before node 0 as its mirror image, those of all nodes, and dark
    /// ones behind the last.
    lines: Vec<f32>,
    /// Of the pixels of a row: the node next to each, how far beyond it the pixel lies, and cos 4 psi.
    nodes: Vec<u32>,
    beyond: Vec<f32>,
    cos4: Vec<f32>,
    /// The coefficients about those nodes: by order and neighbour, a run of pixels each.
    near: Vec<f32>,
    values: Vec<f32>,
}

impl RoundBrush {
    #[inline(always)]
    pub(super) fn add<const ORDERS: usize>(&mut self, sphere: &Sphere, rings: &Rings, canvas: &mut Canvas) {
        let line = rings.columns + 4;
        self.blend(sphere, rings, line);
        let per_px = rings.per_px(sphere.z_um);
        // From here on all is dark.
        let last = rings.columns + 1;
        let reach = last as f64 / per_px;
        let Window { x0, width, .. } = sphere.window;
        for y in canvas.rows(&sphere.window) {
            let dy = y as f64 - sphere.y_px;
            let half = (reach * reach - dy * dy).max(0.0).sqrt();
            // The part of the row that the image lights.
            let start = (libm::ceil(sphere.x_px - half) as i64 - x0).clamp(0, width as i64) as usize;
            let end =
                (libm::floor(sphere.x_px + half) as i64 + 1 - x0).clamp(start as i64, width as i64) as usize;
            if start == end {
                continue;
            }
            let dx = ((x0 + start as i64) as f64 - sphere.x_px) as f32;
            self.reserve(ORDERS, end - start);
            self.place::<ORDERS>(dx, dy as f32, per_px as f32, last as f32);
            self.gather::<ORDERS>(line);
            self.sum::<ORDERS>();
            let pixels = &mut canvas.row(&sphere.window, y)[start..end];
            for (pixel, &value) in pixels.iter_mut().zip(&self.values) {
                *pixel += f64::from(value);
            }
        }
    }

    #[inline(always)]
    fn blend(&mut self, sphere: &Sphere, rings: &Rings, line: usize) {
        let columns = rings.columns;
        self.lines.clear();
        self.lines.resize(line * rings.orders, 0.0);
        let mut planes = sphere.block.around(sphere.z_um, sphere.radius_um);
        while let (Some(a), Some(b), Some(c), Some(d)) =
            (planes.next(), planes.next(), planes.next(), planes.next())
        {
            let four = [a, b, c, d];
            let w = [0, 1, 2, 3].map(|i| (four[i].weight * sphere.light) as f32);
            for (order, out) in self.lines.chunks_exact_mut(line).enumerate() {
                let [a, b, c, d] = [0, 1, 2, 3].map(|i| &four[i].coefficients[order * columns..][..columns]);
                for (i, out) in out[1..=columns].iter_mut().enumerate() {
                    *out += (w[0] * a[i] + w[1] * b[i]) + (w[2] * c[i] + w[3] * d[i]);
                }
            }
        }
        for line in self.lines.chunks_exact_mut(line) {
            line[0] = line[2];
        }
    }

    /// Makes room for the pixels of a row.
    #[inline(always)]
    fn reserve(&mut self, orders: usize, pixels: usize) {
        let n = pixels.next_multiple_of(LANES);
        self.nodes.resize(n, 0);
        self.near.resize(3 * orders * n, 0.0);
        for line in [&mut self.beyond, &mut self.cos4, &mut self.values] {
            line.resize(n, 0.0);
        }
    }

    #[inline(always)]
    fn place<const ORDERS: usize>(&mut self, dx: f32, dy: f32, per_px: f32, last: f32) {
        let nodes = self.nodes.as_chunks_mut::<LANES>().0;
        let beyond = self.beyond.as_chunks_mut::<LANES>().0;
        let cos4 = self.cos4.as_chunks_mut::<LANES>().0;
        for (k, ((nodes, beyond), cos4)) in nodes.iter_mut().zip(beyond).zip(cos4).enumerate() {
            let dx = dx + (k * LANES) as f32;
            for i in 0..LANES {
                let x = dx + i as f32;
                let r2 = x * x + dy * dy;
                let place = r2.sqrt() * per_px;
                let place = if place < last { place } else { last };
                let whole = place + WHOLE;
                nodes[i] = whole.to_bits() & 0x007F_FFFF;
                beyond[i] = place - (whole - WHOLE);
                if ORDERS > 1 {
                    let cross = x * dy / if r2 > f32::MIN_POSITIVE { r2 } else { f32::MIN_POSITIVE };
                    cos4[i] = 1.0 - 8.0 * cross * cross;
                }
            }
        }
    }

    #[inline(always)]
    fn gather<const ORDERS: usize>(&mut self, line: usize) {
        let n = self.nodes.len();
        let lines: [&[f32]; ORDERS] = std::array::from_fn(|order| &self.lines[order * line..][..line]);
        let mut near = self.near.chunks_exact_mut(n);
        let mut near: [[&mut [f32]; 3]; ORDERS] =
            std::array::from_fn(|_| std::array::from_fn(|_| near.next().unwrap_or_default()));
        for (i, &node) in self.nodes.iter().enumerate() {
            let node = node as usize;
            for (line, near) in lines.iter().zip(&mut near) {
                let three = &line[node..node + 3];
                near[0][i] = three[0];
                near[1][i] = three[1];
                near[2][i] = three[2];
            }
        }
    }

    /// f0(r) + f4(r) cos 4 psi + ...
    #[inline(always)]
    fn sum<const ORDERS: usize>(&mut self) {
        let n = self.nodes.len();
        let mut near = self.near.chunks_exact(n);
        let near: [[&[[f32; LANES]]; 3]; ORDERS] = std::array::from_fn(|_| {
            std::array::from_fn(|_| near.next().unwrap_or_default().as_chunks::<LANES>().0)
        });
        let beyond = self.beyond.as_chunks::<LANES>().0;
        let cos4 = self.cos4.as_chunks::<LANES>().0;
        for (k, values) in self.values.as_chunks_mut::<LANES>().0.iter_mut().enumerate() {
            let (beyond, cos4) = (&beyond[k], &cos4[k]);
            let near: [[&[f32; LANES]; 3]; ORDERS] =
                std::array::from_fn(|order| std::array::from_fn(|j| &near[order][j][k]));
            let mut sums = [0.0; LANES];
            for i in 0..LANES {
                let (low, high) = (0.5 - beyond[i], 0.5 + beyond[i]);
                let weights = [0.5 * low * low, 0.75 - beyond[i] * beyond[i], 0.5 * high * high];
                let at = |order: usize| {
                    let [a, b, c] = near[order];
                    (weights[0] * a[i] + weights[1] * b[i]) + weights[2] * c[i]
                };
                // Clenshaw's sum of the orders.
                let (mut next, mut after) = (0.0, 0.0);
                for order in (1..ORDERS).rev() {
                    (next, after) = (at(order) + 2.0 * cos4[i] * next - after, next);
                }
                sums[i] = at(0) + cos4[i] * next - after;
            }
            *values = sums;
        }
    }
}
