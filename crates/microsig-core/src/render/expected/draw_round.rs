//! Drawing round images along their radius.
//!
//! Planes are blended into one line of coefficients for each order of the azimuth, and these become the quadratic of each node.
//! Every pixel finds its node; the quadratics of many pixels are then fetched one by one, and summed side by side. Only + and *
//! in a fixed order occur, never fused, and roots and quotients, which are exact: every instruction set gives the same bits.

use super::draw::{Canvas, Sphere};
use super::layout::{Group, LANES};
use super::rings::Rings;
use crate::render::patch::Window;

/// Added to a number below 2^22 and taken away again it leaves the nearest whole one.
const WHOLE: f32 = 8_388_608.0;

/// Pixels whose quadratics are fetched before they are summed: all that belongs to them stays in the nearest cache.
const BATCH: usize = 512;

/// Numbers of pixels in a batch are multiples of it.
const STRIP: usize = 64;

/// Around a node: the value there, its slope and half its curvature, per node.
type Quadratic = [f32; 4];

/// Working memory.
#[derive(Default)]
pub(super) struct RoundBrush {
    /// Coefficients by order: that of node 1, which stands before node 0 as its mirror image, those of all nodes, and dark
    /// ones behind the last.
    lines: Vec<f32>,
    /// By order and node.
    quadratics: Vec<Quadratic>,
    batch: Batch,
}

/// Some pixels, in groups along their rows.
#[derive(Default)]
struct Batch {
    /// Where each row's groups begin on the canvas, and how many there are.
    rows: Vec<(usize, usize)>,
    nodes: Vec<[u32; LANES]>,
    /// How far beyond their nodes pixels lie, in nodes.
    beyond: Vec<Group>,
    /// cos 4 psi.
    cos4: Vec<Group>,
    /// Their quadratics of one order.
    near: Vec<Quadratic>,
    /// Sums of this order and those above it, and of those above it alone.
    sums: Vec<f32>,
    above: Vec<f32>,
}

impl RoundBrush {
    #[inline(always)]
    pub(super) fn add(&mut self, sphere: &Sphere, rings: &Rings, canvas: &mut Canvas) {
        let rows = canvas.rows(&sphere.window);
        self.blend(sphere, rings);
        self.solve(rings.orders);
        let per_px = rings.per_px(sphere.z_um);
        // From the last node on all is dark.
        let last = rings.columns + 1;
        let reach = last as f64 / per_px;
        let Window { x0, width, .. } = sphere.window;
        for y in rows {
            let dy = y as f64 - sphere.y_px;
            let half = (reach * reach - dy * dy).max(0.0).sqrt();
            // The part of the row that the image lights.
            let start = (libm::ceil(sphere.x_px - half) as i64 - x0).clamp(0, width as i64) as usize;
            let end =
                (libm::floor(sphere.x_px + half) as i64 + 1 - x0).clamp(start as i64, width as i64) as usize;
            let dx = ((x0 + start as i64) as f64 - sphere.x_px) as f32;
            let first = canvas.first(&sphere.window, y) + start;
            let pixels = end - start;
            self.batch.rows.push((first, pixels.div_ceil(LANES)));
            for done in (0..pixels).step_by(LANES) {
                let place = [dx + done as f32, dy as f32];
                self.batch.push(place, (pixels - done) as f32, per_px as f32, last as f32);
            }
            if self.batch.nodes.len() * LANES >= BATCH {
                self.batch.draw(&self.quadratics, last + 1, rings.orders, canvas.pixels);
            }
        }
        self.batch.draw(&self.quadratics, last + 1, rings.orders, canvas.pixels);
    }

    /// Blends the planes' coefficients.
    #[inline(always)]
    fn blend(&mut self, sphere: &Sphere, rings: &Rings) {
        let (columns, length) = (rings.columns, rings.columns + 4);
        self.lines.clear();
        self.lines.resize(rings.orders * length, 0.0);
        for four in sphere.block.around(sphere.z_um, sphere.radius_um) {
            let w: [f32; 4] = std::array::from_fn(|i| (four[i].weight * sphere.light) as f32);
            for (order, line) in self.lines.chunks_exact_mut(length).enumerate() {
                let of_order = order * columns..(order + 1) * columns;
                let a = &four[0].coefficients[of_order.clone()];
                let b = &four[1].coefficients[of_order.clone()];
                let c = &four[2].coefficients[of_order.clone()];
                let d = &four[3].coefficients[of_order];
                for ((((out, a), b), c), d) in line[1..=columns].iter_mut().zip(a).zip(b).zip(c).zip(d) {
                    *out += (w[0] * a + w[1] * b) + (w[2] * c + w[3] * d);
                }
            }
        }
        self.lines.chunks_exact_mut(length).for_each(|line| line[0] = line[2]);
    }

    /// Makes the quadratics of nodes from coefficients.
    #[inline(always)]
    fn solve(&mut self, orders: usize) {
        let length = self.lines.len() / orders;
        self.quadratics.resize(orders * (length - 2), Quadratic::default());
        let of_orders = self.quadratics.chunks_exact_mut(length - 2);
        for (line, out) in self.lines.chunks_exact(length).zip(of_orders) {
            for (out, near) in out.iter_mut().zip(line.windows(3)) {
                let ends = near[0] + near[2];
                *out = [0.125 * ends + 0.75 * near[1], 0.5 * (near[2] - near[0]), 0.5 * ends - near[1], 0.0];
            }
        }
    }
}

impl Batch {
    /// Finds the nodes of a group of pixels of which the first lies at (`dx`, `dy`) from the sphere, px. Those beyond the
    /// first so many are dark.
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

    /// Adds f0(r) + f4(r) cos 4 psi + ... to the pixels, and forgets them.
    #[inline(always)]
    fn draw(&mut self, quadratics: &[Quadratic], per_order: usize, orders: usize, pixels: &mut [f32]) {
        // Loops over whole strips have no rest.
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
        for (order, of_order) in quadratics.chunks_exact(per_order).enumerate().take(orders).rev() {
            for (near, &node) in self.near.iter_mut().zip(self.nodes.as_flattened()) {
                *near = of_order[node as usize];
            }
            // Clenshaw's sum of the orders: for the last one cos 4 psi counts once.
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
