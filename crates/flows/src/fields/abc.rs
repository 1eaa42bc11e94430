//! The Arnold-Beltrami-Childress flow: spatially periodic, with chaotic trajectories in three dimensions.
//!
//! u = A sin kz + C cos ky, v = B sin kx + A cos kz, w = C sin ky + B cos kx (Dombre et al., J. Fluid Mech.
//! 167 (1986) 353). Its curl is k u, so it is a steady solution of the Euler equations. If one of A, B and C
//! is zero, the velocity component that does not contain it is invariant along every trajectory.

use super::prelude::*;

params! {
    /// Parameters of [`Abc`].
    AbcParams("abc") {
        /// Amplitudes A, B and C, um/s.
        amplitudes_um_s: [f64; 3] = [600.0, 489.898, 346.41], [finite];
        /// Wavelength, um.
        wavelength_um: f64 = 100.0, [> 0];
        /// Point at which all phases are zero, um.
        #[alias = "centre_um"]
        #[otherwise = "mid-depth"]
        center_um: Option<[f64; 3]> = None, [finite];
    }
}

entry! {
    AbcParams => Abc::new, XY;
    "u = (A sin kz + C cos ky, B sin kx + A cos kz, C sin ky + B cos kx)";
    "Dombre et al., J. Fluid Mech. 167 (1986) 353";
    [("two", || Self { amplitudes_um_s: [600.0, 500.0, 0.0], ..Default::default() }.build())];
    center_um: middle;
}

field! {
    /// An Arnold-Beltrami-Childress flow.
    Abc(AbcParams)
}

impl Formula for Abc {
    fn formula<S: Real>(&self, [x, y, z]: [S; 3], _t: f64) -> [S; 3] {
        let wavenumber = 2.0 * PI / self.0.wavelength_um;
        let center = self.0.center_um.unwrap_or(MID_DEPTH);
        let phase = |s: S, i: usize| (s - center[i]) * wavenumber;
        let (x, y, z) = (phase(x, 0), phase(y, 1), phase(z, 2));
        let [a, b, c] = self.0.amplitudes_um_s;
        [z.sin() * a + y.cos() * c, x.sin() * b + z.cos() * a, y.sin() * c + x.cos() * b]
    }
}

impl VelocityField for Abc {
    by_formula!();
    facts!(divergence_free, steady);

    fn invariant(&self, x: DVec3, t: f64) -> Option<f64> {
        let u = self.value(x, t);
        // Without C v is invariant, without A w, and without B u.
        let [a, b, c] = self.0.amplitudes_um_s;
        [(c, u.y), (a, u.z), (b, u.x)].into_iter().find_map(|(without, u)| (without == 0.0).then_some(u))
    }

    fn max_speed(&self, _region: &Region, _t0: f64, _t1: f64) -> f64 {
        let [a, b, c] = self.0.amplitudes_um_s.map(f64::abs);
        DVec3::new(a + c, b + a, c + b).length() * ROUNDING_MARGIN
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_curl_is_parallel_to_the_velocity() {
        let field = Abc::new(&AbcParams::default()).unwrap();
        let x = DVec3::new(12.0, -7.0, 3.0);
        let g = field.gradient(x, 0.0);
        let curl = DVec3::new(g.y_axis.z - g.z_axis.y, g.z_axis.x - g.x_axis.z, g.x_axis.y - g.y_axis.x);
        assert!((curl - field.velocity(x, 0.0) * (2.0 * PI / 100.0)).length() < 1e-11);
    }
}
