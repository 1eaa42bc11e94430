//! Making a table: its spacings are found by trial, and the whole is verified.
//!
//! A table depends on nothing but settings, options, tolerance and its place, so it has the same bytes
//! whoever asks first. Its edge is where light stays below a quarter of the tolerance; nodes become denser
//! until the spline meets the light between them, steps of depth are halved until the spline through planes
//! meets those between. At last an image between two planes, computed more finely, is held against the
//! table's.

use rayon::prelude::*;

use super::layout::Layout;
use super::model::{Exposure, Frame, Light, Model, Scope};
use super::table::{Interpolated, Table};
use crate::render::spline as depth_spline;

/// Radii of the spheres of a table, um.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum TableRadii {
    One(f64),
    Between(f64, f64),
}

/// Nodes per px that a plane may have, and what it has if none of these is enough.
const DENSITIES: [usize; 5] = [1, 2, 3, 4, 6];
const DENSEST: usize = 8;
/// Steps of depth that a table begins with, and the most it may have.
const STEPS: usize = 8;
const MOST_STEPS: usize = 128;
/// Nodes of the radius, at first and at most.
const SIZES: usize = 4;
const MOST_SIZES: usize = 8;
/// Edges are whole multiples of so many px.
const EDGE_PX: f64 = 4.0;
/// How often a table is made with a wider edge.
const WIDENED: usize = 4;
/// The part of the tolerance that each spacing may take.
const PART: f64 = 0.4;
/// The part of the tolerance below which light is not drawn.
const CUT: f64 = 0.25;

/// Share of the light that weak modes may have, as a part of the tolerance, at first and at least.
pub(super) const SHARE: f64 = 0.4;
const LEAST_SHARE: f64 = 0.05;

/// Planes before the range and behind it that a spline through planes needs.
const AROUND: usize = 3;

/// From values at equal steps to coefficients of the cubic spline: 1 - d2/6 + (d2/6)^2 with d2 the second
/// difference, which is exact but for (d2/6)^3.
const FILTER: [f64; 5] = [1.0 / 36.0, -5.0 / 18.0, 1.5, -5.0 / 18.0, 1.0 / 36.0];

/// Weights of eight values in that spline, half way between the middle two: [`FILTER`] on (1, 23, 23, 1)/48.
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

/// A table in the making.
pub(super) struct Draft<'a> {
    pub(super) model: &'a Model,
    pub(super) start_um: f64,
    pub(super) length_um: f64,
    pub(super) radii: TableRadii,
    /// The farthest pixels that matter, px from a particle's image, on the two axes.
    pub(super) farthest_px: [f64; 2],
}

/// Kernels and planes of one size, from [`AROUND`] steps before the range on.
struct Planes {
    values: Vec<Vec<f64>>,
    steps: usize,
}

impl Draft<'_> {
    pub(super) fn table(&self) -> Table {
        let mut share = SHARE;
        let mut table = self.widened(self.edges());
        // Where few modes make the peak those that are left out weigh more.
        while table.error > self.model.tolerance && share > LEAST_SHARE {
            share *= 0.25;
            let model = self.model.with_share(share * self.model.tolerance, 1.0);
            let again = Draft { model: &model, ..*self }.widened(table.edge_px);
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

    /// A table whose edge is far enough out, this one or a wider one.
    fn widened(&self, mut edge_px: [usize; 2]) -> Table {
        for attempt in 0.. {
            // A few images tell most; only where others reach farther a whole table is made again.
            let wider = self.wider(edge_px, &self.reaches(edge_px));
            if wider == edge_px || attempt >= WIDENED {
                break;
            }
            edge_px = wider;
        }
        let table = self.with_edge(edge_px);
        let wider = self.wider(edge_px, &table.reach_px);
        if wider == edge_px { table } else { self.with_edge(wider) }
    }

    /// The edge that images ask for which reach so far.
    fn wider(&self, edge_px: [usize; 2], reach_px: &[[f64; 2]]) -> [usize; 2] {
        [0, 1].map(|axis| {
            let limit = libm::ceil(self.farthest_px[axis]) as usize;
            let fits = reach_px.iter().all(|reach| reach[axis] < edge_px[axis] as f64 - 1.0);
            if fits { edge_px[axis] } else { (edge_px[axis] + edge_px[axis] / 4 + 1).min(limit) }
        })
    }

    /// How far images at both ends and in the middle of the range reach, px, on a sensor with this edge.
    fn reaches(&self, edge_px: [usize; 2]) -> Vec<[f64; 2]> {
        let frame = self.frame(edge_px, 1.0);
        let exposure = self.model.exposure(&frame, 1);
        let depths: Vec<f64> = (0..3).map(|i| self.start_um + 0.5 * self.length_um * f64::from(i)).collect();
        let reach = |z_um: &f64| {
            self.reach(
                &self.model.plane(&self.model.light(&frame, *z_um, self.large()), &exposure),
                &exposure,
            )
        };
        depths.par_iter().map(reach).collect()
    }

    fn small(&self) -> f64 {
        let (TableRadii::One(small) | TableRadii::Between(small, _)) = self.radii;
        small
    }

    fn large(&self) -> f64 {
        let (TableRadii::One(large) | TableRadii::Between(_, large)) = self.radii;
        large
    }

    fn end_um(&self) -> f64 {
        self.start_um + self.length_um
    }

    fn frame(&self, edge_px: [usize; 2], fineness: f64) -> Frame {
        // The planes around the range are seen too.
        let around = self.length_um * AROUND as f64 / STEPS as f64;
        self.model.frame(Scope {
            from_um: self.start_um - around,
            to_um: self.end_um() + around,
            radius_um: self.large(),
            edge_px,
            fineness,
        })
    }

    /// Where light falls below the cut, whole px, by the law of the tails behind a hard edge of the pupil.
    pub(super) fn edges(&self) -> [usize; 2] {
        let model = self.model;
        let rim = |z_um: f64| model.rim_px(z_um, self.large());
        let depths = [self.start_um, self.end_um()];
        let rims = depths.map(rim);
        let limit = self.farthest_px.map(|far| libm::ceil(far) as usize);
        let whole =
            |axis: usize, far: f64| (libm::ceil(far / EDGE_PX) * EDGE_PX).min(limit[axis] as f64) as usize;
        let bare = [0, 1].map(|axis| whole(axis, rims[0][axis].max(rims[1][axis]) + 2.0));
        let frame = self.frame(bare, 1.0);
        let exposure = model.exposure(&frame, 1);
        let peaks: Vec<f64> = depths
            .into_par_iter()
            .map(|z_um| peak(&model.plane(&model.light(&frame, z_um, self.large()), &exposure)))
            .collect();
        let mut edges = bare;
        for ((z_um, rim), peak) in depths.into_iter().zip(rims).zip(peaks) {
            let tails = model.tail_px(z_um, rim, CUT * model.tolerance * peak);
            (0..2).for_each(|axis| edges[axis] = edges[axis].max(whole(axis, tails[axis])));
        }
        edges
    }

    fn with_edge(&self, edge_px: [usize; 2]) -> Table {
        let frame = self.frame(edge_px, 1.0);
        let lights = self.lights(&frame, self.small(), STEPS);
        let exposure = self.exposure(&frame, &lights);
        let first = lights.iter().map(|light| self.model.plane(light, &exposure)).collect();
        let mut planes = self.planes(&frame, &exposure, first);
        let radii = match self.radii {
            TableRadii::One(radius) => vec![radius],
            TableRadii::Between(small, large) => self.sizes(&frame, &exposure, small, large),
        };
        let mut values = std::mem::take(&mut planes.values);
        for &radius_um in &radii[1..] {
            let lights = self.lights(&frame, radius_um, planes.steps);
            values.extend(lights.iter().map(|light| self.model.plane(light, &exposure)));
        }
        let mut table = self.assemble(&values, planes.steps, radii, (edge_px, &exposure));
        table.error = self.error(&table, edge_px);
        table
    }

    fn depth(&self, plane: f64, steps: usize) -> f64 {
        self.start_um + (plane - AROUND as f64) * self.length_um / steps as f64
    }

    /// The light of one size at all depths.
    fn lights(&self, frame: &Frame, radius_um: f64, steps: usize) -> Vec<Light> {
        (0..steps + 1 + 2 * AROUND)
            .into_par_iter()
            .map(|i| self.model.light(frame, self.depth(i as f64, steps), radius_um))
            .collect()
    }

    /// The fewest nodes per px whose spline meets the light between them.
    fn exposure(&self, frame: &Frame, lights: &[Light]) -> Exposure {
        let model = self.model;
        let [x, y] = [0, 1].map(|axis| places(frame.scope.edge_px[axis], PROBES, frame.is_mirrored()));
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
                    let place = [x[i % x.len()], y[i / x.len()]];
                    (exposure.evaluate(&ours, place) - truth).abs() <= allowed
                })
            };
            if probed.iter().all(meets) {
                return exposure;
            }
        }
        model.exposure(frame, DENSEST)
    }

    /// Planes so close that a spline through them meets those between.
    fn planes(&self, frame: &Frame, exposure: &Exposure, first: Vec<Vec<f64>>) -> Planes {
        let mut planes = Planes { values: first, steps: STEPS };
        let mut error_before = f64::INFINITY;
        loop {
            let steps = planes.steps;
            let between = |i: usize| {
                let z_um = self.depth((i + AROUND) as f64 + 0.5, steps);
                self.model.plane(&self.model.light(frame, z_um, self.small()), exposure)
            };
            let errors = [0, steps / 2, steps - 1].into_par_iter().map(|i| {
                let known = MIDWAY.into_iter().zip(&planes.values[i..i + 8]);
                deviation(&blend(known), &between(i))
            });
            let error = errors.reduce(|| 0.0, f64::max);
            // Where finer steps do not help, it is not the steps that err.
            let helped = error < 0.6 * error_before;
            if error <= PART * self.model.tolerance || steps >= MOST_STEPS || !helped {
                return planes;
            }
            error_before = error;
            // Planes half way join those that there are; of the outermost some fall away.
            let old = std::mem::take(&mut planes.values);
            planes.steps = 2 * steps;
            planes.values = (0..2 * steps + 1 + 2 * AROUND)
                .into_par_iter()
                .map(|i| {
                    let from_start = i as isize - AROUND as isize;
                    if from_start % 2 == 0 {
                        return old[(from_start / 2 + AROUND as isize) as usize].clone();
                    }
                    let z_um = self.depth(i as f64, 2 * steps);
                    self.model.plane(&self.model.light(frame, z_um, self.small()), exposure)
                })
                .collect();
        }
    }

    /// The radii that it takes to interpolate between two.
    fn sizes(&self, frame: &Frame, exposure: &Exposure, small: f64, large: f64) -> Vec<f64> {
        let z_um = self.start_um + 0.5 * self.length_um;
        let sample = |radius: &f64| self.model.plane(&self.model.light(frame, z_um, *radius), exposure);
        let mut count = SIZES;
        loop {
            let radii = size_nodes(small, large, count);
            let known: Vec<Vec<f64>> = radii.par_iter().map(sample).collect();
            let between: Vec<f64> = radii.windows(2).map(|pair| 0.5 * (pair[0] + pair[1])).collect();
            let error = between
                .par_iter()
                .map(|&radius| {
                    let weights = depth_spline::lagrange(&radii, radius);
                    deviation(&blend(weights.iter().map(|w| w.0).zip(&known)), &sample(&radius))
                })
                .reduce(|| 0.0, f64::max);
            if error <= PART * self.model.tolerance || count >= MOST_SIZES {
                return radii;
            }
            count += 1;
        }
    }

    /// Turns planes of all radii into splines.
    fn assemble(
        &self,
        values: &[Vec<f64>],
        steps: usize,
        radii: Vec<f64>,
        (edge_px, exposure): ([usize; 2], &Exposure),
    ) -> Table {
        let layout = exposure.layout.clone();
        let of_one = steps + 1 + 2 * AROUND;
        let mut coefficients = vec![0.0f32; radii.len() * (steps + 3) * layout.length()];
        let windows = values.chunks(of_one).flat_map(|of_size| of_size.windows(5));
        for (five, out) in windows.zip(coefficients.chunks_exact_mut(layout.length())) {
            layout.store(&blend(FILTER.into_iter().zip(five)), out);
        }
        // The reach of the largest sphere is that of all.
        let reach = |i: usize| {
            let of_sizes =
                values.chunks(of_one).map(|of_size| self.reach(&of_size[i + AROUND - 1], exposure));
            of_sizes.fold([0.0f64; 2], |a, b| [a[0].max(b[0]), a[1].max(b[1])])
        };
        Table {
            start_um: self.start_um,
            step_um: self.length_um / steps as f64,
            planes: steps + 3,
            radii,
            reach_px: (0..steps + 3).map(reach).collect(),
            edge_px,
            layout,
            coefficients,
            error: 0.0,
        }
    }

    /// Half width and half height of the part of a plane that is brighter than the cut, px.
    fn reach(&self, plane: &[f64], exposure: &Exposure) -> [f64; 2] {
        let cut = CUT * self.model.tolerance * peak(plane);
        let Layout { per_px, columns, origin, .. } = exposure.layout;
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

    /// How far the finished table is from an image computed more finely.
    fn error(&self, table: &Table, edge_px: [usize; 2]) -> f64 {
        let z_um = self.start_um + table.step_um * (((table.planes - 3) / 2) as f64 + 0.5);
        let radius_um = match table.radii[..] {
            [a, b, ..] => 0.5 * (a + b),
            _ => self.small(),
        };
        let finer = self.model.with_share(0.2 * self.model.share.min(SHARE * self.model.tolerance), 0.25);
        let frame = finer.frame(Scope { from_um: z_um, to_um: z_um, radius_um, edge_px, fineness: 1.3 });
        let [x, y] = edge_px.map(|edge| places(edge, 2 * edge, frame.is_mirrored()));
        let truth = finer.probe(&finer.light(&frame, z_um, radius_um), &finer.probes(&frame, [&x, &y]));
        let ours = Interpolated::new(table, z_um, radius_um);
        let differ = |(i, truth): (usize, &f64)| (ours.at(x[i % x.len()], y[i / x.len()])[0] - truth).abs();
        let largest = truth.iter().enumerate().map(differ).fold(0.0, f64::max);
        largest / peak(&truth)
    }
}

/// So many places between the particle and the edge, px; if nodes are not mirrored as many on the other side.
fn places(edge_px: usize, count: usize, mirrored: bool) -> Vec<f64> {
    let step = edge_px as f64 / count as f64;
    // Beside nodes, however dense.
    let side = (0..count).map(|i| (i as f64 + 0.307) * step);
    if mirrored { side.collect() } else { side.clone().map(|x| -x).chain(side).collect() }
}

/// Places along an axis at which densities are compared.
const PROBES: usize = 48;

fn peak(values: &[f64]) -> f64 {
    values.iter().copied().fold(f64::MIN_POSITIVE, f64::max)
}

/// The largest error of values, as a share of the peak.
fn deviation(ours: &[f64], truth: &[f64]) -> f64 {
    ours.iter().zip(truth).fold(0.0, |largest, (a, b)| f64::max(largest, (a - b).abs())) / peak(truth)
}

/// The weighted sum of planes.
fn blend<'a>(planes: impl Iterator<Item = (f64, &'a Vec<f64>)>) -> Vec<f64> {
    let mut sum = Vec::new();
    for (weight, plane) in planes {
        sum.resize(plane.len(), 0.0);
        sum.iter_mut().zip(plane).for_each(|(s, v)| *s += weight * v);
    }
    sum
}

/// Chebyshev's points with both ends.
fn size_nodes(small: f64, large: f64, n: usize) -> Vec<f64> {
    let (middle, half) = (0.5 * (small + large), 0.5 * (large - small));
    let angle = |i: usize| std::f64::consts::PI * i as f64 / (n - 1) as f64;
    (0..n).map(|i| middle - half * libm::cos(angle(i))).collect()
}
