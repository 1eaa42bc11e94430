//! Friction of spheroids in creeping flow (Oberbeck 1876; Perrin, J. Phys. Radium 7 (1936) 1; Happel &
//! Brenner, Low Reynolds Number Hydrodynamics, section 5-11; Kim & Karrila, Microhydrodynamics, table 3.4).
//!
//! With semi-axes a along the axis of symmetry and b across it, chi = int_0^inf dl / D and alpha_i =
//! int_0^inf dl / ((a_i^2 + l) D), D = (b^2 + l) sqrt(a^2 + l), the friction coefficients are
//! - translation along axis i: 16 pi mu / (chi + alpha_i a_i^2),
//! - rotation about an equatorial axis: (16 pi mu / 3) (a^2 + b^2) / (a^2 alpha_a + b^2 alpha_b).
//!
//! The integrals are Carlson's R_F and R_D (Carlson, Numer. Math. 33 (1979) 1), which cover prolate and
//! oblate spheroids and the sphere without a case distinction; Perrin's logarithms and arctangents suffer
//! from cancellation near the sphere.

/// Friction coefficients of a spheroid relative to a sphere of the same equatorial diameter d.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SpheroidFriction {
    /// Aspect ratio, polar over equatorial diameter; 1 for a sphere.
    pub aspect: f64,
    /// Translation along the axis of symmetry, over 3 pi mu d.
    pub along: f64,
    /// Translation across it, over 3 pi mu d.
    pub across: f64,
    /// Rotation about an equatorial diameter (tumbling), over pi mu d^3.
    pub tumbling: f64,
}

impl SpheroidFriction {
    /// The sphere: all values are 1.
    pub const SPHERE: SpheroidFriction =
        SpheroidFriction { aspect: 1.0, along: 1.0, across: 1.0, tumbling: 1.0 };

    /// A spheroid of `aspect` (polar over equatorial diameter, > 0).
    pub fn new(aspect: f64) -> Self {
        if aspect == 1.0 {
            return Self::SPHERE;
        }
        let a2 = aspect * aspect;
        let chi = 2.0 * carlson_rf(a2);
        let (alpha_along, alpha_across) =
            (2.0 / 3.0 * carlson_rd([1.0, 1.0, a2]), 2.0 / 3.0 * carlson_rd([a2, 1.0, 1.0]));
        SpheroidFriction {
            aspect,
            along: 8.0 / 3.0 / (chi + alpha_along * a2),
            across: 8.0 / 3.0 / (chi + alpha_across),
            tumbling: 2.0 / 3.0 * (a2 + 1.0) / (a2 * alpha_along + alpha_across),
        }
    }

    /// Whether it is a sphere.
    pub fn is_sphere(&self) -> bool {
        self.aspect == 1.0
    }

    /// Translational friction averaged over all orientations (the harmonic mean over the three axes).
    pub fn mean(&self) -> f64 {
        if self.is_sphere() { 1.0 } else { 3.0 / (1.0 / self.along + 2.0 / self.across) }
    }
}

/// R_F(1, 1, z) = 1/2 int_0^inf dt / ((t + 1) sqrt(t + z)).
fn carlson_rf(z: f64) -> f64 {
    let (mut x, mut z) = (1.0, z);
    loop {
        let mean = (2.0 * x + z) / 3.0;
        let (dx, dz) = (1.0 - x / mean, 1.0 - z / mean);
        if dx.abs().max(dz.abs()) < CONVERGED {
            let (e2, e3) = (dx * dx + 2.0 * dx * dz, dx * dx * dz);
            return (1.0 - e2 / 10.0 + e3 / 14.0 + e2 * e2 / 24.0 - 3.0 / 44.0 * e2 * e3) / libm::sqrt(mean);
        }
        let lambda = x + 2.0 * libm::sqrt(x * z);
        (x, z) = (0.25 * (x + lambda), 0.25 * (z + lambda));
    }
}

/// R_D(x, y, z) = 3/2 int_0^inf dt / (sqrt((t + x) (t + y)) (t + z)^(3/2)).
fn carlson_rd([mut x, mut y, mut z]: [f64; 3]) -> f64 {
    let (mut sum, mut power) = (0.0, 1.0);
    loop {
        let mean = (x + y + 3.0 * z) / 5.0;
        let (dx, dy, dz) = (1.0 - x / mean, 1.0 - y / mean, 1.0 - z / mean);
        if dx.abs().max(dy.abs()).max(dz.abs()) < CONVERGED {
            let (xy, zz) = (dx * dy, dz * dz);
            let (e2, e3) = (xy - 6.0 * zz, (3.0 * xy - 8.0 * zz) * dz);
            let (e4, e5) = (3.0 * (xy - zz) * zz, xy * zz * dz);
            let series = 1.0 - 3.0 / 14.0 * e2 + e3 / 6.0 + 9.0 / 88.0 * e2 * e2
                - 3.0 / 22.0 * e4
                - 9.0 / 52.0 * e2 * e3
                + 3.0 / 26.0 * e5;
            return 3.0 * sum + power * series / (mean * libm::sqrt(mean));
        }
        let roots = [x, y, z].map(libm::sqrt);
        let lambda = roots[0] * roots[1] + roots[1] * roots[2] + roots[2] * roots[0];
        sum += power / (roots[2] * (z + lambda));
        power *= 0.25;
        (x, y, z) = (0.25 * (x + lambda), 0.25 * (y + lambda), 0.25 * (z + lambda));
    }
}

/// The series are exact to rounding once the relative difference of the arguments is below this: their
/// truncation error is of its sixth power.
const CONVERGED: f64 = 1.5e-3;

#[cfg(test)]
mod tests {
    use super::*;

    /// Perrin's S, for semi-axes aspect and 1.
    fn perrin(aspect: f64) -> f64 {
        let c = libm::sqrt((aspect * aspect - 1.0).abs());
        if aspect > 1.0 { 2.0 / c * libm::log(aspect + c) } else { 2.0 / c * libm::atan(c / aspect) }
    }

    #[test]
    fn friction_is_perrins() {
        for aspect in [0.01, 0.2, 0.5, 0.9, 1.1, 2.0, 3.0, 10.0, 100.0] {
            let (s, a2) = (perrin(aspect), aspect * aspect);
            let found = SpheroidFriction::new(aspect);
            // Perrin 1936, eqs 24 to 26, over 6 pi mu b and 8 pi mu b^3.
            let along = 8.0 / 3.0 * (a2 - 1.0) / ((2.0 * a2 - 1.0) * s - 2.0 * aspect);
            let across = 16.0 / 3.0 * (a2 - 1.0) / ((2.0 * a2 - 3.0) * s + 2.0 * aspect);
            let tumbling = 4.0 / 3.0 * (a2 * a2 - 1.0) / ((2.0 * a2 - 1.0) * s - 2.0 * aspect);
            for (found, expected) in
                [(found.along, along), (found.across, across), (found.tumbling, tumbling)]
            {
                // Perrin's expressions lose accuracy by cancellation, up to the third power of the
                // eccentricity, 1e-1.
                assert!((found / expected - 1.0).abs() < 1e-12, "{aspect}: {found} {expected}");
            }
        }
    }

    #[test]
    fn limits_are_sphere_disc_and_needle() {
        // Nearly a sphere (Happel & Brenner 4-22): for aspect 1 + e, 1 + e/5 along and 1 + 2e/5 across,
        // relative to the equatorial sphere.
        let near = SpheroidFriction::new(1.0 + 1e-6);
        assert!((near.along - 1.0 - 0.2e-6).abs() < 1e-11 && (near.across - 1.0 - 0.4e-6).abs() < 1e-11);
        assert_eq!(SpheroidFriction::new(1.0), SpheroidFriction::SPHERE);
        assert_eq!(SpheroidFriction::SPHERE.mean(), 1.0);
        // A disc: 16 mu a broadside and 32/3 mu a edgewise, 32/3 mu a^3 for rotation (Happel & Brenner 5-11).
        let disc = SpheroidFriction::new(1e-6);
        let pi = std::f64::consts::PI;
        assert!((disc.along * 6.0 * pi / 16.0 - 1.0).abs() < 1e-5);
        assert!((disc.across * 6.0 * pi * 3.0 / 32.0 - 1.0).abs() < 1e-5);
        assert!((disc.tumbling * 8.0 * pi * 3.0 / 32.0 - 1.0).abs() < 1e-5);
        // A needle: 4 pi mu a / (ln 2p - 1/2) along and 8 pi mu a / (ln 2p + 1/2) across (Happel & Brenner
        // 5-11).
        let (needle, ln) = (SpheroidFriction::new(1e4), libm::log(2e4));
        assert!((needle.along * 6.0 * pi * (ln - 0.5) / (4e4 * pi) - 1.0).abs() < 1e-6);
        assert!((needle.across * 6.0 * pi * (ln + 0.5) / (8e4 * pi) - 1.0).abs() < 1e-6);
    }
}
