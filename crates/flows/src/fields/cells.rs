//! Cellular vortices in the xy-plane: decaying Taylor-Green vortices, and a steady or laterally oscillating
//! array of cells.
//!
//! Taylor-Green: u = U sin kx cos ky e^(-2 nu k^2 t), v = -U cos kx sin ky e^(-2 nu k^2 t), an exact solution
//! of the Navier-Stokes equations (Taylor & Green, Proc. R. Soc. A 158 (1937) 499). sin kx sin ky is
//! invariant along trajectories even while the vortices decay.
//!
//! Cellular: the stream function (U / ky) sin kx X sin ky y with X = x + b sin wt, the array of roll cells of
//! Solomon & Gollub, Phys. Rev. A 38 (1988) 6280, whose lateral oscillation causes mixing between cells. u =
//! U sin kx X cos ky y, v = -U (kx / ky) cos kx X sin ky y.

use super::prelude::*;

params! {
    /// Parameters of [`TaylorGreen`].
    TaylorGreenParams("taylor_green") {
        /// Maximum speed at t = 0, um/s.
        max_speed_um_s: f64 = 1290.0, [finite];
        /// Wavelength along x and y (two vortices), um.
        wavelength_um: f64 = 200.0, [> 0];
        /// Kinematic viscosity, um^2/s; 0: steady. In water (1e6), small vortices decay within a frame.
        viscosity_um2_s: f64 = 500.0, [>= 0];
        /// x and y of a point where four vortices meet, um.
        #[alias = "centre_um"]
        center_um: [f64; 2] = [0.0, 0.0], [finite];
    }
}

entry! {
    TaylorGreenParams => TaylorGreen::new, XY;
    "u = U sin kx cos ky e^(-2 nu k^2 t), v = -U cos kx sin ky e^(-2 nu k^2 t)";
    "Taylor & Green, Proc. R. Soc. A 158 (1937) 499";
    [("steady", || Self { viscosity_um2_s: 0.0, ..Default::default() }.build())];
}

params! {
    /// Parameters of [`Cellular`].
    CellularParams("cellular") {
        /// Maximum speed along x, um/s.
        max_speed_um_s: f64 = 1290.0, [finite];
        /// Wavelengths along x and y (two cells), um.
        wavelengths_um: [f64; 2] = [200.0, 150.0], [> 0];
        /// Amplitude of the lateral oscillation along x, um.
        sway_um: f64 = 0.0, [>= 0];
        /// Frequency of the oscillation, Hz.
        frequency_hz: f64 = 10.0, [>= 0];
        /// x and y of a point where four cells meet, um.
        #[alias = "centre_um"]
        center_um: [f64; 2] = [0.0, 0.0], [finite];
    }
}

entry! {
    CellularParams => Cellular::new, XY;
    "psi = (U/ky) sin kx X sin ky y, X = x + b sin wt";
    "Solomon & Gollub, Phys. Rev. A 38 (1988) 6280";
    [("swaying", || Self { sway_um: 15.0, ..Default::default() }.build())];
}

/// Decaying Taylor-Green vortices with axes along z.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TaylorGreen {
    center: DVec2,
    max_speed: f64,
    wavenumber: f64,
    decay: f64,
}

impl TaylorGreen {
    /// The vortices of these parameters.
    pub fn new(params: &TaylorGreenParams) -> Result<Self> {
        let params = params.checked()?;
        let wavenumber = 2.0 * PI / params.wavelength_um;
        Ok(TaylorGreen {
            center: DVec2::from_array(params.center_um),
            max_speed: params.max_speed_um_s,
            wavenumber: TaylorGreenParams::CHECK.positive("1 / wavelength_um", wavenumber)?,
            decay: 2.0 * params.viscosity_um2_s * wavenumber * wavenumber,
        })
    }

    /// Maximum speed of the vortices at `t` (s), um/s.
    fn strength(&self, t: f64) -> f64 {
        self.max_speed * libm::exp(-self.decay * t)
    }
}

impl Formula for TaylorGreen {
    fn formula<S: Real>(&self, [x, y, _]: [S; 3], t: f64) -> [S; 3] {
        let (x, y) = ((x - self.center.x) * self.wavenumber, (y - self.center.y) * self.wavenumber);
        let strength = self.strength(t);
        [x.sin() * y.cos() * strength, x.cos() * y.sin() * -strength, S::constant(0.0)]
    }
}

impl VelocityField for TaylorGreen {
    by_formula!();
    facts!(divergence_free);

    fn invariant(&self, x: DVec3, _t: f64) -> Option<f64> {
        let phase = (x.truncate() - self.center) * self.wavenumber;
        Some(libm::sin(phase.x) * libm::sin(phase.y))
    }

    fn is_steady(&self) -> bool {
        self.decay == 0.0
    }

    fn max_speed(&self, _region: &Region, t0: f64, t1: f64) -> f64 {
        // sin^2 cos^2 + cos^2 sin^2 is at most 1.
        self.strength(t0.min(t1)).abs() * ROUNDING_MARGIN
    }
}

field! {
    /// An array of roll cells with axes along z.
    Cellular(CellularParams)
}

impl Cellular {
    fn wavenumbers(&self) -> DVec2 {
        2.0 * PI / DVec2::from_array(self.0.wavelengths_um)
    }
}

impl Formula for Cellular {
    fn formula<S: Real>(&self, [x, y, _]: [S; 3], t: f64) -> [S; 3] {
        let CellularParams { max_speed_um_s, sway_um, frequency_hz, center_um, .. } = self.0;
        let k = self.wavenumbers();
        let sway = if sway_um > 0.0 { sway_um * libm::sin(2.0 * PI * frequency_hz * t) } else { 0.0 };
        let (x, y) = ((x - center_um[0] + sway) * k.x, (y - center_um[1]) * k.y);
        let across = -max_speed_um_s * k.x / k.y;
        [x.sin() * y.cos() * max_speed_um_s, x.cos() * y.sin() * across, S::constant(0.0)]
    }
}

impl VelocityField for Cellular {
    by_formula!();
    facts!(divergence_free);

    fn invariant(&self, x: DVec3, _t: f64) -> Option<f64> {
        let phase = (x.truncate() - DVec2::from_array(self.0.center_um)) * self.wavenumbers();
        self.is_steady().then(|| libm::sin(phase.x) * libm::sin(phase.y))
    }

    fn is_steady(&self) -> bool {
        self.0.sway_um == 0.0 || self.0.frequency_hz == 0.0
    }

    fn max_speed(&self, _region: &Region, _t0: f64, _t1: f64) -> f64 {
        // U^2 sin^2 cos^2 + V^2 cos^2 sin^2 is bilinear in the squares: its maximum is at a corner of the
        // unit square.
        self.0.max_speed_um_s.abs() * (self.wavenumbers().x / self.wavenumbers().y).max(1.0) * ROUNDING_MARGIN
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::integrate::advance;

    /// The complete elliptic integral K(m) of the parameter m, by the arithmetic-geometric mean.
    fn elliptic_k(parameter: f64) -> f64 {
        let (mut a, mut b) = (1.0, libm::sqrt(1.0 - parameter));
        for _ in 0..10 {
            (a, b) = (0.5 * (a + b), libm::sqrt(a * b));
        }
        0.5 * PI / a
    }

    #[test]
    fn an_orbit_closes_after_its_elliptic_period() {
        let params = TaylorGreenParams { viscosity_um2_s: 0.0, ..Default::default() };
        let field = TaylorGreen::new(&params).unwrap();
        let start = DVec3::new(30.0, 45.0, 0.0);
        let kept = field.invariant(start, 0.0).unwrap();
        // flows: T = 4 K(1 - m^2) / (k U).
        let period = 4.0 * elliptic_k(1.0 - kept * kept) / (2.0 * PI / 200.0 * 1290.0);
        let end = advance(&field, start, 0.0, period).unwrap();
        // A few hundred steps with errors of at most 1e-8 um, over 150 um.
        assert!((end - start).length() < 1e-6, "{end}");
        // With decay the path is the same, traversed in a time longer by the factor (e^(decay t) - 1) /
        // (decay t).
        let slow = TaylorGreen::new(&TaylorGreenParams::default()).unwrap();
        let longer = -libm::log1p(-slow.decay * period) / slow.decay;
        let end = advance(&slow, start, 0.0, longer).unwrap();
        assert!((end - start).length() < 1e-6, "{end}");
    }

    #[test]
    fn swaying_cells_keep_nothing_and_bad_ones_are_refused() {
        let swaying = CellularParams { sway_um: 10.0, ..Default::default() };
        assert_eq!(Cellular::new(&swaying).unwrap().invariant(DVec3::ONE, 0.0), None);
        let flat = CellularParams { wavelengths_um: [200.0, 0.0], ..Default::default() };
        let message = Cellular::new(&flat).unwrap_err().to_string();
        assert_eq!(message, "cellular: wavelengths_um = 0: expected a finite number > 0");
    }
}
