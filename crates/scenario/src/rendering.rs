//! The renderer of a scenario and its options.

use microsig_core::emission::SpheroidLaw;
use microsig_core::render::expected::{DEFAULT_TOLERANCE, TOLERANCES};
use microsig_core::render::waves::Emission;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// How particle images are rendered.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default)]
pub struct Render {
    /// The renderer.
    pub mode: RenderMode,
    /// For `rays` and `expected`: distribution of the source points over the surface of a spheroid. `waves`
    /// renders spheroids only with `lens: aplanatic`, with the uniform emission that `emission` selects.
    pub spheroids: SpheroidLaw,
    /// For `waves`: vacuum wavelength at the center of the detected band.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(range(min = 0.1, max = 2.0), example = 0.52)]
    pub wavelength_um: Option<f64>,
    /// For `waves`: full width of the (Gaussian) band at half maximum, at most 0.3 wavelengths; 0 for
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
    /// Error of an image as a fraction of its peak: the RMS error for `expected`, the largest error for
    /// `waves`.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(
        range(min = *TOLERANCES.start(), max = *TOLERANCES.end()),
        extend("x-default" = format!("{DEFAULT_TOLERANCE} if `mode` is `expected` or `waves`")),
        example = DEFAULT_TOLERANCE
    )]
    pub tolerance: Option<f64>,
    /// How each noise-free image, of `expected` and `waves`, is computed.
    #[serde(skip_serializing_if = "Images::is_tables")]
    #[schemars(extend("x-default" = "`tables`"))]
    pub images: Images,
}

/// How noise-free images are computed.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Images {
    /// From tables over depth and size, verified to meet the tolerance: for many images by the same optics.
    #[default]
    Tables,
    /// Each for itself at its own depth, without verification: for training streams in which optics or sizes vary.
    Single,
}

impl Images {
    fn is_tables(&self) -> bool {
        *self == Images::Tables
    }
}

/// A renderer.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum RenderMode {
    /// Discrete rays, counted per pixel: the method of MicroSIG (Rossi 2020).
    #[default]
    Rays,
    /// The limit of infinitely many rays, without ray noise; for shot noise add `sensor: (shot_noise: true)`.
    Expected,
    /// Diffraction at the lens (scalar wave optics; spheroids with `lens: aplanatic` only), without ray
    /// noise; needs `wavelength_um`.
    Waves,
}
