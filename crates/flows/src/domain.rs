//! The box that holds the tracers, and its faces.
//!
//! Walls keep the center of a particle at least one radius away. So that the cloud is uniform over the volume
//! accessible to centers, regardless of particle size, points uniform in the whole box are *squeezed*: mapped
//! linearly, along walled axes only, onto the accessible volume. Fields are expected to be tangential at
//! walls.

use crate::{Axis, ParameterCheck, Region, Result, Wall};
use glam::DVec3;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Type of a boundary of the box.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Boundary {
    /// Particles enter and leave; the number density is the same outside as inside.
    #[default]
    Open,
    /// A solid wall: particle centers stay at least one radius away from it.
    Wall,
    /// Particles that leave on one side enter on the other.
    Periodic,
}

/// An axis-aligned box in object space, um, with a boundary condition for each pair of faces.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Domain {
    region: Region,
    boundaries: [Boundary; 3],
}

impl Domain {
    /// The box with the boundary conditions of its faces normal to x, y and z.
    pub fn new(region: Region, boundaries: [Boundary; 3]) -> Self {
        Domain { region, boundaries }
    }

    /// The box, walls included.
    pub fn region(&self) -> &Region {
        &self.region
    }

    /// The boundary condition of the faces normal to an axis.
    pub fn boundary(&self, axis: Axis) -> Boundary {
        self.boundaries[axis as usize]
    }

    /// Whether a point (um) is outside the box beyond an open face; true for NaN coordinates along open axes.
    pub fn is_beyond_open_face(&self, x: DVec3) -> bool {
        self.axes(Boundary::Open).any(|axis| {
            let (low, high, at) = self.edge(axis, x);
            // The negated form is also true for NaN.
            !(at >= low && at < high)
        })
    }

    /// The part of the box accessible to the centers of particles of `radius` (um); an error naming the
    /// diameter if they do not fit between the walls.
    pub fn room(&self, radius: f64) -> Result<Region> {
        let room = self.axes(Boundary::Wall).try_fold(self.region, |room, axis| {
            let (low, high, _) = self.edge(axis, DVec3::ZERO);
            room.with_edge(axis, low + radius, high - radius)
        });
        room.ok_or_else(|| {
            ParameterCheck("domain").fault(
                "diameter_um",
                2.0 * radius,
                "less than the distance between the walls",
            )
        })
    }

    /// The nearest point (um) to `x` (um) at which a particle of `radius` (um) does not overlap a wall of the
    /// box.
    pub fn push_out_of_walls(&self, mut x: DVec3, radius: f64) -> DVec3 {
        for axis in self.axes(Boundary::Wall) {
            let (low, high, at) = self.edge(axis, x);
            x[axis as usize] = at.min(high - radius).max(low + radius);
        }
        x
    }

    /// The walls of the box, seen from `x` (um).
    pub(crate) fn walls(&self, x: DVec3) -> impl Iterator<Item = Wall> {
        let domain = *self;
        self.axes(Boundary::Wall).flat_map(move |axis| {
            let ((low, high, at), normal) = (domain.edge(axis, x), axis.unit());
            [Wall { clearance_um: at - low, normal }, Wall { clearance_um: high - at, normal: -normal }]
        })
    }

    /// `x` (um) reflected at the walls of the box, repeatedly if necessary, so that a particle of `radius`
    /// (um) stays inside. Random steps with reflection keep a uniform density uniform.
    pub(crate) fn reflect(&self, mut x: DVec3, radius: f64) -> DVec3 {
        for axis in self.axes(Boundary::Wall) {
            let (low, high, at) = self.edge(axis, x);
            let (low, room) = (low + radius, high - low - 2.0 * radius);
            let turns = (at - low) / (2.0 * room);
            // Position folded into one trip from the low wall to the high one and back.
            let way = (turns - libm::floor(turns)) * 2.0 * room;
            x[axis as usize] = low + way.min(2.0 * room - way).clamp(0.0, room);
        }
        x
    }

    /// A point (um) outside periodic faces moved back into the box by whole periods.
    pub(crate) fn wrap(&self, mut x: DVec3) -> DVec3 {
        for axis in self.axes(Boundary::Periodic) {
            let (low, high, at) = self.edge(axis, x);
            if at < low || at >= high {
                let period = high - low;
                let inside = at - libm::floor((at - low) / period) * period;
                // Rounding may give the upper face itself, which is not in the box.
                x[axis as usize] = if inside < high { inside.max(low) } else { low };
            }
        }
        x
    }

    /// A point of the box mapped linearly onto the volume accessible to centers of particles of `radius`
    /// (um).
    pub(crate) fn squeeze(&self, mut x: DVec3, radius: f64) -> DVec3 {
        for axis in self.axes(Boundary::Wall) {
            let (low, high, at) = self.edge(axis, x);
            x[axis as usize] = low + radius + (at - low) / (high - low) * (high - low - 2.0 * radius);
        }
        x
    }

    /// `region` extended to the whole box along walled axes.
    pub(crate) fn extend_to_walls(&self, region: &Region) -> Region {
        self.axes(Boundary::Wall).fold(*region, |region, axis| {
            let (low, high, _) = self.edge(axis, DVec3::ZERO);
            // An edge of a region always has a positive length.
            region.with_edge(axis, low, high).unwrap_or(region)
        })
    }

    /// The part of the box within `depth` (um) of an open face, as non-overlapping boxes that extend from
    /// wall to wall.
    pub fn inflow_slabs(&self, depth: f64) -> Vec<Region> {
        let mut slabs = Vec::new();
        let mut core = self.region;
        for axis in self.axes(Boundary::Open) {
            let (low, high) = (core.min()[axis as usize], core.max()[axis as usize]);
            let inner = core.with_edge(axis, low + depth, high - depth);
            let Some(inner) = inner else {
                slabs.push(core);
                return slabs;
            };
            slabs.extend(core.with_edge(axis, low, low + depth));
            slabs.extend(core.with_edge(axis, high - depth, high));
            core = inner;
        }
        slabs
    }

    fn axes(&self, boundary: Boundary) -> impl Iterator<Item = Axis> {
        let boundaries = self.boundaries;
        Axis::ALL.into_iter().filter(move |axis| boundaries[*axis as usize] == boundary)
    }

    /// Lower and upper end of the box along an axis, and the coordinate of `x` on it, um.
    fn edge(&self, axis: Axis, x: DVec3) -> (f64, f64, f64) {
        let i = axis as usize;
        (self.region.min()[i], self.region.max()[i], x[i])
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use Boundary::{Open, Wall};

    fn channel() -> Domain {
        let region = Region::new(DVec3::new(-200.0, -100.0, -80.0), DVec3::new(200.0, 100.0, 20.0)).unwrap();
        Domain::new(region, [Open, Open, Wall])
    }

    #[test]
    fn slabs_hold_exactly_what_is_near_an_open_face() {
        let slabs = channel().inflow_slabs(15.0);
        let volume: f64 = slabs.iter().map(Region::volume).sum();
        assert_eq!(volume, (400.0 * 200.0 - 370.0 * 170.0) * 100.0);
        for i in 0..4000 {
            let i = f64::from(i);
            let x = channel().region().at(DVec3::new(i * 0.618_034 % 1.0, i * 0.414_214 % 1.0, i / 4000.0));
            let near = x.x.abs() > 185.0 || x.y.abs() > 85.0;
            let holding = slabs.iter().filter(|slab| slab.contains(x)).count();
            assert_eq!(holding, usize::from(near), "{x}");
        }
        for slab in slabs {
            assert_eq!((slab.min().z, slab.max().z), (-80.0, 20.0));
        }
    }

    #[test]
    fn slabs_at_the_limits() {
        assert!(channel().inflow_slabs(0.0).is_empty());
        for depth in [100.0, 1e6, f64::INFINITY, f64::NAN] {
            let volume: f64 = channel().inflow_slabs(depth).iter().map(Region::volume).sum();
            assert_eq!(volume, 400.0 * 200.0 * 100.0, "{depth}");
        }
        let closed = Domain::new(*channel().region(), [Wall; 3]);
        assert!(closed.inflow_slabs(f64::INFINITY).is_empty());
    }

    #[test]
    fn walls_keep_a_radius_of_distance() {
        let domain = channel();
        let z = |z: f64| domain.push_out_of_walls(DVec3::new(900.0, 0.0, z), 1.5).z;
        assert_eq!([z(-99.0), z(-79.0), z(0.0), z(19.9)], [-78.5, -78.5, 0.0, 18.5]);
        assert_eq!(domain.squeeze(DVec3::new(7.0, 8.0, -80.0), 1.5), DVec3::new(7.0, 8.0, -78.5));
        assert_eq!(domain.squeeze(DVec3::new(7.0, 8.0, -30.0), 1.5), DVec3::new(7.0, 8.0, -30.0));
        assert_eq!(domain.room(1.5).unwrap().size(), DVec3::new(400.0, 200.0, 97.0));
        let message = domain.room(50.0).unwrap_err().to_string();
        assert_eq!(message, "domain: diameter_um = 100: expected less than the distance between the walls");
    }

    #[test]
    fn walls_reflect_and_periods_wrap() {
        let domain = channel();
        let z = |z: f64| domain.reflect(DVec3::new(900.0, 0.0, z), 1.0).z;
        for (from, to) in [(0.0, 0.0), (-79.5, -78.5), (21.0, 17.0), (119.0, -77.0), (-275.0, -79.0)] {
            assert!((z(from) - to).abs() < 1e-12, "{from}: {}", z(from));
        }
        let domain = Domain::new(*domain.region(), [Boundary::Periodic, Open, Wall]);
        let x = |x: f64| domain.wrap(DVec3::new(x, 500.0, 500.0));
        assert_eq!(x(250.0), DVec3::new(-150.0, 500.0, 500.0));
        assert_eq!([x(-200.0).x, x(200.0).x, x(-1001.0).x, x(199.5).x], [-200.0, -200.0, 199.0, 199.5]);
        assert!(x(-200.0 - 1e-14).x >= -200.0 && x(-200.0 - 1e-14).x < 200.0);
        assert!(!domain.is_beyond_open_face(DVec3::X * 999.0));
        assert!(domain.inflow_slabs(f64::INFINITY).len() == 1);
    }

    #[test]
    fn only_open_faces_can_be_passed() {
        let domain = channel();
        assert!(domain.is_beyond_open_face(DVec3::new(200.0, 0.0, 0.0)));
        assert!(!domain.is_beyond_open_face(DVec3::new(-200.0, 0.0, 500.0)));
        assert!(domain.is_beyond_open_face(DVec3::new(0.0, f64::NAN, 0.0)));
    }
}
