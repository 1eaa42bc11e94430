//! A recording: the cloud of tracers at each of a series of times.
//!
//! At the first time the domain is seeded. Each step then moves every tracer along its trajectory, drops those that are
//! beyond an open face, and lets new ones in by *backtracking*: a uniform Poisson process is drawn in the part B of the
//! domain that can be reached from an open face within the step (closer to it than the greatest speed times dt), each
//! candidate is followed back to the time before, and kept if it was outside then. A field without divergence carries
//! a uniform Poisson cloud of all space into itself; the tracers that were inside and the candidates that were not are
//! the two parts of that cloud, so the cloud in the domain stays uniform for ever, whatever the flow. (Letting leavers
//! in again at random places of the inflow face does not: slow layers near walls would crowd, fast ones empty.)
//! With divergence, density changes inside, and new particles still come in at the density of the seeding.
//!
//! Random streams: (`Seeding`, recording, 0) for the first cloud, (`Inflow`, later frame of the step, 0) for each step. A
//! shorter run of the same recording is therefore the beginning of a longer one, and threads change nothing.

use crate::domain::Domain;
use crate::error::{Check, Error, Result};
use crate::field::VelocityField;
use crate::integrate::advance;
use crate::seeding::{Seed, Seeding};
use glam::DVec3;
use microsig_core::stream::{Purpose, Streams};
use rayon::prelude::*;

const CHECK: Check = Check("sequence");

/// Greatest first id, 2^53: ids stay whole numbers in every format.
const MAX_FIRST_ID: u64 = 1 << 53;

/// Fewest tracers that are worth a thread.
const TRACERS_PER_TASK: usize = 64;

/// A tracer particle at one time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Tracer {
    /// Its name, never given to another particle.
    pub id: u64,
    /// The centre, um.
    pub position: DVec3,
    /// Diameter, um.
    pub d_um: f64,
}

/// The cloud at one time.
#[derive(Debug, Clone, PartialEq)]
pub struct Frame {
    /// Number of the frame in the dataset.
    pub index: u32,
    /// Time, s.
    pub t_s: f64,
    /// The tracers in the domain, by ascending id.
    pub tracers: Vec<Tracer>,
}

impl Frame {
    /// The tracers that are also in a later frame of the same recording, each with itself there.
    pub fn links<'a>(&'a self, later: &'a Frame) -> impl Iterator<Item = (&'a Tracer, &'a Tracer)> {
        let mut rest = later.tracers.as_slice();
        self.tracers.iter().filter_map(move |tracer| {
            // Both ascend: what is skipped here was born in between.
            rest = &rest[rest.partition_point(|other| other.id < tracer.id)..];
            rest.first().filter(|other| other.id == tracer.id).map(|other| (tracer, other))
        })
    }
}

/// A field, the domain it moves tracers through, and their seeding: parts that fit together.
#[derive(Debug, Clone, Copy)]
pub struct Scene<'a> {
    field: &'a dyn VelocityField,
    domain: &'a Domain,
    seeding: &'a Seeding,
    density: f64,
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
        Ok(Scene { field, domain, seeding, density: seeding.density(domain)? })
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

    /// The tracers of `frame` that are still in the domain at `t1`, where they are then.
    fn survivors(&self, frame: &Frame, t1: f64) -> Result<Vec<Tracer>> {
        let moved = in_parallel(&frame.tracers, |tracer| {
            let end = advance(self.field, tracer.position, frame.t_s, t1)?;
            let position = self.domain.keep_off_walls(end, 0.5 * tracer.d_um);
            Ok((!self.domain.is_beyond_open_face(position)).then_some(Tracer { position, ..*tracer }))
        })?;
        Ok(moved.into_iter().flatten().collect())
    }

    /// The particles that have come in through open faces between `t0` and `t1`, at `t1`.
    fn arrivals(&self, t0: f64, t1: f64, streams: Streams, frame: u32) -> Result<Vec<Seed>> {
        let mut stream = streams.stream(Purpose::Inflow, frame, 0);
        // A path that has come in has stayed in the domain since: its speed there bounds how far it got.
        let reach = self.field.max_speed(self.domain.region(), t0, t1) * (t1 - t0);
        let candidates: Vec<Seed> = self
            .domain
            .inflow_slabs(reach)
            .iter()
            .flat_map(|slab| self.seeding.scatter(self.domain, self.density, slab, &mut stream))
            .collect();
        let followed = in_parallel(&candidates, |seed| {
            let origin = advance(self.field, seed.position, t1, t0)?;
            Ok(self.domain.is_beyond_open_face(origin).then_some(*seed))
        })?;
        Ok(followed.into_iter().flatten().collect())
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
        let (mut tracers, newcomers) = match &self.latest {
            None => {
                let mut stream = self.streams.stream(Purpose::Seeding, self.recording, 0);
                (Vec::new(), self.scene.seeding.populate(self.scene.domain, &mut stream)?)
            }
            Some(before) => (
                self.scene.survivors(before, t_s)?,
                self.scene.arrivals(before.t_s, t_s, self.streams, index)?,
            ),
        };
        for Seed { position, d_um } in newcomers {
            tracers.push(Tracer { id: self.next_id, position, d_um });
            self.next_id += 1;
        }
        Ok(Frame { index, t_s, tracers })
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
    fn links_find_survivors_only() {
        let tracer = |id: u64, x: f64| Tracer { id, position: DVec3::X * x, d_um: 1.0 };
        let first =
            Frame { index: 0, t_s: 0.0, tracers: vec![tracer(3, 0.0), tracer(5, 1.0), tracer(9, 2.0)] };
        let second =
            Frame { index: 1, t_s: 1.0, tracers: vec![tracer(5, 1.5), tracer(9, 2.5), tracer(10, 7.0)] };
        let links: Vec<_> = first.links(&second).map(|(a, b)| (a.id, b.position.x - a.position.x)).collect();
        assert_eq!(links, [(5, 0.5), (9, 0.5)]);
        assert_eq!(second.links(&first).count(), 2);
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
