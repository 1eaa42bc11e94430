//! Solid bodies in the flow, which tracers cannot enter.
//!
//! Particle centers stay one radius away from the surface: seeds that would be closer are discarded, and a
//! particle that ends a step closer is moved to the nearest admissible position, as at the walls of the
//! domain. A drain removes the tracers that enter it from the recording; it represents the core of a sink.

use crate::error::{ParameterCheck, Result};
use crate::wall::{ParabolicCap, Wall};
use glam::{DVec2, DVec3};

const CHECK: ParameterCheck = ParameterCheck("body");

/// A solid body or a drain.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Body {
    shape: Shape,
    drain: bool,
}

#[derive(Debug, Clone, Copy, PartialEq)]
enum Shape {
    Sphere {
        center: DVec3,
        radius: f64,
    },
    Cylinder {
        center: DVec2,
        radius: f64,
    },
    /// The space outside a parabolic cap on a floor.
    OutsideCap(ParabolicCap),
}

impl Body {
    /// A solid sphere; center and radius (> 0) in um.
    pub fn sphere(center: DVec3, radius: f64) -> Result<Self> {
        CHECK.finite_vector("center_um", center)?;
        CHECK.positive("radius_um", radius)?;
        Ok(Body { shape: Shape::Sphere { center, radius }, drain: false })
    }

    /// A solid cylinder along z; center and radius (> 0) in um.
    pub fn cylinder(center: DVec2, radius: f64) -> Result<Self> {
        CHECK.finite_vector("center_um", center.extend(0.0))?;
        CHECK.positive("radius_um", radius)?;
        Ok(Body { shape: Shape::Cylinder { center, radius }, drain: false })
    }

    /// The space outside a sessile drop: a parabolic cap of positive `height` (um) over a circle of positive
    /// `radius` (um) about `center` (um) on the floor. It keeps seeds inside the drop but moves no particles: the free
    /// surface may move, and is handled by the field ([`crate::VelocityField::confine`]).
    pub fn outside_drop(center: DVec3, radius: f64, height: f64) -> Result<Self> {
        CHECK.finite_vector("center_um", center)?;
        CHECK.positive("radius_um", radius)?;
        CHECK.positive("height_um", height)?;
        let cap = ParabolicCap { center, radius, height };
        Ok(Body { shape: Shape::OutsideCap(cap), drain: false })
    }

    /// The same body as a drain, which removes tracers whose center enters it.
    pub fn draining(self) -> Self {
        Body { drain: true, ..self }
    }

    /// Whether a particle of `radius` (um) at `x` (um) overlaps the body; for a drain, whether its center is
    /// inside.
    pub fn touches(&self, x: DVec3, radius: f64) -> bool {
        self.wall(x).overlaps(self.margin(radius))
    }

    /// Gap (um) between the surfaces of the body and of a particle of `radius` (um) at `x` (negative:
    /// overlap), and the normal of the body there.
    pub(crate) fn room(&self, x: DVec3, radius: f64) -> (f64, DVec3) {
        let wall = self.wall(x);
        (wall.clearance_um - self.margin(radius), wall.normal)
    }

    /// The surface of the body as a wall seen from `x` (um); `None` for a drain, which is none, and for the
    /// space outside a drop, whose surface belongs to the field.
    pub(crate) fn obstacle(&self, x: DVec3) -> Option<Wall> {
        let is_wall = !self.drain && !matches!(self.shape, Shape::OutsideCap(_));
        is_wall.then(|| self.wall(x))
    }

    /// The distance (um) at which the body keeps particle centers: the radius, or 0 for a drain.
    fn margin(&self, radius: f64) -> f64 {
        if self.drain { 0.0 } else { radius }
    }

    fn wall(&self, x: DVec3) -> Wall {
        match self.shape {
            Shape::Sphere { center, radius } => Wall::outside(x - center, radius),
            Shape::Cylinder { center, radius } => Wall::outside((x.truncate() - center).extend(0.0), radius),
            Shape::OutsideCap(cap) => cap.wall(x, cap.height),
        }
    }

    /// Whether the body is a drain and contains `x` (um).
    pub(crate) fn drains(&self, x: DVec3) -> bool {
        self.drain && self.touches(x, 0.0)
    }

    /// The position (um) nearest to `x` (um) that is at least `margin` (um) from the body; `x` itself for a
    /// drain.
    pub(crate) fn push_out(&self, x: DVec3, margin: f64) -> DVec3 {
        if self.drain || !self.touches(x, margin) {
            return x;
        }
        match self.shape {
            Shape::Sphere { center, radius } => {
                center + (x - center).normalize_or(DVec3::X) * (radius + margin)
            }
            Shape::Cylinder { center, radius } => {
                let arm = (x.truncate() - center).normalize_or(DVec2::X);
                (center + arm * (radius + margin)).extend(x.z)
            }
            Shape::OutsideCap(_) => x,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn particles_are_put_beside_bodies() {
        let sphere = Body::sphere(DVec3::X * 10.0, 5.0).unwrap();
        assert!(sphere.touches(DVec3::X * 3.5, 2.0) && !sphere.touches(DVec3::X * 2.5, 2.0));
        assert_eq!(sphere.push_out(DVec3::X * 4.0, 2.0), DVec3::X * 3.0);
        let pillar = Body::cylinder(DVec2::ZERO, 5.0).unwrap();
        assert_eq!(pillar.push_out(DVec3::new(0.0, 1.0, 7.0), 1.0), DVec3::new(0.0, 6.0, 7.0));
        let drain = pillar.draining();
        assert!(
            drain.drains(DVec3::Y * 4.0)
                && !drain.drains(DVec3::Y * 5.5)
                && !drain.touches(DVec3::Y * 5.5, 1.0)
        );
        assert_eq!(drain.push_out(DVec3::Y, 1.0), DVec3::Y);
        let drop = Body::outside_drop(DVec3::Z * -80.0, 200.0, 60.0).unwrap();
        assert!(!drop.touches(DVec3::Z * -50.0, 1.0) && drop.touches(DVec3::Z * -20.5, 1.0));
        assert!(drop.touches(DVec3::new(199.0, 0.0, -79.0), 0.0));
        let message = Body::sphere(DVec3::ZERO, -5.0).unwrap_err().to_string();
        assert_eq!(message, "body: radius_um = -5: expected a finite number > 0");
    }
}
