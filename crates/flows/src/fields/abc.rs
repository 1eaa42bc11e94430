//! The Arnold-Beltrami-Childress flow: spatially periodic, with chaotic trajectories in three dimensions.
//!
//! u = A sin kz + C cos ky, v = B sin kx + A cos kz, w = C sin ky + B cos kx (Dombre et al., J. Fluid Mech.
//! 167 (1986) 353). Its curl is k u, so it is a steady solution of the Euler equations. If one of A, B and C
//! is zero, the velocity component that does not contain it is invariant along every trajectory.

use super::prelude::*;

const CHECK: ParameterCheck = ParameterCheck("abc");

params! {
    /// Parameters of [`Abc`].
    AbcParams {
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
    AbcParams => Abc::new, "abc", XY;
    "u = (A sin kz + C cos ky, B sin kx + A cos kz, C sin ky + B cos kx)";
    "Dombre et al., J. Fluid Mech. 167 (1986) 353";
    [("two", || Self { amplitudes_um_s: [600.0, 500.0, 0.0], ..Default::default() }.build())];
    center_um: middle;
}

/// An Arnold-Beltrami-Childress flow.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Abc {
    center: DVec3,
    a: f64,
    b: f64,
    c: f64,
    wavenumber: f64,
}

impl Abc {
    /// The flow of these parameters.
    pub fn new(params: &AbcParams) -> Result<Self> {
        let [a, b, c] = CHECK.all_finite("amplitudes_um_s", params.amplitudes_um_s)?;
        let wavenumber = 2.0 * PI / CHECK.positive("wavelength_um", params.wavelength_um)?;
        let center = DVec3::from_array(CHECK.all_finite("center_um", params.center_um.unwrap_or(MID_DEPTH))?);
        Ok(Abc { center, a, b, c, wavenumber })
    }
}

impl Formula for Abc {
    fn formula<S: Real>(&self, [x, y, z]: [S; 3], _t: f64) -> [S; 3] {
        let phase = |s: S, center: f64| (s - center) * self.wavenumber;
        let (x, y, z) = (phase(x, self.center.x), phase(y, self.center.y), phase(z, self.center.z));
        [
            z.sin() * self.a + y.cos() * self.c,
            x.sin() * self.b + z.cos() * self.a,
            y.sin() * self.c + x.cos() * self.b,
        ]
    }
}

impl VelocityField for Abc {
    by_formula!();
    facts!(divergence_free, steady);

    fn invariant(&self, x: DVec3, t: f64) -> Option<f64> {
        let u = self.value(x, t);
        if self.c == 0.0 {
            Some(u.y)
        } else if self.a == 0.0 {
            Some(u.z)
        } else {
            (self.b == 0.0).then_some(u.x)
        }
    }

    fn max_speed(&self, _region: &Region, _t0: f64, _t1: f64) -> f64 {
        let (a, b, c) = (self.a.abs(), self.b.abs(), self.c.abs());
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
        assert!(Abc::new(&AbcParams { wavelength_um: -1.0, ..Default::default() }).is_err());
    }
}
