//! Particle paths: deterministic drift by flow, settling and forces, Brownian motion, and streaks during an
//! exposure.
//!
//! Brownian motion during an exposure is a part of the motion between frames: a step to the next frame
//! continues from the last point of the streak, goes to the opening of the next exposure, and from there over
//! the points of its first half. Displacements of the centers of images then have the variance 2 D (dt - T/3)
//! for an exposure T, as in a camera, and those of the positions 2 D dt. Only the first half of the first
//! exposure of a particle is a random walk backward in time from the middle of the exposure, which has the
//! same statistics.

use crate::brownian::Brownian;
use crate::error::Result;
use crate::exposure::Shutter;
use crate::field::VelocityField;
use crate::frame::{Streak, StreakPoint, Tracer};
use crate::integrate::advance;
use crate::orientation::carry;
use crate::scene::Scene;
use glam::DVec3;
use microsig_core::stream::{Purpose, Stream, Streams};

/// Largest angle (rad) by which the axis of a settling spheroid may turn in one piece of a path, whose
/// settling velocity is that of the mid-piece orientation: the relative error of the settling velocity is
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

impl From<&StreakPoint> for Pose {
    fn from(point: &StreakPoint) -> Pose {
        Pose { position: point.position, axis: point.axis }
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
        let steps = brownian.substeps();
        let at = |half: u32| t0 + (t1 - t0) * f64::from(half) / f64::from(2 * steps);
        let h = (t1 - t0).abs() / f64::from(steps);
        let mut pose = from;
        for k in 0..steps {
            let (start, middle, end) = (at(2 * k), at(2 * k + 1), at(2 * k + 2));
            pose = self.drift(pose, d_um, (start, middle))?;
            pose = self.diffuse(brownian, pose, d_um, middle, h, stream);
            pose = self.drift(pose, d_um, (middle, end))?;
        }
        Ok(pose)
    }

    /// The pose after a Brownian step over a time `h` (s, > 0) at `t` (s): half the rotation, the
    /// translation, half the rotation.
    fn diffuse(
        &self,
        brownian: &Brownian,
        mut pose: Pose,
        d_um: f64,
        t: f64,
        h: f64,
        stream: &mut Stream,
    ) -> Pose {
        let (radius, friction) = (0.5 * d_um, &self.friction);
        if let Some(walls) = self.slowing_walls(d_um) {
            pose.position = walls.diffuse(brownian.diffusion(d_um), pose.position, t, h, stream);
            return pose;
        }
        if !friction.is_sphere() {
            pose.axis = brownian.random_rotation(pose.axis, d_um, friction, 0.5 * h, stream);
        }
        let kicked = pose.position + brownian.random_displacement(d_um, friction, pose.axis, h, stream);
        pose.position = self.hold(self.fluid().reflect(pose.position, kicked, t, radius), t, radius);
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
        let offsets = shutter.offsets_s(shutter.count_in(streak));
        let (mut at, mut t) = (Pose::from(tracer), t0);
        if let (Some(point), Some(offset)) = (streak.points.last(), offsets.last()) {
            (at, t) = (point.into(), t0 + offset);
        }
        let opening = t1 - 0.5 * shutter.span_s();
        at = self.brownian_path(brownian, at, d_um, (t, opening), stream)?;
        let middle = self.drift(at, d_um, (opening, t1))?;
        let last = self.drift(middle, d_um, (t1, t1 + 0.5 * shutter.span_s()))?;
        let places = [at.position, middle.position, last.position];
        let count = shutter.points(self.path_in_image(places, d_um, shutter));
        let (mut points, mut t) = (Vec::new(), opening);
        for offset in shutter.offsets_s(count).into_iter().filter(|offset| *offset < 0.0) {
            at = self.walk(at, d_um, (t, t1 + offset), stream)?;
            points.push(StreakPoint { position: at.position, axis: at.axis });
            t = t1 + offset;
        }
        Ok((self.walk(at, d_um, (t, t1), stream)?, Approach { points, count }))
    }

    /// The pose at `t1` (s, earlier or later) after one step of drift and Brownian motion.
    fn walk(&self, from: Pose, d_um: f64, (t0, t1): (f64, f64), stream: &mut Stream) -> Result<Pose> {
        let (at, h) = (self.drift(from, d_um, (t0, t1))?, (t1 - t0).abs());
        Ok(match self.brownian.as_ref().filter(|_| h > 0.0) {
            Some(brownian) => self.diffuse(brownian, at, d_um, t1, h, stream),
            None => at,
        })
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
        let offsets = shutter.offsets_s(points);

        let mut stream = streams.stream(Purpose::Exposure, frame, tracer.id as u32);
        let mut streak = vec![StreakPoint { position: middle.position, axis: middle.axis }; offsets.len()];
        let later = offsets.partition_point(|offset| *offset < 0.0);
        let mut fill = |order: &mut dyn Iterator<Item = usize>| -> Result<()> {
            let (mut at, mut t) = (middle, t_s);
            for i in order {
                at = self.walk(at, tracer.d_um, (t, t_s + offsets[i]), &mut stream)?;
                streak[i] = StreakPoint { position: at.position, axis: at.axis };
                t = t_s + offsets[i];
            }
            Ok(())
        };
        fill(&mut (later..offsets.len()))?;
        match approach {
            Some(approach) => streak[..later].clone_from_slice(&approach.points),
            None => fill(&mut (0..later).rev())?,
        }
        Ok((Streak { points: streak, share: 1.0 / f64::from(points) }, (last - first) / span))
    }
}
