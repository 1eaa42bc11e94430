//! Parallel shear flows in the xy-plane: the tanh layer and the Bickley jet.
//!
//! With y measured from the center line: tanh layer u = Um + (dU / 2) tanh(2 y / delta), the mixing layer of
//! thickness delta (Michalke, J. Fluid Mech. 19 (1964) 543); Bickley jet u = U sech^2(y / L) (Drazin & Reid,
//! Hydrodynamic Stability, section 31). Both are steady; trajectories are straight lines at constant speed.
//! The instabilities of these profiles are not modeled.

use super::prelude::*;

params! {
    /// Parameters of [`TanhLayer`].
    TanhLayerParams("tanh_layer") {
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
    TanhLayerParams => TanhLayer::new, XY;
    "u = Um + (dU/2) tanh(2 y / delta)";
    "Michalke, J. Fluid Mech. 19 (1964) 543";
}

params! {
    /// Parameters of [`BickleyJet`].
    BickleyJetParams("bickley_jet") {
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
    BickleyJetParams => BickleyJet::new, XY;
    "u = U / cosh^2(y / L)";
    "Drazin & Reid, Hydrodynamic Stability, 31";
}

field! {
    /// A shear layer along x between two streams.
    TanhLayer(TanhLayerParams)
}

/// 1 / cosh(x)^2, without overflow.
fn sech_squared(x: f64) -> f64 {
    let decay = libm::exp(-2.0 * x.abs());
    4.0 * decay / ((1.0 + decay) * (1.0 + decay))
}

impl Formula for TanhLayer {
    fn formula<S: Real>(&self, [_, y, _]: [S; 3], _t: f64) -> [S; 3] {
        let shape = ((y - self.0.center_y_um) * (2.0 / self.0.thickness_um)).map(libm::tanh, sech_squared);
        [shape * (0.5 * self.0.difference_um_s) + self.0.mean_speed_um_s, S::constant(0.0), S::constant(0.0)]
    }
}

impl VelocityField for TanhLayer {
    by_formula!();
    facts!(divergence_free, steady, straight);

    fn invariant(&self, x: DVec3, _t: f64) -> Option<f64> {
        Some(x.y - self.0.center_y_um)
    }

    fn max_speed(&self, region: &Region, _t0: f64, _t1: f64) -> f64 {
        // The profile is monotonic: the speed is highest at one of the ends.
        let ends = [region.min(), region.max()].map(|x| self.value(x, 0.0).x.abs());
        ends[0].max(ends[1]) * ROUNDING_MARGIN
    }
}

field! {
    /// A plane jet along x.
    BickleyJet(BickleyJetParams)
}

impl Formula for BickleyJet {
    fn formula<S: Real>(&self, [_, y, _]: [S; 3], _t: f64) -> [S; 3] {
        let slope = |x: f64| -2.0 * libm::tanh(x) * sech_squared(x);
        let shape = ((y - self.0.center_y_um) / self.0.half_width_um).map(sech_squared, slope);
        [shape * self.0.max_speed_um_s, S::constant(0.0), S::constant(0.0)]
    }
}

impl VelocityField for BickleyJet {
    by_formula!();
    facts!(divergence_free, steady, straight);

    fn invariant(&self, x: DVec3, _t: f64) -> Option<f64> {
        Some(x.y - self.0.center_y_um)
    }

    fn max_speed(&self, region: &Region, _t0: f64, _t1: f64) -> f64 {
        let nearest = DVec3::Y * self.0.center_y_um.clamp(region.min().y, region.max().y);
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
    }
}
