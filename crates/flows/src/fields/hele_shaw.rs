//! Flow around a circular pillar in a shallow gap (Hele-Shaw cell).
//!
//! With s the relative height in the gap and (X, Y) the distance from the pillar of radius a, (u, v) = 6 s
//! (1 - s) U (1 - a^2 (X^2 - Y^2) / r^4, -2 a^2 X Y / r^4), w = 0: potential flow around a cylinder in every
//! layer, U being the depth-averaged speed far away (Batchelor, An Introduction to Fluid Dynamics, section
//! 4.8). The flow satisfies no slip at the plates but slips at the pillar, where the real flow has a boundary
//! layer about as thick as the gap; the model is valid for pillars much wider than the gap. In every layer
//! the stream function Y (1 - a^2 / r^2) is invariant. Inside the pillar and beyond the plates the velocity
//! is zero.

use super::plates::Plates;
use super::prelude::*;

params! {
    /// Parameters of [`HeleShaw`].
    HeleShawParams("hele_shaw") {
        /// Speed far from the pillar along x, averaged over the depth, um/s.
        mean_speed_um_s: f64 = 430.0, [finite];
        /// Radius of the pillar, um.
        radius_um: f64 = 60.0, [> 0];
        /// x and y of the axis of the pillar, um.
        #[alias = "centre_um"]
        center_um: [f64; 2] = [0.0, 0.0], [finite];
        /// z of floor and ceiling, um.
        #[otherwise = "the depth range"]
        walls_z_um: Option<[f64; 2]> = None, [finite], "floor below ceiling";
    }
}

entry! {
    HeleShawParams => HeleShaw::new, XY;
    "u = 6 s (1 - s) U (1 - a^2 (X^2 - Y^2)/r^4, -2 a^2 X Y/r^4, 0)";
    "Batchelor, An Introduction to Fluid Dynamics, 4.8";
    walls_z_um: walls;
}

/// Flow along x around a pillar between two plates.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct HeleShaw {
    plates: Plates,
    center: DVec2,
    radius: f64,
    speed: f64,
}

impl HeleShaw {
    /// The flow of these parameters.
    pub fn new(params: &HeleShawParams) -> Result<Self> {
        let params = params.checked()?;
        Ok(HeleShaw {
            plates: Plates::new(HeleShawParams::CHECK, params.walls_z_um)?,
            center: DVec2::from_array(params.center_um),
            radius: params.radius_um,
            speed: params.mean_speed_um_s,
        })
    }
}

impl Formula for HeleShaw {
    fn formula<S: Real>(&self, [x, y, z]: [S; 3], _t: f64) -> [S; 3] {
        let (x, y) = (x - self.center.x, y - self.center.y);
        let r2 = x.squared() + y.squared();
        let a2 = self.radius * self.radius;
        let rest = S::constant(0.0);
        if r2.value() < a2 {
            return [rest; 3];
        }
        let speed = self.plates.parabola(z) * self.speed;
        let dipole = S::constant(a2) / r2.squared();
        [speed * (-(x.squared() - y.squared()) * dipole + 1.0), speed * (x * y * dipole * -2.0), rest]
    }
}

impl VelocityField for HeleShaw {
    by_formula!();
    facts!(divergence_free, steady);

    fn invariant(&self, x: DVec3, _t: f64) -> Option<f64> {
        let arm = x.truncate() - self.center;
        Some(arm.y * (1.0 - self.radius * self.radius / arm.length_squared()).max(0.0))
    }

    fn wall(&self, x: DVec3, _t: f64) -> Option<Wall> {
        let arm = (x.truncate() - self.center).extend(0.0);
        Some(self.plates.wall(x).or(Wall::outside(arm, self.radius)))
    }

    fn max_speed(&self, region: &Region, _t0: f64, _t1: f64) -> f64 {
        // |1 - a^2 / Z^2| at the complex position Z is at most 1 + a^2 / r^2.
        let clearance = region.clearance(self.center.extend(0.0)).truncate().length().max(self.radius);
        let ratio = self.radius / clearance;
        let fastest = self.speed.abs() * self.plates.greatest_parabola(region) * (1.0 + ratio * ratio);
        fastest * ROUNDING_MARGIN
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn it_stops_before_the_pillar_and_doubles_beside_it() {
        let field = HeleShaw::new(&HeleShawParams::default()).unwrap();
        let at = |x: f64, y: f64| field.velocity(DVec3::new(x, y, -30.0), 0.0);
        assert!(at(-60.0, 0.0).length() < 1e-12);
        assert!((at(0.0, 60.0) - DVec3::X * 1290.0).length() < 1e-12 * 1290.0);
        assert_eq!(at(10.0, 10.0), DVec3::ZERO);
        assert!((at(1e6, 0.0).x - 645.0).abs() < 1e-5);
    }
}
