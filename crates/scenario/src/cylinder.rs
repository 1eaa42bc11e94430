//! The keys of a cylindrical lens before the camera.

use microsig_core::render::waves;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// A cylindrical lens before the camera. Positions in the image and the growth of images out of focus scale
/// by the same factor in the direction of its power, 1 - `to_sensor_mm` / `focal_length_mm`; `x_px` of the
/// truth is where the camera sees a particle.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Cylinder {
    /// By its data sheet and place.
    Lens {
        /// Focal length; negative for a diverging lens.
        #[schemars(extend("x-range" = "0.01 to 1e7, or negative", "x-unit" = "mm"), example = 1000.0)]
        focal_length_mm: f64,
        /// Distance to the sensor.
        #[schemars(range(min = 0.01, max = 1e7), extend("x-unit" = "mm"), example = 40.0)]
        to_sensor_mm: f64,
    },
    /// By what it does, as measured with a calibration target.
    Planes {
        /// Physical depth at which images are narrowest along x minus that at which they are narrowest along
        /// y; negative for a converging lens.
        #[schemars(range(min = -1e5, max = 1e5), extend("x-unit" = "um"), example = -20.0)]
        apart_um: f64,
        /// Magnification along x over that along y: less than 1 for a converging lens.
        #[schemars(range(min = 0.2, max = 5.0), example = 0.96)]
        growth: f64,
    },
}

impl Cylinder {
    /// The lens behind an objective of this magnification; `index`: physical depth over depth in air. `None`
    /// if none has such planes and such growth.
    pub(super) fn lens(self, index: f64, magnification: f64) -> Option<waves::Cylinder> {
        match self {
            Cylinder::Lens { focal_length_mm, to_sensor_mm } => {
                Some(waves::Cylinder { focal_length_mm, to_sensor_mm })
            }
            Cylinder::Planes { apart_um, growth } => {
                waves::Cylinder::of_planes(apart_um / index, growth, magnification)
            }
        }
    }
}
