//! Images of spheres over a range of depths, and of sizes: planes at equal steps of depth, interpolated between.
//!
//! A block is made in one piece and depends on nothing but settings, tolerance and its place, so it has the same bytes
//! whoever asks first. Its spacings are found by trial: from coarse to fine, until between all its planes, and at twice
//! as many places of each plane, it agrees with images computed there directly.

use rayon::prelude::*;

use super::encircled::{self, Fineness, RINGS};
use super::pixel::{AZIMUTHS, Pixels, harmonic, harmonics};
use super::planar::{self, Quadrant};
use super::pupil::Pupil;
use super::spline;

/// What images are made of.
#[derive(Debug)]
pub(super) struct Model {
    pub(super) pupil: Pupil,
    /// Largest error, as a share of an image's peak.
    pub(super) tolerance: f64,
    /// The farthest pixels that matter, px from a particle's image, on the two axes.
    pub(super) farthest_px: [f64; 2],
    pub(super) pixels: Pixels,
}

/// Radii of the spheres of a block, um.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Radii {
    One(f64),
    Between(f64, f64),
}

/// How a plane is laid out. Round images: columns are nodes along the radius, rows the harmonics of the azimuth; the
/// step between nodes grows with the image, so that edges keep their places among the nodes from plane to plane. Others:
/// columns and rows of a quadrant, at fixed steps.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Layout {
    pub(super) round: bool,
    /// Nodes per px; of round images, at their widest.
    pub(super) per_px: usize,
    pub(super) columns: usize,
    pub(super) rows: usize,
    /// Steps from the axis to the end of a round image.
    steps: f64,
}

/// Images over a range of depths and sizes, as spline coefficients.
#[derive(Debug)]
pub(super) struct Block {
    /// Depth of the plane with number 1; number 0 lies before the block's range.
    start_um: f64,
    step_um: f64,
    /// Planes for each radius.
    planes: usize,
    /// Radii of the nodes of interpolation.
    radii: Vec<f64>,
    pub(super) layout: Layout,
    /// Half width and half height of the images, px.
    pub(super) reach_px: [f64; 2],
    /// Steps between the nodes of each plane, px, by radius and plane.
    steps_px: Vec<f64>,
    /// By radius and plane.
    coefficients: Vec<f32>,
    /// The largest error found, as a share of the peak.
    pub(super) error: f64,
}

/// A plane computed directly: light on pixels at the nodes, twice as many per axis as a plane has.
struct Samples {
    values: Vec<f64>,
    layout: Layout,
}

/// Nodes per px at which round images are computed, before they are taken to the nodes of their plane.
const FIXED_PER_PX: usize = 16;

/// Steps of depth that a block begins with, and the most it may have.
const STEPS: usize = 4;
const MOST_STEPS: usize = 128;
const MOST_STEPS_OF_QUADRANTS: usize = 16;
/// Nodes per px that a block begins with, and the most it may have.
const PER_PX: usize = 2;
const MOST_PER_PX: usize = 16;
const MOST_PER_PX_OF_QUADRANTS: usize = 4;
/// Nodes of the radius, at first and at most.
const SIZES: usize = 4;
const MOST_SIZES: usize = 8;

impl Model {
    fn is_round(&self) -> bool {
        self.pupil.system.cylinder.is_none()
    }

    /// Half width and half height of an image, px.
    fn reach(&self, z_um: f64, radius_um: f64) -> [f64; 2] {
        let [x, y] = encircled::reach(&self.pupil, z_um, radius_um);
        let reach = if self.is_round() { [x.max(y); 2] } else { [x, y] };
        // Half a pixel's diagonal.
        reach.map(|r| r + 0.71)
    }

    /// A layout for images that reach so far.
    fn layout(&self, reach_px: [f64; 2], per_px: usize) -> Layout {
        // Beyond the farthest pixel there is room for the spline to end.
        let nodes = [0, 1].map(|axis| {
            let seen = reach_px[axis].min(self.farthest_px[axis] + 4.0);
            libm::ceil(seen * per_px as f64) as usize + 1
        });
        let round = self.is_round();
        let rows = if round { AZIMUTHS } else { nodes[1] };
        Layout { round, per_px, columns: nodes[0], rows, steps: reach_px[0] * per_px as f64 }
    }

    /// Step between the nodes of an image, px.
    fn step_px(&self, z_um: f64, radius_um: f64, layout: Layout) -> f64 {
        if layout.round { self.reach(z_um, radius_um)[0] / layout.steps } else { 1.0 / layout.per_px as f64 }
    }

    /// The image of a sphere at twice the layout's nodes.
    fn sample(&self, z_um: f64, radius_um: f64, layout: Layout, fineness: Fineness) -> Samples {
        let per_px = 2 * layout.per_px;
        let columns = 2 * layout.columns;
        let values = if self.pupil.distance(z_um) <= radius_um {
            // A plane beyond the lens, which only borders on those in use.
            vec![0.0; columns * if layout.round { AZIMUTHS } else { 2 * layout.rows }]
        } else if layout.round {
            let step_px = 0.5 * self.step_px(z_um, radius_um, layout);
            let fixed = libm::ceil(columns as f64 * step_px * FIXED_PER_PX as f64) as usize + 2;
            let rings = (fixed / FIXED_PER_PX + 2) * RINGS;
            let encircled = encircled::encircled(&self.pupil, z_um, radius_um, rings, fineness);
            let mut at_fixed = self.pixels.integrate(&encircled, FIXED_PER_PX, fixed);
            at_fixed
                .chunks_mut(fixed)
                .flat_map(|azimuth| {
                    spline::even_spline(azimuth);
                    let at = |k: usize| spline::evaluate(azimuth, k as f64 * step_px * FIXED_PER_PX as f64);
                    (0..columns).map(at).collect::<Vec<_>>()
                })
                .collect()
        } else {
            let quadrant = Quadrant { per_px, columns, rows: 2 * layout.rows };
            planar::pixels(&self.pupil, z_um, radius_um, quadrant, fineness)
        };
        Samples { values, layout }
    }
}

impl Samples {
    fn peak(&self) -> f64 {
        self.values.iter().copied().fold(f64::MIN_POSITIVE, f64::max)
    }

    /// Spline coefficients of every second node.
    fn coefficients(&self) -> Vec<f64> {
        let Layout { round, columns, rows, .. } = self.layout;
        let values = &self.values;
        if round {
            let at = |azimuth: usize, k: usize| values[azimuth * 2 * columns + 2 * k];
            let of_nodes: Vec<[f64; AZIMUTHS]> =
                (0..columns).map(|k| harmonics(std::array::from_fn(|azimuth| at(azimuth, k)))).collect();
            (0..AZIMUTHS)
                .flat_map(|order| {
                    let mut line: Vec<f64> = of_nodes.iter().map(|harmonics| harmonics[order]).collect();
                    spline::even_spline(&mut line);
                    line
                })
                .collect()
        } else {
            let lines = (0..rows).flat_map(|row| {
                let mut line: Vec<f64> =
                    (0..columns).map(|k| values[2 * row * 2 * columns + 2 * k]).collect();
                spline::even_spline(&mut line);
                line
            });
            along_columns(&lines.collect::<Vec<_>>(), columns, |mut column| {
                spline::even_spline(&mut column);
                column
            })
        }
    }

    /// The deviation of a plane's spline.
    fn difference(&self, coefficients: &[f64]) -> f64 {
        let layout = self.layout;
        let lines: Vec<f64> = coefficients.chunks(layout.columns).flat_map(spline::half_nodes).collect();
        let ours = if layout.round {
            let n = 2 * layout.columns;
            let cosines: Vec<Vec<f64>> =
                (0..AZIMUTHS).map(|a| (0..AZIMUTHS).map(|order| harmonic(order, a)).collect()).collect();
            cosines
                .iter()
                .flat_map(|cosines| (0..n).map(move |k| (cosines, k)))
                .map(|(cosines, k)| cosines.iter().enumerate().map(|(o, c)| c * lines[o * n + k]).sum())
                .collect()
        } else {
            along_columns(&lines, 2 * layout.columns, |column| spline::half_nodes(&column))
        };
        self.deviation(&ours)
    }

    /// How far other values at the same nodes are off, as a share of the peak.
    fn deviation(&self, values: &[f64]) -> f64 {
        deviation(values.iter().zip(&self.values).map(|(a, b)| a - b)) / self.peak()
    }
}

/// The measure of errors: their root mean square, or a quarter of the largest if that is more. Images have kinks where the
/// edge of a pixel touches the edge of a ring; close to them no interpolation is as good as elsewhere.
fn deviation(errors: impl Iterator<Item = f64>) -> f64 {
    let (mut largest, mut squares, mut n) = (0.0f64, 0.0, 0);
    for error in errors {
        largest = largest.max(error.abs());
        squares += error * error;
        n += 1;
    }
    libm::sqrt(squares / f64::from(n.max(1))).max(0.25 * largest)
}

/// Applies `f` to each column of a table with so many columns.
fn along_columns(values: &[f64], columns: usize, f: impl Fn(Vec<f64>) -> Vec<f64>) -> Vec<f64> {
    let done: Vec<Vec<f64>> =
        (0..columns).map(|c| f(values.iter().skip(c).step_by(columns).copied().collect())).collect();
    (0..done[0].len()).flat_map(|row| done.iter().map(move |column| column[row])).collect()
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

/// Weights of four planes half way between the middle two.
const MIDWAY: [f64; 4] = [-0.0625, 0.5625, 0.5625, -0.0625];

impl Block {
    /// The images of spheres of these radii at the depths from `start_um` to `start_um + length_um`.
    pub(super) fn new(model: &Model, start_um: f64, length_um: f64, radii: Radii) -> Block {
        let (small, large) = match radii {
            Radii::One(radius) => (radius, radius),
            Radii::Between(small, large) => (small, large),
        };
        let reach_px = [0, 1, 2, 3, 4].iter().fold([0.0f64; 2], |reach, &i| {
            // From a step before the range to a step behind it.
            let z_um = start_um + length_um * (-0.25 + 0.375 * f64::from(i));
            let more = model.reach(z_um, large);
            [reach[0].max(more[0]), reach[1].max(more[1])]
        });
        let middle = start_um + 0.5 * length_um;
        let tolerance = model.tolerance;

        let (most_per_px, finest) =
            if model.is_round() { (MOST_PER_PX, 8) } else { (MOST_PER_PX_OF_QUADRANTS, 4) };
        let mut fineness = Fineness(1);
        let mut layout = model.layout(reach_px, 2 * PER_PX);
        while fineness.0 < finest {
            let finer = Fineness(2 * fineness.0);
            let [samples, again] = [fineness, finer].map(|f| model.sample(middle, small, layout, f));
            if again.deviation(&samples.values) <= 0.6 * tolerance {
                break;
            }
            fineness = finer;
        }
        layout = model.layout(reach_px, PER_PX);
        loop {
            let samples = model.sample(middle, small, layout, fineness);
            if layout.per_px >= most_per_px || samples.difference(&samples.coefficients()) <= 0.4 * tolerance
            {
                break;
            }
            layout = model.layout(reach_px, 2 * layout.per_px);
        }
        loop {
            let found = Self::planes(model, (start_um, length_um), small, layout, fineness, most_per_px);
            if !found.crowded {
                let step_um = length_um / (found.planes.len() - 3) as f64;
                let mut block = Block {
                    start_um,
                    step_um,
                    planes: found.planes.len(),
                    radii: vec![small],
                    layout,
                    reach_px,
                    steps_px: Vec::new(),
                    coefficients: Vec::new(),
                    error: found.error,
                };
                match radii {
                    Radii::One(_) => block.keep(model, found.planes),
                    Radii::Between(..) => block.add_sizes(model, small, large, fineness),
                }
                return block;
            }
            layout = model.layout(reach_px, 2 * layout.per_px);
        }
    }

    /// Planes so close that the images of one sphere between them keep the tolerance.
    fn planes(
        model: &Model,
        (start_um, length_um): (f64, f64),
        radius_um: f64,
        layout: Layout,
        fineness: Fineness,
        most_per_px: usize,
    ) -> Planes {
        let sample = |z_um: f64| {
            let samples = model.sample(z_um, radius_um, layout, fineness);
            (samples.coefficients(), samples)
        };
        let sample_all = |count: usize, step: f64, first: f64| -> Vec<(Vec<f64>, Samples)> {
            (0..count).into_par_iter().map(|i| sample(start_um + (first + i as f64) * step)).collect()
        };
        let most_steps = if layout.round { MOST_STEPS } else { MOST_STEPS_OF_QUADRANTS };
        let mut steps = STEPS;
        let mut nodes = sample_all(steps + 3, length_um / steps as f64, -1.0);
        loop {
            let between = sample_all(steps + 2, length_um / steps as f64, -0.5);
            let (mut error, mut crowded) = (0.0f64, false);
            for i in 0..steps {
                let (own, samples) = &between[i + 1];
                let ours = blend(MIDWAY.into_iter().zip(nodes[i..i + 4].iter().map(|n| &n.0)));
                let differs = samples.difference(&ours);
                if differs > error {
                    error = differs;
                    crowded = layout.per_px < most_per_px && samples.difference(own) > 0.4 * model.tolerance;
                }
            }
            crowded &= error > 0.8 * model.tolerance;
            if error <= 0.8 * model.tolerance || crowded || steps >= most_steps {
                return Planes { planes: nodes.into_iter().map(|n| n.0).collect(), error, crowded };
            }
            // The planes half way become planes of half the step; of those outside only the nearest are kept.
            let mut merged = Vec::with_capacity(2 * steps + 3);
            let mut between = between.into_iter();
            let mut old = nodes.into_iter().skip(1);
            merged.extend(between.next());
            for _ in 0..=steps {
                merged.extend(old.next());
                merged.extend(between.next());
            }
            nodes = merged;
            steps *= 2;
        }
    }

    /// Finds the sizes that it takes to interpolate between `small` and `large`, and computes all their planes.
    fn add_sizes(&mut self, model: &Model, small: f64, large: f64, fineness: Fineness) {
        let layout = self.layout;
        let sample = |z_um: f64, radius: f64| model.sample(z_um, radius, layout, fineness);
        let middle = self.start_um + self.step_um * ((self.planes - 3) / 2) as f64;
        let mut count = SIZES;
        loop {
            self.radii = size_nodes(small, large, count);
            let known: Vec<Vec<f64>> =
                self.radii.par_iter().map(|&r| sample(middle, r).coefficients()).collect();
            let between: Vec<f64> = self.radii.windows(2).map(|pair| 0.5 * (pair[0] + pair[1])).collect();
            let errors: Vec<f64> = between
                .par_iter()
                .map(|&radius| {
                    let weights = spline::lagrange(&self.radii, radius);
                    sample(middle, radius).difference(&blend(weights.iter().map(|w| w.0).zip(&known)))
                })
                .collect();
            let error = errors.into_iter().fold(0.0, f64::max);
            if error <= 0.8 * model.tolerance || count >= MOST_SIZES {
                self.error = self.error.max(error);
                break;
            }
            count += 1;
        }
        let places: Vec<(f64, f64)> = self
            .radii
            .iter()
            .flat_map(|&radius| (0..self.planes).map(move |i| (i as f64 - 1.0, radius)))
            .map(|(i, radius)| (self.start_um + i * self.step_um, radius))
            .collect();
        let planes = places.par_iter().map(|&(z, radius)| sample(z, radius).coefficients()).collect();
        self.keep(model, planes);
    }

    /// Stores planes; orders of the azimuth that no plane needs are left out.
    fn keep(&mut self, model: &Model, planes: Vec<Vec<f64>>) {
        let (start_um, step_um, layout) = (self.start_um, self.step_um, self.layout);
        let depth = |i: usize| start_um + (i as f64 - 1.0) * step_um;
        self.steps_px = self
            .radii
            .iter()
            .flat_map(|&radius| (0..self.planes).map(move |i| model.step_px(depth(i), radius, layout)))
            .collect();
        let layout = &mut self.layout;
        if layout.round {
            let n = layout.columns;
            let needed = |order: usize| {
                planes.iter().any(|plane| {
                    let peak = plane[..n].iter().copied().fold(f64::MIN_POSITIVE, f64::max);
                    deviation(plane[order * n..][..n].iter().copied()) > 0.15 * model.tolerance * peak
                })
            };
            layout.rows = (1..AZIMUTHS).rev().find(|&order| needed(order)).map_or(1, |order| order + 1);
        }
        let length = layout.columns * layout.rows;
        self.coefficients =
            planes.iter().flat_map(|plane| plane[..length].iter().map(|&v| v as f32)).collect();
    }

    /// The planes around a depth and a radius.
    pub(super) fn around(&self, z_um: f64, radius_um: f64) -> impl Iterator<Item = Neighbour<'_>> {
        let length = self.layout.columns * self.layout.rows;
        let steps = (z_um - self.start_um) / self.step_um;
        let first = (steps.max(0.0) as usize).min(self.planes - 4);
        let depths = spline::lagrange(&[-1.0, 0.0, 1.0, 2.0], steps - first as f64);
        let sizes = spline::lagrange(&self.radii, radius_um);
        sizes.into_iter().enumerate().flat_map(move |(size, (of_size, _))| {
            let start = size * self.planes + first;
            let step_um = self.step_um;
            let planes = self.coefficients[start * length..(start + 4) * length].chunks(length);
            depths.clone().into_iter().zip(planes).zip(&self.steps_px[start..]).map(
                move |(((weight, slope), coefficients), &step_px)| Neighbour {
                    weight: of_size * weight,
                    by_z: of_size * slope / step_um,
                    step_px,
                    coefficients,
                },
            )
        })
    }

    /// Memory of the block, bytes.
    pub(super) fn bytes(&self) -> usize {
        size_of_val(self.coefficients.as_slice())
    }
}

/// A plane near a sphere.
pub(super) struct Neighbour<'a> {
    pub(super) weight: f64,
    /// Derivative of the weight by depth, 1/um.
    pub(super) by_z: f64,
    /// Step between nodes, px.
    pub(super) step_px: f64,
    pub(super) coefficients: &'a [f32],
}

/// Planes of one sphere.
struct Planes {
    planes: Vec<Vec<f64>>,
    /// The largest error half way between them.
    error: f64,
    /// Whether the tolerance is missed for want of nodes in a plane.
    crowded: bool,
}

/// Chebyshev's points with both ends.
fn size_nodes(small: f64, large: f64, n: usize) -> Vec<f64> {
    let (middle, half) = (0.5 * (small + large), 0.5 * (large - small));
    let angle = |i: usize| std::f64::consts::PI * i as f64 / (n - 1) as f64;
    (0..n).map(|i| middle - half * libm::cos(angle(i))).collect()
}
