//! Contents of results: particles or displacement fields.

use super::Conventions;

/// A position in the image and in depth.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Position {
    /// Horizontal position, px; the first pixel's center is 1.
    pub x_px: f64,
    /// Vertical position, downward, px; the first pixel's center is 1.
    pub y_px: f64,
    /// Depth, um; 0 in data without depth.
    pub z_um: f64,
}

/// A particle in one frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TrackRow {
    /// Frame, from 0.
    pub frame: u32,
    /// Track, or -1 if not linked.
    pub track: i64,
    /// Position.
    pub at: Position,
}

/// A table of particles.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Points {
    /// The rows with complete coordinates.
    pub rows: Vec<TrackRow>,
    /// Line in the file for every row; empty for formats without lines, such as XML.
    pub lines: Vec<u32>,
    /// Claimed standard uncertainties of every row along x, y (px) and z (um), NaN if missing; empty if the
    /// file has none.
    pub sigma: Vec<[f64; 3]>,
    /// Velocities, if the file has any.
    pub velocities: Option<Velocities>,
    /// Box of every row, centered at its position; empty if the file has none.
    pub boxes: Vec<BoxSize>,
    /// Symmetry axis of every row (x right, y down, z away from the lens; any length), NaN if missing; empty
    /// if the file has none.
    pub axes: Vec<[f64; 3]>,
    /// Diameter of every row, um, NaN if missing; empty if the file has none.
    pub diameters_um: Vec<f64>,
    /// Whether the file has z.
    pub has_z: bool,
    /// Number of rows dropped because a coordinate is missing or NaN.
    pub n_nan: usize,
    /// How the reader interpreted the file.
    pub notes: Vec<String>,
    /// The conventions by which it was converted; the default: the dataset's.
    pub read_as: Box<Conventions>,
}

impl Points {
    /// Whether depths are measured: a depth of 0 in every row is none.
    pub fn has_depth(&self) -> bool {
        self.has_z && (self.rows.is_empty() || self.rows.iter().any(|row| row.at.z_um != 0.0))
    }
}

/// The box of a detection.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BoxSize {
    /// Width, px.
    pub w_px: f64,
    /// Height, px.
    pub h_px: f64,
    /// Confidence; detections are ranked by it.
    pub score: f64,
}

/// Velocities reported by a file, y downward.
#[derive(Debug, Clone, PartialEq)]
pub struct Velocities {
    /// Their unit.
    pub unit: VelocityUnit,
    /// Components of every row along x, y, z; NaN if missing.
    pub rows: Vec<[f64; 3]>,
}

/// Unit of velocities.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum VelocityUnit {
    /// um/s.
    UmPerS,
    /// px per frame along x and y, um per frame along z.
    PerFrame,
}

/// A vector of a displacement field.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct FlowVector {
    /// Image pair; `None` if not given in the file.
    pub pair: Option<u32>,
    /// Position; z is 0 if not given in the file.
    pub at: Position,
    /// Displacement along x, y (px) and z (um, NaN if not measured).
    pub moved: [f64; 3],
    /// 0 valid, 1 invalid, 2 interpolated.
    pub flag: u8,
    /// Claimed standard uncertainties along x and y, px; NaN if missing.
    pub sigma: [f64; 2],
}

/// How positions with y upward are reversed.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum Reversal {
    /// Within the image: the centers of the first and last pixel are exchanged.
    #[default]
    Image,
    /// As the size of the image minus the position.
    Size,
    /// Within the grid of vectors.
    Grid,
}

/// How the positions of a field were placed in the image.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Placement {
    /// Added to positions in the file, px.
    pub shift_px: [f64; 2],
    /// The shift that was asked for, px.
    pub asked_px: [f64; 2],
    /// How `y` upward is reversed.
    pub reversal: Reversal,
    /// Whether it was.
    pub is_y_up: bool,
    /// Whether the file states its units.
    pub is_stated: bool,
    /// Whether its displacements are per unit of time.
    pub is_per_s: bool,
    /// Whether its positions are lengths.
    pub is_calibrated: bool,
}

impl Placement {
    /// The sum of a position and its reversed one along an axis on which the image has this size.
    pub(crate) fn reversed_px(&self, axis: usize, size_px: f64) -> f64 {
        match self.reversal {
            Reversal::Image | Reversal::Grid => size_px + 1.0,
            Reversal::Size => size_px + 2.0 * self.shift_px[axis],
        }
    }

    /// The sum of y and reversed y; `None` for an image of unknown height or without vectors.
    pub(crate) fn sum_px(&self, vectors: &[FlowVector], height_px: Option<f64>) -> Option<f64> {
        if self.reversal != Reversal::Grid {
            return height_px.map(|height| self.reversed_px(1, height));
        }
        let y = || vectors.iter().map(|v| v.at.y_px);
        Some(y().fold(f64::INFINITY, f64::min) + y().fold(f64::NEG_INFINITY, f64::max))
    }
}

/// A displacement field.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Field {
    /// The vectors; displacements of invalid ones may be NaN.
    pub vectors: Vec<FlowVector>,
    /// Line in the file for every vector; empty if the reader does not record it.
    pub lines: Vec<u32>,
    /// Number of rows dropped because a position is missing.
    pub n_nan: usize,
    /// How the reader interpreted the file.
    pub notes: Vec<String>,
    /// How positions were placed in the image.
    pub placement: Placement,
    /// Doubts about how it was read.
    pub warnings: Vec<String>,
}

/// Contents of a result.
#[derive(Debug, Clone, PartialEq)]
pub enum TrackerResult {
    /// Particles.
    Points(Points),
    /// A displacement field.
    Field(Field),
}
