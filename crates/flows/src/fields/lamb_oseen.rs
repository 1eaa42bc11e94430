//! The Lamb-Oseen vortex: a line vortex about an axis along z that spreads by viscous diffusion.
//!
//! v(r, t) = G / (2 pi r) (1 - e^(-r^2/s)), s = rc^2 + 4 nu t (Saffman, Vortex Dynamics, section 13.1; rc is
//! the core radius at t = 0). The maximum speed at t = 0 is 0.638173 G / (2 pi rc), at r = 1.120906 rc, where
//! q = r^2/s solves e^q = 1 + 2q. With nu = 0 the vortex is steady: a smooth vortex of fixed size, which is
//! not a solution of the Navier-Stokes equations. Before t = -rc^2 / (4 nu) the field is the one of the initial
//! line vortex.
//!
//! Trajectories are circles. With q = r^2/s and h(q) = (1 - e^-q) / q the angle of rotation is G/2pi INT
//! h(q)/s dt = G / (8 pi nu) [F(q1) - F(q0)], F(q) = h(q) + E1(q), since F' = -h/q. Where s hardly changes
//! and the difference suffers from cancellation, 8-point Gauss quadrature is exact to rounding.
//!
//! Other image generators use the same name for vortices with different formulas.

use super::prelude::*;
use crate::special::{exponential_integral, gauss_mean, mean_decay, mean_decay_slope};

const CHECK: ParameterCheck = LambOseenParams::CHECK;

/// q = r^2/s at the maximum speed.
pub(super) const PEAK_Q: f64 = 1.256_431_208_626_169_7;
/// (1 - e^-q) / sqrt(q) at the maximum speed.
pub(super) const PEAK_SPEED: f64 = 0.638_172_686_338_951_5;

/// Largest ratio of s at the ends of a step for which Gauss quadrature is used: its relative error is 1.3e-16
/// up to this ratio for q from 1e-4 to 300, and 8e-13 at a ratio of 2 (compared with the closed form in 30
/// digits).
const GAUSS_RATIO: f64 = 1.5;

params! {
    /// Parameters of [`LambOseen`].
    LambOseenParams("lamb_oseen") {
        /// Maximum speed at t = 0, um/s; positive: from x toward y.
        max_speed_um_s: f64 = 1290.0, [finite];
        /// Radius of the core at t = 0, um.
        core_radius_um: f64 = 40.0, [> 0];
        /// Kinematic viscosity, um^2/s; 0: a steady vortex; water: 1e6.
        viscosity_um2_s: f64 = 0.0, [>= 0];
        /// x and y of the axis, um.
        #[alias = "centre_um"]
        center_um: [f64; 2] = [0.0, 0.0], [finite];
    }
}

entry! {
    LambOseenParams => LambOseen::from_params, XY;
    "v = G/(2 pi r) (1 - e^(-r^2/s)), s = rc^2 + 4 nu t";
    "Saffman, Vortex Dynamics, 13.1";
    [
        ("slow", || {
            Self { viscosity_um2_s: 1e3, center_um: [20.0, -10.0], ..Default::default() }.build()
        }),
        ("in water", || {
            Self { viscosity_um2_s: 1e6, center_um: [20.0, -10.0], ..Default::default() }.build()
        }),
    ];
}

/// A Lamb-Oseen vortex about an axis along z.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LambOseen {
    center: DVec2,
    /// Circulation over 2 pi, um^2/s.
    strength: f64,
    core_squared: f64,
    nu: f64,
}

impl LambOseen {
    /// The vortex at `center` (x, y in um) with a circulation (um^2/s; positive: from x toward y, clockwise
    /// on the screen), the core radius at t = 0 (um, > 0) and the kinematic viscosity (um^2/s, >= 0; water
    /// 1e6).
    pub fn from_circulation(center: DVec2, circulation: f64, core_radius: f64, nu: f64) -> Result<Self> {
        CHECK.finite_vector("center_um", center.extend(0.0))?;
        CHECK.finite("circulation_um2_s", circulation)?;
        CHECK.positive("core_radius_um", core_radius)?;
        CHECK.not_negative("nu_um2_s", nu)?;
        let core_squared = CHECK.positive("core_radius_um squared", core_radius * core_radius)?;
        Ok(LambOseen { center, strength: circulation / (2.0 * PI), core_squared, nu })
    }

    /// The vortex given by its maximum speed at t = 0 (um/s; its sign is the sense of rotation) instead of
    /// the circulation.
    pub fn from_max_speed(center: DVec2, max_speed: f64, core_radius: f64, nu: f64) -> Result<Self> {
        CHECK.finite("max_speed_um_s", max_speed)?;
        let circulation = 2.0 * PI * core_radius * max_speed / PEAK_SPEED;
        Self::from_circulation(center, circulation, core_radius, nu)
    }

    /// The vortex of these parameters.
    pub fn from_params(params: &LambOseenParams) -> Result<Self> {
        let params = params.checked()?;
        let center = DVec2::from_array(params.center_um);
        Self::from_max_speed(center, params.max_speed_um_s, params.core_radius_um, params.viscosity_um2_s)
    }

    /// The circulation, um^2/s.
    pub fn circulation(&self) -> f64 {
        self.strength * 2.0 * PI
    }

    /// Position relative to the axis, um.
    fn arm(&self, x: DVec3) -> DVec2 {
        x.truncate() - self.center
    }

    /// s, the squared core radius at `t` (s), um^2; 0 for the line vortex before the core starts to grow.
    fn spread(&self, t: f64) -> f64 {
        (self.core_squared + 4.0 * self.nu * t).max(0.0)
    }

    /// Angular velocity (rad/s) at a squared radius `r2` (um^2).
    fn angular_velocity(&self, r2: f64, s: f64) -> f64 {
        if s > 0.0 { self.strength * mean_decay(r2 / s) / s } else { self.strength / r2 }
    }

    /// The angle of rotation (rad) at a squared radius `r2` (um^2, > 0) from `t0` to `t1` (s).
    fn angle(&self, r2: f64, t0: f64, t1: f64) -> f64 {
        if t1 < t0 {
            return -self.angle(r2, t1, t0);
        }
        if self.nu == 0.0 {
            return self.angular_velocity(r2, self.core_squared) * (t1 - t0);
        }
        let birth = -self.core_squared / (4.0 * self.nu);
        if t0 < birth {
            let grown = if t1 > birth { self.angle(r2, birth, t1) } else { 0.0 };
            return self.strength / r2 * (t1.min(birth) - t0) + grown;
        }
        let (s0, s1) = (self.spread(t0), self.spread(t1));
        if s1 <= GAUSS_RATIO * s0 {
            gauss_mean(s0, s1, |s| self.angular_velocity(r2, s)) * (t1 - t0)
        } else {
            let primitive = |s: f64| mean_decay(r2 / s) + exponential_integral(r2 / s);
            self.strength / (4.0 * self.nu) * (primitive(s1) - primitive(s0))
        }
    }
}

impl VelocityField for LambOseen {
    facts!(divergence_free);

    fn velocity(&self, x: DVec3, t: f64) -> DVec3 {
        let arm = self.arm(x);
        (arm.perp() * self.angular_velocity(arm.length_squared(), self.spread(t))).extend(0.0)
    }

    fn gradient(&self, x: DVec3, t: f64) -> DMat3 {
        let arm = self.arm(x);
        let (r2, s) = (arm.length_squared(), self.spread(t));
        let turn = self.angular_velocity(r2, s);
        // Derivative of the angular velocity with respect to r^2.
        let slope = if s > 0.0 {
            self.strength * mean_decay_slope(r2 / s) / (s * s)
        } else {
            -self.strength / (r2 * r2)
        };
        let mixed = 2.0 * arm.x * arm.y * slope;
        DMat3::from_cols(
            DVec3::new(-mixed, turn + 2.0 * arm.x * arm.x * slope, 0.0),
            DVec3::new(-turn - 2.0 * arm.y * arm.y * slope, mixed, 0.0),
            DVec3::ZERO,
        )
    }

    fn flow_map(&self, x: DVec3, t0: f64, t1: f64) -> Option<DVec3> {
        let arm = self.arm(x);
        let r2 = arm.length_squared();
        if r2 == 0.0 {
            return Some(x);
        }
        let (sin, cos) = libm::sincos(self.angle(r2, t0, t1));
        let turned = DVec2::new(arm.x * cos - arm.y * sin, arm.x * sin + arm.y * cos);
        Some((self.center + turned).extend(x.z))
    }

    fn invariant(&self, x: DVec3, _t: f64) -> Option<f64> {
        Some(self.arm(x).length())
    }

    fn is_steady(&self) -> bool {
        self.nu == 0.0
    }

    fn max_speed(&self, region: &Region, t0: f64, t1: f64) -> f64 {
        // At every radius the speed decreases with time, and as a function of radius it has a single maximum.
        let s = self.spread(t0.min(t1));
        let (low, high) = (region.min().truncate() - self.center, region.max().truncate() - self.center);
        let nearest = DVec2::ZERO.clamp(low, high).length_squared();
        let farthest = low.abs().max(high.abs()).length_squared();
        let r2 = (PEAK_Q * s).clamp(nearest, farthest);
        if r2 == 0.0 {
            return f64::INFINITY;
        }
        (self.angular_velocity(r2, s) * libm::sqrt(r2)).abs() * ROUNDING_MARGIN
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn vortex(nu: f64) -> LambOseen {
        LambOseen::from_max_speed(DVec2::new(5.0, -3.0), 1290.0, 40.0, nu).unwrap()
    }

    #[test]
    fn the_peak_is_where_and_as_high_as_asked() {
        let speed = |r: f64| vortex(0.0).velocity(DVec3::new(5.0 + r, -3.0, 9.0), 0.0);
        let peak = 40.0 * libm::sqrt(PEAK_Q);
        // Positive circulation rotates x toward y.
        assert!((speed(peak) - DVec3::new(0.0, 1290.0, 0.0)).length() < 1e-9);
        assert!(speed(peak * 0.99).y < 1290.0 && speed(peak * 1.01).y < 1290.0);
        // Far from the core it is a line vortex; e^-625 is negligible.
        assert!((speed(1000.0).y - vortex(0.0).circulation() / (2.0 * PI * 1000.0)).abs() < 1e-12);
        assert_eq!(speed(0.0), DVec3::ZERO);
    }

    #[test]
    fn a_vortex_of_no_viscosity_is_the_limit_of_small_viscosity() {
        let (steady, slow) = (vortex(0.0), vortex(1e-9));
        let x = DVec3::new(30.0, 10.0, 0.0);
        let gap = steady.flow_map(x, 0.0, 1.0).unwrap() - slow.flow_map(x, 0.0, 1.0).unwrap();
        // 4 nu t / s = 2.5e-12 of some 1000 um of path.
        assert!(gap.length() < 1e-8, "{gap}");
    }

    #[test]
    fn before_its_birth_it_is_a_line_vortex() {
        let field = vortex(1000.0); // The core starts to grow at -0.4 s.
        let x = DVec3::new(25.0, -3.0, 0.0);
        let line = field.circulation() / (2.0 * PI * 20.0);
        assert!((field.velocity(x, -1.0).y - line).abs() < 1e-9);
        let there = field.flow_map(x, 0.5, -1.0).unwrap();
        let back = field.flow_map(there, -1.0, 0.5).unwrap();
        assert!((back - x).length() < 1e-11);
        let region = Region::new(DVec3::splat(-9.0), DVec3::splat(9.0)).unwrap();
        assert_eq!(field.max_speed(&region, -1.0, 0.0), f64::INFINITY);
    }

    #[test]
    fn a_core_without_size_is_refused() {
        let message = LambOseen::from_max_speed(DVec2::ZERO, 1.0, -40.0, 0.0).unwrap_err().to_string();
        assert_eq!(message, "lamb_oseen: core_radius_um = -40: expected a finite number > 0");
        assert!(LambOseen::from_circulation(DVec2::ZERO, 1.0, 1.0, -1.0).is_err());
    }
}
