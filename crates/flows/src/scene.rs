//! A scene: a velocity field, its domain, the seeding, and all other properties and motions of the particles.

use crate::drift::Drifting;
use crate::near_walls::NearWalls;
use crate::seeding::Seed;
use crate::{
    Body, Brownian, Domain, FluidFractionCache, FluidRegion, Intensities, Result, Seeding, Settling, Shutter,
    SpheroidFriction, Spheroids, Tracer, VelocityField,
};
use glam::DVec3;
use microsig_core::stream::{Purpose, Streams};

/// A velocity field, the domain, the seeding and further settings, checked to be consistent.
#[derive(Debug, Clone, Copy)]
pub struct Scene<'a> {
    pub(crate) field: &'a dyn VelocityField,
    pub(crate) domain: &'a Domain,
    pub(crate) seeding: &'a Seeding,
    /// Density of seeding candidates, 1/um^3; those that overlap no wall become particles.
    pub(crate) density: f64,
    bodies: &'a [Body],
    kept: Option<&'a FluidFractionCache>,
    pub(crate) settling: Option<Settling>,
    pub(crate) brownian: Option<Brownian>,
    pub(crate) spheroids: Option<Spheroids>,
    pub(crate) friction: SpheroidFriction,
    intensities: Intensities,
    pub(crate) keeps_ids: bool,
    pub(crate) shutter: Option<Shutter>,
    walls_slow: bool,
}

impl<'a> Scene<'a> {
    /// A scene without bodies, settling, Brownian motion or exposure time; `Err` if the seeding is
    /// incompatible with the domain or its fluid at t = 0 (see [`Seeding::density`]).
    pub fn new(field: &'a dyn VelocityField, domain: &'a Domain, seeding: &'a Seeding) -> Result<Self> {
        Scene::in_fluid(FluidRegion::new(field, domain, &[]), seeding)
    }

    /// The same in a fluid region, which may have bodies that tracers cannot enter.
    pub fn in_fluid(fluid: FluidRegion<'a>, seeding: &'a Seeding) -> Result<Self> {
        Scene {
            field: fluid.field,
            domain: fluid.domain,
            seeding,
            density: 0.0,
            bodies: fluid.bodies,
            kept: fluid.kept,
            settling: None,
            brownian: None,
            spheroids: None,
            friction: SpheroidFriction::SPHERE,
            intensities: Intensities::default(),
            keeps_ids: false,
            shutter: None,
            walls_slow: false,
        }
        .seeded_at(0.0)
    }

    /// With the candidate density recomputed for the walls at `t` (s).
    pub(crate) fn seeded_at(self, t: f64) -> Result<Self> {
        Ok(Scene { density: self.seeding.density(&self.fluid(), t)?, ..self })
    }

    /// With particles that settle.
    pub fn with_settling(self, settling: Settling) -> Self {
        Scene { settling: Some(settling), ..self }
    }

    /// Without settling.
    pub(crate) fn without_settling(self) -> Self {
        Scene { settling: None, ..self }
    }

    /// With Brownian motion, translational and, for spheroids, rotational.
    pub fn with_brownian(self, brownian: Brownian) -> Self {
        Scene { brownian: Some(brownian), ..self }
    }

    /// With spheroids instead of spheres.
    pub fn with_spheroids(self, spheroids: Spheroids) -> Self {
        let friction = SpheroidFriction::new(spheroids.e_p);
        Scene { spheroids: Some(spheroids), friction, ..self }
    }

    /// With a distribution of particle brightness.
    pub fn with_intensities(self, intensities: Intensities) -> Self {
        Scene { intensities, ..self }
    }

    /// Tracers that cross a periodic face keep their ids; by default they become new tracers.
    pub fn keeping_ids(self) -> Self {
        Scene { keeps_ids: true, ..self }
    }

    /// With frames of finite exposure; by default the exposure is instantaneous.
    pub fn with_shutter(self, shutter: Shutter) -> Self {
        Scene { shutter: Some(shutter).filter(|shutter| shutter.span_s() > 0.0), ..self }
    }

    /// With walls that slow spheres: their Brownian motion, settling, and motion with the flow along walls.
    /// Spheroids are not slowed.
    pub fn with_slowing_walls(self) -> Self {
        Scene { walls_slow: true, ..self }
    }

    /// The walls that slow particles of diameter `d_um` (um); `None` if there are none.
    pub(crate) fn slowing_walls(&self, d_um: f64) -> Option<NearWalls<'a>> {
        let slows = self.walls_slow && self.friction.is_sphere();
        slows.then(|| NearWalls::new(self.fluid(), 0.5 * d_um))
    }

    /// The fluid region: the domain without bodies and walls of the field.
    pub fn fluid(&self) -> FluidRegion<'a> {
        FluidRegion { field: self.field, domain: self.domain, bodies: self.bodies, kept: self.kept }
    }

    /// The deterministic velocity field of particles of diameter `d_um` (um) whose symmetry axis is `axis`.
    pub(crate) fn drifting(&self, d_um: f64, axis: DVec3) -> Drifting<'a> {
        let slip =
            self.settling.map_or(DVec3::ZERO, |settling| settling.velocity(d_um, &self.friction, axis));
        Drifting::new(self.field, self.size_for_forces(d_um), slip).near(self.slowing_walls(d_um))
    }

    /// Diameter (um) of the sphere that a force proportional to volume moves at the same speed, averaged over
    /// orientations, as a particle of equatorial diameter `d_um` (um).
    pub(crate) fn size_for_forces(&self, d_um: f64) -> f64 {
        if self.friction.is_sphere() {
            d_um
        } else {
            d_um * libm::sqrt(self.friction.aspect / self.friction.mean())
        }
    }

    /// See [`FluidRegion::hold`].
    pub(crate) fn hold(&self, x: DVec3, t: f64, radius: f64) -> DVec3 {
        self.fluid().hold(x, t, radius)
    }

    /// A tracer with its id, and the properties drawn from the random streams of that id.
    pub(crate) fn tracer(&self, seed: Seed, id: u64, streams: Streams) -> Tracer {
        let stream = |purpose| streams.stream(purpose, 0, id as u32);
        let (aspect, axis) = match &self.spheroids {
            None => (1.0, DVec3::Y),
            Some(spheroids) => {
                let drawn = || spheroids.orientation.draw(&mut stream(Purpose::Orientation));
                (spheroids.e_p, seed.axis.unwrap_or_else(drawn))
            }
        };
        let c_int = self.intensities.draw(seed.d_um, &mut stream(Purpose::Intensity));
        Tracer {
            id,
            position: seed.position,
            d_um: seed.d_um,
            aspect,
            axis,
            c_int,
            velocity: None,
            step: None,
        }
    }
}
