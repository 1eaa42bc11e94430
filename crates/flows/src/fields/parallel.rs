//! Parallel shear flows in the xy-plane: the tanh layer and the Bickley jet.
//!
//! With y measured from the center line: tanh layer u = Um + (dU / 2) tanh(2 y / delta), the mixing layer of
//! thickness delta (Michalke, J. Fluid Mech. 19 (1964) 543); Bickley jet u = U sech^2(y / L) (Drazin & Reid,
//! Hydrodynamic Stability, section 31). Both are steady; trajectories are straight lines at constant speed.
//! The instabilities of these profiles are not modeled.

use super::prelude::*;

const TANH_LAYER: ParameterCheck = ParameterCheck("tanh_layer");
const BICKLEY_JET: ParameterCheck = ParameterCheck("bickley_jet");

params! {
    /// Parameters of [`TanhLayer`].
    TanhLayerParams {
        /// Mean of the two speeds, um/s.
        mean_speed_um_s: f64 = 645.0, [finite];
        /// Speed at large positive y minus speed at large negative y, um/s.
        difference_um_s: f64 = 1290.0, [finite];
        /// Thickness of the layer, um.
        thickness_um: f64 = 12.9, [> 0];
        /// y of the center of the layer, um.
        #[alias = "centre_y_um"]
        center_y_um: f64 = 0.0, [finite];
    }
}

entry! {
    TanhLayerParams => TanhLayer::new, "tanh_layer", XY;
    "u = Um + (dU/2) tanh(2 y / delta)";
    "Michalke, J. Fluid Mech. 19 (1964) 543";
}

params! {
    /// Parameters of [`BickleyJet`].
    BickleyJetParams {
        /// Speed at the center line, um/s.
        max_speed_um_s: f64 = 1290.0, [finite];
        /// Half width, at which the speed is 0.42 of the maximum, um.
        half_width_um: f64 = 40.0, [> 0];
        /// y of the center line, um.
        #[alias = "centre_y_um"]
        center_y_um: f64 = 0.0, [finite];
    }
}

entry! {
    BickleyJetParams => BickleyJet::new, "bickley_jet", XY;
    "u = U / cosh^2(y / L)";
    "Drazin & Reid, Hydrodynamic Stability, 31";
}

/// A shear layer along x between two streams.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TanhLayer {
    mean: f64,
    half_difference: f64,
    thickness: f64,
    center: f64,
}

impl TanhLayer {
    /// The layer of these parameters.
    pub fn new(params: &TanhLayerParams) -> Result<Self> {
        Ok(TanhLayer {
            mean: TANH_LAYER.finite("mean_speed_um_s", params.mean_speed_um_s)?,
            half_difference: 0.5 * TANH_LAYER.finite("difference_um_s", params.difference_um_s)?,
            thickness: TANH_LAYER.positive("thickness_um", params.thickness_um)?,
            center: TANH_LAYER.finite("center_y_um", params.center_y_um)?,
        })
    }
}

/// 1 / cosh(x)^2, without overflow.
fn sech_squared(x: f64) -> f64 {
    let decay = libm::exp(-2.0 * x.abs());
    4.0 * decay / ((1.0 + decay) * (1.0 + decay))
}

impl Formula for TanhLayer {
    fn formula<S: Real>(&self, [_, y, _]: [S; 3], _t: f64) -> [S; 3] {
        let shape = ((y - self.center) * (2.0 / self.thickness)).map(libm::tanh, sech_squared);
        [shape * self.half_difference + self.mean, S::constant(0.0), S::constant(0.0)]
    }
}

impl VelocityField for TanhLayer {
    by_formula!();
    facts!(divergence_free, steady, straight);

    fn invariant(&self, x: DVec3, _t: f64) -> Option<f64> {
        Some(x.y - self.center)
    }

    fn max_speed(&self, region: &Region, _t0: f64, _t1: f64) -> f64 {
        // The profile is monotonic: the speed is highest at one of the ends.
        let ends = [region.min(), region.max()].map(|x| self.value(x, 0.0).x.abs());
        ends[0].max(ends[1]) * ROUNDING_MARGIN
    }
}

/// A plane jet along x.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BickleyJet {
    max_speed: f64,
    half_width: f64,
    center: f64,
}

impl BickleyJet {
    /// The jet of these parameters.
    pub fn new(params: &BickleyJetParams) -> Result<Self> {
        Ok(BickleyJet {
            max_speed: BICKLEY_JET.finite("max_speed_um_s", params.max_speed_um_s)?,
            half_width: BICKLEY_JET.positive("half_width_um", params.half_width_um)?,
            center: BICKLEY_JET.finite("center_y_um", params.center_y_um)?,
        })
    }
}

impl Formula for BickleyJet {
    fn formula<S: Real>(&self, [_, y, _]: [S; 3], _t: f64) -> [S; 3] {
        let slope = |x: f64| -2.0 * libm::tanh(x) * sech_squared(x);
        let shape = ((y - self.center) / self.half_width).map(sech_squared, slope);
        [shape * self.max_speed, S::constant(0.0), S::constant(0.0)]
    }
}

impl VelocityField for BickleyJet {
    by_formula!();
    facts!(divergence_free, steady, straight);

    fn invariant(&self, x: DVec3, _t: f64) -> Option<f64> {
        Some(x.y - self.center)
    }

    fn max_speed(&self, region: &Region, _t0: f64, _t1: f64) -> f64 {
        let nearest = DVec3::Y * self.center.clamp(region.min().y, region.max().y);
        self.value(nearest, 0.0).x.abs() * ROUNDING_MARGIN
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn profiles_have_their_limits() {
        let layer = TanhLayer::new(&TanhLayerParams::default()).unwrap();
        let at = |field: &dyn VelocityField, y: f64| field.velocity(DVec3::Y * y, 0.0).x;
        assert_eq!([at(&layer, -1e4), at(&layer, 0.0), at(&layer, 1e4)], [0.0, 645.0, 1290.0]);
        let jet = BickleyJet::new(&BickleyJetParams::default()).unwrap();
        let cosh = libm::cosh(1.0);
        assert!((at(&jet, 40.0) - 1290.0 / (cosh * cosh)).abs() < 1e-10);
        assert_eq!([at(&jet, 0.0), at(&jet, 1e5)], [1290.0, 0.0]);
        assert!(BickleyJet::new(&BickleyJetParams { half_width_um: 0.0, ..Default::default() }).is_err());
        assert!(TanhLayer::new(&TanhLayerParams { thickness_um: -1.0, ..Default::default() }).is_err());
    }
}
