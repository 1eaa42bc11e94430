//! Solid bodies in the flow, which tracers cannot enter.
//!
//! Particle centers stay one radius away from the surface: seeds that would be closer are discarded, and a
//! particle that ends a step closer is moved to the nearest admissible position, as at the walls of the
//! domain. A drain removes the tracers that enter it from the recording; it represents the core of a sink.

use crate::error::{ParameterCheck, Result};
use crate::wall::{ParabolicCap, Wall};
use glam::{DVec2, DVec3};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

const CHECK: ParameterCheck = ParameterCheck("body");

/// Largest length, um.
const LARGEST_UM: f64 = 1e6;

/// A solid body that particles cannot enter.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
#[schemars(rename = "Obstacle")]
pub enum Body {
    /// A sphere.
    Sphere {
        /// Center (x, y, z).
        #[schemars(extend("x-formerly" = ["centre_um"]), example = (0, 0, -30))]
        center_um: (f64, f64, f64),
        /// Radius.
        #[schemars(extend("exclusiveMinimum" = 0, "maximum" = LARGEST_UM), example = 20.0)]
        radius_um: f64,
    },
    /// A cylinder along z.
    Cylinder {
        /// Axis (x, y).
        #[schemars(extend("x-formerly" = ["centre_um"]), example = (0, 0))]
        center_um: (f64, f64),
        /// Radius.
        #[schemars(extend("exclusiveMinimum" = 0, "maximum" = LARGEST_UM), example = 20.0)]
        radius_um: f64,
    },
    // It keeps seeds inside the drop but moves no particles: the free surface may move, and is handled by the field
    // (`VelocityField::confine`).
    /// The space outside a sessile drop in the shape of a parabolic cap.
    OutsideDrop {
        /// Center of the drop's base (x, y, z).
        #[schemars(extend("x-formerly" = ["centre_um"]), example = (0, 0, -80))]
        center_um: (f64, f64, f64),
        /// Radius of the drop's base.
        #[schemars(extend("exclusiveMinimum" = 0, "maximum" = LARGEST_UM), example = 200.0)]
        radius_um: f64,
        /// Height of the drop.
        #[schemars(extend("exclusiveMinimum" = 0, "maximum" = LARGEST_UM), example = 60.0)]
        height_um: f64,
    },
    /// A sphere that removes the particles that enter it.
    Drain {
        /// Center (x, y, z).
        #[schemars(extend("x-formerly" = ["centre_um"]), example = (0, 0, -30))]
        center_um: (f64, f64, f64),
        /// Radius.
        #[schemars(extend("exclusiveMinimum" = 0, "maximum" = LARGEST_UM), example = 20.0)]
        radius_um: f64,
    },
}

impl Body {
    /// The same body, or `Err` if its center is not finite or a length is not > 0.
    pub fn checked(self) -> Result<Self> {
        let (center, lengths) = match self {
            Body::Sphere { center_um, radius_um } | Body::Drain { center_um, radius_um } => {
                (DVec3::from(center_um), [("radius_um", radius_um), ("radius_um", radius_um)])
            }
            Body::Cylinder { center_um, radius_um } => {
                (DVec2::from(center_um).extend(0.0), [("radius_um", radius_um), ("radius_um", radius_um)])
            }
            Body::OutsideDrop { center_um, radius_um, height_um } => {
                (center_um.into(), [("radius_um", radius_um), ("height_um", height_um)])
            }
        };
        CHECK.finite_vector("center_um", center)?;
        for (name, length) in lengths {
            CHECK.positive(name, length)?;
        }
        Ok(self)
    }

    fn is_drain(&self) -> bool {
        matches!(self, Body::Drain { .. })
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
        matches!(self, Body::Sphere { .. } | Body::Cylinder { .. }).then(|| self.wall(x))
    }

    /// The distance (um) at which the body keeps particle centers: the radius, or 0 for a drain.
    fn margin(&self, radius: f64) -> f64 {
        if self.is_drain() { 0.0 } else { radius }
    }

    fn wall(&self, x: DVec3) -> Wall {
        match *self {
            Body::Sphere { center_um, radius_um } | Body::Drain { center_um, radius_um } => {
                Wall::outside(x - DVec3::from(center_um), radius_um)
            }
            Body::Cylinder { center_um, radius_um } => {
                Wall::outside((x.truncate() - DVec2::from(center_um)).extend(0.0), radius_um)
            }
            Body::OutsideDrop { center_um, radius_um: radius, height_um: height } => {
                ParabolicCap { center: center_um.into(), radius, height }.wall(x, height)
            }
        }
    }

    /// Whether the body is a drain and contains `x` (um).
    pub(crate) fn drains(&self, x: DVec3) -> bool {
        self.is_drain() && self.touches(x, 0.0)
    }

    /// The position (um) nearest to `x` (um) that is at least `margin` (um) from the body; `x` itself for a
    /// drain.
    pub(crate) fn push_out(&self, x: DVec3, margin: f64) -> DVec3 {
        match *self {
            _ if !self.touches(x, margin) => x,
            Body::Sphere { center_um, radius_um } => {
                let center = DVec3::from(center_um);
                center + (x - center).normalize_or(DVec3::X) * (radius_um + margin)
            }
            Body::Cylinder { center_um, radius_um } => {
                let center = DVec2::from(center_um);
                let arm = (x.truncate() - center).normalize_or(DVec2::X);
                (center + arm * (radius_um + margin)).extend(x.z)
            }
            Body::OutsideDrop { .. } | Body::Drain { .. } => x,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn particles_are_put_beside_bodies() {
        let sphere = Body::Sphere { center_um: (10.0, 0.0, 0.0), radius_um: 5.0 };
        assert!(sphere.touches(DVec3::X * 3.5, 2.0) && !sphere.touches(DVec3::X * 2.5, 2.0));
        assert_eq!(sphere.push_out(DVec3::X * 4.0, 2.0), DVec3::X * 3.0);
        let pillar = Body::Cylinder { center_um: (0.0, 0.0), radius_um: 5.0 };
        assert_eq!(pillar.push_out(DVec3::new(0.0, 1.0, 7.0), 1.0), DVec3::new(0.0, 6.0, 7.0));
        let drain = Body::Drain { center_um: (0.0, 0.0, 0.0), radius_um: 5.0 };
        assert!(drain.drains(DVec3::Y * 4.0) && !drain.drains(DVec3::Y * 5.5));
        assert!(!drain.touches(DVec3::Y * 5.5, 1.0));
        assert_eq!(drain.push_out(DVec3::Y, 1.0), DVec3::Y);
        let drop = Body::OutsideDrop { center_um: (0.0, 0.0, -80.0), radius_um: 200.0, height_um: 60.0 };
        assert!(!drop.touches(DVec3::Z * -50.0, 1.0) && drop.touches(DVec3::Z * -20.5, 1.0));
        assert!(drop.touches(DVec3::new(199.0, 0.0, -79.0), 0.0));
        let message = |body: Body| body.checked().unwrap_err().to_string();
        let negative = Body::Sphere { center_um: (0.0, 0.0, 0.0), radius_um: -5.0 };
        assert_eq!(message(negative), "body: radius_um = -5: expected a finite number > 0");
        let flat = Body::OutsideDrop { center_um: (0.0, 0.0, 0.0), radius_um: 1.0, height_um: 0.0 };
        assert!(message(flat).contains("height_um = 0"));
        assert!(Body::Cylinder { center_um: (0.0, f64::NAN), radius_um: 1.0 }.checked().is_err());
    }
}
