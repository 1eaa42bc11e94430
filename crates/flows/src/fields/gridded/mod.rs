//! Velocities given at the nodes of a regular grid, with trilinear or tricubic spline interpolation.
//!
//! Nodes are at origin + (i, j, k) spacing, at times t_0 < t_1 < ...; between two times the velocity is
//! linear in time, before the first and after the last it is constant. Along an axis with a single node the
//! velocity is constant (planar data).
//!
//! Trilinear: the velocity is continuous, its gradient is discontinuous at the cell faces. Tricubic: the
//! interpolating tensor-product cubic B-spline (de Boor, A Practical Guide to Splines, chapters IX and XIII),
//! with two continuous derivatives; the gradient is the interpolant's. End conditions are not-a-knot,
//! which reproduces cubic polynomials up to the edge, or periodic. Beyond a non-periodic edge the velocity is
//! that at the edge.
//!
//! Tracer displacements are exact for the interpolant, not for the flow that the data sample. The interpolant
//! is in general not divergence-free, so that a uniform cloud may not stay uniform;
//! [`Gridded::divergence_rms`] quantifies this.

use crate::fields::composition::vortex;
use crate::fields::prelude::*;
use crate::params::{Parameter, range_of};
use crate::velocity_grid::VelocityGrid;
use microsig_core::bspline;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

const CHECK: ParameterCheck = ParameterCheck("gridded");

/// Interpolation between the nodes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Interpolation {
    /// Tricubic B-spline, with two continuous derivatives.
    #[default]
    Tricubic,
    /// Linear along each axis.
    Trilinear,
}

/// A field interpolated between the nodes of a grid.
#[derive(Debug, Clone, PartialEq)]
pub struct Gridded {
    axes: [Nodes; 3],
    times_s: Vec<f64>,
    cubic: bool,
    /// Spline coefficients of all times, x varies fastest, including those beyond the ends.
    coefficients: Vec<DVec3>,
    bound: f64,
    step: Option<f64>,
}

/// The nodes along one axis.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Nodes {
    origin: f64,
    spacing: f64,
    count: usize,
    periodic: bool,
    /// Number of coefficients along the axis.
    stored: usize,
}

/// The weights of up to four adjacent coefficients, and the derivatives of the weights.
#[derive(Debug, Clone, Copy)]
struct Weights {
    first: usize,
    number: usize,
    value: [f64; 4],
    slope: [f64; 4],
}

impl Gridded {
    /// The field interpolated from a grid; along `periodic` axes the node after the last is the first. `Err`
    /// if a periodic axis has fewer than 4 nodes.
    pub fn new(grid: &VelocityGrid, interpolation: Interpolation, periodic: [bool; 3]) -> Result<Self> {
        let cubic = interpolation == Interpolation::Tricubic;
        let counts = grid.counts();
        let mut axes = Vec::with_capacity(3);
        for axis in 0..3 {
            let (count, periodic) = (counts[axis], periodic[axis] && counts[axis] > 1);
            if periodic && cubic && count < 4 {
                return Err(CHECK.fault("nodes", count, "4 or more along a periodic axis"));
            }
            let stored = match (count, cubic, periodic) {
                (1, ..) => 1,
                (_, true, true) => count + 3,
                (_, true, false) => count + 2,
                (_, false, true) => count + 1,
                (_, false, false) => count,
            };
            let (origin, spacing) = (grid.origin_um()[axis], grid.spacing_um()[axis]);
            axes.push(Nodes { origin, spacing, count, periodic, stored });
        }
        let axes = [axes[0], axes[1], axes[2]];
        let coefficients: Vec<DVec3> = grid
            .velocities()
            .chunks(counts.iter().product())
            .flat_map(|values| spread(values, &axes, cubic))
            .collect();
        // A spline lies in the convex hull of its coefficients, because the weights are positive and sum
        // to 1.
        let bound = coefficients.iter().map(|u| u.length()).fold(0.0, f64::max);
        let finest =
            axes.iter().filter(|axis| axis.count > 1).map(|axis| axis.spacing).fold(f64::INFINITY, f64::min);
        let step = (!cubic && bound > 0.0 && finest.is_finite()).then(|| 0.1 * finest / bound);
        Ok(Gridded { axes, times_s: grid.times_s().to_vec(), cubic, coefficients, bound, step })
    }

    /// Root mean square divergence at the cell centers at the first time, relative to the root mean square of
    /// the elements of the gradient; 0 if the velocity is uniform.
    pub fn divergence_rms(&self) -> f64 {
        let t = self.times_s[0];
        let cells = self.axes.map(|axis| axis.count.max(2) - 1);
        let (mut divergence, mut elements) = (0.0, 0.0);
        for k in 0..cells[2] {
            for j in 0..cells[1] {
                for i in 0..cells[0] {
                    let place = [i, j, k].map(|n| n as f64 + 0.5);
                    let x: [f64; 3] =
                        std::array::from_fn(|a| self.axes[a].origin + place[a] * self.axes[a].spacing);
                    let gradient = self.gradient(DVec3::from_array(x), t);
                    let trace: f64 = (0..3).map(|a| gradient.col(a)[a]).sum();
                    divergence += trace * trace;
                    elements += (0..3).map(|a| gradient.col(a).length_squared()).sum::<f64>() / 9.0;
                }
            }
        }
        if elements > 0.0 { libm::sqrt(divergence / elements) } else { 0.0 }
    }

    /// Indices of the times before and after `t` (s), and the weight of the later one.
    fn between(&self, t: f64) -> (usize, usize, f64) {
        let later = self.times_s.partition_point(|time| *time <= t);
        if later == 0 {
            return (0, 0, 0.0);
        }
        let Some(end) = self.times_s.get(later) else { return (later - 1, later - 1, 0.0) };
        let start = self.times_s[later - 1];
        (later - 1, later, (t - start) / (end - start))
    }

    /// The velocity at one stored time and, if `slopes` is set, its gradient.
    fn at(&self, time: usize, weights: &[Weights; 3], slopes: bool) -> (DVec3, DMat3) {
        let [nx, ny, nz] = self.axes.map(|axis| axis.stored);
        let base = time * nx * ny * nz;
        let (mut u, mut gradient) = (DVec3::ZERO, DMat3::ZERO);
        let [x, y, z] = weights;
        for k in 0..z.number {
            for j in 0..y.number {
                let row = base + ((z.first + k) * ny + y.first + j) * nx + x.first;
                let (mut sum, mut along) = (DVec3::ZERO, DVec3::ZERO);
                for i in 0..x.number {
                    let c = self.coefficients[row + i];
                    sum += c * x.value[i];
                    if slopes {
                        along += c * x.slope[i];
                    }
                }
                u += sum * (y.value[j] * z.value[k]);
                if slopes {
                    gradient.x_axis += along * (y.value[j] * z.value[k]);
                    gradient.y_axis += sum * (y.slope[j] * z.value[k]);
                    gradient.z_axis += sum * (y.value[j] * z.slope[k]);
                }
            }
        }
        (u, gradient)
    }

    /// The velocity and, if `slopes` is set, the gradient at `x` (um) and `t` (s).
    fn look_up(&self, x: DVec3, t: f64, slopes: bool) -> (DVec3, DMat3) {
        if !x.is_finite() {
            return (DVec3::NAN, DMat3::NAN);
        }
        let weights = std::array::from_fn(|i| self.axes[i].weights(x[i], self.cubic));
        let (before, after, share) = self.between(t);
        let (u, gradient) = self.at(before, &weights, slopes);
        if share == 0.0 {
            return (u, gradient);
        }
        let (later, later_gradient) = self.at(after, &weights, slopes);
        (u + (later - u) * share, gradient + (later_gradient - gradient) * share)
    }

    /// Fraction of the volume of a region beyond the outermost nodes, 0 to 1. Periodic axes, and axes with a
    /// single node, cover everything.
    pub(super) fn uncovered(&self, region: &Region) -> f64 {
        let covered = |axis: usize, nodes: &Nodes| {
            if nodes.periodic || nodes.count == 1 {
                return 1.0;
            }
            let last = nodes.origin + (nodes.count - 1) as f64 * nodes.spacing;
            let (low, high) = (region.min()[axis], region.max()[axis]);
            ((high.min(last) - low.max(nodes.origin)) / (high - low)).clamp(0.0, 1.0)
        };
        1.0 - self.axes.iter().enumerate().map(|(axis, nodes)| covered(axis, nodes)).product::<f64>()
    }
}

impl Nodes {
    /// The interpolation weights at a finite coordinate (um).
    fn weights(&self, x: f64, cubic: bool) -> Weights {
        if self.count == 1 {
            return Weights { first: 0, number: 1, value: [1.0, 0.0, 0.0, 0.0], slope: [0.0; 4] };
        }
        let n = self.count as f64;
        let mut place = (x - self.origin) / self.spacing;
        let last = if self.periodic { n } else { n - 1.0 };
        let mut slope = 1.0 / self.spacing;
        if self.periodic {
            place -= libm::floor(place / n) * n;
        } else if !(0.0..=last).contains(&place) {
            slope = 0.0;
        }
        place = place.clamp(0.0, last);
        let cell = libm::floor(place).min(last - 1.0);
        let f = place - cell;
        let first = cell as usize;
        if !cubic {
            let (value, slope) = ([1.0 - f, f, 0.0, 0.0], [-slope, slope, 0.0, 0.0]);
            return Weights { first, number: 2, value, slope };
        }
        let (value, slopes) = bspline::cubic(f);
        Weights { first, number: 4, value, slope: slopes.map(|s| s * slope) }
    }

    /// The spline coefficients of values at the nodes of the axis.
    fn solve(&self, values: &[DVec3], cubic: bool) -> Vec<DVec3> {
        match (self.count, cubic, self.periodic) {
            (1, ..) | (_, false, false) => values.to_vec(),
            (_, false, true) => values.iter().chain(&values[..1]).copied().collect(),
            (_, true, true) => periodic_spline(values),
            (_, true, false) => open_spline(values),
        }
    }
}

/// Coefficients c_-1 .. c_n of the spline with (c_i-1 + 4 c_i + c_i+1) / 6 = f_i and not-a-knot end
/// conditions.
///
/// Continuity of the third derivative at node 1 gives c_1 = (8 f_1 - f_0 - f_2) / 6, and likewise at the
/// other end; the rest is a tridiagonal system. For 3 nodes it is the parabola, for 2 the straight line.
fn open_spline(f: &[DVec3]) -> Vec<DVec3> {
    let n = f.len();
    let mut c = vec![DVec3::ZERO; n];
    if n == 2 {
        return vec![f[0] * 2.0 - f[1], f[0], f[1], f[1] * 2.0 - f[0]];
    }
    let second = |i: usize| (f[i] * 8.0 - f[i - 1] - f[i + 1]) / 6.0;
    c[1] = second(1);
    c[n - 2] = second(n - 2);
    if n > 4 {
        // Thomas algorithm for c_2 .. c_n-3.
        let mut share = vec![0.0; n];
        for i in 2..n - 2 {
            let pivot = 4.0 - share[i - 1];
            share[i] = 1.0 / pivot;
            c[i] = (f[i] * 6.0 - c[i - 1]) / pivot;
        }
        for i in (2..n - 2).rev() {
            c[i] = c[i] - c[i + 1] * share[i];
        }
    }
    if n == 3 {
        // The second difference of a parabola is constant.
        let bend = f[0] - f[1] * 2.0 + f[2];
        (c[0], c[2]) = (f[0] - bend / 6.0, f[2] - bend / 6.0);
        return vec![c[0] * 3.0 - c[1] * 3.0 + c[2], c[0], c[1], c[2], c[0] - c[1] * 3.0 + c[2] * 3.0];
    }
    c[0] = f[1] * 6.0 - c[1] * 4.0 - c[2];
    c[n - 1] = f[n - 2] * 6.0 - c[n - 2] * 4.0 - c[n - 3];
    let beyond = |a: DVec3, b: DVec3, d: DVec3, e: DVec3| a * 4.0 - b * 6.0 + d * 4.0 - e;
    let (low, high) = (beyond(c[0], c[1], c[2], c[3]), beyond(c[n - 1], c[n - 2], c[n - 3], c[n - 4]));
    std::iter::once(low).chain(c).chain(std::iter::once(high)).collect()
}

/// Coefficients c_-1 .. c_n+1 of the periodic spline, by the two recursive filters with the pole sqrt 3 - 2
/// (Unser, IEEE Signal Processing Magazine 16(6) (1999) 22), summed over the period.
fn periodic_spline(f: &[DVec3]) -> Vec<DVec3> {
    let n = f.len();
    let pole = libm::sqrt(3.0) - 2.0;
    // The sum over all repetitions of the period.
    let turns = |start: usize, step: usize, values: &[DVec3]| {
        let (mut sum, mut power, mut at) = (DVec3::ZERO, 1.0, start);
        for _ in 0..n {
            sum += values[at] * power;
            power *= pole;
            at = (at + step) % n;
        }
        sum / (1.0 - power)
    };
    let mut forward = vec![turns(0, n - 1, f)];
    for k in 1..n {
        forward.push(f[k] + forward[k - 1] * pole);
    }
    let mut c = vec![DVec3::ZERO; n];
    c[n - 1] = turns(n - 1, 1, &forward) * -pole;
    for k in (0..n - 1).rev() {
        c[k] = (c[k + 1] - forward[k]) * pole;
    }
    let at = |i: usize| c[i % n] * 6.0;
    (n - 1..=2 * n + 1).map(at).collect()
}

/// The spline coefficients of one time, computed axis by axis.
fn spread(values: &[DVec3], axes: &[Nodes; 3], cubic: bool) -> Vec<DVec3> {
    let mut sizes = axes.map(|axis| axis.count);
    let mut field = values.to_vec();
    for axis in 0..3 {
        let before: usize = sizes[..axis].iter().product();
        let after: usize = sizes[axis + 1..].iter().product();
        let (count, stored) = (axes[axis].count, axes[axis].stored);
        let mut next = vec![DVec3::ZERO; before * stored * after];
        for outer in 0..after {
            for inner in 0..before {
                let line: Vec<DVec3> =
                    (0..count).map(|i| field[(outer * count + i) * before + inner]).collect();
                for (i, c) in axes[axis].solve(&line, cubic).into_iter().enumerate() {
                    next[(outer * stored + i) * before + inner] = c;
                }
            }
        }
        field = next;
        sizes[axis] = stored;
    }
    field
}

impl VelocityField for Gridded {
    fn velocity(&self, x: DVec3, t: f64) -> DVec3 {
        self.look_up(x, t, false).0
    }

    fn gradient(&self, x: DVec3, t: f64) -> DMat3 {
        self.look_up(x, t, true).1
    }

    fn is_steady(&self) -> bool {
        self.times_s.len() == 1
    }

    fn max_speed(&self, _region: &Region, _t0: f64, _t1: f64) -> f64 {
        self.bound * ROUNDING_MARGIN
    }

    fn step_limit(&self, _x: DVec3, _t: f64) -> Option<f64> {
        self.step
    }

    fn share_without_data(&self, region: &Region) -> f64 {
        self.uncovered(region)
    }
}

/// Samples of a field on a grid over the default scene, for examples and tests: 49 x 25 x 11 nodes with a
/// spacing of 10 um.
pub(crate) fn sampled(field: &dyn VelocityField) -> Result<VelocityGrid> {
    let origin = DVec3::new(-240.0, -120.0, -80.0);
    let counts = [49, 25, 11];
    let mut velocities = Vec::new();
    for k in 0..counts[2] {
        for j in 0..counts[1] {
            for i in 0..counts[0] {
                let steps = [i, j, k].map(|n| n as f64);
                velocities.push(field.velocity(origin + DVec3::from_array(steps) * 10.0, 0.0));
            }
        }
    }
    VelocityGrid::new(origin, DVec3::splat(10.0), counts, vec![0.0], velocities)
}

pub(crate) const ENTRY: FieldEntry = FieldEntry {
    name: "gridded",
    formula: "u = SUM c_ijk B_i(x) B_j(y) B_k(z), cubic B-splines or linear, linear in time",
    parameters: &[
        Parameter::new(
            "interpolation",
            "Interpolation::Tricubic",
            None,
            "tricubic or trilinear",
            "Interpolation between the nodes.",
        ),
        Parameter::new(
            "periodic",
            "[false, false, false]",
            None,
            "true or false",
            "Whether the data are periodic along x, y and z.",
        ),
        Parameter::new(
            "origin_um",
            "[-240.0, -120.0, -80.0]",
            range_of!(finite),
            "",
            "For a `.npy` file, in the key `geometry`: position of the first node, um.",
        ),
        Parameter::new(
            "spacing_um",
            "[10.0, 10.0, 10.0]",
            range_of!(> 0),
            "",
            "For a `.npy` file, in `geometry`: node spacing along x, y and z, um.",
        ),
        Parameter::new(
            "times_s",
            "[]",
            range_of!(finite),
            "increasing",
            "For a `.npy` file, in `geometry`: times of the stored fields, s.",
        ),
    ],
    source: "de Boor, A Practical Guide to Splines, IX and XIII",
    plane: PlotPlane::XY,
    make: || example(Interpolation::Tricubic),
    variants: &[("trilinear", || example(Interpolation::Trilinear))],
};

/// Example: a grid of samples of a vortex.
fn example(interpolation: Interpolation) -> Result<Box<dyn VelocityField>> {
    let grid = sampled(vortex(0.0)?.as_ref())?;
    Ok(Box::new(Gridded::new(&grid, interpolation, [false; 3])?))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fields::{Abc, AbcParams, Linear};

    /// A grid of samples of a function of position, with spacing (2, 3, 4) um from (1, 2, 3) um.
    fn grid(counts: [usize; 3], times_s: Vec<f64>, f: impl Fn(DVec3, f64) -> DVec3) -> VelocityGrid {
        let (origin, spacing) = (DVec3::new(1.0, 2.0, 3.0), DVec3::new(2.0, 3.0, 4.0));
        let mut velocities = Vec::new();
        for t in &times_s {
            for k in 0..counts[2] {
                for j in 0..counts[1] {
                    for i in 0..counts[0] {
                        let steps = DVec3::new(i as f64, j as f64, k as f64);
                        velocities.push(f(origin + steps * spacing, *t));
                    }
                }
            }
        }
        VelocityGrid::new(origin, spacing, counts, times_s, velocities).unwrap()
    }

    fn cubic(x: DVec3) -> DVec3 {
        DVec3::new(x.x * x.x * x.x - x.y * x.z, x.y * x.y * x.x, x.z * x.z * x.z - 2.0 * x.y * x.y * x.y)
    }

    #[test]
    fn cubic_polynomials_are_exact_up_to_the_edge() {
        for counts in [[4, 4, 4], [5, 6, 9]] {
            let field =
                Gridded::new(&grid(counts, vec![0.0], |x, _| cubic(x)), Interpolation::Tricubic, [false; 3])
                    .unwrap();
            for i in 0..50 {
                let i = f64::from(i);
                let unit = DVec3::new(i * 0.819 % 1.0, i * 0.671 % 1.0, i / 49.0);
                let x = DVec3::new(1.0, 2.0, 3.0) + unit * DVec3::new(6.0, 9.0, 12.0);
                // Rounding errors of some dozens of additions of numbers of 1e4.
                assert!((field.velocity(x, 0.0) - cubic(x)).length() < 1e-10, "{x}");
                let expected = DMat3::from_cols(
                    DVec3::new(3.0 * x.x * x.x, x.y * x.y, 0.0),
                    DVec3::new(-x.z, 2.0 * x.x * x.y, -6.0 * x.y * x.y),
                    DVec3::new(-x.y, 0.0, 3.0 * x.z * x.z),
                );
                assert!(field.gradient(x, 0.0).abs_diff_eq(expected, 1e-10), "{x}");
            }
        }
    }

    #[test]
    fn few_nodes_give_parabolas_lines_and_constants() {
        let f = |x: DVec3| DVec3::new(x.x * x.x + x.y, x.x * x.y, 5.0);
        let field =
            Gridded::new(&grid([3, 2, 1], vec![0.0], |x, _| f(x)), Interpolation::Tricubic, [false; 3])
                .unwrap();
        for x in [DVec3::new(1.7, 2.2, -50.0), DVec3::new(4.9, 4.9, 99.0)] {
            assert!((field.velocity(x, 0.0) - f(x)).length() < 1e-13);
        }
        // Beyond the edge the velocity is that at the edge.
        let edge = field.velocity(DVec3::new(1.0, 3.0, 0.0), 7.0);
        assert!((field.velocity(DVec3::new(-9.0, 3.0, 0.0), 7.0) - edge).length() == 0.0);
        assert_eq!(field.gradient(DVec3::new(-9.0, 3.0, 0.0), 7.0).x_axis, DVec3::ZERO);
    }

    #[test]
    fn nodes_are_kept_and_trilinear_is_linear_between() {
        let data = grid([4, 5, 6], vec![0.0, 2.0], |x, t| cubic(x) * (1.0 + t));
        for interpolation in [Interpolation::Trilinear, Interpolation::Tricubic] {
            for periodic in [[false; 3], [true; 3]] {
                let field = Gridded::new(&data, interpolation, periodic).unwrap();
                for node in
                    [DVec3::new(1.0, 2.0, 3.0), DVec3::new(7.0, 14.0, 23.0), DVec3::new(3.0, 8.0, 15.0)]
                {
                    for (t, factor) in [(-1.0, 1.0), (0.0, 1.0), (0.5, 1.5), (2.0, 3.0), (9.0, 3.0)] {
                        let gap = (field.velocity(node, t) - cubic(node) * factor).length();
                        assert!(gap < 1e-9, "{interpolation:?} {periodic:?} {node} {t}: {gap:e}");
                    }
                }
            }
        }
        let field = Gridded::new(&data, Interpolation::Trilinear, [false; 3]).unwrap();
        let (a, b) = (DVec3::new(3.0, 5.0, 7.0), DVec3::new(5.0, 5.0, 7.0));
        let middle = field.velocity(0.5 * (a + b), 0.0);
        assert!((middle - 0.5 * (cubic(a) + cubic(b))).length() < 1e-12);
    }

    #[test]
    fn a_periodic_grid_repeats() {
        let wave =
            |x: DVec3| DVec3::new(libm::sin(2.0 * std::f64::consts::PI * (x.x - 1.0) / 16.0), 0.0, 1.0);
        let data = grid([8, 1, 1], vec![0.0], |x, _| wave(x));
        for interpolation in [Interpolation::Trilinear, Interpolation::Tricubic] {
            let field = Gridded::new(&data, interpolation, [true, false, false]).unwrap();
            for i in 0..40 {
                let x = DVec3::X * (0.4 * f64::from(i));
                let gap = (field.velocity(x, 0.0) - field.velocity(x + DVec3::X * 48.0, 0.0)).length();
                assert!(gap < 1e-13);
                // Error of cubic splines with 8 nodes per wavelength: (2 pi / 8)^4 / 384 = 1e-3.
                assert!(
                    interpolation == Interpolation::Trilinear
                        || (field.velocity(x, 0.0) - wave(x)).length() < 2e-3
                );
            }
        }
    }

    #[test]
    fn the_spline_converges_with_its_fourth_order() {
        let field = Abc::new(&AbcParams::default()).unwrap();
        let spline = Gridded::new(&sampled(&field).unwrap(), Interpolation::Tricubic, [false; 3]).unwrap();
        let gap = (0..200).map(f64::from).map(|i| {
            let unit = DVec3::new(i * 0.819 % 1.0, i * 0.671 % 1.0, i * 0.5497 % 1.0);
            let x = DVec3::new(-240.0, -120.0, -80.0) + unit * DVec3::new(480.0, 240.0, 100.0);
            (spline.velocity(x, 0.0) - field.velocity(x, 0.0)).length()
        });
        // 5/384 h^4 k^4 u = 2e-3 u along each axis, several times that in the cells at the edge.
        assert!(gap.fold(0.0, f64::max) < 0.03 * 1000.0);
        // No component varies along its own axis, so the spline is divergence-free.
        assert!(spline.divergence_rms() < 1e-12, "{}", spline.divergence_rms());
        let strained = grid([5, 5, 5], vec![0.0], |x, _| x);
        let field = Gridded::new(&strained, Interpolation::Trilinear, [false; 3]).unwrap();
        // Trace 3, elements of root mean square 1 / sqrt 3.
        assert!((field.divergence_rms() - 3.0 * libm::sqrt(3.0)).abs() < 1e-12);
    }

    #[test]
    fn the_uncovered_share_is_that_of_the_volume() {
        // Nodes from (-240, -120, -80) to (240, 120, 20) um.
        let grid = sampled(&Linear::uniform(DVec3::X).unwrap()).unwrap();
        let share = |periodic: [bool; 3], min: [f64; 3], max: [f64; 3]| {
            let region = Region::new(DVec3::from_array(min), DVec3::from_array(max)).unwrap();
            Gridded::new(&grid, Interpolation::Trilinear, periodic).unwrap().uncovered(&region)
        };
        let none = [false; 3];
        assert_eq!(share(none, [-240.0, -100.0, -80.0], [240.0, 120.0, 20.0]), 0.0);
        assert_eq!(share(none, [-240.0, -120.0, -80.0], [720.0, 120.0, 20.0]), 0.5);
        assert_eq!(share(none, [-240.0, -120.0, -280.0], [720.0, 120.0, 20.0]), 1.0 - 0.5 / 3.0);
        assert_eq!(share([true, false, false], [-240.0, -120.0, -80.0], [720.0, 120.0, 20.0]), 0.0);
        assert_eq!(share(none, [300.0, 0.0, 0.0], [400.0, 10.0, 10.0]), 1.0);
    }
}
