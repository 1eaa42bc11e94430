//! Creeping flow around a sphere, and around a cylinder in a cylindrical cell.
//!
//! Sphere of radius a at rest in the velocity U: u = U - (3a/4) (U / r + x (U.x) / r^3) - (a^3/4) (U / r^3 -
//! 3 x (U.x) / r^5) (Batchelor, An Introduction to Fluid Dynamics, section 4.9). The stream function (U/2)
//! rho^2 (1 - 3a/2r + a^3/2r^3) is invariant.
//!
//! For a cylinder in unbounded fluid no creeping flow exists (Stokes' paradox). In a cell of radius b the
//! stream function f(r) sin theta with f = A r + B / r + C r ln(r/a) + D r^3 solves Stokes' equation exactly
//! (Happel & Brenner, Low Reynolds Number Hydrodynamics, section 8-6, with a different outer boundary
//! condition); no slip at the cylinder and the uniform velocity U on the surface of the cell give f(a) =
//! f'(a) = 0, f(b) = U b, f'(b) = U. Beyond b the flow is uniform; the gradient is discontinuous at r = b.
//!
//! Inside the bodies the velocity is zero.

use super::prelude::*;

params! {
    /// Parameters of [`StokesSphere`].
    StokesSphereParams("stokes_sphere") {
        /// Velocity far from the sphere, um/s.
        velocity_um_s: [f64; 3] = [1290.0, 0.0, 0.0], [finite];
        /// Radius of the sphere, um.
        radius_um: f64 = 30.0, [> 0];
        /// Center of the sphere, um.
        #[alias = "centre_um"]
        #[otherwise = "mid-depth"]
        center_um: Option<[f64; 3]> = None, [finite];
    }
}

entry! {
    StokesSphereParams => StokesSphere::new, XY;
    "u = U - (3a/4) (U/r + x (U.x)/r^3) - (a^3/4) (U/r^3 - 3 x (U.x)/r^5)";
    "Batchelor, An Introduction to Fluid Dynamics, 4.9";
    [("oblique", || {
            Self { velocity_um_s: [900.0, -500.0, 300.0], ..Default::default() }.build()
        })];
    center_um: middle;
}

params! {
    /// Parameters of [`StokesCylinder`].
    StokesCylinderParams("stokes_cylinder") {
        /// Speed along x on the surface of the cell and outside it, um/s.
        speed_um_s: f64 = 1290.0, [finite];
        /// Radius of the cylinder, um.
        radius_um: f64 = 30.0, [> 0];
        /// Radius of the cell, um.
        cell_radius_um: f64 = 200.0, [> 0], "> 1.05 radius_um";
        /// x and y of the axis, um.
        #[alias = "centre_um"]
        center_um: [f64; 2] = [0.0, 0.0], [finite];
    }
}

entry! {
    StokesCylinderParams => StokesCylinder::new, XY;
    "psi = (A r + B/r + C r ln(r/a) + D r^3) sin theta between cylinder and cell, uniform beyond";
    "Happel & Brenner, Low Reynolds Number Hydrodynamics, 8-6";
}

field! {
    /// Creeping flow around a sphere at rest.
    StokesSphere(StokesSphereParams)
}

impl StokesSphere {
    fn center(&self) -> DVec3 {
        DVec3::from_array(self.0.center_um.unwrap_or(MID_DEPTH))
    }

    fn velocity_far_away(&self) -> DVec3 {
        DVec3::from_array(self.0.velocity_um_s)
    }
}

impl Formula for StokesSphere {
    fn formula<S: Real>(&self, x: [S; 3], _t: f64) -> [S; 3] {
        let (center, u, radius) = (self.center(), self.velocity_far_away(), self.0.radius_um);
        let arm: [S; 3] = std::array::from_fn(|i| x[i] - center[i]);
        let r2 = arm[0].squared() + arm[1].squared() + arm[2].squared();
        if r2.value() < radius * radius {
            return [S::constant(0.0); 3];
        }
        let along = arm[0] * u.x + arm[1] * u.y + arm[2] * u.z;
        let ratio = S::constant(radius) / r2.sqrt();
        let cube = ratio * ratio.squared();
        let outward = along / r2 * (cube - ratio) * 0.75;
        let share = -(ratio * 3.0 + cube) * 0.25 + 1.0;
        std::array::from_fn(|i| share * u[i] + arm[i] * outward)
    }
}

impl VelocityField for StokesSphere {
    by_formula!();
    facts!(divergence_free, steady);

    fn invariant(&self, x: DVec3, _t: f64) -> Option<f64> {
        let (arm, axis) = (x - self.center(), self.velocity_far_away().try_normalize());
        let rho2 = axis.map_or(0.0, |axis| arm.reject_from_normalized(axis).length_squared());
        let ratio = (self.0.radius_um / arm.length()).min(1.0);
        Some(0.5 * rho2 * (1.0 - 1.5 * ratio + 0.5 * ratio * ratio * ratio))
    }

    fn wall(&self, x: DVec3, _t: f64) -> Option<Wall> {
        Some(Wall::outside(x - self.center(), self.0.radius_um))
    }

    fn max_speed(&self, _region: &Region, _t0: f64, _t1: f64) -> f64 {
        // With q = a/r, the speed relative to U is 1 - 3/4 q - 1/4 q^3 across the flow and 1 - 3/2 q + 1/2
        // q^3 along it: at most 1.
        self.velocity_far_away().length() * ROUNDING_MARGIN
    }
}

/// Creeping flow along x around a cylinder along z in a cell.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StokesCylinder {
    center: DVec2,
    speed: f64,
    radius: f64,
    cell: f64,
    /// A, B, C, D for U = 1 and lengths in units of the radius.
    coefficients: [f64; 4],
    /// Maximum speed for U = 1.
    peak: f64,
}

impl StokesCylinder {
    /// The flow of these parameters.
    pub fn new(params: &StokesCylinderParams) -> Result<Self> {
        let StokesCylinderParams { speed_um_s: speed, radius_um: radius, cell_radius_um: cell, center_um } =
            params.checked()?;
        let b = cell / radius;
        if b.is_nan() || b <= 1.05 {
            let allowed = format!("a number > 1.05 radius_um = {}", 1.05 * radius);
            return Err(StokesCylinderParams::CHECK.fault("cell_radius_um", cell, &allowed));
        }
        // No slip gives B = -A - D and C = -2A - 4D, which leaves two equations for A and D.
        let ln = libm::log(b);
        let rows = [
            [b - 1.0 / b - 2.0 * b * ln, b * b * b - 1.0 / b - 4.0 * b * ln, b],
            [1.0 + 1.0 / (b * b) - 2.0 * (ln + 1.0), 3.0 * b * b + 1.0 / (b * b) - 4.0 * (ln + 1.0), 1.0],
        ];
        let determinant = rows[0][0] * rows[1][1] - rows[0][1] * rows[1][0];
        let a = (rows[0][2] * rows[1][1] - rows[0][1] * rows[1][2]) / determinant;
        let d = (rows[0][0] * rows[1][2] - rows[0][2] * rows[1][0]) / determinant;
        let mut field = StokesCylinder {
            center: DVec2::from_array(center_um),
            speed,
            radius,
            cell,
            coefficients: [a, -a - d, -2.0 * a - 4.0 * d, d],
            peak: 0.0,
        };
        // f/r and f' are smooth over the gap: sampling at 1000 nodes underestimates their maxima by far less
        // than 0.1 %.
        let nodes = (0..=1000).map(|i| 1.0 + (b - 1.0) * f64::from(i) / 1000.0);
        let faster = |peak: f64, r: f64| {
            let (ratio, slope) = field.shape(r * r);
            peak.max(ratio.abs()).max(slope.abs())
        };
        field.peak = 1.001 * nodes.fold(1.0, faster);
        Ok(field)
    }

    /// f / r and f' for U = 1 at `r2`, the squared radius relative to the cylinder, from 1 to the squared
    /// cell radius.
    fn shape<S: Real>(&self, r2: S) -> (S, S) {
        let [a, b, c, d] = self.coefficients;
        let ln = r2.ln() * (0.5 * c);
        let inverse = S::constant(b) / r2;
        (ln + inverse + r2 * d + a, ln - inverse + r2 * (3.0 * d) + (a + c))
    }
}

impl Formula for StokesCylinder {
    fn formula<S: Real>(&self, [x, y, _]: [S; 3], _t: f64) -> [S; 3] {
        let (x, y) = ((x - self.center.x) / self.radius, (y - self.center.y) / self.radius);
        let r2 = x.squared() + y.squared();
        let rest = S::constant(0.0);
        let edge = self.cell / self.radius;
        if r2.value() < 1.0 {
            return [rest; 3];
        }
        if r2.value() >= edge * edge {
            return [S::constant(self.speed), rest, rest];
        }
        // u_r = f / r cos, u_theta = -f' sin.
        let (ratio, slope) = self.shape(r2);
        let turn = (ratio - slope) / r2;
        [(slope + turn * x.squared()) * self.speed, turn * x * y * self.speed, rest]
    }
}

impl VelocityField for StokesCylinder {
    by_formula!();
    facts!(divergence_free, steady, walls_same_along(false, false, true));

    fn invariant(&self, x: DVec3, _t: f64) -> Option<f64> {
        let arm = (x.truncate() - self.center) / self.radius;
        let edge = self.cell / self.radius;
        let r2 = arm.length_squared();
        let ratio = if r2 >= edge * edge { 1.0 } else { self.shape(r2.max(1.0)).0 };
        Some(ratio * arm.y * self.radius)
    }

    fn wall(&self, x: DVec3, _t: f64) -> Option<Wall> {
        Some(Wall::outside((x.truncate() - self.center).extend(0.0), self.radius))
    }

    fn max_speed(&self, _region: &Region, _t0: f64, _t1: f64) -> f64 {
        // |u|^2 = (f/r)^2 cos^2 + f'^2 sin^2.
        self.speed.abs() * self.peak * ROUNDING_MARGIN
    }

    fn step_limit(&self, x: DVec3, _t: f64) -> Option<f64> {
        let way = ((x.truncate() - self.center).length() - self.cell).abs().max(JUMP_STEP * self.cell);
        Some(way / (self.speed.abs() * self.peak))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nothing_slips_on_a_sphere_and_far_away_it_is_forgotten() {
        let params = StokesSphereParams { velocity_um_s: [600.0, -300.0, 200.0], ..Default::default() };
        let field = StokesSphere::new(&params).unwrap();
        let at = |arm: DVec3| field.velocity(DVec3::new(0.0, 0.0, -30.0) + arm, 0.0);
        for direction in [DVec3::X, DVec3::NEG_Z, DVec3::new(0.6, 0.0, 0.8)] {
            assert!(at(direction * 30.0 * (1.0 + 1e-15)).length() < 1e-10);
        }
        // The Stokeslet decays as 3a/2r.
        assert!((at(DVec3::X * 1e9) - DVec3::new(600.0, -300.0, 200.0)).length() < 1e-3);
        assert_eq!(at(DVec3::X * 10.0), DVec3::ZERO);
    }

    #[test]
    fn a_cylinder_meets_its_four_conditions_for_any_cell() {
        for cell in [33.0, 60.0, 200.0, 5000.0] {
            let params = StokesCylinderParams { cell_radius_um: cell, ..Default::default() };
            let field = StokesCylinder::new(&params).unwrap();
            let at = |x: f64, y: f64| field.velocity(DVec3::new(x, y, 0.0), 0.0);
            let (inner, outer) = (30.0 * (1.0 + 1e-15), cell * (1.0 - 1e-15));
            // Cancellation in narrow gaps: the coefficients grow as (b - 1)^-3.
            for place in [(inner, 0.0), (0.0, inner)] {
                assert!(at(place.0, place.1).length() < 1e-7, "{cell}: {}", at(place.0, place.1));
            }
            for place in [(outer, 0.0), (0.0, -outer)] {
                assert!((at(place.0, place.1) - DVec3::X * 1290.0).length() < 1e-7, "{cell}");
            }
        }
    }

    #[test]
    fn a_cell_needs_a_gap() {
        let params = StokesCylinderParams { cell_radius_um: 31.0, ..Default::default() };
        let message = StokesCylinder::new(&params).unwrap_err().to_string();
        assert_eq!(
            message,
            "stokes_cylinder: cell_radius_um = 31: expected a number > 1.05 radius_um = 31.5"
        );
    }
}
