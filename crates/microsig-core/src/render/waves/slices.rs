//! A particle as slices across the optical axis, for lenses whose images do not depend on the distance from
//! the axis (the aplanatic one).
//!
//! All emitters of a slice have the image of a point at its depth, displaced. The light of a slice is
//! therefore that of a point, convolved with the slice's shape: a circle of emitters for a particle that
//! shines at its surface, a disc for one that shines throughout. A few slices replace tens of coherent modes,
//! since depth enters a pupil function by k z (1 - cos), the distance from the axis by k r sin.

use std::sync::Arc;

use rustfft::num_complex::Complex;
use rustfft::{Fft, FftPlannerScalar};

use super::options::Emission;
use crate::quadrature::gauss_legendre_on;

/// Emitters at one depth.
#[derive(Debug, Clone, Copy)]
pub(super) struct Slice {
    /// Depth relative to the particle's center, um, growing away from the lens.
    pub(super) depth_um: f64,
    /// Fraction of the particle's light.
    pub(super) weight: f64,
    radius_um: f64,
    /// Whether emitters fill the circle.
    is_disc: bool,
}

/// Slices of a sphere. `phases`: k d/2 (1 - cos) of the outermost ray, the range of phases between its middle
/// and its end; `tolerance`: their error relative to the peak.
pub(super) fn slices(emission: Emission, radius_um: f64, phases: f64, tolerance: f64) -> Vec<Slice> {
    if radius_um == 0.0 {
        return vec![Slice { depth_um: 0.0, weight: 1.0, radius_um: 0.0, is_disc: false }];
    }
    // Errors of about 1e-2, 1e-3 and 1e-4 of the peak.
    let (base, more) = (if tolerance > 5e-3 { 1.6 } else { 2.6 }, usize::from(tolerance < 1e-3));
    // The hemisphere is half as long as the ball.
    let (from, to, range, is_disc) = match emission {
        Emission::Surface => (-1.0, 0.0, 0.5 * phases, false),
        Emission::Volume => (-1.0, 1.0, phases, true),
    };
    let (nodes, weights) = gauss_legendre_on(from, to, libm::ceil(base + range) as usize + more);
    let slice = |(u, weight): (&f64, &f64)| {
        let across = 1.0 - u * u;
        let light = if is_disc { 0.75 * across * weight } else { *weight };
        Slice { depth_um: radius_um * u, weight: light, radius_um: radius_um * libm::sqrt(across), is_disc }
    };
    nodes.iter().zip(&weights).map(slice).collect()
}

impl Slice {
    /// The Fourier transform of its shape at a spatial frequency, cycles/um.
    fn spectrum(&self, frequency: f64) -> f64 {
        let x = 2.0 * std::f64::consts::PI * self.radius_um * frequency;
        match self.is_disc {
            false => libm::j0(x),
            true if x < 1e-4 => 1.0,
            true => 2.0 * libm::j1(x) / x,
        }
    }

    /// The same at equidistant frequencies up to the highest one.
    fn spectra(&self, highest: f64) -> Vec<f64> {
        (0..SPECTRA + 2).map(|i| self.spectrum(highest * i as f64 / SPECTRA as f64)).collect()
    }
}

/// Number of steps of a table of spectra, with linear interpolation: errors of 1e-6 up to ten rings.
const SPECTRA: usize = 4096;

/// Convolves light on a grid that is periodic.
pub(super) struct Convolution {
    /// Number of points along x and y.
    points: [usize; 2],
    /// Forward and backward, along x and y.
    transforms: [[Arc<dyn Fft<f64>>; 2]; 2],
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
        Convolution { points, transforms }
    }

    /// The sum of the light of slices, each given on the grid as that of points at the depth of the slice;
    /// `frequency` is the spatial frequency in the particle's space (cycles/um) of a wave with these cycles
    /// per grid along x and y.
    pub(super) fn sum(
        &self,
        slices: &[Slice],
        lights: &[Vec<f64>],
        frequency: impl Fn([f64; 2]) -> f64,
    ) -> Vec<f64> {
        let [columns, rows] = self.points;
        let cycles = |i: usize, n: usize| i as f64 - if 2 * i > n { n as f64 } else { 0.0 };
        let frequencies: Vec<f64> = (0..columns * rows)
            .map(|at| frequency([cycles(at % columns, columns), cycles(at / columns, rows)]))
            .collect();
        let highest = frequencies.iter().copied().fold(f64::MIN_POSITIVE, f64::max);
        let mut sum = vec![Complex::default(); columns * rows];
        // Two real grids are the real and the imaginary part of one: shapes are even, so their products with
        // the spectra of both parts come from that of the whole and its mirror image.
        for (pair, lights) in slices.chunks(2).zip(lights.chunks(2)) {
            let mut both: Vec<Complex<f64>> = match lights {
                [a, b] => a.iter().zip(b).map(|(a, b)| Complex::new(*a, *b)).collect(),
                [a, ..] => a.iter().map(|a| Complex::new(*a, 0.0)).collect(),
                [] => break,
            };
            self.transform(&mut both, 0);
            let shapes: Vec<Vec<f64>> = pair.iter().map(|slice| slice.spectra(highest)).collect();
            let last = shapes.len() - 1;
            for (at, sum) in sum.iter_mut().enumerate() {
                let mirrored = (rows - at / columns) % rows * columns + (columns - at % columns) % columns;
                let (z, m) = (both[at], both[mirrored].conj());
                let place = frequencies[at] / highest * SPECTRA as f64;
                let cell = place as usize;
                let shape =
                    |table: &[f64]| table[cell] + (place - cell as f64) * (table[cell + 1] - table[cell]);
                let (first, second) = (shape(&shapes[0]), shape(&shapes[last]));
                *sum += 0.5 * ((z + m) * first + (z - m) * second);
            }
        }
        self.transform(&mut sum, 1);
        let scale = 1.0 / (columns * rows) as f64;
        sum.iter().map(|z| (z.re + z.im) * scale).collect()
    }

    fn transform(&self, grid: &mut Vec<Complex<f64>>, direction: usize) {
        let [columns, rows] = self.points;
        self.transforms[0][direction].process(grid);
        let mut turned = transposed(grid, columns, rows);
        self.transforms[1][direction].process(&mut turned);
        *grid = transposed(&turned, rows, columns);
    }
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

    /// Total, mean depth and mean square distance from the axis are those of a hemisphere and of a ball.
    #[test]
    fn moments_are_those_of_the_solid() {
        for (emission, depth, across) in [(Emission::Surface, -1.0, 8.0 / 3.0), (Emission::Volume, 0.0, 1.6)]
        {
            let slices = slices(emission, 2.0, 0.6, 2e-3);
            let sum =
                |f: fn(&Slice) -> f64| -> f64 { slices.iter().map(|slice| slice.weight * f(slice)).sum() };
            assert!((sum(|_| 1.0) - 1.0).abs() < 1e-13);
            assert!((sum(|slice| slice.depth_um) - depth).abs() < 1e-13);
            let square =
                |slice: &Slice| slice.radius_um * slice.radius_um * if slice.is_disc { 0.5 } else { 1.0 };
            assert!((sum(square) - across).abs() < 0.05, "{emission:?} {}", sum(square));
        }
    }

    /// Convolved with their shapes, slices of a spot have the sum of its light, and are as much wider as the
    /// shapes are.
    #[test]
    fn convolution_conserves_light_and_adds_variances() {
        let (n, step) = (odd_and_smooth(100), 0.25);
        assert_eq!(n, 105);
        let slices = slices(Emission::Volume, 2.0, 1.2, 2e-3);
        let at = |i: usize| (i as f64 - (n / 2) as f64) * step;
        let spot: Vec<f64> = (0..n * n)
            .map(|i| libm::exp(-0.5 * (at(i % n) * at(i % n) + at(i / n) * at(i / n)) / 0.64))
            .collect();
        let lights: Vec<Vec<f64>> =
            slices.iter().map(|slice| spot.iter().map(|v| slice.weight * v).collect()).collect();
        let period = n as f64 * step;
        let seen = Convolution::new([n, n]).sum(&slices, &lights, |[x, y]| libm::hypot(x, y) / period);
        let total: f64 = seen.iter().sum();
        assert!((total / spot.iter().sum::<f64>() - 1.0).abs() < 1e-9);
        let variance = seen.iter().enumerate().map(|(i, v)| v * at(i % n) * at(i % n)).sum::<f64>() / total;
        // A ball of radius 2: 4/5.
        assert!((variance - 0.64 - 0.8).abs() < 1e-3, "{variance}");
    }
}
