//! The image of one sphere and its derivatives in f64, for fits and error bounds.

use super::depth_table::{DepthTable, PlaneLayout};
use super::quadrant_layout::QuadrantLayout;
use super::radial_layout::RadialLayout;
use crate::bspline;

/// An interpolated plane and its derivative with respect to depth.
pub(super) struct InterpolatedImage<'a> {
    layout: &'a PlaneLayout,
    z_um: f64,
    value: Vec<f64>,
    by_z: Vec<f64>,
}

impl<'a> InterpolatedImage<'a> {
    pub(super) fn new(table: &'a DepthTable, z_um: f64, radius_um: f64) -> Self {
        let layout = &table.layout;
        let (mut value, mut by_z) = (vec![0.0; layout.length()], vec![0.0; layout.length()]);
        for plane in table.planes_around(z_um, radius_um).flatten() {
            for ((v, d), &c) in value.iter_mut().zip(&mut by_z).zip(plane.coefficients) {
                *v += plane.weight * f64::from(c);
                *d += plane.by_z * f64::from(c);
            }
        }
        InterpolatedImage { layout, z_um, value, by_z }
    }

    /// The light on a pixel at (`dx`, `dy`) from the particle (px), and its derivatives with respect to the
    /// position of the pixel (1/px) and the depth of the particle (1/um): value, d/dx, d/dy, d/dz.
    pub(super) fn at(&self, dx: f64, dy: f64) -> [f64; 4] {
        match self.layout {
            PlaneLayout::Radial(rings) => self.round(rings, dx, dy),
            PlaneLayout::Quadrant(layout) => self.quadrant(layout, dx, dy),
        }
    }

    /// f0(r) + f4(r) cos 4 psi + f8(r) cos 8 psi + ...
    fn round(&self, rings: &RadialLayout, dx: f64, dy: f64) -> [f64; 4] {
        let (columns, per_px) = (rings.columns, rings.per_px(self.z_um));
        let r2 = dx * dx + dy * dy;
        let r = libm::sqrt(r2);
        let node = libm::floor(r * per_px + 0.5);
        let (weights, slopes) = bspline::quadratic(r * per_px - node);
        let near = [0, 1, 2].map(|i| (node as isize + i - 1).unsigned_abs());
        // On the axis, orders above 0 and all lateral derivatives vanish.
        let inverse = if r2 > 0.0 { 1.0 / r2 } else { 0.0 };
        let cross = dx * dy * inverse;
        let cos4 = 1.0 - 8.0 * cross * cross;
        // The derivative of the azimuth psi is (-dy, dx) / r^2; sin 4 psi = 4 cos psi sin psi (cos^2 -
        // sin^2).
        let sin4 = 4.0 * cross * (dx * dx - dy * dy) * inverse;
        let radial = [dx, dy].map(|d| if r > 0.0 { d / r } else { 0.0 });
        let mut sum = [0.0; 4];
        // cos and sin of the next order, by the addition theorem.
        let (mut cosine, mut sine) = (1.0, 0.0);
        for (order, (values, by_z)) in self.value.chunks(columns).zip(self.by_z.chunks(columns)).enumerate() {
            let (factor, by_azimuth) = (cosine, -4.0 * order as f64 * sine);
            (cosine, sine) = (cosine * cos4 - sine * sin4, sine * cos4 + cosine * sin4);
            let along = |line: &[f64], weights: [f64; 3]| -> f64 {
                let c = |node: usize| line.get(node).copied().unwrap_or(0.0);
                (0..3).map(|i| weights[i] * c(near[i])).sum()
            };
            let (value, slope) = (along(values, weights), along(values, slopes) * per_px);
            sum[0] += factor * value;
            sum[1] += factor * slope * radial[0] - by_azimuth * value * dy * inverse;
            sum[2] += factor * slope * radial[1] + by_azimuth * value * dx * inverse;
            // The node spacing depends on depth: the image is stretched.
            sum[3] += factor * (along(by_z, weights) + slope * r * rings.per_px_by_z(self.z_um));
        }
        sum
    }

    fn quadrant(&self, layout: &QuadrantLayout, dx: f64, dy: f64) -> [f64; 4] {
        let scale = layout.per_px as f64;
        let (first_x, weights_x, slopes_x) = place(dx.abs() * scale);
        let (first_y, weights_y, slopes_y) = place(dy.abs() * scale);
        let mut sum = [0.0; 4];
        for j in 0..4 {
            let row = (first_y + j as isize).unsigned_abs();
            if row >= layout.rows {
                continue;
            }
            let (mut value, mut slope, mut by_z) = (0.0, 0.0, 0.0);
            for i in 0..4 {
                let Some(at) = layout.place((first_x + i as isize).unsigned_abs()) else { continue };
                let at = row * layout.row() + at;
                value += weights_x[i] * self.value[at];
                slope += slopes_x[i] * self.value[at];
                by_z += weights_x[i] * self.by_z[at];
            }
            sum[0] += weights_y[j] * value;
            sum[1] += weights_y[j] * slope * scale;
            sum[2] += slopes_y[j] * value * scale;
            sum[3] += weights_y[j] * by_z;
        }
        [sum[0], sum[1] * dx.signum(), sum[2] * dy.signum(), sum[3]]
    }
}

/// The index of the first of the four coefficients around a position (in nodes), their weights and the
/// derivatives of these.
fn place(nodes: f64) -> (isize, [f64; 4], [f64; 4]) {
    let cell = libm::floor(nodes);
    let (weights, slopes) = bspline::cubic(nodes - cell);
    (cell as isize - 1, weights, slopes)
}
