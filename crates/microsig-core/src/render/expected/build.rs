//! Construction of a depth table: spacings are chosen by error estimates, and the finished table is verified.
//!
//! A table depends only on settings, tolerance and its range of depth and size, so its bytes do not depend on
//! the thread that builds it. The resolution at which images are computed is chosen first. Depth steps are
//! halved until the spline through the planes agrees with images midway between planes; in a quadrant, node
//! spacings are halved until a least-squares spline fits twice as many values. Finally, an image midway
//! between two planes is computed at a higher resolution and on twice as many nodes, and compared with that
//! of the table.

use rayon::prelude::*;

use super::aperture_integral::Fineness;
use super::depth_table::{DepthTable, PlaneLayout};
use super::model::{Model, QuadrantGrid, SampleNodes, deviation, measure};
use super::pixel_integral::AZIMUTHS;
use super::radial_layout::{RadialLayout, round_spline};
use crate::cancel::checkpoint;
use crate::render::depth_table::PlaneLayout as _;
use crate::render::field_nodes::FieldNodes;
use crate::render::node_layout::NodeLayout;
use crate::render::refinement::{PlaneDepths, RefinedPlanes, Refinement, TableSpan, filtered, peak};
use crate::render::spline;

/// Allowed numbers of nodes per px of a quadrant.
const DENSITIES: [usize; 4] = [1, 2, 4, 8];
/// Largest numbers of nodes per px and per plane for which round images are drawn faster from a quadrant than
/// along the radius.
const DENSEST_ROUND: usize = 2;
const LARGEST_ROUND: usize = 1 << 16;
/// Initial and maximum number of depth steps of a table.
const STEPS: usize = 4;
const MOST_STEPS: usize = 64;

/// Largest number of attempts at a table.
const ATTEMPTS: usize = 4;

/// The table of a span. If its error exceeds the tolerance, it is made again with more of what contributes
/// most to the error.
pub(super) fn table(model: &Model, span: TableSpan) -> DepthTable {
    let fineness = model.fineness(span.middle_um(), span.radii[0]);
    let part = 0.75 * model.tolerance;
    let mut builder = TableBuilder { model, span, fineness, node_error: part, depth_error: part };
    for _ in 1..ATTEMPTS {
        let (table, errors) = builder.table();
        if table.error <= model.tolerance {
            return table;
        }
        if errors.resolution_error >= errors.depth_error.max(errors.node_error) {
            builder.fineness.0 *= 1.5;
        } else if errors.depth_error >= errors.node_error {
            builder.depth_error *= 0.5;
        } else {
            builder.node_error *= 0.5;
        }
    }
    builder.table().0
}

/// A table under construction.
struct TableBuilder<'a> {
    model: &'a Model,
    span: TableSpan,
    fineness: Fineness,
    /// Errors allowed for the spacings of nodes and of planes, relative to the peak.
    node_error: f64,
    depth_error: f64,
}

/// The parts of a table's error, relative to the peak.
struct Errors {
    resolution_error: f64,
    node_error: f64,
    depth_error: f64,
}

impl TableBuilder<'_> {
    fn sample(&self, z_um: f64, radius_um: f64, nodes: SampleNodes) -> Vec<f64> {
        checkpoint();
        self.model.sample(z_um, radius_um, nodes, self.fineness)
    }

    fn table(&self) -> (DepthTable, Errors) {
        let TableSpan { start_um, length_um, radii: [small, large] } = self.span;
        let mut reach_px = [0.0f64; 2];
        for i in 0..9 {
            let z_um = start_um + length_um * f64::from(i) / 8.0;
            let more = self.model.reach(z_um, large);
            (0..2).for_each(|axis| reach_px[axis] = reach_px[axis].max(more[axis]));
        }
        let (nodes, node_error) = self.nodes(small, large, reach_px);
        let refinement = Refinement { deviation, allowed: self.depth_error, most_steps: MOST_STEPS };
        let RefinedPlanes { depths, radii, planes, error: depth_error } =
            refinement.table(self.span, STEPS, None, |z_um, radius| self.sample(z_um, radius, nodes));
        let (layout, coefficients) = self.coefficients(planes, nodes, depths);
        let planes = depths.steps + 3;
        let mut table = DepthTable {
            start_um,
            step_um: depths.step_um(),
            planes,
            radii,
            field: FieldNodes::one(),
            layout,
            reach_px: vec![reach_px; planes],
            coefficients,
            error: 0.0,
        };
        let resolution_error;
        (table.error, resolution_error) = self.errors(&table, nodes);
        (table, Errors { resolution_error, node_error, depth_error })
    }

    /// The nodes at which images are computed, and the error of the spline over them: a quadrant so dense
    /// that a least-squares spline with half as many nodes per axis fits its values, or nodes along the
    /// radius if the image is round and a quadrant would need too many.
    fn nodes(&self, small: f64, large: f64, reach_px: [f64; 2]) -> (SampleNodes, f64) {
        let round = self.model.is_round();
        let (densest, largest) =
            if round { (DENSEST_ROUND, LARGEST_ROUND) } else { (usize::MAX, usize::MAX) };
        let quadrants = DENSITIES.into_iter().map(|per_px| self.model.quadrant(reach_px, per_px));
        let quadrants = quadrants.filter(|q| q.per_px <= densest && q.columns * q.rows <= largest);
        let mut last = None;
        for quadrant in quadrants.map(QuadrantGrid::computed) {
            let error = self.spline_error(small, quadrant, 0.5);
            let found = (SampleNodes::Quadrant(quadrant), error);
            // At the ends of the depth range the tolerance itself is sufficient.
            let at_end = |share| self.spline_error(small, quadrant, share) <= self.model.tolerance;
            if error <= self.node_error && at_end(0.0) && at_end(1.0) {
                return found;
            }
            last = Some(found);
        }
        let reach = |z_um: f64| self.model.reach(z_um, large)[0];
        let TableSpan { start_um, length_um, .. } = self.span;
        let rings = || RadialLayout::new(start_um, length_um, self.model.farthest_px[0], reach);
        last.filter(|_| !round).unwrap_or_else(|| (SampleNodes::Radial(rings()), 0.0))
    }

    /// Error of the least-squares spline of a quadrant at a fraction of the depth range.
    fn spline_error(&self, radius_um: f64, quadrant: QuadrantGrid, share: f64) -> f64 {
        let columns = quadrant.columns / 2;
        let z_um = self.span.start_um + share * self.span.length_um;
        let values = self.sample(z_um, radius_um, SampleNodes::Quadrant(quadrant));
        let plane = spline::fit_plane(&values, columns);
        deviation(&spline::plane_at_half_nodes(&plane, columns), &values)
    }

    /// Converts the planes of all radii to spline coefficients.
    fn coefficients(
        &self,
        planes: Vec<Vec<f64>>,
        nodes: SampleNodes,
        depths: PlaneDepths,
    ) -> (PlaneLayout, Vec<f32>) {
        let splines = planes.par_chunks(depths.planes()).flat_map(|planes| {
            planes.par_windows(5).map(|five| {
                let plane = filtered(five);
                match nodes {
                    SampleNodes::Radial(rings) => round_spline(&plane, rings.columns),
                    SampleNodes::Quadrant(QuadrantGrid { columns, .. }) => {
                        spline::fit_plane(&plane, columns / 2)
                    }
                }
            })
        });
        let splines: Vec<Vec<f64>> = splines.collect();
        match nodes {
            SampleNodes::Radial(mut rings) => {
                let n = rings.columns;
                // Azimuthal orders that no plane needs are omitted.
                let needed = |order: usize| {
                    let is_lit = |plane: &Vec<f64>| {
                        let share = 0.4 * self.model.tolerance * peak(&plane[..n]);
                        measure(plane[order * n..][..n].iter().copied()) > share
                    };
                    splines.iter().any(is_lit)
                };
                rings.orders = (1..AZIMUTHS).rev().find(|&order| needed(order)).map_or(1, |order| order + 1);
                let layout = PlaneLayout::Radial(rings);
                let length = layout.length();
                (layout, splines.iter().flat_map(|plane| plane[..length].iter().map(|&v| v as f32)).collect())
            }
            SampleNodes::Quadrant(QuadrantGrid { per_px, columns, rows }) => {
                let (per_px, columns, rows) = (per_px / 2, columns / 2, rows / 2);
                let layout = NodeLayout::new(per_px, [columns, rows], true);
                let mut coefficients = vec![0.0f32; splines.len() * layout.length()];
                for (plane, out) in splines.iter().zip(coefficients.chunks_mut(layout.length())) {
                    layout.store(plane, out, |value| value as f32);
                }
                (PlaneLayout::Quadrant(layout), coefficients)
            }
        }
    }

    /// Error of the finished table, relative to the peak, estimated by an image computed at a higher
    /// resolution; and the part of it that is due to the resolution.
    fn errors(&self, table: &DepthTable, nodes: SampleNodes) -> (f64, f64) {
        let Fineness(fine) = self.fineness;
        let (z_um, radius_um) = table.between_nodes();
        // Quadrants are computed on twice as many nodes already.
        let nodes = if let SampleNodes::Radial(_) = nodes { nodes.finer() } else { nodes };
        let truth = self.model.sample(z_um, radius_um, nodes, Fineness(1.5 * fine));
        let plane = table.plane_at(z_um, radius_um, [0.0; 2]);
        let ours: Vec<f64> =
            nodes.places(z_um).into_iter().map(|[x, y]| table.layout.at(&plane, x, y)[0]).collect();
        let error = deviation(&ours, &truth);
        let resolution_error = if error > self.model.tolerance {
            deviation(&self.sample(z_um, radius_um, nodes), &truth)
        } else {
            0.0
        };
        (error, resolution_error)
    }
}
