//! Velocity fields as scenarios write them: `poiseuille(max_speed_um_s: 1290)`.
//!
//! Names, parameters and defaults are those of `flows::registry`; compositions hold further fields.

use std::path::Path;

use flows::VelocityField;
use flows::fields as f;
use flows::grid::{Geometry, Grid};
use serde::{Deserialize, Serialize};

use super::resolve::{Files, Problems};

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
    Poiseuille(Poiseuille),
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

/// Plane Poiseuille flow, whose walls are those of the depth range unless they are given.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct Poiseuille {
    /// Speed half-way between the walls, um/s.
    pub max_speed_um_s: f64,
    /// Floor and ceiling, um.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub walls_z_um: Option<(f64, f64)>,
    /// Direction of the flow in the image plane, from x toward y, rad.
    pub direction_rad: f64,
}

impl Default for Poiseuille {
    fn default() -> Self {
        // 1290 um/s move a particle by 10 px in 5 ms under setting 1.
        Poiseuille { max_speed_um_s: 1290.0, walls_z_um: None, direction_rad: 0.0 }
    }
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
        match self {
            Field::Uniform(p) => plain!(f::Linear::from_uniform(p)),
            Field::Shear(p) => plain!(f::Linear::from_shear(p)),
            Field::Rotation(p) => plain!(f::Linear::from_rotation(p)),
            Field::Strain(p) => plain!(f::Linear::from_strain(p)),
            Field::Dilatation(p) => plain!(f::Linear::from_dilatation(p)),
            Field::Linear(p) => plain!(f::Linear::from_params(p)),
            Field::Poiseuille(p) => {
                let (floor, ceiling) = *p.walls_z_um.get_or_insert(z_um);
                plain!(f::Poiseuille::new(p.max_speed_um_s, floor, ceiling, p.direction_rad))
            }
            Field::CouettePoiseuille(p) => plain!(f::CouettePoiseuille::new(p)),
            Field::Duct(p) => plain!(f::Duct::new(p)),
            Field::Tube(p) => plain!(f::Tube::new(p)),
            Field::Womersley(p) => plain!(f::Womersley::new(p)),
            Field::ElectroOsmotic(p) => plain!(f::ElectroOsmotic::new(p)),
            Field::HeleShaw(p) => plain!(f::HeleShaw::new(p)),
            Field::Rankine(p) => plain!(f::Rankine::new(p)),
            Field::LambOseen(p) => plain!(f::LambOseen::from_params(p)),
            Field::Burgers(p) => plain!(f::Burgers::new(p)),
            Field::TaylorGreen(p) => plain!(f::TaylorGreen::new(p)),
            Field::Cellular(p) => plain!(f::Cellular::new(p)),
            Field::DoubleGyre(p) => plain!(f::DoubleGyre::new(p)),
            Field::Abc(p) => plain!(f::Abc::new(p)),
            Field::Hill(p) => plain!(f::Hill::new(p)),
            Field::Sinusoid(p) => plain!(f::Sinusoid::new(p)),
            Field::TanhLayer(p) => plain!(f::TanhLayer::new(p)),
            Field::BickleyJet(p) => plain!(f::BickleyJet::new(p)),
            Field::Source(p) => plain!(f::Source::new(p)),
            Field::StokesSphere(p) => plain!(f::StokesSphere::new(p)),
            Field::StokesCylinder(p) => plain!(f::StokesCylinder::new(p)),
            Field::ToroidalDrop(p) => plain!(f::ToroidalDrop::new(p)),
            Field::CoffeeRing(p) => plain!(f::CoffeeRing::new(p)),
            Field::RayleighStreaming(p) => plain!(f::RayleighStreaming::new(p)),
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
