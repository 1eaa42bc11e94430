//! Making a block: its spacings are found by trial, and the whole is verified.
//!
//! A block depends on nothing but settings, tolerance and its place, so it has the same bytes whoever asks first. Steps of
//! depth are halved until the spline through planes meets the planes between; in a quadrant, so are the steps between
//! nodes, until the spline nearest to twice as many values meets them. How finely the images themselves are computed is
//! found before. At last an image half way between two planes is computed more finely than the planes were and on twice as
//! many nodes, and the block's is held against it.

use rayon::prelude::*;

use super::block::{Block, Form};
use super::encircled;
use super::exposure::{self, Fineness, Grid, Part};
use super::layout::Layout;
use super::pixel::{self, AZIMUTHS, Pixels};
use super::pupil::Pupil;
use super::rings::Rings;
use super::sheet::Sheet;
use super::spline::{self, Degree};
use super::surface::Surface;
use crate::render::instructions::InstructionSet;

/// What images are made of.
#[derive(Debug)]
pub(super) struct Model {
    pub(super) pupil: Pupil,
    /// Error, as a share of an image's peak.
    pub(super) tolerance: f64,
    /// The farthest pixels that matter, px from a particle's image, on the two axes.
    pub(super) farthest_px: [f64; 2],
    pub(super) pixels: Pixels,
    pub(super) instructions: InstructionSet,
}

/// Radii of the spheres of a block, um.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Radii {
    One(f64),
    Between(f64, f64),
}

/// Nodes per px that a quadrant may have.
const DENSITIES: [usize; 4] = [1, 2, 4, 8];
/// Nodes per px, and numbers of a plane, up to which round images are drawn faster from a quadrant than along the radius.
const DENSEST_ROUND: usize = 2;
const LARGEST_ROUND: usize = 1 << 16;
/// Steps of depth that a block begins with, and the most it may have.
const STEPS: usize = 4;
const MOST_STEPS: usize = 64;
/// Nodes of the radius, at first and at most.
const SIZES: usize = 4;
const MOST_SIZES: usize = 8;
/// How often images are computed more finely than at first.
const FINER: usize = 2;
/// Source points of a sphere.
const POINTS: usize = 2048;

/// Values at the nodes of a quadrant.
#[derive(Debug, Clone, Copy)]
struct Quadrant {
    per_px: usize,
    columns: usize,
    rows: usize,
}

/// Where an image is computed. Those of a quadrant are twice as many per axis as are stored.
#[derive(Debug, Clone, Copy)]
enum Nodes {
    /// By azimuth and radius.
    Round(Rings),
    Quadrant(Quadrant),
}

impl Quadrant {
    /// Twice as many nodes per axis.
    fn computed(self) -> Quadrant {
        Quadrant { per_px: 2 * self.per_px, columns: 2 * self.columns, rows: 2 * self.rows }
    }
}

impl Nodes {
    fn finer(self) -> Nodes {
        match self {
            Nodes::Round(rings) => Nodes::Round(rings.finer()),
            Nodes::Quadrant(quadrant) => Nodes::Quadrant(quadrant.computed()),
        }
    }

    /// Where the nodes lie relative to the particle, px.
    fn places(self, z_um: f64) -> Vec<[f64; 2]> {
        match self {
            Nodes::Round(rings) => (0..AZIMUTHS)
                .flat_map(|azimuth| (0..rings.columns).map(move |k| (pixel::direction(azimuth), k as f64)))
                .map(|(direction, k)| direction.map(|d| d * k / rings.per_px(z_um)))
                .collect(),
            Nodes::Quadrant(Quadrant { per_px, columns, rows }) => (0..rows)
                .flat_map(|row| (0..columns).map(move |column| [column, row]))
                .map(|node| node.map(|n| n as f64 / per_px as f64))
                .collect(),
        }
    }
}

impl Model {
    fn is_round(&self) -> bool {
        self.pupil.system.cylinder.is_none()
    }

    /// Half width and half height of an image, px.
    fn reach(&self, z_um: f64, radius_um: f64) -> [f64; 2] {
        // Half a pixel; its diagonal if the image is round.
        let pixel = if self.is_round() { 0.75 } else { 0.6 };
        self.pupil.reach(z_um, radius_um).map(|r| r + pixel)
    }

    fn quadrant(&self, reach_px: [f64; 2], per_px: usize) -> Quadrant {
        let nodes = |axis: usize| {
            let seen = reach_px[axis].min(self.farthest_px[axis]);
            // Room for the spline to end.
            libm::ceil(seen * per_px as f64) as usize + 3
        };
        Quadrant { per_px, columns: nodes(0), rows: nodes(1) }
    }

    /// The image of a sphere at these nodes.
    fn sample(&self, z_um: f64, radius_um: f64, nodes: Nodes, fineness: Fineness) -> Vec<f64> {
        // A plane beyond the lens, which only borders on those in use, is dark.
        let beyond = self.pupil.distance(z_um) <= radius_um;
        match nodes {
            Nodes::Round(rings) if beyond => vec![0.0; rings.columns * AZIMUTHS],
            Nodes::Round(rings) => {
                let step_px = 1.0 / rings.per_px(z_um);
                let reach_px = rings.columns as f64 * step_px;
                let azimuths = self.azimuths(z_um, radius_um, reach_px, fineness);
                let places = (0..rings.columns).map(|k| k as f64 * step_px * FIXED_PER_PX as f64);
                azimuths
                    .iter()
                    .flat_map(|azimuth| places.clone().map(|place| spline::evaluate(azimuth, place)))
                    .collect()
            }
            Nodes::Quadrant(Quadrant { columns, rows, .. }) if beyond => vec![0.0; columns * rows],
            Nodes::Quadrant(quadrant) if self.is_round() => {
                self.round_quadrant(z_um, radius_um, quadrant, fineness)
            }
            Nodes::Quadrant(Quadrant { per_px, columns, rows }) => {
                let surface = Surface::sphere(radius_um, POINTS);
                let grid = Grid::about(per_px, columns, rows);
                let exposure = exposure::Exposed { pupil: &self.pupil, z_um, surface: &surface, grid };
                let values = exposure.light(Part::Quadrant, fineness, self.instructions);
                exposure::fold(&values, columns, rows)
            }
        }
    }

    /// A round image along the radius, at each azimuth of the samples: cubic splines on [`FIXED_PER_PX`] nodes per px.
    fn azimuths(&self, z_um: f64, radius_um: f64, reach_px: f64, fineness: Fineness) -> Vec<Vec<f64>> {
        let nodes = libm::ceil(reach_px * FIXED_PER_PX as f64) as usize + 2;
        let annuli = (nodes / FIXED_PER_PX + 2) * encircled::RINGS;
        let encircled =
            encircled::encircled(&self.pupil, z_um, radius_um, annuli, fineness, self.instructions);
        let values = self.pixels.integrate(&encircled, FIXED_PER_PX, nodes);
        let spline = |azimuth: &[f64]| {
            let mut azimuth = azimuth.to_vec();
            spline::even_spline(&mut azimuth, Degree::Three);
            azimuth
        };
        values.chunks(nodes).map(spline).collect()
    }

    /// The same on the nodes of a quadrant.
    fn round_quadrant(&self, z_um: f64, radius_um: f64, quadrant: Quadrant, fineness: Fineness) -> Vec<f64> {
        let Quadrant { per_px, columns, rows } = quadrant;
        let step_px = 1.0 / per_px as f64;
        let reach_px = step_px * libm::hypot(columns as f64, rows as f64);
        let orders = pixel::orders(&self.azimuths(z_um, radius_um, reach_px, fineness));
        let at = |column: usize, row: usize| {
            let (x, y) = (column as f64 * step_px, row as f64 * step_px);
            let r2 = x * x + y * y;
            let place = libm::sqrt(r2) * FIXED_PER_PX as f64;
            let cross = if r2 > 0.0 { x * y / r2 } else { 0.0 };
            let cos4 = 1.0 - 8.0 * cross * cross;
            // Clenshaw's sum of the orders.
            let (low, sum) = orders.iter().rev().fold((0.0, 0.0), |(after, next), order| {
                (next, spline::evaluate(order, place) + 2.0 * cos4 * next - after)
            });
            sum - cos4 * low
        };
        (0..rows)
            .flat_map(|row| {
                (0..columns).map({
                    let at = &at;
                    move |column| at(column, row)
                })
            })
            .collect()
    }

    /// The block of these spheres at the depths from `start_um` to `start_um + length_um`.
    pub(super) fn block(&self, start_um: f64, length_um: f64, radii: Radii) -> Block {
        let (Radii::One(small) | Radii::Between(small, _)) = radii;
        let Fineness(mut fineness) = self.fineness(start_um + 0.5 * length_um, small);
        let mut part = 0.75 * self.tolerance;
        let mut attempts = 0;
        loop {
            let attempt = Attempt { model: self, start_um, length_um, fineness: Fineness(fineness), part };
            let block = attempt.block(radii);
            attempts += 1;
            // More nodes make every image slower to draw, so they come last.
            match attempts {
                _ if block.error <= self.tolerance => return block,
                1 => fineness *= 1.5,
                2 => part *= 0.6,
                _ => return block,
            }
        }
    }

    /// How finely images about this depth are to be computed, whatever they are stored on: until half as much again changes
    /// little.
    fn fineness(&self, z_um: f64, radius_um: f64) -> Fineness {
        let mut fineness = 2.0 * (1e-3 / self.tolerance).clamp(0.3, 4.0);
        // Round images are computed closely enough.
        if self.is_round() {
            return Fineness(fineness);
        }
        let nodes = Nodes::Quadrant(self.quadrant(self.reach(z_um, radius_um), 1).computed());
        let mut image = self.sample(z_um, radius_um, nodes, Fineness(fineness));
        for _ in 0..FINER {
            let finer = self.sample(z_um, radius_um, nodes, Fineness(1.5 * fineness));
            if deviation(&image, &finer) <= 0.4 * self.tolerance {
                break;
            }
            fineness *= 1.5;
            image = finer;
        }
        Fineness(fineness)
    }
}

/// Nodes per px at which round images are computed, before they are taken to the nodes of their plane.
const FIXED_PER_PX: usize = 16;

/// A block in the making.
struct Attempt<'a> {
    model: &'a Model,
    start_um: f64,
    length_um: f64,
    fineness: Fineness,
    /// The part of the error that either spacing may cause, as a share of the peak.
    part: f64,
}

impl Attempt<'_> {
    fn sample(&self, z_um: f64, radius_um: f64, nodes: Nodes) -> Vec<f64> {
        self.model.sample(z_um, radius_um, nodes, self.fineness)
    }

    fn middle(&self) -> f64 {
        self.start_um + 0.5 * self.length_um
    }

    fn block(&self, radii: Radii) -> Block {
        let (small, large) = match radii {
            Radii::One(radius) => (radius, radius),
            Radii::Between(small, large) => (small, large),
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
            Radii::One(radius) => vec![radius],
            Radii::Between(..) => self.sizes(small, large, nodes),
        };
        if radii.len() > 1 {
            planes = radii.iter().flat_map(|&radius| self.planes_at(radius, nodes, steps)).collect();
        }
        let (form, coefficients) = self.coefficients(planes, nodes, steps);
        let mut block = Block {
            start_um: self.start_um,
            step_um: self.length_um / steps as f64,
            planes: steps + 3,
            radii,
            form,
            reach_px,
            coefficients,
            error: 0.0,
        };
        block.error = self.error(&block, nodes);
        block
    }

    /// Where images are computed: on a quadrant with nodes so dense that the spline nearest to its values, half as many per
    /// axis, meets them, or along the radius if the image is round and that would take too many.
    fn nodes(&self, small: f64, large: f64, reach_px: [f64; 2]) -> Nodes {
        let round = self.model.is_round();
        let (densest, largest) =
            if round { (DENSEST_ROUND, LARGEST_ROUND) } else { (usize::MAX, usize::MAX) };
        let quadrants = DENSITIES.into_iter().map(|per_px| self.model.quadrant(reach_px, per_px));
        let quadrants = quadrants.filter(|q| q.per_px <= densest && q.columns * q.rows <= largest);
        let mut last = None;
        for quadrant in quadrants.map(Quadrant::computed) {
            if self.is_met(small, quadrant) {
                return Nodes::Quadrant(quadrant);
            }
            last = Some(quadrant);
        }
        let reach = |z_um: f64| self.model.reach(z_um, large)[0];
        let rings = || Rings::new(self.start_um, self.length_um, self.model.farthest_px[0], reach);
        last.filter(|_| !round).map_or_else(|| Nodes::Round(rings()), Nodes::Quadrant)
    }

    /// Whether its spline is near enough in the middle of the range of depths, and within the tolerance at both ends, which
    /// images are between.
    fn is_met(&self, radius_um: f64, quadrant: Quadrant) -> bool {
        let columns = quadrant.columns / 2;
        [(0.5, self.part), (0.0, self.model.tolerance), (1.0, self.model.tolerance)].into_iter().all(
            |(share, allowed)| {
                let z_um = self.start_um + share * self.length_um;
                let values = self.sample(z_um, radius_um, Nodes::Quadrant(quadrant));
                let plane = spline::fit_plane(&values, columns);
                deviation(&spline::plane_at_half_nodes(&plane, columns), &values) <= allowed
            },
        )
    }

    /// Planes of one sphere before they are splines in depth, from [`AROUND`] before the range on.
    fn planes_at(&self, radius_um: f64, nodes: Nodes, steps: usize) -> Vec<Vec<f64>> {
        let step = self.length_um / steps as f64;
        let at = |i: usize| self.start_um + (i as f64 - AROUND as f64) * step;
        (0..steps + 1 + 2 * AROUND).into_par_iter().map(|i| self.sample(at(i), radius_um, nodes)).collect()
    }

    /// Planes so close that a spline through them meets those between; the number of steps over the range.
    fn planes(&self, radius_um: f64, nodes: Nodes) -> (Vec<Vec<f64>>, usize) {
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
            // Where finer steps do not help, it is not the steps that err.
            let helped = error < 0.6 * error_before;
            if error <= self.part || steps >= MOST_STEPS || !helped {
                return (planes, steps);
            }
            error_before = error;
            // Planes half way join those that there are; of the outermost some fall away.
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

    /// The radii that it takes to interpolate between two.
    fn sizes(&self, small: f64, large: f64, nodes: Nodes) -> Vec<f64> {
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

    /// Turns planes of all radii into splines.
    fn coefficients(&self, planes: Vec<Vec<f64>>, nodes: Nodes, steps: usize) -> (Form, Vec<f32>) {
        let of_one = steps + 1 + 2 * AROUND;
        let splines = planes.par_chunks(of_one).flat_map(|planes| {
            planes.par_windows(5).map(|five| {
                let plane = blend(FILTER.into_iter().zip(five));
                match nodes {
                    Nodes::Round(rings) => round_spline(&plane, rings.columns),
                    Nodes::Quadrant(Quadrant { columns, .. }) => spline::fit_plane(&plane, columns / 2),
                }
            })
        });
        let splines: Vec<Vec<f64>> = splines.collect();
        match nodes {
            Nodes::Round(rings) => {
                let n = rings.columns;
                // Orders of the azimuth that no plane needs are left out.
                let needed = |order: usize| {
                    let of_order = |plane: &Vec<f64>| {
                        let share = 0.4 * self.model.tolerance * peak(&plane[..n]);
                        measure(plane[order * n..][..n].iter().copied()) > share
                    };
                    splines.iter().any(of_order)
                };
                let orders = (1..AZIMUTHS).rev().find(|&order| needed(order)).map_or(1, |order| order + 1);
                let form = Form::Round(rings.of_orders(orders));
                let length = form.length();
                (form, splines.iter().flat_map(|plane| plane[..length].iter().map(|&v| v as f32)).collect())
            }
            Nodes::Quadrant(Quadrant { per_px, columns, rows }) => {
                let (per_px, columns, rows) = (per_px / 2, columns / 2, rows / 2);
                let layout = Layout::new(per_px, columns, rows);
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
                (Form::Quadrant(layout), coefficients)
            }
        }
    }

    /// How far the finished block is from an image computed more finely.
    fn error(&self, block: &Block, nodes: Nodes) -> f64 {
        let Fineness(fine) = self.fineness;
        let z_um = self.start_um + block.step_um * (((block.planes - 3) / 2) as f64 + 0.5);
        let radius_um = match block.radii[..] {
            [a, b, ..] => 0.5 * (a + b),
            [a] => a,
            [] => return 0.0,
        };
        // Quadrants are computed on twice as many nodes already.
        let nodes = if let Nodes::Round(_) = nodes { nodes.finer() } else { nodes };
        let truth = self.model.sample(z_um, radius_um, nodes, Fineness(1.5 * fine));
        let sheet = Sheet::new(block, z_um, radius_um);
        let ours: Vec<f64> = nodes.places(z_um).into_iter().map(|[x, y]| sheet.at(x, y)[0]).collect();
        deviation(&ours, &truth)
    }
}

/// Orders of the azimuth of values by azimuth and radius, as coefficients of quadratic splines along the radius.
fn round_spline(values: &[f64], columns: usize) -> Vec<f64> {
    let of_nodes: Vec<[f64; AZIMUTHS]> = (0..columns)
        .map(|k| pixel::harmonics(std::array::from_fn(|azimuth| values[azimuth * columns + k])))
        .collect();
    (0..AZIMUTHS)
        .flat_map(|order| {
            let mut line: Vec<f64> = of_nodes.iter().map(|harmonics| harmonics[order]).collect();
            spline::even_spline(&mut line, Degree::Two);
            line
        })
        .collect()
}

/// Planes before the range and behind it that a spline through planes needs.
const AROUND: usize = 3;

/// From values at equal steps to coefficients of the cubic spline: 1 - d2/6 + (d2/6)^2 with d2 the second difference,
/// which is exact but for (d2/6)^3.
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

fn peak(values: &[f64]) -> f64 {
    values.iter().copied().fold(f64::MIN_POSITIVE, f64::max)
}

/// The error of values, as a share of the peak. The dark around an image does not make it better.
fn deviation(ours: &[f64], truth: &[f64]) -> f64 {
    let peak = peak(truth);
    let lit = ours.iter().zip(truth).filter(|(a, b)| a.abs().max(b.abs()) > 1e-9 * peak);
    measure(lit.map(|(a, b)| a - b)) / peak
}

/// The measure of errors: their root mean square, or a quarter of the largest if that is more. Images have kinks where the
/// edge of a pixel touches the edge of a ring; close to them no interpolation is as good as elsewhere.
fn measure(errors: impl Iterator<Item = f64>) -> f64 {
    let (mut largest, mut squares, mut n) = (0.0f64, 0.0, 0);
    for error in errors {
        largest = largest.max(error.abs());
        squares += error * error;
        n += 1;
    }
    libm::sqrt(squares / f64::from(n.max(1))).max(0.25 * largest)
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
