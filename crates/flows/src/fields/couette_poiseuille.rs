//! Couette-Poiseuille flow: between a fixed and a moving plate, with a pressure gradient.
//!
//! With s = (z - z0) / H, u = V s + 4 U s (1 - s) along a direction in the xy-plane (Landau & Lifshitz, Fluid
//! Mechanics, section 17). The flow is steady and fully developed. Trajectories are straight lines at
//! constant speed. Beyond the plates the velocity is the plate's.

use super::plates::{Plates, along, direction};
use super::prelude::*;

params! {
    /// Parameters of [`CouettePoiseuille`].
    CouettePoiseuilleParams("couette_poiseuille") {
        /// Velocity of the ceiling, um/s.
        wall_speed_um_s: f64 = 1290.0, [finite];
        /// Maximum speed of the pressure-driven part alone, um/s; negative: against `direction_rad`.
        pressure_speed_um_s: f64 = -430.0, [finite];
        /// z of floor and ceiling, um.
        #[otherwise = "the depth range"]
        walls_z_um: Option<[f64; 2]> = None, [finite], "floor below ceiling";
        /// Direction of the flow in the image plane, from x toward y, rad.
        direction_rad: f64 = 0.0, [finite];
    }
}

entry! {
    CouettePoiseuilleParams => CouettePoiseuille::new, XZ;
    "u = V s + 4 U s (1 - s), s = (z - floor) / depth";
    "Landau & Lifshitz, Fluid Mechanics, 17";
    walls_z_um: walls;
}

/// Flow between a fixed and a moving plate.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CouettePoiseuille {
    plates: Plates,
    direction: DVec3,
    wall: f64,
    pressure: f64,
}

impl CouettePoiseuille {
    /// The flow of these parameters.
    pub fn new(params: &CouettePoiseuilleParams) -> Result<Self> {
        let params = params.checked()?;
        Ok(CouettePoiseuille {
            plates: Plates::new(CouettePoiseuilleParams::CHECK, params.walls_z_um)?,
            direction: direction(params.direction_rad),
            wall: params.wall_speed_um_s,
            pressure: params.pressure_speed_um_s,
        })
    }

    fn speed<S: Real>(&self, height: S) -> S {
        match height.value() {
            s if s < 0.0 => S::constant(0.0),
            s if s > 1.0 => S::constant(self.wall),
            _ => height * self.wall + height * (-height + 1.0) * (4.0 * self.pressure),
        }
    }
}

impl Formula for CouettePoiseuille {
    fn formula<S: Real>(&self, x: [S; 3], _t: f64) -> [S; 3] {
        along(self.direction, self.speed(self.plates.height(x[2])))
    }
}

impl VelocityField for CouettePoiseuille {
    by_formula!();
    facts!(divergence_free, steady, straight, walls_same_along(true, true, false));

    fn invariant(&self, x: DVec3, _t: f64) -> Option<f64> {
        Some(x.z)
    }

    fn wall(&self, x: DVec3, _t: f64) -> Option<Wall> {
        Some(self.plates.wall(x))
    }

    fn max_speed(&self, region: &Region, _t0: f64, _t1: f64) -> f64 {
        // A parabola has its maximum at an end of the range or at its vertex.
        let (low, high) = self.plates.heights(region);
        let vertex = 0.5 + self.wall / (8.0 * self.pressure);
        let vertex = if vertex.is_finite() { vertex.clamp(low, high) } else { low };
        let fastest = [low, high, vertex].map(|s| self.speed(s).abs()).into_iter().fold(0.0, f64::max);
        fastest * ROUNDING_MARGIN
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn without_pressure_it_is_linear_and_with_it_curved() {
        let params = CouettePoiseuilleParams { pressure_speed_um_s: 0.0, ..Default::default() };
        let couette = CouettePoiseuille::new(&params).unwrap();
        assert_eq!(couette.velocity(DVec3::new(0.0, 0.0, -30.0), 0.0).x, 645.0);
        let backward = CouettePoiseuille::new(&CouettePoiseuilleParams::default()).unwrap();
        assert_eq!(backward.velocity(DVec3::new(0.0, 0.0, -30.0), 0.0).x, 215.0);
        // Near the floor the flow opposes the motion of the ceiling.
        assert!(backward.velocity(DVec3::new(0.0, 0.0, -75.0), 0.0).x < 0.0);
        assert_eq!(backward.velocity(DVec3::new(0.0, 0.0, 20.0), 0.0).x, 1290.0);
    }
}
