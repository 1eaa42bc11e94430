//! `datapackage.json`: a Frictionless data package; `microsig` in it has the facts that users of the images
//! need.
//!
//! The types are used for reading and writing. A missing key is read as `None` or as its type's default, so
//! that manifests of earlier versions and of test splits, which have fewer keys, can be read.

mod resource;
mod rules;
mod seal;

use std::path::Path;

use serde::{Deserialize, Deserializer, Serialize};
use serde_json::{Map, Value};

use crate::{Error, Result, read_text};
use microsig_core::emission::SpheroidLaw;
use microsig_core::optics::FieldOptics;
use microsig_core::render::WaveOptics;
use microsig_core::render::waves::{Cylinder, Emission, Layers, Lens, PupilFunction};
use microsig_core::sensor::ImageFormat;

pub use resource::{Resource, SchemaField, TableSchema, resource};
pub use rules::{Metric, ScoringRules, SuitePlace};
pub use seal::seal;

/// Name of the manifest file.
pub const MANIFEST: &str = "datapackage.json";

/// Version of the generator; it changes whenever the bytes of datasets change.
pub const GENERATOR_VERSION: &str = env!("CARGO_PKG_VERSION");

/// Version of the layout of a dataset.
pub const LAYOUT_VERSION: u32 = 1;

/// What a result holds.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ResultKind {
    /// Particles or tracks.
    Particles,
    /// Displacement fields.
    Fields,
}

/// Description of the coordinates; `zero` completes "z_um is zero ...".
pub fn coordinates(zero: &str) -> String {
    format!(
        "x_px and y_px are image coordinates: the centre of the top-left pixel is (1, 1), x grows to the right along columns, y \
         downward along rows; pixel k covers [k - 0.5, k + 0.5). z_um is the physical depth in um, zero {zero}, growing away from \
         the lens. x_um and y_um are object-space coordinates from the middle of the image, in the directions of x_px and y_px. \
         Frames count from 0."
    )
}

/// Where `z_um` of generated datasets is zero.
pub const ZERO_OF_DATASETS: &str = "in the paraxial object plane";

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
    /// Description, possibly of several lines.
    pub description: String,
    /// Version of the data package.
    pub version: String,
    /// Licenses; always one.
    pub licenses: Vec<LicenseEntry>,
    /// Facts that users of the images need.
    pub microsig: Facts,
    /// The files; empty until the manifest is written.
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
    /// Address of its summary.
    #[serde(default)]
    pub path: String,
}

/// Declares a struct whose fields are left out of JSON where they have their default: `None` or nothing.
macro_rules! sparse {
    ($(#[$about:meta])* pub struct $name:ident { $($(#[$attribute:meta])* pub $field:ident: $type:ty,)+ }) => {
        $(#[$about])*
        #[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
        #[serde(default)]
        pub struct $name {
            $($(#[$attribute])* #[serde(skip_serializing_if = "is_default")] pub $field: $type,)+
        }
    };
}

fn is_default<T: Default + PartialEq>(value: &T) -> bool {
    *value == T::default()
}

sparse! {
    /// Facts that users of the images need. Test splits omit those that are derived from the truth.
    pub struct Facts {
        /// Name of the program, `microsig`.
        pub generator: String,
        /// Its version.
        pub generator_version: Option<String>,
        /// [`LAYOUT_VERSION`].
        pub layout_version: Option<u32>,
        /// The seed; `Some(None)` (null) with a secret key.
        #[serde(deserialize_with = "present")]
        pub seed: Option<Option<u64>>,
        /// Description of how random numbers are addressed.
        pub random_streams: Option<String>,
        /// Times of the frames.
        pub timing: TimingFacts,
        /// Pixel size in object space, um.
        pub um_per_px: Option<f64>,
        /// With a cylindrical lens before the camera: the rows of the matrix by which it stretches images about
        /// the center of the sensor. A displacement in px is this matrix times that in um, over `um_per_px`.
        pub image_stretch: Option<[[f64; 2]; 2]>,
        /// Physical depth over depth in MicroSIG's data files.
        pub depth_factor: Option<f64>,
        /// The camera.
        pub sensor: Option<SensorFacts>,
        /// Name of the renderer.
        pub renderer: Option<String>,
        /// Light and objective for wave optics.
        pub waves: Option<WaveFacts>,
        /// Blur, and how the optics vary over the field of view; left out without both.
        pub optics: Option<OpticsFacts>,
        /// Lower and upper end of the depth range, um.
        pub depth_range_um: Option<[f64; 2]>,
        /// Length of the depth range, um.
        pub depth_range_h_um: Option<f64>,
        /// Text of [`coordinates`].
        pub coordinates: Option<String>,
        /// Visible particles per frame, mean over frames.
        pub n_p: Option<f64>,
        /// Visible particles per frame and pixel.
        pub n_ppp: Option<f64>,
        /// Source density N_S.
        pub n_s: Option<f64>,
        /// The share of the sensor in which particles are, if walls or bodies exclude them from the rest.
        pub image_share: Option<f64>,
        /// Area of a particle image, px (number of pixels).
        pub a_pi_px: Option<f64>,
        /// How concentrations are defined.
        pub concentration_definition: Option<String>,
        /// Signal-to-noise ratio.
        pub snr: Option<SnrFacts>,
        /// The image of a single particle.
        pub particle_image: Option<ParticleImageFacts>,
        /// The images of each of several sizes of particles.
        pub sizes: Vec<SizeFacts>,
        /// Diameters of the particles of the calibration stacks, um, if there are several.
        pub calibration_d_um: Vec<f64>,
        /// The flow and its formulas.
        pub motion: Option<MotionFacts>,
        /// The grid of `truth/field.csv`; `Some(None)` (null) without one.
        #[serde(deserialize_with = "present")]
        pub truth_grid: Option<Option<TruthGridFacts>>,
        /// Largest displacement of a visible particle in the image plane, px.
        pub max_displacement_px: Option<f64>,
        /// Gates for scoring.
        pub scoring_gates: Option<ScoringGates>,
        /// How results are scored and ranked, where a suite or the scenario states it.
        pub scoring: Option<ScoringRules>,
        /// `test` in the public part of a test split.
        pub split: Option<String>,
        /// `withheld` if the truth is withheld.
        pub truth: Option<String>,
        /// What is scored in a test split: particles, and fields unless the train split reveals the velocity
        /// field.
        pub scored: Option<Vec<ResultKind>>,
        /// [`RECORDING`] if the images were recorded instead of generated.
        pub kind: Option<String>,
        /// What is known of the particles of a recording.
        pub known: Option<KnownFacts>,
        /// Noise of the images of a recording.
        pub noise: Option<NoiseFacts>,
        /// Places of the calibration stacks in the field of view, if there are several.
        pub calibration_places: Vec<PlaceFacts>,
        /// Digest of all images of a test split.
        pub images_sha256: Option<String>,
        /// SHA-256 of salt and truth of a test split.
        pub commitment_sha256: Option<String>,
        /// Last day for submissions to the challenge of a test split, such as 2027-03-01.
        pub deadline: Option<String>,
    }
}

/// The kind of a folder with recorded images.
pub const RECORDING: &str = "recording";

/// What is known of the particles of a recording.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default)]
pub struct KnownFacts {
    /// Number of frames in which all particles are in a plane of known height (`truth/planes.csv`).
    pub planes: u32,
    /// Number of known positions of particles (`truth/tracks.csv`).
    pub particles: u64,
    /// Whether these are all particles of the frames in which there are any.
    pub all_particles: bool,
}

/// Noise of the images of a recording.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct NoiseFacts {
    /// Mean of the background, counts.
    pub background_counts: f64,
    /// Variance of a pixel of one frame as a polynomial in its signal s above the background: the
    /// coefficients of 1 (counts^2), s (counts) and s^2; the last two are left out if they are unknown.
    pub variance: Vec<f64>,
    /// Number of repeated frames per plane of the scan from which it was estimated; 1 if there are none.
    pub repeats: u32,
    /// How it was estimated.
    pub definition: String,
}

/// The place of a calibration stack in the field of view.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct PlaceFacts {
    /// Number of the place, from 0, row by row.
    pub place: u32,
    /// Column in the frames; the first pixel's center is 1.
    pub x_px: f64,
    /// Row in the frames; the first pixel's center is 1.
    pub y_px: f64,
    /// Number of particles of which the stack is the average; left out for generated stacks.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub particles: Option<u32>,
}

/// Times of the frames: the keys of the scenario's timing, `mode`, `frames` and, for image pairs, `pairs`.
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

    /// Number of pairs; `None` if frames are not pairs.
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

    /// Time from the beginning to the end of an exposure, s: 0 if it is instantaneous.
    pub fn open_s(&self) -> f64 {
        let of = |map: &Map<String, Value>, key: &str| map.get(key).and_then(Value::as_f64).unwrap_or(0.0);
        let flashes = self.0.get("flashes").and_then(Value::as_object);
        of(&self.0, "exposure_s")
            + flashes.map_or(0.0, |flashes| (of(flashes, "count") - 1.0).max(0.0) * of(flashes, "spacing_s"))
    }

    /// Whether frames 2k and 2k + 1 form a pair.
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
    /// Width of the images, px.
    pub width_px: u32,
    /// Height of the images, px.
    pub height_px: u32,
    /// Bit depth of the images.
    pub bit_depth: u8,
    /// MicroSIG's gain, counts per ray; NaN and left out for recordings without a model of their optics.
    #[serde(skip_serializing_if = "is_unknown")]
    pub gain: f64,
    /// Mean background of MicroSIG's own sensor or of a recording, counts.
    pub background_mean_counts: f64,
    /// Background noise of MicroSIG's own sensor or of a recording, counts.
    pub background_noise_counts: f64,
    /// What the pixels of images hold, unless it is whole counts.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub image_format: Option<ImageFormat>,
    /// Whether counts are rounded once, after noise is added; MicroSIG's program rounds the noise first.
    pub rounded_once: bool,
    /// The camera as in the scenario; null for MicroSIG's own sensor.
    pub detector: Value,
}

/// Signal-to-noise ratio.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct SnrFacts {
    /// Median of the SNR over depth; `None` without noise.
    pub value: Option<f64>,
    /// Its definition.
    pub definition: String,
    /// Standard deviation of the background, counts.
    pub background_noise_counts: f64,
    /// MicroSIG's gain, counts per ray.
    pub gain: f64,
    /// Rays per source point.
    pub n_rays: u32,
}

/// Light and objective for wave optics.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct WaveFacts {
    /// Wavelength in vacuum, um.
    pub wavelength_um: f64,
    /// Full width of the band at half maximum, um.
    pub bandwidth_um: f64,
    /// Part of a particle that emits light: `surface` or `volume`.
    pub emission: Emission,
    /// Model of the objective: `microsig` or `aplanatic`.
    pub lens: Lens,
    /// Radius of the Airy disc, px: 0.61 wavelength M / (NA pixel).
    pub airy_radius_px: f64,
    /// Mask and aberrations of the pupil as in the scenario; null for an open pupil without aberrations.
    pub pupil: Option<PupilFunction>,
    /// Medium, cover slip and immersion as in the scenario; null if they are those that the objective was
    /// designed for.
    pub layers: Option<Layers>,
    /// Azimuth of the direction in which the cylindrical lens has power, degrees from image x toward image y;
    /// left out if it is 0.
    #[serde(skip_serializing_if = "is_default")]
    pub cyl_angle_deg: f64,
    /// A cylindrical lens before the camera; left out if there is none.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub cylinder: Option<Cylinder>,
    /// Largest error of an image as a fraction of its peak.
    pub tolerance: f64,
    /// Least and greatest share over depth of the light accepted by the aperture that images of the mean
    /// diameter show; the rest lies outside the drawn part of an image or, with a mask, is blocked.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub drawn_share: Option<[f64; 2]>,
}

#[expect(clippy::trivially_copy_pass_by_ref, reason = "serde passes a reference")]
fn is_unknown(value: &f64) -> bool {
    value.is_nan()
}

impl WaveFacts {
    /// The light and the optics in the middle of the field of view, without blur.
    pub fn optics(&self) -> WaveOptics {
        WaveOptics {
            wavelength_um: self.wavelength_um,
            bandwidth_um: self.bandwidth_um,
            emission: self.emission,
            lens: self.lens,
            pupil: self.pupil.clone().unwrap_or_default(),
            cyl_angle_deg: self.cyl_angle_deg,
            cylinder: self.cylinder,
            layers: self.layers,
            blur_um: 0.0,
            field: FieldOptics::default(),
        }
    }
}

/// What the optics do with images of all renderers.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct OpticsFacts {
    /// Standard deviation of the blur by detector and relay optics, in the particles' space, um.
    pub blur_um: f64,
    /// How the optics vary over the field of view as in the scenario; left out if they do not.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub field: Option<FieldOptics>,
    /// Which points of spheroids emit; left out if they emit as in MicroSIG's program, or if there are none.
    #[serde(default, skip_serializing_if = "is_original")]
    pub spheroids: SpheroidLaw,
}

fn is_original(law: &SpheroidLaw) -> bool {
    *law == SpheroidLaw::Original
}

/// The image of a single particle.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct ParticleImageFacts {
    /// Diameter of the particle, um.
    #[serde(default)]
    pub d_um: f64,
    /// Depth of the highest peak, um; `None` if all depths are in focus.
    pub focus_um: Option<f64>,
}

/// Noise-free images of particles of one size through the depth range.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct SizeFacts {
    /// Diameter, um.
    pub d_um: f64,
    /// Depth of the highest peak, um; `None` if all depths are in focus.
    pub focus_um: Option<f64>,
    /// Least and greatest peak above the background over depth.
    pub peak_counts: [f64; 2],
    /// Least and greatest signal-to-noise ratio over depth; `None` without noise.
    pub snr: Option<[f64; 2]>,
}

/// The flow and its formulas.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct MotionFacts {
    /// The motion as in the scenario.
    pub scenario: Value,
    /// Formula and source of every field in it, by name.
    pub formulas: Map<String, Value>,
}

/// The grid of `truth/field.csv`.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct TruthGridFacts {
    /// Depths of the planes, um.
    pub planes_um: Vec<f64>,
    /// Number of columns of nodes.
    pub columns: usize,
    /// Number of rows of nodes.
    pub rows: usize,
    /// Description of the depth weighting.
    pub weighting: String,
    /// Side of the averaging window, px.
    pub window_px: Option<f64>,
    /// Definitions of the displacements.
    pub definition: String,
}

/// Gates for scoring.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct ScoringGates {
    /// Gate in the image plane, px.
    pub xy_px: f64,
    /// Gate in depth, um.
    pub z_um: f64,
    /// Gate of the ISBI scores, px.
    pub isbi_px: f64,
}

impl ScoringGates {
    /// Gate in the image plane, px.
    pub const XY_PX: f64 = 2.0;
    /// Gate of the ISBI scores, px.
    pub const ISBI_PX: f64 = 5.0;

    /// The gates for a depth range of length `h_um` (um): the gate in depth is a tenth of it.
    pub fn over(h_um: f64) -> Self {
        ScoringGates { xy_px: Self::XY_PX, z_um: h_um / 10.0, isbi_px: Self::ISBI_PX }
    }

    /// The same with the gates that the rules state.
    pub fn by(rules: Option<&ScoringRules>, h_um: f64) -> Self {
        let of = |gate: fn(&ScoringRules) -> Option<f64>| rules.and_then(gate);
        let default = ScoringGates::over(h_um);
        let (xy_px, z_um) = (of(|rules| rules.gate_xy_px), of(|rules| rules.gate_z_um));
        ScoringGates { xy_px: xy_px.unwrap_or(default.xy_px), z_um: z_um.unwrap_or(default.z_um), ..default }
    }
}

impl Manifest {
    /// Reads the manifest of a dataset. Errors: a folder that is no dataset; a file that is not a manifest.
    pub fn read(dataset: &Path) -> Result<Self> {
        let path = dataset.join(MANIFEST);
        if std::fs::symlink_metadata(&path).is_err() {
            return Err(Error::input(no_dataset(dataset)));
        }
        Manifest::parse(&read_text(&path)?, &path.display().to_string())
    }

    /// Reads a manifest's text; `name` is the file's name in messages. Errors: a text that is not a manifest,
    /// with the key or with line and column.
    pub fn parse(text: &str, name: &str) -> Result<Self> {
        crate::json::parse(text).map_err(|e| Error::input(format!("{name}: {e}")))
    }

    /// The entry of the file at a path in the dataset.
    pub fn resource(&self, path: &str) -> Option<&Resource> {
        self.resources.iter().find(|resource| resource.path == path)
    }
}

/// Distinguishes a null value from a missing key.
fn present<'de, T: Deserialize<'de>, D: Deserializer<'de>>(
    value: D,
) -> std::result::Result<Option<Option<T>>, D::Error> {
    Option::deserialize(value).map(Some)
}

/// A message on a path without a manifest: what it is, and which dataset may be meant, in it or around it.
fn no_dataset(path: &Path) -> String {
    let name = path.display();
    match std::fs::metadata(path) {
        Err(e) => return format!("{name}: {e}"),
        Ok(about) if !about.is_dir() => {
            return format!("{name}: a file; expected the folder of a dataset, which has {MANIFEST}");
        }
        Ok(_) => {}
    }
    let is_one = |path: &Path| path.join(MANIFEST).is_file();
    let mut inside: Vec<String> = std::fs::read_dir(path)
        .into_iter()
        .flat_map(|entries| entries.flatten())
        .filter(|entry| is_one(&entry.path()))
        .map(|entry| entry.file_name().to_string_lossy().into_owned())
        .collect();
    inside.sort();
    let around = path.canonicalize().ok().and_then(|whole| whole.parent().map(Path::to_owned));
    let hint = match (inside.as_slice(), around.filter(|around| is_one(around))) {
        ([], None) => String::new(),
        ([], Some(around)) => format!("; {} is one", around.display()),
        ([only], _) => format!("; {} is one", path.join(only).display()),
        ([first, ..], _) => {
            format!(
                "; it holds {} datasets, of which to give one: {}",
                inside.len(),
                path.join(first).display()
            )
        }
    };
    format!("{name}: no dataset: it has no {MANIFEST}{hint}")
}
