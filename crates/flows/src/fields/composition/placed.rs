//! A translated, rotated or reflected field.

use super::Inner;
use crate::fields::prelude::*;
use glam::DQuat;
use std::sync::Arc;

const TRANSLATED: ParameterCheck = ParameterCheck("translated");
const ROTATED: ParameterCheck = ParameterCheck("rotated");
const MIRRORED: ParameterCheck = ParameterCheck("mirrored");

params! {
    /// Parameters of [`Translated`].
    TranslatedParams {
        /// Displacement of the field, um.
        offset_um: [f64; 3] = [0.0, 0.0, 0.0], [finite];
    }
}

params! {
    /// Parameters of [`Rotated`].
    RotatedParams {
        /// Direction of the axis.
        axis: [f64; 3] = [0.0, 0.0, 1.0], [finite], "not all zero";
        /// Angle of rotation, rad; a positive angle about z is clockwise on the screen.
        angle_rad: f64 = 0.0, [finite];
        /// A point on the axis, um.
        #[alias = "centre_um"]
        center_um: [f64; 3] = [0.0, 0.0, 0.0], [finite];
    }
}

params! {
    /// Parameters of [`Mirrored`].
    MirroredParams {
        /// Axis normal to the mirror plane.
        axis: Axis = Axis::X, [one of], "x, y or z";
        /// Position of the mirror plane on this axis, um.
        at_um: f64 = 0.0, [finite];
    }
}

/// A field under a rigid transformation T, reflections included: u = T f(T^-1 x).
#[derive(Debug)]
struct Placed {
    inner: Inner,
    /// Orthogonal matrix.
    turn: DMat3,
    /// x = turn y + shift.
    shift: DVec3,
}

impl Placed {
    /// T x = `turn` (x - `center`) + `center` + `shift`.
    fn new(inner: Box<dyn VelocityField>, turn: DMat3, center: DVec3, shift: DVec3) -> Placed {
        Placed { inner: inner.into(), turn, shift: center - turn * center + shift }
    }

    fn inward(&self, x: DVec3) -> DVec3 {
        self.turn.transpose() * (x - self.shift)
    }

    fn outward(&self, x: DVec3) -> DVec3 {
        self.turn * x + self.shift
    }

    fn max_speed(&self, region: &Region, t0: f64, t1: f64) -> f64 {
        // The margin covers rounding errors of the corners.
        let inner = region.mapped(|x| self.inward(x)).grown(1e-9);
        self.inner.max_speed(&inner, t0, t1) * ROUNDING_MARGIN
    }
}

/// Implements [`VelocityField`] for a wrapper of [`Placed`].
macro_rules! by_placement {
    ($field:ty, $make:expr) => {
        impl VelocityField for $field {
            fn velocity(&self, x: DVec3, t: f64) -> DVec3 {
                self.0.turn * self.0.inner.velocity(self.0.inward(x), t)
            }

            fn gradient(&self, x: DVec3, t: f64) -> DMat3 {
                self.0.turn * self.0.inner.gradient(self.0.inward(x), t) * self.0.turn.transpose()
            }

            fn flow_map(&self, x: DVec3, t0: f64, t1: f64) -> Option<DVec3> {
                Some(self.0.outward(self.0.inner.flow_map(self.0.inward(x), t0, t1)?))
            }

            fn invariant(&self, x: DVec3, t: f64) -> Option<f64> {
                self.0.inner.invariant(self.0.inward(x), t)
            }

            fn is_divergence_free(&self) -> bool {
                self.0.inner.is_divergence_free()
            }

            fn is_steady(&self) -> bool {
                self.0.inner.is_steady()
            }

            fn max_speed(&self, region: &Region, t0: f64, t1: f64) -> f64 {
                self.0.max_speed(region, t0, t1)
            }

            fn step_limit(&self, x: DVec3, t: f64) -> Option<f64> {
                self.0.inner.step_limit(self.0.inward(x), t)
            }

            fn wall(&self, x: DVec3, t: f64) -> Option<Wall> {
                let wall = self.0.inner.wall(self.0.inward(x), t)?;
                Some(Wall { normal: self.0.turn * wall.normal, ..wall })
            }

            fn for_diameter(&self, d_um: f64) -> Option<Inner> {
                let inner = self.0.inner.for_diameter(d_um)?;
                let field: $field = $make(Placed { inner, ..self.0 });
                Some(Arc::new(field))
            }

            fn confine(&self, x: DVec3, t: f64, radius: f64) -> DVec3 {
                let inward = self.0.inward(x);
                let held = self.0.inner.confine(inward, t, radius);
                // A particle that overlaps no wall keeps its position bit for bit.
                if held == inward { x } else { self.0.outward(held) }
            }
        }
    };
}

/// A translated field.
#[derive(Debug)]
pub struct Translated(Placed);

impl Translated {
    /// `inner`, translated.
    pub fn new(inner: Box<dyn VelocityField>, params: &TranslatedParams) -> Result<Self> {
        let offset = DVec3::from_array(TRANSLATED.all_finite("offset_um", params.offset_um)?);
        Ok(Translated(Placed::new(inner, DMat3::IDENTITY, DVec3::ZERO, offset)))
    }
}

by_placement!(Translated, Translated);

/// A field rotated about an axis.
#[derive(Debug)]
pub struct Rotated(Placed);

impl Rotated {
    /// `inner`, rotated.
    pub fn new(inner: Box<dyn VelocityField>, params: &RotatedParams) -> Result<Self> {
        let axis = DVec3::from_array(ROTATED.all_finite("axis", params.axis)?);
        let center = DVec3::from_array(ROTATED.all_finite("center_um", params.center_um)?);
        let half = 0.5 * ROTATED.finite("angle_rad", params.angle_rad)?;
        let Some(axis) = axis.try_normalize() else {
            return Err(ROTATED.fault("axis", format!("{:?}", params.axis), "a vector other than zero"));
        };
        let (sin, cos) = libm::sincos(half);
        let turn = DMat3::from_quat(DQuat::from_xyzw(axis.x * sin, axis.y * sin, axis.z * sin, cos));
        Ok(Rotated(Placed::new(inner, turn, center, DVec3::ZERO)))
    }
}

by_placement!(Rotated, Rotated);

/// A field reflected at a plane; vortices rotate in the opposite sense.
#[derive(Debug)]
pub struct Mirrored(Placed);

impl Mirrored {
    /// `inner`, reflected.
    pub fn new(inner: Box<dyn VelocityField>, params: &MirroredParams) -> Result<Self> {
        let center = params.axis.unit() * MIRRORED.finite("at_um", params.at_um)?;
        let turn = DMat3::from_diagonal(DVec3::ONE - 2.0 * params.axis.unit());
        Ok(Mirrored(Placed::new(inner, turn, center, DVec3::ZERO)))
    }
}

by_placement!(Mirrored, Mirrored);
