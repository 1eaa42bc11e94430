//! Flows in a sessile drop: a toroidal (Marangoni-like) circulation, and the outward flow in an evaporating
//! drop.
//!
//! The drop is a parabolic cap of height h = h0 s, s = 1 - rho^2 / R^2, z being measured from the floor.
//!
//! Toroidal: the polynomial stream function psi = P (rho/R)^2 s z^2 (h0 s - z) / h0^3, a model (not a
//! solution of Stokes' equations) with no slip at the floor and no flux through the surface:
//! `u_rho = -(rho P / R^2) s (2 h0 s z - 3 z^2) / h0^3`,
//! `u_z = (P / (R^2 h0^3)) z^2 [2 (h0 s^2 - z s) - (2 rho^2 / R^2) (2 h0 s - z)]`. For P > 0 the flow is inward near the floor and outward along the surface. psi is invariant. The
//! formula is extended to 10 % above the surface, because the integrator may probe points there; beyond that
//! the velocity is zero.
//!
//! Coffee ring: lubrication flow toward the pinned contact line of a thin drop that dries in the time tf by
//! diffusion-limited evaporation (Deegan et al., Phys. Rev. E 62 (2000) 756; Hu & Larson, J. Phys. Chem. B
//! 106 (2002) 1334), h = h0 (1 - t/tf) s:
//! - the mean speed is R^2 / (4 rho (tf - t)) (s^-1/2 - s) = rho m with m = (1 + 1 / (r (1 + r))) /
//!   (4 (tf - t)) and r = sqrt s,
//! - u_rho = 3 rho m (Z - Z^2 / 2) with Z = z / h (no slip below, no stress above), and w follows from
//!   continuity.
//!
//! The surface descends, and tracers that it reaches stay just below it ([`VelocityField::confine`]); above
//! the surface the velocity is that at the surface. Beyond 0.98 R, and once the drop is dry, the velocity is
//! zero: tracers are deposited there.

use super::prelude::*;
use crate::wall::ParabolicCap;

/// Height up to which the toroidal formula is extended, relative to the surface.
const BEYOND: f64 = 1.1;
/// Radius from which tracers are deposited, relative to the drop's.
const RIM: f64 = 0.98;

params! {
    /// Parameters of [`ToroidalDrop`].
    ToroidalDropParams("toroidal_drop") {
        /// Strength P of the circulation, um^3/s; positive: inward along the floor.
        strength_um3_s: f64 = 4e6, [finite];
        /// Radius of the base of the drop, um.
        radius_um: f64 = 200.0, [> 0];
        /// Height at the center, um.
        height_um: f64 = 60.0, [> 0];
        /// Center of the base of the drop, um.
        #[alias = "centre_um"]
        #[otherwise = "on the floor"]
        center_um: Option<[f64; 3]> = None, [finite];
    }
}

entry! {
    ToroidalDropParams => ToroidalDrop::new, XZ;
    "psi = P (rho/R)^2 s z^2 (h0 s - z) / h0^3, s = 1 - rho^2/R^2";
    "a model made for this program";
    center_um: floor;
}

params! {
    /// Parameters of [`CoffeeRing`].
    CoffeeRingParams("coffee_ring") {
        /// Time from t = 0 until the drop is dry, s.
        drying_time_s: f64 = 5.0, [> 0];
        /// Radius of the base of the drop, um.
        radius_um: f64 = 200.0, [> 0];
        /// Height at the center at t = 0, um.
        height_um: f64 = 60.0, [> 0];
        /// Center of the base of the drop, um.
        #[alias = "centre_um"]
        #[otherwise = "on the floor"]
        center_um: Option<[f64; 3]> = None, [finite];
    }
}

entry! {
    CoffeeRingParams => CoffeeRing::new, XZ;
    "u_rho = 3 U (Z - Z^2/2), U = R^2/(4 rho (tf - t)) (s^-1/2 - s), Z = z/h, h = h0 (1 - t/tf) s";
    "Deegan et al., Phys. Rev. E 62 (2000) 756";
    center_um: floor;
}

/// The drop at t = 0.
fn cap(center_um: Option<[f64; 3]>, radius: f64, height: f64) -> ParabolicCap {
    ParabolicCap { center: DVec3::from_array(center_um.unwrap_or(ON_FLOOR)), radius, height }
}

/// A point relative to the center of the drop on the floor, and s there.
fn place<S: Real>(cap: &ParabolicCap, x: [S; 3]) -> ([S; 3], S) {
    let arm: [S; 3] = std::array::from_fn(|i| x[i] - cap.center[i]);
    let s = -(arm[0].squared() + arm[1].squared()) / (cap.radius * cap.radius) + 1.0;
    (arm, s)
}

/// Toroidal circulation in a sessile drop.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ToroidalDrop {
    cap: ParabolicCap,
    strength: f64,
}

impl ToroidalDrop {
    /// The flow of these parameters.
    pub fn new(params: &ToroidalDropParams) -> Result<Self> {
        let params = params.checked()?;
        let cap = cap(params.center_um, params.radius_um, params.height_um);
        Ok(ToroidalDrop { cap, strength: params.strength_um3_s })
    }
}

impl Formula for ToroidalDrop {
    fn formula<S: Real>(&self, x: [S; 3], _t: f64) -> [S; 3] {
        let ([x, y, z], s) = place(&self.cap, x);
        let h0 = self.cap.height;
        let above = z.value() > BEYOND * h0 * s.value();
        if s.value() <= 0.0 || z.value() < 0.0 || above {
            return [S::constant(0.0); 3];
        }
        let unit = self.strength / (self.cap.radius * self.cap.radius * h0 * h0 * h0);
        let outward = s * (s * z * (2.0 * h0) - z.squared() * 3.0) * -unit;
        let rho2 = -s + 1.0;
        let up = z.squared() * ((s * s * h0 - z * s) * 2.0 - rho2 * (s * (2.0 * h0) - z) * 2.0) * unit;
        [x * outward, y * outward, up]
    }
}

impl VelocityField for ToroidalDrop {
    by_formula!();
    facts!(divergence_free, steady);

    fn invariant(&self, x: DVec3, _t: f64) -> Option<f64> {
        let ([_, _, z], s) = place(&self.cap, x.to_array());
        let h0 = self.cap.height;
        let inside = s > 0.0 && (0.0..=BEYOND * h0 * s).contains(&z);
        Some(if inside { (1.0 - s) * s * z * z * (h0 * s - z) / (h0 * h0 * h0) } else { 0.0 })
    }

    fn max_speed(&self, _region: &Region, _t0: f64, _t1: f64) -> f64 {
        // With x = rho / R and zeta = z / h up to 1.1: |u_rho| = P / (R h0) x (1 - x^2)^3 |2 zeta - 3
        // zeta^2| <= 0.238 * 1.43, and |u_z| <= P / R^2 [2 s^4 zeta^2 |1 - zeta| + 2 x^2 s^3 zeta^2 (2 -
        // zeta)] <= 2 * 0.149 + 2 * 0.1055 * 1.09.
        let (r, h) = (self.cap.radius, self.cap.height);
        self.strength.abs() * DVec2::new(0.341 / (r * h), 0.529 / (r * r)).length()
    }

    fn wall(&self, x: DVec3, _t: f64) -> Option<Wall> {
        Some(self.cap.wall(x, self.cap.height))
    }

    fn confine(&self, x: DVec3, _t: f64, radius: f64) -> DVec3 {
        self.cap.hold_under(x, self.cap.height, radius)
    }
}

/// The capillary flow in an evaporating drop, which leaves a ring-shaped deposit.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CoffeeRing {
    cap: ParabolicCap,
    drying_time: f64,
}

impl CoffeeRing {
    /// The flow of these parameters.
    pub fn new(params: &CoffeeRingParams) -> Result<Self> {
        let params = params.checked()?;
        let cap = cap(params.center_um, params.radius_um, params.height_um);
        Ok(CoffeeRing { cap, drying_time: params.drying_time_s })
    }

    /// Height at the center, um.
    pub fn height(&self, t: f64) -> f64 {
        self.cap.height * (1.0 - t / self.drying_time).max(0.0)
    }
}

impl Formula for CoffeeRing {
    fn formula<S: Real>(&self, x: [S; 3], t: f64) -> [S; 3] {
        let ([x, y, z], s) = place(&self.cap, x);
        let rest = S::constant(0.0);
        if t >= self.drying_time || s.value() <= 1.0 - RIM * RIM || z.value() <= 0.0 {
            return [rest; 3];
        }
        let rate = 0.25 / (self.drying_time - t);
        let h = s * self.height(t);
        let top = z.value() >= h.value();
        let level = if top { S::constant(1.0) } else { z / h };
        let root = s.sqrt();
        let m = (S::constant(1.0) / (root * (root + 1.0)) + 1.0) * rate;
        let outward = m * level * (-level * 0.5 + 1.0) * 3.0;
        // q = rho^2 m h p(Z) is the radial flux below z over 2 pi; w = -(1/rho) dq/drho.
        let p = level.squared() * (-level + 3.0) * 0.5;
        let sheared = level.squared() * (level - 1.5);
        let growth = (S::constant(1.0) / (s * root) + 2.0) * rate;
        let fall = -(-s + 1.0) * (2.0 * self.height(t));
        [x * outward, y * outward, -(growth * h * p + fall * m * sheared)]
    }
}

impl VelocityField for CoffeeRing {
    by_formula!();
    facts!(divergence_free);

    fn max_speed(&self, region: &Region, t0: f64, t1: f64) -> f64 {
        let (early, late) = (t0.min(t1), t0.max(t1));
        if early >= self.drying_time {
            return 0.0;
        }
        // The maximum is at the largest radius in the box. The fluid is fastest at the later time, the drop
        // highest at the earlier.
        let radius = self.cap.radius;
        let rho = region.reach(self.cap.center).truncate().length().min(RIM * radius);
        let root = libm::sqrt(1.0 - rho * rho / (radius * radius));
        let rate = 0.25 / (self.drying_time - late).max(0.0);
        let m = rate * (1.0 + 1.0 / (root * (1.0 + root)));
        // |Z^2 (Z - 3/2)| <= 1/2; (g'/rho) h <= rate H (s^-1/2 + 2).
        let down = self.height(early) * (rate * (1.0 / root + 2.0) + m * rho * rho / (radius * radius));
        DVec2::new(1.5 * m * rho, down).length() * ROUNDING_MARGIN
    }

    fn wall(&self, x: DVec3, t: f64) -> Option<Wall> {
        Some(self.cap.wall(x, self.height(t)))
    }

    fn confine(&self, x: DVec3, t: f64, radius: f64) -> DVec3 {
        self.cap.hold_under(x, self.height(t), radius)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_surface_of_the_drying_drop_moves_with_fluid_and_evaporation() {
        let field = CoffeeRing::new(&CoffeeRingParams::default()).unwrap();
        let t = 2.0;
        for rho in [1e-6, 50.0, 120.0, 180.0] {
            let s = 1.0 - rho * rho / 40_000.0;
            let h = field.height(t) * s;
            let u = field.velocity(DVec3::new(0.0, rho, -80.0 + h * (1.0 - 1e-15)), t);
            // w = dh/dt + u dh/drho + J, J = h0 / (4 tf) s^-1/2 (Deegan et al.).
            let (rate, slope) = (-60.0 / 5.0 * s, -2.0 * field.height(t) * rho / 40_000.0);
            let through = rate + u.y * slope + 60.0 / 20.0 / libm::sqrt(s);
            assert!((u.z - through).abs() < 1e-10, "{rho}: {} {through}", u.z);
        }
        // The drop is dry.
        assert_eq!(field.velocity(DVec3::new(0.0, 50.0, -79.0), 5.0), DVec3::ZERO);
    }

    #[test]
    fn particles_stay_in_the_drop() {
        let field = CoffeeRing::new(&CoffeeRingParams::default()).unwrap();
        let at = |z: f64, t: f64| field.confine(DVec3::new(0.0, 0.0, z), t, 1.0).z;
        assert_eq!(
            [at(-50.0, 0.0), at(-20.0, 0.0), at(-20.0, 2.5), at(-20.0, 9.0)],
            [-50.0, -21.0, -51.0, -79.0]
        );
    }
}
