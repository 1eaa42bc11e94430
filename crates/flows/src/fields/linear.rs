//! Fields that are linear in space: u = U0 + A (x - c), steady.
//!
//! Trajectories are given by the matrix exponential: with u0 = u(x0) the initial velocity, the displacement
//! over a time t is INT_0^t e^(A s) ds u0 = t phi(A t) u0, phi(B) = SUM_k B^k / (k+1)!, also for singular A
//! (Moler & Van Loan, "Nineteen dubious ways to compute the exponential of a matrix", SIAM Review 45 (2003),
//! section 3: scaling and squaring). The gradient is A everywhere.

use super::prelude::*;

const CHECK: ParameterCheck = LinearParams::CHECK;

params! {
    /// Parameters of a uniform flow, [`Linear::from_uniform`].
    UniformParams("uniform") {
        /// The velocity everywhere, um/s.
        velocity_um_s: [f64; 3] = [1290.0, 0.0, 0.0], [finite];
    }
}

entry! {
    UniformParams => Linear::from_uniform, XY;
    "u = U";
    "any textbook";
}

params! {
    /// Parameters of simple shear, [`Linear::from_shear`].
    ShearParams("shear") {
        /// Shear rate g, 1/s.
        rate_per_s: f64 = 12.9, [finite];
        /// Direction of the velocity.
        along: Axis = Axis::X, [one of], "x, y or z";
        /// Direction of the velocity gradient.
        across: Axis = Axis::Z, [one of], "x, y or z, other than along";
        /// A point in the layer at rest, um.
        #[alias = "centre_um"]
        #[otherwise = "on the floor"]
        center_um: Option<[f64; 3]> = None, [finite];
    }
}

entry! {
    ShearParams => Linear::from_shear, XZ;
    "u = g (s - s0), along one axis and growing along another";
    "Batchelor, An Introduction to Fluid Dynamics, 2.3";
    [("xy", || {
            Self { across: Axis::Y, center_um: Some([0.0; 3]), ..Default::default() }.build()
        })];
    center_um: floor;
}

params! {
    /// Parameters of solid rotation, [`Linear::from_rotation`].
    RotationParams("rotation") {
        /// Angular velocity vector, rad/s; a positive z component is clockwise on the screen.
        omega_rad_s: [f64; 3] = [0.0, 0.0, 5.0], [finite];
        /// A point on the axis, um.
        #[alias = "centre_um"]
        #[otherwise = "mid-depth"]
        center_um: Option<[f64; 3]> = None, [finite];
    }
}

entry! {
    RotationParams => Linear::from_rotation, XY;
    "u = omega x (x - c)";
    "Batchelor, An Introduction to Fluid Dynamics, 2.3";
    [("oblique", || {
            Self { omega_rad_s: [1.0, 2.0, 8.0], center_um: Some([20.0, -10.0, -30.0]) }.build()
        })];
    center_um: middle;
}

/// Kinds of strain.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize, serde::Deserialize, schemars::JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Strain {
    /// Extension along x, compression along y at the same rate.
    Planar,
    /// Extension along x, compression at half the rate along y and z.
    UniaxialX,
    /// Extension along y.
    UniaxialY,
    /// Extension along z.
    UniaxialZ,
}

params! {
    /// Parameters of pure strain, [`Linear::from_strain`].
    StrainParams("strain") {
        /// Strain rate e, 1/s; negative: compression along the axis of extension.
        rate_per_s: f64 = 10.0, [finite];
        /// Planar in xy, or uniaxial along an axis.
        kind: Strain = Strain::Planar, [one of], "planar, uniaxial_x, uniaxial_y or uniaxial_z";
        /// Stagnation point, um.
        #[alias = "centre_um"]
        #[otherwise = "mid-depth"]
        center_um: Option<[f64; 3]> = None, [finite];
    }
}

entry! {
    StrainParams => Linear::from_strain, XY;
    "planar: u = e (x, -y, 0); uniaxial along x: u = e (x, -y/2, -z/2)";
    "Batchelor, An Introduction to Fluid Dynamics, 2.3";
    [("uniaxial", || Self { kind: Strain::UniaxialZ, ..Default::default() }.build())];
    center_um: middle;
}

params! {
    /// Parameters of isotropic dilatation, [`Linear::from_dilatation`].
    DilatationParams("dilatation") {
        /// Rate of expansion along every axis, 1/s; negative: contraction.
        rate_per_s: f64 = 5.0, [finite];
        /// Stagnation point, um.
        #[alias = "centre_um"]
        #[otherwise = "mid-depth"]
        center_um: Option<[f64; 3]> = None, [finite];
    }
}

entry! {
    DilatationParams => Linear::from_dilatation, XY;
    "u = e (x - c)";
    "Batchelor, An Introduction to Fluid Dynamics, 2.3";
    center_um: middle;
}

params! {
    /// Parameters of the general linear field, [`Linear::from_params`].
    LinearParams("linear") {
        /// The velocity at the center, um/s.
        velocity_um_s: [f64; 3] = [600.0, 0.0, 0.0], [finite];
        /// Rows of the velocity gradient du_i/dx_j, 1/s.
        gradient_per_s: [[f64; 3]; 3] = [[2.0, -6.0, 0.0], [4.0, -2.0, 0.0], [0.0, 0.0, 0.0]], [finite];
        /// The center, um.
        #[alias = "centre_um"]
        #[otherwise = "mid-depth"]
        center_um: Option<[f64; 3]> = None, [finite];
    }
}

entry! {
    LinearParams => Linear::from_params, XY;
    "u = U + A (x - c)";
    "Moler & Van Loan, SIAM Review 45 (2003) 3, for its trajectories";
    [("oblique", || {
            Self {
                velocity_um_s: [300.0, 0.0, 50.0],
                gradient_per_s: [[3.0, -4.0, 0.3], [1.0, -5.0, 2.0], [-2.0, 0.5, 2.0]],
                ..Default::default()
            }
            .build()
        })];
    center_um: middle;
}

/// A steady velocity field that is linear in space, with its exact trajectories.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Linear {
    velocity: DVec3,
    gradient: DMat3,
    center: DVec3,
    kept: Kept,
}

/// The invariant of the trajectories.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Kept {
    Unknown,
    /// The coordinate normal to the layers of a shear.
    Coordinate(Axis),
    /// The distance from the axis of rotation, which is along this unit vector.
    Radius(DVec3),
    /// The product x y of the planar strain.
    Product,
    /// (p^2 + q^2) s of the uniaxial strain, s being the coordinate along this axis and p, q the others.
    Volume(Axis),
}

impl Linear {
    /// u = `velocity` + `gradient` (x - `center`): um/s, 1/s (G_ij = du_i/dx_j, stored by columns) and um.
    pub fn new(velocity: DVec3, gradient: DMat3, center: DVec3) -> Result<Self> {
        CHECK.finite_vector("velocity_um_s", velocity)?;
        for column in 0..3 {
            CHECK.finite_vector("gradient_per_s", gradient.col(column))?;
        }
        CHECK.finite_vector("center_um", center)?;
        Ok(Linear { velocity, gradient, center, kept: Kept::Unknown })
    }

    /// The field of these parameters.
    pub fn from_params(params: &LinearParams) -> Result<Self> {
        let params = params.checked()?;
        let gradient = DMat3::from_cols_array_2d(&params.gradient_per_s).transpose();
        Self::new(DVec3::from_array(params.velocity_um_s), gradient, center(params.center_um, MID_DEPTH))
    }

    /// [`Linear::uniform`] from its parameters.
    pub fn from_uniform(params: &UniformParams) -> Result<Self> {
        Self::uniform(DVec3::from_array(params.checked()?.velocity_um_s))
    }

    /// [`Linear::shear`] from its parameters.
    pub fn from_shear(params: &ShearParams) -> Result<Self> {
        let params = params.checked()?;
        Self::shear(params.rate_per_s, params.along, params.across, center(params.center_um, ON_FLOOR))
    }

    /// [`Linear::rotation`] from its parameters.
    pub fn from_rotation(params: &RotationParams) -> Result<Self> {
        let params = params.checked()?;
        Self::rotation(DVec3::from_array(params.omega_rad_s), center(params.center_um, MID_DEPTH))
    }

    /// [`Linear::planar_strain`] or [`Linear::uniaxial_strain`] from their parameters.
    pub fn from_strain(params: &StrainParams) -> Result<Self> {
        let params = params.checked()?;
        let center = center(params.center_um, MID_DEPTH);
        match params.kind {
            Strain::Planar => Self::planar_strain(params.rate_per_s, center),
            Strain::UniaxialX => Self::uniaxial_strain(params.rate_per_s, Axis::X, center),
            Strain::UniaxialY => Self::uniaxial_strain(params.rate_per_s, Axis::Y, center),
            Strain::UniaxialZ => Self::uniaxial_strain(params.rate_per_s, Axis::Z, center),
        }
    }

    /// [`Linear::dilatation`] from its parameters.
    pub fn from_dilatation(params: &DilatationParams) -> Result<Self> {
        let params = params.checked()?;
        Self::dilatation(params.rate_per_s, center(params.center_um, MID_DEPTH))
    }

    /// A uniform velocity, um/s.
    pub fn uniform(velocity: DVec3) -> Result<Self> {
        Self::new(velocity, DMat3::ZERO, DVec3::ZERO)
    }

    /// Simple shear: the velocity is along one axis and increases along another at `rate` (1/s), from zero at
    /// `center` (um). Couette flow over a depth H is `shear(U / H, Axis::X, Axis::Z, floor)`.
    pub fn shear(rate: f64, along: Axis, across: Axis, center: DVec3) -> Result<Self> {
        if along == across {
            return Err(CHECK.fault("across", format!("{across:?}"), "an axis other than `along`"));
        }
        CHECK.finite("rate_per_s", rate)?;
        let mut gradient = DMat3::ZERO;
        gradient.col_mut(across as usize)[along as usize] = rate;
        Ok(Linear { kept: Kept::Coordinate(across), ..Self::new(DVec3::ZERO, gradient, center)? })
    }

    /// Solid-body rotation about an axis through `center` (um) with angular velocity `omega` (rad/s, a vector
    /// along the axis): u = omega x (x - c). The period is 2 pi / |omega|; a positive z component looks
    /// clockwise on the screen.
    pub fn rotation(omega: DVec3, center: DVec3) -> Result<Self> {
        CHECK.finite_vector("omega_rad_s", omega)?;
        let columns = DVec3::AXES.map(|axis| omega.cross(axis));
        let gradient = DMat3::from_cols(columns[0], columns[1], columns[2]);
        let kept = omega.try_normalize().map_or(Kept::Unknown, Kept::Radius);
        Ok(Linear { kept, ..Self::new(DVec3::ZERO, gradient, center)? })
    }

    /// Planar strain in the xy-plane about `center` (um): extension along x and compression along y at `rate`
    /// (1/s).
    pub fn planar_strain(rate: f64, center: DVec3) -> Result<Self> {
        CHECK.finite("rate_per_s", rate)?;
        let gradient = DMat3::from_diagonal(DVec3::new(rate, -rate, 0.0));
        Ok(Linear { kept: Kept::Product, ..Self::new(DVec3::ZERO, gradient, center)? })
    }

    /// Uniaxial strain: extension along an axis at `rate` (1/s), compression at half that rate along the
    /// other two.
    pub fn uniaxial_strain(rate: f64, axis: Axis, center: DVec3) -> Result<Self> {
        CHECK.finite("rate_per_s", rate)?;
        let gradient = DMat3::from_diagonal(axis.unit() * (1.5 * rate) - DVec3::splat(0.5 * rate));
        Ok(Linear { kept: Kept::Volume(axis), ..Self::new(DVec3::ZERO, gradient, center)? })
    }

    /// Isotropic dilatation from `center` at `rate` (1/s) per axis: u = rate (x - c). Not divergence-free.
    pub fn dilatation(rate: f64, center: DVec3) -> Result<Self> {
        CHECK.finite("rate_per_s", rate)?;
        Self::new(DVec3::ZERO, DMat3::from_diagonal(DVec3::splat(rate)), center)
    }
}

impl VelocityField for Linear {
    facts!(steady);

    fn velocity(&self, x: DVec3, _t: f64) -> DVec3 {
        self.velocity + self.gradient * (x - self.center)
    }

    fn gradient(&self, _x: DVec3, _t: f64) -> DMat3 {
        self.gradient
    }

    fn flow_map(&self, x: DVec3, t0: f64, t1: f64) -> Option<DVec3> {
        let dt = t1 - t0;
        Some(x + mean_exponential(self.gradient * dt) * self.velocity(x, t0) * dt)
    }

    fn invariant(&self, x: DVec3, _t: f64) -> Option<f64> {
        let r = x - self.center;
        match self.kept {
            Kept::Unknown => None,
            Kept::Coordinate(axis) => Some(r.dot(axis.unit())),
            Kept::Radius(direction) => Some(r.reject_from_normalized(direction).length()),
            Kept::Product => Some(r.x * r.y),
            Kept::Volume(axis) => {
                let s = r.dot(axis.unit());
                Some((r.length_squared() - s * s) * s)
            }
        }
    }

    fn is_divergence_free(&self) -> bool {
        let diagonal = DVec3::from_array(std::array::from_fn(|i| self.gradient.col(i)[i]));
        // Rates given as decimals may not cancel exactly.
        diagonal.element_sum().abs() <= 1e-14 * diagonal.abs().element_sum()
    }

    fn max_speed(&self, region: &Region, t0: f64, _t1: f64) -> f64 {
        // The magnitude of a linear function is convex: its maximum over a box is at a corner.
        let at_corners = region.corners().map(|corner| self.velocity(corner, t0).length());
        at_corners.into_iter().fold(0.0, f64::max) * ROUNDING_MARGIN
    }
}

fn center(center_um: Option<[f64; 3]>, default_um: [f64; 3]) -> DVec3 {
    DVec3::from_array(center_um.unwrap_or(default_um))
}

pub(crate) fn exponential(matrix: DMat3) -> DMat3 {
    DMat3::IDENTITY + matrix * mean_exponential(matrix)
}

/// phi(B) = SUM_k B^k / (k+1)! = INT_0^1 e^(B s) ds.
fn mean_exponential(matrix: DMat3) -> DMat3 {
    // A shortcut for uniform flows, the most common case; the sum below gives the same bits.
    if matrix == DMat3::ZERO {
        return DMat3::IDENTITY;
    }
    let size = |m: &DMat3| (0..3).map(|i| m.col(i).abs().element_sum()).fold(0.0, f64::max);
    let mut halved = matrix;
    let mut halvings = 0;
    // A matrix that overflows is not scaled: its trajectory ends in an error.
    while size(&halved) > 0.5 && size(&halved).is_finite() {
        halved *= 0.5;
        halvings += 1;
    }
    // Horner's scheme; the next term is 0.5^16 / 17! = 4e-20.
    let mut phi = DMat3::IDENTITY;
    for k in (2..=16).rev() {
        phi = DMat3::IDENTITY + halved * phi * (1.0 / f64::from(k));
    }
    // e^B = 1 + B phi(B) and phi(2B) = (1 + e^B) / 2 phi(B).
    for _ in 0..halvings {
        phi = (DMat3::IDENTITY + halved * phi * 0.5) * phi;
        halved *= 2.0;
    }
    phi
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn strain_and_dilatation_grow_exponentially() {
        let center = DVec3::new(1.0, 2.0, 3.0);
        let start = center + DVec3::new(4.0, 5.0, 6.0);
        let e = libm::exp(0.7);
        let cases = [
            (Linear::planar_strain(7.0, center).unwrap(), DVec3::new(4.0 * e, 5.0 / e, 6.0)),
            (Linear::dilatation(7.0, center).unwrap(), DVec3::new(4.0, 5.0, 6.0) * e),
            (
                Linear::uniaxial_strain(7.0, Axis::Y, center).unwrap(),
                DVec3::new(4.0 / libm::sqrt(e), 5.0 * e, 6.0 / libm::sqrt(e)),
            ),
        ];
        for (field, expected) in cases {
            let end = field.flow_map(start, 0.3, 0.4).unwrap();
            // Rounding errors of numbers near 10.
            assert!((end - center - expected).length() < 1e-14 * 10.0, "{field:?}: {end}");
        }
        assert!(cases[0].0.is_divergence_free() && cases[2].0.is_divergence_free());
        assert!(!cases[1].0.is_divergence_free());
    }

    #[test]
    fn shear_and_translation_are_polynomials() {
        let shear = Linear::shear(12.9, Axis::X, Axis::Z, DVec3::new(0.0, 0.0, -80.0)).unwrap();
        let end = shear.flow_map(DVec3::new(1.0, 2.0, 20.0), 0.0, 0.5).unwrap();
        assert!((end - DVec3::new(646.0, 2.0, 20.0)).length() < 1e-11);
        assert_eq!(shear.gradient(end, 0.0).z_axis, DVec3::new(12.9, 0.0, 0.0));
        let uniform = Linear::uniform(DVec3::new(1290.0, -10.0, 2.0)).unwrap();
        assert_eq!(uniform.flow_map(DVec3::ZERO, 1.0, 0.5).unwrap(), DVec3::new(-645.0, 5.0, -1.0));
        assert!(Linear::shear(1.0, Axis::Y, Axis::Y, DVec3::ZERO).is_err());
        assert!(Linear::uniform(DVec3::new(f64::NAN, 0.0, 0.0)).is_err());
    }

    #[test]
    fn the_speed_bound_is_reached_at_a_corner() {
        let field = Linear::rotation(DVec3::Z * 10.0, DVec3::ZERO).unwrap();
        let region = Region::new(DVec3::new(-3.0, -1.0, 0.0), DVec3::new(2.0, 4.0, 1.0)).unwrap();
        let bound = field.max_speed(&region, 0.0, 1.0);
        assert!((50.0..50.0 + 1e-9).contains(&bound));
    }
}
