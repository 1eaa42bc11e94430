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

const TAYLOR_GREEN: ParameterCheck = ParameterCheck("taylor_green");
const CELLULAR: ParameterCheck = ParameterCheck("cellular");

params! {
    /// Parameters of [`TaylorGreen`].
    TaylorGreenParams {
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
    TaylorGreenParams => TaylorGreen::new, "taylor_green", XY;
    "u = U sin kx cos ky e^(-2 nu k^2 t), v = -U cos kx sin ky e^(-2 nu k^2 t)";
    "Taylor & Green, Proc. R. Soc. A 158 (1937) 499";
    [("steady", || Self { viscosity_um2_s: 0.0, ..Default::default() }.build())];
}

params! {
    /// Parameters of [`Cellular`].
    CellularParams {
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
    CellularParams => Cellular::new, "cellular", XY;
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
        let wavenumber = 2.0 * PI / TAYLOR_GREEN.positive("wavelength_um", params.wavelength_um)?;
        let viscosity = TAYLOR_GREEN.not_negative("viscosity_um2_s", params.viscosity_um2_s)?;
        Ok(TaylorGreen {
            center: DVec2::from_array(TAYLOR_GREEN.all_finite("center_um", params.center_um)?),
            max_speed: TAYLOR_GREEN.finite("max_speed_um_s", params.max_speed_um_s)?,
            wavenumber: TAYLOR_GREEN.positive("1 / wavelength_um", wavenumber)?,
            decay: 2.0 * viscosity * wavenumber * wavenumber,
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

/// An array of roll cells with axes along z.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Cellular {
    center: DVec2,
    max_speed: f64,
    wavenumbers: DVec2,
    sway: f64,
    omega: f64,
}

impl Cellular {
    /// The cells of these parameters.
    pub fn new(params: &CellularParams) -> Result<Self> {
        let [long, across] = params.wavelengths_um;
        let wavenumbers = DVec2::new(
            2.0 * PI / CELLULAR.positive("wavelengths_um", long)?,
            2.0 * PI / CELLULAR.positive("wavelengths_um", across)?,
        );
        Ok(Cellular {
            center: DVec2::from_array(CELLULAR.all_finite("center_um", params.center_um)?),
            max_speed: CELLULAR.finite("max_speed_um_s", params.max_speed_um_s)?,
            wavenumbers,
            sway: CELLULAR.not_negative("sway_um", params.sway_um)?,
            omega: 2.0 * PI * CELLULAR.not_negative("frequency_hz", params.frequency_hz)?,
        })
    }
}

impl Formula for Cellular {
    fn formula<S: Real>(&self, [x, y, _]: [S; 3], t: f64) -> [S; 3] {
        let sway = if self.sway > 0.0 { self.sway * libm::sin(self.omega * t) } else { 0.0 };
        let x = (x - self.center.x + sway) * self.wavenumbers.x;
        let y = (y - self.center.y) * self.wavenumbers.y;
        let across = -self.max_speed * self.wavenumbers.x / self.wavenumbers.y;
        [x.sin() * y.cos() * self.max_speed, x.cos() * y.sin() * across, S::constant(0.0)]
    }
}

impl VelocityField for Cellular {
    by_formula!();
    facts!(divergence_free);

    fn invariant(&self, x: DVec3, _t: f64) -> Option<f64> {
        let phase = (x.truncate() - self.center) * self.wavenumbers;
        self.is_steady().then(|| libm::sin(phase.x) * libm::sin(phase.y))
    }

    fn is_steady(&self) -> bool {
        self.sway == 0.0 || self.omega == 0.0
    }

    fn max_speed(&self, _region: &Region, _t0: f64, _t1: f64) -> f64 {
        // U^2 sin^2 cos^2 + V^2 cos^2 sin^2 is bilinear in the squares: its maximum is at a corner of the
        // unit square.
        self.max_speed.abs() * (self.wavenumbers.x / self.wavenumbers.y).max(1.0) * ROUNDING_MARGIN
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
