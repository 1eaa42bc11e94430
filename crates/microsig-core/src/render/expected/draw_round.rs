//! Drawing round images: every pixel finds its place along the radius.
//!
//! Planes are blended into one line of coefficients for each order of the azimuth. From these a record is made for every half
//! node: the value and the slope of the orders 0 and 4, and as many records more as there are orders. A pixel reads the
//! record next to its place, all at once, and follows the slopes from there.

use super::draw::{Canvas, Sphere};
use super::layout::LANES;
use super::rings::Rings;
use crate::render::patch::Window;

/// Added to a number below 2^22 and taken away again it leaves the nearest whole one.
const WHOLE: f32 = 8_388_608.0;

/// Records per node.
const PER_NODE: usize = 2;

/// Values and slopes, per record, of two orders of the azimuth: value and slope of the lower one, then of the higher.
type Record = [f32; 4];

/// Working memory.
#[derive(Default)]
pub(super) struct RoundBrush {
    /// Coefficients by order: that of node 1, which stands before node 0 as its mirror image, those of all nodes, and dark
    /// ones behind the last; for the last order a dark one, if their number is odd.
    lines: Vec<f32>,
    /// Records along the radius, those of all pairs of orders side by side.
    records: Vec<Record>,
}

impl RoundBrush {
    /// Draws a sphere with so many pairs of orders.
    #[inline(always)]
    pub(super) fn add<const PAIRS: usize>(&mut self, sphere: &Sphere, rings: &Rings, canvas: &mut Canvas) {
        let rows = canvas.rows(&sphere.window);
        self.blend::<PAIRS>(sphere, rings);
        self.records.resize(PAIRS * (PER_NODE * (rings.columns + 2) + 1), Record::default());
        let records = self.records.as_chunks_mut::<PAIRS>().0;
        record(&self.lines, records);
        let per_px = PER_NODE as f64 * rings.per_px(sphere.z_um);
        // From here on all is dark.
        let last = records.len() - 1;
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
            let pixels = &mut canvas.row(&sphere.window, y)[start..end];
            let row = Row { dx, dy: dy as f32, per_px: per_px as f32, last: last as f32 };
            row.add(records, pixels);
        }
    }

    /// Blends the planes' coefficients.
    #[inline(always)]
    fn blend<const PAIRS: usize>(&mut self, sphere: &Sphere, rings: &Rings) {
        let (columns, length) = (rings.columns, rings.columns + 4);
        self.lines.clear();
        self.lines.resize(2 * PAIRS * length, 0.0);
        let mut planes = sphere.block.around(sphere.z_um, sphere.radius_um);
        while let (Some(a), Some(b), Some(c), Some(d)) =
            (planes.next(), planes.next(), planes.next(), planes.next())
        {
            let four = [a, b, c, d];
            let w = [0, 1, 2, 3].map(|i| (four[i].weight * sphere.light) as f32);
            for (order, line) in self.lines.chunks_exact_mut(length).take(rings.orders).enumerate() {
                let [a, b, c, d] = [0, 1, 2, 3].map(|i| &four[i].coefficients[order * columns..][..columns]);
                let line = &mut line[1..=columns];
                for ((((out, a), b), c), d) in line.iter_mut().zip(a).zip(b).zip(c).zip(d) {
                    *out += (w[0] * a + w[1] * b) + (w[2] * c + w[3] * d);
                }
            }
        }
        self.lines.chunks_exact_mut(length).for_each(|line| line[0] = line[2]);
    }
}

/// Makes records from lines of coefficients.
#[inline(always)]
fn record<const PAIRS: usize>(lines: &[f32], records: &mut [[Record; PAIRS]]) {
    let length = lines.len() / (2 * PAIRS);
    for (pair, lines) in lines.chunks_exact(2 * length).enumerate() {
        let (low, high) = lines.split_at(length);
        let near = low.windows(3).zip(high.windows(3));
        for (records, (low, high)) in records.as_chunks_mut::<PER_NODE>().0.iter_mut().zip(near) {
            let [low, high] = [low, high].map(|near| tangents([near[0], near[1], near[2]]));
            records[0][pair] = [low[0][0], low[0][1], high[0][0], high[0][1]];
            records[1][pair] = [low[1][0], low[1][1], high[1][0], high[1][1]];
        }
    }
    if let Some(dark) = records.last_mut() {
        *dark = [Record::default(); PAIRS];
    }
}

/// Value and slope, per record, of a quadratic spline at the node of the second of three coefficients, and half way to the
/// next node.
#[inline(always)]
fn tangents([a, b, c]: [f32; 3]) -> [[f32; 2]; 2] {
    // With a twelfth of the curvature's part at the ends, straight lines have the middles of the curve.
    let curvature = (a - 2.0 * b + c) * (1.0 / 96.0);
    [[0.125 * (a + c) + 0.75 * b + curvature, 0.25 * (c - a)], [0.5 * (b + c), 0.5 * (c - b)]]
}

/// A row of pixels.
struct Row {
    /// The first pixel's place relative to the sphere, px.
    dx: f32,
    dy: f32,
    /// Records per px, and the number of the last, which is dark.
    per_px: f32,
    last: f32,
}

impl Row {
    #[inline(always)]
    fn add<const PAIRS: usize>(&self, records: &[[Record; PAIRS]], pixels: &mut [f64]) {
        let (full, rest) = pixels.as_chunks_mut::<LANES>();
        for (k, pixels) in full.iter_mut().enumerate() {
            let light = self.light(records, k);
            for i in 0..LANES {
                pixels[i] += f64::from(light[i]);
            }
        }
        if !rest.is_empty() {
            let light = self.light(records, full.len());
            rest.iter_mut().zip(light).for_each(|(pixel, light)| *pixel += f64::from(light));
        }
    }

    /// f0(r) + f4(r) cos 4 psi + ... of a run of pixels.
    #[inline(always)]
    fn light<const PAIRS: usize>(&self, records: &[[Record; PAIRS]], run: usize) -> [f32; LANES] {
        let (mut nodes, mut beyond, mut cos4) = ([0u32; LANES], [0.0f32; LANES], [0.0f32; LANES]);
        let dx = self.dx + (run * LANES) as f32;
        for i in 0..LANES {
            let x = dx + i as f32;
            let r2 = x * x + self.dy * self.dy;
            let place = r2.sqrt() * self.per_px;
            let place = if place < self.last { place } else { self.last };
            let whole = place + WHOLE;
            nodes[i] = whole.to_bits() & 0x007F_FFFF;
            beyond[i] = place - (whole - WHOLE);
            let cross = x * self.dy / if r2 > f32::MIN_POSITIVE { r2 } else { f32::MIN_POSITIVE };
            cos4[i] = 1.0 - 8.0 * cross * cross;
        }
        let near = nodes.map(|node| records[node as usize]);
        let mut light = [0.0; LANES];
        for i in 0..LANES {
            let at = |order: usize| {
                let record = near[i][order / 2];
                record[2 * (order % 2)] + beyond[i] * record[2 * (order % 2) + 1]
            };
            // Clenshaw's sum of the orders.
            let (mut next, mut after) = (at(2 * PAIRS - 1), 0.0);
            for order in (1..2 * PAIRS - 1).rev() {
                (next, after) = (at(order) + 2.0 * cos4[i] * next - after, next);
            }
            light[i] = at(0) + cos4[i] * next - after;
        }
        light
    }
}
