//! What moves the particles in a scenario: a velocity field and its placement, or recorded tracks.

use std::sync::Arc;

use flows::fields::{RotatedParams, Transform, TranslatedParams};
use flows::registry::DepthRange;
use flows::scale::Scale;
use flows::{Diameters, RecordedTracks, VelocityField};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use storage::dataset::{Row, TrackRow};

use super::field::Field;
use super::findings::{Collect, Findings};

/// The source of particle motion.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
#[expect(clippy::large_enum_variant, reason = "a scenario has one")]
pub enum Motion {
    /// A velocity field advects the particles.
    Flow(Flow),
    /// Particles follow recorded tracks.
    Tracks(Tracks),
    /// A velocity field of a program that uses the libraries; a scenario file cannot have it.
    #[serde(skip)]
    Own(OwnField),
}

impl Motion {
    /// Particles in a velocity field that is not built in.
    pub fn own(field: impl VelocityField + 'static) -> Self {
        Motion::Own(OwnField(Arc::new(field)))
    }
}

impl From<Field> for Motion {
    fn from(field: Field) -> Self {
        Motion::Flow(Flow { field, placement: None, walls: Walls::default() })
    }
}

/// A velocity field that is not built in. It equals its clones only.
#[derive(Debug, Clone)]
pub struct OwnField(pub(super) Arc<dyn VelocityField>);

impl PartialEq for OwnField {
    fn eq(&self, other: &Self) -> bool {
        Arc::ptr_eq(&self.0, &other.0)
    }
}

/// A velocity field and its placement.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Flow {
    /// The field, with its parameters; `microsig flows` lists and describes all fields.
    pub field: Field,
    /// Rotation of the field about an axis through a point, followed by a translation.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub placement: Option<FieldPlacement>,
    /// Whether walls slow the particles.
    #[serde(default, skip_serializing_if = "Walls::is_free")]
    #[schemars(extend("x-default" = "`free`"))]
    pub walls: Walls,
}

/// What walls do to particles: the walled faces of the box, the walls of the field, and bodies.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Walls {
    /// They stop particles, and slow none.
    #[default]
    Free,
    /// They also slow spheres within some radii: Brownian motion and settling by the mobility near a plane
    /// wall, and motion along the wall by the slip in a shear flow. Not available for spheroids.
    Hindered,
}

impl Walls {
    fn is_free(&self) -> bool {
        *self == Walls::Free
    }
}

/// Rotation of a field about an axis, followed by a translation.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default)]
pub struct FieldPlacement {
    /// Displacement of the field (x, y, z).
    pub offset_um: (f64, f64, f64),
    /// Direction of the axis of rotation (x, y, z).
    pub axis: (f64, f64, f64),
    /// Angle of rotation; a positive angle about z is clockwise on the screen.
    pub angle_rad: f64,
    /// A point on the axis (x, y, z), before the translation.
    #[schemars(extend("x-formerly" = ["centre_um"]))]
    pub center_um: (f64, f64, f64),
}

impl Default for FieldPlacement {
    fn default() -> Self {
        FieldPlacement {
            offset_um: (0.0, 0.0, 0.0),
            axis: (0.0, 0.0, 1.0),
            angle_rad: 0.0,
            center_um: (0.0, 0.0, 0.0),
        }
    }
}

/// Recorded tracks; `flows::tracks` describes the file.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Tracks {
    /// CSV file with the columns `frame`, `track` and `x_um, y_um, z_um` (or `x_px, y_px, z_um`), optionally
    /// `d_um`, `c_int`, `e_p`, `axis_x`, `axis_y`, `axis_z`, `u_um_s`, `v_um_s`, `w_um_s`; relative to the
    /// scenario.
    #[schemars(example = &"tracks.csv")]
    pub file: String,
}

/// The source of particle motion, validated.
#[derive(Debug)]
pub enum MotionSource {
    /// A velocity field.
    Field(Arc<dyn VelocityField>),
    /// Tracks.
    Tracks(RecordedTracks),
}

impl MotionSource {
    /// Smallest, mean and largest diameter of the particles, um: of `drawn`, unless rows of the tracks give it.
    pub(super) fn diameters_um(&self, drawn: &Diameters) -> [f64; 3] {
        let own = [drawn.min(), drawn.mean(), drawn.max()];
        let rows = match self {
            MotionSource::Tracks(tracks) if tracks.rows().iter().any(|row| row.d_um.is_some()) => {
                tracks.rows()
            }
            _ => return own,
        };
        let of = |k: usize| rows.iter().map(move |row| row.d_um.unwrap_or(own[k]));
        let mean = of(1).sum::<f64>() / rows.len() as f64;
        [of(0).fold(f64::INFINITY, f64::min), mean, of(2).fold(0.0, f64::max)]
    }
}

impl Flow {
    /// Fills in defaults and builds the placed field.
    pub(super) fn build(
        &mut self,
        z_um: (f64, f64),
        found: &mut Findings<'_>,
    ) -> Option<Box<dyn VelocityField>> {
        let depths = DepthRange { floor_um: z_um.0, ceiling_um: z_um.1 };
        let field = self.field.build("motion.flow.field", depths, found)?;
        let Some(p) = self.placement else { return Some(field) };
        let turn =
            RotatedParams { axis: p.axis.into(), angle_rad: p.angle_rad, center_um: p.center_um.into() };
        let shift = TranslatedParams { offset_um: p.offset_um.into() };
        let placed = turn.apply(field).and_then(|turned| shift.apply(turned));
        found.problems.of("motion.flow.placement", placed)
    }
}

impl Tracks {
    pub(super) fn build(&mut self, scale: &Scale, found: &mut Findings<'_>) -> Option<RecordedTracks> {
        const KEY: &str = "motion.tracks.file";
        let (path, bytes) = found.read(KEY, &self.file)?;
        let name = path.display().to_string();
        let tracks = match RecordedTracks::from_csv(&bytes[..], scale) {
            Ok(tracks) => tracks,
            Err(faults) => {
                faults.iter().for_each(|fault| found.problems.other(KEY, in_file(&name, fault)));
                return None;
            }
        };
        // The other columns of a dataset's own `truth/tracks.csv` are redundant and not worth a warning.
        let unknown = |c: &&String| !TrackRow::table(&[]).columns.iter().any(|own| own.name == c.as_str());
        let unused: Vec<&str> = tracks.unused_columns().iter().filter(unknown).map(String::as_str).collect();
        if !unused.is_empty() {
            found.warn(format!("{KEY}: {name}: unused columns: {}", unused.join(", ")));
        }
        self.file = found.keep(KEY, &path, bytes);
        Some(tracks)
    }
}

/// The message of an error, preceded by the file name and, if known, the line.
pub(super) fn in_file(name: &str, fault: &flows::Error) -> String {
    match fault {
        flows::Error::Data { line: Some(line), problem, .. } => format!("{name}:{line}: {problem}"),
        other => format!("{name}: {other}"),
    }
}
