//! Builds tables: refines their spacings until they are accurate enough, and verifies the result.
//!
//! A table depends only on settings, options, tolerance and its range of depths and sizes, so its bytes do
//! not depend on the order of requests. It extends to where the light falls below a quarter of the tolerance.
//! Nodes are refined until the spline reproduces the light between them, steps in depth are halved until the
//! spline through planes reproduces the planes between. Finally, the table's image between two planes is
//! compared with one computed with finer discretization.

use rayon::prelude::*;

use super::layout::{Layout, Table};
use super::model::{Exposure, Frame, Light, Model, Scope};
use crate::render::depth_table::PlaneLayout;
use crate::render::node_layout::NodeLayout;
use crate::render::refinement::{AROUND, PlaneDepths, RefinedPlanes, Refinement, TableSpan, filtered, peak};

/// Nodes per px of a plane that are tried, and the number used if none of these is sufficient.
const DENSITIES: [usize; 5] = [1, 2, 3, 4, 6];
const MAX_DENSITY: usize = 8;
/// Initial and maximum number of steps in depth.
const STEPS: usize = 8;
const MAX_STEPS: usize = 128;
/// Half width of images above which their extents are not computed from their light, px.
const LARGE_PX: usize = 256;
/// Edges are rounded up to multiples of this, px.
const EDGE_PX: f64 = 4.0;
/// Maximum number of attempts with a wider edge.
const MAX_ATTEMPTS: usize = 4;
/// Fraction of the tolerance allowed for each spacing.
const PART: f64 = 0.4;
/// Light below this fraction of the tolerance is not rendered: of spheres, and of points. Points are the
/// emitters of spheroids, whose tails overlap.
const CUT: f64 = 0.25;
const CUT_OF_POINTS: f64 = 0.025;

/// Fraction of the light in neglected modes, relative to the tolerance: initial and minimum value.
pub(super) const SHARE: f64 = 0.4;
const MIN_SHARE: f64 = 0.005;

/// The input for building a table.
pub(super) struct Draft<'a> {
    pub(super) model: &'a Model,
    pub(super) span: TableSpan,
    /// Maximum distance of pixels from a particle's image along x and y, px.
    pub(super) farthest_px: [f64; 2],
}

impl Draft<'_> {
    pub(super) fn table(&self) -> Table {
        let mut share = SHARE;
        let mut table = self.widened(self.edges());
        // If few modes contribute to the peak, neglected modes matter more.
        while table.error > self.model.tolerance && share > MIN_SHARE {
            share *= 0.25;
            let model = self.model.with_share(share * self.model.tolerance, 1.0);
            let again = Draft { model: &model, ..*self }.widened(table.layout.edge_px);
            let helped = again.error < 0.8 * table.error;
            if again.error < table.error {
                table = again;
            }
            if !helped {
                break;
            }
        }
        table
    }

    /// A table with a sufficiently wide edge: the given one or a wider one.
    fn widened(&self, edge_px: [usize; 2]) -> Table {
        let mut frame = self.frame(edge_px, 1.0);
        for _ in 0..MAX_ATTEMPTS {
            // A few images determine the edge; the entire table is rebuilt only if others extend farther.
            let edge_px = frame.scope.edge_px;
            let wider = self.wider(edge_px, &self.reaches(&frame));
            if wider == edge_px {
                break;
            }
            frame = self.frame(wider, 1.0);
        }
        let table = self.on_frame(&frame);
        let wider = self.wider(frame.scope.edge_px, &table.reach_px);
        if wider == frame.scope.edge_px { table } else { self.on_frame(&self.frame(wider, 1.0)) }
    }

    /// The edge needed for images with the given extents.
    fn wider(&self, edge_px: [usize; 2], reach_px: &[[f64; 2]]) -> [usize; 2] {
        [0, 1].map(|axis| {
            let limit = libm::ceil(self.farthest_px[axis]) as usize;
            let fits = reach_px.iter().all(|reach| reach[axis] < edge_px[axis] as f64 - 1.0);
            if fits { edge_px[axis] } else { (edge_px[axis] + edge_px[axis] / 4 + 1).min(limit) }
        })
    }

    /// Extents (px) of images at both ends and in the middle of the depth range, computed up to the frame's
    /// edge.
    fn reaches(&self, frame: &Frame) -> Vec<[f64; 2]> {
        let exposure = self.model.exposure(frame, 1);
        let TableSpan { start_um, length_um, .. } = self.span;
        let depths: Vec<f64> = (0..3).map(|i| start_um + 0.5 * length_um * f64::from(i)).collect();
        let reach = |z_um: &f64| {
            self.reach(&self.model.plane(&self.model.light(frame, *z_um, self.large()), &exposure), &exposure)
        };
        depths.par_iter().map(reach).collect()
    }

    fn small(&self) -> f64 {
        self.span.radii.smallest()
    }

    fn large(&self) -> f64 {
        self.span.radii.largest()
    }

    fn end_um(&self) -> f64 {
        self.span.start_um + self.span.length_um
    }

    fn frame(&self, edge_px: [usize; 2], fineness: f64) -> Frame {
        // Includes the planes before and after the range.
        let around = self.span.length_um * AROUND as f64 / STEPS as f64;
        self.model.frame(Scope {
            from_um: self.span.start_um - around,
            to_um: self.end_um() + around,
            radius_um: self.large(),
            edge_px,
            fineness,
        })
    }

    /// Distances along x and y, whole px, at which light falls below the cut, from the decay of the tails
    /// caused by a hard edge of the pupil.
    fn edges(&self) -> [usize; 2] {
        let rims = self.rims();
        let bare = self.bare(&rims);
        // Tails only make them wider.
        if bare == self.limit() {
            return bare;
        }
        self.with_tails(bare, &rims, &self.peaks(bare, &rims))
    }

    /// The same, at least, in a time that does not grow with the image: one that is large is taken to be as
    /// faint as if all of its light were spread evenly.
    pub(super) fn extent(&self) -> [usize; 2] {
        let rims = self.rims();
        let bare = self.bare(&rims);
        if bare.into_iter().all(|edge| edge <= LARGE_PX) {
            return self.edges();
        }
        let even = |&(z_um, [x, y]): &(f64, [f64; 2])| {
            self.model.accepted(z_um, self.large()) / (std::f64::consts::PI * x.max(1.0) * y.max(1.0))
        };
        self.with_tails(bare, &rims, &rims.iter().map(even).collect::<Vec<_>>())
    }

    /// The ends of the range of depths (um) and the half axes of the geometric images there, px.
    fn rims(&self) -> Vec<(f64, [f64; 2])> {
        let mut depths = vec![self.span.start_um, self.end_um()];
        depths.dedup();
        depths.into_iter().map(|z_um| (z_um, self.model.rim_px(z_um, self.large()))).collect()
    }

    fn limit(&self) -> [usize; 2] {
        self.farthest_px.map(|far| libm::ceil(far) as usize)
    }

    /// A distance along an axis as an edge.
    fn edge(&self, axis: usize, far: f64) -> usize {
        (libm::ceil(far / EDGE_PX) * EDGE_PX).min(self.limit()[axis] as f64) as usize
    }

    /// Edges around the geometric images alone.
    fn bare(&self, rims: &[(f64, [f64; 2])]) -> [usize; 2] {
        [0, 1].map(|axis| self.edge(axis, rims.iter().map(|(_, rim)| rim[axis]).fold(0.0, f64::max) + 2.0))
    }

    /// The peaks of the images at the ends.
    fn peaks(&self, bare: [usize; 2], rims: &[(f64, [f64; 2])]) -> Vec<f64> {
        let frame = self.frame(bare, 1.0);
        let exposure = self.model.exposure(&frame, 1);
        let plane = |z_um: f64| self.model.plane(&self.model.light(&frame, z_um, self.large()), &exposure);
        rims.par_iter().map(|&(z_um, _)| peak(&plane(z_um))).collect()
    }

    fn with_tails(&self, bare: [usize; 2], rims: &[(f64, [f64; 2])], peaks: &[f64]) -> [usize; 2] {
        let mut edges = bare;
        for (&(z_um, rim), peak) in rims.iter().zip(peaks) {
            let tails = self.model.tail_px(z_um, rim, self.cut() * peak);
            (0..2).for_each(|axis| edges[axis] = edges[axis].max(self.edge(axis, tails[axis])));
        }
        edges
    }

    /// Fraction of the peak below which light is not rendered.
    fn cut(&self) -> f64 {
        self.model.tolerance * if self.large() > 0.0 { CUT } else { CUT_OF_POINTS }
    }

    fn on_frame(&self, frame: &Frame) -> Table {
        let (model, small) = (self.model, self.small());
        let TableSpan { start_um, length_um, .. } = self.span;
        let depths = PlaneDepths { start_um, length_um, steps: STEPS };
        let lights = depths.sample(|z_um| model.light(frame, z_um, small));
        let exposure = self.exposure(frame, &lights);
        let first = lights.iter().map(|light| model.plane(light, &exposure)).collect();
        let refinement = Refinement { deviation, allowed: PART * model.tolerance, most_steps: MAX_STEPS };
        let refined = refinement.table(self.span, STEPS, Some(first), |z_um, radius_um| {
            model.plane(&model.light(frame, z_um, radius_um), &exposure)
        });
        let mut table = self.assemble(refined, frame.scope.edge_px, &exposure);
        table.error = self.error(&table);
        table
    }

    /// The exposure with the fewest nodes per px whose spline reproduces the light between them.
    fn exposure(&self, frame: &Frame, lights: &[Light]) -> Exposure {
        let model = self.model;
        let [x, y] = [0, 1].map(|axis| positions(frame.scope.edge_px[axis], PROBES, frame.is_mirrored()));
        let probes = model.probes(frame, [&x, &y]);
        let probed = [AROUND, AROUND + STEPS / 2, AROUND + STEPS].map(|i| {
            let light = &lights[i];
            (light, model.probe(light, &probes))
        });
        for per_px in DENSITIES {
            let exposure = model.exposure(frame, per_px);
            let meets = |(light, truth): &(&Light, Vec<f64>)| {
                let ours = model.plane(light, &exposure);
                let allowed = PART * model.tolerance * peak(&ours);
                truth.iter().enumerate().all(|(i, truth)| {
                    let position = [x[i % x.len()], y[i / x.len()]];
                    (exposure.evaluate(&ours, position)[0] - truth).abs() <= allowed
                })
            };
            if probed.iter().all(meets) {
                return exposure;
            }
        }
        model.exposure(frame, MAX_DENSITY)
    }

    /// Converts planes of all radii to splines, fades them out, and collects them in a table.
    fn assemble(&self, refined: RefinedPlanes, edge_px: [usize; 2], exposure: &Exposure) -> Table {
        let RefinedPlanes { depths, radii, mut planes, .. } = refined;
        let layout = &exposure.layout;
        let steps = depths.steps;
        let of_one = depths.planes();
        // The extent at each depth is the maximum over all sizes.
        let reaches: Vec<[f64; 2]> = (0..of_one)
            .map(|i| {
                let of_sizes = planes.chunks(of_one).map(|of_size| self.reach(&of_size[i], exposure));
                of_sizes.fold([0.0f64; 2], |a, b| [a[0].max(b[0]), a[1].max(b[1])])
            })
            .collect();
        for of_size in planes.chunks_mut(of_one) {
            of_size.iter_mut().zip(&reaches).for_each(|(plane, reach)| self.fade(plane, *reach, layout));
        }
        let mut coefficients = vec![0.0f32; radii.len() * (steps + 3) * layout.length()];
        let windows = planes.chunks(of_one).flat_map(|of_size| of_size.windows(5));
        for (five, out) in windows.zip(coefficients.chunks_exact_mut(layout.length())) {
            layout.store(&filtered(five), out, |value| value as f32);
        }
        Table {
            start_um: self.span.start_um,
            step_um: depths.step_um(),
            planes: steps + 3,
            radii,
            reach_px: reaches[AROUND - 1..][..steps + 3].to_vec(),
            layout: Layout { nodes: layout.clone(), edge_px },
            coefficients,
            error: 0.0,
        }
    }

    /// Half width and half height (px) of the part of a plane that is brighter than the cut.
    fn reach(&self, plane: &[f64], exposure: &Exposure) -> [f64; 2] {
        let cut = self.cut() * peak(plane);
        let NodeLayout { per_px, columns, origin, .. } = exposure.layout;
        let mut far = [0; 2];
        for (row, line) in plane.chunks_exact(columns).enumerate() {
            let lit = |value: &f64| value.abs() > cut;
            let Some((first, last)) = line.iter().position(lit).zip(line.iter().rposition(lit)) else {
                continue;
            };
            far[0] = far[0].max(first.abs_diff(origin[0])).max(last.abs_diff(origin[0]));
            far[1] = far[1].max(row.abs_diff(origin[1]));
        }
        [0, 1].map(|axis| ((far[axis] + 1) as f64 / per_px as f64).min(self.farthest_px[axis]))
    }

    /// Lets a plane fade out over the last pixel of its extent (px). Cut off at whole pixels, an image would
    /// extend farther on one side than on the other, and its centroid would be shifted.
    fn fade(&self, plane: &mut [f64], reach_px: [f64; 2], layout: &NodeLayout) {
        let NodeLayout { per_px, columns, rows, origin, .. } = *layout;
        let along = |axis: usize, nodes: usize| -> Vec<f64> {
            let place_px = |node: usize| node.abs_diff(origin[axis]) as f64 / per_px as f64;
            (0..nodes).map(|node| (reach_px[axis] + 0.5 - place_px(node)).clamp(0.0, 1.0)).collect()
        };
        let across = along(0, columns);
        for (line, of_row) in plane.chunks_exact_mut(columns).zip(along(1, rows)) {
            line.iter_mut().zip(&across).for_each(|(value, share)| *value *= of_row * share);
        }
    }

    /// Error of the finished table relative to an image computed with finer discretization, as a fraction of
    /// the peak.
    fn error(&self, table: &Table) -> f64 {
        let ((z_um, radius_um), edge_px) = (table.between_nodes(), table.layout.edge_px);
        let finer = self.model.with_share(0.2 * self.model.share.min(SHARE * self.model.tolerance), 0.25);
        let frame = finer.frame(Scope { from_um: z_um, to_um: z_um, radius_um, edge_px, fineness: 1.3 });
        let [x, y] = edge_px.map(|edge| positions(edge, 2 * edge, frame.is_mirrored()));
        let truth = finer.probe(&finer.light(&frame, z_um, radius_um), &finer.probes(&frame, [&x, &y]));
        let (layout, plane) = (&table.layout, table.plane_at(z_um, radius_um));
        let ours = |i: usize| layout.at(&plane, x[i % x.len()], y[i / x.len()])[0];
        let differ = |(i, truth): (usize, &f64)| (ours(i) - truth).abs();
        let largest = truth.iter().enumerate().map(differ).fold(0.0, f64::max);
        largest / peak(&truth)
    }
}

/// Equally spaced positions between the particle and the edge, px; without mirror symmetry, as many on the
/// other side.
fn positions(edge_px: usize, count: usize, mirrored: bool) -> Vec<f64> {
    let step = edge_px as f64 / count as f64;
    // Not on nodes, for any density.
    let side = (0..count).map(|i| (i as f64 + 0.307) * step);
    if mirrored { side.collect() } else { side.clone().map(|x| -x).chain(side).collect() }
}

/// Number of positions along an axis at which densities are compared.
const PROBES: usize = 48;

/// The largest error of values, as a fraction of the peak.
fn deviation(ours: &[f64], truth: &[f64]) -> f64 {
    ours.iter().zip(truth).fold(0.0, |largest, (a, b)| f64::max(largest, (a - b).abs())) / peak(truth)
}
