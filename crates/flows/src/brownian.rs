//! Brownian motion and settling of small spheres.
//!
//! Diffusion coefficients of Stokes and Einstein: D = kB T / (3 pi mu d) for translation, D_r = kB T / (pi mu d^3) for rotation
//! (Berg, Random Walks in Biology, chapters 2 and 6). A step of time h is half a drift, the whole noise, half a drift (Strang's splitting): in
//! a shear g the variance along the flow, 2 D t (1 + (g t)^2 / 3), comes out with 1/3 - 1/(12 n^2) for n steps. Noise is reflected at walls by
//! folding, which is exact in law. Spheroids diffuse like spheres of their diameter; hindrance near walls is left out.
//!
//! A sphere settles at drho g d^2 / (18 mu) (Stokes).

use crate::error::{Check, Result};
use glam::DVec3;
use microsig_core::random::normal;
use microsig_core::stream::Stream;
use std::f64::consts::PI;

const BROWNIAN: Check = Check("brownian");
const SETTLING: Check = Check("settling");

/// Boltzmann's constant, J/K, times 1e18: with diameters in um it gives um^2/s and 1/s.
const BOLTZMANN: f64 = 1.380_649e-23 * 1e18;
/// Standard gravity, m/s^2.
const GRAVITY: f64 = 9.806_65;
/// Most steps a frame.
const MAX_SUBSTEPS: u32 = 10_000;

/// Thermal motion in a liquid.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Brownian {
    /// kB T / mu.
    agitation: f64,
    substeps: u32,
}

impl Brownian {
    /// Motion at a temperature (K, > 0; 298.15) in a liquid of a dynamic viscosity (Pa s, > 0; water 0.89e-3), in `substeps` steps from
    /// frame to frame (1 to 10000; 2 are enough unless the shear times the time between frames exceeds 0.1).
    pub fn new(temperature_k: f64, viscosity_pa_s: f64, substeps: u32) -> Result<Self> {
        BROWNIAN.positive("temperature_k", temperature_k)?;
        BROWNIAN.positive("viscosity_pa_s", viscosity_pa_s)?;
        if !(1..=MAX_SUBSTEPS).contains(&substeps) {
            return Err(BROWNIAN.fault("substeps", substeps, "1 to 10000"));
        }
        Ok(Brownian { agitation: BOLTZMANN * temperature_k / viscosity_pa_s, substeps })
    }

    /// Steps from frame to frame.
    pub fn substeps(&self) -> u32 {
        self.substeps
    }

    /// Coefficient of translation of a sphere of diameter `d_um`, um^2/s.
    pub fn diffusion(&self, d_um: f64) -> f64 {
        self.agitation / (3.0 * PI * d_um)
    }

    /// Coefficient of rotation, rad^2/s.
    pub fn rotational_diffusion(&self, d_um: f64) -> f64 {
        self.agitation / (PI * d_um * d_um * d_um)
    }

    /// A random displacement over a time `h` (s, > 0), um.
    pub(crate) fn kick(&self, d_um: f64, h: f64, stream: &mut Stream) -> DVec3 {
        let xi = DVec3::new(normal(stream), normal(stream), normal(stream));
        xi * libm::sqrt(2.0 * self.diffusion(d_um) * h)
    }

    /// An axis after a random rotation over a time `h` (s, > 0): along a great circle by a normal angle of two components.
    pub(crate) fn turn(&self, axis: DVec3, d_um: f64, h: f64, stream: &mut Stream) -> DVec3 {
        let xi = DVec3::new(normal(stream), normal(stream), normal(stream));
        let way = (xi - axis * axis.dot(xi)) * libm::sqrt(2.0 * self.rotational_diffusion(d_um) * h);
        let angle = way.length();
        if angle == 0.0 {
            return axis;
        }
        let (sin, cos) = libm::sincos(angle);
        (axis * cos + way * (sin / angle)).normalize()
    }
}

/// Sinking, or rising, of particles of another density than the liquid.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Settling {
    /// Velocity of a sphere of 1 um, um/s.
    unit: DVec3,
}

impl Settling {
    /// Settling with a difference of densities (kg/m^3, particle less liquid; polystyrene in water 50) in a liquid of a dynamic viscosity
    /// (Pa s, > 0), gravity being along `direction` (any length but zero; (0, 0, -1) is toward the lens, from below).
    pub fn new(density_difference_kg_m3: f64, viscosity_pa_s: f64, direction: DVec3) -> Result<Self> {
        SETTLING.finite("density_difference_kg_m3", density_difference_kg_m3)?;
        SETTLING.positive("viscosity_pa_s", viscosity_pa_s)?;
        let down = SETTLING.finite_vector("direction", direction)?.try_normalize();
        let down = down.ok_or_else(|| SETTLING.fault("direction", direction, "a vector other than zero"))?;
        // d^2 in um^2 is 1e-12 m^2, and 1 m/s is 1e6 um/s.
        let speed = density_difference_kg_m3 * GRAVITY / (18.0 * viscosity_pa_s) * 1e-6;
        Ok(Settling { unit: down * speed })
    }

    /// Velocity of a sphere through the liquid, um/s.
    pub fn velocity(&self, d_um: f64) -> DVec3 {
        self.unit * (d_um * d_um)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use microsig_core::stream::{Purpose, Streams};

    fn water() -> Brownian {
        Brownian::new(298.15, 0.89e-3, 2).unwrap()
    }

    #[test]
    fn coefficients_are_those_of_polystyrene_in_water() {
        for (d, translation, rotation) in [(2.0, 0.2454, 0.184), (1.0, 0.4907, 1.47), (0.5, 0.9815, 11.8)] {
            assert!((water().diffusion(d) / translation - 1.0).abs() < 3e-4, "{}", water().diffusion(d));
            assert!((water().rotational_diffusion(d) / rotation - 1.0).abs() < 4e-3);
        }
        let settling = Settling::new(50.0, 0.89e-3, DVec3::NEG_Z).unwrap();
        for (d, speed) in [(2.0, 0.1225), (1.0, 0.0306), (0.5, 0.00765)] {
            assert!((settling.velocity(d).z / -speed - 1.0).abs() < 2e-3);
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
                axis = water().turn(axis, 1.0, time / 40.0, &mut stream);
            }
            cosines += axis.x / 20_000.0;
            squares += axis.x * axis.x / 20_000.0;
        }
        let decay = water().rotational_diffusion(1.0) * time;
        // Standard errors at most 0.7 / 141 and 0.3 / 141; the splitting is off by (2 D_r h)^2 a step, 1e-3 in all.
        assert!((cosines - libm::exp(-2.0 * decay)).abs() < 0.02, "{cosines}");
        assert!((0.5 * (3.0 * squares - 1.0) - libm::exp(-6.0 * decay)).abs() < 0.02, "{squares}");
    }

    #[test]
    fn impossible_liquids_are_refused() {
        let message = Brownian::new(-1.0, 1e-3, 2).unwrap_err().to_string();
        assert_eq!(message, "brownian: temperature_k = -1: expected a finite number > 0");
        assert!(Brownian::new(300.0, 1e-3, 0).is_err());
        assert!(
            Settling::new(50.0, 1e-3, DVec3::ZERO).is_err() && Settling::new(50.0, 0.0, DVec3::X).is_err()
        );
    }
}
