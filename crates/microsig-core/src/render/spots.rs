//! The inner loops of Gaussian spots: erf at the edges of pixels, and the sum of outer products, many numbers at a time.
//!
//! Only + - * / and comparisons occur, never fused, so that every instruction set gives the same bits.

use super::patch::Window;

/// Pixels of a row added in one stroke: one or more registers of every instruction set.
const LANES: usize = 8;

/// Spots with their profiles along columns and rows.
#[derive(Debug, Default)]
pub(super) struct Spots {
    places: Vec<Place>,
    /// First the edges of pixels in units of sigma sqrt(2), then erf there.
    values: Vec<f64>,
}

/// Where a spot lies on the sensor, and where its profiles lie in `values`.
#[derive(Debug)]
struct Place {
    column: usize,
    columns: usize,
    row: usize,
    rows: usize,
    /// The profile along columns begins here, that along rows after it.
    at: usize,
    /// sigma sqrt(pi / 2), px: the integral of the profile is this times a difference of erf.
    scale: f64,
    peak: f64,
}

impl Spots {
    /// Adds a spot of `peak` counts at (x, y) px, on the pixels of a window.
    pub(super) fn push(
        &mut self,
        window: &Window,
        sensor_width: u32,
        (x_px, y_px): (f64, f64),
        diameter_px: f64,
        peak: f64,
    ) {
        let (mut column, mut columns) = (window.x0 as usize - 1, window.width);
        // Widened to full strokes where the sensor has room for them.
        let (wide, room) = (columns.next_multiple_of(LANES), sensor_width as usize);
        if wide <= room {
            (column, columns) = (column.min(room - wide), wide);
        }
        let (row, rows) = (window.y0 as usize - 1, window.height);
        self.places.push(Place {
            column,
            columns,
            row,
            rows,
            at: self.values.len(),
            scale: diameter_px / 4.0 * SQRT_HALF_PI,
            peak,
        });
        // sigma sqrt(2) = d / (2 sqrt(2)).
        let per_px = 2.0 * std::f64::consts::SQRT_2 / diameter_px;
        for (first, n, centre) in [(column, columns, x_px), (row, rows, y_px)] {
            let start = first as f64 + 0.5 - centre;
            self.values.extend((0..=n).map(|i| (start + i as f64) * per_px));
        }
    }
}

const SQRT_HALF_PI: f64 = 1.253_314_137_315_500_3;

/// Takes erf of all edges and makes profiles of the differences.
pub(super) fn erf_all(arch: pulp::Arch, spots: &mut Spots) {
    arch.dispatch(Profiles(spots));
}

struct Profiles<'a>(&'a mut Spots);

impl pulp::WithSimd for Profiles<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: pulp::Simd>(self, _: S) {
        let Spots { places, values } = self.0;
        for value in values.iter_mut() {
            *value = erf(*value);
        }
        for place in places {
            let (across, down) =
                values[place.at..][..place.columns + place.rows + 2].split_at_mut(place.columns + 1);
            // A difference of two errors of `erf` could be below zero.
            for (profile, scale) in [(across, place.scale), (down, place.scale * place.peak)] {
                for i in 0..profile.len() - 1 {
                    profile[i] = ((profile[i + 1] - profile[i]) * scale).max(0.0);
                }
            }
        }
    }
}

/// Adds spots to a band of the sensor's rows, from row `first` (from 0) on.
pub(super) fn add(arch: pulp::Arch, spots: &Spots, width: usize, first: usize, pixels: &mut [f64]) {
    arch.dispatch(Add { spots, width, first, pixels });
}

struct Add<'a> {
    spots: &'a Spots,
    width: usize,
    first: usize,
    pixels: &'a mut [f64],
}

impl pulp::WithSimd for Add<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: pulp::Simd>(self, _: S) {
        let Add { spots, width, first, pixels } = self;
        let end = first + pixels.len() / width;
        for place in &spots.places {
            let (top, bottom) = (place.row.max(first), (place.row + place.rows).min(end));
            if top >= bottom {
                continue;
            }
            let across = &spots.values[place.at..][..place.columns];
            let down = &spots.values[place.at + place.columns + 1..][..place.rows];
            for row in top..bottom {
                let light = down[row - place.row];
                let line = &mut pixels[(row - first) * width + place.column..][..place.columns];
                let (strokes, rest) = line.as_chunks_mut::<LANES>();
                let (profiles, last) = across.as_chunks::<LANES>();
                for (pixels, profile) in strokes.iter_mut().zip(profiles) {
                    for i in 0..LANES {
                        pixels[i] += light * profile[i];
                    }
                }
                for (pixel, profile) in rest.iter_mut().zip(last) {
                    *pixel += light * profile;
                }
            }
        }
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
