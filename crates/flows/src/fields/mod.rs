//! The fields on offer, one family a file.
//!
//! To add one, read `tube.rs` (among the shortest) or `lamb_oseen.rs` (time-dependent, with an exact trajectory), and enter
//! it in the table of [`crate::registry`]: the conformance tests walk it.

mod abc;
mod acoustics;
mod burgers;
mod cells;
mod composition;
mod couette_poiseuille;
mod double_gyre;
mod drops;
mod duct;
mod electro_osmotic;
mod gridded;
mod hele_shaw;
mod hill;
mod kraichnan;
mod lamb_oseen;
mod linear;
mod parallel;
mod plates;
mod poiseuille;
mod rankine;
mod sinusoid;
mod source;
mod stokes;
mod tube;
mod womersley;

pub use abc::{Abc, AbcParams};
pub use acoustics::{Acoustophoresis, AcoustophoresisParams, RayleighStreaming, RayleighStreamingParams};
pub use burgers::{Burgers, BurgersParams};
pub use cells::{Cellular, CellularParams, TaylorGreen, TaylorGreenParams};
pub use composition::{
    Mirrored, MirroredParams, Modulated, ModulatedParams, Moving, MovingParams, Rotated, RotatedParams,
    Scaled, ScaledParams, Sum, Translated, TranslatedParams,
};
pub use couette_poiseuille::{CouettePoiseuille, CouettePoiseuilleParams};
pub use double_gyre::{DoubleGyre, DoubleGyreParams};
pub use drops::{CoffeeRing, CoffeeRingParams, ToroidalDrop, ToroidalDropParams};
pub use duct::{Duct, DuctParams};
pub use electro_osmotic::{ElectroOsmotic, ElectroOsmoticParams};
pub(crate) use gridded::sampled;
pub use gridded::{Gridded, Interpolation};
pub use hele_shaw::{HeleShaw, HeleShawParams};
pub use hill::{Hill, HillParams};
pub use kraichnan::{Kraichnan, KraichnanParams};
pub use lamb_oseen::{LambOseen, LambOseenParams};
pub(crate) use linear::exponential;
pub use linear::{
    DilatationParams, Linear, LinearParams, RotationParams, ShearParams, Strain, StrainParams, UniformParams,
};
pub use parallel::{BickleyJet, BickleyJetParams, TanhLayer, TanhLayerParams};
pub use poiseuille::{Poiseuille, PoiseuilleParams};
pub use rankine::{Rankine, RankineParams};
pub use sinusoid::{Sinusoid, SinusoidParams, Variation};
pub use source::{Source, SourceParams, SourceShape};
pub use stokes::{StokesCylinder, StokesCylinderParams, StokesSphere, StokesSphereParams};
pub use tube::{Tube, TubeParams};
pub use womersley::{CrossSection, Womersley, WomersleyParams};

/// Floor and ceiling of the default channel, um: where a field's walls are unless they are given.
const CHANNEL: [f64; 2] = [-80.0, 20.0];

/// The place in its middle, um: the default centre of fields without walls.
const MID_DEPTH: [f64; 3] = [0.0, 0.0, -30.0];

/// The place on its floor, um: the default centre of what stands there.
const ON_FLOOR: [f64; 3] = [0.0, 0.0, -80.0];

/// Factor on a bound of the speed that is sharp in exact arithmetic, so that rounding cannot make it too small.
const ROUNDING_MARGIN: f64 = 1.0 + 1e-12;

/// Longest way over a surface where the gradient jumps, as a share of its radius.
const JUMP_STEP: f64 = 0.02;
