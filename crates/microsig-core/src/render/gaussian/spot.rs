//! The Gaussian spot of a particle: diameter, light and extent.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Pixels that would receive less than this many counts from a spot may be skipped. Ten overlapping tails
/// would be needed for half a count.
pub(super) const NEGLIGIBLE: f64 = 0.05;

/// Gaussian spots, all in focus, instead of rays, as in synthetic images for classical PIV.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default)]
#[schemars(rename = "Gaussian")]
pub struct GaussianSpot {
    /// e^-2 diameter of a spot.
    #[schemars(extend("exclusiveMinimum" = 0, "maximum" = 1000))]
    pub diameter_px: f64,
    /// Particle diameter whose spot has `diameter_px`; other spots scale with their particles.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(extend("exclusiveMinimum" = 0, "maximum" = 1e6, "x-default" = "all spots have the same diameter"))]
    pub reference_um: Option<f64>,
    /// Peak of the irradiance of a particle with `c_int` 1, counts per pixel before gain.
    #[schemars(range(min = 0.0, max = 1e9))]
    pub peak_counts: f64,
}

impl Default for GaussianSpot {
    /// The diameter at which PIV errors are smallest; the peak is 100 times the noise of setting 1.
    fn default() -> Self {
        GaussianSpot { diameter_px: 2.5, reference_um: None, peak_counts: 1000.0 }
    }
}

/// Precomputed factors of [`GaussianSpot`] for a gain, on which the extent of spots depends.
#[derive(Debug, Clone, Copy)]
pub(super) struct SpotScaling {
    /// e^-2 diameter of a spot: constant part (px), and `diameter_px_per_um` per particle diameter (px/um).
    diameter_px: f32,
    diameter_px_per_um: f32,
    counts_per_negligible: f32,
    /// Peak times pi / 32; times the squared diameter, a quarter of the integral of the spot.
    light: f32,
}

impl SpotScaling {
    pub(super) fn new(spot: GaussianSpot, gain: f64) -> Self {
        let per_um = spot.reference_um.map(|reference| spot.diameter_px / reference);
        SpotScaling {
            diameter_px: if per_um.is_some() { 0.0 } else { spot.diameter_px as f32 },
            diameter_px_per_um: per_um.unwrap_or(0.0) as f32,
            counts_per_negligible: (spot.peak_counts * gain / NEGLIGIBLE) as f32,
            light: (spot.peak_counts * std::f64::consts::PI / 32.0) as f32,
        }
    }

    /// e^-2 diameter (px) of the spot of a particle of diameter `d_um` (um).
    #[inline(always)]
    pub(super) fn diameter(&self, d_um: f32) -> f32 {
        self.diameter_px + self.diameter_px_per_um * d_um
    }

    /// Peak times (sigma sqrt(pi / 2))^2 for a spot of this diameter (px).
    #[inline(always)]
    pub(super) fn light(&self, diameter: f32, c_int: f32) -> f32 {
        self.light * c_int * diameter * diameter
    }

    /// The distance (px) beyond which a spot adds less than [`NEGLIGIBLE`] counts.
    #[inline(always)]
    pub(super) fn reach(&self, diameter: f32, c_int: f32) -> f32 {
        let log = log_upper_bound(c_int * self.counts_per_negligible);
        diameter * (if log > 0.0 { log * 0.125 } else { 0.0 }).sqrt()
    }
}

/// An upper bound of log(x) for x >= 0, too large by less than 0.06: log2(1 + m) <= m + 0.0861 for mantissas
/// m in [0, 1).
#[inline(always)]
fn log_upper_bound(x: f32) -> f32 {
    const FRACTION: u32 = (1 << 23) - 1;
    let exponent = (x.to_bits() >> 23) as i32 as f32 - 127.0;
    let mantissa = f32::from_bits(x.to_bits() & FRACTION | 1.0f32.to_bits()) - 1.0;
    std::f32::consts::LN_2 * (exponent + mantissa + 0.0862)
}
