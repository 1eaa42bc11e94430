//! The built-in velocity fields, one family per file.
//!
//! To add one, take `tube.rs` (short) or `lamb_oseen.rs` (time-dependent, with closed-form trajectories) as a
//! model, and enter it in [`for_each_field!`](crate::for_each_field) below: scenarios, documentation and
//! conformance tests iterate over that list.

mod abc;
mod acoustics;
mod burgers;
mod cells;
pub(crate) mod composition;
mod couette_poiseuille;
mod double_gyre;
mod drops;
mod duct;
mod electro_osmotic;
pub(crate) mod gridded;
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
mod speed;
mod stokes;
mod tube;
mod womersley;

pub use abc::{Abc, AbcParams};
pub use acoustics::{Acoustophoresis, AcoustophoresisParams, RayleighStreaming, RayleighStreamingParams};
pub use burgers::{Burgers, BurgersParams};
pub use cells::{Cellular, CellularParams, TaylorGreen, TaylorGreenParams};
pub use composition::{
    MirroredParams, ModulatedParams, MovingParams, RotatedParams, ScaledParams, Sum, Transform,
    TranslatedParams,
};
pub use couette_poiseuille::{CouettePoiseuille, CouettePoiseuilleParams};
pub use double_gyre::{DoubleGyre, DoubleGyreParams};
pub use drops::{CoffeeRing, CoffeeRingParams, ToroidalDrop, ToroidalDropParams};
pub use duct::{Duct, DuctParams};
pub use electro_osmotic::{ElectroOsmotic, ElectroOsmoticParams};
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

/// Calls a macro with all fields that have a formula of their own: the name of each (snake_case in scenarios)
/// and its parameters, which implement [`FieldParameters`](crate::entry::FieldParameters).
#[macro_export]
macro_rules! for_each_field {
    ($callback:ident) => {
        $callback! {
            Uniform(UniformParams),
            Shear(ShearParams),
            Rotation(RotationParams),
            Strain(StrainParams),
            Dilatation(DilatationParams),
            Linear(LinearParams),
            Poiseuille(PoiseuilleParams),
            CouettePoiseuille(CouettePoiseuilleParams),
            Duct(DuctParams),
            Tube(TubeParams),
            Womersley(WomersleyParams),
            ElectroOsmotic(ElectroOsmoticParams),
            HeleShaw(HeleShawParams),
            Rankine(RankineParams),
            LambOseen(LambOseenParams),
            Burgers(BurgersParams),
            TaylorGreen(TaylorGreenParams),
            Cellular(CellularParams),
            DoubleGyre(DoubleGyreParams),
            Abc(AbcParams),
            Hill(HillParams),
            Sinusoid(SinusoidParams),
            TanhLayer(TanhLayerParams),
            BickleyJet(BickleyJetParams),
            Source(SourceParams),
            StokesSphere(StokesSphereParams),
            StokesCylinder(StokesCylinderParams),
            ToroidalDrop(ToroidalDropParams),
            CoffeeRing(CoffeeRingParams),
            RayleighStreaming(RayleighStreamingParams),
            Acoustophoresis(AcoustophoresisParams),
            Kraichnan(KraichnanParams),
        }
    };
}

/// What the files of the fields have in common.
pub(in crate::fields) mod prelude {
    pub(in crate::fields) use super::{
        CHANNEL, JUMP_STEP, MID_DEPTH, ON_FLOOR, ROUNDING_MARGIN, entry, facts, field,
    };
    pub(in crate::fields) use crate::dual::{Formula, Real, by_formula};
    pub(in crate::fields) use crate::entry::{DepthRange, FieldEntry, FieldParameters, PlotPlane};
    pub(in crate::fields) use crate::error::{ParameterCheck, Result};
    pub(in crate::fields) use crate::field::VelocityField;
    pub(in crate::fields) use crate::params::params;
    pub(in crate::fields) use crate::region::{Axis, Region};
    pub(in crate::fields) use crate::wall::Wall;
    pub(in crate::fields) use glam::{DMat3, DVec2, DVec3};
    pub(in crate::fields) use std::f64::consts::PI;
}

/// A field that is its parameters, checked, and its constructor.
macro_rules! field {
    (#[doc = $doc:literal] $field:ident($parameters:ident)) => {
        #[doc = $doc]
        #[derive(Debug, Clone, PartialEq)]
        pub struct $field($parameters);

        impl $field {
            /// The field of these parameters; `Err` if one is out of range.
            pub fn new(params: &$parameters) -> Result<Self> {
                params.checked().map($field)
            }
        }
    };
}
use field;

/// The entry of a field in the registry and its construction: parameters, constructor, plane of its plot; formula;
/// source; variants; parameters that are derived from the depth range unless they are given, or functions of the trait.
macro_rules! entry {
    (
        $parameters:ident => $new:path, $plane:ident;
        $formula:literal;
        $source:literal;
        $([$($variant:tt)*];)?
        $($derived:ident: $from:ident;)*
        $({ $($function:tt)* })?
    ) => {
        impl FieldParameters for $parameters {
            const ENTRY: FieldEntry = FieldEntry {
                name: Self::CHECK.0,
                formula: $formula,
                parameters: Self::PARAMETERS,
                source: $source,
                plane: PlotPlane::$plane,
                make: || Self::default().build(),
                variants: &[$($($variant)*)?],
            };

            fn build(&self) -> Result<Box<dyn VelocityField>> {
                Ok(Box::new($new(self)?))
            }

            entry!(@fill_defaults $($derived: $from)*);
            $($($function)*)?
        }
    };
    (@fill_defaults) => {};
    (@fill_defaults $($derived:ident: $from:ident)+) => {
        fn fill_defaults(&mut self, depths: DepthRange) {
            $(self.$derived.get_or_insert(depths.$from());)+
        }
    };
}
use entry;

/// Properties of a velocity field: `divergence_free`, `steady`, `straight` (its trajectories are straight lines at constant
/// speed), `walls_same_along` (followed by whether they are along x, y and z).
macro_rules! facts {
    (@ divergence_free) => {
        fn is_divergence_free(&self) -> bool {
            true
        }
    };
    (@ steady) => {
        fn is_steady(&self) -> bool {
            true
        }
    };
    (@ walls_same_along($x:literal, $y:literal, $z:literal)) => {
        fn walls_same_along(&self) -> [bool; 3] {
            [$x, $y, $z]
        }
    };
    (@ straight) => {
        fn flow_map(&self, x: DVec3, t0: f64, t1: f64) -> Option<DVec3> {
            Some(x + self.velocity(x, t0) * (t1 - t0))
        }
    };
    ($($fact:ident $(($($value:literal),+))?),+) => {
        $(facts!(@ $fact $(($($value),+))?);)+
    };
}
use facts;

/// Floor and ceiling of the default channel, um: the default walls of a field.
const CHANNEL: [f64; 2] = [-80.0, 20.0];

/// The center of the default channel, um: the default center of fields without walls.
const MID_DEPTH: [f64; 3] = [0.0, 0.0, -30.0];

/// The center of its floor, um: the default center of flows attached to the floor.
const ON_FLOOR: [f64; 3] = [0.0, 0.0, -80.0];

/// Factor for speed bounds that are sharp in exact arithmetic, so that rounding cannot make them too small.
const ROUNDING_MARGIN: f64 = 1.0 + 1e-12;

/// Longest step across a surface where the gradient is discontinuous, as a fraction of its radius.
const JUMP_STEP: f64 = 0.02;

#[cfg(test)]
mod tests {
    use super::*;
    use crate::entry::FieldParameters;

    #[test]
    fn a_parameter_out_of_its_declared_range_is_refused() {
        macro_rules! assert_refused {
            ($($parameters:ident { $key:ident: $value:expr }: $message:literal,)*) => {$(
                let built = $parameters { $key: $value, ..Default::default() }.build();
                assert_eq!(built.map(drop).unwrap_err().to_string(), $message);
            )*};
        }
        assert_refused! {
            AbcParams { center_um: Some([f64::NAN, 1.0, 2.0]) }: "abc: center_um = [NaN, 1.0, 2.0]: expected finite numbers",
            AbcParams { wavelength_um: -1.0 }: "abc: wavelength_um = -1: expected a finite number > 0",
            AcoustophoresisParams { half_waves: 0 }: "acoustophoresis: half_waves = 0: expected a finite number >= 1",
            BickleyJetParams { half_width_um: 0.0 }: "bickley_jet: half_width_um = 0: expected a finite number > 0",
            BurgersParams { strain_rate_per_s: 0.0 }: "burgers: strain_rate_per_s = 0: expected a finite number > 0",
            CoffeeRingParams { drying_time_s: 0.0 }: "coffee_ring: drying_time_s = 0: expected a finite number > 0",
            HillParams { radius_um: 0.0 }: "hill: radius_um = 0: expected a finite number > 0",
            KraichnanParams { modes: 0 }: "kraichnan: modes = 0: expected a number from 1 to 1e5",
            SinusoidParams { wavelength_um: f64::NAN }: "sinusoid: wavelength_um = NaN: expected a finite number > 0",
            SourceParams { core_radius_um: 0.0 }: "source: core_radius_um = 0: expected a finite number > 0",
            TanhLayerParams { thickness_um: -1.0 }: "tanh_layer: thickness_um = -1: expected a finite number > 0",
            ToroidalDropParams { height_um: -1.0 }: "toroidal_drop: height_um = -1: expected a finite number > 0",
            TubeParams { radius_um: Some(-1.0) }: "tube: radius_um = -1: expected a finite number > 0",
            WomersleyParams { frequency_hz: 0.0 }: "womersley: frequency_hz = 0: expected a finite number > 0",
        }
    }
}
