//! A recording: the cloud of tracers at each of a series of times.
//!
//! At the first time the domain is seeded. Each step then moves every tracer along its trajectory, drops those that are
//! beyond an open face, and lets new ones in by *backtracking*: a uniform Poisson process is drawn in the part B of the
//! domain that can be reached from an open face within the step (closer to it than the greatest speed times dt), each
//! candidate is followed back to the time before, and kept if it was outside then. A field without divergence carries
//! a uniform Poisson cloud of all space into itself; the tracers that were inside and the candidates that were not are
//! the two parts of that cloud, so the cloud in the domain stays uniform for ever, whatever the flow. (Letting leavers
//! in again at random places of the inflow face does not: slow layers near walls would crowd, fast ones empty.)
//! With divergence, density changes inside, and new particles still come in at the density of the seeding. Brownian motion, which a uniform
//! cloud does not notice either, is followed backward with noise in the same way.
//!
//! Random streams: (`Seeding`, recording, 0) for the first cloud, (`Inflow`, later frame of the step, 0) for each step, and for a tracer by the
//! low 32 bits of its id (`Brownian`, later frame, id), (`Orientation`, 0, id), (`Intensity`, 0, id). A
//! shorter run of the same recording is therefore the beginning of a longer one, and threads change nothing.

use crate::body::Body;
use crate::brownian::{Brownian, Settling};
use crate::domain::Domain;
use crate::drift::Drifting;
use crate::error::{Check, Error, Result};
use crate::exposure::{Shutter, Streak};
use crate::field::VelocityField;
pub use crate::frame::{Displacement, Frame, Tracer};
use crate::integrate::advance;
use crate::intensities::Intensities;
use crate::orientation::{Spheroids, carry};
use crate::seeding::{Seed, Seeding};
use glam::DVec3;
use microsig_core::stream::{Purpose, Stream, Streams};
use rayon::prelude::*;

const CHECK: Check = Check("sequence");

/// Greatest first id, 2^53: ids stay whole numbers in every format.
const MAX_FIRST_ID: u64 = 1 << 53;

/// How far noise may carry a newcomer, in standard deviations of one axis: farther goes one in 10^15.
const REACH_OF_NOISE: f64 = 8.0;

/// Fewest tracers that are worth a thread.
const TRACERS_PER_TASK: usize = 64;

/// A field, the domain it moves tracers through, and their seeding: parts that fit together.
#[derive(Debug, Clone, Copy)]
pub struct Scene<'a> {
    field: &'a dyn VelocityField,
    pub(crate) domain: &'a Domain,
    seeding: &'a Seeding,
    density: f64,
    bodies: &'a [Body],
    settling: Option<Settling>,
    pub(crate) brownian: Option<Brownian>,
    spheroids: Option<Spheroids>,
    intensities: Intensities,
    keeps_ids: bool,
    shutter: Option<Shutter>,
}

/// Where the numbers of a recording begin.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Start {
    /// Number of the recording; recordings of one dataset are seeded independently.
    pub recording: u32,
    /// Number of its first frame in the dataset.
    pub first_frame: u32,
    /// Id of its first tracer, at most 2^53; the next recording of the dataset starts at [`Sequence::next_id`].
    pub first_id: u64,
}

impl<'a> Scene<'a> {
    /// A scene; `Err` if the seeding does not fit the domain (see [`Seeding::density`]).
    pub fn new(field: &'a dyn VelocityField, domain: &'a Domain, seeding: &'a Seeding) -> Result<Self> {
        let density = seeding.density(domain)?;
        Ok(Scene {
            field,
            domain,
            seeding,
            density,
            bodies: &[],
            settling: None,
            brownian: None,
            spheroids: None,
            intensities: Intensities::default(),
            keeps_ids: false,
            shutter: None,
        })
    }

    /// With bodies that tracers do not enter. A count in view is what remains in it beside them.
    pub fn with_bodies(self, bodies: &'a [Body]) -> Self {
        Scene { bodies, ..self }
    }

    /// With particles that settle.
    pub fn with_settling(self, settling: Settling) -> Self {
        Scene { settling: Some(settling), ..self }
    }

    /// With Brownian motion, of the axes of spheroids too.
    pub fn with_brownian(self, brownian: Brownian) -> Self {
        Scene { brownian: Some(brownian), ..self }
    }

    /// With spheroids instead of spheres.
    pub fn with_spheroids(self, spheroids: Spheroids) -> Self {
        Scene { spheroids: Some(spheroids), ..self }
    }

    /// With particles of different brightness.
    pub fn with_intensities(self, intensities: Intensities) -> Self {
        Scene { intensities, ..self }
    }

    /// With ids that go on when a tracer passes a periodic face; without this it is a new tracer on the other side.
    pub fn keeping_ids(self) -> Self {
        Scene { keeps_ids: true, ..self }
    }

    /// With frames of finite exposure; without this they are instantaneous.
    pub fn with_shutter(self, shutter: Shutter) -> Self {
        Scene { shutter: Some(shutter).filter(|shutter| shutter.span_s() > 0.0), ..self }
    }

    /// The recording of this scene at the given times (s, increasing). Two times make a pair.
    pub fn record(&self, times_s: &[f64], streams: Streams, start: Start) -> Result<Sequence<'a>> {
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
        Ok(Sequence {
            scene: *self,
            times_s: times_s.to_vec(),
            streams,
            recording: start.recording,
            first_frame: start.first_frame,
            next_id: start.first_id,
            made: 0,
            latest: None,
        })
    }

    /// The velocity (um/s) of a tracer that is in a frame at `t0` half-way to the next frame at `t1`: on the path that flow and
    /// settling take it, random motion left out.
    pub fn velocity_midway(&self, tracer: &Tracer, t0: f64, t1: f64) -> Result<DVec3> {
        let (field, middle) = (self.drifting(tracer.d_um), f64::midpoint(t0, t1));
        let x = self.hold(advance(&field, tracer.position, t0, middle)?, middle, 0.5 * tracer.d_um);
        Ok(field.velocity(x, middle))
    }

    /// The field that carries particles of a diameter.
    pub(crate) fn drifting(&self, d_um: f64) -> Drifting<'a> {
        let slip = self.settling.map_or(DVec3::ZERO, |settling| settling.velocity(d_um));
        Drifting { field: self.field, slip }
    }

    /// The nearest place where walls, bodies and the field's own surfaces leave a particle.
    pub(crate) fn hold(&self, x: DVec3, t: f64, radius: f64) -> DVec3 {
        let x = self.domain.keep_off_walls(self.field.confine(x, t, radius), radius);
        let x = self.bodies.iter().fold(x, |x, body| body.keep_off(x, radius));
        if self.bodies.is_empty() { x } else { self.domain.keep_off_walls(x, radius) }
    }

    /// Where flow and noise take a particle from `t0` to `t1`, earlier or later; its axis is turned on the way.
    fn wander(
        &self,
        brownian: &Brownian,
        (mut x, d_um, aspect): (DVec3, f64, f64),
        axis: &mut DVec3,
        (t0, t1): (f64, f64),
        stream: &mut Stream,
    ) -> Result<DVec3> {
        let (field, radius) = (self.drifting(d_um), 0.5 * d_um);
        let steps = brownian.substeps();
        let at = |half: u32| t0 + (t1 - t0) * f64::from(half) / f64::from(2 * steps);
        let h = (t1 - t0).abs() / f64::from(steps);
        for k in 0..steps {
            let (start, middle, end) = (at(2 * k), at(2 * k + 1), at(2 * k + 2));
            if aspect != 1.0 {
                *axis = carry(&field, x, *axis, aspect, start, middle)?;
                *axis = brownian.turn(*axis, d_um, h, stream);
            }
            x = self.hold(advance(&field, x, start, middle)?, middle, radius);
            x = self.domain.reflect(x + brownian.kick(d_um, h, stream), radius);
            x = self.hold(x, middle, radius);
            if aspect != 1.0 {
                *axis = carry(&field, x, *axis, aspect, middle, end)?;
            }
            x = self.hold(advance(&field, x, middle, end)?, end, radius);
        }
        Ok(x)
    }

    /// The tracers of `frame` that are still in the domain at `t1`, where they are then, in two groups: those that go on, and those that are new
    /// because they have passed a periodic face.
    fn survivors(
        &self,
        before: &Frame,
        t1: f64,
        streams: Streams,
        frame: u32,
    ) -> Result<(Vec<Tracer>, Vec<Tracer>)> {
        let t0 = before.t_s;
        let moved = in_parallel(&before.tracers, |tracer| {
            let (field, radius) = (self.drifting(tracer.d_um), 0.5 * tracer.d_um);
            let drift = self.hold(advance(&field, tracer.position, t0, t1)?, t1, radius);
            let mut axis = tracer.axis;
            let end = match &self.brownian {
                None => {
                    if tracer.aspect != 1.0 {
                        axis = carry(&field, tracer.position, axis, tracer.aspect, t0, t1)?;
                    }
                    drift
                }
                Some(brownian) => {
                    let mut stream = streams.stream(Purpose::Brownian, frame, tracer.id as u32);
                    let particle = (tracer.position, tracer.d_um, tracer.aspect);
                    self.wander(brownian, particle, &mut axis, (t0, t1), &mut stream)?
                }
            };
            let gone =
                self.domain.is_beyond_open_face(end) || self.bodies.iter().any(|body| body.drains(end));
            let position = self.domain.wrap(end);
            let step = Displacement { actual: end - tracer.position, drift: drift - tracer.position };
            let new = position != end && !self.keeps_ids;
            let step = (!new).then_some(step);
            Ok((!gone).then_some(Tracer { position, axis, step, ..*tracer }))
        })?;
        Ok(moved.into_iter().flatten().partition(|tracer| tracer.step.is_some()))
    }

    /// The particles that have come in through open faces between `t0` and `t1`, at `t1`.
    fn arrivals(&self, t0: f64, t1: f64, streams: Streams, frame: u32) -> Result<Vec<Seed>> {
        let mut stream = streams.stream(Purpose::Inflow, frame, 0);
        // A path that has come in has stayed in the domain since: its speed there bounds how far it got.
        let sizes = self.seeding.diameters();
        let speed = self.drifting(sizes.max()).max_speed(self.domain.region(), t0, t1);
        let noise = self.brownian.map_or(0.0, |brownian| {
            REACH_OF_NOISE * libm::sqrt(2.0 * brownian.diffusion(sizes.min()) * (t1 - t0))
        });
        let reach = speed * (t1 - t0) + noise;
        let mut candidates: Vec<(Seed, Streams)> = Vec::new();
        for slab in self.domain.inflow_slabs(reach) {
            for seed in self.seeding.scatter(self.domain, self.density, &slab, &mut stream) {
                // Noise of its own, whatever becomes of the others.
                let own = if self.brownian.is_some() { stream.next_u64() } else { 0 };
                candidates.push((seed, Streams::new(own)));
            }
        }
        let followed = in_parallel(&candidates, |(seed, own)| {
            let radius = 0.5 * seed.d_um;
            if self.is_taken(seed.position, t1, radius) {
                return Ok(None);
            }
            // Uniform noise is the same backward in time as forward.
            let origin = match &self.brownian {
                None => advance(&self.drifting(seed.d_um), seed.position, t1, t0)?,
                Some(brownian) => {
                    let mut stream = own.stream(Purpose::Brownian, 0, 0);
                    let particle = (seed.position, seed.d_um, 1.0);
                    let mut axis = DVec3::Y;
                    self.wander(brownian, particle, &mut axis, (t1, t0), &mut stream)?
                }
            };
            Ok(self.domain.is_beyond_open_face(origin).then_some(*seed))
        })?;
        Ok(followed.into_iter().flatten().collect())
    }

    /// Whether something holds particles of a radius away from a place.
    fn is_taken(&self, x: DVec3, t: f64, radius: f64) -> bool {
        self.bodies.iter().any(|body| body.touches(x, radius)) || self.field.confine(x, t, radius) != x
    }

    /// A particle with its name, and what else is drawn by it.
    fn christen(&self, seed: Seed, id: u64, streams: Streams) -> Tracer {
        let stream = |purpose| streams.stream(purpose, 0, id as u32);
        let (aspect, axis) = match &self.spheroids {
            None => (1.0, DVec3::Y),
            Some(spheroids) => {
                (spheroids.aspect, spheroids.orientations.draw(&mut stream(Purpose::Orientation)))
            }
        };
        let c_int = self.intensities.draw(seed.d_um, &mut stream(Purpose::Intensity));
        Tracer {
            id,
            position: seed.position,
            d_um: seed.d_um,
            aspect,
            axis,
            c_int,
            velocity: None,
            step: None,
        }
    }
}

/// The frames of a recording, one after the other; it keeps only the latest in memory.
///
/// After an `Err` it ends.
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
}

impl Sequence<'_> {
    /// The first id that no tracer of the frames made so far bears.
    pub fn next_id(&self) -> u64 {
        self.next_id
    }

    fn make(&mut self, t_s: f64) -> Result<Frame> {
        // In range by the check of `Scene::record`.
        let index = self.first_frame + self.made as u32;
        let (mut tracers, wrapped, newcomers) = match &self.latest {
            None => {
                let mut stream = self.streams.stream(Purpose::Seeding, self.recording, 0);
                let taken = |x: DVec3, radius: f64| self.scene.is_taken(x, t_s, radius);
                (Vec::new(), Vec::new(), self.scene.seeding.populate(self.scene.domain, &taken, &mut stream)?)
            }
            Some(before) => {
                let (survivors, wrapped) = self.scene.survivors(before, t_s, self.streams, index)?;
                (survivors, wrapped, self.scene.arrivals(before.t_s, t_s, self.streams, index)?)
            }
        };
        for tracer in wrapped {
            tracers.push(Tracer { id: self.next_id, ..tracer });
            self.next_id += 1;
        }
        for seed in newcomers {
            tracers.push(self.scene.christen(seed, self.next_id, self.streams));
            self.next_id += 1;
        }
        let streaks = self.expose(&mut tracers, index, t_s)?;
        Ok(Frame { index, t_s, tracers, streaks })
    }

    /// Gives the tracers their velocities, and the streaks that they leave if the frame has an exposure.
    fn expose(&self, tracers: &mut [Tracer], index: u32, t_s: f64) -> Result<Vec<Streak>> {
        let scene = &self.scene;
        let Some(shutter) = &scene.shutter else {
            tracers.par_iter_mut().with_min_len(TRACERS_PER_TASK).for_each(|tracer| {
                tracer.velocity = Some(scene.drifting(tracer.d_um).velocity(tracer.position, t_s));
            });
            return Ok(Vec::new());
        };
        let exposed =
            in_parallel(tracers, |tracer| scene.streak(tracer, shutter, (index, t_s), self.streams))?;
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
        self.latest = frame.as_ref().ok().cloned();
        Some(frame)
    }
}

/// `f` of every item, in the order of the items; the error, if any, is that of the first item that has one.
fn in_parallel<T: Sync, U: Send>(items: &[T], f: impl Fn(&T) -> Result<U> + Sync + Send) -> Result<Vec<U>> {
    let results: Vec<Result<U>> = items.par_iter().with_min_len(TRACERS_PER_TASK).map(f).collect();
    results.into_iter().collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::diameters::Diameters;
    use crate::domain::Boundary::{Open, Wall};
    use crate::fields::Linear;
    use crate::region::Region;

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
            .record(&[0.0, 1.0], Streams::new(1), Start::default())
            .unwrap()
            .map(Result::unwrap)
            .collect();
        assert_eq!(frames[0].tracers.len(), frames[1].tracers.len());
        assert!(frames[1].tracers.iter().all(|tracer| tracer.position.z == 19.0));
    }

    #[test]
    fn times_and_numbers_are_checked() {
        let field = Linear::uniform(DVec3::X).unwrap();
        let (domain, seeding) = (domain(), seeding());
        let scene = Scene::new(&field, &domain, &seeding).unwrap();
        let fault = |times: &[f64], start: Start| {
            scene
                .record(times, Streams::new(1), start)
                .err()
                .map(|error| error.to_string())
                .unwrap_or_default()
        };
        let start = Start::default();
        assert!(fault(&[0.0, 0.1, 0.1], start).contains("times_s = 0.1"));
        assert!(fault(&[f64::NAN], start).contains("NaN"));
        assert!(fault(&[0.0, 1.0], Start { first_frame: u32::MAX - 1, ..start }).contains("frames"));
        assert!(fault(&[0.0], Start { first_id: u64::MAX, ..start }).contains("first_id"));
        assert_eq!(fault(&[], start), "");
    }

    #[test]
    fn a_trajectory_to_infinity_ends_the_recording() {
        let field = Linear::dilatation(1e6, DVec3::ZERO).unwrap();
        let (domain, seeding) = (domain(), seeding());
        let scene = Scene::new(&field, &domain, &seeding).unwrap();
        let mut sequence = scene.record(&[0.0, 1.0, 2.0], Streams::new(1), Start::default()).unwrap();
        assert!(sequence.next().unwrap().is_ok());
        assert!(matches!(sequence.next(), Some(Err(Error::Trajectory { .. }))));
        assert!(sequence.next().is_none());
    }
}
