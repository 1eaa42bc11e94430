//! Velocity fields as scenarios write them: `poiseuille(max_speed_um_s: 1290)`.
//!
//! Names, parameters and defaults are those of `flows::registry`; compositions hold further fields.

use std::path::Path;

use flows::VelocityField;
use flows::fields as f;
use flows::grid::{Geometry, Grid};
use serde::{Deserialize, Serialize};

use super::files::Files;
use super::problems::Problems;
use crate::error::Result;

/// Path of the field in a scenario.
const PATH: &str = "motion.flow.field";

/// A velocity field and its parameters.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
#[allow(missing_docs, reason = "`microsig flows` and flows::registry describe every one of them")]
pub enum Field {
    Uniform(f::UniformParams),
    Shear(f::ShearParams),
    Rotation(f::RotationParams),
    Strain(f::StrainParams),
    Dilatation(f::DilatationParams),
    Linear(f::LinearParams),
    Poiseuille(f::PoiseuilleParams),
    CouettePoiseuille(f::CouettePoiseuilleParams),
    Duct(f::DuctParams),
    Tube(f::TubeParams),
    Womersley(f::WomersleyParams),
    ElectroOsmotic(f::ElectroOsmoticParams),
    HeleShaw(f::HeleShawParams),
    Rankine(f::RankineParams),
    LambOseen(f::LambOseenParams),
    Burgers(f::BurgersParams),
    TaylorGreen(f::TaylorGreenParams),
    Cellular(f::CellularParams),
    DoubleGyre(f::DoubleGyreParams),
    Abc(f::AbcParams),
    Hill(f::HillParams),
    Sinusoid(f::SinusoidParams),
    TanhLayer(f::TanhLayerParams),
    BickleyJet(f::BickleyJetParams),
    Source(f::SourceParams),
    StokesSphere(f::StokesSphereParams),
    StokesCylinder(f::StokesCylinderParams),
    ToroidalDrop(f::ToroidalDropParams),
    CoffeeRing(f::CoffeeRingParams),
    RayleighStreaming(f::RayleighStreamingParams),
    Acoustophoresis(f::AcoustophoresisParams),
    Kraichnan(f::KraichnanParams),
    Gridded(Gridded),
    Sum(Vec<Field>),
    Scaled(Changed<f::ScaledParams>),
    Translated(Changed<f::TranslatedParams>),
    Rotated(Changed<f::RotatedParams>),
    Moving(Changed<f::MovingParams>),
    Modulated(Changed<f::ModulatedParams>),
    Mirrored(Changed<f::MirroredParams>),
}

/// Velocities on a regular grid, from a file: `.npy` (with its geometry given here), `.csv` or legacy `.vtk`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Gridded {
    /// The file, relative to the scenario.
    pub file: String,
    /// What is between the nodes.
    #[serde(default = "tricubic")]
    pub interpolation: f::Interpolation,
    /// Whether the data repeat along x, y and z.
    #[serde(default)]
    pub periodic: [bool; 3],
    /// Where the nodes of a `.npy` file are.
    #[serde(default)]
    pub geometry: Geometry,
}

fn tricubic() -> f::Interpolation {
    f::Interpolation::Tricubic
}

/// A field that is changed as a whole.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Changed<P> {
    /// The field.
    pub field: Box<Field>,
    /// How it is changed.
    pub by: P,
}

impl Field {
    /// Gives the parts that are drawn at random new seeds.
    ///
    /// # Errors
    /// What `draw` says.
    pub fn reseed(&mut self, draw: &mut impl FnMut() -> Result<u64>) -> Result<()> {
        match self {
            Field::Kraichnan(p) => p.seed = draw()?,
            Field::Sum(fields) => fields.iter_mut().try_for_each(|field| field.reseed(draw))?,
            Field::Scaled(Changed { field, .. }) => field.reseed(draw)?,
            Field::Translated(Changed { field, .. }) => field.reseed(draw)?,
            Field::Rotated(Changed { field, .. }) => field.reseed(draw)?,
            Field::Moving(Changed { field, .. }) => field.reseed(draw)?,
            Field::Modulated(Changed { field, .. }) => field.reseed(draw)?,
            Field::Mirrored(Changed { field, .. }) => field.reseed(draw)?,
            _ => {}
        }
        Ok(())
    }
}

type Built = Option<Box<dyn VelocityField>>;

impl Field {
    /// Fills defaults and builds the field; files it names are found and kept by `files`.
    pub(super) fn build(
        &mut self,
        z_um: (f64, f64),
        files: &mut Files<'_>,
        problems: &mut Problems,
    ) -> Built {
        macro_rules! plain {
            ($field:expr) => {
                problems.of(PATH, $field).map(|field| Box::new(field) as Box<dyn VelocityField>)
            };
        }
        macro_rules! changed {
            ($kind:ident, $changed:expr) => {{
                let inner = $changed.field.build(z_um, files, problems)?;
                plain!(f::$kind::new(inner, &$changed.by))
            }};
        }
        let (floor, ceiling) = z_um;
        let walls = [floor, ceiling];
        let (mid_depth, on_floor) = ([0.0, 0.0, 0.5 * (floor + ceiling)], [0.0, 0.0, floor]);
        // What is not given follows the depth range.
        macro_rules! within {
            ($kind:ident::$make:ident, $p:ident, $($key:ident: $default:expr),+) => {{
                $( $p.$key.get_or_insert($default); )+
                plain!(f::$kind::$make($p))
            }};
        }
        match self {
            Field::Uniform(p) => plain!(f::Linear::from_uniform(p)),
            Field::Shear(p) => within!(Linear::from_shear, p, centre_um: on_floor),
            Field::Rotation(p) => within!(Linear::from_rotation, p, centre_um: mid_depth),
            Field::Strain(p) => within!(Linear::from_strain, p, centre_um: mid_depth),
            Field::Dilatation(p) => within!(Linear::from_dilatation, p, centre_um: mid_depth),
            Field::Linear(p) => within!(Linear::from_params, p, centre_um: mid_depth),
            Field::Poiseuille(p) => within!(Poiseuille::from_params, p, walls_z_um: walls),
            Field::CouettePoiseuille(p) => within!(CouettePoiseuille::new, p, walls_z_um: walls),
            Field::Duct(p) => within!(Duct::new, p, walls_z_um: walls),
            Field::Tube(p) => {
                let (axis, radius) = ([0.0, mid_depth[2]], 0.5 * (ceiling - floor));
                within!(Tube::new, p, centre_yz_um: axis, radius_um: radius)
            }
            Field::Womersley(p) => within!(Womersley::new, p, walls_z_um: walls),
            Field::ElectroOsmotic(p) => within!(ElectroOsmotic::new, p, walls_z_um: walls),
            Field::HeleShaw(p) => within!(HeleShaw::new, p, walls_z_um: walls),
            Field::Rankine(p) => plain!(f::Rankine::new(p)),
            Field::LambOseen(p) => plain!(f::LambOseen::from_params(p)),
            Field::Burgers(p) => within!(Burgers::new, p, centre_um: mid_depth),
            Field::TaylorGreen(p) => plain!(f::TaylorGreen::new(p)),
            Field::Cellular(p) => plain!(f::Cellular::new(p)),
            Field::DoubleGyre(p) => plain!(f::DoubleGyre::new(p)),
            Field::Abc(p) => within!(Abc::new, p, centre_um: mid_depth),
            Field::Hill(p) => within!(Hill::new, p, centre_um: mid_depth),
            Field::Sinusoid(p) => plain!(f::Sinusoid::new(p)),
            Field::TanhLayer(p) => plain!(f::TanhLayer::new(p)),
            Field::BickleyJet(p) => plain!(f::BickleyJet::new(p)),
            Field::Source(p) => within!(Source::new, p, centre_um: mid_depth, walls_z_um: walls),
            Field::StokesSphere(p) => within!(StokesSphere::new, p, centre_um: mid_depth),
            Field::StokesCylinder(p) => plain!(f::StokesCylinder::new(p)),
            Field::ToroidalDrop(p) => within!(ToroidalDrop::new, p, centre_um: on_floor),
            Field::CoffeeRing(p) => within!(CoffeeRing::new, p, centre_um: on_floor),
            Field::RayleighStreaming(p) => within!(RayleighStreaming::new, p, walls_z_um: walls),
            Field::Acoustophoresis(p) => plain!(f::Acoustophoresis::new(p)),
            Field::Kraichnan(p) => plain!(f::Kraichnan::new(p)),
            Field::Gridded(p) => p.build(files, problems),
            Field::Sum(fields) => {
                let parts: Option<Vec<_>> =
                    fields.iter_mut().map(|p| p.build(z_um, files, problems)).collect();
                plain!(f::Sum::new(parts?))
            }
            Field::Scaled(p) => changed!(Scaled, p),
            Field::Translated(p) => changed!(Translated, p),
            Field::Rotated(p) => changed!(Rotated, p),
            Field::Moving(p) => changed!(Moving, p),
            Field::Modulated(p) => changed!(Modulated, p),
            Field::Mirrored(p) => changed!(Mirrored, p),
        }
    }
}

impl Gridded {
    fn build(&mut self, files: &mut Files<'_>, problems: &mut Problems) -> Built {
        let key = format!("{PATH}.gridded.file");
        let (path, bytes) = files.read(&key, &self.file, problems)?;
        let extension =
            Path::new(&self.file).extension().unwrap_or_default().to_string_lossy().to_lowercase();
        let grid = match extension.as_str() {
            "npy" => Grid::from_npy(&bytes[..], &self.geometry),
            "csv" => Grid::from_csv(&bytes[..]),
            "vtk" => Grid::from_vtk(&bytes[..]),
            other => {
                problems.add(&key, &self.file, &format!("a .npy, .csv or .vtk file, not `.{other}`"));
                return None;
            }
        };
        let grid = problems.of(&format!("{key}: {}", path.display()), grid)?;
        let field = problems.of(PATH, f::Gridded::new(&grid, self.interpolation, self.periodic))?;
        self.file = files.keep(&path, bytes);
        Some(Box::new(field))
    }
}
