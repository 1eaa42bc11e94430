//! Spacings of tables: planes in depth and radii of spheres are added until interpolation between them is
//! accurate enough.
//!
//! Between planes, a cubic spline interpolates in depth. Its coefficients follow from the planes by a short
//! filter, so that planes can be computed, filtered and stored one after the other.

use rayon::prelude::*;

use super::spline;

/// What one table covers.
#[derive(Debug, Clone, Copy)]
pub struct TableSpan {
    /// The range of depths, um.
    pub(super) start_um: f64,
    pub(super) length_um: f64,
    /// The smallest and the largest radius of its spheres, um; one size if they are equal.
    pub(super) radii: [f64; 2],
}

impl TableSpan {
    /// A single depth and radius, um.
    pub(super) fn single(z_um: f64, radius_um: f64) -> Self {
        TableSpan { start_um: z_um, length_um: 0.0, radii: [radius_um; 2] }
    }

    /// The middle of the range of depths, um.
    pub(super) fn middle_um(&self) -> f64 {
        self.start_um + 0.5 * self.length_um
    }
}

/// Number of additional planes that the spline in depth needs before and after the range.
pub(super) const AROUND: usize = 3;

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

/// Initial number of radii of a table for a range of sizes, and the largest.
const RADII: usize = 4;
const MOST_RADII: usize = 8;

/// Equidistant depths of planes: the range and [`AROUND`] planes before and after it.
#[derive(Debug, Clone, Copy)]
pub(super) struct PlaneDepths {
    pub(super) start_um: f64,
    pub(super) length_um: f64,
    /// Number of steps over the range.
    pub(super) steps: usize,
}

impl PlaneDepths {
    pub(super) fn step_um(self) -> f64 {
        self.length_um / self.steps as f64
    }

    /// The depth of a plane, um; half-integers are midway between planes.
    pub(super) fn at(self, plane: f64) -> f64 {
        self.start_um + (plane - AROUND as f64) * self.step_um()
    }

    /// Number of planes, including those outside the range.
    pub(super) fn planes(self) -> usize {
        self.steps + 1 + 2 * AROUND
    }

    /// The planes that `sample` gives for each depth (um).
    pub(super) fn sample<T: Send>(self, sample: impl Fn(f64) -> T + Sync) -> Vec<T> {
        (0..self.planes()).into_par_iter().map(|i| sample(self.at(i as f64))).collect()
    }
}

/// How accurate interpolation has to be.
pub(super) struct Refinement {
    /// The deviation of an interpolated image (first) from the computed one, relative to the peak.
    pub(super) deviation: fn(&[f64], &[f64]) -> f64,
    /// The largest allowed deviation.
    pub(super) allowed: f64,
    /// Largest number of steps over the range of depths.
    pub(super) most_steps: usize,
}

impl Refinement {
    /// The planes of spheres of all radii of a span, refined in depth, from planes of the smallest (`first`),
    /// and in radius. `sample` gives the plane at a depth and of a radius (um).
    pub(super) fn table(
        &self,
        span: TableSpan,
        steps: usize,
        first: Option<Vec<Vec<f64>>>,
        sample: impl Fn(f64, f64) -> Vec<f64> + Sync,
    ) -> RefinedPlanes {
        let depths = PlaneDepths { start_um: span.start_um, length_um: span.length_um, steps };
        let smallest_sphere = |z_um: f64| sample(z_um, span.radii[0]);
        let first = first.unwrap_or_else(|| depths.sample(smallest_sphere));
        let (depths, mut planes, error) = self.planes(depths, first, smallest_sphere);
        let radii = self.radii(span.radii, |radius| sample(span.middle_um(), radius));
        for &radius in &radii[1..] {
            planes.extend(depths.sample(|z_um| sample(z_um, radius)));
        }
        RefinedPlanes { depths, radii, planes, error }
    }

    /// Adds planes midway between those given until the spline through them is accurate there, and returns
    /// its deviation, too. `sample` gives the plane at a depth (um).
    fn planes(
        &self,
        mut depths: PlaneDepths,
        mut planes: Vec<Vec<f64>>,
        sample: impl Fn(f64) -> Vec<f64> + Sync,
    ) -> (PlaneDepths, Vec<Vec<f64>>, f64) {
        let mut error_before = f64::INFINITY;
        loop {
            let steps = depths.steps;
            let error = [0, steps / 2, steps - 1]
                .into_par_iter()
                .map(|i| {
                    let between = sample(depths.at((i + AROUND) as f64 + 0.5));
                    (self.deviation)(&blend(MIDWAY.into_iter().zip(&planes[i..i + 8])), &between)
                })
                .reduce(|| 0.0, f64::max);
            // If finer steps do not reduce the error, it has another cause.
            let helped = error < 0.6 * error_before;
            if error <= self.allowed || steps >= self.most_steps || !helped {
                return (depths, planes, error);
            }
            error_before = error;
            // Some of the outermost planes are no longer needed.
            let old = planes;
            depths.steps *= 2;
            planes = (0..depths.planes())
                .into_par_iter()
                .map(|i| {
                    let from_start = i as isize - AROUND as isize;
                    if from_start % 2 == 0 {
                        old[(from_start / 2 + AROUND as isize) as usize].clone()
                    } else {
                        sample(depths.at(i as f64))
                    }
                })
                .collect();
        }
    }

    /// The radii at which spheres are computed, um: one, or as many as interpolation between them needs.
    /// `sample` gives the plane of a radius (um).
    fn radii(&self, [small, large]: [f64; 2], sample: impl Fn(f64) -> Vec<f64> + Sync) -> Vec<f64> {
        if small == large {
            return vec![small];
        }
        let mut count = RADII;
        loop {
            let radii = chebyshev_points(small, large, count);
            let known: Vec<Vec<f64>> = radii.par_iter().map(|&radius| sample(radius)).collect();
            let between: Vec<f64> = radii.windows(2).map(|pair| 0.5 * (pair[0] + pair[1])).collect();
            let error = between
                .par_iter()
                .map(|&radius| {
                    let weights = spline::lagrange(&radii, radius);
                    let ours = blend(weights.iter().map(|w| w.0).zip(&known));
                    (self.deviation)(&ours, &sample(radius))
                })
                .reduce(|| 0.0, f64::max);
            if error <= self.allowed || count >= MOST_RADII {
                return radii;
            }
            count += 1;
        }
    }
}

pub(super) struct RefinedPlanes {
    pub(super) depths: PlaneDepths,
    /// Radii of the spheres, um.
    pub(super) radii: Vec<f64>,
    /// By radius, then by depth.
    pub(super) planes: Vec<Vec<f64>>,
    /// Deviation of the spline in depth.
    pub(super) error: f64,
}

pub(super) fn peak(values: &[f64]) -> f64 {
    values.iter().copied().fold(f64::MIN_POSITIVE, f64::max)
}

/// The coefficients of the spline in depth at the middle one of five planes.
pub(super) fn filtered(five: &[Vec<f64>]) -> Vec<f64> {
    blend(FILTER.into_iter().zip(five))
}

/// The weighted sum of planes.
pub(super) fn blend<'a>(planes: impl Iterator<Item = (f64, &'a Vec<f64>)>) -> Vec<f64> {
    let mut sum = Vec::new();
    for (weight, plane) in planes {
        sum.resize(plane.len(), 0.0);
        sum.iter_mut().zip(plane).for_each(|(s, v)| *s += weight * v);
    }
    sum
}

/// `n` Chebyshev points, including both ends.
fn chebyshev_points(small: f64, large: f64, n: usize) -> Vec<f64> {
    let (middle, half) = (0.5 * (small + large), 0.5 * (large - small));
    let angle = |i: usize| std::f64::consts::PI * i as f64 / (n - 1) as f64;
    (0..n).map(|i| middle - half * libm::cos(angle(i))).collect()
}
