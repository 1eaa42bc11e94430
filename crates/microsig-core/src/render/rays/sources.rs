//! The source points of a particle, sorted by the rotation angles of their fans.
//!
//! For each direction of the fan, the points from which it can pass the aperture are then one contiguous run
//! (or two, where the angle wraps around), so that the kernel has long loops over contiguous memory in which
//! nearly every ray passes.

use std::ops::Range;

use super::fan::Candidate;
use crate::emission::Point;
use crate::render::instructions::InstructionSet;
use crate::render::lanes::MAX_LANES;

/// Source points, bucket-sorted by angle modulo pi.
///
/// The last point is followed by `MAX_LANES` padding points, all of whose rays miss the aperture.
#[derive(Debug, Clone, Default)]
pub(super) struct Sources {
    /// The points relative to the particle center in their original order, in the kernel's unit of length, as
    /// bits of f32.
    surface: Vec<[u32; 3]>,
    /// The points in sorted order, each with the rotation angle of its fan (2^32 per turn): 16 bytes written
    /// at once.
    ordered: Vec<[u32; 4]>,
    /// Cosine and sine of the rotation angle of the fan.
    cosine: Vec<f32>,
    sine: Vec<f32>,
    /// Lateral position (e2, e3) and axial distance to the lens.
    e2: Vec<f32>,
    e3: Vec<f32>,
    distance: Vec<f32>,
    /// Start of each bucket, and end of the last one.
    starts: Vec<u32>,
    /// Right shift (bits) that converts an angle modulo pi to its bucket.
    shift: u32,
}

impl Sources {
    /// Sets the points of a particle (um); `scale` converts um to the kernel's unit of length.
    pub(super) fn set_points(&mut self, points: &[Point], scale: f64) {
        self.surface.clear();
        self.surface.extend(points.iter().map(|point| point.map(|e| ((e * scale) as f32).to_bits())));
        // One to two points per bucket; one additional bucket at either end of a run costs little.
        let bits = points.len().next_power_of_two().ilog2().clamp(2, 16) - 1;
        self.shift = 32 - bits;
        self.starts.resize((1 << bits) + 1, 0);
        let length = points.len() + MAX_LANES;
        self.ordered.resize(points.len(), [0; 4]);
        for values in [&mut self.cosine, &mut self.sine, &mut self.e2, &mut self.e3] {
            values.resize(length, 0.0);
        }
        // Padding points so far away that all their rays miss the aperture.
        self.distance.resize(length, f32::MAX);
        let behind = points.len()..;
        self.cosine[behind.clone()].fill(1.0);
        self.sine[behind.clone()].fill(0.0);
        self.e2[behind.clone()].fill(0.0);
        self.e3[behind.clone()].fill(0.0);
        self.distance[behind].fill(f32::MAX);
    }

    /// Cosines, sines, e2, e3 and distances, all of the same length.
    #[inline(always)]
    pub(super) fn vectors(&self) -> [&[f32]; 5] {
        let length = self.number() + MAX_LANES;
        [&self.cosine, &self.sine, &self.e2, &self.e3, &self.distance].map(|values| &values[..length])
    }

    pub(super) fn number(&self) -> usize {
        self.surface.len()
    }

    /// Sorts the points by the rotation angles `phases` of their fans (2^32 per turn). `distance` is the
    /// distance from the particle center to the lens, in the kernel's unit of length.
    pub(super) fn place(&mut self, instructions: InstructionSet, phases: &[u32], distance: f32) {
        let shift = self.shift;
        let bucket = |phase: u32| (phase.wrapping_mul(2) >> shift) as usize;

        // Counts, shifted by one; their prefix sums are the starts of the buckets.
        self.starts.fill(0);
        for &phase in phases {
            self.starts[bucket(phase) + 1] += 1;
        }
        let mut sum = 0;
        for start in &mut self.starts {
            sum += *start;
            *start = sum;
        }
        for (&[e1, e2, e3], &phase) in self.surface.iter().zip(phases) {
            let next = &mut self.starts[bucket(phase)];
            self.ordered[*next as usize] = [e1, e2, e3, phase];
            *next += 1;
        }
        // Filling advanced every start to the next bucket's: shift them back.
        self.starts.rotate_right(1);
        self.starts[0] = 0;
        instructions.dispatch(Spread { sources: self, distance });
    }

    /// The points from which a candidate direction can pass the aperture, as up to two runs. The kernel reads
    /// up to a full vector past the end of a run: the `MAX_LANES` points there belong to neither run.
    pub(super) fn runs(&self, candidate: &Candidate) -> [Range<usize>; 2] {
        let number = self.number();
        let all = [0..number, 0..0];
        if candidate.reach >= 1 << 31 {
            return all;
        }
        let low = candidate.center.wrapping_sub(candidate.reach);
        let high = candidate.center.wrapping_add(candidate.reach);
        let (first, last) = ((low >> self.shift) as usize, (high >> self.shift) as usize);
        let (start, end) = (self.starts[first] as usize, self.starts[last + 1] as usize);
        if low <= high {
            [start..end, 0..0]
        } else if end + MAX_LANES <= start {
            [start..number, 0..end]
        } else {
            all
        }
    }
}

/// Conversion of the sorted points to a structure of arrays, compiled once for every instruction set.
struct Spread<'a> {
    sources: &'a mut Sources,
    distance: f32,
}

impl pulp::WithSimd for Spread<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: pulp::Simd>(self, _: S) {
        let Sources { ordered, cosine, sine, e2, e3, distance, .. } = self.sources;
        let n = ordered.len();
        let (cosine, sine) = (&mut cosine[..n], &mut sine[..n]);
        let (e2, e3, distance) = (&mut e2[..n], &mut e3[..n], &mut distance[..n]);
        // Two loops, because the compiler does not vectorize a loop that writes five arrays.
        for ((&[.., phase], cosine), sine) in ordered.iter().zip(cosine).zip(sine) {
            (*cosine, *sine) = cos_sin(phase);
        }
        for (((&[toward, across, along, _], distance), e2), e3) in
            ordered.iter().zip(distance).zip(e2).zip(e3)
        {
            *distance = self.distance + f32::from_bits(toward);
            *e2 = f32::from_bits(across);
            *e3 = f32::from_bits(along);
        }
    }
}

/// Cosine and sine of an angle given in units of 2^-32 turn, with errors below 1e-7.
#[inline(always)]
fn cos_sin(phase: u32) -> (f32, f32) {
    // Subtract the nearest multiple of a quarter turn; the remainder is within 45 degrees.
    let quarter = phase.wrapping_add(1 << 29) >> 30;
    let rest = phase.wrapping_sub(quarter << 30) as i32;
    let x = rest as f32 * (std::f32::consts::PI / 2_147_483_648.0);
    let x2 = x * x;
    // Taylor series; the first neglected terms are x^9/9! = 3e-7 x and x^10/10! = 2e-8 at 45 degrees.
    let sine =
        x * (1.0 - x2 * (1.0 / 6.0 - x2 * (1.0 / 120.0 - x2 * (1.0 / 5040.0 - x2 * (1.0 / 362_880.0)))));
    let cosine = 1.0 - x2 * (0.5 - x2 * (1.0 / 24.0 - x2 * (1.0 / 720.0 - x2 * (1.0 / 40_320.0))));
    // In odd quadrants sine and cosine are exchanged; the signs follow from the quadrant.
    let (cosine, sine) = if quarter & 1 == 0 { (cosine, sine) } else { (sine, cosine) };
    let negate_if = |second_bit: u32, value: f32| f32::from_bits(value.to_bits() ^ (second_bit & 2) << 30);
    (negate_if(quarter ^ quarter << 1, cosine), negate_if(quarter, sine))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cosine_and_sine_of_a_phase() {
        for step in 0..10_000u32 {
            let phase = step.wrapping_mul(429_497);
            let (sine, cosine) =
                libm::sincos(f64::from(phase) / 4_294_967_296.0 * 2.0 * std::f64::consts::PI);
            let (c, s) = cos_sin(phase);
            assert!(
                (f64::from(c) - cosine).abs() < 2e-7 && (f64::from(s) - sine).abs() < 2e-7,
                "phase {phase}"
            );
        }
    }

    /// Every point occurs once, and the runs of a range of angles contain all points within it, each once.
    #[test]
    fn runs_hold_all_points_of_a_range_once() {
        for n in [1, 2, 3, 16, 17, 1000] {
            let phases: Vec<u32> = (0..n).map(|k: u32| k.wrapping_mul(0x9E37_79B9) ^ 0x1234_5678).collect();
            // e2 is the number of the point, by which it is identified after sorting.
            let points: Vec<Point> = (0..n).map(|k| [0.0, f64::from(k), 0.0]).collect();
            let mut sources = Sources::default();
            sources.set_points(&points, 1.0);
            sources.place(InstructionSet::best(), &phases, 1.0);
            let mut ranges = 0;
            for step in 0..300u32 {
                let center = step.wrapping_mul(0x85EB_CA6B);
                let reach = (u32::MAX / 250).saturating_mul(step);
                let runs = sources.runs(&Candidate { direction: [0.0; 3], center, reach });
                let mut held: Vec<u32> =
                    runs.into_iter().flatten().map(|place| sources.e2[place] as u32).collect();
                held.sort_unstable();
                assert!(held.windows(2).all(|pair| pair[0] < pair[1]), "{n} points: one is there twice");
                for (k, phase) in phases.iter().enumerate() {
                    let off = (phase.wrapping_mul(2).wrapping_sub(center) as i32).unsigned_abs();
                    let within = off <= reach;
                    assert!(!within || held.binary_search(&(k as u32)).is_ok(), "{n} points: {k} is missing");
                    ranges += u32::from(!within);
                }
            }
            assert!(ranges > 0, "every range held everything");
        }
    }
}
