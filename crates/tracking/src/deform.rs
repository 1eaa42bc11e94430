//! Image deformation by the displacements found in the previous correlation pass.
//!
//! Particle images of 3 px are hardly larger than the pixels that sample them, so an interpolation that
//! attenuates the highest wavenumbers shifts them by too little: a cubic spline by 0.006 px too little for a
//! shift of 0.25 px, which biases displacements near half a pixel by twice as much. Splines of higher degree
//! are closer to the ideal interpolation (Astarita & Cardone 2005, Exp. Fluids 38, 233), at the cost of more
//! coefficients for each pixel.

use std::sync::OnceLock;

use rayon::prelude::*;

use super::gray_image::{CUBIC, GrayImage, mirrored, prefiltered};

/// Poles of the filter that makes the coefficients of a septic spline (Unser 1999, IEEE Signal Process. Mag.
/// 16(6), 22).
const SEPTIC: [f64; 3] = [-0.535_280_430_796_438_2, -0.122_554_615_192_326_69, -0.009_148_694_809_608_277];

/// Degree of the interpolation.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Degree {
    Cubic,
    Septic,
}

/// A pair of images, and the coefficients of their cubic splines once they are needed.
pub(super) struct Deformable<'a> {
    pub(super) images: [&'a GrayImage; 2],
    cubic: OnceLock<[GrayImage; 2]>,
}

impl<'a> Deformable<'a> {
    pub(super) fn new(a: &'a GrayImage, b: &'a GrayImage) -> Self {
        Deformable { images: [a, b], cubic: OnceLock::new() }
    }

    /// Both images, displaced by minus and plus half of a displacement at every pixel, px: `displacement` writes it for
    /// a row.
    pub(super) fn deformed(
        &self,
        degree: Degree,
        displacement: impl Fn(f32, &mut [[f32; 2]]) + Sync,
    ) -> [GrayImage; 2] {
        let splines = |poles: &[f64]| self.images.map(|image| prefiltered(image, poles));
        match degree {
            Degree::Cubic => resampled::<4>(self.cubic.get_or_init(|| splines(&CUBIC)), displacement),
            Degree::Septic => resampled::<8>(&splines(&SEPTIC), displacement),
        }
    }
}

fn resampled<const TAPS: usize>(
    splines: &[GrayImage; 2],
    displacement: impl Fn(f32, &mut [[f32; 2]]) + Sync,
) -> [GrayImage; 2] {
    let weights = Weights::<TAPS>::new();
    let (width, height) = (splines[0].width, splines[0].height);
    let mut deformed = [0; 2].map(|_| GrayImage { width, height, counts: vec![0.0; width * height] });
    let [a, b] = &mut deformed;
    let rows = a.counts.par_chunks_mut(width).zip(b.counts.par_chunks_mut(width)).enumerate();
    rows.for_each_init(
        || vec![[0.0; 2]; width],
        |moved, (y, (row_a, row_b))| {
            displacement(y as f32, moved);
            for (x, ((pixel_a, pixel_b), d)) in row_a.iter_mut().zip(row_b).zip(moved).enumerate() {
                // The preceding pixel of a position in the first image, and the distance from it.
                let back = d.map(|d| -0.5 * d);
                let whole = back.map(|back| back as isize - isize::from(back < (back as isize) as f32));
                let [wx, wy] = [0, 1].map(|axis| weights.at(back[axis] - whole[axis] as f32));
                let (x, y) = (x as isize, y as isize);
                *pixel_a = interpolated(&splines[0], [x + whole[0], y + whole[1]], (wx, wy));
                // In the second image it is as far before the next pixel.
                let reversed = |mut weights: [f32; TAPS]| {
                    weights.reverse();
                    weights
                };
                let weights = (reversed(wx), reversed(wy));
                *pixel_b = interpolated(&splines[1], [x - whole[0] - 1, y - whole[1] - 1], weights);
            }
        },
    );
    deformed
}

/// Weights of the coefficients around a position in a B-spline, as polynomials of the distance from the
/// preceding coefficient.
struct Weights<const TAPS: usize> {
    /// For each power, the factors of all coefficients.
    powers: [[f32; TAPS]; TAPS],
}

impl<const TAPS: usize> Weights<TAPS> {
    /// Recursion of Cox and de Boor.
    fn new() -> Self {
        let mut powers = [[0.0f64; TAPS]; TAPS];
        powers[0][0] = 1.0;
        for degree in 1..TAPS {
            let (lower, n) = (powers, degree as f64);
            for (i, k) in (0..=degree).flat_map(|i| (0..=degree).map(move |k| (i, k))) {
                let of = |i: usize, k: usize| if k < degree { lower[k][i] } else { 0.0 };
                // ((t + n - i) times the previous weight + (i + 1 - t) times its own) / n.
                let times = |i: usize, constant: f64, sign: f64| {
                    constant * of(i, k) + if k > 0 { sign * of(i, k - 1) } else { 0.0 }
                };
                let before = if i > 0 { times(i - 1, n - i as f64, 1.0) } else { 0.0 };
                let own = if i < degree { times(i, i as f64 + 1.0, -1.0) } else { 0.0 };
                powers[k][i] = (before + own) / n;
            }
        }
        Weights { powers: powers.map(|factors| factors.map(|f| f as f32)) }
    }

    fn at(&self, t: f32) -> [f32; TAPS] {
        self.powers
            .iter()
            .rev()
            .fold([0.0; TAPS], |sum, factors| std::array::from_fn(|i| sum[i] * t + factors[i]))
    }
}

/// The value of a spline with these coefficients, by the weights of those around a position beyond a pixel.
fn interpolated<const TAPS: usize>(
    coefficients: &GrayImage,
    pixel: [isize; 2],
    (wx, wy): ([f32; TAPS], [f32; TAPS]),
) -> f32 {
    let [left, top] = pixel.map(|at| at - (TAPS as isize / 2 - 1));
    let (width, height) = (coefficients.width, coefficients.height);
    let is_inside = left >= 0 && top >= 0 && left as usize + TAPS <= width && top as usize + TAPS <= height;
    let mut sums = [0.0f32; TAPS];
    if is_inside {
        let rows = coefficients.counts[top as usize * width + left as usize..].chunks(width);
        for (weight, row) in wy.into_iter().zip(rows) {
            sums.iter_mut().zip(&row[..TAPS]).for_each(|(sum, tap)| *sum += weight * tap);
        }
    } else {
        for (j, weight) in wy.into_iter().enumerate() {
            let row = mirrored(top + j as isize, height) * width;
            for (i, sum) in sums.iter_mut().enumerate() {
                *sum += weight * coefficients.counts[row + mirrored(left + i as isize, width)];
            }
        }
    }
    sums.iter().zip(wx).map(|(sum, weight)| sum * weight).sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn weights_are_those_of_splines_and_sum_to_one() {
        for t in [0.0, 0.3, 0.5, 0.97] {
            let (cubic, _) = microsig_core::bspline::cubic(f64::from(t));
            let weights = Weights::<4>::new().at(t);
            assert!(weights.iter().zip(cubic).all(|(w, c)| (f64::from(*w) - c).abs() < 1e-6), "{weights:?}");
            let weights = Weights::<8>::new().at(t);
            assert!((weights.iter().sum::<f32>() - 1.0).abs() < 1e-6 && weights.iter().all(|w| *w >= 0.0));
        }
        // At a node the central weight is 2416 / 5040 (Unser 1999).
        assert!((Weights::<8>::new().at(0.0)[3] - 2416.0 / 5040.0).abs() < 1e-7);
    }

    /// Without displacement pixels are unchanged, also at the edges; waves are displaced, of 3 px in
    /// length far better by a septic spline than by a cubic one.
    #[test]
    fn waves_are_displaced() {
        let wave = |length: f32| {
            move |x: f32, y: f32| {
                100.0 + 30.0 * (std::f32::consts::TAU * x / length).sin() * (0.35 * y + 1.0).cos()
            }
        };
        let error = |degree: Degree, length: f32| {
            let wave = wave(length);
            let image = GrayImage::from_fn((60, 40), |x, y| wave(x as f32, y as f32));
            let deformed =
                |by: [f32; 2]| Deformable::new(&image, &image).deformed(degree, |_, row| row.fill(by));
            let [a, b] = deformed([0.0; 2]);
            assert!(a == b && a.counts.iter().zip(&image.counts).all(|(a, b)| (a - b).abs() < 2e-3));
            let [a, b] = deformed([0.5, 0.0]);
            let mut worst = 0.0f32;
            for (x, y) in (15..45).flat_map(|x| (12..28).map(move |y| (x, y))) {
                let (i, x, y) = (y * 60 + x, x as f32, y as f32);
                worst = worst.max(
                    (a.counts[i] - wave(x - 0.25, y)).abs().max((b.counts[i] - wave(x + 0.25, y)).abs()),
                );
            }
            worst
        };
        assert!(error(Degree::Cubic, 12.0) < 0.05 && error(Degree::Septic, 12.0) < 0.01);
        let [cubic, septic] = [Degree::Cubic, Degree::Septic].map(|degree| error(degree, 3.0));
        assert!(cubic > 1.0 && septic < cubic / 4.0, "{cubic} {septic}");
    }
}
