//! Tracers at one time, and their ways between two.

use crate::exposure::Streak;
use glam::DVec3;

/// A tracer particle at one time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Tracer {
    /// Its name, never given to another particle.
    pub id: u64,
    /// The centre, um.
    pub position: DVec3,
    /// Diameter, um.
    pub d_um: f64,
    /// Length along the axis over length across it; 1 for a sphere.
    pub aspect: f64,
    /// Direction of the axis, of length 1.
    pub axis: DVec3,
    /// Factor on the light of a particle of its size.
    pub c_int: f64,
    /// Velocity of its centre, um/s; of a frame with an exposure the mean over it. `None` only for a recorded track that
    /// is in no frame beside this one.
    pub velocity: Option<DVec3>,
    /// How it came here from the frame before; `None` for a newcomer.
    pub step: Option<Displacement>,
}

/// The way of a tracer between two frames, um.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Displacement {
    /// The whole way, noise included; through a periodic face it goes on, where positions jump.
    pub actual: DVec3,
    /// What flow and settling alone would have done.
    pub drift: DVec3,
}

/// The cloud at one time.
#[derive(Debug, Clone, PartialEq)]
pub struct Frame {
    /// Number of the frame in the dataset.
    pub index: u32,
    /// Time, s: the middle of the exposure.
    pub t_s: f64,
    /// The tracers in the domain, by ascending id.
    pub tracers: Vec<Tracer>,
    /// What each tracer leaves on the image; empty if the exposure is instantaneous.
    pub streaks: Vec<Streak>,
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
