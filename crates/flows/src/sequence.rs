//! A recording: the tracer cloud at each of a series of times.
//!
//! At the first time the domain is seeded. Each step then moves every tracer along its trajectory, removes
//! those that have left through an open face, and adds new ones by *backtracking*: a uniform Poisson process
//! is drawn in the part of the domain that can be reached from an open face within the step (closer to it
//! than maximum speed times dt), each candidate is traced back to the previous time, and kept if it was
//! outside the domain then. A divergence-free field maps a uniform Poisson process in all space onto itself;
//! the tracers that were inside and the candidates that were outside are the two parts of that process, so
//! the cloud in the domain stays uniform in any divergence-free flow. (Reinserting particles that left at
//! random positions on the inflow face would not: slow layers near walls would become denser, and fast layers
//! depleted.) Brownian motion, which also preserves a uniform cloud, is traced backward with random steps in
//! the same way. Candidates that would overlap a wall of the field or a body are discarded.
//!
//! A field with divergence does not keep a cloud uniform: along a path the density changes as exp(-integral
//! of div u dt), while new particles enter at the seeding density (see [`crate::divergence`]). Particles
//! also accumulate where a flow that is tangential at a wall, but not one radius away from it, presses them
//! against a body or a free surface.
//!
//! With a finite exposure, Brownian motion during it is a part of that between frames, so that it changes the
//! paths of diffusing tracers.
//!
//! Random streams: (`Seeding`, recording, 0) for the first cloud, (`Inflow`, later frame of the step, 0) for
//! each step, and for each tracer, addressed by the low 32 bits of its id, (`Brownian`, later frame, id),
//! (`Exposure`, frame, id), (`Orientation`, 0, id) and (`Intensity`, 0, id). A shorter run of the same
//! recording is therefore the beginning of a longer one, and the result does not depend on the number of
//! threads.

use crate::drift::Drifting;
use crate::error::{Error, ParameterCheck, Result};
use crate::field::VelocityField;
use crate::frame::{Displacement, Frame, RecordingStart, Streak, Tracer};
use crate::integrate::advance;
use crate::path::{Approach, Pose};
use crate::scene::Scene;
use crate::seeding::Seed;
use glam::DVec3;
use microsig_core::cancel::checkpoint;
use microsig_core::stream::{Purpose, Streams};
use rayon::prelude::*;

const CHECK: ParameterCheck = ParameterCheck("sequence");

/// Largest first id, 2^53: up to here integers are exact in f64, and so in every file format.
const MAX_FIRST_ID: u64 = 1 << 53;

/// Largest Brownian displacement considered for inflow, in standard deviations along one axis; the
/// probability of exceeding it is 1e-15.
const REACH_OF_NOISE: f64 = 8.0;

/// A tracer at its new position, and the first half of its exposure.
type Moved = (Tracer, Option<Approach>);

/// Tracers that keep their ids, and the first half of the exposure of each; empty if those are not parts of
/// Brownian paths.
#[derive(Default)]
struct Survivors {
    tracers: Vec<Tracer>,
    approaches: Vec<Approach>,
}

/// Minimum number of tracers per parallel task.
const TRACERS_PER_TASK: usize = 64;

impl<'a> Scene<'a> {
    /// The recording of this scene at the given times (s, increasing); two times give an image pair. `Err` if
    /// the times do not increase, or frame numbers or ids are out of range.
    pub fn record(&self, times_s: &[f64], streams: Streams, start: RecordingStart) -> Result<Sequence<'a>> {
        for (i, t) in times_s.iter().enumerate() {
            CHECK.finite("times_s", *t)?;
            if i > 0 && *t <= times_s[i - 1] {
                let allowed = format!("a time after the one before it, {}", times_s[i - 1]);
                return Err(CHECK.fault("times_s", t, &allowed));
            }
        }
        if times_s.len() as u64 > u64::from(u32::MAX - start.first_frame) {
            return Err(Error::Misuse(format!(
                "sequence: {} frames from frame {} are more than {}",
                times_s.len(),
                start.first_frame,
                u32::MAX
            )));
        }
        if start.first_id > MAX_FIRST_ID {
            return Err(CHECK.fault("first_id", start.first_id, "at most 2^53"));
        }
        let first_s = times_s.first().copied().unwrap_or(0.0);
        Ok(Sequence {
            // Walls of an unsteady field may have moved since t = 0.
            scene: if self.field.is_steady() { *self } else { self.seeded_at(first_s)? },
            times_s: times_s.to_vec(),
            streams,
            recording: start.recording,
            first_frame: start.first_frame,
            next_id: start.first_id,
            made: 0,
            latest: None,
            velocities: true,
        })
    }

    /// The tracers of `frame` that are still in the domain at `t1` (s), at their new positions, in two
    /// groups: those that keep their ids, and those that become new tracers because they have crossed a
    /// periodic face.
    fn survivors(
        &self,
        before: &Frame,
        t1: f64,
        streams: Streams,
        frame: u32,
    ) -> Result<(Survivors, Vec<Moved>)> {
        let (times, from) = ((before.t_s, t1), (frame, streams));
        let (mut tracers, halves) = if self.brownian.is_some() && self.shutter.is_some() {
            let streaks: Vec<_> = before.tracers.iter().zip(&before.streaks).collect();
            let moved = filtered_in_parallel(&streaks, |(tracer, streak)| {
                self.moved((tracer, Some(streak)), times, from)
            })?;
            moved.into_iter().unzip()
        } else {
            let tracers = filtered_in_parallel(&before.tracers, |tracer| {
                Ok(self.moved((tracer, None), times, from)?.map(|(tracer, _)| tracer))
            })?;
            (tracers, Vec::new())
        };
        // Usually all stay, and no tracer is moved in memory.
        let (mut wrapped, mut approaches) = (Vec::new(), Vec::new());
        let mut halves = halves.into_iter();
        tracers.retain(|tracer| {
            let (stays, approach) = (tracer.step.is_some(), halves.next().flatten());
            if stays {
                approaches.extend(approach);
            } else {
                wrapped.push((*tracer, approach));
            }
            stays
        });
        Ok((Survivors { tracers, approaches }, wrapped))
    }

    /// A tracer at its position at `t1` (s), without `step` if it becomes a new tracer; with the first half
    /// of its exposure there if `streak`, its image at `t0` (s), is given and it diffuses; `None` if it has
    /// left the domain.
    fn moved(
        &self,
        (tracer, streak): (&Tracer, Option<&Streak>),
        (t0, t1): (f64, f64),
        (frame, streams): (u32, Streams),
    ) -> Result<Option<Moved>> {
        let drift = self.drift(tracer.into(), tracer.d_um, (t0, t1))?;
        let stream = || streams.stream(Purpose::Brownian, frame, tracer.id as u32);
        let (Pose { position: end, axis }, approach) = match (&self.brownian, &self.shutter, streak) {
            (None, ..) => (drift, None),
            (Some(brownian), Some(shutter), Some(streak)) => {
                let seen = (tracer, streak);
                let (end, approach) =
                    self.brownian_path_between(brownian, seen, shutter, (t0, t1), &mut stream())?;
                (end, Some(approach))
            }
            (Some(brownian), ..) => {
                let from = tracer.into();
                (self.brownian_path(brownian, from, tracer.d_um, (t0, t1), &mut stream())?, None)
            }
        };
        if self.domain.is_beyond_open_face(end) || self.fluid().drains(end) {
            return Ok(None);
        }
        let position = self.domain.wrap(end);
        let step = Displacement { actual: end - tracer.position, drift: drift.position - tracer.position };
        let new = position != end && !self.keeps_ids;
        let approach = approach.map(|approach| approach.moved(position - end));
        Ok(Some((Tracer { position, axis, step: (!new).then_some(step), ..*tracer }, approach)))
    }

    /// The particles that have entered through open faces between `t0` and `t1` (s), at their positions at
    /// `t1`.
    fn arrivals(&self, t0: f64, t1: f64, streams: Streams, frame: u32) -> Result<Vec<Seed>> {
        let mut stream = streams.stream(Purpose::Inflow, frame, 0);
        // The displacement of a spheroid depends on its orientation.
        let turned = self.spheroids.filter(|_| self.brownian.is_some() || self.settling.is_some());
        let mut candidates: Vec<(Seed, Streams)> = Vec::new();
        for slab in self.domain.inflow_slabs(self.reach(t0, t1)) {
            for seed in self.seeding.scatter(self.domain, self.density, &slab, &mut stream) {
                // An independent random stream per candidate, regardless of the other candidates.
                let own = if self.brownian.is_some() || turned.is_some() { stream.next_u64() } else { 0 };
                candidates.push((seed, Streams::new(own)));
            }
        }
        let fluid = self.fluid();
        filtered_in_parallel(&candidates, |(seed, own)| {
            if !fluid.admits(seed.position, t1, 0.5 * seed.d_um) {
                return Ok(None);
            }
            let axis = turned.map(|s| s.orientation.draw(&mut own.stream(Purpose::Orientation, 0, 0)));
            let there = Pose { position: seed.position, axis: axis.unwrap_or(DVec3::Y) };
            // Homogeneous Brownian motion has the same statistics backward in time as forward.
            let origin = match &self.brownian {
                None if axis.is_none() => {
                    advance(&self.drifting(seed.d_um, there.axis), seed.position, t1, t0)?
                }
                None => self.drift(there, seed.d_um, (t1, t0))?.position,
                Some(brownian) => {
                    let mut stream = own.stream(Purpose::Brownian, 0, 0);
                    self.brownian_path(brownian, there, seed.d_um, (t1, t0), &mut stream)?.position
                }
            };
            Ok(self.domain.is_beyond_open_face(origin).then_some(Seed { axis, ..*seed }))
        })
    }

    /// Largest distance (um) from an open face that a particle that enters between two times (s) can reach.
    /// After entering, its path stays in the domain, so the maximum speed in the domain bounds the distance.
    fn reach(&self, t0: f64, t1: f64) -> f64 {
        let sizes = self.seeding.diameters();
        let carried = Drifting::new(self.field, self.size_for_forces(sizes.max()), DVec3::ZERO)
            .near(self.slowing_walls(sizes.max()));
        let settled = self.settling.map_or(0.0, |s| s.max_speed(sizes.max(), &self.friction));
        let speed = carried.max_speed(self.domain.region(), t0, t1) + settled;
        let noise = self.brownian.map_or(0.0, |brownian| {
            let diffusion = brownian.diffusion(sizes.min()) / self.friction.along.min(self.friction.across);
            REACH_OF_NOISE * libm::sqrt(2.0 * diffusion * (t1 - t0))
        });
        speed * (t1 - t0) + noise
    }
}

/// Iterator over the frames of a recording; only the latest frame is kept in memory, unless it is the last.
///
/// It ends after the first `Err`.
#[derive(Debug, Clone)]
pub struct Sequence<'a> {
    scene: Scene<'a>,
    times_s: Vec<f64>,
    streams: Streams,
    recording: u32,
    first_frame: u32,
    next_id: u64,
    made: usize,
    latest: Option<Frame>,
    velocities: bool,
}

impl Sequence<'_> {
    /// The same without the velocities of tracers unless streaks need them; they are then `None`.
    #[must_use]
    pub fn without_velocities(self) -> Self {
        Sequence { velocities: false, ..self }
    }

    /// The smallest id that the frames so far have not used.
    pub fn next_id(&self) -> u64 {
        self.next_id
    }

    fn make(&mut self, t_s: f64) -> Result<Frame> {
        // In range: checked by `Scene::record`.
        let index = self.first_frame + self.made as u32;
        let (Survivors { mut tracers, mut approaches }, wrapped, newcomers) = match &self.latest {
            None => {
                let mut stream = self.streams.stream(Purpose::Seeding, self.recording, 0);
                let (scene, fluid) = (&self.scene, self.scene.fluid());
                let seeds = scene.seeding.populate(&fluid, t_s, scene.density, &mut stream)?;
                (Survivors::default(), Vec::new(), seeds)
            }
            Some(before) => {
                let (survivors, wrapped) = self.scene.survivors(before, t_s, self.streams, index)?;
                (survivors, wrapped, self.scene.arrivals(before.t_s, t_s, self.streams, index)?)
            }
        };
        tracers.reserve(wrapped.len() + newcomers.len());
        for (tracer, approach) in wrapped {
            tracers.push(Tracer { id: self.next_id, ..tracer });
            approaches.extend(approach);
            self.next_id += 1;
        }
        for seed in newcomers {
            tracers.push(self.scene.tracer(seed, self.next_id, self.streams));
            self.next_id += 1;
        }
        let streaks = if self.velocities || self.scene.shutter.is_some() {
            self.expose(&mut tracers, &approaches, (index, t_s))?
        } else {
            Vec::new()
        };
        Ok(Frame { index, t_s, tracers, streaks })
    }

    /// Sets the velocities of the tracers, and returns their streaks if the exposure is finite; `approaches`
    /// are their first halves.
    fn expose(
        &self,
        tracers: &mut [Tracer],
        approaches: &[Approach],
        (index, t_s): (u32, f64),
    ) -> Result<Vec<Streak>> {
        let scene = &self.scene;
        let Some(shutter) = &scene.shutter else {
            tracers.par_iter_mut().with_min_len(TRACERS_PER_TASK).for_each(|tracer| {
                tracer.velocity =
                    Some(scene.drifting(tracer.d_um, tracer.axis).velocity(tracer.position, t_s));
            });
            return Ok(Vec::new());
        };
        // Newcomers come last and have none.
        let halves = approaches.iter().map(Some).chain(std::iter::repeat(None));
        let both: Vec<_> = tracers.iter().zip(halves).collect();
        let exposed = filtered_in_parallel(&both, |(tracer, approach)| {
            scene.streak((tracer, *approach), shutter, (index, t_s), self.streams).map(Some)
        })?;
        let streaks = tracers.iter_mut().zip(exposed).map(|(tracer, (streak, velocity))| {
            tracer.velocity = Some(velocity);
            streak
        });
        Ok(streaks.collect())
    }
}

impl Iterator for Sequence<'_> {
    type Item = Result<Frame>;

    fn next(&mut self) -> Option<Self::Item> {
        let t_s = *self.times_s.get(self.made)?;
        let frame = self.make(t_s);
        self.made = if frame.is_ok() { self.made + 1 } else { self.times_s.len() };
        let is_last = self.made == self.times_s.len();
        self.latest = frame.as_ref().ok().filter(|_| !is_last).cloned();
        Some(frame)
    }
}

/// Applies `f` to all items in parallel and collects the values that it returns, in the order of the items;
/// on failure, returns the error of the first item that failed.
fn filtered_in_parallel<T: Sync, U: Send>(
    items: &[T],
    f: impl Fn(&T) -> Result<Option<U>> + Sync + Send,
) -> Result<Vec<U>> {
    let of = |items: &[T]| {
        let mut kept = Vec::with_capacity(items.len());
        for item in items {
            checkpoint();
            kept.extend(f(item)?);
        }
        Ok(kept)
    };
    let parts: Vec<Result<Vec<U>>> = items.par_chunks(TRACERS_PER_TASK).map(of).collect();
    let mut all = Vec::with_capacity(items.len());
    for part in parts {
        all.append(&mut part?);
    }
    Ok(all)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::domain::Boundary::{Open, Wall};
    use crate::fields::Linear;
    use crate::{Diameters, Domain, Region, Seeding};

    fn domain() -> Domain {
        let region = Region::new(DVec3::new(-50.0, -50.0, 0.0), DVec3::new(50.0, 50.0, 20.0)).unwrap();
        Domain::new(region, [Open, Open, Wall])
    }

    fn seeding() -> Seeding {
        Seeding::poisson(1e-3, Diameters::equal(2.0).unwrap()).unwrap()
    }

    #[test]
    fn a_flow_into_a_wall_is_stopped_by_it() {
        let field = Linear::uniform(DVec3::new(0.0, 0.0, 100.0)).unwrap();
        let (domain, seeding) = (domain(), seeding());
        let scene = Scene::new(&field, &domain, &seeding).unwrap();
        let frames: Vec<Frame> = scene
            .record(&[0.0, 1.0], Streams::new(1), RecordingStart::default())
            .unwrap()
            .map(Result::unwrap)
            .collect();
        assert_eq!(frames[0].tracers.len(), frames[1].tracers.len());
        assert!(frames[1].tracers.iter().all(|tracer| tracer.position.z == 19.0));
    }

    #[test]
    fn velocities_that_nobody_asks_for_change_nothing_else() {
        let field = Linear::uniform(DVec3::X).unwrap();
        let (domain, seeding) = (domain(), seeding());
        let scene = Scene::new(&field, &domain, &seeding).unwrap();
        let record = || scene.record(&[0.0, 1.0], Streams::new(1), RecordingStart::default()).unwrap();
        for (with, without) in record().zip(record().without_velocities()) {
            let (mut with, without) = (with.unwrap(), without.unwrap());
            assert!(with.tracers.iter().all(|tracer| tracer.velocity == Some(DVec3::X)));
            with.tracers.iter_mut().for_each(|tracer| tracer.velocity = None);
            assert_eq!(with, without);
        }
    }

    #[test]
    fn times_and_numbers_are_checked() {
        let field = Linear::uniform(DVec3::X).unwrap();
        let (domain, seeding) = (domain(), seeding());
        let scene = Scene::new(&field, &domain, &seeding).unwrap();
        let fault = |times: &[f64], start: RecordingStart| {
            scene
                .record(times, Streams::new(1), start)
                .err()
                .map(|error| error.to_string())
                .unwrap_or_default()
        };
        let start = RecordingStart::default();
        assert!(fault(&[0.0, 0.1, 0.1], start).contains("times_s = 0.1"));
        assert!(fault(&[f64::NAN], start).contains("NaN"));
        assert!(fault(&[0.0, 1.0], RecordingStart { first_frame: u32::MAX - 1, ..start }).contains("frames"));
        assert!(fault(&[0.0], RecordingStart { first_id: u64::MAX, ..start }).contains("first_id"));
        assert_eq!(fault(&[], start), "");
    }

    #[test]
    fn a_trajectory_to_infinity_ends_the_recording() {
        let field = Linear::dilatation(1e6, DVec3::ZERO).unwrap();
        let (domain, seeding) = (domain(), seeding());
        let scene = Scene::new(&field, &domain, &seeding).unwrap();
        let mut sequence =
            scene.record(&[0.0, 1.0, 2.0], Streams::new(1), RecordingStart::default()).unwrap();
        assert!(sequence.next().unwrap().is_ok());
        assert!(matches!(sequence.next(), Some(Err(Error::Trajectory { .. }))));
        assert!(sequence.next().is_none());
    }
}
