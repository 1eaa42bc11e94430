//! A Gaussian band of wavelengths, discretized by Gauss-Hermite quadrature.

use super::quadrature;

/// One wavelength of the band.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Line {
    pub(super) wavelength_um: f64,
    /// Its fraction of the light.
    pub(super) share: f64,
}

impl Line {
    /// 2 pi / wavelength, 1/um.
    pub(super) fn k(&self) -> f64 {
        2.0 * std::f64::consts::PI / self.wavelength_um
    }
}

/// Lines with less than this fraction of the light are omitted.
const MIN_WEIGHT: f64 = 1e-7;

/// Lines of a band with the given center and full width at half maximum (um), for pupil functions whose
/// optical paths differ by up to `spread_um`.
pub(super) fn lines(center_um: f64, width_um: f64, spread_um: f64, tolerance: f64) -> Vec<Line> {
    if width_um == 0.0 {
        return vec![Line { wavelength_um: center_um, share: 1.0 }];
    }
    let phases = 2.0 * std::f64::consts::PI * spread_um * width_um / (center_um * center_um);
    let more = usize::from(tolerance < 1e-3) * 2;
    let n = libm::ceil(1.0 + 2.0 * phases) as usize + more;
    let (nodes, weights) = quadrature::hermite(n);
    // Full width at half maximum over standard deviation: 2 sqrt(2 ln 2).
    let sigma = width_um / 2.354_820_045_030_949_3;
    let kept = nodes.iter().zip(&weights).filter(|(_, weight)| **weight > MIN_WEIGHT);
    let sum: f64 = kept.clone().map(|(_, weight)| weight).sum();
    kept.map(|(x, weight)| Line { wavelength_um: center_um + sigma * x, share: weight / sum }).collect()
}
