//! Velocity fields in scenarios: `poiseuille(max_speed_um_s: 1290)`.
//!
//! Names, parameters and defaults come from `flows::registry`; compositions contain other fields.

use std::path::Path;

use flows::VelocityField;
use flows::fields as f;
use flows::registry::{DepthRange, FieldParameters};
use flows::velocity_grid::{GridGeometry, VelocityGrid};
use schemars::{JsonSchema, Schema};
use serde::{Deserialize, Serialize};
use serde_json::Value;

use super::findings::{Collect, Findings};
use super::language::schema::joined;
use super::motion::{Motion, in_file};
use storage::error::{Error, Result};

macro_rules! field {
    ($($variant:ident($parameters:ident),)*) => {
        /// A velocity field and its parameters; formulas, ranges and meanings are those of `flows::registry`.
        #[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
        #[serde(rename_all = "snake_case")]
        #[schemars(transform = formulas)]
        pub enum Field {
            $(
                /// The field of this name in `flows::registry`.
                $variant(f::$parameters),
            )*
            /// Velocities on a regular grid, from a file.
            Gridded(Gridded),
            /// Sum of fields.
            Sum(Vec<Field>),
            /// A field scaled in velocity and length.
            Scaled(Changed<f::ScaledParams>),
            /// A translated field.
            Translated(Changed<f::TranslatedParams>),
            /// A field rotated about an axis.
            Rotated(Changed<f::RotatedParams>),
            /// A field that moves at constant velocity.
            Moving(Changed<f::MovingParams>),
            /// A field modulated in time.
            Modulated(Changed<f::ModulatedParams>),
            /// A field mirrored at a plane.
            Mirrored(Changed<f::MirroredParams>),
        }

        $(
            impl From<f::$parameters> for Motion {
                fn from(parameters: f::$parameters) -> Self {
                    Field::$variant(parameters).into()
                }
            }
        )*

        impl Field {
            /// Draws new seeds for all random fields, including nested ones.
            pub fn reseed(&mut self, draw: &mut impl FnMut() -> Result<u64>) -> Result<()> {
                match self {
                    $(Field::$variant(p) => p.seed().map_or(Ok(()), |seed| Ok(*seed = draw()?)),)*
                    Field::Gridded(_) => Ok(()),
                    Field::Sum(fields) => fields.iter_mut().try_for_each(|field| field.reseed(draw)),
                    Field::Scaled(Changed { field, .. })
                    | Field::Translated(Changed { field, .. })
                    | Field::Rotated(Changed { field, .. })
                    | Field::Moving(Changed { field, .. })
                    | Field::Modulated(Changed { field, .. })
                    | Field::Mirrored(Changed { field, .. }) => field.reseed(draw),
                }
            }

            /// Fills in defaults and builds the field whose key is at `path`; `files` reads and stores the
            /// files that it names.
            pub(super) fn build(
                &mut self,
                path: &str,
                depths: DepthRange,
                found: &mut Findings<'_>,
            ) -> Built {
                let path = joined(path, &self.name());
                match self {
                    $(Field::$variant(p) => {
                        p.fill_defaults(depths);
                        found.problems.of(&path, p.build())
                    })*
                    Field::Gridded(p) => p.build(&path, found),
                    Field::Sum(fields) => {
                        let parts = fields.iter_mut().enumerate();
                        let parts: Option<Vec<_>> = parts
                            .map(|(i, part)| part.build(&joined(&path, &i.to_string()), depths, found))
                            .collect();
                        found.problems.of(&path, f::Sum::new(parts?).map(|sum| Box::new(sum) as Box<dyn VelocityField>))
                    }
                    Field::Scaled(p) => p.build(&path, depths, found),
                    Field::Translated(p) => p.build(&path, depths, found),
                    Field::Rotated(p) => p.build(&path, depths, found),
                    Field::Moving(p) => p.build(&path, depths, found),
                    Field::Modulated(p) => p.build(&path, depths, found),
                    Field::Mirrored(p) => p.build(&path, depths, found),
                }
            }
        }
    };
}
flows::for_each_field!(field);

/// Uses the formula of each field as its description.
fn formulas(schema: &mut Schema) {
    let variants = schema.get_mut("oneOf").and_then(Value::as_array_mut);
    for variant in variants.into_iter().flatten().filter_map(Value::as_object_mut) {
        let name = variant.get("properties").and_then(Value::as_object).and_then(|one| one.keys().next());
        if let Some(entry) = name.and_then(|name| flows::registry::find(name)) {
            variant.insert("description".to_owned(), entry.formula.into());
        }
    }
}

/// Velocities on a regular grid, from a file: `.npy` (with its geometry given here), `.csv`, or VTK's `.vti`,
/// `.vtr` and legacy `.vtk`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Gridded {
    /// File with the velocities in um/s, relative to the scenario: `.npy` with an array of shape (z, y, x,
    /// 3) or (time, z, y, x, 3); `.csv` with the columns x_um, y_um, z_um, u_um_s, v_um_s, w_um_s and, for
    /// several times, t_s; or VTK's `.vti`, `.vtr` (with equal steps) and legacy `.vtk`. A position outside
    /// the grid has the velocity of the nearest point of the grid.
    #[schemars(example = &"velocities.npy")]
    pub file: String,
    /// Name of the array with the velocities in a file of VTK; needed if several arrays have three components.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub array: Option<String>,
    /// Interpolation between the nodes.
    #[serde(default = "tricubic")]
    pub interpolation: f::Interpolation,
    /// Whether the data are periodic along x, y and z.
    #[serde(default)]
    pub periodic: [bool; 3],
    /// Positions of the nodes, for a `.npy` file; the other formats contain them.
    #[serde(default)]
    pub geometry: GridGeometry,
}

fn tricubic() -> f::Interpolation {
    f::Interpolation::Tricubic
}

/// A field that is transformed as a whole.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Changed<P> {
    /// The field that is transformed.
    pub field: Box<Field>,
    /// How it is transformed.
    pub by: P,
}

type Built = Option<Box<dyn VelocityField>>;

impl<P: f::Transform> Changed<P> {
    fn build(&mut self, path: &str, depths: DepthRange, found: &mut Findings<'_>) -> Built {
        let inner = self.field.build(&joined(path, "field"), depths, found)?;
        found.problems.of(&joined(path, "by"), self.by.apply(inner))
    }
}

impl Field {
    /// Visits the field and all fields in it.
    pub fn visit(&self, visitor: &mut impl FnMut(&Field)) {
        visitor(self);
        match self {
            Field::Sum(fields) => fields.iter().for_each(|field| field.visit(visitor)),
            Field::Scaled(Changed { field, .. })
            | Field::Translated(Changed { field, .. })
            | Field::Rotated(Changed { field, .. })
            | Field::Moving(Changed { field, .. })
            | Field::Modulated(Changed { field, .. })
            | Field::Mirrored(Changed { field, .. }) => field.visit(visitor),
            _ => {}
        }
    }

    /// The name of the variant in scenarios.
    pub fn name(&self) -> String {
        let value = serde_json::to_value(self).unwrap_or_default();
        value.as_object().and_then(|one| one.keys().next().cloned()).unwrap_or_default()
    }
}

impl Gridded {
    fn build(&mut self, path: &str, found: &mut Findings<'_>) -> Built {
        let key = joined(path, "file");
        let (file, bytes) = found.read(&key, &self.file)?;
        let extension =
            Path::new(&self.file).extension().unwrap_or_default().to_string_lossy().to_lowercase();
        let is_vtk = ["vtk", "vti", "vtr"].contains(&extension.as_str());
        if let Some(array) = self.array.as_ref().filter(|_| !is_vtk) {
            found.problems.value(&joined(path, "array"), array, "no array of a file that is not of VTK");
            return None;
        }
        // The scenario in the dataset names the array.
        let array = self.array.take();
        let mut named = |(grid, name): (VelocityGrid, String)| {
            self.array = Some(name);
            grid
        };
        let grid = match extension.as_str() {
            "npy" => VelocityGrid::from_npy(&bytes[..], &self.geometry),
            "csv" => VelocityGrid::from_csv(&bytes[..]),
            "vtk" => VelocityGrid::from_vtk(&bytes[..], array.as_deref()).map(&mut named),
            "vti" | "vtr" => VelocityGrid::from_vtk_xml(&bytes[..], array.as_deref()).map(&mut named),
            other => {
                found.problems.value(
                    &key,
                    &self.file,
                    &format!("a .npy, .csv, .vtk, .vti or .vtr file, not `.{other}`"),
                );
                return None;
            }
        };
        let grid = grid.map_err(|e| Error::input(in_file(&file.display().to_string(), &e)));
        let grid = found.problems.of(&key, grid)?;
        let field = found.problems.of(path, f::Gridded::new(&grid, self.interpolation, self.periodic))?;
        self.file = found.keep(&key, &file, bytes);
        Some(Box::new(field))
    }
}
