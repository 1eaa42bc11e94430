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
    EveryUm(#[schemars(extend("exclusiveMinimum" = 0, "maximum" = 1e6, "x-unit" = "um"), example = 1.0)] f64),
    /// One stack for each given diameter.
    Sizes {
        /// Particle diameters of the stacks, without duplicates.
        #[schemars(length(min = 1, max = 16), extend("x-unit" = "um", "exclusiveMinimum" = 0, "maximum" = 1e6), example = vec![2.0, 5.0])]
        diameters_um: Vec<f64>,
        /// Step in depth.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        #[schemars(extend("exclusiveMinimum" = 0, "maximum" = 1e6, "x-unit" = "um", "x-default" = "as for `stack`"))]
        every_um: Option<f64>,
    },
    /// Stacks at several places of the field of view, the centers of equal rectangles, for optics whose images
    /// vary over the field.
    Field {
        /// Number of places along each side of the image.
        #[schemars(range(min = 1, max = 9), example = 3)]
        places: u32,
        /// Particle diameters of the stacks, without duplicates.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        #[schemars(length(min = 1, max = 16), extend("x-unit" = "um", "exclusiveMinimum" = 0, "maximum" = 1e6, "x-default" = "as for `stack`"))]
        diameters_um: Option<Vec<f64>>,
        /// Step in depth.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        #[schemars(extend("exclusiveMinimum" = 0, "maximum" = 1e6, "x-unit" = "um", "x-default" = "as for `stack`"))]
        every_um: Option<f64>,
    },
    /// No stack.
    None,
}

impl Calibration {
    /// The given step in depth, um.
    pub fn given_step_um(&self) -> Option<f64> {
        match self {
            Calibration::EveryUm(step_um) => Some(*step_um),
            Calibration::Sizes { every_um, .. } | Calibration::Field { every_um, .. } => *every_um,
            Calibration::Stack | Calibration::None => None,
        }
    }

    /// The given particle diameters, um.
    pub fn given_diameters_um(&self) -> Option<&[f64]> {
        match self {
            Calibration::Sizes { diameters_um, .. } => Some(diameters_um),
            Calibration::Field { diameters_um, .. } => diameters_um.as_deref(),
            Calibration::Stack | Calibration::EveryUm(_) | Calibration::None => None,
        }
    }

    /// Number of places of stacks along each side of the image; 1 without a field of them.
    pub fn places(&self) -> u32 {
        if let Calibration::Field { places, .. } = self { *places } else { 1 }
    }
}
