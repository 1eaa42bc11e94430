//! What carries a particle: the fluid, and its own velocity through it.

use crate::field::VelocityField;
use crate::region::Region;
use glam::{DMat3, DVec3};

/// A field with the velocity of particles through the fluid added.
#[derive(Debug)]
pub(crate) struct Drifting<'a> {
    pub(crate) field: &'a dyn VelocityField,
    pub(crate) slip: DVec3,
}

impl VelocityField for Drifting<'_> {
    fn velocity(&self, x: DVec3, t: f64) -> DVec3 {
        self.field.velocity(x, t) + self.slip
    }

    fn gradient(&self, x: DVec3, t: f64) -> DMat3 {
        self.field.gradient(x, t)
    }

    fn flow_map(&self, x: DVec3, t0: f64, t1: f64) -> Option<DVec3> {
        if self.slip == DVec3::ZERO { self.field.flow_map(x, t0, t1) } else { None }
    }

    fn is_divergence_free(&self) -> bool {
        self.field.is_divergence_free()
    }

    fn max_speed(&self, region: &Region, t0: f64, t1: f64) -> f64 {
        self.field.max_speed(region, t0, t1) + self.slip.length()
    }

    fn step_limit(&self, x: DVec3, t: f64) -> Option<f64> {
        let speed = self.field.velocity(x, t).length();
        Some(self.field.step_limit(x, t)? * speed / (speed + self.slip.length()))
    }
}
