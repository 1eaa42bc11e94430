//! A translated, rotated or reflected field.

use super::{Field, Inner, Transform};
use crate::fields::prelude::*;
use glam::DQuat;

params! {
    /// Parameters of a translated field.
    TranslatedParams("translated") {
        /// Displacement of the field, um.
        offset_um: [f64; 3] = [0.0, 0.0, 0.0], [finite];
    }
}

params! {
    /// Parameters of a field rotated about an axis.
    RotatedParams("rotated") {
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
    /// Parameters of a field reflected at a plane.
    MirroredParams("mirrored") {
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
    fn field(inner: Field, turn: DMat3, center: DVec3, shift: DVec3) -> Field {
        Box::new(Placed { inner: inner.into(), turn, shift: center - turn * center + shift })
    }

    fn inward(&self, x: DVec3) -> DVec3 {
        self.turn.transpose() * (x - self.shift)
    }

    fn outward(&self, x: DVec3) -> DVec3 {
        self.turn * x + self.shift
    }
}

impl VelocityField for Placed {
    like_inner!(Placed);

    fn velocity(&self, x: DVec3, t: f64) -> DVec3 {
        self.turn * self.inner.velocity(self.inward(x), t)
    }

    fn gradient(&self, x: DVec3, t: f64) -> DMat3 {
        self.turn * self.inner.gradient(self.inward(x), t) * self.turn.transpose()
    }

    fn flow_map(&self, x: DVec3, t0: f64, t1: f64) -> Option<DVec3> {
        Some(self.outward(self.inner.flow_map(self.inward(x), t0, t1)?))
    }

    fn invariant(&self, x: DVec3, t: f64) -> Option<f64> {
        self.inner.invariant(self.inward(x), t)
    }

    fn is_steady(&self) -> bool {
        self.inner.is_steady()
    }

    fn max_speed(&self, region: &Region, t0: f64, t1: f64) -> f64 {
        // The margin covers rounding errors of the corners.
        let inner = region.mapped(|x| self.inward(x)).grown(1e-9);
        self.inner.max_speed(&inner, t0, t1) * ROUNDING_MARGIN
    }

    fn step_limit(&self, x: DVec3, t: f64) -> Option<f64> {
        self.inner.step_limit(self.inward(x), t)
    }

    fn wall(&self, x: DVec3, t: f64) -> Option<Wall> {
        let wall = self.inner.wall(self.inward(x), t)?;
        Some(Wall { normal: self.turn * wall.normal, ..wall })
    }

    fn walls_same_along(&self) -> [bool; 3] {
        let is_turned = self.turn != DMat3::from_diagonal(self.turn.diagonal());
        if is_turned { [false; 3] } else { self.inner.walls_same_along() }
    }

    fn confine(&self, x: DVec3, t: f64, radius: f64) -> DVec3 {
        let inward = self.inward(x);
        let held = self.inner.confine(inward, t, radius);
        // A particle that overlaps no wall keeps its position bit for bit.
        if held == inward { x } else { self.outward(held) }
    }
}

impl Transform for TranslatedParams {
    fn apply(&self, inner: Field) -> Result<Field> {
        let offset = DVec3::from_array(self.checked()?.offset_um);
        Ok(Placed::field(inner, DMat3::IDENTITY, DVec3::ZERO, offset))
    }
}

impl Transform for RotatedParams {
    fn apply(&self, inner: Field) -> Result<Field> {
        let RotatedParams { axis, angle_rad, center_um } = self.checked()?;
        let Some(axis) = DVec3::from_array(axis).try_normalize() else {
            return Err(Self::CHECK.fault("axis", format!("{axis:?}"), "a vector other than zero"));
        };
        let (sin, cos) = libm::sincos(0.5 * angle_rad);
        let turn = DMat3::from_quat(DQuat::from_xyzw(axis.x * sin, axis.y * sin, axis.z * sin, cos));
        Ok(Placed::field(inner, turn, DVec3::from_array(center_um), DVec3::ZERO))
    }
}

/// Vortices rotate in the opposite sense.
impl Transform for MirroredParams {
    fn apply(&self, inner: Field) -> Result<Field> {
        let center = self.axis.unit() * self.checked()?.at_um;
        let turn = DMat3::from_diagonal(DVec3::ONE - 2.0 * self.axis.unit());
        Ok(Placed::field(inner, turn, center, DVec3::ZERO))
    }
}
