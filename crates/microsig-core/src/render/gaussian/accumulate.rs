//! The inner loops of Gaussian spots, vectorized: erf at the pixel edges, and sums of outer products.
//!
//! Spots are summed in f32, with a relative error of 6e-8 of the light of a pixel. Only + - * / and
//! comparisons occur, each correctly rounded and never fused, so that every instruction set gives the same
//! bits.

use std::array::from_fn;

use super::footprint::{Footprint, Footprints, SHORT_TILE, TILE};
use crate::pool::{BufferPool, Pooled};

/// Number of pixel edges of a tile: a whole number of registers in every instruction set.
const LANES: usize = TILE + 1;

/// Columns of a panel. The band is summed in panels because rows with a compile-time stride need fewer bounds
/// checks.
const PANEL: usize = 64;

/// Length of a row of a panel; a tile may start at its last column.
const STRIDE: usize = PANEL + LANES;

/// Tiles whose profiles are computed together before they are added.
const BATCH: usize = 128;

/// Below this value of `per_px` (1/px; spots more than 12 px wide) profiles are computed in f64, because
/// differences of erf would lose too many digits in f32.
const WIDE_PER_PX: f32 = 0.235_7;

/// Fractions of the light in the pixels of a tile along one axis, and a zero.
type Profile = [f32; LANES];

/// A band of rows of the sensor, and the spots of the image.
pub(super) struct Band<'a> {
    pub(super) spots: &'a Footprints<'a>,
    /// Width of the sensor, px.
    pub(super) width: usize,
    /// The first row of the band, from 0.
    pub(super) first: usize,
    /// The pixels of the band, row by row; their values are overwritten.
    pub(super) pixels: &'a mut [f64],
    /// Memory for sums.
    pub(super) pool: &'a BufferPool<Vec<f32>>,
}

impl pulp::WithSimd for Band<'_> {
    type Output = ();

    // Must be inlined, with everything it calls, into a function compiled with the instruction set enabled.
    #[inline(always)]
    fn with_simd<S: pulp::Simd>(self, _: S) {
        let Band { spots, width, first, pixels, pool } = self;
        let mut panels = Panels::new(width, first, pixels.len() / width, pool);
        let mut batch = Batch {
            spots: [Footprint::default(); BATCH / 2],
            taken: 0,
            profiles: [0.0; BATCH * LANES],
            made: 0,
        };
        for spot in spots.near(first..panels.end) {
            if (spot.top as usize) >= panels.end || spot.bottom() <= first {
                continue;
            }
            if spot.per_px < WIDE_PER_PX {
                batch.finish(&mut panels);
                let axis = |count, center| (0..count).map(move |k| wide_profile(k, center, spot.per_px));
                let profiles: Vec<Profile> =
                    axis(spot.across, spot.x).chain(axis(spot.down(), spot.y)).collect();
                panels.add(spot, &profiles);
            } else {
                if batch.made + (spot.across + spot.down()) as usize > BATCH {
                    batch.finish(&mut panels);
                }
                batch.take(spot);
            }
        }
        batch.finish(&mut panels);
        panels.give(pixels);
    }
}

/// Footprints whose profiles are yet to be computed.
struct Batch {
    spots: [Footprint; BATCH / 2],
    taken: usize,
    /// Profiles of each spot: its tiles along columns, then along rows.
    profiles: [f32; BATCH * LANES],
    made: usize,
}

impl Batch {
    /// Adds a spot; it must not be wide, and its profiles must fit.
    #[inline(always)]
    fn take(&mut self, spot: &Footprint) {
        self.spots[self.taken] = *spot;
        self.taken += 1;
        let rest = &mut self.profiles[self.made * LANES..];
        self.made += (spot.across + spot.down()) as usize;
        if (spot.across, spot.down()) == (1, 1) {
            // The usual case, in one store of the size in which it is loaded again.
            let Some(edges) = rest.first_chunk_mut::<{ 2 * LANES }>() else { return };
            *edges =
                from_fn(|i| ((i % LANES) as f32 - if i < LANES { spot.x } else { spot.y }) * spot.per_px);
            return;
        }
        let (across, down) = rest.split_at_mut(spot.across as usize * LANES);
        for (tiles, count, center) in [(across, spot.across, spot.x), (down, spot.down(), spot.y)] {
            for (k, edges) in tiles.as_chunks_mut::<LANES>().0[..count as usize].iter_mut().enumerate() {
                let start = (k * TILE) as f32 - center;
                *edges = from_fn(|i| (i as f32 + start) * spot.per_px);
            }
        }
    }

    /// Computes all profiles and adds the spots to the panels.
    #[inline(always)]
    fn finish(&mut self, panels: &mut Panels<'_>) {
        // Two tiles fill the widest register of any instruction set.
        let pairs = self.profiles[..self.made.next_multiple_of(2) * LANES].as_chunks_mut::<{ 2 * LANES }>().0;
        for pair in pairs {
            let edges = pair.map(erf);
            *pair = from_fn(|i| {
                // The last lane of a tile has no pixel; its fraction is 0.
                let share = edges[i / LANES * LANES + (i % LANES + 1).min(TILE)] - edges[i];
                // Errors of `erf` could make the difference negative.
                if share > 0.0 { share } else { 0.0 }
            });
        }
        let mut profiles = self.profiles.as_chunks().0;
        for spot in &self.spots[..self.taken] {
            panels.add(spot, profiles);
            profiles = &profiles[(spot.across + spot.down()) as usize..];
        }
        (self.taken, self.made) = (0, 0);
    }
}

/// Sums of a band, in panels of columns: each panel row by row, with [`TILE`] additional rows.
struct Panels<'a> {
    sums: Pooled<'a, Vec<f32>>,
    /// Values per panel.
    size: usize,
    /// Rows of the band.
    first: usize,
    end: usize,
    width: usize,
}

impl<'a> Panels<'a> {
    fn new(width: usize, first: usize, rows: usize, pool: &'a BufferPool<Vec<f32>>) -> Self {
        let size = (rows + TILE) * STRIDE;
        let mut sums = pool.get();
        sums.resize(width.div_ceil(PANEL) * size, 0.0);
        Panels { sums, size, first, end: first + rows, width }
    }

    /// Adds a spot given its profiles, those along columns first.
    #[inline(always)]
    fn add(&mut self, spot: &Footprint, profiles: &[Profile]) {
        let (across, down) = profiles.split_at(spot.across as usize);
        let down = &down[..spot.down() as usize];
        let (top, left) = (spot.top as usize, spot.left as usize);
        let fits = top >= self.first && spot.bottom() <= self.end + TILE;
        for (k, across) in across.iter().enumerate() {
            let column = left + k * TILE;
            if column >= self.width {
                break;
            }
            let across = across.map(|share| share * spot.light);
            let panel = &mut self.sums[column / PANEL * self.size..][..self.size];
            let column = column % PANEL;
            if fits {
                let mut place = (top - self.first) * STRIDE + column;
                let (mut rows, mut down) = (spot.rows as usize, down.iter());
                while rows >= TILE {
                    add_rows::<TILE, { (TILE - 1) * STRIDE + LANES }>(panel, place, across, down.next());
                    place += TILE * STRIDE;
                    rows -= TILE;
                }
                if rows > 0 {
                    add_rows::<SHORT_TILE, { (SHORT_TILE - 1) * STRIDE + LANES }>(
                        panel,
                        place,
                        across,
                        down.next(),
                    );
                }
            } else {
                for row in top.max(self.first)..spot.bottom().min(self.end) {
                    let share = down[(row - top) / TILE][(row - top) % TILE];
                    add_row(&mut panel[(row - self.first) * STRIDE + column..], across, share);
                }
            }
        }
    }

    /// Copies the sums to the pixels of the band.
    #[inline(always)]
    fn give(&mut self, pixels: &mut [f64]) {
        for (row, pixels) in pixels.chunks_exact_mut(self.width).enumerate() {
            let mut overhang = [0.0; LANES];
            for (panel, pixels) in self.sums.chunks_exact_mut(self.size).zip(pixels.chunks_mut(PANEL)) {
                let Some(sums) = panel[row * STRIDE..].first_chunk_mut::<STRIDE>() else { continue };
                for (sum, overhang) in sums.iter_mut().zip(overhang) {
                    *sum += overhang;
                }
                overhang = from_fn(|i| sums[PANEL + i]);
                for (pixel, sum) in pixels.iter_mut().zip(sums) {
                    *pixel = f64::from(*sum);
                }
            }
        }
    }
}

/// Adds `ROWS` rows of a tile, whose pixels span `NUMBERS` values of the panel.
#[inline(always)]
fn add_rows<const ROWS: usize, const NUMBERS: usize>(
    panel: &mut [f32],
    place: usize,
    across: Profile,
    down: Option<&Profile>,
) {
    if let (Some(pixels), Some(down)) = (panel[place..].first_chunk_mut::<NUMBERS>(), down) {
        for (row, share) in down[..ROWS].iter().enumerate() {
            add_row(&mut pixels[row * STRIDE..], across, *share);
        }
    }
}

#[inline(always)]
fn add_row(row: &mut [f32], across: Profile, share: f32) {
    if let Some(pixels) = row.first_chunk_mut::<LANES>() {
        // A local copy, which cannot alias, is summed in one register.
        let before = *pixels;
        *pixels = from_fn(|i| before[i] + across[i] * share);
    }
}

/// The profile of tile k of a wide spot, computed in f64.
#[inline(always)]
fn wide_profile(k: u32, center: f32, per_px: f32) -> Profile {
    let start = (k as usize * TILE) as f64 - f64::from(center);
    let edges: [f64; LANES] = from_fn(|i| wide_erf((i as f64 + start) * f64::from(per_px)));
    from_fn(|i| (edges[(i + 1).min(TILE)] - edges[i]).max(0.0) as f32)
}

/// Differences of erf between the edges of `pixels` pixels; `first` is the first edge's distance from the
/// center of the spot, px.
pub(super) fn shares(first: f64, pixels: usize, per_px: f64) -> Vec<f64> {
    let edges: Vec<f64> = (0..=pixels).map(|i| wide_erf((first + i as f64) * per_px)).collect();
    edges.windows(2).map(|pair| (pair[1] - pair[0]).max(0.0)).collect()
}

/// The error function with an absolute error below 4.6e-7, without branches.
///
/// x P(x^2) / Q(x^2) on [-3.8, 3.8], beyond which erf is 1 to within 8e-8. The coefficients are a
/// near-minimax fit (least squares with Lawson's weights) with an error of 1.1e-8; the rest is rounding
/// error.
#[expect(clippy::approx_constant, reason = "the fit's own, the next number below 2 / sqrt(pi)")]
#[inline(always)]
fn erf(x: f32) -> f32 {
    const P: [f32; 6] =
        [1.128_379_1, 0.188_116_27, 0.052_547_354, 0.003_693_617_9, 0.000_287_999_8, 2.132_134_8e-6];
    const Q: [f32; 6] = [1.0, 0.500_045_96, 0.113_254_935, 0.014_822_937, 0.001_153_746_7, 3.909_79e-5];
    let x = if x > -3.8 { x } else { -3.8 };
    let x = if x < 3.8 { x } else { 3.8 };
    let u = x * x;
    let horner = |c: [f32; 6]| ((((c[5] * u + c[4]) * u + c[3]) * u + c[2]) * u + c[1]) * u + c[0];
    x * horner(P) / horner(Q)
}

/// The error function with an absolute error below 6e-12, without branches.
///
/// x P(x^2) / Q(x^2) on [-5, 5], beyond which erf is 1 to within 2e-12; the coefficients are a near-minimax
/// fit (least squares with Lawson's weights).
#[inline(always)]
fn wide_erf(x: f64) -> f64 {
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
            // The error of the fit is 4.1e-12; beyond 5, replacing erf by 1 adds 1.5e-12.
            assert!((wide_erf(x) - libm::erf(x)).abs() < 6e-12, "{x}: {} {}", wide_erf(x), libm::erf(x));
            let x = x as f32;
            let exact = libm::erf(f64::from(x));
            assert!((f64::from(erf(x)) - exact).abs() < 4.6e-7, "{x}: {} {exact}", erf(x));
        }
        assert_eq!((wide_erf(f64::INFINITY), wide_erf(-1e300)), (wide_erf(5.0), wide_erf(-5.0)));
        assert_eq!((erf(f32::INFINITY), erf(-1e30)), (erf(3.8), erf(-3.8)));
    }
}
