//! Particle paths: deterministic drift by flow, settling and forces, Brownian motion, and streaks during an
//! exposure.
//!
//! Brownian motion during an exposure is a part of the motion between frames: a step to the next frame
//! continues from the end of the exposure, goes to the opening of the next one, and from there through the
//! parts of its first half. Each point of a streak is the mean over a part of the exposure, not the place in
//! its middle, so that for any number of points the center of an image has the variance D T / 6 about the
//! position in the middle of an exposure T. Displacements of centers then have the variance 2 D (dt - T/3), as
//! in a camera, and positions 2 D dt. Only the first half of the first
//! exposure of a particle is a random walk backward in time from the middle of the exposure, which has the
//! same statistics.

use crate::integrate::advance;
use crate::near_walls::NearWalls;
use crate::orientation::carry;
use crate::{Brownian, Result, Scene, Shutter, Streak, StreakPoint, Tracer, VelocityField};
use glam::DVec3;
use microsig_core::stream::{Purpose, Stream, Streams};

/// Largest angle (rad) by which the axis of a settling spheroid may turn in one piece of a path, whose
/// settling velocity follows from the mid-piece orientation: the relative error of the settling velocity is
/// below 1e-4.
const TURN_PER_PIECE: f64 = 0.05;
/// Maximum number of pieces of one drift.
const MAX_PIECES: f64 = 1000.0;

/// Position (um) and orientation (unit vector along the symmetry axis) of a particle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Pose {
    pub(crate) position: DVec3,
    pub(crate) axis: DVec3,
}

/// The first half of the exposure of a frame, as a particle has moved through it.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Approach {
    /// Points of the streak before the middle of the exposure, in order of time.
    points: Vec<StreakPoint>,
    /// Number of points per flash.
    count: u32,
}

impl Approach {
    /// The same moved by `shift` (um).
    pub(crate) fn moved(mut self, shift: DVec3) -> Self {
        if shift != DVec3::ZERO {
            self.points.iter_mut().for_each(|point| point.position += shift);
        }
        self
    }
}

impl Pose {
    fn halfway_to(&self, other: &Pose) -> Pose {
        Pose {
            position: 0.5 * (self.position + other.position),
            axis: (self.axis + other.axis).try_normalize().unwrap_or(other.axis),
        }
    }
}

impl From<&StreakPoint> for Pose {
    fn from(point: &StreakPoint) -> Pose {
        Pose { position: point.position, axis: point.axis }
    }
}

impl From<Pose> for StreakPoint {
    fn from(pose: Pose) -> StreakPoint {
        StreakPoint { position: pose.position, axis: pose.axis }
    }
}

impl From<&Tracer> for Pose {
    fn from(tracer: &Tracer) -> Pose {
        Pose { position: tracer.position, axis: tracer.axis }
    }
}

impl Scene<'_> {
    /// Velocity (um/s) at the mid-time of a tracer that is in the frame at `t0` (s), the next frame being at
    /// `t1` (s): on its deterministic path by flow, settling and forces, without Brownian motion.
    pub fn velocity_at_mid_time(&self, tracer: &Tracer, t0: f64, t1: f64) -> Result<DVec3> {
        let middle = f64::midpoint(t0, t1);
        let there = self.drift(tracer.into(), tracer.d_um, (t0, middle))?;
        Ok(self.drifting(tracer.d_um, there.axis).velocity(there.position, middle))
    }

    /// The pose at `t1` (s, earlier or later) of a particle that flow, settling and forces move from `from`
    /// at `t0` (s), without Brownian motion.
    pub(crate) fn drift(&self, from: Pose, d_um: f64, (t0, t1): (f64, f64)) -> Result<Pose> {
        let (radius, aspect) = (0.5 * d_um, self.friction.aspect);
        let field = self.drifting(d_um, from.axis);
        if self.friction.is_sphere() || self.settling.is_none() {
            let position = self.hold(advance(&field, from.position, t0, t1)?, t1, radius);
            let axis = if self.friction.is_sphere() {
                from.axis
            } else {
                carry(&field, from.position, from.axis, aspect, t0, t1)?
            };
            return Ok(Pose { position, axis });
        }
        // The settling velocity turns with the axis.
        let gradient = field.gradient(from.position, t0);
        let rate = (0..3).map(|i| gradient.col(i).length_squared()).sum::<f64>();
        let pieces = libm::ceil(libm::sqrt(rate) * (t1 - t0).abs() / TURN_PER_PIECE).clamp(1.0, MAX_PIECES);
        let mut at = from;
        for piece in 0..pieces as u32 {
            let time = |i: f64| t0 + (t1 - t0) * ((f64::from(piece) + i) / pieces);
            let (start, middle, end) = (time(0.0), time(0.5), time(1.0));
            let axis = carry(&field, at.position, at.axis, aspect, start, middle)?;
            let field = self.drifting(d_um, axis);
            let axis = carry(&field, at.position, at.axis, aspect, start, end)?;
            at = Pose { position: self.hold(advance(&field, at.position, start, end)?, end, radius), axis };
        }
        Ok(at)
    }

    /// The pose at `t1` (s, earlier or later) of a particle that starts at `t0` (s), with drift and Brownian
    /// motion.
    pub(crate) fn brownian_path(
        &self,
        brownian: &Brownian,
        from: Pose,
        d_um: f64,
        (t0, t1): (f64, f64),
        stream: &mut Stream,
    ) -> Result<Pose> {
        if t0 == t1 {
            return Ok(from);
        }
        let steps = brownian.substeps;
        let at = |half: u32| t0 + (t1 - t0) * f64::from(half) / f64::from(2 * steps);
        let dt = (t1 - t0) / f64::from(steps);
        (0..steps).try_fold(from, |pose, k| {
            let times = [0, 1, 2].map(|half| at(2 * k + half));
            let [_, _, end] = self.brownian_step(brownian, pose, d_um, (times, dt), stream)?;
            Ok(end)
        })
    }

    /// A step of drift and Brownian motion between the first and the last of three times, `dt` (s) apart: the
    /// poses in its middle before and after the Brownian motion, and at its end.
    fn brownian_step(
        &self,
        brownian: &Brownian,
        from: Pose,
        d_um: f64,
        ([start, middle, end], dt): ([f64; 3], f64),
        stream: &mut Stream,
    ) -> Result<[Pose; 3]> {
        // Heavy spheres for which walls that slow them would need too many steps settle between the steps.
        let too_many =
            |walls: NearWalls<'_>| walls.forced_steps(brownian.diffusion(d_um), dt.abs()).is_none();
        let heavy = self.pulling_walls(brownian, d_um, dt).is_some_and(too_many);
        let (flow, settling_s) = if heavy { (*self, 0.0) } else { (self.without_settling(), dt) };
        let before = flow.drift(from, d_um, (start, middle))?;
        let after = self.diffuse(brownian, before, d_um, middle, (dt.abs(), settling_s), stream);
        Ok([before, after, flow.drift(after, d_um, (middle, end))?])
    }

    /// A Brownian step from `t0` to `t1` (s): the mean pose over it, and that at its end. Given the ends of a
    /// Brownian path, its mean has a twelfth of the variance of the way.
    fn mean_and_end(
        &self,
        brownian: &Brownian,
        from: Pose,
        d_um: f64,
        (t0, t1): (f64, f64),
        stream: &mut Stream,
    ) -> Result<(Pose, Pose)> {
        if t0 == t1 {
            return Ok((from, from));
        }
        let (middle, dt) = (f64::midpoint(t0, t1), t1 - t0);
        let [before, after, end] =
            self.brownian_step(brownian, from, d_um, ([t0, middle, t1], dt), stream)?;
        let mean = before.halfway_to(&after);
        let position = self.diffuse(brownian, mean, d_um, middle, (dt.abs() / 12.0, 0.0), stream).position;
        Ok((Pose { position, ..mean }, end))
    }

    /// Walls that slow spheres of diameter `d_um` (um), which settle forward in time or, if `dt` < 0,
    /// backward; `None` if walls do not slow them.
    fn pulling_walls(&self, brownian: &Brownian, d_um: f64, dt: f64) -> Option<NearWalls<'_>> {
        let mut walls = self.slowing_walls(d_um)?;
        let slip = self.settling.filter(|_| dt != 0.0).map(|s| s.velocity(d_um, &self.friction, DVec3::Y));
        walls.pull = slip.unwrap_or_default() * (dt.signum() / brownian.diffusion(d_um));
        Some(walls)
    }

    /// The pose after a Brownian step over a time `h` (s, > 0) and settling over a time `settling_s` (s, of
    /// any sign) at `t` (s): half the rotation, the translation, half the rotation.
    fn diffuse(
        &self,
        brownian: &Brownian,
        mut pose: Pose,
        d_um: f64,
        t: f64,
        (h, settling_s): (f64, f64),
        stream: &mut Stream,
    ) -> Pose {
        let (radius, friction) = (0.5 * d_um, &self.friction);
        if let Some(walls) = self.pulling_walls(brownian, d_um, settling_s) {
            pose.position = walls.diffuse(brownian.diffusion(d_um), pose.position, t, h, stream);
            return pose;
        }
        if !friction.is_sphere() {
            pose.axis = brownian.random_rotation(pose.axis, d_um, friction, 0.5 * h, stream);
        }
        let (from, axis, fluid) = (pose.position, pose.axis, self.fluid());
        let mut end = from + brownian.random_displacement(d_um, friction, axis, h, stream);
        if let Some(settling) = self.settling.filter(|_| settling_s != 0.0) {
            end += settling.velocity(d_um, friction, axis) * settling_s;
            let variance = |n: DVec3| brownian.variance(d_um, friction, (axis, n), h);
            end = fluid.settle((from, end), t, radius, variance, stream);
        }
        pose.position = self.hold(fluid.reflect(from, end, t, radius), t, radius);
        if !friction.is_sphere() {
            pose.axis = brownian.random_rotation(pose.axis, d_um, friction, 0.5 * h, stream);
        }
        pose
    }

    /// The pose of a tracer at `t1` (s), the time of the next frame, after Brownian motion since the exposure
    /// of the frame at `t0` (s), of which `streak` is its image; and the first half of its next exposure.
    pub(crate) fn brownian_path_between(
        &self,
        brownian: &Brownian,
        (tracer, streak): (&Tracer, &Streak),
        shutter: &Shutter,
        (t0, t1): (f64, f64),
        stream: &mut Stream,
    ) -> Result<(Pose, Approach)> {
        let d_um = tracer.d_um;
        let (at, t) = (Pose::from(&streak.closing), t0 + 0.5 * shutter.span_s());
        let opening = t1 - 0.5 * shutter.span_s();
        let at = self.brownian_path(brownian, at, d_um, (t, opening), stream)?;
        let middle = self.drift(at, d_um, (opening, t1))?;
        let last = self.drift(middle, d_um, (t1, t1 + 0.5 * shutter.span_s()))?;
        let places = [at.position, middle.position, last.position];
        let count = shutter.points(self.path_in_image(places, d_um, shutter));
        let parts = shutter.parts_s(count);
        let before = parts[..parts.len() / 2].iter().copied();
        let (points, at) = self.expose_parts(brownian, at, d_um, (t1, opening), before, stream)?;
        Ok((at, Approach { points, count }))
    }

    /// The mean poses over parts of the exposure centered on `t_s` (s), in the order in which a diffusing
    /// particle that is at `from` at `t` (s) moves through them, and its pose at the end of the last.
    fn expose_parts(
        &self,
        brownian: &Brownian,
        from: Pose,
        d_um: f64,
        (t_s, mut t): (f64, f64),
        parts: impl Iterator<Item = (f64, f64)>,
        stream: &mut Stream,
    ) -> Result<(Vec<StreakPoint>, Pose)> {
        let (mut at, mut points) = (from, Vec::new());
        for (start, end) in parts {
            // Between flashes.
            (_, at) = self.mean_and_end(brownian, at, d_um, (t, t_s + start), stream)?;
            t = t_s + end;
            let (mean, end) = self.mean_and_end(brownian, at, d_um, (t_s + start, t), stream)?;
            points.push(mean.into());
            at = end;
        }
        Ok((points, at))
    }

    /// Length (um) in the image plane of a path over three places during an exposure, with twice the standard
    /// deviation of the Brownian displacement.
    fn path_in_image(&self, [first, middle, last]: [DVec3; 3], d_um: f64, shutter: &Shutter) -> f64 {
        let flat = |way: DVec3| way.truncate().length();
        let noise =
            self.brownian.map_or(0.0, |b| 2.0 * libm::sqrt(2.0 * b.diffusion(d_um) * shutter.span_s()));
        flat(middle - first) + flat(last - middle) + noise
    }

    /// The streak of a tracer in frame number `frame`, whose exposure is centered on `t_s` (s), and its mean
    /// velocity (um/s) over the exposure. `approach` is its first half, if the tracer comes from a frame
    /// before.
    pub(crate) fn streak(
        &self,
        (tracer, approach): (&Tracer, Option<&Approach>),
        shutter: &Shutter,
        (frame, t_s): (u32, f64),
        streams: Streams,
    ) -> Result<(Streak, DVec3)> {
        let span = shutter.span_s();
        let middle = Pose::from(tracer);
        let first = self.drift(middle, tracer.d_um, (t_s, t_s - 0.5 * span))?.position;
        let last = self.drift(middle, tracer.d_um, (t_s, t_s + 0.5 * span))?.position;
        let path = self.path_in_image([first, tracer.position, last], tracer.d_um, shutter);
        let points = approach.map_or_else(|| shutter.points(path), |approach| approach.count);
        let share = 1.0 / f64::from(points);
        let velocity = (last - first) / span;
        let Some(brownian) = &self.brownian else {
            let offsets = shutter.offsets_s(points);
            let middle_point = StreakPoint::from(middle);
            let mut streak = vec![middle_point; offsets.len()];
            let later = offsets.partition_point(|offset| *offset < 0.0);
            let mut fill = |order: &mut dyn Iterator<Item = usize>| -> Result<()> {
                let (mut at, mut t) = (middle, t_s);
                for i in order {
                    at = self.drift(at, tracer.d_um, (t, t_s + offsets[i]))?;
                    streak[i] = at.into();
                    t = t_s + offsets[i];
                }
                Ok(())
            };
            fill(&mut (later..offsets.len()))?;
            fill(&mut (0..later).rev())?;
            return Ok((Streak { points: streak, share, closing: middle_point }, velocity));
        };
        let mut stream = streams.stream(Purpose::Exposure, frame, tracer.id as u32);
        let parts = shutter.parts_s(points);
        let later = parts.len() / 2;
        let mut expose = |parts: &mut dyn Iterator<Item = (f64, f64)>| {
            self.expose_parts(brownian, middle, tracer.d_um, (t_s, t_s), parts, &mut stream)
        };
        let (after, closing) = expose(&mut parts[later..].iter().copied())?;
        let mut streak = match approach {
            Some(approach) => approach.points.clone(),
            None => {
                let (mut before, _) = expose(&mut parts[..later].iter().rev().map(|(a, b)| (*b, *a)))?;
                before.reverse();
                before
            }
        };
        let mut after = after.into_iter();
        if shutter.splits(points)
            && let (Some(before), Some(after)) = (streak.last_mut(), after.next())
        {
            // The halves of the part that contains the middle.
            *before = Pose::from(&*before).halfway_to(&Pose::from(&after)).into();
        }
        streak.extend(after);
        Ok((Streak { points: streak, share, closing: closing.into() }, velocity))
    }
}
