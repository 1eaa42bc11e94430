//! Deterministic particle velocity: the velocity of the fluid, or the field that results from a
//! size-dependent force, plus the settling velocity; near walls, if they slow the particles, less the lag
//! behind the fluid and with the mobility there ([`crate::near_walls`]).

use crate::field::{VelocityField, differences};
use crate::near_walls::NearWalls;
use crate::region::Region;
use glam::{DMat3, DVec3};
use std::sync::Arc;

/// The velocity field that particles of one size follow.
#[derive(Debug)]
enum Carrier<'a> {
    Fluid(&'a dyn VelocityField),
    OfSize(Arc<dyn VelocityField>),
}

/// A velocity field plus a constant slip velocity (um/s) of the particles relative to the fluid, both reduced
/// near walls if these slow the particles.
#[derive(Debug)]
pub(crate) struct Drifting<'a> {
    fluid: &'a dyn VelocityField,
    carrier: Carrier<'a>,
    slip: DVec3,
    walls: Option<NearWalls<'a>>,
}

impl<'a> Drifting<'a> {
    /// The velocity field of particles of diameter `d_um` (um) that move relative to the fluid at `slip`
    /// (um/s).
    pub(crate) fn new(field: &'a dyn VelocityField, d_um: f64, slip: DVec3) -> Self {
        let carrier = field.for_diameter(d_um).map_or(Carrier::Fluid(field), Carrier::OfSize);
        Drifting { fluid: field, carrier, slip, walls: None }
    }

    /// The same near walls that slow the particles.
    pub(crate) fn near(self, walls: Option<NearWalls<'a>>) -> Self {
        Drifting { walls, ..self }
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
        let Some(walls) = &self.walls else { return self.field().velocity(x, t) + self.slip };
        let forced = match &self.carrier {
            Carrier::Fluid(_) => self.slip,
            Carrier::OfSize(field) => field.velocity(x, t) - self.fluid.velocity(x, t) + self.slip,
        };
        walls.velocity(self.fluid, forced, x, t)
    }

    fn gradient(&self, x: DVec3, t: f64) -> DMat3 {
        if self.walls.is_some() { differences(self, x, t) } else { self.field().gradient(x, t) }
    }

    fn flow_map(&self, x: DVec3, t0: f64, t1: f64) -> Option<DVec3> {
        if self.slip == DVec3::ZERO && self.walls.is_none() { self.field().flow_map(x, t0, t1) } else { None }
    }

    fn is_divergence_free(&self) -> bool {
        self.field().is_divergence_free() && self.walls.is_none()
    }

    fn max_speed(&self, region: &Region, t0: f64, t1: f64) -> f64 {
        // A lag behind a moving wall may turn the velocity, to a component along the wall that is at most the
        // speed of the fluid.
        let turned = if self.walls.is_some() { std::f64::consts::SQRT_2 } else { 1.0 };
        self.field().max_speed(region, t0, t1) * turned + self.slip.length()
    }

    fn step_limit(&self, x: DVec3, t: f64) -> Option<f64> {
        let speed = self.field().velocity(x, t).length();
        Some(self.field().step_limit(x, t)? * speed / (speed + self.slip.length()))
    }
}
