//! Tracers in a frame, and their displacements between frames.

use glam::DVec3;

/// A tracer particle at one time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Tracer {
    /// Unique id, never reused.
    pub id: u64,
    /// Position of the center, um.
    pub position: DVec3,
    /// Diameter, um.
    pub d_um: f64,
    /// Aspect ratio: length along the symmetry axis over length across it; 1 for a sphere.
    pub aspect: f64,
    /// Direction of the axis, of length 1.
    pub axis: DVec3,
    /// Brightness factor relative to a particle of its size.
    pub c_int: f64,
    /// Velocity of the center, um/s; with a finite exposure, the mean over the exposure. `None` for a
    /// recorded track that is present in neither the previous nor the next frame, and if it is not computed
    /// ([`crate::Sequence::without_velocities`]).
    pub velocity: Option<DVec3>,
    /// Displacement from the previous frame; `None` for a new tracer.
    pub step: Option<Displacement>,
}

/// Displacement of a tracer between two frames, um.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Displacement {
    /// Total displacement, including Brownian motion; continuous across periodic faces, where positions jump.
    pub actual: DVec3,
    /// Displacement by flow and settling only.
    pub drift: DVec3,
}

/// The points that represent a particle that moves while the shutter is open.
#[derive(Debug, Clone, PartialEq)]
pub struct Streak {
    /// Points in order of time.
    pub points: Vec<StreakPoint>,
    /// Fraction of the light of one flash that each point contributes.
    pub share: f64,
    /// The particle at the end of the exposure, if it diffuses.
    pub(crate) closing: StreakPoint,
}

/// A point of a streak.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StreakPoint {
    /// Position of the particle center, um.
    pub position: DVec3,
    /// Direction of the axis, of length 1.
    pub axis: DVec3,
}

/// First frame number and first id of a recording.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct RecordingStart {
    /// Number of the recording; recordings of one dataset are seeded independently.
    pub recording: u32,
    /// Dataset-wide number of its first frame.
    pub first_frame: u32,
    /// Id of its first tracer, at most 2^53; the next recording of the dataset continues at
    /// [`crate::Sequence::next_id`].
    pub first_id: u64,
}

/// The tracer cloud at one time.
#[derive(Debug, Clone, PartialEq)]
pub struct Frame {
    /// Number of the frame in the dataset.
    pub index: u32,
    /// Time, s: the middle of the exposure.
    pub t_s: f64,
    /// The tracers in the domain, by ascending id.
    pub tracers: Vec<Tracer>,
    /// The streak of each tracer, in the same order; empty if the exposure is instantaneous.
    pub streaks: Vec<Streak>,
}

impl Frame {
    /// The tracers that are also in a later frame of the same recording, paired with their state there.
    pub fn links<'a>(&'a self, later: &'a Frame) -> impl Iterator<Item = (&'a Tracer, &'a Tracer)> {
        let mut rest = later.tracers.as_slice();
        self.tracers.iter().filter_map(move |tracer| {
            // Both lists ascend by id: tracers skipped here entered in between.
            let here = rest.iter().position(|other| other.id >= tracer.id).unwrap_or(rest.len());
            rest = &rest[here..];
            rest.first().filter(|other| other.id == tracer.id).map(|other| (tracer, other))
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn links_find_survivors_only() {
        let tracer = |id: u64, x: f64| Tracer {
            id,
            position: DVec3::X * x,
            d_um: 1.0,
            aspect: 1.0,
            axis: DVec3::Y,
            c_int: 1.0,
            velocity: None,
            step: None,
        };
        let first = Frame {
            index: 0,
            t_s: 0.0,
            tracers: vec![tracer(3, 0.0), tracer(5, 1.0), tracer(9, 2.0)],
            streaks: Vec::new(),
        };
        let second = Frame {
            index: 1,
            t_s: 1.0,
            tracers: vec![tracer(5, 1.5), tracer(9, 2.5), tracer(10, 7.0)],
            streaks: Vec::new(),
        };
        let links: Vec<_> = first.links(&second).map(|(a, b)| (a.id, b.position.x - a.position.x)).collect();
        assert_eq!(links, [(5, 0.5), (9, 0.5)]);
        assert_eq!(second.links(&first).count(), 2);
    }
}
