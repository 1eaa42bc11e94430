//! Plane Poiseuille flow: the pressure-driven flow between two parallel plates.
//!
//! With s = (z - z0) / H, u = 4 U s (1 - s) along a direction in the xy-plane (Landau & Lifshitz, Fluid
//! Mechanics, section 17). The mean velocity is 2U/3 and the pressure gradient 8 mu U / H^2. The flow is
//! steady and fully developed; side walls are neglected. Trajectories are straight lines at constant speed.
//! Beyond the plates the velocity is zero.

use super::plates::{Plates, along, direction, inside};
use super::prelude::*;
use super::speed::max_speed;

const CHECK: ParameterCheck = PoiseuilleParams::CHECK;

params! {
    /// Parameters of [`Poiseuille`].
    PoiseuilleParams("poiseuille") {
        /// Speed midway between the plates, um/s; negative: opposite direction.
        #[otherwise = "1290.0"]
        max_speed_um_s: Option<f64> = None, [finite];
        /// Instead of `max_speed_um_s`: mean speed over the cross-section, um/s.
        #[otherwise = "none"]
        mean_speed_um_s: Option<f64> = None, [finite];
        /// Instead of `max_speed_um_s`: volumetric flow rate through the width `width_um`, ul/min.
        #[otherwise = "none"]
        flow_rate_ul_min: Option<f64> = None, [finite];
        /// Channel width for `flow_rate_ul_min`, um; the velocity does not vary across it.
        #[otherwise = "none"]
        width_um: Option<f64> = None, [> 0];
        /// z of floor and ceiling, um.
        #[otherwise = "the depth range"]
        walls_z_um: Option<[f64; 2]> = None, [finite], "floor below ceiling";
        /// Direction of the flow in the image plane, from x toward y, rad.
        direction_rad: f64 = 0.0, [finite];
    }
}

entry! {
    PoiseuilleParams => Poiseuille::from_params, XZ;
    "u = 4 U s (1 - s), s = (z - floor) / depth";
    "Landau & Lifshitz, Fluid Mechanics, 17";
    [("diagonal", || Self { direction_rad: 0.3, ..Default::default() }.build())];
    {
        fn fill_defaults(&mut self, depths: DepthRange) {
            self.walls_z_um.get_or_insert(depths.walls());
            // `build` reports values that cannot be converted.
            if let Ok(max) = self.max_speed() {
                (self.max_speed_um_s, self.mean_speed_um_s, self.flow_rate_ul_min) = (Some(max), None, None);
                self.width_um = None;
            }
        }
    }
}

impl PoiseuilleParams {
    fn max_speed(&self) -> Result<f64> {
        self.checked()?;
        let speeds = [self.max_speed_um_s, self.mean_speed_um_s, self.flow_rate_ul_min];
        if let (Some(width_um), None) = (self.width_um, self.flow_rate_ul_min) {
            return Err(CHECK.fault("width_um", width_um, "no value without flow_rate_ul_min"));
        }
        max_speed(speeds, CHECK, 2.0 / 3.0, || {
            let [floor, ceiling] = CHECK.increasing("walls_z_um", self.walls_z_um.unwrap_or(CHANNEL))?;
            let Some(width_um) = self.width_um else {
                let allowed = "no value without width_um, the width of the channel";
                let rate = self.flow_rate_ul_min.unwrap_or_default();
                return Err(CHECK.fault("flow_rate_ul_min", rate, allowed));
            };
            Ok(width_um * (ceiling - floor))
        })
    }
}

/// Plane Poiseuille flow between a floor and a ceiling.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Poiseuille {
    plates: Plates,
    direction: DVec3,
    max_speed: f64,
}

impl Poiseuille {
    /// The flow with `max_speed` (um/s; negative: opposite direction) midway between `floor` and `ceiling` (z
    /// in um), in the direction at `angle` (rad) from image x toward image y, that is, clockwise on the
    /// screen. `Err` if a value is not finite or the floor is not below the ceiling.
    pub fn new(max_speed: f64, floor: f64, ceiling: f64, angle: f64) -> Result<Self> {
        CHECK.finite("max_speed_um_s", max_speed)?;
        let direction = direction(CHECK.finite("angle_rad", angle)?);
        Ok(Poiseuille { plates: Plates::new(CHECK, Some([floor, ceiling]))?, direction, max_speed })
    }

    /// The flow of these parameters.
    pub fn from_params(params: &PoiseuilleParams) -> Result<Self> {
        let [floor, ceiling] = params.checked()?.walls_z_um.unwrap_or(CHANNEL);
        Self::new(params.max_speed()?, floor, ceiling, params.direction_rad)
    }

    fn speed<S: Real>(&self, height: S) -> S {
        if inside(height.value()) {
            height * (4.0 * self.max_speed) * (-height + 1.0)
        } else {
            S::constant(0.0)
        }
    }
}

impl Formula for Poiseuille {
    fn formula<S: Real>(&self, x: [S; 3], _t: f64) -> [S; 3] {
        along(self.direction, self.speed(self.plates.height(x[2])))
    }
}

impl VelocityField for Poiseuille {
    by_formula!();
    facts!(divergence_free, steady, straight, walls_same_along(true, true, false));

    fn invariant(&self, x: DVec3, _t: f64) -> Option<f64> {
        Some(x.z)
    }

    fn wall(&self, x: DVec3, _t: f64) -> Option<Wall> {
        Some(self.plates.wall(x))
    }

    fn max_speed(&self, region: &Region, _t0: f64, _t1: f64) -> f64 {
        // The speed decreases from the mid-plane: the fastest layer of the box is the one nearest to it.
        let (low, high) = self.plates.heights(region);
        self.speed(0.5_f64.clamp(low, high)).abs() * ROUNDING_MARGIN
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The default channel: 100 um deep, 10 px of 0.645 um in 5 ms.
    fn channel(angle: f64) -> Poiseuille {
        Poiseuille::new(1290.0, -80.0, 20.0, angle).unwrap()
    }

    #[test]
    fn the_profile_is_the_parabola() {
        let field = channel(0.0);
        let speed = |z: f64| field.velocity(DVec3::new(7.0, 8.0, z), 0.0).x;
        assert_eq!(speed(-30.0), 1290.0);
        assert_eq!([speed(-80.0), speed(20.0), speed(-81.0), speed(99.0)], [0.0; 4]);
        // Three quarters of the maximum halfway between plate and mid-plane, up to rounding.
        assert!((speed(-55.0) - 0.75 * 1290.0).abs() < 1e-10);
        let mean = (0..1000).map(|i| speed(-80.0 + 0.1 * (f64::from(i) + 0.5))).sum::<f64>() / 1000.0;
        // The midpoint rule's error for a parabola: U / (3 n^2) = 4e-4.
        assert!((mean - 860.0).abs() < 1e-3);
        let end = field.flow_map(DVec3::new(0.0, 0.0, -30.0), 0.0, 0.005).unwrap();
        assert!((end.x / 0.645 - 10.0).abs() < 1e-13);
    }

    #[test]
    fn a_positive_angle_turns_from_columns_to_rows() {
        let velocity = channel(std::f64::consts::FRAC_PI_2).velocity(DVec3::new(0.0, 0.0, -30.0), 0.0);
        assert!(velocity.y == 1290.0 && velocity.x.abs() < 1e-12);
    }

    #[test]
    fn the_speed_bound_knows_where_the_box_lies() {
        let bound = |low: f64, high: f64| {
            let region = Region::new(DVec3::new(0.0, 0.0, low), DVec3::new(1.0, 1.0, high)).unwrap();
            channel(1.0).max_speed(&region, 0.0, 1.0)
        };
        assert!((bound(-80.0, 20.0) - 1290.0).abs() < 1e-8);
        assert!((bound(-80.0, -55.0) - 967.5).abs() < 1e-8);
        assert!((bound(-5.0, 50.0) - 967.5).abs() < 1e-8);
        assert_eq!(bound(30.0, 50.0), 0.0);
    }

    #[test]
    fn plates_in_the_wrong_order_are_refused() {
        let message = Poiseuille::new(1.0, 20.0, -80.0, 0.0).unwrap_err().to_string();
        assert_eq!(
            message,
            "poiseuille: walls_z_um = [20.0, -80.0]: expected two finite numbers, the lower first"
        );
    }
}
