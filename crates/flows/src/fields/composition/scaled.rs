use super::{Field, Inner, Transform};
use crate::fields::prelude::*;

params! {
    /// Parameters of a field with scaled velocities and lengths.
    ScaledParams("scaled") {
        /// Factor by which velocities are multiplied.
        velocity_factor: f64 = 1.0, [finite];
        /// Factor by which lengths are multiplied.
        length_factor: f64 = 1.0, [> 0];
        /// Fixed point of the scaling, um.
        #[alias = "centre_um"]
        center_um: [f64; 3] = [0.0, 0.0, 0.0], [finite];
    }
}

#[derive(Debug)]
struct Scaled {
    inner: Inner,
    velocity: f64,
    length: f64,
    center: DVec3,
}

impl Transform for ScaledParams {
    fn apply(&self, inner: Field) -> Result<Field> {
        let ScaledParams { velocity_factor: velocity, length_factor: length, center_um } = self.checked()?;
        Ok(Box::new(Scaled { inner: inner.into(), velocity, length, center: DVec3::from_array(center_um) }))
    }
}

impl Scaled {
    fn inward(&self, x: DVec3) -> DVec3 {
        self.center + (x - self.center) / self.length
    }

    fn outward(&self, x: DVec3) -> DVec3 {
        self.center + (x - self.center) * self.length
    }
}

impl VelocityField for Scaled {
    // The inner field uses the physical particle diameter, which is not scaled.
    like_inner!(Scaled, same_walls);

    fn velocity(&self, x: DVec3, t: f64) -> DVec3 {
        self.inner.velocity(self.inward(x), t) * self.velocity
    }

    fn gradient(&self, x: DVec3, t: f64) -> DMat3 {
        self.inner.gradient(self.inward(x), t) * (self.velocity / self.length)
    }

    fn flow_map(&self, x: DVec3, t0: f64, t1: f64) -> Option<DVec3> {
        let rate = self.velocity / self.length;
        let steady = self.inner.is_steady() || rate == 1.0;
        let (t0, t1) = if rate == 1.0 { (t0, t1) } else { (0.0, (t1 - t0) * rate) };
        if steady { Some(self.outward(self.inner.flow_map(self.inward(x), t0, t1)?)) } else { None }
    }

    fn invariant(&self, x: DVec3, t: f64) -> Option<f64> {
        let similar = self.inner.is_steady() || self.velocity == self.length;
        if similar { self.inner.invariant(self.inward(x), t) } else { None }
    }

    fn is_steady(&self) -> bool {
        self.inner.is_steady()
    }

    fn max_speed(&self, region: &Region, t0: f64, t1: f64) -> f64 {
        let inner = self.inner.max_speed(&region.mapped(|x| self.inward(x)), t0, t1);
        if self.velocity == 0.0 { 0.0 } else { inner * self.velocity.abs() * ROUNDING_MARGIN }
    }

    fn step_limit(&self, x: DVec3, t: f64) -> Option<f64> {
        Some(self.inner.step_limit(self.inward(x), t)? * (self.length / self.velocity).abs())
    }

    fn share_without_data(&self, region: &Region) -> f64 {
        self.inner.share_without_data(&region.mapped(|x| self.inward(x)))
    }

    fn wall(&self, x: DVec3, t: f64) -> Option<Wall> {
        let wall = self.inner.wall(self.inward(x), t)?;
        Some(Wall { clearance_um: wall.clearance_um * self.length, ..wall })
    }

    fn confine(&self, x: DVec3, t: f64, radius: f64) -> DVec3 {
        let inward = self.inward(x);
        let held = self.inner.confine(inward, t, radius / self.length);
        // A particle that overlaps no wall keeps its position bit for bit.
        if held == inward { x } else { self.outward(held) }
    }
}
