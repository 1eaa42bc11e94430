//! The image of one sphere and its derivatives in f64, for fits and error bounds: from a table, or computed
//! for its own depth.

use super::depth_table::{DepthTable, PlaneLayout};
use super::image_model::{ImageModel, QuadrantGrid, SampleNodes};
use super::quadrant_layout::QuadrantLayout;
use super::radial_layout::{RadialLayout, round_spline};
use crate::bspline;
use crate::render::spline::{self, SplineDegree};

/// Nodes per px of a quadrant that is computed for one image: for coarse tolerances and for others.
const DIRECT_PER_PX: [usize; 2] = [2, 4];
const COARSE: f64 = 2e-3;

/// Motion of an image's edge (px) over half the distance of the two images whose difference is a derivative
/// with respect to depth.
const EDGE_STEP_PX: f64 = 0.15;

/// An interpolated plane and its derivative with respect to depth.
pub(super) struct InterpolatedImage {
    layout: PlaneLayout,
    z_um: f64,
    value: Vec<f64>,
    by_z: Vec<f64>,
}

impl InterpolatedImage {
    /// The image of a sphere within `farthest_px` of its center along both axes, without a table. The error
    /// is that of the quadrature and of the nodes, without verification; the derivative with respect to depth
    /// is zero unless asked for.
    pub(super) fn direct(
        model: &ImageModel,
        z_um: f64,
        radius_um: f64,
        farthest_px: [f64; 2],
        with_derivative: bool,
    ) -> Self {
        let seen = |reach: [f64; 2]| [0, 1].map(|axis| reach[axis].min(farthest_px[axis]));
        let nodes = if model.is_round() {
            let [x, y] = farthest_px;
            let reach = model.reach(z_um, radius_um)[0].min(libm::hypot(x, y));
            SampleNodes::Radial(RadialLayout::new(z_um, 0.0, f64::INFINITY, |_| reach + 1.0))
        } else {
            let per_px = DIRECT_PER_PX[usize::from(model.tolerance < COARSE)];
            SampleNodes::Quadrant(model.quadrant(seen(model.reach(z_um, radius_um)), per_px))
        };
        let fineness = model.first_fineness();
        let coefficients = |z_um: f64| {
            let values = model.sample(z_um, radius_um, nodes, fineness);
            match nodes {
                SampleNodes::Radial(rings) => round_spline(&values, rings.columns),
                SampleNodes::Quadrant(QuadrantGrid { columns, .. }) => quadrant_spline(values, columns),
            }
        };
        let value = coefficients(z_um);
        let by_z = if with_derivative {
            let step = EDGE_STEP_PX / model.edge_px_per_um();
            let (low, high) = (coefficients(z_um - step), coefficients(z_um + step));
            low.iter().zip(&high).map(|(low, high)| (high - low) / (2.0 * step)).collect()
        } else {
            vec![0.0; value.len()]
        };
        let layout = match nodes {
            SampleNodes::Radial(rings) => PlaneLayout::Radial(rings),
            SampleNodes::Quadrant(QuadrantGrid { per_px, columns, rows }) => {
                return Self::of_quadrant(
                    QuadrantLayout::new(per_px, columns, rows),
                    columns,
                    z_um,
                    [value, by_z],
                );
            }
        };
        InterpolatedImage { layout, z_um, value, by_z }
    }

    /// From the coefficients of a quadrant in row-major order: the image, and its derivative.
    fn of_quadrant(layout: QuadrantLayout, columns: usize, z_um: f64, planes: [Vec<f64>; 2]) -> Self {
        let [value, by_z] = planes.map(|plane| {
            let mut out = vec![0.0; layout.length()];
            for (line, out) in plane.chunks(columns).zip(out.chunks_mut(layout.row())) {
                for (column, &value) in line.iter().enumerate() {
                    if let Some(place) = layout.place(column) {
                        out[place] = value;
                    }
                }
            }
            out
        });
        InterpolatedImage { layout: PlaneLayout::Quadrant(layout), z_um, value, by_z }
    }

    /// The image at a depth and a radius within the range of a table.
    pub(super) fn new(table: &DepthTable, z_um: f64, radius_um: f64) -> Self {
        let layout = table.layout.clone();
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
        match &self.layout {
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

/// Coefficients of the cubic spline through values over a quadrant, even about both axes.
fn quadrant_spline(mut values: Vec<f64>, columns: usize) -> Vec<f64> {
    values.chunks_mut(columns).for_each(|line| spline::even_spline(line, SplineDegree::Three));
    for column in 0..columns {
        let mut line: Vec<f64> = values.iter().skip(column).step_by(columns).copied().collect();
        spline::even_spline(&mut line, SplineDegree::Three);
        values.iter_mut().skip(column).step_by(columns).zip(line).for_each(|(value, c)| *value = c);
    }
    values
}

/// The index of the first of the four coefficients around a position (in nodes), their weights and the
/// derivatives of these.
fn place(nodes: f64) -> (isize, [f64; 4], [f64; 4]) {
    let cell = libm::floor(nodes);
    let (weights, slopes) = bspline::cubic(nodes - cell);
    (cell as isize - 1, weights, slopes)
}
