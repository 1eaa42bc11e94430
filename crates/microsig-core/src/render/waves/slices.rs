//! A particle as slices across the optical axis, for lenses whose images do not depend on the distance from
//! the axis (the aplanatic one).
//!
//! All emitters at one depth have the image of a point at this depth, displaced: a circle of emitters for a
//! particle that shines at its surface, a disc for one that shines throughout. The image of a point changes
//! slowly with depth, by k z (1 - cos), and is interpolated between a few depths; the shape of the particle
//! changes fast, by k r sin, but its Fourier transform is known. The light of a particle is therefore the light of
//! points at a few depths, each convolved with the integral over depth of shape times interpolation weight.
//! These few replace tens of coherent modes.

use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, PoisonError};

use rustfft::num_complex::Complex;
use rustfft::{Fft, FftPlannerScalar};

use super::options::Emission;
use crate::quadrature::gauss_legendre_on;
use crate::render::spline;

/// Depths of the points that stand for a particle, um relative to its center, growing away from the lens.
/// `phases`: k d/2 (1 - cos) of the outermost ray, the range of phases between its middle and its end;
/// `tolerance`: their error relative to the peak.
pub(super) fn depths(emission: Emission, radius_um: f64, phases: f64, tolerance: f64) -> Vec<f64> {
    if radius_um == 0.0 {
        return vec![0.0];
    }
    // The hemisphere is half as long as the ball.
    let (from, to) = ends(emission);
    let range = 0.5 * (to - from) * phases;
    // Errors are a small part of the tolerance.
    let (base, more) = (if tolerance > 5e-3 { 1.0 } else { 1.6 }, usize::from(tolerance < 1e-3));
    let (nodes, _) = gauss_legendre_on(from, to, libm::ceil(base + range) as usize + more);
    nodes.iter().map(|u| radius_um * u).collect()
}

/// The range of depths of emitters, in units of the radius.
fn ends(emission: Emission) -> (f64, f64) {
    match emission {
        Emission::Surface => (-1.0, 0.0),
        Emission::Volume => (-1.0, 1.0),
    }
}

/// The particle in the particles' space, and the light by which it is seen.
#[derive(Debug, Clone, Copy)]
pub(super) struct Sphere<'a> {
    pub(super) emission: Emission,
    pub(super) radius_um: f64,
    /// See [`depths`].
    pub(super) depths_um: &'a [f64],
}

/// Number of steps of a table of spectra, with linear interpolation.
const SPECTRA: usize = 2048;

impl Sphere<'_> {
    /// The Fourier transforms of shape times interpolation weight of each depth, at equidistant spatial
    /// frequencies up to the highest one, cycles/um.
    fn spectra(&self, highest: f64) -> Vec<Vec<f64>> {
        let Sphere { emission, radius_um, depths_um } = *self;
        let (from, to) = ends(emission);
        let etendue = 2.0 * std::f64::consts::PI * radius_um * highest;
        let (nodes, weights) = gauss_legendre_on(from, to, libm::ceil(0.6 * etendue) as usize + 16);
        // By node: radius there, and the weights of the depths times the share of the light.
        let across = |u: f64| libm::sqrt(1.0 - u * u);
        let node_weights: Vec<(f64, Vec<f64>)> = nodes
            .iter()
            .zip(&weights)
            .map(|(u, weight)| {
                let light = match emission {
                    Emission::Surface => *weight,
                    Emission::Volume => 0.75 * (1.0 - u * u) * weight,
                };
                let depth_weights = spline::lagrange(depths_um, radius_um * u);
                (radius_um * across(*u), depth_weights.into_iter().map(|(w, _)| light * w).collect())
            })
            .collect();
        let mut spectra = vec![vec![0.0; SPECTRA + 2]; depths_um.len()];
        for i in 0..SPECTRA + 2 {
            let frequency = highest * i as f64 / SPECTRA as f64;
            for (radius, depth_weights) in &node_weights {
                let x = 2.0 * std::f64::consts::PI * radius * frequency;
                let shape = match emission {
                    Emission::Surface => libm::j0(x),
                    Emission::Volume if x < 1e-4 => 1.0,
                    Emission::Volume => 2.0 * libm::j1(x) / x,
                };
                spectra.iter_mut().zip(depth_weights).for_each(|(spectrum, w)| spectrum[i] += w * shape);
            }
        }
        spectra
    }
}

/// Spectra of a sphere, by its radius and the highest frequency (as bits).
type Known = BTreeMap<(u64, u64), Arc<Vec<Vec<f64>>>>;

/// Convolves light on a grid that is periodic.
pub(super) struct Convolution {
    /// Number of points along x and y.
    points: [usize; 2],
    /// Forward and backward, along x and y.
    transforms: [[Arc<dyn Fft<f64>>; 2]; 2],
    /// Spectra are the same for all images of a size.
    known: Mutex<Known>,
}

impl std::fmt::Debug for Convolution {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "Convolution({:?})", self.points)
    }
}

/// The smallest number from `points` up that is odd and has no prime factors but 3, 5 and 7.
pub(super) fn odd_and_smooth(points: usize) -> usize {
    let is_smooth = |n: &usize| {
        let mut rest = *n;
        for factor in [3, 5, 7] {
            while rest.is_multiple_of(factor) {
                rest /= factor;
            }
        }
        rest == 1
    };
    (points..).find(is_smooth).unwrap_or(points)
}

impl Convolution {
    /// For grids with these numbers of points along x and y. The transforms use no instructions that not all
    /// processors have, so results are the same on all of them.
    pub(super) fn new(points: [usize; 2]) -> Convolution {
        let mut planner = FftPlannerScalar::new();
        let transforms = [0, 1].map(|axis| {
            let n = points[axis];
            [planner.plan_fft_forward(n), planner.plan_fft_inverse(n)]
        });
        Convolution { points, transforms, known: Mutex::default() }
    }

    /// The light of a sphere, from points at its depths, each given on the grid; `frequency` is the
    /// spatial frequency in the particle's space (cycles/um) of a wave with these cycles per grid along x and
    /// y.
    pub(super) fn sum(
        &self,
        sphere: &Sphere<'_>,
        lights: &[Vec<f64>],
        frequency: impl Fn([f64; 2]) -> f64,
    ) -> Vec<f64> {
        let [columns, rows] = self.points;
        let cycles = |i: usize, n: usize| i as f64 - if 2 * i > n { n as f64 } else { 0.0 };
        let frequencies: Vec<f64> = (0..columns * rows)
            .map(|at| frequency([cycles(at % columns, columns), cycles(at / columns, rows)]))
            .collect();
        let highest = frequencies.iter().copied().fold(f64::MIN_POSITIVE, f64::max);
        let spectra = self.spectra(sphere, highest);
        let mut sum = vec![Complex::default(); columns * rows];
        // Two real grids are the real and the imaginary part of one: shapes are even, so their products with
        // the spectra of both parts come from the whole's and its mirror image.
        for (pair, lights) in spectra.chunks(2).zip(lights.chunks(2)) {
            let mut both: Vec<Complex<f64>> = match lights {
                [a, b] => a.iter().zip(b).map(|(a, b)| Complex::new(*a, *b)).collect(),
                [a, ..] => a.iter().map(|a| Complex::new(*a, 0.0)).collect(),
                [] => break,
            };
            self.transform(&mut both, 0);
            let last = pair.len() - 1;
            for (at, sum) in sum.iter_mut().enumerate() {
                let mirrored = (rows - at / columns) % rows * columns + (columns - at % columns) % columns;
                let (z, m) = (both[at], both[mirrored].conj());
                let place = frequencies[at] / highest * SPECTRA as f64;
                let cell = place as usize;
                let shape =
                    |table: &[f64]| table[cell] + (place - cell as f64) * (table[cell + 1] - table[cell]);
                let (first, second) = (shape(&pair[0]), shape(&pair[last]));
                *sum += 0.5 * ((z + m) * first + (z - m) * second);
            }
        }
        self.transform(&mut sum, 1);
        let scale = 1.0 / (columns * rows) as f64;
        sum.iter().map(|z| (z.re + z.im) * scale).collect()
    }

    fn spectra(&self, sphere: &Sphere<'_>, highest: f64) -> Arc<Vec<Vec<f64>>> {
        let key = (sphere.radius_um.to_bits(), highest.to_bits());
        let known = || self.known.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(spectra) = known().get(&key) {
            return Arc::clone(spectra);
        }
        // No lock is held: another thread that needs the same makes identical ones.
        let spectra = Arc::new(sphere.spectra(highest));
        known().insert(key, Arc::clone(&spectra));
        spectra
    }

    fn transform(&self, grid: &mut Vec<Complex<f64>>, direction: usize) {
        let [columns, rows] = self.points;
        self.transforms[0][direction].process(grid);
        let mut turned = transposed(grid, columns, rows);
        self.transforms[1][direction].process(&mut turned);
        *grid = transposed(&turned, rows, columns);
    }
}

/// A whole grid from its quadrant, whose first point is in the middle; rows of the quadrant have `stride`
/// numbers.
pub(super) fn whole(quadrant: &[f64], stride: usize, [columns, rows]: [usize; 2]) -> Vec<f64> {
    let from_middle = |i: usize, n: usize| i.abs_diff(n - 1);
    let row = |row: usize| {
        let line = &quadrant[from_middle(row, rows) * stride..];
        (0..2 * columns - 1).map(move |column| line[from_middle(column, columns)])
    };
    (0..2 * rows - 1).flat_map(row).collect()
}

/// The quadrant of a whole grid, without padding.
pub(super) fn quadrant(whole: &[f64], [columns, rows]: [usize; 2]) -> Vec<f64> {
    let lines = whole.chunks_exact(2 * columns - 1).skip(rows - 1);
    lines.flat_map(|line| &line[columns - 1..]).copied().collect()
}

fn transposed(grid: &[Complex<f64>], columns: usize, rows: usize) -> Vec<Complex<f64>> {
    let mut out = Vec::with_capacity(grid.len());
    for column in 0..columns {
        out.extend((0..rows).map(|row| grid[row * columns + column]));
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Convolved with their shapes, points have the sum of their light, and are as much wider as a ball or a
    /// hemisphere is.
    #[test]
    fn convolution_conserves_light_and_adds_variances() {
        let (n, step) = (odd_and_smooth(100), 0.25);
        assert_eq!(n, 105);
        let at = |i: usize| (i as f64 - (n / 2) as f64) * step;
        let spot: Vec<f64> = (0..n * n)
            .map(|i| libm::exp(-0.5 * (at(i % n) * at(i % n) + at(i / n) * at(i / n)) / 0.64))
            .collect();
        let period = n as f64 * step;
        // R^2 / 5 and R^2 / 3.
        for (emission, expected) in [(Emission::Volume, 0.8), (Emission::Surface, 4.0 / 3.0)] {
            let depths_um = depths(emission, 2.0, 1.2, 2e-3);
            let lights = vec![spot.clone(); depths_um.len()];
            let sphere = Sphere { emission, radius_um: 2.0, depths_um: &depths_um };
            let convolution = Convolution::new([n, n]);
            let seen = convolution.sum(&sphere, &lights, |[x, y]| libm::hypot(x, y) / period);
            let total: f64 = seen.iter().sum();
            assert!((total / spot.iter().sum::<f64>() - 1.0).abs() < 1e-9);
            let variance =
                seen.iter().enumerate().map(|(i, v)| v * at(i % n) * at(i % n)).sum::<f64>() / total;
            assert!((variance - 0.64 - expected).abs() < 1e-3, "{emission:?}: {variance}");
        }
    }
}
