//! Converts light on a grid to the coefficients of a spline through the light on square pixels.
//!
//! Light is band-limited: intensities have no frequencies above 2 sigma_a / (lambda B). A grid that resolves
//! this band determines its Fourier series. Integration over a pixel multiplies it by sinc f, and the
//! least-squares quintic spline (an orthogonal projection) and a Gaussian blur by others. All of this is one matrix for
//! each axis. Light is assumed to be even about the particle where the pupil has mirror symmetry and, a few
//! px beyond the edge, periodic.

use super::matrix::{self, LANES, Panels};
use crate::render::instructions::InstructionSet;

/// The matrix of one axis, from `grid` values to `nodes` coefficients.
#[derive(Debug, Clone)]
pub(super) struct Axis {
    grid: usize,
    nodes: usize,
    /// The matrix, [nodes x grid].
    #[cfg(test)]
    by_node: Vec<f64>,
    /// The same in f32, and its transpose with rows of `wide` numbers.
    down: Vec<f32>,
    across: Panels<f32>,
    wide: usize,
}

impl Axis {
    fn new(grid: usize, by_node: Vec<f64>) -> Axis {
        let nodes = by_node.len() / grid;
        let wide = nodes.next_multiple_of(LANES);
        let mut across = Panels::zeros(grid, wide);
        for (node, row) in by_node.chunks_exact(grid).enumerate() {
            for (j, value) in row.iter().enumerate() {
                across.set(j, node, *value as f32);
            }
        }
        let down = by_node.iter().map(|value| *value as f32).collect();
        Axis {
            grid,
            nodes,
            down,
            across,
            wide,
            #[cfg(test)]
            by_node,
        }
    }

    /// From values at k `step_px`, k < `grid`, to coefficients at k / `per_px`, k < `nodes`, for light that
    /// is even about the particle.
    pub(super) fn even(grid: usize, step_px: f64, blur_px: f64, nodes: usize, per_px: usize) -> Axis {
        Axis::mirrored(&Waves::at_nodes(grid, step_px, blur_px, nodes, per_px))
    }

    /// From the same values to the light on pixels at given positions (px from the particle), without a
    /// spline.
    pub(super) fn even_at(grid: usize, step_px: f64, blur_px: f64, places_px: &[f64]) -> Axis {
        Axis::mirrored(&Waves::at_places(grid, step_px, blur_px, places_px))
    }

    fn mirrored(waves: &Waves) -> Axis {
        let mut by_node = waves.sums(libm::cos);
        // A value also represents its mirror image.
        by_node.chunks_exact_mut(waves.grid).for_each(|row| row[1..].iter_mut().for_each(|w| *w *= 2.0));
        Axis::new(waves.grid, by_node)
    }

    /// [`Axis::even_at`] for values on both sides of the particle, without symmetry.
    pub(super) fn both_at(grid: usize, step_px: f64, blur_px: f64, places_px: &[f64]) -> Axis {
        let waves = Waves::at_places(grid, step_px, blur_px, places_px);
        let (even, odd) = (waves.sums(libm::cos), waves.sums(libm::sin));
        let columns = 2 * grid - 1;
        let by_node = (0..places_px.len() * columns).map(|at| {
            let j = (at % columns) as isize - (grid as isize - 1);
            let place = at / columns * grid + j.unsigned_abs();
            even[place] + if j < 0 { -odd[place] } else { odd[place] }
        });
        Axis::new(columns, by_node.collect())
    }

    /// [`Axis::even`] without symmetry: from values at k `step_px`, |k| < `grid`, to coefficients at k /
    /// `per_px`, |k| < `nodes`.
    pub(super) fn both(grid: usize, step_px: f64, blur_px: f64, nodes: usize, per_px: usize) -> Axis {
        let waves = Waves::at_nodes(grid, step_px, blur_px, nodes, per_px);
        let (even, odd) = (waves.sums(libm::cos), waves.sums(libm::sin));
        let (columns, rows) = (2 * grid - 1, 2 * nodes - 1);
        let by_node = (0..rows * columns).map(|at| {
            let (node, j) = (
                (at / columns) as isize - (nodes as isize - 1),
                (at % columns) as isize - (grid as isize - 1),
            );
            let place = node.unsigned_abs() * grid + j.unsigned_abs();
            // cos (a - b) = cos a cos b + sin a sin b
            even[place] + if (node < 0) == (j < 0) { odd[place] } else { -odd[place] }
        });
        Axis::new(columns, by_node.collect())
    }
}

/// Positions on an axis, with the parameters of the grid.
struct Waves {
    grid: usize,
    step_px: f64,
    /// Standard deviation of a Gaussian blur, px.
    blur_px: f64,
    places_px: Vec<f64>,
    /// Nodes per px of the spline; `None`: light on pixels, without a spline.
    per_px: Option<usize>,
}

impl Waves {
    /// The nodes of a spline on one side.
    fn at_nodes(grid: usize, step_px: f64, blur_px: f64, nodes: usize, per_px: usize) -> Waves {
        let places_px = (0..nodes).map(|i| i as f64 / per_px as f64).collect();
        Waves { grid, step_px, blur_px, places_px, per_px: Some(per_px) }
    }

    fn at_places(grid: usize, step_px: f64, blur_px: f64, places_px: &[f64]) -> Waves {
        Waves { grid, step_px, blur_px, places_px: places_px.to_vec(), per_px: None }
    }

    /// Sums over all frequencies, with the factors of pixels and spline, of cosines (or sines) at the
    /// positions times those on the grid: [places x grid].
    fn sums(&self, wave: fn(f64) -> f64) -> Vec<f64> {
        let Waves { grid, step_px, blur_px, per_px, ref places_px } = *self;
        // One period, which covers both sides, is an odd number of steps.
        let n = 2 * grid - 1;
        let frequency = |k: usize| k as f64 / (n as f64 * step_px);
        let wide = grid.next_multiple_of(LANES);
        let mut at_grid = Panels::zeros(grid, wide);
        for k in 0..grid {
            // Includes negative frequencies.
            let twice = if k == 0 { 1.0 } else { 2.0 };
            let spline = per_px.map_or(1.0, |per_px| nearest(frequency(k) / per_px as f64));
            let factor = sinc(frequency(k)) * gaussian(blur_px, frequency(k)) * spline * twice / n as f64;
            for j in 0..grid {
                // Reduces large angles by whole turns.
                let angle = ((k * j) % n) as f64 / n as f64;
                at_grid.set(k, j, factor * wave(2.0 * std::f64::consts::PI * angle));
            }
        }
        let at_places: Vec<f64> = places_px
            .iter()
            .flat_map(|place| (0..grid).map(move |k| (place, k)))
            .map(|(place, k)| wave(2.0 * std::f64::consts::PI * frequency(k) * place))
            .collect();
        let mut padded = vec![0.0; places_px.len() * wide];
        matrix::multiply(InstructionSet::best(), &at_places, &at_grid, &mut padded);
        padded.chunks_exact(wide).flat_map(|row| row[..grid].iter().copied()).collect()
    }
}

/// Coefficients, row by row, from light on a grid with rows of `stride` numbers.
pub(super) fn expose(
    light: &[f64],
    stride: usize,
    [across, down]: [&Axis; 2],
    instructions: InstructionSet,
) -> Vec<f64> {
    let light = light.chunks_exact(stride).take(down.grid);
    let light: Vec<f32> = light.flat_map(|row| &row[..across.grid]).map(|value| *value as f32).collect();
    let mut rows = Panels::zeros(down.grid, across.wide);
    matrix::multiply_to_panels(instructions, &light, &across.across, &mut rows);
    let mut coefficients = vec![0.0; down.nodes * across.wide];
    matrix::multiply(instructions, &down.down, &rows, &mut coefficients);
    let rows = coefficients.chunks_exact(across.wide);
    rows.flat_map(|row| &row[..across.nodes]).map(|value| f64::from(*value)).collect()
}

/// The factor of a Gaussian blur of this standard deviation (px) for a wave of this frequency (1/px).
fn gaussian(blur_px: f64, f: f64) -> f64 {
    let angle = 2.0 * std::f64::consts::PI * blur_px * f;
    libm::exp(-0.5 * angle * angle)
}

fn sinc(f: f64) -> f64 {
    let angle = std::f64::consts::PI * f;
    if angle.abs() < 1e-9 { 1.0 } else { libm::sin(angle) / angle }
}

/// The factor of the least-squares quintic spline for a wave of this frequency (cycles per node).
fn nearest(f: f64) -> f64 {
    let shape = |f: f64| {
        let s = sinc(f);
        let s3 = s * s * s;
        s3 * s3
    };
    let all: f64 = (-8..=8).map(|i| shape(f + f64::from(i))).map(|s| s * s).sum();
    shape(f) / all
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bspline;

    /// Without a spline, the light on a pixel is exact for any wave within the band.
    #[test]
    fn a_wave_is_seen_exactly_at_any_place() {
        let (grid, step) = (60, 0.45);
        let period = (2 * grid - 1) as f64 * step;
        let places = [-7.3, 0.0, 0.1, 3.37, 9.9];
        for cycles in [0.0, 5.0, 20.0, 30.0] {
            let f = cycles / period;
            let angle = |x: f64| 2.0 * std::f64::consts::PI * f * x;
            let value = |axis: &Axis, i: usize, light: &dyn Fn(isize) -> f64, first: isize| -> f64 {
                let row = &axis.by_node[i * axis.grid..][..axis.grid];
                row.iter().enumerate().map(|(j, w)| w * light(j as isize + first)).sum()
            };
            let (even, both) =
                (Axis::even_at(grid, step, 0.0, &places), Axis::both_at(grid, step, 0.0, &places));
            for (i, x) in places.iter().enumerate() {
                let found = value(&even, i, &|j| libm::cos(angle(j as f64 * step)), 0);
                assert!((found - sinc(f) * libm::cos(angle(*x))).abs() < 1e-10, "{cycles} {x}: {found}");
                let shifted = |x: f64| libm::cos(angle(x) + 0.4);
                let found = value(&both, i, &|j| shifted(j as f64 * step), 1 - grid as isize);
                assert!((found - sinc(f) * shifted(*x)).abs() < 1e-10, "{cycles} {x}: {found}");
            }
        }
    }

    /// For a wave within the band, the spline gives the light on a pixel.
    #[test]
    fn a_wave_is_seen_through_a_pixel() {
        let (grid, step, per_px) = (60, 0.45, 2);
        let period = (2 * grid - 1) as f64 * step;
        // The error of the spline grows with the sixth power of the frequency.
        for (cycles, tolerance) in [(0.0, 1e-10), (5.0, 1e-7), (20.0, 3e-4), (30.0, 4e-3)] {
            let f = cycles / period;
            let wave = |x: f64| libm::cos(2.0 * std::f64::consts::PI * f * x);
            let axis = Axis::even(grid, step, 0.0, 40, per_px);
            let coefficients: Vec<f64> = axis
                .by_node
                .chunks_exact(grid)
                .map(|row| row.iter().enumerate().map(|(j, w)| w * wave(j as f64 * step)).sum())
                .collect();
            for x in [0.0, 0.1, 3.37, 9.9] {
                let place = x * f64::from(per_px as u32);
                let cell = libm::floor(place);
                let (weights, _) = bspline::quintic(place - cell);
                let value: f64 = weights
                    .iter()
                    .enumerate()
                    .map(|(i, w)| w * coefficients[(cell as isize + i as isize - 2).unsigned_abs()])
                    .sum();
                let expected = sinc(f) * wave(x);
                assert!(
                    (value - expected).abs() < tolerance,
                    "{cycles} cycles at {x}: {value}, not {expected}"
                );
            }
        }
    }
}
