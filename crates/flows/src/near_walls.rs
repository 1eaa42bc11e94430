//! The walls near a sphere, and how they slow it.
//!
//! The walls are the walled faces of the box, the nearest wall of the field, and the bodies, except drains.
//! Each is replaced by its tangent plane at the point nearest to the sphere, so that a curved wall is a good
//! approximation if its radius of curvature is large compared with the distance of the sphere from it. Of two
//! walls with the same normal only the nearer counts. A free surface is treated as a wall.
//!
//! Several walls are superposed: the resistances that they add to that far from walls are summed (Oseen),
//! R = 1 + sum (R_wall - 1). In the middle between two plates at distances h this gives mobilities of
//! 1 - 1.125 a/h along and 1 - 2.25 a/h across the plates to first order, instead of 1 - 1.004 a/h and
//! 1 - 1.452 a/h (Faxen; Ho and Leal, J. Fluid Mech. 65 (1974) 365). Along plates at least four radii apart the
//! error is below 2 % (Faxen's series to fifth order); across them it is about 0.8 a/h, 4 % if they are 40
//! radii apart. Near one of the plates both errors are smaller.
//!
//! The flow carries a sphere at its own velocity at the center, less the lag: the velocity along a wall,
//! relative to the fluid at the wall, is multiplied by the slip in a simple shear
//! ([`crate::hindered::slip_in_shear`]). The curvature of the velocity profile over the sphere is neglected,
//! as it is without walls, and so is the lag of the velocity toward a wall. Where the velocity along a wall
//! varies in its own direction, the lag makes the velocity of the spheres slightly divergent.

use crate::hindered::{resistances, slip_in_shear};
use crate::{FluidRegion, VelocityField, Wall};
use glam::{DMat3, DVec3};

/// The walls around spheres of one size.
#[derive(Debug, Clone, Copy)]
pub(crate) struct NearWalls<'a> {
    fluid: FluidRegion<'a>,
    radius: f64,
    /// Force on the spheres over kB T, 1/um.
    pub(crate) pull: DVec3,
}

impl<'a> NearWalls<'a> {
    /// The walls of `fluid` around spheres of `radius` (um, > 0).
    pub(crate) fn new(fluid: FluidRegion<'a>, radius: f64) -> Self {
        NearWalls { fluid, radius, pull: DVec3::ZERO }
    }

    /// Radius of the spheres, um.
    pub(crate) fn radius(&self) -> f64 {
        self.radius
    }

    /// Whether a sphere at `x` (um) overlaps no wall at `t` (s).
    pub(crate) fn admits(&self, x: DVec3, t: f64) -> bool {
        self.fluid.hold(x, t, self.radius) == x
    }

    /// Resistance to motion, relative to that far from walls, of a sphere at `x` (um) and `t` (s): a
    /// symmetric positive definite matrix; `None` without walls.
    pub(crate) fn resistance(&self, x: DVec3, t: f64) -> Option<DMat3> {
        let (mut sum, mut any) = (DMat3::IDENTITY, false);
        for wall in self.walls(x, t) {
            let (along, across) = resistances(self.gap(&wall));
            let (along, across) = (along - 1.0, across - 1.0);
            let n = wall.normal;
            let outer = DMat3::from_cols(n * n.x, n * n.y, n * n.z);
            sum += DMat3::IDENTITY * along + outer * (across - along);
            any = true;
        }
        any.then_some(sum)
    }

    /// Velocity (um/s) at `x` (um) and `t` (s) of a sphere that `flow` carries and that a force would move at
    /// `forced` (um/s) far from walls.
    pub(crate) fn velocity(&self, flow: &dyn VelocityField, forced: DVec3, x: DVec3, t: f64) -> DVec3 {
        let mut carried = flow.velocity(x, t);
        for wall in self.walls(x, t) {
            let at_wall = flow.velocity(x - wall.normal * wall.clearance_um, t);
            if at_wall.is_finite() {
                let relative = carried - at_wall;
                let along = relative - wall.normal * wall.normal.dot(relative);
                carried -= along * (1.0 - slip_in_shear(self.gap(&wall)));
            }
        }
        if forced == DVec3::ZERO {
            return carried;
        }
        carried + self.resistance(x, t).map_or(forced, |resistance| resistance.inverse() * forced)
    }

    /// Gap between sphere and wall in radii.
    fn gap(&self, wall: &Wall) -> f64 {
        wall.clearance_um / self.radius - 1.0
    }

    fn walls(&self, x: DVec3, t: f64) -> impl Iterator<Item = Wall> {
        let field_wall = self.fluid.field.wall(x, t);
        let bodies = self.fluid.bodies.iter().filter_map(move |body| body.obstacle(x));
        let bodies = bodies.filter(move |body| !field_wall.is_some_and(|own| own.is_before(body)));
        self.fluid.walls(field_wall, x).chain(bodies)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fields::{Linear, Poiseuille, Tube, TubeParams};
    use crate::hindered::{resistance_across, resistance_along};
    use crate::{Body, Boundary, Domain, Region};

    fn domain(faces: [Boundary; 3]) -> Domain {
        let region = Region::new(DVec3::new(-50.0, -50.0, 0.0), DVec3::new(50.0, 50.0, 20.0)).unwrap();
        Domain::new(region, faces)
    }

    const PLATES: [Boundary; 3] = [Boundary::Open, Boundary::Open, Boundary::Wall];

    #[test]
    fn walls_of_box_and_field_at_the_same_place_count_once() {
        let domain = domain(PLATES);
        let count = |field: &dyn VelocityField, bodies: &[Body], x: DVec3| {
            NearWalls::new(FluidRegion::new(field, &domain, bodies), 0.5).walls(x, 0.0).count()
        };
        let rest = Linear::uniform(DVec3::ZERO).unwrap();
        let poiseuille = |top| Poiseuille::new(100.0, 0.0, top, 0.0).unwrap();
        let pillar = [
            Body::Cylinder { center_um: (0.0, 0.0), radius_um: 5.0 },
            Body::Drain { center_um: (30.0, 0.0, 0.0), radius_um: 1.0 },
        ];
        let x = DVec3::new(10.0, 0.0, 15.0);
        assert_eq!(count(&rest, &[], x), 2);
        assert_eq!(count(&poiseuille(20.0), &[], x), 2);
        assert_eq!(count(&poiseuille(20.0), &pillar, x), 3);
        // The plate of the field hides the face of the box behind it, and is hidden by a face before it.
        assert_eq!(count(&poiseuille(18.0), &[], x), 2);
        assert_eq!(count(&poiseuille(22.0), &[], x), 2);
        let tube = Tube::new(&TubeParams {
            radius_um: Some(8.0),
            center_yz_um: Some([0.0, 10.0]),
            ..TubeParams::default()
        });
        assert_eq!(count(&tube.unwrap(), &[], DVec3::new(0.0, 3.0, 12.0)), 3);
    }

    #[test]
    fn resistances_of_walls_add_up_along_and_across_each() {
        let rest = Linear::uniform(DVec3::ZERO).unwrap();
        let (open, walled) = (domain([Boundary::Open; 3]), domain(PLATES));
        let at = |domain: &Domain, bodies: &[Body], x: DVec3| {
            NearWalls::new(FluidRegion::new(&rest, domain, bodies), 0.5).resistance(x, 0.0)
        };
        assert_eq!(at(&open, &[], DVec3::Z), None);
        let two = at(&walled, &[], DVec3::Z * 2.0).unwrap();
        let along = resistance_along(3.0) + resistance_along(35.0) - 1.0;
        let across = resistance_across(3.0) + resistance_across(35.0) - 1.0;
        assert!(two.abs_diff_eq(DMat3::from_diagonal(DVec3::new(along, along, across)), 1e-12), "{two}");
        // A pillar is a plane normal to the arm.
        let pillar = [Body::Cylinder { center_um: (0.0, 0.0), radius_um: 5.0 }];
        let arm = DVec3::new(3.0, 4.0, 0.0) / 5.0;
        let beside = at(&open, &pillar, arm * 6.0).unwrap();
        assert!((beside * arm - arm * resistance_across(1.0)).length() < 1e-12);
        assert!((beside * DVec3::Z - DVec3::Z * resistance_along(1.0)).length() < 1e-12);
    }

    #[test]
    fn a_sphere_lags_behind_a_shear_and_not_behind_a_moving_wall() {
        let domain = domain(PLATES);
        let velocity = |field: &dyn VelocityField, forced: DVec3, z: f64| {
            NearWalls::new(FluidRegion::new(field, &domain, &[]), 0.5).velocity(
                field,
                forced,
                DVec3::Z * z,
                0.0,
            )
        };
        let channel = Poiseuille::new(100.0, 0.0, 20.0, 0.0).unwrap();
        let there = velocity(&channel, DVec3::ZERO, 0.6);
        let fluid = channel.velocity(DVec3::Z * 0.6, 0.0);
        assert!((there / fluid.x - DVec3::X * slip_in_shear(0.2)).length() < 1e-5, "{there} {fluid}");
        // Walls that move with the fluid, as in plug flow.
        let plug = Linear::uniform(DVec3::X * 3.0).unwrap();
        assert_eq!(velocity(&plug, DVec3::ZERO, 0.6), DVec3::X * 3.0);
        // A force.
        let sinking = velocity(&plug, DVec3::Z * -2.0, 0.6);
        let resistance = resistance_across(0.2) + resistance_across(37.8) - 1.0;
        assert!((sinking - DVec3::new(3.0, 0.0, -2.0 / resistance)).length() < 1e-12);
    }
}
