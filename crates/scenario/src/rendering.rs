//! The renderer of a scenario and its options.

use clap::ValueEnum;
use microsig_core::emission::SpheroidLaw;
use microsig_core::render::expected::{DEFAULT_TOLERANCE, TOLERANCES};
use microsig_core::render::waves;
use microsig_core::sensor;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// How particle images are rendered.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default)]
pub struct Render {
    /// The renderer.
    pub mode: RenderMode,
    /// Distribution of the source points over a spheroid's surface.
    pub spheroids: SpheroidPoints,
    /// For `waves`: wavelength in vacuum, the center of the detected band.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(range(min = 0.1, max = 2.0), example = 0.52)]
    pub wavelength_um: Option<f64>,
    /// For `waves`: full width of the (Gaussian) band at half maximum, at most 0.3 wavelengths; 0 is
    /// monochromatic light.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(
        range(min = 0.0, max = 0.6),
        extend("x-default" = "0 if `mode` is `waves`"),
        example = 0.03
    )]
    pub bandwidth_um: Option<f64>,
    /// For `waves`: the part of a particle that emits light.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(extend("x-default" = "surface if `mode` is `waves`"))]
    pub emission: Option<Emission>,
    /// For `expected`: root-mean-square error of an image as a fraction of its peak; for `waves`: the largest
    /// error.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(
        range(min = *TOLERANCES.start(), max = *TOLERANCES.end()),
        extend("x-default" = format!("{DEFAULT_TOLERANCE} if `mode` is `expected` or `waves`")),
        example = DEFAULT_TOLERANCE
    )]
    pub tolerance: Option<f64>,
}

/// Distribution of the source points over a spheroid's surface.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema, ValueEnum)]
#[serde(rename_all = "snake_case")]
pub enum SpheroidPoints {
    /// As in MicroSIG's program: denser toward the poles.
    #[default]
    Original,
    /// Uniform in area, as the paper describes it.
    Uniform,
}

impl From<SpheroidPoints> for SpheroidLaw {
    fn from(points: SpheroidPoints) -> Self {
        match points {
            SpheroidPoints::Original => SpheroidLaw::Original,
            SpheroidPoints::Uniform => SpheroidLaw::Uniform,
        }
    }
}

/// What the pixels of an image file hold.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema, ValueEnum)]
#[serde(rename_all = "snake_case")]
pub enum ImageFormat {
    /// Whole counts of 16 bit, or of 8 bit for a sensor of 8 bit, clamped to the sensor's range.
    #[default]
    Integer,
    /// 32-bit floating-point numbers: counts before they are rounded and clamped to the range of the sensor,
    /// which keeps light below half a count. Noise is included, if there is any.
    Float32,
}

impl From<ImageFormat> for sensor::ImageFormat {
    fn from(format: ImageFormat) -> Self {
        match format {
            ImageFormat::Integer => sensor::ImageFormat::Integer,
            ImageFormat::Float32 => sensor::ImageFormat::Float32,
        }
    }
}

/// The part of a particle that emits light.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema, ValueEnum)]
#[serde(rename_all = "snake_case")]
pub enum Emission {
    /// The half of its surface that faces the lens, as in MicroSIG.
    #[default]
    Surface,
    /// Its entire volume: a transparent particle, dyed throughout.
    Volume,
}

impl From<Emission> for waves::Emission {
    fn from(emission: Emission) -> Self {
        match emission {
            Emission::Surface => waves::Emission::Surface,
            Emission::Volume => waves::Emission::Volume,
        }
    }
}

/// A renderer.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema, ValueEnum)]
#[serde(rename_all = "snake_case")]
pub enum RenderMode {
    /// Discrete rays, counted per pixel: the method of the paper.
    #[default]
    Rays,
    /// The limit of infinitely many rays, without ray noise; for shot noise add `sensor: (shot_noise: true)`.
    Expected,
    /// Diffraction at the lens (scalar wave optics; spheres only), without ray noise; needs `wavelength_um`.
    Waves,
}
