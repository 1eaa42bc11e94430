//! The objective in wave-optics scenarios: lens model, pupil mask and aberrations, layers in front of the
//! lens.

use clap::ValueEnum;
use microsig_core::render::waves;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// The model of the objective, for `mode: waves`.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema, ValueEnum)]
#[serde(rename_all = "snake_case")]
pub enum Lens {
    /// MicroSIG's thin lens with its spherical aberration; dry.
    #[default]
    Microsig,
    /// An objective corrected for the plane in focus (Abbe's sine condition), as microscope objectives are.
    Aplanatic,
}

/// The pupil of the objective, in units of its radius; x to the right and y down as in the image.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default)]
pub struct Pupil {
    /// The open part of the pupil; the rest blocks light.
    pub mask: Mask,
    /// Aberrations: Noll's index (2 to 66) and the coefficient, waves rms at `wavelength_um`; 6 is
    /// astigmatism along x and y, 11 spherical aberration.
    #[schemars(extend("x-unit" = "waves"), example = [(6, 0.1), (11, -0.05)])]
    pub zernike: Vec<(u32, f64)>,
}

/// The open part of the pupil.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Mask {
    /// All of it.
    #[default]
    Open,
    /// A ring.
    Annulus {
        /// Inner radius, in units of the pupil's radius.
        #[schemars(extend("x-range" = ">= 0 and < 1"), example = 0.5)]
        inner: f64,
    },
    /// Discs inside the pupil that do not overlap, as in a plate with pinholes.
    Pinholes(#[schemars(length(min = 1), example = [Pinhole { x: 0.0, y: 0.6, r: 0.2 }])] Vec<Pinhole>),
}

/// An open disc, in units of the pupil's radius.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default)]
pub struct Pinhole {
    /// Center, to the right.
    #[schemars(range(min = -1.0, max = 1.0))]
    pub x: f64,
    /// Center, down.
    #[schemars(range(min = -1.0, max = 1.0))]
    pub y: f64,
    /// Radius.
    #[schemars(extend("x-range" = "> 0 and <= 1"))]
    pub r: f64,
}

impl Default for Pinhole {
    /// A pinhole in the middle of the pupil.
    fn default() -> Self {
        Pinhole { x: 0.0, y: 0.0, r: 0.2 }
    }
}

/// The layers between a particle and the objective, and those that the objective was designed for (Gibson and
/// Lanni 1991). Depths are physical: `depth_factor` is 1.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default)]
pub struct Layers {
    /// Refractive index of the medium around the particles.
    #[schemars(range(min = 1.0, max = 4.0))]
    pub n_s: f64,
    /// Refractive index of the cover slip.
    #[schemars(range(min = 1.0, max = 4.0))]
    pub n_g: f64,
    /// Thickness of the cover slip.
    #[schemars(range(min = 0.0, max = 1e6))]
    pub t_g_um: f64,
    /// Refractive index of the cover slip that the objective was designed for.
    #[schemars(range(min = 1.0, max = 4.0))]
    pub n_g_design: f64,
    /// Thickness of the cover slip that the objective was designed for; 0: none.
    #[schemars(range(min = 0.0, max = 1e6))]
    pub t_g_design_um: f64,
    /// Refractive index of the immersion; 1: a dry objective.
    #[schemars(range(min = 1.0, max = 4.0))]
    pub n_i: f64,
    /// Refractive index of the immersion that the objective was designed for.
    #[schemars(range(min = 1.0, max = 4.0))]
    pub n_i_design: f64,
    /// Working distance of the objective.
    #[schemars(range(min = 0.0, max = 1e6))]
    pub t_i_design_um: f64,
    /// Depth of the plane z = 0, which is in paraxial focus, below the inner face of the cover slip.
    #[schemars(range(min = 0.0, max = 1e6))]
    pub focus_depth_um: f64,
}

impl Default for Layers {
    /// Water below a 0.17 mm cover slip, for which the dry objective was designed; the focus is 100 um deep.
    fn default() -> Self {
        Layers {
            n_s: 1.33,
            n_g: 1.515,
            t_g_um: 170.0,
            n_g_design: 1.515,
            t_g_design_um: 170.0,
            n_i: 1.0,
            n_i_design: 1.0,
            t_i_design_um: 1000.0,
            focus_depth_um: 100.0,
        }
    }
}

impl From<Lens> for waves::Lens {
    fn from(lens: Lens) -> Self {
        match lens {
            Lens::Microsig => waves::Lens::Microsig,
            Lens::Aplanatic => waves::Lens::Aplanatic,
        }
    }
}

impl From<&Pupil> for waves::PupilFunction {
    fn from(pupil: &Pupil) -> Self {
        let mask = match &pupil.mask {
            Mask::Open => waves::Mask::Open,
            Mask::Annulus { inner } => waves::Mask::Annulus { inner: *inner },
            Mask::Pinholes(holes) => waves::Mask::Pinholes(
                holes.iter().map(|&Pinhole { x, y, r }| waves::Pinhole { x, y, r }).collect(),
            ),
        };
        waves::PupilFunction { mask, zernike: pupil.zernike.clone() }
    }
}

impl From<Layers> for waves::Layers {
    fn from(layers: Layers) -> Self {
        let Layers {
            n_s,
            n_g,
            t_g_um,
            n_g_design,
            t_g_design_um,
            n_i,
            n_i_design,
            t_i_design_um,
            focus_depth_um,
        } = layers;
        waves::Layers {
            n_s,
            n_g,
            t_g_um,
            n_g_design,
            t_g_design_um,
            n_i,
            n_i_design,
            t_i_design_um,
            focus_depth_um,
        }
    }
}
