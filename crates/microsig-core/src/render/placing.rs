//! Gaussian spots on the sensor: which pixels they light, in the order in which these are added up.

use super::gaussian::Look;
use super::instructions::InstructionSet;
use super::strokes::{SHORT, STROKE};
use crate::particle::Particle;
use crate::shelf::{Lent, Shelf};

/// Spots are sorted by bands of so many rows: those that follow each other light pixels that are still at hand.
const BUCKET: usize = 8;

/// Particles that are placed at a time.
const GROUP: usize = 16;

/// A spot, and the pixels that it lights: strokes of [`STROKE`] columns and rows.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Spot {
    /// From the upper left corner of its first pixel to its centre, px.
    pub(super) x: f32,
    pub(super) y: f32,
    /// 1 / (sigma sqrt(2)) = 2 sqrt(2) / d, 1/px.
    pub(super) per_px: f32,
    /// Peak times (sigma sqrt(pi / 2))^2: what is to be multiplied by differences of erf along both axes.
    pub(super) light: f32,
    /// First column and row, from 0.
    pub(super) left: u32,
    pub(super) top: u32,
    /// Strokes of columns.
    pub(super) across: u32,
    /// Rows, in whole strokes or in whole strokes and [`SHORT`].
    pub(super) rows: u32,
}

impl Spot {
    /// The row below its last one; may lie beyond the sensor.
    #[inline(always)]
    pub(super) fn bottom(&self) -> usize {
        (self.top + self.rows) as usize
    }

    /// Strokes of rows.
    #[inline(always)]
    pub(super) fn down(&self) -> u32 {
        strokes(self.rows - 1)
    }
}

/// The spots of an image that light its sensor, by the bucket of their first row, then in the order of their particles.
#[derive(Debug)]
pub(super) struct Spots<'a> {
    spots: Lent<'a, Vec<Spot>>,
    /// Where each bucket ends.
    ends: Vec<u32>,
    /// Rows of the tallest spot.
    tallest: usize,
}

impl<'a> Spots<'a> {
    pub(super) fn new(
        particles: &[Particle],
        look: Look,
        sensor: (u32, u32),
        instructions: InstructionSet,
        shelf: &'a Shelf<Vec<Spot>>,
    ) -> Self {
        let mut placed = shelf.lend();
        placed.resize(particles.len(), Spot::default());
        let n = instructions.dispatch(Placing { particles, look, sensor, placed: &mut placed });
        placed.truncate(n);
        // A counting sort; it keeps the order within a bucket.
        let mut ends = vec![0; (sensor.1 as usize).div_ceil(BUCKET) + 1];
        for spot in placed.iter() {
            ends[spot.top as usize / BUCKET + 1] += 1;
        }
        for bucket in 1..ends.len() {
            ends[bucket] += ends[bucket - 1];
        }
        let tallest = placed.iter().map(|spot| spot.rows).max().unwrap_or_default() as usize;
        let mut spots = shelf.lend();
        spots.resize(placed.len(), Spot::default());
        for &spot in placed.iter() {
            // Where its bucket begins, which moves on to where it ends.
            let next = &mut ends[spot.top as usize / BUCKET];
            spots[*next as usize] = spot;
            *next += 1;
        }
        Spots { spots, ends, tallest }
    }

    /// The spots that may light some of these rows.
    pub(super) fn near(&self, rows: std::ops::Range<usize>) -> &[Spot] {
        let end_of = |bucket: usize| self.ends.get(bucket).map_or(self.spots.len(), |&end| end as usize);
        let first = rows.start.saturating_sub(self.tallest) / BUCKET;
        let from = if first == 0 { 0 } else { end_of(first - 1) };
        let to = if rows.is_empty() { from } else { end_of((rows.end - 1) / BUCKET) };
        &self.spots[from..to]
    }
}

/// Places all particles whose spots meet the sensor; gives their number.
struct Placing<'a> {
    particles: &'a [Particle],
    look: Look,
    /// Width and height, px.
    sensor: (u32, u32),
    /// As many as there are particles.
    placed: &'a mut [Spot],
}

impl pulp::WithSimd for Placing<'_> {
    type Output = usize;

    // Inlined, with all that it calls, into a function for which the instruction set is switched on.
    #[inline(always)]
    fn with_simd<S: pulp::Simd>(self, _: S) -> usize {
        let mut next = 0;
        let (groups, rest) = self.particles.as_chunks();
        for group in groups {
            next += place(group, self.look, self.sensor, &mut self.placed[next..][..GROUP]);
        }
        if let Some(&last) = rest.last() {
            let group = std::array::from_fn(|i| rest.get(i).copied().unwrap_or(last));
            next += place(&group, self.look, self.sensor, &mut self.placed[next..][..rest.len()]);
        }
        next
    }
}

/// Places as many of a group as there is room for; gives the number of those that meet the sensor.
#[inline(always)]
fn place(group: &[Particle; GROUP], look: Look, sensor: (u32, u32), placed: &mut [Spot]) -> usize {
    let mut spots = Columns::default();
    let mut lit = [0u32; GROUP];
    let (width, height) = (f64::from(sensor.0), f64::from(sensor.1));
    // From the sensor's corner.
    let (mut x, mut y) = ([0.0; GROUP], [0.0; GROUP]);
    let (mut d_um, mut c_int) = ([0.0; GROUP], [0.0; GROUP]);
    for (i, particle) in group.iter().enumerate() {
        (x[i], y[i]) = (particle.x_px - 0.5, particle.y_px - 0.5);
        (d_um[i], c_int[i]) = (particle.d_um, particle.c_int);
    }
    for i in 0..GROUP {
        let (x, y) = (x[i], y[i]);
        let (diameter, brightness) = (look.diameter(d_um[i] as f32), c_int[i] as f32);
        let reach = f64::from(look.reach(diameter, brightness));
        let (left, right) = (x - reach, x + reach);
        let (top, bottom) = (y - reach, y + reach);
        let meets = (reach > 0.0) & (left < width) & (right >= 0.0) & (top < height) & (bottom >= 0.0);
        lit[i] = u32::from(meets);
        let (left, right) = (Whole::of(left, width), Whole::of(right, width));
        let (top, bottom) = (Whole::of(top, height), Whole::of(bottom, height));
        spots.x[i] = (x - left.value()) as f32;
        spots.y[i] = (y - top.value()) as f32;
        spots.per_px[i] = (2.0 * std::f32::consts::SQRT_2) / diameter;
        spots.light[i] = look.light(diameter, brightness);
        spots.left[i] = left.number();
        spots.top[i] = top.number();
        spots.across[i] = strokes(right.number().wrapping_sub(left.number()));
        spots.rows[i] = whole_rows(bottom.number().wrapping_sub(top.number()));
    }
    let mut next = 0;
    for (i, lit) in lit.into_iter().enumerate().take(placed.len()) {
        // The next one takes the place of one that does not meet the sensor.
        placed[next] = Spot {
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

/// Spots, one number of them all after the other: what vectors are made of.
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

/// The strokes that reach a pixel `pixels` further on: pixels / 7 + 1, for less than 43,000 px.
#[inline(always)]
fn strokes(pixels: u32) -> u32 {
    const { assert!(STROKE == 7) };
    pixels.wrapping_mul(37_450) / (1 << 18) + 1
}

/// Rows that reach a pixel `pixels` further on, as they are added.
#[inline(always)]
fn whole_rows(pixels: u32) -> u32 {
    let whole = strokes(pixels).wrapping_mul(STROKE as u32);
    let short = whole - (STROKE - SHORT) as u32;
    if pixels < short { short } else { whole }
}

/// The number of the pixel that holds a place, plus 2^52, by which it lies in the low bits; conversions to integers are slow.
#[derive(Clone, Copy)]
struct Whole(f64);

impl Whole {
    const SHIFT: f64 = 4_503_599_627_370_496.0;

    /// On a sensor of this size. A place on the edge of two pixels may be taken for either.
    #[inline(always)]
    fn of(place: f64, size: f64) -> Self {
        let low = if place > 0.5 { place } else { 0.5 };
        let within = if low < size - 0.5 { low } else { size - 0.5 };
        // Rounding to the nearest is rounding down half a pixel before.
        Whole((within - 0.5) + Self::SHIFT)
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
        assert!((0..43_000).all(|pixels| strokes(pixels) == pixels / 7 + 1));
        assert_eq!([0, 2, 3, 6, 7, 9, 10, 13, 14].map(whole_rows), [3, 3, 7, 7, 10, 10, 14, 14, 17]);
    }

    #[test]
    fn a_place_lies_in_its_pixel() {
        for (place, number) in [(-3.0, 0), (0.3, 0), (1.2, 1), (6.9, 6), (7.3, 7), (9.0, 7), (f64::NAN, 0)] {
            assert_eq!(Whole::of(place, 8.0).number(), number, "{place}");
        }
    }
}
