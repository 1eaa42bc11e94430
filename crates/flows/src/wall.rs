//! Walls: the boundaries of the fluid of a field.
//!
//! A field with walls returns the nearest wall of any point ([`crate::VelocityField::wall`]): the signed
//! distance from it, positive in the fluid, and its normal. Masks, seeding, inflow, reflection of Brownian
//! steps and the confinement of particles of finite size are derived from it. Bodies in the flow
//! ([`crate::Body`]) are walls too.

use crate::region::Axis;
use glam::{DVec2, DVec3};

/// Overlap (um) of particle and wall that is tolerated: above the rounding errors of coordinates and far
/// below anything visible.
pub const CONTACT_UM: f64 = 1e-9;

/// Walls coincide if 1 - cos of the angle between their normals is at most this,
const SAME_NORMAL: f64 = 1e-9;
/// and their clearances (um) differ by at most this.
const SAME_UM: f64 = 1e-6;

/// Maximum number of successive pushes of one particle.
const MAX_PUSHES: u32 = 16;

/// The wall nearest to a point.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Wall {
    /// Distance from the wall, um; negative inside the solid.
    pub clearance_um: f64,
    /// Unit normal of the wall, into the fluid.
    pub normal: DVec3,
}

impl Wall {
    /// The nearer to `x` (um) of two planes normal to `axis` at `low` and `high` (um), with fluid between
    /// them.
    pub(crate) fn between(axis: Axis, low: f64, high: f64, x: DVec3) -> Wall {
        let at = x[axis as usize];
        if at - low <= high - at {
            Wall { clearance_um: at - low, normal: axis.unit() }
        } else {
            Wall { clearance_um: high - at, normal: -axis.unit() }
        }
    }

    /// The wall of a cylinder or sphere of `radius` (um) filled with fluid; `arm` (um) is the vector from its
    /// axis or center to the point.
    pub(crate) fn inside(arm: DVec3, radius: f64) -> Wall {
        let r = arm.length();
        let normal = if r > 0.0 { -arm / r } else { DVec3::X };
        Wall { clearance_um: radius - r, normal }
    }

    /// The wall of a solid cylinder or sphere of `radius` (um); `arm` (um) is the vector from its axis or
    /// center to the point.
    pub(crate) fn outside(arm: DVec3, radius: f64) -> Wall {
        let r = arm.length();
        let normal = if r > 0.0 { arm / r } else { DVec3::X };
        Wall { clearance_um: r - radius, normal }
    }

    /// The nearer of two walls.
    pub(crate) fn or(self, other: Wall) -> Wall {
        if other.clearance_um < self.clearance_um { other } else { self }
    }

    /// Whether this wall is nearer than `other`, or the same, with the same normal.
    pub(crate) fn is_before(&self, other: &Wall) -> bool {
        self.normal.dot(other.normal) > 1.0 - SAME_NORMAL && self.clearance_um <= other.clearance_um + SAME_UM
    }

    /// Whether a particle of `radius` (um) at the point overlaps the wall by more than [`CONTACT_UM`].
    pub(crate) fn overlaps(&self, radius: f64) -> bool {
        self.clearance_um < radius - CONTACT_UM
    }
}

/// The nearer of two optional walls.
pub(crate) fn nearer(a: Option<Wall>, b: Option<Wall>) -> Option<Wall> {
    match (a, b) {
        (Some(a), Some(b)) => Some(a.or(b)),
        (a, b) => a.or(b),
    }
}

/// `x` (um) moved along the normals of the walls that a particle of `radius` (um) overlaps until it overlaps
/// none; `x` itself, bit for bit, if it overlaps none at first. Between walls that leave no room it ends near
/// both.
pub(crate) fn push_off(wall: impl Fn(DVec3) -> Option<Wall>, mut x: DVec3, radius: f64) -> DVec3 {
    for _ in 0..MAX_PUSHES {
        match wall(x) {
            Some(wall) if wall.overlaps(radius) => x += wall.normal * (radius - wall.clearance_um),
            _ => break,
        }
    }
    x
}

/// A sessile drop: a parabolic cap z = h (1 - rho^2 / R^2) on a floor.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct ParabolicCap {
    /// Center of the drop on the floor, um.
    pub(crate) center: DVec3,
    /// Contact radius R on the floor, um.
    pub(crate) radius: f64,
    /// Height h at the center, um.
    pub(crate) height: f64,
}

impl ParabolicCap {
    /// The nearer of the floor and the free surface, whose height at the center is `height` (um). The
    /// distance from the surface is correct to first order, by its tangent plane.
    pub(crate) fn wall(&self, x: DVec3, height: f64) -> Wall {
        let arm = x - self.center;
        let floor = Wall { clearance_um: arm.z, normal: DVec3::Z };
        let place = arm.truncate();
        let above = height * (1.0 - place.length_squared() / (self.radius * self.radius)) - arm.z;
        let slope: DVec2 = place * (-2.0 * height / (self.radius * self.radius));
        let length = libm::sqrt(1.0 + slope.length_squared());
        let surface = Wall { clearance_um: above / length, normal: slope.extend(-1.0) / length };
        floor.or(surface)
    }

    /// `x` (um) moved along z so that a particle of `radius` (um) is below a free surface of this `height`
    /// (um) at the center and above the floor. A particle that does not fit rests on the floor.
    pub(crate) fn hold_under(&self, x: DVec3, height: f64, radius: f64) -> DVec3 {
        let share = 1.0 - (x - self.center).truncate().length_squared() / (self.radius * self.radius);
        let ceiling = self.center.z + height * share.max(0.0) - radius;
        x.with_z(x.z.min(ceiling).max(self.center.z + radius))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn walls_push_particles_out_along_their_normals() {
        let tube = |x: DVec3| Some(Wall::inside(x.with_x(0.0), 10.0));
        assert_eq!(push_off(tube, DVec3::new(5.0, 0.0, 12.0), 1.0), DVec3::new(5.0, 0.0, 9.0));
        let kept = DVec3::new(5.0, 3.0, 4.0);
        assert_eq!(push_off(tube, kept, 1.0), kept);
        // A corner needs two pushes.
        let duct =
            |x: DVec3| Some(Wall::between(Axis::Y, -5.0, 5.0, x).or(Wall::between(Axis::Z, 0.0, 20.0, x)));
        assert_eq!(push_off(duct, DVec3::new(0.0, 7.0, 25.0), 1.0), DVec3::new(0.0, 4.0, 19.0));
        let pillar = |x: DVec3| Some(Wall::outside(x.with_z(0.0), 10.0));
        assert_eq!(push_off(pillar, DVec3::new(0.0, -6.0, 3.0), 2.0), DVec3::new(0.0, -12.0, 3.0));
        assert_eq!(push_off(|_| None, DVec3::X, 1.0), DVec3::X);
        // The normal is defined on the axis of a tube and of a pillar too.
        assert_eq!(Wall::inside(DVec3::ZERO, 10.0).normal.length(), 1.0);
        assert_eq!(Wall::outside(DVec3::ZERO, 10.0).clearance_um, -10.0);
    }

    #[test]
    fn a_cap_has_a_floor_and_a_surface() {
        let cap = ParabolicCap { center: DVec3::Z * -80.0, radius: 200.0, height: 60.0 };
        assert_eq!(cap.wall(DVec3::Z * -75.0, 60.0), Wall { clearance_um: 5.0, normal: DVec3::Z });
        assert_eq!(cap.wall(DVec3::Z * -23.0, 60.0).clearance_um, 3.0);
        // Outside the contact radius there is no fluid at any height.
        for z in [-80.0, -70.0, 0.0] {
            assert!(cap.wall(DVec3::new(230.0, 0.0, z), 60.0).overlaps(0.0), "{z}");
        }
        // At 100 um from the center the surface is 45 um high with a slope of -0.3.
        let wall = cap.wall(DVec3::new(100.0, 0.0, -36.0), 60.0);
        assert!((wall.clearance_um - 1.0 / libm::sqrt(1.09)).abs() < 1e-12);
        assert!((wall.normal - DVec3::new(-0.3, 0.0, -1.0).normalize()).length() < 1e-12);
        assert_eq!(cap.hold_under(DVec3::new(100.0, 0.0, 0.0), 60.0, 1.0).z, -36.0);
        assert_eq!(cap.hold_under(DVec3::new(199.9, 0.0, -78.0), 60.0, 1.0).z, -79.0);
    }
}
