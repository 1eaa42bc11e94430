//! The image of one sphere and its derivatives, computed for its own depth, without a table: for fits.

use super::depth_table::{DepthTable, PlaneLayout};
use super::model::{Model, QuadrantGrid, SampleNodes};
use super::radial_layout::{RadialLayout, round_spline};
use crate::particle::Particle;
use crate::render::depth_table::{InterpolatedPlane, PlaneLayout as _};
use crate::render::node_layout::NodeLayout;
use crate::render::spline::{self, SplineDegree};
use crate::render::tabled;
use crate::settings::Settings;

/// Nodes per px of a quadrant: for coarse tolerances and for others.
const PER_PX: [usize; 2] = [2, 4];
const COARSE: f64 = 2e-3;

/// Motion of an image's edge (px) over half the distance of the two images whose difference is a derivative
/// with respect to depth.
const EDGE_STEP_PX: f64 = 0.15;

/// For single images: half the meridians of tables, as no further error is added between depths and sizes, and
/// fewer steps for the extent.
pub(super) const MERIDIANS: f64 = 0.5;
pub(super) const REACH_STEPS: u32 = 16;

/// An image at one depth.
pub(super) struct DirectImage {
    layout: PlaneLayout,
    plane: InterpolatedPlane,
}

impl DirectImage {
    /// The image of a sphere within `farthest_px` of its center along both axes. Its error comes from
    /// quadrature and nodes, without verification; the derivative with respect to depth is zero unless
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
            let step = step_um(model);
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

/// Half the distance of the two images whose difference is a derivative with respect to depth, um.
fn step_um(model: &Model) -> f64 {
    EDGE_STEP_PX / model.edge_px_per_um()
}

/// The image of a sphere as a table of its depth alone.
pub(super) fn single(
    model: &Model,
    settings: &Settings,
    sphere: &Particle,
    with_derivative: bool,
) -> DepthTable {
    let (z_um, radius_um, step_um) = (sphere.z_um, 0.5 * sphere.d_um, step_um(model));
    let reach = model.reach(z_um, radius_um);
    if !with_derivative && tabled::window(settings, sphere, (reach[0], reach[1])).area() == 0 {
        let layout = PlaneLayout::Quadrant(NodeLayout::new(1, [1, 1], true));
        let dark = vec![0.0; layout.length()];
        return DepthTable::single((z_um, step_um), layout, reach, &dark, None);
    }
    // To the farthest pixel of the sensor; pixels of derivatives may lie beyond it.
    let far = |at: f64, size: u32| (at - 1.0).abs().max((f64::from(size) - at).abs()) + 1.0;
    let sensor = [far(sphere.x_px, settings.pixel_dim_x), far(sphere.y_px, settings.pixel_dim_y)];
    let seen = if with_derivative { reach } else { sensor };
    let DirectImage { layout, plane } = DirectImage::new(model, z_um, radius_um, seen, with_derivative);
    let single = |values: Vec<f64>, factor: f64| -> Vec<f32> {
        values.into_iter().map(|value| (factor * value) as f32).collect()
    };
    let by_step = with_derivative.then(|| single(plane.by_z, step_um));
    DepthTable::single((z_um, step_um), layout, reach, &single(plane.value, 1.0), by_step.as_deref())
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
