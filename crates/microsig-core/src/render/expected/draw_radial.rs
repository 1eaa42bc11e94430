//! Drawing of round images from splines along the radius.
//!
//! The planes are interpolated to one line of coefficients per azimuthal order, from which the quadratic
//! polynomial around each node is computed. The node of every pixel is found; the polynomials of many pixels
//! are then loaded one by one and evaluated in vectors. Only + and * in a fixed order, never fused, and
//! correctly rounded roots and quotients occur: every instruction set gives the same bits.

use super::depth_table::PlaneLayout;
use super::radial_layout::RadialLayout;
use crate::render::image_sum::{Group, ImageBand, LANES, SphereImage};
use crate::render::patch::Window;

/// Adding and subtracting this rounds a number below 2^22 to the nearest integer.
const WHOLE: f32 = 8_388_608.0;

/// Number of pixels whose polynomials are loaded before they are evaluated: their data fit into the L1 cache.
const BATCH: usize = 512;

/// The number of pixels in a batch is a multiple of this.
const STRIP: usize = 64;

/// The polynomial around a node: value, slope and half the second derivative, in units of nodes; the fourth
/// element is padding.
type Quadratic = [f32; 4];

/// Working memory.
#[derive(Debug, Default)]
pub(super) struct RadialInterpolator {
    /// Coefficients by order: of node 1 as the mirror image before node 0, of all nodes, and zeros
    /// after the last.
    lines: Vec<f32>,
    /// By order and node.
    quadratics: Vec<Quadratic>,
    batch: Batch,
}

/// A batch of pixels, in groups along their rows.
#[derive(Debug, Default)]
struct Batch {
    /// For each row, the position of its first group on the band and the number of groups.
    rows: Vec<(usize, usize)>,
    nodes: Vec<[u32; LANES]>,
    /// Positions of the pixels relative to their nodes, in units of nodes.
    beyond: Vec<Group>,
    /// cos 4 psi.
    cos4: Vec<Group>,
    /// Polynomials of the pixels for one order.
    near: Vec<Quadratic>,
    /// Clenshaw sums of the orders from this one on (`sums`) and of the orders above it (`above`).
    sums: Vec<f32>,
    above: Vec<f32>,
}

impl RadialInterpolator {
    #[inline(always)]
    pub(super) fn add(
        &mut self,
        sphere: &SphereImage<PlaneLayout>,
        rings: &RadialLayout,
        band: &mut ImageBand,
    ) {
        let rows = band.rows(&sphere.window);
        self.blend(sphere, rings);
        self.solve(rings.orders);
        let per_px = rings.per_px(sphere.z_um);
        // Zero from the last node on.
        let last = rings.columns + 1;
        let reach = last as f64 / per_px;
        let Window { x0, width, .. } = sphere.window;
        for y in rows {
            let dy = y as f64 - sphere.y_px;
            let half = (reach * reach - dy * dy).max(0.0).sqrt();
            // The part of the row that the image covers.
            let start = (libm::ceil(sphere.x_px - half) as i64 - x0).clamp(0, width as i64) as usize;
            let end =
                (libm::floor(sphere.x_px + half) as i64 + 1 - x0).clamp(start as i64, width as i64) as usize;
            let dx = ((x0 + start as i64) as f64 - sphere.x_px) as f32;
            let first = band.first(&sphere.window, y) + start;
            let pixels = end - start;
            self.batch.rows.push((first, pixels.div_ceil(LANES)));
            for done in (0..pixels).step_by(LANES) {
                let place = [dx + done as f32, dy as f32];
                self.batch.push(place, (pixels - done) as f32, per_px as f32, last as f32);
            }
            if self.batch.nodes.len() * LANES >= BATCH {
                self.batch.draw(&self.quadratics, last + 1, rings.orders, band.pixels);
            }
        }
        self.batch.draw(&self.quadratics, last + 1, rings.orders, band.pixels);
    }

    /// Interpolates the coefficients of the planes.
    #[inline(always)]
    fn blend(&mut self, sphere: &SphereImage<PlaneLayout>, rings: &RadialLayout) {
        let (columns, length) = (rings.columns, rings.columns + 4);
        self.lines.clear();
        self.lines.resize(rings.orders * length, 0.0);
        for four in sphere.table.planes_around(sphere.z_um, sphere.radius_um, sphere.at_px()) {
            let w: [f32; 4] = std::array::from_fn(|i| (four[i].weight * sphere.light) as f32);
            for (order, line) in self.lines.chunks_exact_mut(length).enumerate() {
                let order_range = order * columns..(order + 1) * columns;
                let a = &four[0].coefficients[order_range.clone()];
                let b = &four[1].coefficients[order_range.clone()];
                let c = &four[2].coefficients[order_range.clone()];
                let d = &four[3].coefficients[order_range];
                for ((((out, a), b), c), d) in line[1..=columns].iter_mut().zip(a).zip(b).zip(c).zip(d) {
                    *out += (w[0] * a + w[1] * b) + (w[2] * c + w[3] * d);
                }
            }
        }
        self.lines.chunks_exact_mut(length).for_each(|line| line[0] = line[2]);
    }

    /// Computes the polynomials around the nodes from the spline coefficients.
    #[inline(always)]
    fn solve(&mut self, orders: usize) {
        let length = self.lines.len() / orders;
        self.quadratics.resize(orders * (length - 2), Quadratic::default());
        let order_chunks = self.quadratics.chunks_exact_mut(length - 2);
        for (line, out) in self.lines.chunks_exact(length).zip(order_chunks) {
            for (out, near) in out.iter_mut().zip(line.windows(3)) {
                let ends = near[0] + near[2];
                *out = [0.125 * ends + 0.75 * near[1], 0.5 * (near[2] - near[0]), 0.5 * ends - near[1], 0.0];
            }
        }
    }
}

impl Batch {
    /// Finds the nodes of a group of pixels, the first of which is at (`dx`, `dy`) from the sphere (px).
    /// Pixels after the first `pixels` are set to zero.
    #[inline(always)]
    fn push(&mut self, [dx, dy]: [f32; 2], pixels: f32, per_px: f32, last: f32) {
        let (mut nodes, mut beyond, mut cos4) = ([0; LANES], Group::default(), Group::default());
        for i in 0..LANES {
            let x = dx + i as f32;
            let r2 = x * x + dy * dy;
            let place = r2.sqrt() * per_px;
            let place = if place < last && (i as f32) < pixels { place } else { last };
            let whole = place + WHOLE;
            nodes[i] = whole.to_bits() & 0x007F_FFFF;
            beyond[i] = place - (whole - WHOLE);
            let cross = x * dy / if r2 > f32::MIN_POSITIVE { r2 } else { f32::MIN_POSITIVE };
            cos4[i] = 1.0 - 8.0 * cross * cross;
        }
        self.nodes.push(nodes);
        self.beyond.push(beyond);
        self.cos4.push(cos4);
    }

    /// Adds f0(r) + f4(r) cos 4 psi + ... to the pixels, and clears the batch.
    #[inline(always)]
    fn draw(&mut self, quadratics: &[Quadratic], per_order: usize, orders: usize, pixels: &mut [f32]) {
        // Padded to whole strips, so that loops have no remainder.
        while !self.nodes.len().is_multiple_of(STRIP / LANES) {
            self.nodes.push([per_order as u32 - 1; LANES]);
            self.beyond.push(Group::default());
            self.cos4.push(Group::default());
        }
        let n = self.nodes.len() * LANES;
        for sums in [&mut self.sums, &mut self.above] {
            sums.clear();
            sums.resize(n, 0.0);
        }
        self.near.resize(n, Quadratic::default());
        let (beyond, cos4) = (self.beyond.as_flattened(), self.cos4.as_flattened());
        for (order, order_range) in quadratics.chunks_exact(per_order).enumerate().take(orders).rev() {
            for (near, &node) in self.near.iter_mut().zip(self.nodes.as_flattened()) {
                *near = order_range[node as usize];
            }
            // Clenshaw summation of the orders; in its last step cos 4 psi is not doubled.
            let twice = if order == 0 { 1.0 } else { 2.0 };
            let places = self.near.iter().zip(beyond).zip(cos4);
            for ((sum, above), ((q, t), cos4)) in self.sums.iter_mut().zip(&mut self.above).zip(places) {
                let next = (q[0] + t * (q[1] + t * q[2])) + twice * cos4 * *sum - *above;
                *above = *sum;
                *sum = next;
            }
        }
        let mut sums = self.sums.as_chunks::<LANES>().0.iter();
        for (first, groups) in self.rows.drain(..) {
            let pixels = pixels[first..].as_chunks_mut::<LANES>().0;
            for (pixels, sums) in pixels[..groups].iter_mut().zip(&mut sums) {
                for i in 0..LANES {
                    pixels[i] += sums[i];
                }
            }
        }
        self.nodes.clear();
        self.beyond.clear();
        self.cos4.clear();
    }
}
