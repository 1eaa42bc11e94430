//! Poiseuille flow in a straight tube of circular cross-section.
//!
//! u = U (1 - r^2 / R^2) along x, with the mean U/2 (Landau & Lifshitz, Fluid Mechanics, section 17). The
//! flow is steady and fully developed; trajectories are straight lines at constant speed. Outside the tube
//! the velocity is zero.

use super::prelude::*;
use super::speed::max_speed;

params! {
    /// Parameters of [`Tube`].
    TubeParams("tube") {
        /// Speed on the axis, um/s.
        #[otherwise = "1290.0"]
        max_speed_um_s: Option<f64> = None, [finite];
        /// Instead of `max_speed_um_s`: mean speed over the cross-section, um/s.
        #[otherwise = "none"]
        mean_speed_um_s: Option<f64> = None, [finite];
        /// Instead of `max_speed_um_s`: volumetric flow rate, ul/min.
        #[otherwise = "none"]
        flow_rate_ul_min: Option<f64> = None, [finite];
        /// Inner radius, um.
        #[otherwise = "half the depth range"]
        radius_um: Option<f64> = None, [> 0];
        /// y and z of the axis, um.
        #[alias = "centre_yz_um"]
        #[otherwise = "(0, mid-depth)"]
        center_yz_um: Option<[f64; 2]> = None, [finite];
    }
}

entry! {
    TubeParams => Tube::new, YZ;
    "u = U (1 - r^2 / R^2) along x";
    "Landau & Lifshitz, Fluid Mechanics, 17";
    {
        fn fill_defaults(&mut self, depths: DepthRange) {
            self.center_yz_um.get_or_insert([0.0, depths.middle()[2]]);
            self.radius_um.get_or_insert(0.5 * (depths.ceiling_um - depths.floor_um));
            // `build` reports values that cannot be converted.
            if let Ok(max) = self.max_speed() {
                (self.max_speed_um_s, self.mean_speed_um_s, self.flow_rate_ul_min) = (Some(max), None, None);
            }
        }
    }
}

impl TubeParams {
    fn radius(&self) -> f64 {
        self.radius_um.unwrap_or(0.5 * (CHANNEL[1] - CHANNEL[0]))
    }

    fn max_speed(&self) -> Result<f64> {
        self.checked()?;
        let speeds = [self.max_speed_um_s, self.mean_speed_um_s, self.flow_rate_ul_min];
        max_speed(speeds, Self::CHECK, 0.5, || Ok(PI * self.radius() * self.radius()))
    }
}

/// Flow along x in a tube.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Tube {
    center: DVec2,
    radius: f64,
    max_speed: f64,
}

impl Tube {
    /// The flow of these parameters.
    pub fn new(params: &TubeParams) -> Result<Self> {
        let params = params.checked()?;
        let center = DVec2::from_array(params.center_yz_um.unwrap_or([0.0, MID_DEPTH[2]]));
        Ok(Tube { center, radius: params.radius(), max_speed: params.max_speed()? })
    }
}

impl Formula for Tube {
    fn formula<S: Real>(&self, [_, y, z]: [S; 3], _t: f64) -> [S; 3] {
        let share =
            ((y - self.center.x).squared() + (z - self.center.y).squared()) / self.radius / self.radius;
        let rest = S::constant(0.0);
        [if share.value() > 1.0 { rest } else { (-share + 1.0) * self.max_speed }, rest, rest]
    }
}

impl VelocityField for Tube {
    by_formula!();
    facts!(divergence_free, steady, straight, walls_same_along(true, false, false));

    fn invariant(&self, x: DVec3, _t: f64) -> Option<f64> {
        Some((DVec2::new(x.y, x.z) - self.center).length())
    }

    fn wall(&self, x: DVec3, _t: f64) -> Option<Wall> {
        let arm = DVec3::new(0.0, x.y - self.center.x, x.z - self.center.y);
        Some(Wall::inside(arm, self.radius))
    }

    fn max_speed(&self, region: &Region, _t0: f64, _t1: f64) -> f64 {
        let nearest = DVec3::new(0.0, self.center.x, self.center.y).clamp(region.min(), region.max());
        self.value(nearest, 0.0).x.abs() * ROUNDING_MARGIN
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_profile_is_a_paraboloid() {
        let field = Tube::new(&TubeParams::default()).unwrap();
        let speed = |y: f64, z: f64| field.velocity(DVec3::new(3.0, y, z), 0.0).x;
        assert_eq!(
            [speed(0.0, -30.0), speed(0.0, 20.0), speed(-50.0, -30.0), speed(40.0, 10.0)],
            [1290.0, 0.0, 0.0, 0.0]
        );
        assert!((speed(30.0, -70.0)).abs() < 1e-12 && (speed(25.0, -30.0) - 967.5).abs() < 1e-10);
    }
}
