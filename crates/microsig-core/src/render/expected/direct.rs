//! The image of one sphere and its derivatives, computed for its own depth, without a table: for fits.

use super::depth_table::PlaneLayout;
use super::model::{Model, QuadrantGrid, SampleNodes};
use super::radial_layout::{RadialLayout, round_spline};
use crate::render::depth_table::{InterpolatedPlane, PlaneLayout as _};
use crate::render::node_layout::NodeLayout;
use crate::render::spline::{self, SplineDegree};

/// Nodes per px of a quadrant: for coarse tolerances and for others.
const PER_PX: [usize; 2] = [2, 4];
const COARSE: f64 = 2e-3;

/// Motion of an image's edge (px) over half the distance of the two images whose difference is a derivative
/// with respect to depth.
const EDGE_STEP_PX: f64 = 0.15;

/// An image at one depth.
pub(super) struct DirectImage {
    layout: PlaneLayout,
    plane: InterpolatedPlane,
}

impl DirectImage {
    /// The image of a sphere within `farthest_px` of its center along both axes. The error is that of the
    /// quadrature and of the nodes, without verification; the derivative with respect to depth is zero unless
    /// asked for.
    pub(super) fn new(
        model: &Model,
        z_um: f64,
        radius_um: f64,
        farthest_px: [f64; 2],
        with_derivative: bool,
    ) -> Self {
        let (nodes, layout) = if model.is_round() {
            let [x, y] = farthest_px;
            let reach = model.reach(z_um, radius_um)[0].min(libm::hypot(x, y));
            let rings = RadialLayout::new(z_um, 0.0, f64::INFINITY, |_| reach + 1.0);
            (SampleNodes::Radial(rings), PlaneLayout::Radial(rings))
        } else {
            let reach = model.reach(z_um, radius_um);
            let seen = [0, 1].map(|axis| reach[axis].min(farthest_px[axis]));
            let quadrant = model.quadrant(seen, PER_PX[usize::from(model.tolerance < COARSE)]);
            let QuadrantGrid { per_px, columns, rows } = quadrant;
            let layout = NodeLayout::new(per_px, [columns, rows], true);
            (SampleNodes::Quadrant(quadrant), PlaneLayout::Quadrant(layout))
        };
        let fineness = model.first_fineness();
        let coefficients = |z_um: f64| {
            let values = model.sample(z_um, radius_um, nodes, fineness);
            match &layout {
                PlaneLayout::Radial(rings) => round_spline(&values, rings.columns),
                PlaneLayout::Quadrant(layout) => {
                    let mut out = vec![0.0; layout.length()];
                    layout.store(&quadrant_spline(values, layout.columns), &mut out, |value| value);
                    out
                }
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
        DirectImage { layout, plane: InterpolatedPlane { z_um, value, by_z } }
    }

    /// As [`crate::render::depth_table::PlaneLayout::at`].
    pub(super) fn at(&self, [dx, dy]: [f64; 2]) -> [f64; 4] {
        self.layout.at(&self.plane, dx, dy)
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
