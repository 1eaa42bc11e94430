//! Finite exposure: what a particle leaves on the image while the shutter is open.
//!
//! The time of a frame is the middle of its exposure. Light is collected over [t - open/2, t + open/2]; with several flashes
//! a frame, over such an interval about each of them, and they lie symmetrically about the time of the frame. A moving
//! particle is drawn as K points a flash, at the middles of K equal parts of the interval, each with 1/K of the light of the
//! flash; K = ceil(path / piece), at most 64, so that neighbouring points are no farther apart than the piece, a quarter of
//! a pixel. The truth of a frame is the place of a particle in the middle of the exposure and its mean velocity over it,
//! without noise.
//!
//! Thermal motion during the exposure is a random walk from the middle outward in both directions, which is a Brownian
//! path seen from its middle; its noise is not that of the step to the next frame.

use crate::error::{Check, Result};
use crate::frame::Tracer;
use crate::integrate::advance;
use crate::orientation::carry;
use crate::sequence::Scene;
use glam::DVec3;
use microsig_core::stream::{Purpose, Streams};

const CHECK: Check = Check("exposure");

/// Most points of one flash.
const MAX_POINTS: f64 = 64.0;

/// Most flashes of one frame.
const MAX_FLASHES: u32 = 100;

/// When a frame collects light.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Shutter {
    open_s: f64,
    flashes: u32,
    spacing_s: f64,
    piece_um: f64,
}

/// The image of a particle that moves while the shutter is open.
#[derive(Debug, Clone, PartialEq)]
pub struct Streak {
    /// Its points in the order of time.
    pub points: Vec<StreakPoint>,
    /// Share of the light of one flash that each of them has.
    pub share: f64,
}

/// A point of a streak.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StreakPoint {
    /// Where the centre is, um.
    pub position: DVec3,
    /// Direction of the axis, of length 1.
    pub axis: DVec3,
}

impl Shutter {
    /// A shutter that is open for `open_s` (s, >= 0) in each of `flashes` flashes (1 to 100) that are `spacing_s` (s, > 0 if
    /// there are several, and no less than `open_s`) apart. Points of a streak are at most `piece_um` (> 0) apart.
    pub fn new(open_s: f64, flashes: u32, spacing_s: f64, piece_um: f64) -> Result<Self> {
        CHECK.not_negative("exposure_s", open_s)?;
        CHECK.positive("piece_um", piece_um)?;
        if !(1..=MAX_FLASHES).contains(&flashes) {
            return Err(CHECK.fault("flashes.count", flashes, "1 to 100"));
        }
        if flashes > 1 {
            CHECK.positive("flashes.spacing_s", spacing_s)?;
            if spacing_s < open_s {
                let allowed = format!("a time >= exposure_s = {open_s}: flashes do not overlap");
                return Err(CHECK.fault("flashes.spacing_s", spacing_s, &allowed));
            }
        }
        Ok(Shutter { open_s, flashes, spacing_s: if flashes > 1 { spacing_s } else { 0.0 }, piece_um })
    }

    /// From the first opening to the last closing, s.
    pub fn span_s(&self) -> f64 {
        self.open_s + f64::from(self.flashes - 1) * self.spacing_s
    }

    /// Points of one flash for a particle that covers `path_um` in the image plane during the whole span.
    fn points(&self, path_um: f64) -> u32 {
        let path = path_um * self.open_s / self.span_s();
        // Rounding must not turn a path of four pieces into five points. Also true for NaN, which ends elsewhere.
        libm::ceil(path / self.piece_um * (1.0 - 1e-12)).clamp(1.0, MAX_POINTS) as u32
    }

    /// Times of the points from the middle, s, ascending.
    fn offsets_s(&self, points: u32) -> Vec<f64> {
        let flash = |k: u32| (f64::from(k) - 0.5 * f64::from(self.flashes - 1)) * self.spacing_s;
        let within = |i: u32| ((f64::from(i) + 0.5) / f64::from(points) - 0.5) * self.open_s;
        (0..self.flashes).flat_map(|k| (0..points).map(move |i| flash(k) + within(i))).collect()
    }

    /// The streak of a particle that moves on a straight line, which recorded tracks are between their frames.
    pub(crate) fn straight(&self, tracer: &Tracer) -> Streak {
        let velocity = tracer.velocity.unwrap_or(DVec3::ZERO);
        let points = self.points(velocity.truncate().length() * self.span_s());
        let at =
            |offset: f64| StreakPoint { position: tracer.position + velocity * offset, axis: tracer.axis };
        Streak {
            points: self.offsets_s(points).into_iter().map(at).collect(),
            share: 1.0 / f64::from(points),
        }
    }
}

impl Scene<'_> {
    /// The streak of a tracer about the time `t_s` of the frame of number `frame`, and its mean velocity.
    pub(crate) fn streak(
        &self,
        tracer: &Tracer,
        shutter: &Shutter,
        (frame, t_s): (u32, f64),
        streams: Streams,
    ) -> Result<(Streak, DVec3)> {
        let (field, radius) = (self.drifting(tracer.d_um), 0.5 * tracer.d_um);
        let span = shutter.span_s();
        let carried = |from: StreakPoint, t0: f64, t1: f64| -> Result<StreakPoint> {
            let position = self.hold(advance(&field, from.position, t0, t1)?, t1, radius);
            let axis = match tracer.aspect {
                1.0 => from.axis,
                aspect => carry(&field, from.position, from.axis, aspect, t0, t1)?,
            };
            Ok(StreakPoint { position, axis })
        };
        let middle = StreakPoint { position: tracer.position, axis: tracer.axis };
        let first = carried(middle, t_s, t_s - 0.5 * span)?.position;
        let last = carried(middle, t_s, t_s + 0.5 * span)?.position;
        let flat = |way: DVec3| way.truncate().length();
        // Twice the standard deviation of the walk is seen as well.
        let noise = self.brownian.map_or(0.0, |b| 2.0 * libm::sqrt(2.0 * b.diffusion(tracer.d_um) * span));
        let path = flat(tracer.position - first) + flat(last - tracer.position) + noise;
        let points = shutter.points(path);
        let offsets = shutter.offsets_s(points);

        let mut stream = streams.stream(Purpose::Exposure, frame, tracer.id as u32);
        let mut streak = vec![middle; offsets.len()];
        let later = offsets.partition_point(|offset| *offset < 0.0);
        let orders: [&mut dyn Iterator<Item = usize>; 2] =
            [&mut (later..offsets.len()), &mut (0..later).rev()];
        for order in orders {
            let (mut at, mut t) = (middle, t_s);
            for i in order {
                let t_next = t_s + offsets[i];
                at = carried(at, t, t_next)?;
                let h = (t_next - t).abs();
                if let Some(brownian) = self.brownian.as_ref().filter(|_| h > 0.0) {
                    let kick = brownian.kick(tracer.d_um, h, &mut stream);
                    at.position = self.hold(self.domain.reflect(at.position + kick, radius), t_next, radius);
                    if tracer.aspect != 1.0 {
                        at.axis = brownian.turn(at.axis, tracer.d_um, h, &mut stream);
                    }
                }
                streak[i] = at;
                t = t_next;
            }
        }
        Ok((Streak { points: streak, share: 1.0 / f64::from(points) }, (last - first) / span))
    }
}
