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
use super::image_model::{ImageModel, QuadrantGrid, SampleNodes, deviation, measure, peak};
use super::interpolated::InterpolatedImage;
use super::pixel_integral::AZIMUTHS;
use super::quadrant_layout::QuadrantLayout;
use super::radial_layout::{RadialLayout, round_spline};
use crate::cancel::checkpoint;
use crate::render::spline;

/// Radii of the spheres of a table, um.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum TableRadii {
    One(f64),
    Between(f64, f64),
}

/// Allowed numbers of nodes per px of a quadrant.
const DENSITIES: [usize; 4] = [1, 2, 4, 8];
/// Largest numbers of nodes per px and per plane for which round images are drawn faster from a quadrant than
/// along the radius.
const DENSEST_ROUND: usize = 2;
const LARGEST_ROUND: usize = 1 << 16;
/// Initial and maximum number of depth steps of a table.
const STEPS: usize = 4;
const MOST_STEPS: usize = 64;
/// Initial and maximum number of particle radii of a table.
const SIZES: usize = 4;
const MOST_SIZES: usize = 8;

/// The table of spheres of these radii for depths from `start_um` to `start_um + length_um` (um).
pub(super) fn table(model: &ImageModel, start_um: f64, length_um: f64, radii: TableRadii) -> DepthTable {
    let (TableRadii::One(small) | TableRadii::Between(small, _)) = radii;
    let Fineness(mut fineness) = model.fineness(start_um + 0.5 * length_um, small);
    let mut part = 0.75 * model.tolerance;
    let mut attempts = 0;
    loop {
        let builder = TableBuilder { model, start_um, length_um, fineness: Fineness(fineness), part };
        let table = builder.table(radii);
        attempts += 1;
        // More nodes make drawing slower, so they are the last resort.
        match attempts {
            _ if table.error <= model.tolerance => return table,
            1 => fineness *= 1.5,
            2 => part *= 0.6,
            _ => return table,
        }
    }
}

/// A table under construction.
struct TableBuilder<'a> {
    model: &'a ImageModel,
    start_um: f64,
    length_um: f64,
    fineness: Fineness,
    /// Error allowed for each of the spacings, relative to the peak.
    part: f64,
}

impl TableBuilder<'_> {
    fn sample(&self, z_um: f64, radius_um: f64, nodes: SampleNodes) -> Vec<f64> {
        checkpoint();
        self.model.sample(z_um, radius_um, nodes, self.fineness)
    }

    fn middle(&self) -> f64 {
        self.start_um + 0.5 * self.length_um
    }

    fn table(&self, radii: TableRadii) -> DepthTable {
        let (small, large) = match radii {
            TableRadii::One(radius) => (radius, radius),
            TableRadii::Between(small, large) => (small, large),
        };
        let mut reach_px = [0.0f64; 2];
        for i in 0..9 {
            let z_um = self.start_um + self.length_um * f64::from(i) / 8.0;
            let more = self.model.reach(z_um, large);
            (0..2).for_each(|axis| reach_px[axis] = reach_px[axis].max(more[axis]));
        }
        let nodes = self.nodes(small, large, reach_px);
        let (mut planes, steps) = self.planes(small, nodes);
        let radii = match radii {
            TableRadii::One(radius) => vec![radius],
            TableRadii::Between(..) => self.sizes(small, large, nodes),
        };
        if radii.len() > 1 {
            planes = radii.iter().flat_map(|&radius| self.planes_at(radius, nodes, steps)).collect();
        }
        let (layout, coefficients) = self.coefficients(planes, nodes, steps);
        let mut table = DepthTable {
            start_um: self.start_um,
            step_um: self.length_um / steps as f64,
            planes: steps + 3,
            radii,
            layout,
            reach_px,
            coefficients,
            error: 0.0,
        };
        table.error = self.error(&table, nodes);
        table
    }

    /// The nodes at which images are computed: a quadrant so dense that a least-squares spline with half as
    /// many nodes per axis fits its values, or nodes along the radius if the image is round and a quadrant
    /// would need too many.
    fn nodes(&self, small: f64, large: f64, reach_px: [f64; 2]) -> SampleNodes {
        let round = self.model.is_round();
        let (densest, largest) =
            if round { (DENSEST_ROUND, LARGEST_ROUND) } else { (usize::MAX, usize::MAX) };
        let quadrants = DENSITIES.into_iter().map(|per_px| self.model.quadrant(reach_px, per_px));
        let quadrants = quadrants.filter(|q| q.per_px <= densest && q.columns * q.rows <= largest);
        let mut last = None;
        for quadrant in quadrants.map(QuadrantGrid::computed) {
            if self.is_met(small, quadrant) {
                return SampleNodes::Quadrant(quadrant);
            }
            last = Some(quadrant);
        }
        let reach = |z_um: f64| self.model.reach(z_um, large)[0];
        let rings = || RadialLayout::new(self.start_um, self.length_um, self.model.farthest_px[0], reach);
        last.filter(|_| !round).map_or_else(|| SampleNodes::Radial(rings()), SampleNodes::Quadrant)
    }

    /// Whether the least-squares spline of a quadrant is accurate enough at the middle of the depth range,
    /// and within the tolerance at both ends.
    fn is_met(&self, radius_um: f64, quadrant: QuadrantGrid) -> bool {
        let columns = quadrant.columns / 2;
        [(0.5, self.part), (0.0, self.model.tolerance), (1.0, self.model.tolerance)].into_iter().all(
            |(share, allowed)| {
                let z_um = self.start_um + share * self.length_um;
                let values = self.sample(z_um, radius_um, SampleNodes::Quadrant(quadrant));
                let plane = spline::fit_plane(&values, columns);
                deviation(&spline::plane_at_half_nodes(&plane, columns), &values) <= allowed
            },
        )
    }

    /// Sampled planes of one sphere, before spline filtering in depth, starting [`AROUND`] planes before the
    /// range.
    fn planes_at(&self, radius_um: f64, nodes: SampleNodes, steps: usize) -> Vec<Vec<f64>> {
        let step = self.length_um / steps as f64;
        let at = |i: usize| self.start_um + (i as f64 - AROUND as f64) * step;
        (0..steps + 1 + 2 * AROUND).into_par_iter().map(|i| self.sample(at(i), radius_um, nodes)).collect()
    }

    /// Planes so closely spaced that a spline through them is accurate midway between them, and the number of
    /// steps over the range.
    fn planes(&self, radius_um: f64, nodes: SampleNodes) -> (Vec<Vec<f64>>, usize) {
        let mut steps = STEPS;
        let mut planes = self.planes_at(radius_um, nodes, steps);
        let mut error_before = f64::INFINITY;
        loop {
            let step = self.length_um / steps as f64;
            let error = [0, steps / 2, steps - 1]
                .into_par_iter()
                .map(|i| {
                    let z_um = self.start_um + (i as f64 + 0.5) * step;
                    let between = self.sample(z_um, radius_um, nodes);
                    deviation(&blend(MIDWAY.into_iter().zip(&planes[i..i + 8])), &between)
                })
                .reduce(|| 0.0, f64::max);
            // If finer steps do not reduce the error, it has another cause.
            let helped = error < 0.6 * error_before;
            if error <= self.part || steps >= MOST_STEPS || !helped {
                return (planes, steps);
            }
            error_before = error;
            // Planes midway between the existing ones are added; some of the outermost are no longer needed.
            let finer = 0.5 * step;
            let old = planes;
            let at = |i: usize| self.start_um + (i as f64 - AROUND as f64) * finer;
            planes = (0..2 * steps + 1 + 2 * AROUND)
                .into_par_iter()
                .map(|i| {
                    let from_start = i as isize - AROUND as isize;
                    if from_start % 2 == 0 {
                        old[(from_start / 2 + AROUND as isize) as usize].clone()
                    } else {
                        self.sample(at(i), radius_um, nodes)
                    }
                })
                .collect();
            steps *= 2;
        }
    }

    /// The particle radii needed to interpolate between `small` and `large` (um).
    fn sizes(&self, small: f64, large: f64, nodes: SampleNodes) -> Vec<f64> {
        let mut count = SIZES;
        loop {
            let radii = size_nodes(small, large, count);
            let known: Vec<Vec<f64>> =
                radii.par_iter().map(|&r| self.sample(self.middle(), r, nodes)).collect();
            let between: Vec<f64> = radii.windows(2).map(|pair| 0.5 * (pair[0] + pair[1])).collect();
            let error = between
                .par_iter()
                .map(|&radius| {
                    let weights = spline::lagrange(&radii, radius);
                    let ours = blend(weights.iter().map(|w| w.0).zip(&known));
                    deviation(&ours, &self.sample(self.middle(), radius, nodes))
                })
                .reduce(|| 0.0, f64::max);
            if error <= self.part || count >= MOST_SIZES {
                return radii;
            }
            count += 1;
        }
    }

    /// Converts the planes of all radii to spline coefficients.
    fn coefficients(
        &self,
        planes: Vec<Vec<f64>>,
        nodes: SampleNodes,
        steps: usize,
    ) -> (PlaneLayout, Vec<f32>) {
        let of_one = steps + 1 + 2 * AROUND;
        let splines = planes.par_chunks(of_one).flat_map(|planes| {
            planes.par_windows(5).map(|five| {
                let plane = blend(FILTER.into_iter().zip(five));
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
            SampleNodes::Radial(rings) => {
                let n = rings.columns;
                // Azimuthal orders that no plane needs are omitted.
                let needed = |order: usize| {
                    let of_order = |plane: &Vec<f64>| {
                        let share = 0.4 * self.model.tolerance * peak(&plane[..n]);
                        measure(plane[order * n..][..n].iter().copied()) > share
                    };
                    splines.iter().any(of_order)
                };
                let orders = (1..AZIMUTHS).rev().find(|&order| needed(order)).map_or(1, |order| order + 1);
                let layout = PlaneLayout::Radial(rings.of_orders(orders));
                let length = layout.length();
                (layout, splines.iter().flat_map(|plane| plane[..length].iter().map(|&v| v as f32)).collect())
            }
            SampleNodes::Quadrant(QuadrantGrid { per_px, columns, rows }) => {
                let (per_px, columns, rows) = (per_px / 2, columns / 2, rows / 2);
                let layout = QuadrantLayout::new(per_px, columns, rows);
                let mut coefficients = vec![0.0f32; splines.len() * layout.length()];
                for (plane, out) in splines.iter().zip(coefficients.chunks_mut(layout.length())) {
                    for (line, out) in plane.chunks(columns).zip(out.chunks_mut(layout.row())) {
                        for (column, &value) in line.iter().enumerate() {
                            if let Some(place) = layout.place(column) {
                                out[place] = value as f32;
                            }
                        }
                    }
                }
                (PlaneLayout::Quadrant(layout), coefficients)
            }
        }
    }

    /// Error of the finished table, relative to the peak, estimated by an image computed at a higher
    /// resolution.
    fn error(&self, table: &DepthTable, nodes: SampleNodes) -> f64 {
        let Fineness(fine) = self.fineness;
        let z_um = self.start_um + table.step_um * (((table.planes - 3) / 2) as f64 + 0.5);
        let radius_um = match table.radii[..] {
            [a, b, ..] => 0.5 * (a + b),
            [a] => a,
            [] => return 0.0,
        };
        // Quadrants are computed on twice as many nodes already.
        let nodes = if let SampleNodes::Radial(_) = nodes { nodes.finer() } else { nodes };
        let truth = self.model.sample(z_um, radius_um, nodes, Fineness(1.5 * fine));
        let interpolated = InterpolatedImage::new(table, z_um, radius_um);
        let ours: Vec<f64> = nodes.places(z_um).into_iter().map(|[x, y]| interpolated.at(x, y)[0]).collect();
        deviation(&ours, &truth)
    }
}

/// Number of additional planes that the spline in depth needs before and after the range.
const AROUND: usize = 3;

/// Filter from equidistant values to the coefficients of the cubic spline: 1 - d2/6 + (d2/6)^2, d2 being the
/// second difference; its error is of order (d2/6)^3.
const FILTER: [f64; 5] = [1.0 / 36.0, -5.0 / 18.0, 1.5, -5.0 / 18.0, 1.0 / 36.0];

/// Weights of eight values in that spline at the midpoint of the middle two: [`FILTER`] convolved with (1,
/// 23, 23, 1)/48.
const MIDWAY: [f64; 8] = {
    let mut weights = [0.0; 8];
    let spline = [1.0 / 48.0, 23.0 / 48.0, 23.0 / 48.0, 1.0 / 48.0];
    let mut i = 0;
    while i < 4 {
        let mut j = 0;
        while j < 5 {
            weights[i + j] += spline[i] * FILTER[j];
            j += 1;
        }
        i += 1;
    }
    weights
};

/// Weighted sum of planes.
fn blend<'a>(planes: impl Iterator<Item = (f64, &'a Vec<f64>)>) -> Vec<f64> {
    let mut sum = Vec::new();
    for (weight, plane) in planes {
        sum.resize(plane.len(), 0.0);
        sum.iter_mut().zip(plane).for_each(|(s, v)| *s += weight * v);
    }
    sum
}

/// Chebyshev points including both ends.
fn size_nodes(small: f64, large: f64, n: usize) -> Vec<f64> {
    let (middle, half) = (0.5 * (small + large), 0.5 * (large - small));
    let angle = |i: usize| std::f64::consts::PI * i as f64 / (n - 1) as f64;
    (0..n).map(|i| middle - half * libm::cos(angle(i))).collect()
}
