//! The keys of the calibration stacks, and their checks.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::language::problems::Problems;
use super::resolved::Scenario;
use super::spec::Spec;

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

/// Maximum number of images in a calibration stack.
const MAX_IMAGES: f64 = 100_000.0;

/// Checks steps and sizes of the calibration stacks.
pub(super) fn check(spec: &Spec, (low, high): (f64, f64), problems: &mut Problems) {
    let (path, step_um) = match &spec.calibration {
        Some(Calibration::EveryUm(step_um)) => ("calibration.every_um", Some(*step_um)),
        Some(Calibration::Sizes { diameters_um, every_um }) => {
            for (k, d_um) in diameters_um.iter().enumerate() {
                let path = format!("calibration.sizes.diameters_um.{k}");
                if !(*d_um > 0.0 && *d_um <= 1e6) {
                    problems.value(&path, d_um, "a number > 0 and <= 1e6");
                } else if diameters_um[..k].contains(d_um) {
                    problems.value(&path, d_um, "each diameter once");
                }
            }
            ("calibration.sizes.every_um", *every_um)
        }
        _ => return,
    };
    if let Some(step_um) = step_um.filter(|step_um| (high - low) / step_um > MAX_IMAGES) {
        let least = (high - low) / MAX_IMAGES;
        problems.value(path, step_um, &format!("at least {least}: a stack has at most {MAX_IMAGES} images"));
    }
}

/// A warning where the images of one calibration stack stand for particles of several sizes.
pub(super) fn few_stacks(scenario: &Scenario) -> Option<String> {
    let (stacks, sizes) = (scenario.calibrated_um(), scenario.representative_um());
    let ([d_um], [smallest, .., largest]) = (stacks.as_slice(), sizes.as_slice()) else { return None };
    Some(format!(
        "calibration: one stack of a particle of {d_um} um stands for particles of {smallest} to {largest} um, whose images \
         differ in size and brightness; `calibration: stack` makes one for each size"
    ))
}
