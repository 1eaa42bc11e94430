//! The inner loops of Gaussian spots: erf at the edges of pixels, and sums of outer products, many numbers at a time.
//!
//! Only + - * / sqrt, floor and comparisons occur, each correctly rounded and never fused, so that every instruction set gives
//! the same bits.

use super::gaussian::Look;
use super::patch::Window;
use crate::particle::Particle;

/// Edges of pixels taken in one stroke: one or more registers of every instruction set.
const LANES: usize = 8;

/// Pixels between them.
const PIXELS: usize = LANES - 1;

/// A band of the sensor's rows, and the particles whose light falls on it or elsewhere.
pub(super) struct Band<'a> {
    pub(super) particles: &'a [Particle],
    pub(super) look: Look,
    /// How far any of them reaches, px.
    pub(super) farthest: f64,
    /// Width and height of the whole sensor, px.
    pub(super) sensor: (u32, u32),
    /// The first row of the band, from 0.
    pub(super) first: usize,
    /// The band's pixels, row by row.
    pub(super) pixels: &'a mut [f64],
}

impl pulp::WithSimd for Band<'_> {
    type Output = ();

    // Inlined, with all that it calls, into a function for which the instruction set is switched on.
    #[inline(always)]
    fn with_simd<S: pulp::Simd>(self, _: S) {
        let width = self.sensor.0 as usize;
        let end = self.first + self.pixels.len() / width;
        // Pixel row k, from 0, covers k + 0.5 to k + 1.5.
        let (above, below) = (self.first as f64 + 0.5 - self.farthest, end as f64 + 0.5 + self.farthest);
        let mut down = Vec::new();
        for particle in self.particles {
            if particle.y_px < above || particle.y_px > below {
                continue;
            }
            let reach = self.look.reach_px(particle);
            let window = Window::around(particle.x_px, particle.y_px, (reach, reach), self.sensor);
            let top = (window.y0 as usize).saturating_sub(1).max(self.first);
            let bottom = (window.y0 as usize + window.height).saturating_sub(1).min(end);
            if window.area() == 0 || top >= bottom {
                continue;
            }
            let (spot, peak) = (Profile::new(self.look.diameter_px(particle)), self.look.peak(particle));
            down.clear();
            for row in (top..bottom).step_by(PIXELS) {
                down.extend(spot.over_pixels(row, particle.y_px)[..PIXELS].iter().map(|share| share * peak));
            }
            let left = window.x0 as usize - 1;
            for column in (left..left + window.width).step_by(PIXELS) {
                let across = spot.over_pixels(column, particle.x_px);
                let rows = self.pixels[(top - self.first) * width..(bottom - self.first) * width]
                    .chunks_exact_mut(width);
                for (row, light) in rows.zip(&down) {
                    add(&mut row[column..], across, *light);
                }
            }
        }
    }
}

/// Adds a profile times `light` to the first pixels of a row, as many as there are.
#[inline(always)]
fn add(pixels: &mut [f64], profile: [f64; LANES], light: f64) {
    if let Some(pixels) = pixels.first_chunk_mut::<LANES>() {
        // A copy that nothing else can refer to is added in one register.
        let before = *pixels;
        *pixels = std::array::from_fn(|i| before[i] + light * profile[i]);
    } else {
        for (pixel, share) in pixels.iter_mut().zip(profile) {
            *pixel += light * share;
        }
    }
}

/// A Gaussian along one axis.
#[derive(Clone, Copy)]
struct Profile {
    /// 1 / (sigma sqrt(2)) = 2 sqrt(2) / d, 1/px.
    per_px: f64,
    /// sigma sqrt(pi / 2), px: the integral of exp(-x^2 / (2 sigma^2)) is this times a difference of erf.
    scale: f64,
}

impl Profile {
    #[inline(always)]
    fn new(diameter_px: f64) -> Self {
        const SQRT_HALF_PI: f64 = 1.253_314_137_315_500_3;
        Profile {
            per_px: 2.0 * std::f64::consts::SQRT_2 / diameter_px,
            scale: diameter_px / 4.0 * SQRT_HALF_PI,
        }
    }

    /// Its integrals over pixels `first` (from 0) and on, and a zero.
    #[inline(always)]
    fn over_pixels(self, first: usize, centre: f64) -> [f64; LANES] {
        let start = first as f64 + 0.5 - centre;
        let edges: [f64; LANES] = std::array::from_fn(|i| erf((start + i as f64) * self.per_px));
        // A difference of two errors of `erf` could be below zero.
        std::array::from_fn(|i| ((edges[(i + 1).min(PIXELS)] - edges[i]) * self.scale).max(0.0))
    }
}

/// The error function to 6e-12, without branches.
///
/// x P(x^2) / Q(x^2) on [-5, 5], beyond which erf is 1 to 2e-12; the coefficients are a least-squares fit with Lawson's
/// weights, which spreads the error evenly.
#[inline(always)]
fn erf(x: f64) -> f64 {
    const P: [f64; 9] = [
        1.128_379_167_139_567_3,
        0.210_763_988_799_959_56,
        0.062_031_447_239_915_31,
        0.005_844_016_030_608_227,
        0.000_661_520_394_858_917_8,
        3.413_440_555_596_967e-5,
        1.773_367_749_723_878_2e-6,
        2.581_473_667_088_187_6e-8,
        3.164_731_860_196_473e-11,
    ];
    const Q: [f64; 9] = [
        1.0,
        0.520_118_055_963_495_8,
        0.128_346_618_824_659_92,
        0.019_759_064_121_480_863,
        0.002_092_058_428_141_986_6,
        0.000_157_217_486_932_623_78,
        8.199_992_650_802_765e-6,
        2.702_396_691_450_951_4e-7,
        1.382_800_186_784_111_7e-9,
    ];
    let x = x.clamp(-5.0, 5.0);
    let u = x * x;
    let horner = |c: [f64; 9]| {
        (((((((c[8] * u + c[7]) * u + c[6]) * u + c[5]) * u + c[4]) * u + c[3]) * u + c[2]) * u + c[1]) * u
            + c[0]
    };
    x * horner(P) / horner(Q)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn erf_agrees_with_libm() {
        for step in -60_000..=60_000 {
            let x = f64::from(step) * 1e-4;
            // The fit's own error is 4.1e-12; beyond 5 that of taking 1 adds 1.5e-12.
            assert!((erf(x) - libm::erf(x)).abs() < 6e-12, "{x}: {} {}", erf(x), libm::erf(x));
        }
        assert_eq!((erf(f64::INFINITY), erf(-1e300)), (erf(5.0), erf(-5.0)));
    }
}
