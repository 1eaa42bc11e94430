//! One sphere's image and its derivatives, in f64: for fits and bounds rather than for drawing.

use super::block::{Block, Layout};
use super::spline;

/// A blended plane and its derivative by depth.
pub(super) struct Sheet {
    layout: Layout,
    /// Nodes per px, and its derivative by depth, 1/um.
    per_px: f64,
    per_px_by_z: f64,
    value: Vec<f64>,
    by_z: Vec<f64>,
}

impl Sheet {
    pub(super) fn new(block: &Block, z_um: f64, radius_um: f64) -> Self {
        let layout = block.layout;
        let length = layout.columns * layout.rows;
        let (mut value, mut by_z) = (vec![0.0; length], vec![0.0; length]);
        let (mut step_px, mut step_by_z) = (0.0, 0.0);
        for plane in block.around(z_um, radius_um) {
            step_px += plane.weight * plane.step_px;
            step_by_z += plane.by_z * plane.step_px;
            for ((v, d), &c) in value.iter_mut().zip(&mut by_z).zip(plane.coefficients) {
                *v += plane.weight * f64::from(c);
                *d += plane.by_z * f64::from(c);
            }
        }
        Sheet { layout, per_px: 1.0 / step_px, per_px_by_z: -step_by_z / (step_px * step_px), value, by_z }
    }

    /// The light on a pixel this far from the particle, px, and its derivatives by the pixel's place (1/px) and by the
    /// particle's depth (1/um): value, by x, by y, by z.
    pub(super) fn at(&self, dx: f64, dy: f64) -> [f64; 4] {
        let evaluate =
            |c: &[f64]| if self.layout.round { self.round(c, dx, dy) } else { self.quadrant(c, dx, dy) };
        let [value, by_x, by_y] = evaluate(&self.value);
        // Nodes move with depth: the image is stretched.
        let stretched = (by_x * dx + by_y * dy) * self.per_px_by_z / self.per_px;
        [value, by_x, by_y, evaluate(&self.by_z)[0] + stretched]
    }

    /// f0(r) + f4(r) cos 4 psi + f8(r) cos 8 psi + ...
    fn round(&self, coefficients: &[f64], dx: f64, dy: f64) -> [f64; 3] {
        let columns = self.layout.columns;
        let r2 = dx * dx + dy * dy;
        let r = libm::sqrt(r2);
        let (first, weights, slopes) = place(r * self.per_px);
        let mut sum = [0.0; 3];
        // At the axis orders above 0 vanish, and so do all derivatives across.
        let inverse = if r2 > 0.0 { 1.0 / r2 } else { 0.0 };
        let cross = dx * dy * inverse;
        let cos4 = 1.0 - 8.0 * cross * cross;
        // The derivative of the azimuth psi is (-dy, dx) / r^2; sin 4 psi = 4 cos psi sin psi (cos^2 - sin^2).
        let sin4 = 4.0 * cross * (dx * dx - dy * dy) * inverse;
        let radial = [dx, dy].map(|d| if r > 0.0 { d / r } else { 0.0 });
        // cos and sin of the next order follow from those of the last one.
        let (mut cosine, mut sine) = (1.0, 0.0);
        for (order, line) in coefficients.chunks(columns).enumerate() {
            let (factor, by_azimuth) = (cosine, -4.0 * order as f64 * sine);
            (cosine, sine) = (cosine * cos4 - sine * sin4, sine * cos4 + cosine * sin4);
            let (mut value, mut slope) = (0.0, 0.0);
            for i in 0..4 {
                let c = mirrored(line, first + i as isize);
                value += weights[i] * c;
                slope += slopes[i] * c;
            }
            let slope = slope * self.per_px;
            sum[0] += factor * value;
            sum[1] += factor * slope * radial[0] - by_azimuth * value * dy * inverse;
            sum[2] += factor * slope * radial[1] + by_azimuth * value * dx * inverse;
        }
        sum
    }

    fn quadrant(&self, coefficients: &[f64], dx: f64, dy: f64) -> [f64; 3] {
        let Layout { columns, rows, .. } = self.layout;
        let scale = self.per_px;
        let (first_x, weights_x, slopes_x) = place(dx.abs() * scale);
        let (first_y, weights_y, slopes_y) = place(dy.abs() * scale);
        let mut sum = [0.0; 3];
        for j in 0..4 {
            let row = (first_y + j as isize).unsigned_abs();
            if row >= rows {
                continue;
            }
            let line = &coefficients[row * columns..][..columns];
            let (mut value, mut slope) = (0.0, 0.0);
            for i in 0..4 {
                let c = mirrored(line, first_x + i as isize);
                value += weights_x[i] * c;
                slope += slopes_x[i] * c;
            }
            sum[0] += weights_y[j] * value;
            sum[1] += weights_y[j] * slope * scale;
            sum[2] += slopes_y[j] * value * scale;
        }
        [sum[0], sum[1] * dx.signum(), sum[2] * dy.signum()]
    }
}

/// The first of the four coefficients around a place on an axis of nodes, with their weights and derivatives.
fn place(nodes: f64) -> (isize, [f64; 4], [f64; 4]) {
    let cell = libm::floor(nodes);
    let (weights, slopes) = spline::basis(nodes - cell);
    (cell as isize - 1, weights, slopes)
}

/// The coefficient of a node; those on the far side of node 0 are mirrored, those behind the last are zero.
fn mirrored(line: &[f64], node: isize) -> f64 {
    line.get(node.unsigned_abs()).copied().unwrap_or(0.0)
}
