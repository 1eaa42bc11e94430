//! Node layout of round images.
//!
//! Nodes are equidistant along the radius. Their spacing in a table is linear in depth, like the radius of
//! the rim, so that edges keep their positions relative to the nodes from plane to plane.

use serde::{Deserialize, Serialize};

use super::pixel_integral::{self, AZIMUTHS};
use crate::bspline;
use crate::render::depth_table::InterpolatedPlane;
use crate::render::spline::{self, SplineDegree};

/// Nodes per px at the middle depth of a table.
const PER_PX: f64 = 16.0;

/// Largest relative growth of the node spacing over a table.
const MOST_GROWTH: f64 = 0.4;

/// Nodes along the radius, for each azimuthal order.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct RadialLayout {
    middle_um: f64,
    /// Relative growth of the node spacing with depth, 1/um.
    growth: f64,
    per_px: f64,
    pub(super) columns: usize,
    /// Number of azimuthal orders: f0(r) + f4(r) cos 4 psi + ...
    pub(super) orders: usize,
}

impl RadialLayout {
    /// Nodes for a range of depths (um); `reach` returns the radius of the image at a depth, px; parts
    /// farther than `farthest_px` from the center are never on the sensor.
    pub(super) fn new(
        start_um: f64,
        length_um: f64,
        farthest_px: f64,
        reach: impl Fn(f64) -> f64,
    ) -> RadialLayout {
        let middle_um = start_um + 0.5 * length_um;
        let grown = (reach(start_um + length_um) - reach(start_um)) / reach(middle_um);
        let growth = if length_um > 0.0 { grown.clamp(-MOST_GROWTH, MOST_GROWTH) / length_um } else { 0.0 };
        let mut rings = RadialLayout { middle_um, growth, per_px: PER_PX, columns: 0, orders: AZIMUTHS };
        for i in 0..9 {
            let z_um = start_um + length_um * f64::from(i) / 8.0;
            // Additional nodes after the last pixel for the decay of the spline.
            let seen = reach(z_um).min(farthest_px + 2.0);
            rings.columns = rings.columns.max(libm::ceil(seen * rings.per_px(z_um)) as usize + 2);
        }
        rings
    }

    /// Twice as many nodes per px.
    pub(super) fn finer(self) -> RadialLayout {
        RadialLayout { per_px: 2.0 * self.per_px, columns: 2 * self.columns, ..self }
    }

    fn steps(&self, z_um: f64) -> f64 {
        1.0 + self.growth * (z_um - self.middle_um)
    }

    /// Nodes per px at this depth.
    pub(super) fn per_px(&self, z_um: f64) -> f64 {
        self.per_px / self.steps(z_um)
    }

    /// Relative derivative of [`Self::per_px`] with respect to depth, 1/um.
    pub(super) fn per_px_by_z(&self, z_um: f64) -> f64 {
        -self.growth / self.steps(z_um)
    }

    /// The image and its derivatives, as [`crate::render::depth_table::PlaneLayout::at`]: f0(r) + f4(r) cos 4
    /// psi + f8(r) cos 8 psi + ...
    pub(super) fn at(&self, plane: &InterpolatedPlane, dx: f64, dy: f64) -> [f64; 4] {
        let (columns, per_px) = (self.columns, self.per_px(plane.z_um));
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
        for (order, (values, by_z)) in plane.value.chunks(columns).zip(plane.by_z.chunks(columns)).enumerate()
        {
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
            sum[3] += factor * (along(by_z, weights) + slope * r * self.per_px_by_z(plane.z_um));
        }
        sum
    }
}

/// The azimuthal orders of values given by azimuth and radius, as coefficients of quadratic splines along the
/// radius.
pub(super) fn round_spline(values: &[f64], columns: usize) -> Vec<f64> {
    let node_harmonics: Vec<[f64; AZIMUTHS]> = (0..columns)
        .map(|k| pixel_integral::harmonics(std::array::from_fn(|azimuth| values[azimuth * columns + k])))
        .collect();
    (0..AZIMUTHS)
        .flat_map(|order| {
            let mut line: Vec<f64> = node_harmonics.iter().map(|harmonics| harmonics[order]).collect();
            spline::even_spline(&mut line, SplineDegree::Two);
            line
        })
        .collect()
}
