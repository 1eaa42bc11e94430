//! Womersley flow: pulsating flow between plates or in a tube.
//!
//! A mean velocity Us + Re(A e^(iwt)) gives, with the Womersley number Wo = h sqrt(w / nu) of the half depth
//! or radius h and the relative distance eta from the middle plane or axis,
//!
//!   u = Us P_0(eta) + Re(A P(eta) e^(iwt)),
//!   plane: P = [1 - cosh(L eta) / cosh L] / [1 - tanh L / L], L = sqrt(i) Wo, P_0 = (3/2) (1 - eta^2),
//!   tube:  P = [1 - J0(L eta) / J0(L)] / [1 - 2 J1(L) / (L J0(L))], L = i^(3/2) Wo, P_0 = 2 (1 - eta^2)
//!
//! (Womersley, J. Physiol. 127 (1955) 553; the plane case: Landau & Lifshitz, Fluid Mechanics, section 24).
//! Numerator and denominator are expanded in powers of i Wo^2 and the common factor that vanishes with Wo is
//! cancelled: one polynomial in eta^2 for all Wo from 0 (the parabola) to 40, where cancellation limits the
//! relative error to 1e-12. Trajectories are straight lines, and displacements are the time integral of the
//! velocity. Outside the channel or tube the velocity is zero.

use super::plates::Plates;
use super::prelude::*;

/// Largest Womersley number for which the series is accurate.
const MAX_WO: f64 = 40.0;

/// The cross-section of a pulsating flow.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize, serde::Deserialize, schemars::JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum CrossSection {
    /// Between two plates.
    Plane,
    /// In a tube that touches both walls, with its axis midway between them.
    Tube,
}

params! {
    /// Parameters of [`Womersley`].
    WomersleyParams("womersley") {
        /// Two plates, or a tube whose diameter is the distance between floor and ceiling.
        cross_section: CrossSection = CrossSection::Plane, [one of], "plane or tube";
        /// Steady part of the mean velocity over the cross-section, um/s.
        steady_speed_um_s: f64 = 430.0, [finite];
        /// Amplitude of the pulsating part of the mean velocity (a cosine in time), um/s.
        amplitude_um_s: f64 = 430.0, [finite];
        /// Frequency, Hz.
        frequency_hz: f64 = 20.0, [> 0], "Womersley number at most 40";
        /// Kinematic viscosity, um^2/s; water: 1e6.
        viscosity_um2_s: f64 = 1e6, [> 0], "Womersley number at most 40";
        /// z of floor and ceiling, um.
        #[otherwise = "the depth range"]
        walls_z_um: Option<[f64; 2]> = None, [finite], "floor below ceiling";
        /// y of the axis of the tube, um.
        #[alias = "centre_y_um"]
        center_y_um: f64 = 0.0, [finite];
    }
}

entry! {
    WomersleyParams => Womersley::new, XZ;
    "u = Us P0 + Re(A P e^(iwt)), plane P = (1 - cosh(L eta)/cosh L) / (1 - tanh(L)/L), L = sqrt(i) Wo; tube with J0";
    "Womersley, J. Physiol. 127 (1955) 553";
    [
        ("plane Wo 5", || Self { viscosity_um2_s: 12_566.0, ..Default::default() }.build()),
        ("tube", || {
            Self { cross_section: CrossSection::Tube, viscosity_um2_s: 12_566.0, ..Default::default() }
                .build()
        }),
        ("tube Wo 40", || {
            Self { cross_section: CrossSection::Tube, viscosity_um2_s: 197.0, ..Default::default() }
                .build()
        }),
    ];
    walls_z_um: walls;
}

/// A complex number: the real and the imaginary part.
type Complex = DVec2;

/// Pulsating flow along x between plates or in a tube.
#[derive(Debug, Clone, PartialEq)]
pub struct Womersley {
    plates: Plates,
    /// y of the axis (um) of a tube; `None` for plates.
    axis: Option<f64>,
    steady: f64,
    amplitude: f64,
    omega: f64,
    /// P = SUM_k c_k (1 - eta^2k), k from 1.
    series: Vec<Complex>,
    /// SUM_k c_k.
    total: Complex,
    /// Maximum of |P| over the cross-section.
    peak: f64,
}

impl Womersley {
    /// The flow of these parameters.
    pub fn new(params: &WomersleyParams) -> Result<Self> {
        let (params, check) = (params.checked()?, WomersleyParams::CHECK);
        let plates = Plates::new(check, params.walls_z_um)?;
        let omega = 2.0 * PI * params.frequency_hz;
        let wo = 0.5 * plates.depth * libm::sqrt(omega / params.viscosity_um2_s);
        if wo.is_nan() || wo > MAX_WO {
            let allowed = "at most 40: a lower frequency_hz or a higher viscosity_um2_s";
            return Err(check.fault("Womersley number", wo, allowed));
        }
        let axis = (params.cross_section == CrossSection::Tube).then_some(params.center_y_um);
        let series = series(params.cross_section, wo);
        let total = series.iter().sum();
        let mut field = Womersley {
            plates,
            axis,
            steady: params.steady_speed_um_s,
            amplitude: params.amplitude_um_s,
            omega,
            series,
            total,
            peak: 0.0,
        };
        // The maximum is within 1/4000 of a node, where |P| differs from it by a factor of less than 1 +
        // (Wo/4000)^2.
        let nodes = (0..=2000).map(|i| f64::from(i) / 2000.0);
        let size = |p: Complex| libm::hypot(p.x, p.y);
        field.peak = 1.001 * nodes.map(|eta| size(field.pulse(eta * eta).0)).fold(0.0, f64::max);
        Ok(field)
    }

    /// The Womersley number of these parameters.
    pub fn number(params: &WomersleyParams) -> f64 {
        let [floor, ceiling] = params.walls_z_um.unwrap_or(CHANNEL);
        let half = 0.5 * (ceiling - floor);
        half * libm::sqrt(2.0 * PI * params.frequency_hz / params.viscosity_um2_s)
    }

    /// The position in the cross-section relative to the mid-plane or axis, in units of half the depth.
    fn place(&self, x: DVec3) -> DVec2 {
        let half = 0.5 * self.plates.depth;
        let y = self.axis.map_or(0.0, |axis| (x.y - axis) / half);
        DVec2::new(y, (x.z - self.plates.middle()) / half)
    }

    /// P and dP/d(eta^2).
    fn pulse(&self, eta2: f64) -> (Complex, Complex) {
        let (mut sum, mut slope) = (Complex::ZERO, Complex::ZERO);
        for term in self.series.iter().rev() {
            slope = slope * eta2 + sum;
            sum = sum * eta2 + *term;
        }
        // SUM c_k eta^2k = eta2 * sum.
        (self.total + sum * -eta2, -(sum + slope * eta2))
    }

    /// P_0 and dP_0/d(eta^2).
    fn parabola(&self, eta2: f64) -> (f64, f64) {
        let peak = if self.axis.is_some() { 2.0 } else { 1.5 };
        (peak * (1.0 - eta2), -peak)
    }

    /// Speed and its derivative with respect to eta^2, for the mean velocities `steady` of the steady part
    /// and Re(`pulse`) of the pulsating part.
    fn speed(&self, eta2: f64, steady: f64, pulse: Complex) -> (f64, f64) {
        if eta2 > 1.0 {
            return (0.0, 0.0);
        }
        let ((p0, slope0), (p, slope)) = (self.parabola(eta2), self.pulse(eta2));
        (steady * p0 + pulse.rotate(p).x, steady * slope0 + pulse.rotate(slope).x)
    }

    /// A e^(iwt).
    fn drive(&self, t: f64) -> Complex {
        let (sin, cos) = libm::sincos(self.omega * t);
        Complex::new(cos, sin) * self.amplitude
    }
}

/// The coefficients c_k of the profile: with q = i Wo^2 (plane) or i Wo^2 / 4 (tube) they are q^(k-1) a_k
/// over SUM_k q^(k-1) m_k, a_k = 1/(2k)! or 1/k!^2, and m_k = a_k 2k/(2k+1) or a_k k/(k+1) the mean of a_k
/// (1 - eta^2k).
fn series(cross_section: CrossSection, wo: f64) -> Vec<Complex> {
    let tube = cross_section == CrossSection::Tube;
    let q = Complex::new(0.0, if tube { 0.25 * wo * wo } else { wo * wo });
    let mut term = Complex::new(if tube { 1.0 } else { 0.5 }, 0.0);
    let mut terms = Vec::new();
    let mut mean = Complex::ZERO;
    // The largest terms have k = Wo/2; 40 terms later they are below 1e-30 of the sum.
    for k in 1..=(60 + wo as u32) {
        let k = f64::from(k);
        terms.push(term);
        mean += term * if tube { k / (k + 1.0) } else { 2.0 * k / (2.0 * k + 1.0) };
        let ratio = if tube { (k + 1.0) * (k + 1.0) } else { (2.0 * k + 1.0) * (2.0 * k + 2.0) };
        term = term.rotate(q) * (1.0 / ratio);
    }
    let inverse = Complex::new(mean.x, -mean.y) / mean.length_squared();
    terms.into_iter().map(|term| term.rotate(inverse)).collect()
}

impl VelocityField for Womersley {
    facts!(divergence_free);

    fn velocity(&self, x: DVec3, t: f64) -> DVec3 {
        DVec3::X * self.speed(self.place(x).length_squared(), self.steady, self.drive(t)).0
    }

    fn gradient(&self, x: DVec3, t: f64) -> DMat3 {
        let place = self.place(x);
        let slope = self.speed(place.length_squared(), self.steady, self.drive(t)).1;
        let across = place * (2.0 * slope / (0.5 * self.plates.depth));
        DMat3::from_cols(DVec3::ZERO, DVec3::X * across.x, DVec3::X * across.y)
    }

    fn flow_map(&self, x: DVec3, t0: f64, t1: f64) -> Option<DVec3> {
        // The integral of e^(iwt) is its value at the mid-time times 2 sin(w dt / 2) / w.
        let weight = 2.0 * libm::sin(0.5 * self.omega * (t1 - t0)) / self.omega;
        let pulse = self.drive(0.5 * (t0 + t1)) * weight;
        let way = self.speed(self.place(x).length_squared(), self.steady * (t1 - t0), pulse).0;
        Some(x + DVec3::X * way)
    }

    fn invariant(&self, x: DVec3, _t: f64) -> Option<f64> {
        Some(self.place(x).length())
    }

    fn wall(&self, x: DVec3, _t: f64) -> Option<Wall> {
        Some(match self.axis {
            None => self.plates.wall(x),
            Some(axis) => {
                let arm = DVec3::new(0.0, x.y - axis, x.z - self.plates.middle());
                Wall::inside(arm, 0.5 * self.plates.depth)
            }
        })
    }

    fn walls_same_along(&self) -> [bool; 3] {
        [true, self.axis.is_none(), false]
    }

    fn max_speed(&self, _region: &Region, _t0: f64, _t1: f64) -> f64 {
        (self.steady.abs() * self.parabola(0.0).0 + self.amplitude.abs() * self.peak) * ROUNDING_MARGIN
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn params(cross_section: CrossSection, wo: f64) -> WomersleyParams {
        // Wo^2 = h^2 w / nu with h = 50 um.
        let viscosity_um2_s = 2500.0 * 2.0 * PI * 20.0 / (wo * wo);
        WomersleyParams { cross_section, viscosity_um2_s, steady_speed_um_s: 0.0, ..Default::default() }
    }

    /// Residual of du/dt = G(t) + nu (u'' [+ u'/r]): its variation over the cross-section, divided by w A.
    fn momentum_residual(params: &WomersleyParams) -> f64 {
        let field = Womersley::new(params).unwrap();
        let tube = params.cross_section == CrossSection::Tube;
        let omega = 2.0 * PI * params.frequency_hz;
        let residual = |t: f64, eta: f64| {
            let u =
                |d: f64, dt: f64| field.velocity(DVec3::new(0.0, 0.0, -30.0 + 50.0 * (eta + d)), t + dt).x;
            let h = 0.2 / f64::max(Womersley::number(params), 4.0);
            let h = h.min(0.02);
            let second = (-u(2.0 * h, 0.0) + 16.0 * u(h, 0.0) - 30.0 * u(0.0, 0.0) + 16.0 * u(-h, 0.0)
                - u(-2.0 * h, 0.0))
                / (12.0 * h * h * 2500.0);
            let first =
                (8.0 * (u(h, 0.0) - u(-h, 0.0)) - u(2.0 * h, 0.0) + u(-2.0 * h, 0.0)) / (12.0 * h * 50.0);
            let dt = 1e-3 / omega;
            let rate = (u(0.0, dt) - u(0.0, -dt)) / (2.0 * dt);
            let laplacian = second + if tube { first / (50.0 * eta) } else { 0.0 };
            rate - params.viscosity_um2_s * laplacian
        };
        let mut worst = 0.0_f64;
        for t in [0.0, 0.007, 0.03] {
            // The pressure gradient is uniform over the cross-section.
            let pressure = residual(t, 0.31);
            for eta in [0.1, 0.5, 0.8, 0.9] {
                worst = worst.max((residual(t, eta) - pressure).abs() / (omega * params.amplitude_um_s));
            }
        }
        worst
    }

    #[test]
    fn it_solves_the_momentum_equation() {
        for cross_section in [CrossSection::Plane, CrossSection::Tube] {
            for wo in [0.8, 5.0, 15.0] {
                let residual = momentum_residual(&params(cross_section, wo));
                // Finite-difference errors: dt^2 w^2 / 6 = 2e-7, and (h Wo)^4 / 90 = 2e-5 of the viscous
                // term, which is of order 1.
                assert!(residual < 1e-4, "{cross_section:?} {wo}: {residual:e}");
            }
        }
    }

    #[test]
    fn the_mean_over_the_cross_section_is_the_one_asked_for() {
        for cross_section in [CrossSection::Plane, CrossSection::Tube] {
            for wo in [1e-3, 1.0, 5.0, 20.0, 40.0] {
                let params = WomersleyParams { steady_speed_um_s: 100.0, ..params(cross_section, wo) };
                let field = Womersley::new(&params).unwrap();
                let tube = cross_section == CrossSection::Tube;
                let speed = |eta: f64| {
                    let weight = if tube { 2.0 * eta } else { 1.0 };
                    weight * field.velocity(DVec3::new(0.0, 0.0, -30.0 + 50.0 * eta), 0.011).x
                };
                let parts = 64;
                let node = |i: i32| f64::from(i) / f64::from(parts);
                let mean: f64 =
                    (0..parts).map(|i| crate::special::gauss_mean(node(i), node(i + 1), speed)).sum::<f64>()
                        / f64::from(parts);
                let expected = 100.0 + 430.0 * libm::cos(2.0 * PI * 20.0 * 0.011);
                // 1e-12 at Wo = 40.
                assert!((mean - expected).abs() < 1e-9, "{cross_section:?} {wo}: {mean} {expected}");
            }
        }
    }

    #[test]
    fn slow_pulsation_is_the_parabola_and_fast_pulsation_a_plug() {
        let at = |wo: f64, eta: f64| {
            let field = Womersley::new(&params(CrossSection::Plane, wo)).unwrap();
            field.velocity(DVec3::new(0.0, 0.0, -30.0 + 50.0 * eta), 0.0).x / 430.0
        };
        // The leading correction is of order Wo^2.
        assert!((at(1e-6, 0.0) - 1.5).abs() < 1e-11 && (at(1e-6, 0.5) - 1.125).abs() < 1e-11);
        // 1 + O(1/Wo) at the center.
        assert!((at(40.0, 0.0) - 1.0).abs() < 0.03 && at(40.0, 1.0).abs() < 1e-11);
    }

    #[test]
    fn too_fast_for_the_series_is_refused() {
        let message = Womersley::new(&params(CrossSection::Tube, 50.0)).unwrap_err().to_string();
        assert!(
            message.starts_with("womersley: Womersley number = ") && message.contains("at most 40"),
            "{message}"
        );
    }
}
