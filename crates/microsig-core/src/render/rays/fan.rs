//! The directions of a ray fan, and for each direction the rotation angles of the fan for which it can pass
//! the aperture.
//!
//! A direction rotated by an angle has the depth component |s cos(A)|, where A is its azimuth plus the angle,
//! and the slopes p_x = tan(A) (up to sign) and p_y = c / |s cos(A)|, where c is its polar cosine and s^2 =
//! 1 - c^2. From a point within r of the axis at a distance L from the lens, it can pass an aperture of
//! radius a only if L |p| <= a + r, that is if
//!
//! tan(A)^2 <= (m^2 - k^2) / (1 + k^2),   m = (a + r) / L,   k = c / s.
//!
//! Azimuths modulo pi are stored as 32-bit fractions of a half turn, so that sums wrap around. The selection
//! is conservative: rejected rays miss the aperture with certainty, and the others are tested by the kernel.

use crate::emission;

/// The directions of a fan before its random rotation.
#[derive(Debug, Clone)]
pub(super) struct RayFan {
    directions: Vec<Direction>,
}

#[derive(Debug, Clone, Copy)]
struct Direction {
    components: [f32; 3],
    /// Azimuth modulo pi, 2^32 per half turn.
    azimuth: u32,
    /// Square of the polar cosine over the polar sine.
    slope2: f64,
}

/// A direction and the range of rotation angles, modulo pi, for which it can pass the aperture.
#[derive(Debug, Clone, Copy)]
pub(super) struct Candidate {
    pub(super) direction: [f32; 3],
    /// Center of the range, 2^32 per half turn.
    pub(super) center: u32,
    /// Half width of the range, 2^32 per half turn; from 2^31 on it includes all angles.
    pub(super) reach: u32,
}

/// 2^32 / pi, the conversion from rad to 32-bit fractions of a half turn.
const PER_RADIAN: f64 = 4_294_967_296.0 / std::f64::consts::PI;

impl RayFan {
    pub(super) fn new(n_rays: u32) -> Self {
        let direction = |[d1, d2, d3]: [f64; 3]| {
            let azimuth = libm::atan2(d2, d1);
            let half_turn = if azimuth < 0.0 { azimuth + std::f64::consts::PI } else { azimuth };
            Direction {
                components: [d1 as f32, d2 as f32, d3 as f32],
                // `as` saturates at 2^32 - 1, one part in 2^32 away from the wrapped zero.
                azimuth: (half_turn * PER_RADIAN) as u32,
                slope2: d3 * d3 / (d1 * d1 + d2 * d2),
            }
        };
        let mut directions: Vec<Direction> = emission::fan(n_rays).map(direction).collect();
        // Directions with similar azimuths use nearly the same source points, which then stay in the L1
        // cache.
        directions.sort_by_key(|d| d.azimuth);
        RayFan { directions }
    }

    /// The directions that can have a slope of at most `max_slope` after a rotation.
    pub(super) fn candidates(&self, max_slope: f64) -> impl Iterator<Item = Candidate> {
        // The margins cover the rounding errors of f32 in the kernel.
        let max_slope = max_slope * (1.0 + 1e-5);
        let max_slope2 = max_slope * max_slope;
        self.directions.iter().filter(move |d| d.slope2 <= max_slope2).map(move |d| {
            let tangent = libm::sqrt((max_slope2 - d.slope2) / (1.0 + d.slope2));
            Candidate {
                direction: d.components,
                center: d.azimuth.wrapping_neg(),
                reach: ((angle_above(tangent) + 2e-6) * PER_RADIAN) as u32,
            }
        })
    }
}

/// A tight upper bound of the arctangent of `t` >= 0, close for small t: the third convergent of its
/// continued fraction (Abramowitz and Stegun 4.4.43); odd convergents are above, even ones below.
fn angle_above(t: f64) -> f64 {
    t * (15.0 + 4.0 * t * t) / (15.0 + 9.0 * t * t)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_convergent_lies_above_the_arctangent() {
        for i in 1..10_000 {
            let t = 0.01 * f64::from(i);
            let excess = angle_above(t) / libm::atan(t) - 1.0;
            assert!(excess > -1e-15 && (t > 0.5 || excess < 1e-3), "{t}: {excess}");
        }
    }

    /// Every direction whose slope is below the limit for some rotation angle is a candidate at that angle.
    #[test]
    fn candidates_hold_all_that_can_arrive() {
        for (n_rays, max_slope) in [(1, 0.3), (7, 2.0), (100, 0.35), (500, 0.05), (500, 30.0)] {
            let fan = RayFan::new(n_rays);
            let candidates: Vec<Candidate> = fan.candidates(max_slope).collect();
            let mut arrived = 0;
            for step in 0..500u32 {
                let phase = step.wrapping_mul(0x9E37_79B9);
                let (sine, cosine) = libm::sincos(2.0 * f64::from(phase) / PER_RADIAN);
                for [d1, d2, d3] in emission::fan(n_rays) {
                    let (toward_lens, across) = ((d1 * cosine - d2 * sine).abs(), d1 * sine + d2 * cosine);
                    if libm::sqrt(across * across + d3 * d3) > max_slope * toward_lens {
                        continue;
                    }
                    arrived += 1;
                    let direction = [d1 as f32, d2 as f32, d3 as f32];
                    let found = candidates.iter().find(|c| c.direction == direction).unwrap();
                    let off = phase.wrapping_mul(2).wrapping_sub(found.center) as i32;
                    assert!(off.unsigned_abs() <= found.reach, "n_rays {n_rays}, phase {phase}, {off}");
                }
            }
            assert!(arrived > 0, "n_rays {n_rays}");
        }
    }
}
