//! The Rankine vortex: a core in solid-body rotation inside a line vortex, about an axis along z.
//!
//! v(r) = V r / R for r < R and V R / r outside (Saffman, Vortex Dynamics, section 2.3), V = G / (2 pi R)
//! being the maximum speed. The flow is steady; the gradient is discontinuous at R. Trajectories are circles.

use super::prelude::*;

params! {
    /// Parameters of [`Rankine`].
    RankineParams("rankine") {
        /// Speed at the edge of the core, um/s; positive: from x toward y.
        max_speed_um_s: f64 = 1290.0, [finite];
        /// Radius of the core, um.
        core_radius_um: f64 = 40.0, [> 0];
        /// x and y of the axis, um.
        #[alias = "centre_um"]
        center_um: [f64; 2] = [0.0, 0.0], [finite];
    }
}

entry! {
    RankineParams => Rankine::new, XY;
    "v = V r/R inside, V R/r outside";
    "Saffman, Vortex Dynamics, 2.3";
}

field! {
    /// A Rankine vortex about an axis along z.
    Rankine(RankineParams)
}

impl Rankine {
    fn center(&self) -> DVec2 {
        DVec2::from_array(self.0.center_um)
    }

    /// Angular velocity (rad/s) at a squared radius `r2` (um^2).
    fn angular_velocity(&self, r2: f64) -> f64 {
        self.0.max_speed_um_s * self.0.core_radius_um / r2.max(self.0.core_radius_um * self.0.core_radius_um)
    }
}

impl VelocityField for Rankine {
    facts!(divergence_free, steady);

    fn velocity(&self, x: DVec3, _t: f64) -> DVec3 {
        let arm = x.truncate() - self.center();
        (arm.perp() * self.angular_velocity(arm.length_squared())).extend(0.0)
    }

    fn gradient(&self, x: DVec3, _t: f64) -> DMat3 {
        let arm = x.truncate() - self.center();
        let r2 = arm.length_squared();
        let turn = self.angular_velocity(r2);
        // Derivative of the angular velocity with respect to r^2.
        let slope = if r2 < self.0.core_radius_um * self.0.core_radius_um { 0.0 } else { -turn / r2 };
        let mixed = 2.0 * arm.x * arm.y * slope;
        DMat3::from_cols(
            DVec3::new(-mixed, turn + 2.0 * arm.x * arm.x * slope, 0.0),
            DVec3::new(-turn - 2.0 * arm.y * arm.y * slope, mixed, 0.0),
            DVec3::ZERO,
        )
    }

    fn flow_map(&self, x: DVec3, t0: f64, t1: f64) -> Option<DVec3> {
        let arm = x.truncate() - self.center();
        let (sin, cos) = libm::sincos(self.angular_velocity(arm.length_squared()) * (t1 - t0));
        let turned = DVec2::new(arm.x * cos - arm.y * sin, arm.x * sin + arm.y * cos);
        Some((self.center() + turned).extend(x.z))
    }

    fn invariant(&self, x: DVec3, _t: f64) -> Option<f64> {
        Some((x.truncate() - self.center()).length())
    }

    fn max_speed(&self, region: &Region, _t0: f64, _t1: f64) -> f64 {
        let center = self.center().extend(0.0);
        let nearest = region.clearance(center).truncate().length();
        let farthest = region.reach(center).truncate().length();
        let r = self.0.core_radius_um.clamp(nearest, farthest);
        (self.angular_velocity(r * r) * r).abs() * ROUNDING_MARGIN
    }

    fn step_limit(&self, _x: DVec3, _t: f64) -> Option<f64> {
        Some(0.05 * self.0.core_radius_um / self.0.max_speed_um_s.abs())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_speed_rises_to_the_edge_and_falls_beyond() {
        let field = Rankine::new(&RankineParams::default()).unwrap();
        let speed = |r: f64| field.velocity(DVec3::new(r, 0.0, 5.0), 0.0);
        assert!((speed(40.0) - DVec3::Y * 1290.0).length() < 1e-12 * 1290.0);
        assert!((speed(20.0).y - 645.0).abs() < 1e-12 * 1290.0);
        assert!((speed(160.0).y - 322.5).abs() < 1e-12 * 1290.0);
        let message = Rankine::new(&RankineParams { core_radius_um: 0.0, ..Default::default() }).unwrap_err();
        assert_eq!(message.to_string(), "rankine: core_radius_um = 0: expected a finite number > 0");
    }
}
