//! Hill's spherical vortex: a sphere of rotational flow that travels through a fluid at rest.
//!
//! In the frame of the vortex, with s along the axis, rho the distance from it, r^2 = rho^2 + s^2, radius a
//! and speed U (Hill, Phil. Trans. R. Soc. A 185 (1894) 213; Batchelor, An Introduction to Fluid Dynamics,
//! section 7.2; signs such that the fluid at the center flows along +s and the fluid far away along -s):
//!   inside   u_rho = 3 U rho s / (2 a^2),        u_s = 3 U (a^2 - 2 rho^2 - s^2) / (2 a^2),
//!   outside  u_rho = 3 U a^3 rho s / (2 r^5),    u_s = -U + U a^3 (2 s^2 - rho^2) / (2 r^5).
//! The velocity is continuous, its gradient is discontinuous at the surface. In the frame of the vortex the
//! stream function is invariant: (3 U / 4) rho^2 (1 - r^2 / a^2) inside, -(U / 2) rho^2 (1 - a^3 / r^3)
//! outside. The inner part is also the circulation in a drop (Hadamard and Rybczynski). In the laboratory
//! frame U is added and the center moves.

use super::prelude::*;

params! {
    /// Parameters of [`Hill`].
    HillParams("hill") {
        /// Speed of the vortex through the fluid along its axis, um/s.
        speed_um_s: f64 = 600.0, [finite];
        /// Radius of the sphere, um.
        radius_um: f64 = 40.0, [> 0];
        /// Direction of the axis.
        axis: Axis = Axis::X, [one of], "x, y or z";
        /// true: the vortex moves through fluid at rest; false: the fluid flows past a vortex at rest.
        moving: bool = false, [one of], "true or false";
        /// The center at t = 0, um.
        #[alias = "centre_um"]
        #[otherwise = "mid-depth"]
        center_um: Option<[f64; 3]> = None, [finite];
    }
}

entry! {
    HillParams => Hill::new, XY;
    "Hill's spherical vortex: u_rho = 3 U rho s/(2 a^2), u_s = 3 U (a^2 - 2 rho^2 - s^2)/(2 a^2) inside, a dipole flow outside";
    "Batchelor, An Introduction to Fluid Dynamics, 7.2";
    [("moving", || Self { moving: true, axis: Axis::Z, ..Default::default() }.build())];
    center_um: middle;
}

field! {
    /// Hill's spherical vortex.
    Hill(HillParams)
}

impl Hill {
    fn center(&self, t: f64) -> DVec3 {
        let center = DVec3::from_array(self.0.center_um.unwrap_or(MID_DEPTH));
        if self.0.moving { center + self.0.axis.unit() * (self.0.speed_um_s * t) } else { center }
    }
}

impl Formula for Hill {
    fn formula<S: Real>(&self, x: [S; 3], t: f64) -> [S; 3] {
        let (center, axis) = (self.center(t), self.0.axis.unit());
        let arm: [S; 3] = std::array::from_fn(|i| x[i] - center[i]);
        let s = arm[0] * axis.x + arm[1] * axis.y + arm[2] * axis.z;
        let r2 = arm[0].squared() + arm[1].squared() + arm[2].squared();
        let HillParams { speed_um_s: u, radius_um, moving, .. } = self.0;
        let a2 = radius_um * radius_um;
        // The velocity is `outward` times the arm and `along` times the axis: u_rho = outward rho.
        let (outward, along) = if r2.value() < a2 {
            (s * (1.5 * u / a2), (-r2 * 2.0 + a2) * (1.5 * u / a2))
        } else {
            let cube = S::constant(a2 * radius_um) / (r2 * r2.sqrt());
            (s / r2 * cube * (1.5 * u), (cube * -0.5 - 1.0) * u)
        };
        let along = if moving { along + u } else { along };
        std::array::from_fn(|i| arm[i] * outward + along * axis[i])
    }
}

impl VelocityField for Hill {
    by_formula!();
    facts!(divergence_free);

    fn invariant(&self, x: DVec3, t: f64) -> Option<f64> {
        let arm = x - self.center(t);
        let (r2, s) = (arm.length_squared(), arm.dot(self.0.axis.unit()));
        let rho2 = r2 - s * s;
        let share = libm::sqrt(r2) / self.0.radius_um;
        Some(if share < 1.0 {
            0.75 * self.0.speed_um_s * rho2 * (1.0 - share * share)
        } else {
            -0.5 * self.0.speed_um_s * rho2 * (1.0 - 1.0 / (share * share * share))
        })
    }

    fn is_steady(&self) -> bool {
        !self.0.moving
    }

    fn max_speed(&self, _region: &Region, _t0: f64, _t1: f64) -> f64 {
        // In the frame of the vortex the maximum is 3U/2, at the center and on the equator.
        let fastest = if self.0.moving { 2.5 } else { 1.5 };
        self.0.speed_um_s.abs() * fastest * ROUNDING_MARGIN
    }

    fn step_limit(&self, x: DVec3, t: f64) -> Option<f64> {
        // At most to the surface; near it, a fraction of the radius.
        let way = ((x - self.center(t)).length() - self.0.radius_um).abs().max(JUMP_STEP * self.0.radius_um);
        Some(way / (1.5 * self.0.speed_um_s.abs()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_velocity_is_continuous_and_the_ring_rests() {
        let field = Hill::new(&HillParams { axis: Axis::Z, ..Default::default() }).unwrap();
        let at = |rho: f64, s: f64| field.velocity(DVec3::new(0.6 * rho, 0.8 * rho, s - 30.0), 0.0);
        for angle in [0.0, 0.4, 1.2, 2.0] {
            let (sin, cos) = libm::sincos(angle);
            let gap = at(40.0 * sin * (1.0 - 1e-12), 40.0 * cos * (1.0 - 1e-12)) - at(40.0 * sin, 40.0 * cos);
            assert!(gap.length() < 1e-8, "{gap}");
        }
        assert!(at(40.0 / std::f64::consts::SQRT_2, 0.0).length() < 1e-10);
        assert!((at(0.0, 0.0) - DVec3::Z * 900.0).length() < 1e-10);
        assert!((at(0.0, 1e9) + DVec3::Z * 600.0).length() < 1e-10);
    }
}
