//! The source points of a particle in the order of the angles of their fans.
//!
//! Seen from one direction of the fan, the points whose angle brings it into the lens are then one run (or two, where
//! the angle wraps): long loops over neighbours in memory, in which nearly every ray arrives.

use std::ops::Range;

use super::fan::Candidate;
use crate::emission::Point;

/// The widest vector of any instruction set, in numbers of f32.
pub(super) const MAX_LANES: usize = 16;

/// Source points, ordered by angle modulo pi to the width of a bucket.
///
/// Behind the last point there are `MAX_LANES` more, which are there to be read and thrown away.
#[derive(Debug, Clone, Default)]
pub(super) struct Sources {
    /// Angle of the fan, 2^32 per turn, with its cosine and sine.
    phase: Vec<u32>,
    pub(super) cosine: Vec<f32>,
    pub(super) sine: Vec<f32>,
    /// Position across the axis and distance to the lens along it, in units of the kernel's choice.
    pub(super) e2: Vec<f32>,
    pub(super) e3: Vec<f32>,
    pub(super) distance: Vec<f32>,
    /// Where each bucket begins, and where the last one ends.
    starts: Vec<u32>,
    /// Angles modulo pi are shifted by so many bits to give a bucket.
    shift: u32,
}

impl Sources {
    /// Puts `points` in order, whose fans are turned by `phases`. Lengths times `scale` are what the kernel wants;
    /// `distance` is that from the particle's centre to the lens.
    pub(super) fn place(
        &mut self,
        arch: pulp::Arch,
        points: &[Point],
        phases: &[u32],
        distance: f64,
        scale: f64,
    ) {
        // One to two points a bucket; a bucket more at either end of a run costs little.
        let bits = points.len().next_power_of_two().ilog2().clamp(2, 16) - 1;
        self.shift = 32 - bits;
        let bucket = |phase: u32| (phase.wrapping_mul(2) >> self.shift) as usize;

        // Counts, one place up; their running sums are where buckets begin.
        self.starts.clear();
        self.starts.resize((1 << bits) + 1, 0);
        for &phase in phases {
            self.starts[bucket(phase) + 1] += 1;
        }
        let mut sum = 0;
        for start in &mut self.starts {
            sum += *start;
            *start = sum;
        }
        let length = points.len() + MAX_LANES;
        self.phase.resize(length, 0);
        for values in [&mut self.cosine, &mut self.sine, &mut self.e2, &mut self.e3, &mut self.distance] {
            values.resize(length, 0.0);
        }
        for (&[e1, e2, e3], &phase) in points.iter().zip(phases) {
            let next = &mut self.starts[bucket(phase)];
            let place = *next as usize;
            *next += 1;
            self.phase[place] = phase;
            self.e2[place] = (e2 * scale) as f32;
            self.e3[place] = (e3 * scale) as f32;
            self.distance[place] = ((distance + e1) * scale) as f32;
        }
        // Filling moved every start to that of the next bucket: move them back.
        self.starts.rotate_right(1);
        self.starts[0] = 0;
        arch.dispatch(Turns { phase: &self.phase, cosine: &mut self.cosine, sine: &mut self.sine });
    }

    /// The points that can send a candidate direction into the lens, as up to two runs.
    pub(super) fn runs(&self, candidate: &Candidate) -> [Range<usize>; 2] {
        let number = self.starts[self.starts.len() - 1] as usize;
        let all = [0..number, 0..0];
        if candidate.reach >= 1 << 31 {
            return all;
        }
        let low = candidate.centre.wrapping_sub(candidate.reach);
        let high = candidate.centre.wrapping_add(candidate.reach);
        let (first, last) = ((low >> self.shift) as usize, (high >> self.shift) as usize);
        let (start, end) = (self.starts[first] as usize, self.starts[last + 1] as usize);
        if low <= high {
            [start..end, 0..0]
        } else if last < first {
            [start..number, 0..end]
        } else {
            all
        }
    }
}

/// Cosines and sines of phases, compiled once for every instruction set.
struct Turns<'a> {
    phase: &'a [u32],
    cosine: &'a mut [f32],
    sine: &'a mut [f32],
}

impl pulp::WithSimd for Turns<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: pulp::Simd>(self, _: S) {
        for ((&phase, cosine), sine) in self.phase.iter().zip(self.cosine).zip(self.sine) {
            (*cosine, *sine) = cos_sin(phase);
        }
    }
}

/// Cosine and sine of an angle given in 2^32 per turn, to 1e-7.
#[inline(always)]
fn cos_sin(phase: u32) -> (f32, f32) {
    // Split off the nearest multiple of a quarter turn; the rest lies within 45 degrees.
    let quarter = phase.wrapping_add(1 << 29) >> 30;
    let rest = phase.wrapping_sub(quarter << 30) as i32;
    let x = rest as f32 * (std::f32::consts::PI / 2_147_483_648.0);
    let x2 = x * x;
    // Taylor series; the first neglected terms are x^9/9! = 3e-7 x and x^10/10! = 2e-8 at 45 degrees.
    let sine =
        x * (1.0 - x2 * (1.0 / 6.0 - x2 * (1.0 / 120.0 - x2 * (1.0 / 5040.0 - x2 * (1.0 / 362_880.0)))));
    let cosine = 1.0 - x2 * (0.5 - x2 * (1.0 / 24.0 - x2 * (1.0 / 720.0 - x2 * (1.0 / 40_320.0))));
    // In odd quarters the two change places; the signs are those of the quadrant.
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

    /// All points are there once, and the runs of a range of angles hold all points within it, none of them twice.
    #[test]
    fn runs_hold_all_points_of_a_range_once() {
        for n in [1, 2, 3, 16, 17, 1000] {
            let phases: Vec<u32> = (0..n).map(|k: u32| k.wrapping_mul(0x9E37_79B9) ^ 0x1234_5678).collect();
            // A point's number is its e2, so that it can be told where it went.
            let points: Vec<Point> = (0..n).map(|k| [0.0, f64::from(k), 0.0]).collect();
            let mut sources = Sources::default();
            sources.place(pulp::Arch::new(), &points, &phases, 1.0, 1.0);
            let mut ranges = 0;
            for step in 0..300u32 {
                let centre = step.wrapping_mul(0x85EB_CA6B);
                let reach = (u32::MAX / 250).saturating_mul(step);
                let runs = sources.runs(&Candidate { direction: [0.0; 3], centre, reach });
                let mut held: Vec<u32> =
                    runs.into_iter().flatten().map(|place| sources.e2[place] as u32).collect();
                held.sort_unstable();
                assert!(held.windows(2).all(|pair| pair[0] < pair[1]), "{n} points: one is there twice");
                for (k, phase) in phases.iter().enumerate() {
                    let off = (phase.wrapping_mul(2).wrapping_sub(centre) as i32).unsigned_abs();
                    let within = off <= reach;
                    assert!(!within || held.binary_search(&(k as u32)).is_ok(), "{n} points: {k} is missing");
                    ranges += u32::from(!within);
                }
            }
            assert!(ranges > 0, "every range held everything");
        }
    }
}
