//! `datapackage.json`: a Frictionless data package, and under `microsig` what users of the images must know.
//!
//! The types are read and written alike. A key that is missing when read is `None` or its type's default, so
//! that manifests of earlier versions and of test splits, which tell less, are read too.

mod seal;
mod write;

use std::path::Path;

use serde::{Deserialize, Deserializer, Serialize};
use serde_json::{Map, Value};

use storage::error::{Error, Result};
use storage::read_text;
pub use write::{N_S, SNR, manifest};
pub(crate) use write::{bit_depth, waves, write};
pub use write::{license, resource};

/// Name of the file.
pub const MANIFEST: &str = "datapackage.json";

/// Version of the generator: it changes when the bytes of datasets do.
pub const GENERATOR_VERSION: &str = storage::VERSION;

/// Version of the layout of a dataset.
pub const LAYOUT_VERSION: u32 = 1;

/// The coordinates, in words.
pub const COORDINATES: &str = "x_px and y_px are image coordinates: the centre of the top-left pixel is (1, 1), x grows to \
the right along columns, y downward along rows; pixel k covers [k - 0.5, k + 0.5). z_um is the physical depth in um, zero in \
the paraxial object plane, growing away from the lens. x_um and y_um are object-space coordinates from the middle of the \
image, in the directions of x_px and y_px. Frames count from 0.";

/// A manifest.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct Manifest {
    /// Frictionless profile, `data-package`.
    pub profile: String,
    /// Name of the dataset.
    pub name: String,
    /// Title, one line.
    pub title: String,
    /// Description, may have several lines.
    pub description: String,
    /// Version of the data package.
    pub version: String,
    /// Licenses, one.
    pub licenses: Vec<LicenseEntry>,
    /// What users of the images must know.
    pub microsig: Facts,
    /// The files; a manifest in the making has none.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub resources: Vec<Resource>,
}

/// A license.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct LicenseEntry {
    /// SPDX identifier.
    pub name: String,
    /// Name.
    #[serde(default)]
    pub title: String,
    /// Where its text is.
    #[serde(default)]
    pub path: String,
}

/// What users of the images must know. Test splits leave out what was counted or measured in the truth.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct Facts {
    /// Name of the program, `microsig`.
    #[serde(skip_serializing_if = "String::is_empty")]
    pub generator: String,
    /// Its version.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub generator_version: Option<String>,
    /// [`LAYOUT_VERSION`].
    #[serde(skip_serializing_if = "Option::is_none")]
    pub layout_version: Option<u32>,
    /// The seed; `Some(None)` (null) with a secret key.
    #[serde(skip_serializing_if = "Option::is_none", deserialize_with = "present")]
    pub seed: Option<Option<u64>>,
    /// How random numbers are addressed, in words.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub random_streams: Option<String>,
    /// When frames are taken.
    pub timing: TimingFacts,
    /// Object-space length of a pixel, um.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub um_per_px: Option<f64>,
    /// Physical depth over depth in MicroSIG's data files.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub depth_factor: Option<f64>,
    /// The camera.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub sensor: Option<SensorFacts>,
    /// Name of the renderer.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub renderer: Option<String>,
    /// Light and objective of images by wave optics.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub waves: Option<WaveFacts>,
    /// Lower and upper end of the depth range, um.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub depth_range_um: Option<[f64; 2]>,
    /// Its length, um.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub depth_range_h_um: Option<f64>,
    /// [`COORDINATES`].
    #[serde(skip_serializing_if = "Option::is_none")]
    pub coordinates: Option<String>,
    /// Visible particles per frame, mean over frames.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub n_p: Option<f64>,
    /// Visible particles per pixel.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub n_ppp: Option<f64>,
    /// Source density.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub n_s: Option<f64>,
    /// Area of a particle image, px.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub a_pi_px: Option<f64>,
    /// [`N_S`].
    #[serde(skip_serializing_if = "Option::is_none")]
    pub concentration_definition: Option<String>,
    /// Signal-to-noise ratio.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub snr: Option<SnrFacts>,
    /// The image of a single particle.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub particle_image: Option<ParticleImageFacts>,
    /// The flow and its formulas.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub motion: Option<MotionFacts>,
    /// The grid of `truth/field.csv`; `Some(None)` (null) without one.
    #[serde(skip_serializing_if = "Option::is_none", deserialize_with = "present")]
    pub truth_grid: Option<Option<TruthGridFacts>>,
    /// Largest displacement of a visible particle in the image plane, px.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub max_displacement_px: Option<f64>,
    /// Gates for scoring.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub scoring_gates: Option<ScoringGates>,
    /// `test` in the public part of a test split.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub split: Option<String>,
    /// `withheld` where the truth is.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub truth: Option<String>,
    /// What a test split scores: `particles`, and `fields` unless the train split tells the velocity field.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub scored: Option<Vec<String>>,
    /// Digest of all images of a test split.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub images_sha256: Option<String>,
    /// SHA-256 of salt and truth of a test split.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub commitment_sha256: Option<String>,
}

/// When frames are taken: the keys of the scenario's timing, `mode`, `frames` and, of pair recordings,
/// `pairs`.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(transparent)]
pub struct TimingFacts(pub Map<String, Value>);

impl TimingFacts {
    /// `pairs`, `sequence` or `four_pulse`.
    pub fn mode(&self) -> &str {
        self.0.get("mode").and_then(Value::as_str).unwrap_or_default()
    }

    /// Number of frames.
    pub fn frames(&self) -> Option<u32> {
        self.number("frames")
    }

    /// Number of pairs of a pair recording.
    pub fn pairs(&self) -> Option<u32> {
        self.number("pairs")
    }

    fn number(&self, key: &str) -> Option<u32> {
        self.0.get(key)?.as_u64()?.try_into().ok()
    }

    /// Interval between linked frames, s.
    pub fn dt_s(&self) -> Option<f64> {
        self.0.get("dt_s")?.as_f64()
    }

    /// Whether frames 2k and 2k + 1 are a pair of their own.
    pub fn are_pairs(&self) -> bool {
        self.mode() == "pairs"
    }

    /// Whether frames come in bursts of four.
    pub fn are_bursts(&self) -> bool {
        self.mode() == "four_pulse"
    }
}

/// The camera.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct SensorFacts {
    /// Columns.
    pub width_px: u32,
    /// Rows.
    pub height_px: u32,
    /// Bits of a count.
    pub bit_depth: u8,
    /// MicroSIG's gain, counts per ray.
    pub gain: f64,
    /// Mean background of MicroSIG's own sensor, counts.
    pub background_mean_counts: f64,
    /// Background noise of MicroSIG's own sensor, counts.
    pub background_noise_counts: f64,
    /// Whether counts are rounded once, after noise is added; MicroSIG's program rounds the noise first.
    pub rounded_once: bool,
    /// The camera's chain as the scenario has it; null for MicroSIG's own sensor.
    pub detector: Value,
}

/// Signal-to-noise ratio.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct SnrFacts {
    /// Median over depth; `None` without noise.
    pub value: Option<f64>,
    /// [`SNR`].
    pub definition: String,
    /// Standard deviation of the background, counts.
    pub background_noise_counts: f64,
    /// MicroSIG's gain, counts per ray.
    pub gain: f64,
    /// Rays per source point.
    pub n_rays: u32,
}

/// Light and objective of images by wave optics.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct WaveFacts {
    /// Wavelength in vacuum, um.
    pub wavelength_um: f64,
    /// Full width of the band at half maximum, um.
    pub bandwidth_um: f64,
    /// Where light leaves a particle: `surface` or `volume`.
    pub emission: String,
    /// Model of the objective: `microsig` or `aplanatic`.
    pub lens: String,
    /// Radius of the Airy disc, px: 0.61 wavelength M / (NA pixel).
    pub airy_radius_px: f64,
    /// Mask and aberrations of the pupil as in the scenario; null for an open pupil without aberrations.
    pub pupil: Value,
    /// Medium, cover slip and immersion as in the scenario; null where they are as the objective was designed
    /// for.
    pub layers: Value,
    /// Largest error of an image as a share of its peak.
    pub tolerance: f64,
}

/// The image of a single particle.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct ParticleImageFacts {
    /// Diameter of the particle, um.
    #[serde(default)]
    pub d_um: f64,
    /// Depth of the highest peak, um; `None` where all depths are in focus.
    pub focus_um: Option<f64>,
}

/// The flow and its formulas.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct MotionFacts {
    /// As in the scenario.
    pub scenario: Value,
    /// Formula and source of every field in it, by name.
    pub formulas: Map<String, Value>,
}

/// The grid of `truth/field.csv`.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct TruthGridFacts {
    /// Depths of the planes, um.
    pub planes_um: Vec<f64>,
    /// Columns of nodes.
    pub columns: usize,
    /// Rows of nodes.
    pub rows: usize,
    /// Weights of depths, in words.
    pub weighting: String,
    /// Side of the window of averages, px.
    pub window_px: Option<f64>,
    /// Definitions of displacement, in words.
    pub definition: String,
}

/// Gates for scoring.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct ScoringGates {
    /// In the image plane, px.
    pub xy_px: f64,
    /// In depth, um.
    pub z_um: f64,
    /// Of the ISBI scores, px.
    pub isbi_px: f64,
}

impl ScoringGates {
    /// Gate in the image plane, px.
    pub const XY_PX: f64 = 2.0;
    /// Gate of the ISBI scores, px.
    pub const ISBI_PX: f64 = 5.0;

    /// The gates of a depth range of length `h_um`: a tenth of it in depth.
    pub fn over(h_um: f64) -> Self {
        ScoringGates { xy_px: Self::XY_PX, z_um: h_um / 10.0, isbi_px: Self::ISBI_PX }
    }
}

/// A file of a dataset.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Resource {
    /// Name, lower case without slashes.
    #[serde(default)]
    pub name: String,
    /// Path in the dataset.
    pub path: String,
    /// Extension.
    #[serde(default)]
    pub format: String,
    /// Media type.
    #[serde(default)]
    pub mediatype: String,
    /// Size, bytes.
    pub bytes: u64,
    /// `sha256:` and 64 hexadecimal digits.
    pub hash: String,
    /// `tabular-data-resource` of a table.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub profile: Option<String>,
    /// Encoding of a table.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub encoding: Option<String>,
    /// What a row of a table is.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub description: Option<String>,
    /// Columns of a table.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub schema: Option<TableSchema>,
    /// Number of an image's frame.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub frame: Option<u32>,
    /// Width of an image.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub width_px: Option<u32>,
    /// Height of an image.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub height_px: Option<u32>,
    /// Bits of a count of an image.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub bit_depth: Option<u8>,
    /// Visible particles of an image.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub n_visible: Option<u64>,
}

impl Resource {
    /// SHA-256 in hexadecimal.
    pub fn sha256(&self) -> &str {
        self.hash.trim_start_matches("sha256:")
    }
}

/// The columns of a table.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct TableSchema {
    /// The columns, in order.
    pub fields: Vec<SchemaField>,
    /// Cells that are missing values.
    #[serde(rename = "missingValues", default)]
    pub missing_values: Vec<String>,
}

/// A column.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct SchemaField {
    /// Name.
    pub name: String,
    /// `integer`, `number` or `string`.
    #[serde(rename = "type")]
    pub kind: String,
    /// Unit; empty if there is none.
    #[serde(default)]
    pub unit: String,
    /// What it holds.
    #[serde(default)]
    pub description: String,
}

impl Manifest {
    /// Reads the manifest of a dataset.
    ///
    /// # Errors
    /// A file that is missing or is not a manifest.
    pub fn read(dataset: &Path) -> Result<Self> {
        let path = dataset.join(MANIFEST);
        Manifest::parse(&read_text(&path)?, &path.display().to_string())
    }

    /// Reads a manifest's text; `name` is the file's name in messages.
    ///
    /// # Errors
    /// A text that is not a manifest, with line and column.
    pub fn parse(text: &str, name: &str) -> Result<Self> {
        serde_json::from_str(text).map_err(|e| Error::input(format!("{name}: {e}")))
    }

    /// The file of a path in the dataset.
    pub fn resource(&self, path: &str) -> Option<&Resource> {
        self.resources.iter().find(|resource| resource.path == path)
    }
}

/// Tells a key that is null from one that is missing.
fn present<'de, T: Deserialize<'de>, D: Deserializer<'de>>(
    value: D,
) -> std::result::Result<Option<Option<T>>, D::Error> {
    Option::deserialize(value).map(Some)
}
