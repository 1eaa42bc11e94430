//! The keys of the calibration stacks.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Calibration stacks: images of one particle, scanned through the depth range; particles of several sizes
/// get one stack each.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Calibration {
    /// Writes stacks to `calibration/`. The step is 2 um, halved until it is at most about a quarter of the
    /// depth of field and a stack has at least 41 images. A list of up to eight diameters gets one stack per
    /// diameter; a distribution gets one for each of its 10, 50 and 90 % quantiles, or a single one for its
    /// mean if these quantiles differ by less than 10 %.
    #[default]
    Stack,
    /// The same with this step.
    EveryUm(#[schemars(extend("x-range" = "> 0 and <= 1e6", "x-unit" = "um"), example = 1.0)] f64),
    /// One stack for each given diameter.
    Sizes {
        /// Particle diameters of the stacks, without duplicates.
        #[schemars(length(min = 1, max = 16), extend("x-unit" = "um", "x-range" = "each > 0 and <= 1e6"), example = vec![2.0, 5.0])]
        diameters_um: Vec<f64>,
        /// Step in depth.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        #[schemars(extend("x-range" = "> 0 and <= 1e6", "x-unit" = "um", "x-default" = "as for `stack`"))]
        every_um: Option<f64>,
    },
    /// No stack.
    None,
}
