//! The pixels illuminated by each Gaussian spot, in the order in which the spots are added.

use super::spot::SpotScaling;
use crate::particle::Particle;
use crate::pool::{BufferPool, Pooled};
use crate::render::instructions::InstructionSet;

/// Footprints are sorted into buckets of this many rows, so that consecutive spots illuminate pixels that are
/// still in the cache.
const BUCKET: usize = 8;

/// Width and height of a tile, px.
pub(super) const TILE: usize = 7;

/// Rows of a short tile, which may be the last tile of a footprint.
pub(super) const SHORT_TILE: usize = 3;

/// Particles per group of the placement loop.
const GROUP: usize = 16;

/// A spot and the pixels that it illuminates, in tiles of [`TILE`] x [`TILE`] px.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Footprint {
    /// Position of the center relative to the upper left corner of the first pixel, px.
    pub(super) x: f32,
    pub(super) y: f32,
    /// 1 / (sigma sqrt(2)) = 2 sqrt(2) / d, 1/px.
    pub(super) per_px: f32,
    /// Peak times (sigma sqrt(pi / 2))^2, the factor on the differences of erf along both axes.
    pub(super) light: f32,
    /// First column and row, from 0.
    pub(super) left: u32,
    pub(super) top: u32,
    /// Number of tiles along columns.
    pub(super) across: u32,
    /// Number of rows: whole tiles, or whole tiles plus [`SHORT_TILE`].
    pub(super) rows: u32,
}

impl Footprint {
    /// The row after the last one; may be outside the sensor.
    #[inline(always)]
    pub(super) fn bottom(&self) -> usize {
        (self.top + self.rows) as usize
    }

    /// Number of tiles along rows.
    #[inline(always)]
    pub(super) fn down(&self) -> u32 {
        tiles(self.rows - 1)
    }
}

/// The spots of an image that overlap the sensor, sorted by the bucket of their first row, then in the order
/// of their particles.
#[derive(Debug)]
pub(super) struct Footprints<'a> {
    spots: Pooled<'a, Vec<Footprint>>,
    /// End of each bucket.
    ends: Vec<u32>,
    /// Rows of the tallest spot.
    tallest: usize,
}

impl<'a> Footprints<'a> {
    pub(super) fn new(
        particles: &[Particle],
        scaling: SpotScaling,
        sensor: (u32, u32),
        instructions: InstructionSet,
        pool: &'a BufferPool<Vec<Footprint>>,
    ) -> Self {
        let mut placed = pool.get();
        placed.resize(particles.len(), Footprint::default());
        let n = instructions.dispatch(Place { particles, scaling, sensor, placed: &mut placed });
        placed.truncate(n);
        // A counting sort, which is stable within a bucket.
        let mut ends = vec![0; (sensor.1 as usize).div_ceil(BUCKET) + 1];
        for spot in placed.iter() {
            ends[spot.top as usize / BUCKET + 1] += 1;
        }
        for bucket in 1..ends.len() {
            ends[bucket] += ends[bucket - 1];
        }
        let tallest = placed.iter().map(|spot| spot.rows).max().unwrap_or_default() as usize;
        let mut spots = pool.get();
        spots.resize(placed.len(), Footprint::default());
        for &spot in placed.iter() {
            // The start of its bucket, which advances to its end.
            let next = &mut ends[spot.top as usize / BUCKET];
            spots[*next as usize] = spot;
            *next += 1;
        }
        Footprints { spots, ends, tallest }
    }

    /// The spots that may illuminate some of these rows.
    pub(super) fn near(&self, rows: std::ops::Range<usize>) -> &[Footprint] {
        let end_of = |bucket: usize| self.ends.get(bucket).map_or(self.spots.len(), |&end| end as usize);
        let first = rows.start.saturating_sub(self.tallest) / BUCKET;
        let from = if first == 0 { 0 } else { end_of(first - 1) };
        let to = if rows.is_empty() { from } else { end_of((rows.end - 1) / BUCKET) };
        &self.spots[from..to]
    }
}

/// Computes the footprints of all particles whose spots overlap the sensor; returns their number.
struct Place<'a> {
    particles: &'a [Particle],
    scaling: SpotScaling,
    /// Width and height, px.
    sensor: (u32, u32),
    /// One element per particle.
    placed: &'a mut [Footprint],
}

impl pulp::WithSimd for Place<'_> {
    type Output = usize;

    // Must be inlined, with everything it calls, into a function compiled with the instruction set enabled.
    #[inline(always)]
    fn with_simd<S: pulp::Simd>(self, _: S) -> usize {
        let mut next = 0;
        let (groups, rest) = self.particles.as_chunks();
        for group in groups {
            next += place(group, self.scaling, self.sensor, &mut self.placed[next..][..GROUP]);
        }
        if let Some(&last) = rest.last() {
            let group = std::array::from_fn(|i| rest.get(i).copied().unwrap_or(last));
            next += place(&group, self.scaling, self.sensor, &mut self.placed[next..][..rest.len()]);
        }
        next
    }
}

/// Computes the footprints of a group until `placed` is full; returns the number of those that overlap the
/// sensor.
#[inline(always)]
fn place(
    group: &[Particle; GROUP],
    scaling: SpotScaling,
    sensor: (u32, u32),
    placed: &mut [Footprint],
) -> usize {
    let mut spots = Columns::default();
    let mut lit = [0u32; GROUP];
    let (width, height) = (f64::from(sensor.0), f64::from(sensor.1));
    // Positions relative to the corner of the sensor.
    let (mut x, mut y) = ([0.0; GROUP], [0.0; GROUP]);
    let (mut d_um, mut c_int) = ([0.0; GROUP], [0.0; GROUP]);
    for (i, particle) in group.iter().enumerate() {
        (x[i], y[i]) = (particle.x_px - 0.5, particle.y_px - 0.5);
        (d_um[i], c_int[i]) = (particle.d_um, particle.c_int);
    }
    for i in 0..GROUP {
        let (x, y) = (x[i], y[i]);
        let (diameter, brightness) = (scaling.diameter(d_um[i] as f32), c_int[i] as f32);
        let reach = f64::from(scaling.reach(diameter, brightness));
        let (left, right) = (x - reach, x + reach);
        let (top, bottom) = (y - reach, y + reach);
        let meets = (reach > 0.0) & (left < width) & (right >= 0.0) & (top < height) & (bottom >= 0.0);
        lit[i] = u32::from(meets);
        let (left, right) = (PixelIndex::of(left, width), PixelIndex::of(right, width));
        let (top, bottom) = (PixelIndex::of(top, height), PixelIndex::of(bottom, height));
        spots.x[i] = (x - left.value()) as f32;
        spots.y[i] = (y - top.value()) as f32;
        spots.per_px[i] = (2.0 * std::f32::consts::SQRT_2) / diameter;
        spots.light[i] = scaling.light(diameter, brightness);
        spots.left[i] = left.number();
        spots.top[i] = top.number();
        spots.across[i] = tiles(right.number().wrapping_sub(left.number()));
        spots.rows[i] = whole_rows(bottom.number().wrapping_sub(top.number()));
    }
    let mut next = 0;
    for (i, lit) in lit.into_iter().enumerate().take(placed.len()) {
        // A spot that does not overlap the sensor is overwritten by the next one.
        placed[next] = Footprint {
            x: spots.x[i],
            y: spots.y[i],
            per_px: spots.per_px[i],
            light: spots.light[i],
            left: spots.left[i],
            top: spots.top[i],
            across: spots.across[i],
            rows: spots.rows[i],
        };
        next += lit as usize;
    }
    next
}

/// Footprints as a structure of arrays, for vectorization.
#[derive(Default)]
struct Columns {
    x: [f32; GROUP],
    y: [f32; GROUP],
    per_px: [f32; GROUP],
    light: [f32; GROUP],
    left: [u32; GROUP],
    top: [u32; GROUP],
    across: [u32; GROUP],
    rows: [u32; GROUP],
}

/// Number of tiles needed to reach the pixel at offset `pixels` from the first: pixels / 7 + 1, for less than
/// 43,000 px.
#[inline(always)]
fn tiles(pixels: u32) -> u32 {
    const { assert!(TILE == 7) };
    pixels.wrapping_mul(37_450) / (1 << 18) + 1
}

/// Number of rows, in whole and short tiles, needed to reach the pixel at offset `pixels` from the first.
#[inline(always)]
fn whole_rows(pixels: u32) -> u32 {
    let whole = tiles(pixels).wrapping_mul(TILE as u32);
    let short = whole - (TILE - SHORT_TILE) as u32;
    if pixels < short { short } else { whole }
}

/// The number of the pixel that contains a position, plus 2^52, which puts it into the low bits; conversions
/// to integers are slow.
#[derive(Clone, Copy)]
struct PixelIndex(f64);

impl PixelIndex {
    const SHIFT: f64 = 4_503_599_627_370_496.0;

    /// The pixel of a position on a sensor of `size` px. A position on the edge of two pixels may be assigned
    /// to either.
    #[inline(always)]
    fn of(place: f64, size: f64) -> Self {
        let low = if place > 0.5 { place } else { 0.5 };
        let within = if low < size - 0.5 { low } else { size - 0.5 };
        // Rounding (x - 0.5) to nearest is rounding x down.
        PixelIndex((within - 0.5) + Self::SHIFT)
    }

    #[inline(always)]
    fn value(self) -> f64 {
        self.0 - Self::SHIFT
    }

    #[inline(always)]
    fn number(self) -> u32 {
        self.0.to_bits() as u32
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn strokes_hold_all_pixels() {
        assert!((0..43_000).all(|pixels| tiles(pixels) == pixels / 7 + 1));
        assert_eq!([0, 2, 3, 6, 7, 9, 10, 13, 14].map(whole_rows), [3, 3, 7, 7, 10, 10, 14, 14, 17]);
    }

    #[test]
    fn a_place_lies_in_its_pixel() {
        for (place, number) in [(-3.0, 0), (0.3, 0), (1.2, 1), (6.9, 6), (7.3, 7), (9.0, 7), (f64::NAN, 0)] {
            assert_eq!(PixelIndex::of(place, 8.0).number(), number, "{place}");
        }
    }
}
