//! Errors of displacements, velocities and accelerations.
//!
//! Displacements are compared over correct links, so both sides are the same finite difference. Velocities
//! are those reported by the result, or else derived from its positions and the times of frames: at an
//! interior point the slope of the parabola through it and its two neighbors, at the ends of tracks the slope
//! of the straight line. They are compared with the exact velocity of the flow. Accelerations are second
//! differences, compared with second differences of the truth.

use std::borrow::Cow;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::links::{correct_links, successors};
use super::matching::{Matching, NONE};
use super::statistics::{Errors, ratio};
use super::track_set::TrackSet;
use super::truth::{TrueParticles, same_time};
use crate::results::{Points, VelocityUnit};

/// Where velocities come from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum VelocitySource {
    /// Reported by the result.
    Result,
    /// Finite differences of positions.
    Positions,
    /// Finite differences where the result reports none.
    Both,
}

scores! {
    /// Errors of displacements, velocities and accelerations.
    pub struct Motion {
        /// RMS error of the displacement in the image plane, over correct links.
        not_negative displacement_rms_px: Option<f64>,
        /// Mean error of the displacement in x, over correct links.
        pub displacement_bias_x_px: Option<f64>,
        /// Mean error of the displacement in y, over correct links.
        pub displacement_bias_y_px: Option<f64>,
        /// RMS error of the displacement in z, over correct links.
        not_negative displacement_rms_z_um: Option<f64>,
        /// Source of the velocities: `result` (reported by the result), `positions` (finite differences of its
        /// positions), or `both` (finite differences where the result reports none).
        pub velocity_from: Option<VelocitySource>,
        /// RMS error of the in-plane velocity against the exact velocity of the flow, over matched points.
        not_negative velocity_rms_um_s: Option<f64>,
        /// velocity_rms_um_s over the RMS of the true in-plane velocity.
        not_negative velocity_rms_relative: Option<f64>,
        /// RMS error of the velocity in z, over matched points.
        not_negative velocity_rms_z_um_s: Option<f64>,
        /// RMS error of the in-plane acceleration, from second differences of result and truth.
        not_negative acceleration_rms_um_s2: Option<f64>,
        /// The same in px per frame^2; null if the time steps differ.
        not_negative acceleration_rms_px: Option<f64>,
        /// RMS error of the acceleration over the RMS of the true acceleration.
        not_negative acceleration_rms_relative: Option<f64>,
    }
}

/// Quantities whose errors are summed, in the order of [`Sums`].
#[derive(Debug, Clone, Copy)]
pub(super) enum MotionQuantity {
    Displacement,
    Velocity,
    /// px per frame^2
    Bend,
    /// um/s^2
    Acceleration,
}

/// For every true point and [`MotionQuantity`]: number of errors and sum of their squares.
pub(super) type Sums = Vec<[[f64; 2]; 4]>;

/// The velocities reported by a result, um/s, one per row; `None` if it reports none.
pub fn reported<'a>(
    truth: &TrueParticles,
    points: &'a Points,
) -> Result<Option<Cow<'a, [[f64; 3]]>>, String> {
    let Some(velocities) = &points.velocities else { return Ok(None) };
    if velocities.unit == VelocityUnit::UmPerS {
        return Ok(Some(Cow::Borrowed(&velocities.rows)));
    }
    let derived = "so velocities are derived from positions";
    let um_per_px = truth.facts.um_per_px.ok_or_else(|| format!("um per px is unknown, {derived}"))?;
    let step_s = truth.step_s().ok_or_else(|| {
        format!(
            "the time between frames varies or is unknown, {derived}; columns u_um_s, v_um_s, w_um_s are read as um/s"
        )
    })?;
    let in_um_s = |velocity: &[f64; 3]| {
        let [u, v, w] = truth.facts.unstretched(*velocity);
        [u * um_per_px / step_s, v * um_per_px / step_s, w / step_s]
    };
    Ok(Some(Cow::Owned(velocities.rows.iter().map(in_um_s).collect())))
}

/// Velocity along x of every result point, um/s, as reported or from differences of positions; NaN for ghosts
/// and where it is undefined.
pub fn found_u(
    truth: &TrueParticles,
    clouds: (&TrackSet, &TrackSet),
    matching: &Matching,
    reported: Option<&[[f64; 3]]>,
) -> Vec<f64> {
    let compared = TrackComparison { truth, clouds, matching, depth: false, reported };
    let r = clouds.1;
    let mut u = vec![f64::NAN; r.len()];
    for track in 0..r.n_tracks() {
        let points = r.track(track);
        for (k, &i) in points.iter().enumerate().filter(|(_, i)| matching.truth_for[**i as usize] != NONE) {
            u[i as usize] = compared.velocity(points, k).map_or(f64::NAN, |(v, _)| v[0]);
        }
    }
    u
}

/// A matched result and its truth.
pub(super) struct TrackComparison<'a> {
    pub(super) truth: &'a TrueParticles,
    pub(super) clouds: (&'a TrackSet, &'a TrackSet),
    pub(super) matching: &'a Matching,
    /// Whether z is scored.
    pub(super) depth: bool,
    /// Velocities of the rows of the result, um/s.
    pub(super) reported: Option<&'a [[f64; 3]]>,
}

impl TrackComparison<'_> {
    /// All errors, and their sums for each true point.
    pub(super) fn motion(&self) -> (Motion, Sums) {
        let (mut motion, mut sums) = (Motion::default(), vec![Default::default(); self.clouds.0.len()]);
        let next = successors(self.clouds.0);
        self.displacements(&next, &mut motion, &mut sums);
        self.velocities(&mut motion, &mut sums);
        self.accelerations(&next, &mut motion, &mut sums);
        (motion, sums)
    }

    fn displacements(&self, next: &[u32], motion: &mut Motion, sums: &mut [[[f64; 2]; 4]]) {
        let (t, r) = self.clouds;
        let mut errors: Vec<[f64; 3]> = Vec::new();
        for ((ta, tb), (ra, rb)) in correct_links(r, self.matching, next) {
            let error = minus(moved(r, ra, rb), moved(t, ta, tb));
            add(sums, ta, MotionQuantity::Displacement, &error);
            errors.push(error);
        }
        let axis = |k: usize| Errors::of(errors.iter().map(move |e| e[k]));
        let (x, y) = (axis(0), axis(1));
        motion.displacement_rms_px = x.rms.zip(y.rms).map(|(x, y)| (x * x + y * y).sqrt());
        (motion.displacement_bias_x_px, motion.displacement_bias_y_px) = (x.bias, y.bias);
        motion.displacement_rms_z_um = axis(2).rms.filter(|_| self.depth);
    }

    fn velocities(&self, motion: &mut Motion, sums: &mut [[[f64; 2]; 4]]) {
        let (t, r) = self.clouds;
        if self.truth.velocity_um_s.is_empty() {
            return;
        }
        let (mut speed, mut upward) = (Total::default(), Vec::new());
        let mut is_from = [false; 2];
        for track in 0..r.n_tracks() {
            let points = r.track(track);
            for (k, &i) in points.iter().enumerate() {
                let of = self.matching.truth_for[i as usize];
                if of == NONE {
                    continue;
                }
                let exact = self.truth.velocity_um_s[t.points[of as usize].source as usize];
                let Some((found, is_reported)) = self.velocity(points, k) else { continue };
                let error = minus(found, exact);
                if error[0].is_finite() && error[1].is_finite() {
                    is_from[usize::from(is_reported)] = true;
                    speed.add(error, exact);
                    add(sums, of as usize, MotionQuantity::Velocity, &error);
                }
                upward.extend(Some(error[2]).filter(|w| w.is_finite()));
            }
        }
        (motion.velocity_rms_um_s, motion.velocity_rms_relative) = speed.rms();
        motion.velocity_rms_z_um_s = Errors::of(upward.iter().copied()).rms.filter(|_| self.depth);
        let from = match is_from {
            [true, true] => VelocitySource::Both,
            [_, true] => VelocitySource::Result,
            _ => VelocitySource::Positions,
        };
        motion.velocity_from = motion.velocity_rms_um_s.map(|_| from);
    }

    /// Velocity at point `k` of a track, um/s, and whether the result reports it. Where it reports none, the
    /// velocity is derived from its positions: a score over reported velocities only would favor a result
    /// that reports few.
    fn velocity(&self, points: &[u32], k: usize) -> Option<([f64; 3], bool)> {
        let source = self.clouds.1.points[points[k] as usize].source as usize;
        let reported =
            self.reported.map(|rows| rows[source]).filter(|v| v[0].is_finite() && v[1].is_finite());
        reported.map(|v| (v, true)).or_else(|| self.slope(points, k).map(|v| (v, false)))
    }

    /// Squared error of the in-plane velocity of every true particle; `None` for those that are missed or
    /// have no velocity.
    pub(super) fn squared_velocity_errors(&self) -> Vec<Option<f64>> {
        let (t, r) = self.clouds;
        let mut errors = vec![None; t.len()];
        for points in (0..r.n_tracks()).map(|track| r.track(track)) {
            for (k, &i) in points.iter().enumerate() {
                let of = self.matching.truth_for[i as usize];
                if of == NONE {
                    continue;
                }
                let exact = self.truth.velocity_um_s[t.points[of as usize].source as usize];
                let error = self.velocity(points, k).map(|(v, _)| minus(v, exact));
                errors[of as usize] = error.map(|e| e[0] * e[0] + e[1] * e[1]).filter(|e| e.is_finite());
            }
        }
        errors
    }

    /// Velocity at point `k` of a track from the positions of it and its neighbors, um/s.
    fn slope(&self, points: &[u32], k: usize) -> Option<[f64; 3]> {
        let (r, um_per_px) = (self.clouds.1, self.truth.facts.um_per_px?);
        let over = |a: u32, b: u32| {
            let s = self.truth.elapsed_s(r.points[a as usize].frame, r.points[b as usize].frame)?;
            Some((moved(r, a as usize, b as usize).map(|d| d / s), s))
        };
        let before = k.checked_sub(1).map(|b| over(points[b], points[k]));
        let after = points.get(k + 1).map(|&a| over(points[k], a));
        let slope = match (before, after) {
            (Some(before), Some(after)) => {
                let ((u, s), (v, t)) = (before?, after?);
                // Slope of the parabola through three points: the shorter interval has the larger weight.
                std::array::from_fn(|k| (u[k] * t + v[k] * s) / (s + t))
            }
            (one, other) => one.or(other)??.0,
        };
        let [x, y, z] = self.truth.facts.unstretched(slope);
        Some([x * um_per_px, y * um_per_px, z])
    }

    fn accelerations(&self, next: &[u32], motion: &mut Motion, sums: &mut [[[f64; 2]; 4]]) {
        let (t, r) = self.clouds;
        // Whether two result points follow one particle in consecutive frames.
        let joined = |a: u32, b: u32| {
            let of = |i: u32| self.matching.truth_for[i as usize];
            let is_next = of(a) != NONE && of(b) != NONE && next[of(a) as usize] == of(b);
            is_next && r.points[b as usize].frame - r.points[a as usize].frame == 1
        };
        let (mut bend, mut curve) = (Total::default(), Total::default());
        let (mut step, mut is_even) = (None, true);
        for track in 0..r.n_tracks() {
            for three in r.track(track).windows(3).filter(|w| joined(w[0], w[1]) && joined(w[1], w[2])) {
                let found = [0, 1, 2].map(|k| three[k] as usize);
                let exact = found.map(|i| self.matching.truth_for[i] as usize);
                let frame = found.map(|i| r.points[i].frame);
                let pair = |[s, t]: [f64; 2], of: (&TrackSet, [usize; 3])| {
                    let (a, b) = (moved(of.0, of.1[0], of.1[1]), moved(of.0, of.1[1], of.1[2]));
                    [0, 1, 2].map(|k| 2.0 * (b[k] / t - a[k] / s) / (s + t))
                };
                let facts = &self.truth.facts;
                let mut both = |steps: [f64; 2], total: &mut Total, kind: MotionQuantity, um: Option<f64>| {
                    let scaled = |px: [f64; 3]| um.map_or(px, |um| facts.unstretched(px).map(|v| v * um));
                    let expected = scaled(pair(steps, (t, exact)));
                    let error = minus(scaled(pair(steps, (r, found))), expected);
                    total.add(error, expected);
                    add(sums, exact[1], kind, &error);
                };
                both([1.0; 2], &mut bend, MotionQuantity::Bend, None);
                let elapsed = |a: usize, b: usize| self.truth.elapsed_s(frame[a], frame[b]);
                let Some((s, t)) = elapsed(0, 1).zip(elapsed(1, 2)) else { continue };
                let first = *step.get_or_insert(s);
                is_even &= same_time(s, first) && same_time(t, first);
                if facts.um_per_px.is_some() {
                    both([s, t], &mut curve, MotionQuantity::Acceleration, facts.um_per_px);
                }
            }
        }
        if !is_even {
            bend = Total::default();
            sums.iter_mut().for_each(|of_point| of_point[MotionQuantity::Bend as usize] = [0.0; 2]);
        }
        let ((in_um, relative), (in_px, relative_px)) = (curve.rms(), bend.rms());
        (motion.acceleration_rms_um_s2, motion.acceleration_rms_px) = (in_um, in_px);
        motion.acceleration_rms_relative = relative.or(relative_px);
    }
}

fn minus(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

fn moved(cloud: &TrackSet, a: usize, b: usize) -> [f64; 3] {
    let (p, q) = (&cloud.points[a].at, &cloud.points[b].at);
    [q.x_px - p.x_px, q.y_px - p.y_px, q.z_um - p.z_um]
}

/// Adds an error in the image plane.
fn add(sums: &mut [[[f64; 2]; 4]], point: usize, kind: MotionQuantity, error: &[f64; 3]) {
    let [n, squares] = &mut sums[point][kind as usize];
    *n += 1.0;
    *squares += error[0] * error[0] + error[1] * error[1];
}

/// Sums of squared in-plane errors and of squared in-plane true values.
#[derive(Default)]
struct Total {
    n: f64,
    errors: f64,
    exact: f64,
}

impl Total {
    fn add(&mut self, error: [f64; 3], exact: [f64; 3]) {
        self.n += 1.0;
        self.errors += error[0] * error[0] + error[1] * error[1];
        self.exact += exact[0] * exact[0] + exact[1] * exact[1];
    }

    fn rms(&self) -> (Option<f64>, Option<f64>) {
        (ratio(self.errors, self.n).map(f64::sqrt), ratio(self.errors, self.exact).map(f64::sqrt))
    }
}

#[cfg(test)]
mod tests {
    use super::super::truth::Region;
    use super::*;
    use crate::evaluate::gate::Gate;
    use crate::evaluate::matching::{Cost, optimal};
    use crate::results::{Position, TrackRow, Velocities};
    use storage::dataset::RecordingFacts;

    /// Scores a result at the true positions x = 100 + 1000 t + 50,000 t^2 px, at 2 um/px and t = 0, 2, 7, 9
    /// ms.
    fn burst(result: Points) -> (Motion, Option<String>) {
        let times = [0.0, 0.002, 0.007, 0.009];
        let rows: Vec<TrackRow> = (0..4u32)
            .zip(times)
            .map(|(frame, t)| {
                let x_px = 100.0 + 1000.0 * t + 50_000.0 * t * t;
                TrackRow { frame, track: 0, at: Position { x_px, y_px: 5.0, z_um: 0.0 } }
            })
            .collect();
        let truth = TrueParticles {
            facts: RecordingFacts { um_per_px: Some(2.0), dt_s: Some(0.002), ..RecordingFacts::default() },
            visible: vec![true; 4],
            velocity_um_s: times.map(|t| [2.0 * (1000.0 + 100_000.0 * t), 0.0, 0.0]).to_vec(),
            times_s: (0..4).zip(times).collect(),
            rows: rows.clone(),
            ..TrueParticles::default()
        };
        let points = Points { rows, ..result };
        let gate = Gate::radial(2.0);
        let scored = truth.scored(&points, &gate, true, Region::default()).unwrap();
        let matching = &optimal(&scored.truth, &scored.result, &gate, Cost::Squares).unwrap();
        let (reported, note) = match reported(&truth, &points) {
            Ok(velocities) => (velocities, None),
            Err(note) => (None, Some(note)),
        };
        let clouds = (&scored.truth, &scored.result);
        let compared =
            TrackComparison { truth: &truth, clouds, matching, depth: true, reported: reported.as_deref() };
        (compared.motion().0, note)
    }

    #[test]
    fn steps_of_unequal_length_are_taken_as_long_as_they_are() {
        let (motion, _) = burst(Points::default());
        // Exact at interior points; at both ends the error is half a step of 2 ms times 200,000 um/s^2.
        let expected = (2.0 * 200f64.powi(2) / 4.0).sqrt();
        assert!((motion.velocity_rms_um_s.unwrap() / expected - 1.0).abs() < 1e-9, "{motion:?}");
        assert_eq!((motion.acceleration_rms_um_s2, motion.acceleration_rms_px), (Some(0.0), None));
        assert_eq!(motion.velocity_from, Some(VelocitySource::Positions));
    }

    #[test]
    fn velocities_of_the_result_come_first_and_those_per_frame_need_frames_of_equal_length() {
        let all = |unit, v| Points {
            velocities: Some(Velocities { unit, rows: vec![[v, 0.0, f64::NAN]; 4] }),
            ..Points::default()
        };
        let (motion, note) = burst(all(VelocityUnit::UmPerS, 2000.0));
        // Errors of 0, 400, 1400 and 1800 um/s.
        let expected = (f64::from(400 * 400 + 1400 * 1400 + 1800 * 1800) / 4.0).sqrt();
        assert!((motion.velocity_rms_um_s.unwrap() / expected - 1.0).abs() < 1e-9, "{motion:?}");
        assert_eq!(
            (motion.velocity_from, motion.velocity_rms_z_um_s, note),
            (Some(VelocitySource::Result), None, None)
        );
        let (motion, note) = burst(all(VelocityUnit::PerFrame, 2.0));
        assert!(note.unwrap().contains("the time between frames varies"));
        assert_eq!(motion.velocity_from, Some(VelocitySource::Positions));
    }
}
