//! Builds tables: refines their spacings until they are accurate enough, and verifies the result.
//!
//! A table depends only on settings, options, tolerance and its range of depths and sizes, so its bytes do
//! not depend on the order of requests. It extends to where the light falls below a quarter of the tolerance.
//! Nodes are refined until the spline reproduces the light between them, steps in depth are halved until the
//! spline through planes reproduces the planes between. Finally, the table's image between two planes is
//! compared with one computed with finer discretization.

use rayon::prelude::*;

use super::Waves;
use super::layout::{Layout, Table};
use super::model::{Exposure, Frame, Light, Model, Scope};
use crate::render::depth_table::PlaneLayout;
use crate::render::field_nodes::{self, FieldNodes};
use crate::render::node_layout::NodeLayout;
use crate::render::refinement::{
    AROUND, PlaneDepths, RefinedPlanes, Refinement, TableSpan, blend, filtered, peak,
};

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
/// Fraction of the tolerance allowed for each spacing. Of 60 particles in images of a 10x, a 20x and a 40x, the
/// largest errors are 0.37 to 0.73 tolerances with 0.4, and up to 1.5 with 0.8.
const PART: f64 = 0.4;
/// Light below this fraction of the tolerance is not rendered: of spheres, and of points. Points are the
/// emitters of spheroids, whose tails overlap. For the same spheres, the median error is 0.2 tolerances with 0.25,
/// 0.4 with 0.5, and 0.6 to 0.75 with 1.
const CUT: f64 = 0.25;
const CUT_OF_POINTS: f64 = 0.025;

/// Fraction of the light in neglected modes, relative to the tolerance: initial and minimum value.
pub(super) const SHARE: f64 = 0.4;
const MIN_SHARE: f64 = 0.005;

/// The input for building a table.
pub(super) struct TableBuilder<'a> {
    pub(super) model: &'a Model,
    pub(super) span: TableSpan,
    /// Maximum distance of pixels from a particle's image along x and y, px.
    pub(super) farthest_px: [f64; 2],
    /// Images that depend on the place in the field; `model` holds at its center.
    pub(super) field: Option<&'a Waves>,
    /// Whether images over the field are displaced against coma ([`super::tilt`]).
    pub(super) tilted: bool,
}

/// The place where the error of the finished table is measured.
const OF_ERROR: [f64; 2] = [0.71, -0.83];
/// Error of the polynomial over the field, as a fraction of the tolerance.
const OF_FIELD: f64 = 0.5;
/// Places between the nodes where it is measured, in units of half the field from its center.
const BETWEEN: [[f64; 2]; 5] = [[0.53, 0.31], [-0.86, 0.79], [0.18, -0.91], [-0.47, -0.62], [0.93, -0.36]];

impl TableBuilder<'_> {
    pub(super) fn table(&self) -> Table {
        let mut share = SHARE;
        let mut table = self.widened(self.edges());
        // If few modes contribute to the peak, neglected modes matter more.
        while table.error > self.model.tolerance && share > MIN_SHARE {
            share *= 0.25;
            let model = self.model.with_share(share * self.model.tolerance, 1.0);
            let again = TableBuilder { model: &model, ..*self }.widened(table.layout.edge_px);
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
        let TableSpan { start_um, length_um, .. } = self.span;
        let depths: Vec<f64> = (0..3).map(|i| start_um + 0.5 * length_um * f64::from(i)).collect();
        let reaches = |model: &Model, frame: &Frame| -> Vec<[f64; 2]> {
            let exposure = model.exposure(frame, 1);
            let plane = |z_um: &f64| model.plane(&model.light(frame, *z_um, self.span.radii[1]), &exposure);
            depths.par_iter().map(|z_um| self.reach(&plane(z_um), &exposure)).collect()
        };
        let corners = self.corners().into_iter().flat_map(|model| reaches(&model, &model.frame(frame.scope)));
        reaches(self.model, frame).into_iter().chain(corners).collect()
    }

    fn corners(&self) -> Vec<Model> {
        let Some(waves) = self.field else { return Vec::new() };
        let [right, below] = waves.size_px();
        [[1.0, 1.0], [right, 1.0], [1.0, below], [right, below]]
            .map(|at| waves.model_at(at, self.tilted))
            .into()
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
            radius_um: self.span.radii[1],
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
        if self.bare(&self.rims()).into_iter().all(|edge| edge <= LARGE_PX) {
            return self.edges();
        }
        self.faint_edges()
    }

    /// Edges of an image that is as faint as if all of its light were spread evenly: at least the edges of the
    /// image.
    pub(super) fn faint_edges(&self) -> [usize; 2] {
        let rims = self.rims();
        let bare = self.bare(&rims);
        let even = |&(z_um, [x, y]): &(f64, [f64; 2])| {
            self.model.accepted(z_um, self.span.radii[1]) / (std::f64::consts::PI * x.max(1.0) * y.max(1.0))
        };
        self.with_tails(bare, &rims, &rims.iter().map(even).collect::<Vec<_>>())
    }

    /// The ends of the range of depths (um) and the half axes of the geometric images there, px.
    fn rims(&self) -> Vec<(f64, [f64; 2])> {
        let mut depths = vec![self.span.start_um, self.end_um()];
        depths.dedup();
        let corners = self.corners();
        let rim = |z_um: f64| {
            let rims = corners.iter().map(|model| model.rim_px(z_um, self.span.radii[1]));
            rims.fold(self.model.rim_px(z_um, self.span.radii[1]), |a, b| [a[0].max(b[0]), a[1].max(b[1])])
        };
        depths.into_iter().map(|z_um| (z_um, rim(z_um))).collect()
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
        let plane =
            |z_um: f64| self.model.plane(&self.model.light(&frame, z_um, self.span.radii[1]), &exposure);
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
        self.model.tolerance * if self.span.radii[1] > 0.0 { CUT } else { CUT_OF_POINTS }
    }

    fn on_frame(&self, frame: &Frame) -> Table {
        let (model, small) = (self.model, self.span.radii[0]);
        let TableSpan { start_um, length_um, .. } = self.span;
        let depths = PlaneDepths { start_um, length_um, steps: STEPS };
        let lights = depths.sample(|z_um| model.light(frame, z_um, small));
        let exposure = self.exposure(frame, &lights);
        let first = lights.iter().map(|light| model.plane(light, &exposure)).collect();
        let refinement = Refinement { deviation, allowed: PART * model.tolerance, most_steps: MAX_STEPS };
        let refined = refinement.table(self.span, STEPS, Some(first), |z_um, radius_um| {
            model.plane(&model.light(frame, z_um, radius_um), &exposure)
        });
        let (field, refined, field_error) = self.over_field(refined, frame, &exposure);
        let mut table = self.assemble(refined, field, frame.scope.edge_px, &exposure);
        table.error = self.error(&table).max(field_error);
        table
    }

    /// The planes at all nodes of the field, and the error of the polynomial through them.
    fn over_field(
        &self,
        refined: RefinedPlanes,
        frame: &Frame,
        exposure: &Exposure,
    ) -> (FieldNodes, RefinedPlanes, f64) {
        let Some(waves) = self.field else { return (FieldNodes::one(), refined, 0.0) };
        let planes_at = |at_px: [f64; 2], images: &[(f64, f64)]| -> Vec<Vec<f64>> {
            let model = Model { share: self.model.share, ..waves.model_at(at_px, self.tilted) };
            let scale = waves.depth_scale(at_px);
            let Scope { from_um, to_um, .. } = frame.scope;
            let frame = model.frame(Scope { from_um: from_um / scale, to_um: to_um / scale, ..frame.scope });
            let exposure = model.exposure(&frame, exposure.layout.per_px);
            let plane = |&(z_um, radius_um): &(f64, f64)| {
                model.plane(&model.light(&frame, z_um / scale, radius_um), &exposure)
            };
            images.par_iter().map(plane).collect()
        };
        // At both ends of the range.
        let ends = [self.span.start_um, self.end_um()].map(|z_um| (z_um, self.span.radii[0]));
        let nodes_of = |degree: usize| FieldNodes::new(degree, waves.size_px());
        let between: Vec<([f64; 2], Vec<Vec<f64>>)> = BETWEEN
            .iter()
            .map(|&at| nodes_of(1).in_px(at))
            .map(|at_px| (at_px, planes_at(at_px, &ends)))
            .collect();
        let deviates = |nodes: &FieldNodes| {
            let known: Vec<Vec<Vec<f64>>> =
                nodes.places_px().into_iter().map(|at_px| planes_at(at_px, &ends)).collect();
            let place_error = |(at_px, truth): &([f64; 2], Vec<Vec<f64>>)| {
                let weights = nodes.weights(*at_px);
                let end_error = |end: usize| {
                    let planes = weights.iter().copied().zip(known.iter().map(|planes| &planes[end]));
                    deviation(&blend(planes), &truth[end])
                };
                end_error(0).max(end_error(1))
            };
            between.iter().map(place_error).fold(0.0, f64::max)
        };
        let allowed = OF_FIELD * self.model.tolerance;
        let mut nodes = nodes_of(1);
        let mut error = deviates(&nodes);
        for degree in 2..=field_nodes::MOST {
            if error <= allowed {
                break;
            }
            nodes = nodes_of(degree);
            error = deviates(&nodes);
        }
        let depths = refined.depths;
        let images: Vec<(f64, f64)> = (refined.radii.iter())
            .flat_map(|radius| (0..depths.planes()).map(move |i| (depths.at(i as f64), *radius)))
            .collect();
        let planes = nodes.places_px().into_iter().flat_map(|at_px| planes_at(at_px, &images)).collect();
        (nodes, RefinedPlanes { planes, ..refined }, error)
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

    /// The image at the start of the span as a table of this depth alone, with its change over `step_um`, if
    /// given; `scale`: depths in the table over depths of images; `reaches`: whether an image with this edge
    /// reaches the sensor.
    pub(super) fn single(
        &self,
        scale: f64,
        step_um: Option<f64>,
        reaches: impl Fn([usize; 2]) -> bool,
    ) -> Table {
        let (model, radius_um, z_um) = (self.model, self.span.radii[1], self.span.start_um);
        let depths = (scale * z_um, scale * step_um.unwrap_or(1.0));
        let mut edge_px = self.faint_edges();
        if step_um.is_none() && !reaches(edge_px) {
            let nodes = NodeLayout::new(1, [1, 1], true);
            let dark = vec![0.0; nodes.length()];
            return Table::single(depths, Layout { nodes, edge_px, tilted: false }, [1.0; 2], &dark, None);
        }
        let per_px = libm::ceil(3.0 * model.sharpest()).max(2.0) as usize;
        loop {
            let step_um = step_um.unwrap_or(0.0);
            let (from_um, to_um) = (z_um - step_um, z_um + step_um);
            let frame = model.frame(Scope { from_um, to_um, radius_um, edge_px, fineness: 1.0 });
            let exposure = model.exposure(&frame, per_px);
            let plane_at = |z_um: f64| model.plane(&model.light(&frame, z_um, radius_um), &exposure);
            let plane = plane_at(z_um);
            let reach = self.reach(&plane, &exposure);
            let wider = self.wider(edge_px, &[reach]);
            if wider != edge_px {
                edge_px = wider;
                continue;
            }
            let nodes = &exposure.layout;
            let stored = |mut plane: Vec<f64>, factor: f64| {
                self.fade(&mut plane, reach, nodes);
                let mut stored = vec![0.0; nodes.length()];
                plane.iter_mut().for_each(|value| *value *= factor);
                nodes.store(&plane, &mut stored, |value| value as f32);
                stored
            };
            let by_step = (step_um > 0.0).then(|| {
                let [low, high] = [-step_um, step_um].map(|step| stored(plane_at(z_um + step), 0.5));
                low.iter().zip(high).map(|(low, high)| high - low).collect::<Vec<f32>>()
            });
            let layout = Layout { nodes: nodes.clone(), edge_px, tilted: false };
            return Table::single(depths, layout, reach, &stored(plane, 1.0), by_step.as_deref());
        }
    }

    /// Converts planes of all radii to splines, fades them out, and collects them in a table.
    fn assemble(
        &self,
        refined: RefinedPlanes,
        field: FieldNodes,
        edge_px: [usize; 2],
        exposure: &Exposure,
    ) -> Table {
        let RefinedPlanes { depths, radii, mut planes, .. } = refined;
        let layout = &exposure.layout;
        let steps = depths.steps;
        let per_size = depths.planes();
        // The extent at each depth is the maximum over all sizes.
        let reaches: Vec<[f64; 2]> = (0..per_size)
            .map(|i| {
                let size_reaches =
                    planes.chunks(per_size).map(|size_planes| self.reach(&size_planes[i], exposure));
                size_reaches.fold([0.0f64; 2], |a, b| [a[0].max(b[0]), a[1].max(b[1])])
            })
            .collect();
        for size_planes in planes.chunks_mut(per_size) {
            size_planes.iter_mut().zip(&reaches).for_each(|(plane, reach)| self.fade(plane, *reach, layout));
        }
        let mut coefficients = vec![0.0f32; field.count() * radii.len() * (steps + 3) * layout.length()];
        let windows = planes.chunks(per_size).flat_map(|size_planes| size_planes.windows(5));
        for (five, out) in windows.zip(coefficients.chunks_exact_mut(layout.length())) {
            layout.store(&filtered(five), out, |value| value as f32);
        }
        Table {
            start_um: self.span.start_um,
            step_um: depths.step_um(),
            planes: steps + 3,
            radii,
            field,
            reach_px: reaches[AROUND - 1..][..steps + 3].to_vec(),
            layout: Layout { nodes: layout.clone(), edge_px, tilted: self.tilted },
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
        for (line, row_share) in plane.chunks_exact_mut(columns).zip(along(1, rows)) {
            line.iter_mut().zip(&across).for_each(|(value, share)| *value *= row_share * share);
        }
    }

    /// Error of the finished table relative to an image computed with finer discretization, as a fraction of
    /// the peak.
    fn error(&self, table: &Table) -> f64 {
        let ((z_um, radius_um), edge_px) = (table.between_nodes(), table.layout.edge_px);
        let at_px = table.field.in_px(OF_ERROR);
        let local = self.field.map(|waves| waves.model_at(at_px, self.tilted));
        let table_um = z_um;
        let z_um = z_um / self.field.map_or(1.0, |waves| waves.depth_scale(at_px));
        let finer = local
            .as_ref()
            .unwrap_or(self.model)
            .with_share(0.2 * self.model.share.min(SHARE * self.model.tolerance), 0.25);
        let frame = finer.frame(Scope { from_um: z_um, to_um: z_um, radius_um, edge_px, fineness: 1.3 });
        let [x, y] = edge_px.map(|edge| positions(edge, 2 * edge, frame.is_mirrored()));
        let truth = finer.probe(&finer.light(&frame, z_um, radius_um), &finer.probes(&frame, [&x, &y]));
        let (layout, plane) = (&table.layout, table.plane_at(table_um, radius_um, at_px));
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
