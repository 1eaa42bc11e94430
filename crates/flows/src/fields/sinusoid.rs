//! Sinusoidal velocity, to measure the spatial frequency response of a method.
//!
//! With k = 2 pi / lambda and a phase p, along x:
//! - transverse: u = A sin(k y + p). Trajectories are straight, so that a displacement is exactly A dt
//!   sin(k y + p).
//! - longitudinal: u = A sin(k x + p). Not divergence-free; with a = k x + p, tan(a/2) grows as e^(k A t).
//! - product: u = A sin(k x + p) sin(k y + p). As longitudinal, with an amplitude that depends on y.

use super::prelude::*;

/// Directions of variation.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize, serde::Deserialize, schemars::JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Variation {
    /// Perpendicular to the velocity, along y.
    Transverse,
    /// Along the velocity, in x.
    Longitudinal,
    /// Along x and y.
    Product,
}

params! {
    /// Parameters of [`Sinusoid`].
    SinusoidParams("sinusoid") {
        /// Maximum speed A, um/s.
        amplitude_um_s: f64 = 387.0, [finite];
        /// Wavelength, um.
        wavelength_um: f64 = 41.28, [> 0];
        /// Phase p at the center of the image, rad.
        phase_rad: f64 = 0.0, [finite];
        /// Directions in which the velocity varies.
        variation: Variation = Variation::Transverse, [one of], "transverse, longitudinal or product";
    }
}

entry! {
    SinusoidParams => Sinusoid::new, XY;
    "transverse u = A sin(ky + p); longitudinal A sin(kx + p); product A sin(kx + p) sin(ky + p)";
    "the usual test of the response of PIV to wavelength";
    [
        ("longitudinal", || Self { variation: Variation::Longitudinal, ..Default::default() }.build()),
        ("product", || Self { variation: Variation::Product, ..Default::default() }.build()),
    ];
}

field! {
    /// A velocity along x that varies as a sine.
    Sinusoid(SinusoidParams)
}

impl Sinusoid {
    fn wavenumber(&self) -> f64 {
        2.0 * PI / self.0.wavelength_um
    }
}

/// Change (rad) over a time `dt` of an angle that obeys da/dt = `rate` sin a: tan(a/2) grows as e^(rate t),
/// so the tangent of half the change is (E - 1) s c / (c^2 + E s^2) with E = e^(rate t), s = sin(a/2) and c =
/// cos(a/2) at the start.
pub(super) fn sine_displacement(angle: f64, rate: f64, dt: f64) -> f64 {
    let (sin, cos) = libm::sincos(0.5 * angle);
    let growth = libm::expm1(rate * dt);
    2.0 * libm::atan(growth * sin * cos / (1.0 + growth * sin * sin))
}

impl Formula for Sinusoid {
    fn formula<S: Real>(&self, [x, y, _]: [S; 3], _t: f64) -> [S; 3] {
        let wave = |s: S| (s * self.wavenumber() + self.0.phase_rad).sin();
        let shape = match self.0.variation {
            Variation::Transverse => wave(y),
            Variation::Longitudinal => wave(x),
            Variation::Product => wave(x) * wave(y),
        };
        [shape * self.0.amplitude_um_s, S::constant(0.0), S::constant(0.0)]
    }
}

impl VelocityField for Sinusoid {
    by_formula!();
    facts!(steady);

    fn flow_map(&self, x: DVec3, t0: f64, t1: f64) -> Option<DVec3> {
        let amplitude = match self.0.variation {
            Variation::Transverse => return Some(x + self.value(x, t0) * (t1 - t0)),
            Variation::Longitudinal => self.0.amplitude_um_s,
            Variation::Product => {
                self.0.amplitude_um_s * libm::sin(self.wavenumber() * x.y + self.0.phase_rad)
            }
        };
        let angle = self.wavenumber() * x.x + self.0.phase_rad;
        let way = sine_displacement(angle, self.wavenumber() * amplitude, t1 - t0);
        Some(x + DVec3::X * (way / self.wavenumber()))
    }

    fn invariant(&self, x: DVec3, _t: f64) -> Option<f64> {
        Some(x.y)
    }

    fn is_divergence_free(&self) -> bool {
        self.0.variation == Variation::Transverse
    }

    fn max_speed(&self, _region: &Region, _t0: f64, _t1: f64) -> f64 {
        self.0.amplitude_um_s.abs() * ROUNDING_MARGIN
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_default_moves_by_three_px_at_most_over_64_px() {
        let field = Sinusoid::new(&SinusoidParams::default()).unwrap();
        let way = field.flow_map(DVec3::new(0.0, 0.25 * 41.28, 0.0), 0.0, 0.005).unwrap().x;
        assert!((way / 0.645 - 3.0).abs() < 1e-12);
    }
}
