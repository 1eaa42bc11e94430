use microsig_core::render::waves;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// A cylindrical lens in front of the camera. In the direction of its power, it scales image positions and
/// the growth of defocused images by 1 - `to_sensor_mm` / `focal_length_mm`; `x_px` and `y_px` of the truth
/// include this factor.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Cylinder {
    /// Given by focal length and position, as in its data sheet and the setup.
    Lens {
        /// Focal length; negative for a diverging lens.
        #[schemars(extend("x-condition" = "0.01 to 1e7, or negative", "x-unit" = "mm"), example = 1000.0)]
        focal_length_mm: f64,
        /// Distance from the lens to the sensor.
        #[schemars(range(min = 0.01, max = 1e7), extend("x-unit" = "mm"), example = 40.0)]
        to_sensor_mm: f64,
    },
    /// Given by its effect on the images, as measured with a calibration target.
    Planes {
        /// Distance of the two focal planes: the physical depth at which images are narrowest along x minus
        /// the depth at which they are narrowest along y; negative for a converging lens.
        #[schemars(range(min = -1e5, max = 1e5), extend("x-unit" = "um"), example = -20.0)]
        apart_um: f64,
        /// Ratio of the magnifications along x and y; less than 1 for a converging lens.
        #[schemars(range(min = 0.2, max = 5.0), example = 0.96)]
        growth: f64,
    },
}

impl Cylinder {
    /// The lens behind an objective of this magnification; `index`: physical depth over depth in air. `None`
    /// if no lens has these focal planes and this growth.
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
