//! Facts on images of particles of several sizes.

use serde::{Deserialize, Serialize};

use crate::preview::{Preview, SizeCurves};

/// Noise-free images of particles of one size through the depth range.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct SizeFacts {
    /// Diameter, um.
    pub d_um: f64,
    /// Depth of the highest peak, um; `None` if all depths are in focus.
    pub focus_um: Option<f64>,
    /// Least and greatest peak above the background over depth.
    pub peak_counts: [f64; 2],
    /// Least and greatest signal-to-noise ratio over depth; `None` without noise.
    pub snr: Option<[f64; 2]>,
}

impl SizeFacts {
    /// Those of a preview; none if there is one size only.
    pub fn of(preview: &Preview) -> Vec<SizeFacts> {
        if preview.sizes.len() < 2 {
            return Vec::new();
        }
        let facts = |size: &SizeCurves| SizeFacts {
            d_um: size.d_um,
            focus_um: size.focus_um,
            peak_counts: size.range(|depth| Some(depth.peak_counts)).unwrap_or_default(),
            snr: size.range(|depth| depth.snr),
        };
        preview.sizes.iter().map(facts).collect()
    }
}
