//! The directions of a ray fan, sorted so that those of a turned fan that can reach the lens are one run.
//!
//! A turned direction has the depth component |s cos(A)|, where A is its azimuth plus the random angle, and the slopes
//! p_x = tan(A) (up to sign) and p_y = c / |s cos(A)|. It can reach the lens only if A lies near 0 or pi, and only if
//! its polar cosine c is small. Azimuths are held modulo pi as 32-bit fractions of a half turn, so that adding an
//! angle wraps by itself. Nothing is approximated: what is left out is sure to miss, and what is kept is tested.

use crate::emission;

/// Directions traced in one stroke; runs are widened to multiples of it.
pub(super) const LANES: usize = 8;

/// All directions of a fan, sorted by azimuth modulo pi.
#[derive(Debug, Clone)]
pub(super) struct Fan {
    directions: Vec<(u32, [f32; 3])>,
}

/// The directions of a fan that can reach the lens from one particle, laid out for the kernel.
#[derive(Debug, Clone, Default)]
pub(super) struct Candidates {
    /// Azimuth modulo pi, ascending, without the repetition.
    keys: Vec<u32>,
    /// Direction components; the whole list twice, so that a run never wraps.
    pub(super) d1: Vec<f32>,
    pub(super) d2: Vec<f32>,
    pub(super) d3: Vec<f32>,
}

/// 2^32 / pi: half turns as 32-bit fractions.
const PER_RADIAN: f64 = 4_294_967_296.0 / std::f64::consts::PI;

impl Fan {
    pub(super) fn new(n_rays: u32) -> Self {
        let mut directions: Vec<(u32, [f32; 3])> = emission::fan(n_rays)
            .map(|[d1, d2, d3]| {
                let azimuth = libm::atan2(d2, d1);
                let half_turns = if azimuth < 0.0 { azimuth + std::f64::consts::PI } else { azimuth };
                // `as` saturates at 2^32 - 1, one part in 2^32 away from the wrapped zero.
                ((half_turns * PER_RADIAN) as u32, [d1 as f32, d2 as f32, d3 as f32])
            })
            .collect();
        directions.sort_by_key(|&(key, _)| key);
        Fan { directions }
    }

    /// Collects the directions whose slope along image rows can be as small as `max_slope_y`.
    pub(super) fn candidates(&self, max_slope_y: f64, out: &mut Candidates) {
        // |p_y| >= |c| / sqrt(1 - c^2); the margin covers the rounding of f32.
        let slope = max_slope_y * (1.0 + 1e-5);
        let max_cosine = (slope / libm::sqrt(1.0 + slope * slope) + 1e-6) as f32;
        out.keys.clear();
        out.d1.clear();
        out.d2.clear();
        out.d3.clear();
        for &(key, [d1, d2, d3]) in self.directions.iter().filter(|(_, d)| d[2].abs() <= max_cosine) {
            out.keys.push(key);
            out.d1.push(d1);
            out.d2.push(d2);
            out.d3.push(d3);
        }
        for component in [&mut out.d1, &mut out.d2, &mut out.d3] {
            component.extend_from_within(..);
        }
    }
}

impl Candidates {
    /// The run of directions of a fan turned by `phase` (in 2^32 per full turn) whose slope along image columns is at
    /// most `tan(reach)`; `reach` is a [`half_turns`] angle. Widened to full lanes where that repeats no direction.
    pub(super) fn run(&self, phase: u32, reach: u32) -> std::ops::Range<usize> {
        let n = self.keys.len();
        if reach >= 1 << 31 {
            return 0..n;
        }
        // Turning by a full turn is two half turns: azimuths modulo pi move by 2 phase, wrapping.
        let centre = 0u32.wrapping_sub(phase.wrapping_mul(2));
        let (low, high) = (centre.wrapping_sub(reach), centre.wrapping_add(reach));
        let start = self.keys.partition_point(|&k| k < low);
        let mut end = self.keys.partition_point(|&k| k <= high);
        if high < low {
            end += n;
        }
        let length = end - start;
        let full = length.next_multiple_of(LANES);
        start..start + if full <= n { full } else { length }
    }
}

/// An angle as a fraction of a half turn in 2^32 parts, widened by the rounding of f32.
pub(super) fn half_turns(angle: f64) -> u32 {
    ((angle + 1e-6) * PER_RADIAN) as u32
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Every direction that a turn brings within the reach is in the run, and none is there twice.
    #[test]
    fn a_run_holds_all_that_can_arrive_once() {
        for n_rays in [1, 7, 100, 500] {
            let fan = Fan::new(n_rays);
            let mut candidates = Candidates::default();
            fan.candidates(0.35, &mut candidates);
            for step in 0..200u32 {
                let phase = step.wrapping_mul(0x9E37_79B9);
                let reach = 0.02 * f64::from(step % 90);
                let run = candidates.run(phase, half_turns(reach));
                assert!(run.len() <= candidates.keys.len());
                let inside = |i: usize| run.contains(&i) || run.contains(&(i + candidates.keys.len()));
                for (i, &key) in candidates.keys.iter().enumerate() {
                    let azimuth = f64::from(key.wrapping_add(phase.wrapping_mul(2)) as i32) / PER_RADIAN;
                    assert!(
                        azimuth.abs() > reach || inside(i),
                        "n_rays {n_rays}, phase {phase}, {azimuth} {reach}"
                    );
                }
            }
        }
    }
}
