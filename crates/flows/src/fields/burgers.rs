//! The Burgers vortex: a vortex about an axis along z in which axial strain balances viscous spreading.
//!
//! With the strain rate a and the core radius rc, u_r = -a r / 2, u_z = a z, and v = G / (2 pi r) (1 - e^-q),
//! q = r^2 / rc^2 (Burgers, Adv. Appl. Mech. 1 (1948) 171; Saffman, Vortex Dynamics, section 13.3). It is a
//! steady solution of the Navier-Stokes equations for the kinematic viscosity a rc^2 / 4. The maximum of v is
//! 0.638173 G / (2 pi rc), at r = 1.120906 rc.
//!
//! A trajectory is r = r0 e^(-a t / 2), z = z0 e^(a t), and with h(q) = (1 - e^-q) / q and q = q0 e^(-a t)
//! the angle of rotation is G / (2 pi rc^2) INT h(q) dt = G / (2 pi rc^2 a) [F(q1) - F(q0)], F = h + E1. For
//! short times, where the difference suffers from cancellation, 8-point Gauss quadrature is exact to
//! rounding.

use super::lamb_oseen::PEAK_SPEED;
use super::prelude::*;
use crate::special::{exponential_integral, gauss_mean, mean_decay, mean_decay_slope};

/// Longest time, in units of 1/a, for which Gauss quadrature is used: q changes by less than half.
const GAUSS_TIME: f64 = 0.4;

params! {
    /// Parameters of [`Burgers`].
    BurgersParams("burgers") {
        /// Maximum swirl speed, um/s; positive: from x toward y.
        max_speed_um_s: f64 = 1290.0, [finite];
        /// Radius of the core, um.
        core_radius_um: f64 = 40.0, [> 0];
        /// Strain rate along the axis, 1/s.
        strain_rate_per_s: f64 = 5.0, [> 0];
        /// Stagnation point, um.
        #[alias = "centre_um"]
        #[otherwise = "mid-depth"]
        center_um: Option<[f64; 3]> = None, [finite];
    }
}

entry! {
    BurgersParams => Burgers::new, XY;
    "u_r = -a r/2, u_z = a z, v = G/(2 pi r) (1 - e^(-r^2/rc^2))";
    "Burgers, Adv. Appl. Mech. 1 (1948) 171";
    center_um: middle;
}

/// A Burgers vortex about an axis along z.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Burgers {
    center: DVec3,
    max_speed: f64,
    core_squared: f64,
    rate: f64,
    /// Angular velocity on the axis, rad/s.
    spin: f64,
}

impl Burgers {
    /// The vortex of these parameters.
    pub fn new(params: &BurgersParams) -> Result<Self> {
        let (params, check) = (params.checked()?, BurgersParams::CHECK);
        let (max_speed, core) = (params.max_speed_um_s, params.core_radius_um);
        Ok(Burgers {
            center: DVec3::from_array(params.center_um.unwrap_or(MID_DEPTH)),
            max_speed,
            core_squared: check.positive("core_radius_um squared", core * core)?,
            rate: params.strain_rate_per_s,
            spin: check.finite("max_speed_um_s over core_radius_um", max_speed / (PEAK_SPEED * core))?,
        })
    }

    /// The kinematic viscosity for which the vortex is a solution, um^2/s.
    pub fn viscosity(&self) -> f64 {
        0.25 * self.rate * self.core_squared
    }

    /// r^2 / rc^2.
    fn q(&self, arm: DVec3) -> f64 {
        arm.truncate().length_squared() / self.core_squared
    }

    /// The angle of rotation (rad) over a time `dt` (s) of a fluid element that starts at `q0`.
    fn angle(&self, q0: f64, dt: f64) -> f64 {
        if (self.rate * dt).abs() <= GAUSS_TIME {
            let turn = |t: f64| mean_decay(q0 * libm::exp(-self.rate * t));
            self.spin * gauss_mean(0.0, dt, turn) * dt
        } else {
            let primitive = |q: f64| mean_decay(q) + exponential_integral(q);
            let q1 = q0 * libm::exp(-self.rate * dt);
            self.spin / self.rate * (primitive(q1) - primitive(q0))
        }
    }
}

impl VelocityField for Burgers {
    facts!(divergence_free, steady);

    fn velocity(&self, x: DVec3, _t: f64) -> DVec3 {
        let arm = x - self.center;
        let turn = self.spin * mean_decay(self.q(arm));
        let half = 0.5 * self.rate;
        DVec3::new(-half * arm.x - turn * arm.y, -half * arm.y + turn * arm.x, self.rate * arm.z)
    }

    fn gradient(&self, x: DVec3, _t: f64) -> DMat3 {
        let arm = x - self.center;
        let turn = self.spin * mean_decay(self.q(arm));
        let slope = 2.0 * self.spin * mean_decay_slope(self.q(arm)) / self.core_squared;
        let mixed = arm.x * arm.y * slope;
        let half = 0.5 * self.rate;
        DMat3::from_cols(
            DVec3::new(-half - mixed, turn + arm.x * arm.x * slope, 0.0),
            DVec3::new(-turn - arm.y * arm.y * slope, mixed - half, 0.0),
            DVec3::new(0.0, 0.0, self.rate),
        )
    }

    fn flow_map(&self, x: DVec3, t0: f64, t1: f64) -> Option<DVec3> {
        let arm = x - self.center;
        let dt = t1 - t0;
        let q = self.q(arm);
        let angle = if q > 0.0 { self.angle(q, dt) } else { 0.0 };
        let (sin, cos) = libm::sincos(angle);
        let shrink = libm::exp(-0.5 * self.rate * dt);
        let turned = DVec3::new(
            (arm.x * cos - arm.y * sin) * shrink,
            (arm.x * sin + arm.y * cos) * shrink,
            arm.z * libm::exp(self.rate * dt),
        );
        Some(self.center + turned)
    }

    fn invariant(&self, x: DVec3, _t: f64) -> Option<f64> {
        let arm = x - self.center;
        Some(arm.truncate().length_squared() * arm.z)
    }

    fn max_speed(&self, region: &Region, _t0: f64, _t1: f64) -> f64 {
        let reach = region.reach(self.center);
        let inward = 0.5 * self.rate * reach.truncate().length();
        DVec3::new(self.max_speed, inward, self.rate * reach.z).length() * ROUNDING_MARGIN
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_swirl_peaks_where_it_should() {
        let field = Burgers::new(&BurgersParams::default()).unwrap();
        let swirl = |r: f64| field.velocity(DVec3::new(r, 0.0, -30.0), 0.0).y;
        let peak = 40.0 * libm::sqrt(super::super::lamb_oseen::PEAK_Q);
        assert!((swirl(peak) - 1290.0).abs() < 1e-9);
        assert!(swirl(0.99 * peak) < 1290.0 && swirl(1.01 * peak) < 1290.0);
        assert_eq!(field.viscosity(), 2000.0);
    }
}
