//! Bodies in the flow, which tracers do not enter.
//!
//! The centre of a particle stays a radius away from the surface: seeds that would lie closer are not sown, and a drift or a random step that
//! ends closer is put back to the nearest place outside, as at the walls of the domain. A drain takes the tracers that reach it out of the
//! recording, as the core of a sink does.

use crate::error::{Check, Result};
use glam::{DVec2, DVec3};

const CHECK: Check = Check("body");

/// A body.
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
    /// All that is outside a parabolic cap on a floor.
    OutsideCap {
        center: DVec3,
        radius: f64,
        height: f64,
    },
}

impl Body {
    /// A solid sphere; centre and radius (> 0) in um.
    pub fn sphere(center: DVec3, radius: f64) -> Result<Self> {
        CHECK.finite_vector("centre_um", center)?;
        CHECK.positive("radius_um", radius)?;
        Ok(Body { shape: Shape::Sphere { center, radius }, drain: false })
    }

    /// A solid cylinder along z; centre and radius (> 0) in um.
    pub fn cylinder(center: DVec2, radius: f64) -> Result<Self> {
        CHECK.finite_vector("centre_um", center.extend(0.0))?;
        CHECK.positive("radius_um", radius)?;
        Ok(Body { shape: Shape::Cylinder { center, radius }, drain: false })
    }

    /// Everything but a sessile drop: a parabolic cap of a height (um, > 0) over a circle of a radius (um, > 0) about `center` on the floor. It
    /// keeps seeds inside the drop; how the surface moves is up to the field ([`crate::VelocityField::confine`]), so that nothing is put back.
    pub fn outside_drop(center: DVec3, radius: f64, height: f64) -> Result<Self> {
        CHECK.finite_vector("centre_um", center)?;
        CHECK.positive("radius_um", radius)?;
        CHECK.positive("height_um", height)?;
        Ok(Body { shape: Shape::OutsideCap { center, radius, height }, drain: false })
    }

    /// The same body as a drain: tracers whose centre comes into it end.
    pub fn draining(self) -> Self {
        Body { drain: true, ..self }
    }

    /// Whether a particle of a radius (um) at `x` overlaps the body; of a drain, whether its centre is inside.
    pub fn touches(&self, x: DVec3, radius: f64) -> bool {
        let margin = if self.drain { 0.0 } else { radius };
        match self.shape {
            Shape::Sphere { center, radius } => (x - center).length() < radius + margin,
            Shape::Cylinder { center, radius } => (x.truncate() - center).length() < radius + margin,
            Shape::OutsideCap { center, radius, height } => {
                let share = 1.0 - (x - center).truncate().length_squared() / (radius * radius);
                x.z < center.z + margin || x.z > center.z + height * share - margin
            }
        }
    }

    /// Whether a tracer that comes to `x` ends there.
    pub(crate) fn drains(&self, x: DVec3) -> bool {
        self.drain && self.touches(x, 0.0)
    }

    /// The place nearest to `x` where a particle of a radius does not overlap the body.
    pub(crate) fn keep_off(&self, x: DVec3, margin: f64) -> DVec3 {
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
            Shape::OutsideCap { .. } => x,
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
        assert_eq!(sphere.keep_off(DVec3::X * 4.0, 2.0), DVec3::X * 3.0);
        let pillar = Body::cylinder(DVec2::ZERO, 5.0).unwrap();
        assert_eq!(pillar.keep_off(DVec3::new(0.0, 1.0, 7.0), 1.0), DVec3::new(0.0, 6.0, 7.0));
        let drain = pillar.draining();
        assert!(
            drain.drains(DVec3::Y * 4.0)
                && !drain.drains(DVec3::Y * 5.5)
                && !drain.touches(DVec3::Y * 5.5, 1.0)
        );
        assert_eq!(drain.keep_off(DVec3::Y, 1.0), DVec3::Y);
        let drop = Body::outside_drop(DVec3::Z * -80.0, 200.0, 60.0).unwrap();
        assert!(!drop.touches(DVec3::Z * -50.0, 1.0) && drop.touches(DVec3::Z * -20.5, 1.0));
        assert!(drop.touches(DVec3::new(199.0, 0.0, -79.0), 0.0));
        let message = Body::sphere(DVec3::ZERO, -5.0).unwrap_err().to_string();
        assert_eq!(message, "body: radius_um = -5: expected a finite number > 0");
    }
}
