//! Deterministic particle velocity: the velocity of the fluid, or the field that results from a
//! size-dependent force, plus the settling velocity.

use crate::field::VelocityField;
use crate::region::Region;
use glam::{DMat3, DVec3};
use std::sync::Arc;

/// The velocity field that particles of one size follow.
#[derive(Debug)]
enum Carrier<'a> {
    Fluid(&'a dyn VelocityField),
    OfSize(Arc<dyn VelocityField>),
}

/// A velocity field plus a constant slip velocity (um/s) of the particles relative to the fluid.
#[derive(Debug)]
pub(crate) struct Drifting<'a> {
    carrier: Carrier<'a>,
    slip: DVec3,
}

impl<'a> Drifting<'a> {
    /// The velocity field of particles of diameter `d_um` (um) that move relative to the fluid at `slip`
    /// (um/s).
    pub(crate) fn new(field: &'a dyn VelocityField, d_um: f64, slip: DVec3) -> Self {
        let carrier = field.for_diameter(d_um).map_or(Carrier::Fluid(field), Carrier::OfSize);
        Drifting { carrier, slip }
    }

    fn field(&self) -> &dyn VelocityField {
        match &self.carrier {
            Carrier::Fluid(field) => *field,
            Carrier::OfSize(field) => field.as_ref(),
        }
    }
}

impl VelocityField for Drifting<'_> {
    fn velocity(&self, x: DVec3, t: f64) -> DVec3 {
        self.field().velocity(x, t) + self.slip
    }

    fn gradient(&self, x: DVec3, t: f64) -> DMat3 {
        self.field().gradient(x, t)
    }

    fn flow_map(&self, x: DVec3, t0: f64, t1: f64) -> Option<DVec3> {
        if self.slip == DVec3::ZERO { self.field().flow_map(x, t0, t1) } else { None }
    }

    fn is_divergence_free(&self) -> bool {
        self.field().is_divergence_free()
    }

    fn max_speed(&self, region: &Region, t0: f64, t1: f64) -> f64 {
        self.field().max_speed(region, t0, t1) + self.slip.length()
    }

    fn step_limit(&self, x: DVec3, t: f64) -> Option<f64> {
        let speed = self.field().velocity(x, t).length();
        Some(self.field().step_limit(x, t)? * speed / (speed + self.slip.length()))
    }
}
