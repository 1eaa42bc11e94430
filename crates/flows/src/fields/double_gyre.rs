//! The double gyre: two counter-rotating vortices in a box of 2 L x L, separated by a line that oscillates
//! from side to side.
//!
//! With X and Y the position relative to a corner in units of L, e = eps sin wt and f = e X^2 + (1 - 2 e) X,
//! u = -pi A L sin(pi f) cos(pi Y), v = pi A L cos(pi f) sin(pi Y) df/dX (Shadden, Lekien & Marsden, Physica
//! D 212 (2005) 271; their case is eps = 0.25 and w = 2 pi A). There is no flow through the four sides. With
//! eps = 0 the stream function sin(pi X) sin(pi Y) is invariant.

use super::prelude::*;

params! {
    /// Parameters of [`DoubleGyre`].
    DoubleGyreParams("double_gyre") {
        /// Maximum speed along x, um/s.
        max_speed_um_s: f64 = 1290.0, [finite];
        /// Length of the box along y, um; along x it is twice as long.
        size_um: f64 = 236.0, [> 0];
        /// Amplitude eps of the lateral oscillation.
        epsilon: f64 = 0.25, [0 to 0.5];
        /// Frequency of the oscillation, Hz.
        frequency_hz: f64 = 1.74, [>= 0];
        /// x and y of the center of the box, um.
        #[alias = "centre_um"]
        center_um: [f64; 2] = [0.0, 0.0], [finite];
    }
}

entry! {
    DoubleGyreParams => DoubleGyre::new, XY;
    "u = -U sin(pi f) cos(pi Y), v = U cos(pi f) sin(pi Y) df/dX, f = e X^2 + (1 - 2e) X, e = eps sin wt";
    "Shadden, Lekien & Marsden, Physica D 212 (2005) 271";
    [("steady", || Self { epsilon: 0.0, ..Default::default() }.build())];
}

field! {
    /// A double gyre in the xy-plane.
    DoubleGyre(DoubleGyreParams)
}

impl DoubleGyre {
    fn corner(&self) -> DVec2 {
        DVec2::from_array(self.0.center_um) - DVec2::new(self.0.size_um, 0.5 * self.0.size_um)
    }
}

impl Formula for DoubleGyre {
    fn formula<S: Real>(&self, [x, y, _]: [S; 3], t: f64) -> [S; 3] {
        let DoubleGyreParams { max_speed_um_s, size_um, epsilon, frequency_hz, .. } = self.0;
        let corner = self.corner();
        let (x, y) = ((x - corner.x) / size_um, (y - corner.y) * (PI / size_um));
        let e = epsilon * libm::sin(2.0 * PI * frequency_hz * t);
        let f = (x * e + (1.0 - 2.0 * e)) * x * PI;
        let slope = x * (2.0 * e) + (1.0 - 2.0 * e);
        [f.sin() * y.cos() * -max_speed_um_s, f.cos() * y.sin() * slope * max_speed_um_s, S::constant(0.0)]
    }
}

impl VelocityField for DoubleGyre {
    by_formula!();
    facts!(divergence_free, walls_same_along(false, false, true));

    fn invariant(&self, x: DVec3, _t: f64) -> Option<f64> {
        let phase = (x.truncate() - self.corner()) * (PI / self.0.size_um);
        self.is_steady().then(|| libm::sin(phase.x) * libm::sin(phase.y))
    }

    fn is_steady(&self) -> bool {
        self.0.epsilon * self.0.frequency_hz == 0.0
    }

    fn wall(&self, x: DVec3, _t: f64) -> Option<Wall> {
        let (low, high) = (self.corner(), self.corner() + DVec2::new(2.0, 1.0) * self.0.size_um);
        Some(Wall::between(Axis::X, low.x, high.x, x).or(Wall::between(Axis::Y, low.y, high.y, x)))
    }

    fn max_speed(&self, region: &Region, _t0: f64, _t1: f64) -> f64 {
        // Here |df/dX| = |1 + 2 e (X - 1)| is at most 1 + 2 eps |X - 1|, and the speed is at most the maximum
        // of u times this factor.
        let middle = self.corner() + DVec2::new(self.0.size_um, 0.0);
        let farthest = region.reach(middle.extend(0.0)).x / self.0.size_um;
        self.0.max_speed_um_s.abs() * (1.0 + 2.0 * self.0.epsilon * farthest) * ROUNDING_MARGIN
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_border_sways_to_where_f_is_one() {
        let field = DoubleGyre::new(&DoubleGyreParams::default()).unwrap();
        // A quarter period: e = 0.25, f = 1 at X^2 + 2 X - 4 = 0. There is no flow through the separating
        // line at its turning point.
        let border = -236.0 + 236.0 * (libm::sqrt(5.0) - 1.0);
        let u = field.velocity(DVec3::new(border, -60.0, 0.0), 0.25 / 1.74).x;
        assert!(u.abs() < 1e-9, "{u}");
        let params = DoubleGyreParams { epsilon: 0.7, ..Default::default() };
        let message = DoubleGyre::new(&params).unwrap_err().to_string();
        assert_eq!(message, "double_gyre: epsilon = 0.7: expected a number from 0 to 0.5");
    }
}
