use flows::Illumination as Light;
use flows::illumination::{Profile, Shape};
use glam::DVec3;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::language::problems::Problems;

/// Illumination that varies in space and from pulse to pulse; `flows::illumination` documents the formulas.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default)]
pub struct Illumination {
    /// Spatial distribution of the light.
    pub shape: LightShape,
    /// Relative gradient of the light along x, y and z; the ramp is 1 at the center of the image.
    pub ramp_per_um: (f64, f64, f64),
    /// Relative pulse energies of the frames of a recording, repeated cyclically.
    #[schemars(length(min = 1, max = 10_000_000), inner(range(min = 0.0, max = 1e6)))]
    pub pulse_energies: Vec<f64>,
    /// Relative standard deviation of the pulse energies.
    #[schemars(range(min = 0.0, max = 0.3))]
    pub energy_jitter: f64,
    /// Photobleaching: time in which the brightness of the particles decays to 1/e.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(extend("exclusiveMinimum" = 0), example = 2.0)]
    pub bleaching_s: Option<f64>,
}

/// Spatial distribution of the light.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum LightShape {
    /// The same everywhere.
    #[default]
    Uniform,
    /// A light sheet.
    Sheet(Sheet),
    /// A Gaussian beam.
    Beam(Beam),
}

/// A light sheet.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default)]
pub struct Sheet {
    /// Intensity profile across the sheet.
    pub profile: Profile,
    /// Thickness T: distance between the two e^-2 points, or between the edges of a top hat.
    #[schemars(extend("exclusiveMinimum" = 0))]
    pub thickness_um: f64,
    /// A point in its middle plane (x, y, z).
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(extend("x-default" = "the middle of the depth range", "x-formerly" = ["centre_um"]))]
    pub center_um: Option<(f64, f64, f64)>,
    /// Normal of the sheet (x, y, z).
    pub normal: (f64, f64, f64),
}

impl Default for Sheet {
    fn default() -> Self {
        Sheet { profile: Profile::Gaussian, thickness_um: 20.0, center_um: None, normal: (0.0, 0.0, 1.0) }
    }
}

/// A Gaussian beam.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default)]
pub struct Beam {
    /// Center of the beam waist (x, y, z).
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(extend(
        "x-default" = "on the optical axis in the middle of the depth range",
        "x-formerly" = ["centre_um"]
    ))]
    pub center_um: Option<(f64, f64, f64)>,
    /// Direction of the beam (x, y, z).
    pub axis: (f64, f64, f64),
    /// e^-2 radius of the beam waist.
    #[schemars(extend("exclusiveMinimum" = 0))]
    pub waist_um: f64,
    /// Rayleigh length: distance from the waist at which the cross-section has doubled.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(extend("exclusiveMinimum" = 0, "x-default" = "a collimated beam"), example = 5000.0)]
    pub rayleigh_um: Option<f64>,
}

impl Default for Beam {
    fn default() -> Self {
        Beam { center_um: None, axis: (0.0, 0.0, 1.0), waist_um: 200.0, rayleigh_um: None }
    }
}

impl Default for Illumination {
    fn default() -> Self {
        Illumination {
            shape: LightShape::Uniform,
            ramp_per_um: (0.0, 0.0, 0.0),
            pulse_energies: vec![1.0],
            energy_jitter: 0.0,
            bleaching_s: None,
        }
    }
}

impl Illumination {
    /// Fills in defaults, then checks and builds the illumination.
    pub(super) fn build(&mut self, z_um: (f64, f64), problems: &mut Problems) -> Option<Light> {
        let middle = (0.0, 0.0, 0.5 * (z_um.0 + z_um.1));
        let shape = match &mut self.shape {
            LightShape::Uniform => Ok(Shape::Uniform),
            LightShape::Sheet(s) => {
                let center = DVec3::from(*s.center_um.get_or_insert(middle));
                Shape::sheet(s.profile, center, DVec3::from(s.normal), s.thickness_um)
            }
            LightShape::Beam(b) => {
                let center = DVec3::from(*b.center_um.get_or_insert(middle));
                let rayleigh = b.rayleigh_um.unwrap_or(f64::INFINITY);
                Shape::beam(center, DVec3::from(b.axis), b.waist_um, rayleigh)
            }
        };
        let light = shape.and_then(|shape| {
            Light::new(shape)
                .with_ramp(DVec3::from(self.ramp_per_um))?
                .with_pulses(self.pulse_energies.clone(), self.energy_jitter)?
                .with_bleaching(self.bleaching_s.unwrap_or(f64::INFINITY))
        });
        problems.of("illumination", light)
    }
}
