//! The model of the objective in wave-optics scenarios. Pupil and layers are those of `microsig-core`.

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

impl From<Lens> for waves::Lens {
    fn from(lens: Lens) -> Self {
        match lens {
            Lens::Microsig => waves::Lens::Microsig,
            Lens::Aplanatic => waves::Lens::Aplanatic,
        }
    }
}
