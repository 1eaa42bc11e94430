//! Electro-osmotic flow between two charged plates, open or closed at the ends.
//!
//! With the Debye length 1/k, the half depth h and z measured from the mid-plane, u = U [1 - cosh(k z) /
//! cosh(k h)]; its mean is U [1 - tanh(k h) / (k h)], and U = -epsilon zeta E / mu is the
//! Helmholtz-Smoluchowski slip velocity (Bruus, Theoretical Microfluidics, section 9.2; 50 mV and 100 V/cm in
//! water give 390 um/s). Debye lengths in water are far below the resolution of a microscope, so that the
//! default is the thin-layer limit: plug flow with slip at the plates. In a channel that is closed at its
//! ends, pressure drives the same flow rate back: a parabola with the same mean is subtracted; for the thin
//! layer u = U (1 - 6 s (1 - s)), which is zero at s = (1 +- 1/sqrt 3) / 2. Trajectories are straight lines.
//! Beyond the plates the velocity is zero.

use super::plates::{Plates, along, direction, inside};
use super::prelude::*;

params! {
    /// Parameters of [`ElectroOsmotic`].
    ElectroOsmoticParams("electro_osmotic") {
        /// Helmholtz-Smoluchowski slip velocity U, um/s.
        slip_speed_um_s: f64 = 390.0, [finite];
        /// Debye length, um; 0: thin-layer limit.
        debye_length_um: f64 = 0.0, [>= 0];
        /// Whether the channel is closed at its ends, so that the net flow rate is zero.
        closed: bool = false, [one of], "true or false";
        /// z of floor and ceiling, um.
        #[otherwise = "the depth range"]
        walls_z_um: Option<[f64; 2]> = None, [finite], "floor below ceiling";
        /// Direction of the flow in the image plane, from x toward y, rad.
        direction_rad: f64 = 0.0, [finite];
    }
}

entry! {
    ElectroOsmoticParams => ElectroOsmotic::new, XZ;
    "u = U (1 - cosh(z/l) / cosh(h/l)), closed: minus the parabola of the same mean";
    "Bruus, Theoretical Microfluidics, 9.2";
    [
        ("closed", || Self { closed: true, ..Default::default() }.build()),
        ("thick layer", || Self { debye_length_um: 5.0, closed: true, ..Default::default() }.build()),
    ];
    walls_z_um: walls;
}

/// Electro-osmotic flow in a plane channel.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ElectroOsmotic {
    plates: Plates,
    direction: DVec3,
    slip: f64,
    /// 1 / Debye length, 1/um; infinite for a thin layer.
    decay: f64,
    /// Mean velocity of the pressure-driven back flow, um/s.
    back: f64,
}

impl ElectroOsmotic {
    /// The flow of these parameters.
    pub fn new(params: &ElectroOsmoticParams) -> Result<Self> {
        let params = params.checked()?;
        let plates = Plates::new(ElectroOsmoticParams::CHECK, params.walls_z_um)?;
        let (slip, decay) = (params.slip_speed_um_s, 1.0 / params.debye_length_um);
        let kh = 0.5 * plates.depth * decay;
        let mean = if kh.is_infinite() { slip } else { slip * (1.0 - libm::tanh(kh) / kh) };
        let back = if params.closed { -mean } else { 0.0 };
        Ok(ElectroOsmotic { plates, direction: direction(params.direction_rad), slip, decay, back })
    }

    /// Mean velocity over the depth, um/s.
    pub fn mean_speed(&self) -> f64 {
        let kh = 0.5 * self.plates.depth * self.decay;
        let plug = if kh.is_infinite() { 1.0 } else { 1.0 - libm::tanh(kh) / kh };
        self.slip * plug + self.back
    }
}

impl Formula for ElectroOsmotic {
    fn formula<S: Real>(&self, [_, _, z]: [S; 3], _t: f64) -> [S; 3] {
        if !inside(self.plates.height(z).value()) {
            return [S::constant(0.0); 3];
        }
        let mut speed = self.plates.parabola(z) * self.back + self.slip;
        if self.decay.is_finite() {
            // cosh(kz) / cosh(kh) written as exponential decay from both plates, which cannot overflow.
            let decayed = |distance: S| {
                let rate = self.decay;
                (distance * -rate).map(libm::exp, libm::exp)
            };
            let layers =
                decayed(z - self.plates.floor) + decayed(-z + (self.plates.floor + self.plates.depth));
            speed = speed - layers * (self.slip / (1.0 + libm::exp(-self.plates.depth * self.decay)));
        }
        along(self.direction, speed)
    }
}

impl VelocityField for ElectroOsmotic {
    by_formula!();
    facts!(divergence_free, steady, straight, walls_same_along(true, true, false));

    fn invariant(&self, x: DVec3, _t: f64) -> Option<f64> {
        Some(x.z)
    }

    fn wall(&self, x: DVec3, _t: f64) -> Option<Wall> {
        Some(self.plates.wall(x))
    }

    fn max_speed(&self, region: &Region, _t0: f64, _t1: f64) -> f64 {
        // Plug flow (0 to the slip velocity) and back flow (0 to 3/2 of its mean) have opposite signs: the
        // larger of the two bounds the speed.
        let back = self.back.abs() * self.plates.greatest_parabola(region);
        self.slip.abs().max(back) * ROUNDING_MARGIN
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn field(debye_length_um: f64, closed: bool) -> ElectroOsmotic {
        ElectroOsmotic::new(&ElectroOsmoticParams { debye_length_um, closed, ..Default::default() }).unwrap()
    }

    #[test]
    fn the_mean_is_the_integral_and_closed_channels_have_none() {
        for (debye, closed) in [(0.0, false), (5.0, false), (5.0, true), (0.0, true)] {
            let field = field(debye, closed);
            let speed = |z: f64| field.velocity(DVec3::new(0.0, 0.0, z), 0.0).x;
            let mean: f64 = (0..50)
                .map(|i| -80.0 + 2.0 * f64::from(i))
                .map(|z| crate::special::gauss_mean(z, z + 2.0, speed))
                .sum::<f64>()
                / 50.0;
            // Rounding errors of 390 um/s.
            assert!((mean - field.mean_speed()).abs() < 1e-11, "{debye} {closed}: {mean}");
            assert!(!closed || mean.abs() < 1e-11);
        }
    }

    #[test]
    fn a_thin_layer_in_a_closed_channel_turns_where_it_should() {
        let z = -80.0 + 100.0 * 0.5 * (1.0 - 1.0 / libm::sqrt(3.0));
        assert!(field(0.0, true).velocity(DVec3::new(0.0, 0.0, z), 0.0).x.abs() < 1e-10);
        assert_eq!(field(0.0, true).velocity(DVec3::new(0.0, 0.0, -30.0), 0.0).x, -195.0);
        // With a resolved layer the velocity at the plates is zero, up to rounding.
        assert!(field(5.0, false).velocity(DVec3::new(0.0, 0.0, 20.0), 0.0).length() < 1e-12);
    }
}
