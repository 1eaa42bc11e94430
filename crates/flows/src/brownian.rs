//! Brownian motion and settling of small spheres and spheroids.
//!
//! A diffusion coefficient is kB T over a friction coefficient (Einstein): for a sphere D = kB T / (3 pi mu
//! d) for translation and D_r = kB T / (pi mu d^3) for rotation (Berg, Random Walks in Biology, chapters 2
//! and 6). A spheroid diffuses with Perrin's coefficients along and across its axis ([`SpheroidFriction`]),
//! and its axis turns with the D_r of tumbling. A step of duration h consists of half the drift, the Brownian
//! step, and half the drift (Strang splitting); the Brownian step of a spheroid consists of half the
//! rotation, the translation, and half the rotation. Settling is part of the Brownian step, which at plane
//! walls is exact for any h (`FluidRegion::settle`; at walls that slow spheres,
//! `hindered_brownian.rs`); at bodies h must be small. In a simple shear of rate g the variance along the flow,
//! 2 D t (1 + (g t)^2 / 3), is reproduced with 1/3 - 1/(12 n^2) in place of 1/3 for n steps. Walls
//! hinder the diffusion of spheres if the scene says so ([`crate::hindered`]).
//!
//! A sphere settles at drho g d^2 / (18 mu) (Stokes). The friction of a spheroid differs along and across its
//! axis, so that it also drifts sideways when it settles.

use crate::{ParameterCheck, Result, SpheroidFriction};
use glam::DVec3;
use microsig_core::random::normal;
use microsig_core::stream::Stream;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::f64::consts::PI;

const BROWNIAN: ParameterCheck = ParameterCheck("brownian");
const SETTLING: ParameterCheck = ParameterCheck("settling");

/// Boltzmann's constant, J/K, times 1e18: with lengths in um it gives um^2/s and 1/s.
const BOLTZMANN: f64 = 1.380_649e-23 * 1e18;
/// Standard gravity, m/s^2.
const GRAVITY: f64 = 9.806_65;
/// Maximum number of Brownian steps per frame interval.
const MAX_SUBSTEPS: u32 = 10_000;

// Two time steps are enough unless shear rate times frame interval exceeds 0.1.
/// Brownian motion in a liquid; the defaults are for water at 25 degrees Celsius.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default)]
pub struct Brownian {
    /// Temperature of the liquid.
    #[schemars(extend("exclusiveMinimum" = 0, "maximum" = 1e4))]
    pub temperature_k: f64,
    /// Dynamic viscosity of the liquid.
    #[schemars(extend("exclusiveMinimum" = 0, "maximum" = 1e6))]
    pub viscosity_pa_s: f64,
    /// Number of time steps between consecutive frames.
    #[schemars(range(min = 1, max = MAX_SUBSTEPS))]
    pub substeps: u32,
}

impl Default for Brownian {
    fn default() -> Self {
        Brownian { temperature_k: 298.15, viscosity_pa_s: 0.89e-3, substeps: 2 }
    }
}

impl Brownian {
    /// The same motion, or `Err` if a value is out of range.
    pub fn checked(self) -> Result<Self> {
        BROWNIAN.positive("temperature_k", self.temperature_k)?;
        BROWNIAN.positive("viscosity_pa_s", self.viscosity_pa_s)?;
        BROWNIAN.positive("temperature_k over viscosity_pa_s", self.kt_over_viscosity())?;
        if !(1..=MAX_SUBSTEPS).contains(&self.substeps) {
            return Err(BROWNIAN.fault("substeps", self.substeps, "1 to 10000"));
        }
        Ok(self)
    }

    /// kB T / mu, um^3/s.
    fn kt_over_viscosity(&self) -> f64 {
        BOLTZMANN * self.temperature_k / self.viscosity_pa_s
    }

    /// Translational diffusion coefficient of a sphere of diameter `d_um` (um), um^2/s. For a spheroid of
    /// that equatorial diameter, divide by `along` or `across` of [`SpheroidFriction`].
    pub fn diffusion(&self, d_um: f64) -> f64 {
        self.kt_over_viscosity() / (3.0 * PI * d_um)
    }

    /// Rotational diffusion coefficient of a sphere of diameter `d_um` (um), rad^2/s. For a spheroid of that
    /// equatorial diameter, divide by `tumbling` of [`SpheroidFriction`].
    pub fn rotational_diffusion(&self, d_um: f64) -> f64 {
        self.kt_over_viscosity() / (PI * d_um * d_um * d_um)
    }

    /// Variance (um^2) of the displacement along the unit vector `n` over a time `h` (s) of a particle with
    /// symmetry axis `axis`.
    pub(crate) fn variance(
        &self,
        d_um: f64,
        friction: &SpheroidFriction,
        (axis, n): (DVec3, DVec3),
        h: f64,
    ) -> f64 {
        let cosine = axis.dot(n);
        let share = 1.0 / friction.across + (1.0 / friction.along - 1.0 / friction.across) * cosine * cosine;
        2.0 * self.diffusion(d_um) * h * share
    }

    /// A random displacement (um) over a time `h` (s, > 0) of a particle with symmetry axis `axis`.
    pub(crate) fn random_displacement(
        &self,
        d_um: f64,
        friction: &SpheroidFriction,
        axis: DVec3,
        h: f64,
        stream: &mut Stream,
    ) -> DVec3 {
        let xi = DVec3::new(normal(stream), normal(stream), normal(stream));
        let length = libm::sqrt(2.0 * self.diffusion(d_um) * h);
        if friction.is_sphere() {
            return xi * length;
        }
        let (along, across) = (length / libm::sqrt(friction.along), length / libm::sqrt(friction.across));
        xi * across + axis * (axis.dot(xi) * (along - across))
    }

    /// `axis` after a random rotation over a time `h` (s, > 0): along a great circle, by an angle vector with
    /// two normally distributed components.
    pub(crate) fn random_rotation(
        &self,
        axis: DVec3,
        d_um: f64,
        friction: &SpheroidFriction,
        h: f64,
        stream: &mut Stream,
    ) -> DVec3 {
        let xi = DVec3::new(normal(stream), normal(stream), normal(stream));
        let diffusion = self.rotational_diffusion(d_um) / friction.tumbling;
        let way = (xi - axis * axis.dot(xi)) * libm::sqrt(2.0 * diffusion * h);
        let angle = way.length();
        if angle == 0.0 {
            return axis;
        }
        let (sin, cos) = libm::sincos(angle);
        (axis * cos + way * (sin / angle)).normalize()
    }
}

/// Sedimentation in a liquid; the defaults are for polystyrene in water on an inverted microscope (the lens
/// is on the side of negative z).
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default)]
pub struct Settling {
    /// Density of the particles minus the liquid's.
    #[schemars(range(min = -1e5, max = 1e5))]
    pub density_difference_kg_m3: f64,
    /// Dynamic viscosity of the liquid.
    #[schemars(extend("exclusiveMinimum" = 0, "maximum" = 1e6))]
    pub viscosity_pa_s: f64,
    /// Direction of gravity (x, y, z).
    pub direction: (f64, f64, f64),
}

impl Default for Settling {
    fn default() -> Self {
        Settling { density_difference_kg_m3: 50.0, viscosity_pa_s: 0.89e-3, direction: (0.0, 0.0, -1.0) }
    }
}

impl Settling {
    /// The same motion, or `Err` if a value is out of range; `direction` may have any length but zero.
    pub fn checked(self) -> Result<Self> {
        SETTLING.finite("density_difference_kg_m3", self.density_difference_kg_m3)?;
        SETTLING.positive("viscosity_pa_s", self.viscosity_pa_s)?;
        SETTLING.direction("direction", self.direction.into())?;
        SETTLING.finite_vector("density_difference_kg_m3 over viscosity_pa_s", self.unit())?;
        Ok(self)
    }

    /// Settling velocity of a sphere 1 um in diameter, um/s.
    fn unit(&self) -> DVec3 {
        // d^2 in um^2 is 1e-12 m^2, and 1 m/s is 1e6 um/s.
        let speed = self.density_difference_kg_m3 * GRAVITY / (18.0 * self.viscosity_pa_s) * 1e-6;
        DVec3::from(self.direction).normalize() * speed
    }

    /// Settling velocity relative to the liquid (um/s) of a particle of equatorial diameter `d_um` (um) with
    /// symmetry axis `axis` (unit vector).
    pub fn velocity(&self, d_um: f64, friction: &SpheroidFriction, axis: DVec3) -> DVec3 {
        let sphere = self.unit() * (d_um * d_um);
        if friction.is_sphere() {
            return sphere;
        }
        let along = axis * axis.dot(sphere);
        (along / friction.along + (sphere - along) / friction.across) * friction.aspect
    }

    /// The largest settling speed over all orientations of the axis, um/s.
    pub(crate) fn max_speed(&self, d_um: f64, friction: &SpheroidFriction) -> f64 {
        self.unit().length() * (d_um * d_um) * friction.aspect / friction.along.min(friction.across)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use microsig_core::stream::{Purpose, Streams};

    fn water() -> Brownian {
        Brownian::default()
    }

    #[test]
    fn coefficients_are_those_of_polystyrene_in_water() {
        for (d, translation, rotation) in [(2.0, 0.2454, 0.184), (1.0, 0.4907, 1.47), (0.5, 0.9815, 11.8)] {
            assert!((water().diffusion(d) / translation - 1.0).abs() < 3e-4, "{}", water().diffusion(d));
            assert!((water().rotational_diffusion(d) / rotation - 1.0).abs() < 4e-3);
        }
        let settling = Settling::default();
        for (d, speed) in [(2.0, 0.1225), (1.0, 0.0306), (0.5, 0.00765)] {
            assert!(
                (settling.velocity(d, &SpheroidFriction::SPHERE, DVec3::X).z / -speed - 1.0).abs() < 2e-3
            );
        }
    }

    #[test]
    fn an_axis_forgets_its_direction_at_the_known_rate() {
        // <cos> = e^(-2 D_r t), <3 cos^2 - 1> / 2 = e^(-6 D_r t); 20000 axes, 40 steps.
        let time = 0.2;
        let (mut cosines, mut squares) = (0.0, 0.0);
        for row in 0..20_000 {
            let mut stream = Streams::new(4).stream(Purpose::Brownian, 0, row);
            let mut axis = DVec3::X;
            for _ in 0..40 {
                axis =
                    water().random_rotation(axis, 1.0, &SpheroidFriction::SPHERE, time / 40.0, &mut stream);
            }
            cosines += axis.x / 20_000.0;
            squares += axis.x * axis.x / 20_000.0;
        }
        let decay = water().rotational_diffusion(1.0) * time;
        // Standard errors are at most 0.7 / 141 and 0.3 / 141; the splitting error is (2 D_r h)^2 per step,
        // 1e-3 in total.
        assert!((cosines - libm::exp(-2.0 * decay)).abs() < 0.02, "{cosines}");
        assert!((0.5 * (3.0 * squares - 1.0) - libm::exp(-6.0 * decay)).abs() < 0.02, "{squares}");
    }

    #[test]
    fn rods_diffuse_and_settle_as_perrin_says() {
        // d 1 um, e_p 3 in water: D_r 0.2093 /s, D 0.3494 and 0.2841 um^2/s.
        let rod = SpheroidFriction::new(3.0);
        let rotation = water().rotational_diffusion(1.0) / rod.tumbling;
        let (along, across) = (water().diffusion(1.0) / rod.along, water().diffusion(1.0) / rod.across);
        assert!((rotation / 0.2095 - 1.0).abs() < 2e-3, "{rotation}");
        assert!(
            (along / 0.3494 - 1.0).abs() < 2e-3 && (across / 0.2841 - 1.0).abs() < 2e-3,
            "{along} {across}"
        );
        let settling = Settling::default();
        let sphere = settling.velocity(1.0, &SpheroidFriction::SPHERE, DVec3::X).z;
        // It weighs three times as much as the sphere: relative to it, a rod falls at 3 / 1.4045 end-on and
        // 3 / 1.7276 broadside.
        let falls = |axis: DVec3| settling.velocity(1.0, &rod, axis);
        assert!((falls(DVec3::Z).z / sphere - 2.1360).abs() < 1e-3, "{}", falls(DVec3::Z).z / sphere);
        assert!((falls(DVec3::X).z / sphere - 1.7365).abs() < 1e-3);
        // At 45 degrees it drifts sideways, toward its lower end.
        let oblique = falls(DVec3::new(1.0, 0.0, -1.0).normalize());
        assert!(
            (oblique.x / -sphere - 0.5 * (2.1360 - 1.7365)).abs() < 1e-3 && oblique.y == 0.0,
            "{oblique}"
        );
        assert!(settling.max_speed(1.0, &rod) >= falls(DVec3::Z).length());
    }

    #[test]
    fn impossible_motions_are_refused() {
        let message = Brownian { temperature_k: -1.0, ..water() }.checked().unwrap_err().to_string();
        assert_eq!(message, "brownian: temperature_k = -1: expected a finite number > 0");
        assert!(Brownian { viscosity_pa_s: 0.0, ..water() }.checked().is_err());
        let none = Brownian { substeps: 0, ..water() }.checked();
        assert!(none.unwrap_err().to_string().contains("substeps = 0"));
        assert!(Settling { direction: (0.0, 0.0, 0.0), ..Settling::default() }.checked().is_err());
        assert!(Settling { viscosity_pa_s: 0.0, ..Settling::default() }.checked().is_err());
        assert!(Settling { density_difference_kg_m3: f64::MAX, ..Settling::default() }.checked().is_err());
    }
}
