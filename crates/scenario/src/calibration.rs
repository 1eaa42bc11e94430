//! The keys of the calibration stacks.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Calibration stacks: one particle, scanned through the depth range; of particles of several sizes a stack
/// for each.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Calibration {
    /// Written to `calibration/`, in steps of 2 um or, where that is more than about a quarter of the depth
    /// of field or makes fewer than 41 images, half of that, and so on. One stack for each diameter of a list
    /// of up to eight; for distributions one for each of the 10, 50 and 90 % quantiles, or for the mean alone
    /// where these differ by less than 10 %.
    #[default]
    Stack,
    /// The same in steps of this length.
    EveryUm(#[schemars(extend("x-range" = "> 0 and <= 1e6", "x-unit" = "um"), example = 1.0)] f64),
    /// One stack for each of these sizes.
    Sizes {
        /// Diameters of the particles of the stacks, each different.
        #[schemars(length(min = 1, max = 16), extend("x-unit" = "um", "x-range" = "each > 0 and <= 1e6"), example = vec![2.0, 5.0])]
        diameters_um: Vec<f64>,
        /// Length of the steps.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        #[schemars(extend("x-range" = "> 0 and <= 1e6", "x-unit" = "um", "x-default" = "as for `stack`"))]
        every_um: Option<f64>,
    },
    /// No stack.
    None,
}
