//! What moves the particles, as scenarios write it: a velocity field in its place, or recorded tracks.

use flows::fields::{Rotated, RotatedParams, Translated, TranslatedParams};
use flows::scale::Scale;
use flows::{Tracks as RecordedTracks, VelocityField};
use serde::{Deserialize, Serialize};

use super::field::Field;
use super::files::Files;
use super::problems::Problems;
use crate::dataset::truth::TRACKS;

/// What moves the particles.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Motion {
    /// A velocity field.
    Flow(Flow),
    /// Tracks from a file.
    Tracks(Tracks),
}

/// A velocity field in its place.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Flow {
    /// The field.
    pub field: Field,
    /// Where it is put, and how it is turned.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub placement: Option<FieldPlacement>,
}

/// A field turned about its own origin, which is then moved.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct FieldPlacement {
    /// How far it is moved, um.
    pub offset_um: (f64, f64, f64),
    /// Axis that it is turned about.
    pub axis: (f64, f64, f64),
    /// Angle that it is turned by, rad; about z clockwise on the screen.
    pub angle_rad: f64,
    /// A point of the axis, um, before the field is moved.
    pub centre_um: (f64, f64, f64),
}

impl Default for FieldPlacement {
    fn default() -> Self {
        FieldPlacement {
            offset_um: (0.0, 0.0, 0.0),
            axis: (0.0, 0.0, 1.0),
            angle_rad: 0.0,
            centre_um: (0.0, 0.0, 0.0),
        }
    }
}

/// Recorded tracks; `flows::tracks` says what the file holds.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Tracks {
    /// The file, relative to the scenario.
    pub file: String,
}

/// What moves the particles, checked.
#[derive(Debug)]
pub enum Mover {
    /// A velocity field.
    Field(Box<dyn VelocityField>),
    /// Tracks.
    Tracks(RecordedTracks),
}

impl Flow {
    /// Fills defaults and builds the field.
    pub(super) fn build(
        &mut self,
        z_um: (f64, f64),
        files: &mut Files<'_>,
        problems: &mut Problems,
    ) -> Option<Box<dyn VelocityField>> {
        let field = self.field.build(z_um, files, problems)?;
        let Some(p) = self.placement else { return Some(field) };
        let turn =
            RotatedParams { axis: p.axis.into(), angle_rad: p.angle_rad, centre_um: p.centre_um.into() };
        let placed = Rotated::new(field, &turn).and_then(|turned| {
            Translated::new(Box::new(turned), &TranslatedParams { offset_um: p.offset_um.into() })
        });
        problems.of("motion.flow.placement", placed).map(|field| Box::new(field) as Box<dyn VelocityField>)
    }
}

impl Tracks {
    /// Reads the file.
    pub(super) fn build(
        &mut self,
        scale: &Scale,
        files: &mut Files<'_>,
        warnings: &mut Vec<String>,
        problems: &mut Problems,
    ) -> Option<RecordedTracks> {
        const KEY: &str = "motion.tracks.file";
        let (path, bytes) = files.read(KEY, &self.file, problems)?;
        let name = path.display().to_string();
        let tracks = match RecordedTracks::from_csv(&bytes[..], scale) {
            Ok(tracks) => tracks,
            Err(faults) => {
                for fault in faults {
                    problems.of::<()>(KEY, Err(in_file(&name, &fault)));
                }
                return None;
            }
        };
        // The other columns of a dataset's own table say nothing new.
        let unknown = |c: &&String| !TRACKS.columns.iter().any(|own| own.name == c.as_str());
        let unused: Vec<&str> = tracks.unused_columns().iter().filter(unknown).map(String::as_str).collect();
        if !unused.is_empty() {
            warnings.push(format!("{KEY}: {name}: columns that mean nothing here: {}", unused.join(", ")));
        }
        self.file = files.keep(&path, bytes);
        Some(tracks)
    }
}

/// A fault of a file's line, with both in front.
fn in_file(name: &str, fault: &flows::Error) -> String {
    match fault {
        flows::Error::Data { line: Some(line), found, expected, .. } => {
            format!("{name}:{line}: {found}: expected {expected}")
        }
        other => format!("{name}: {other}"),
    }
}
