//! The scenario file as Rust structs. Every key is a field of one of these structs: its doc comment is the
//! description in the documentation, its attributes give default and range (`language::schema`).
//!
//! An omitted key is `None` or has its default. [`super::resolve`] fills in all of them; the completed
//! scenario is the `scenario.ron` of a dataset.

use std::sync::LazyLock;

use microsig_core::render::expected::DEFAULT_TOLERANCE;
use microsig_core::render::waves::{Lens, WaveOptics};
use microsig_core::render::{RenderMethod, RendererSpec};
use microsig_core::sensor::{Detector, ImageFormat, PixelMaps};
use microsig_core::{KEYS, Settings};
use schemars::JsonSchema;
use serde::{Deserialize, Deserializer, Serialize};
use serde_json::{Value, json};
use storage::dataset::manifest::ScoringRules;

pub use super::calibration::Calibration;
pub use super::field::{Changed, Field, Gridded};
pub use super::focal_planes::Cylinder;
use super::language::derive::schema_of;
use super::language::schema::Schema;
use super::license::LICENSES;
pub use super::maps::Maps;
pub use super::motion::{FieldPlacement, Flow, Motion, OwnField, Tracks, Walls};
pub use super::particles::{Diameter, Emitted, Growth, Number, Particles, Photons, Placement};
pub use super::rendering::{Images, Render, RenderMode};
pub use super::timing::{Flashes, FourPulse, PairSeeding, Pairs, Sequence, Timing};
pub use super::truth_grid::{FieldGrid, Planes, TruthColumns, TruthGrid, Weighting};
pub use flows::illumination::{Beam, Illumination, LightShape, Sheet, SheetProfile};
pub use flows::{Body, Boundary, Brownian, Intensities, Orientation, Settling, Spheroids};
pub use microsig_core::optics::FieldOptics;
pub use microsig_core::render::GaussianSpot as Gaussian;
pub use microsig_core::render::waves::{Layers, Mask, Pinhole, PupilFunction as Pupil};
pub use microsig_core::sensor::HotPixels;

/// A scenario: what is imaged, through which optics, and when.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Spec {
    /// Name of the dataset and of its folder: 1 to 100 lower-case letters, digits, `.`, `_`, `-`.
    #[schemars(example = &"mine", extend("pattern" = "^[a-z0-9_-][a-z0-9._-]{0,99}$"))]
    pub name: String,
    /// Free text for the dataset card.
    #[serde(default)]
    pub description: String,
    /// License of the dataset, written to `LICENSE`, card and manifest.
    #[serde(default = "license")]
    #[schemars(extend("enum" = LICENSES.map(|license| license.id), "x-quoted" = true))]
    pub license: String,
    /// Seed of all random numbers; another seed gives another realization.
    #[serde(default)]
    pub seed: u64,
    /// Lenses, sensor size, background: MicroSIG's 14 settings from a preset, a settings file, or one by one.
    #[serde(default)]
    pub optics: Optics,
    /// A camera model, instead of MicroSIG's constant background with Gaussian noise. Effects that are not
    /// given are off.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub sensor: Option<Sensor>,
    /// What moves the particles.
    #[schemars(example = json!({ "flow": { "field": { "poiseuille": {} } } }))]
    pub motion: Motion,
    /// Number, positions, sizes and brightness of the particles, and what moves them besides the flow.
    #[serde(default)]
    pub particles: Particles,
    /// The box that contains the particles: the image, a margin around it, the depth range.
    #[serde(default)]
    pub boundaries: Boundaries,
    /// Times at which frames are recorded.
    #[schemars(example = json!({ "pairs": { "count": 10 } }))]
    pub timing: Timing,
    /// Illumination that varies in space and from pulse to pulse; it multiplies `c_int`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schemars(extend("x-default" = "the same everywhere and always"))]
    pub illumination: Option<Illumination>,
    /// How particle images are rendered.
    #[serde(default)]
    pub render: Render,
    /// What the pixels of image files hold.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schemars(extend("x-default" = "integer"))]
    pub image_format: Option<ImageFormat>,
    /// Optional columns of the truth.
    #[serde(default)]
    pub truth: TruthColumns,
    /// The true displacement field, `truth/field.csv`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schemars(extend("x-default" = "a grid, or none for recorded tracks"))]
    pub truth_grid: Option<TruthGrid>,
    /// Calibration stacks: one particle, scanned through the depth range; of particles of several sizes a
    /// stack for each.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schemars(extend("x-default" = "stack, or none for Gaussian spots"))]
    pub calibration: Option<Calibration>,
    /// How results are scored and ranked: the defaults of `evaluate`, `compare` and challenges.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schemars(extend("x-default" = "the gates of `evaluate`"))]
    pub scoring: Option<ScoringRules>,
}

/// The language of scenarios.
pub fn schema() -> Schema<'static> {
    static ROOT: LazyLock<Value> = LazyLock::new(schema_of::<Spec>);
    Schema::root(&ROOT)
}

fn license() -> String {
    LICENSES[0].id.to_owned()
}

impl Spec {
    /// A scenario of this name in which everything else has its default.
    pub fn new(name: impl Into<String>, motion: Motion, timing: Timing) -> Self {
        Spec {
            name: name.into(),
            description: String::new(),
            license: license(),
            seed: 0,
            optics: Optics::default(),
            sensor: None,
            motion,
            particles: Particles::default(),
            boundaries: Boundaries::default(),
            timing,
            illumination: None,
            render: Render::default(),
            image_format: None,
            truth: TruthColumns::default(),
            truth_grid: None,
            calibration: None,
            scoring: None,
        }
    }

    /// The renderer and its options.
    pub fn renderer(&self) -> RendererSpec {
        let spheroids = self.render.spheroids;
        let tolerance = self.render.tolerance.unwrap_or(DEFAULT_TOLERANCE);
        let method = match (self.optics.gaussian, self.render.mode) {
            (Some(spot), _) => RenderMethod::Gaussian(spot),
            (None, RenderMode::Rays) => RenderMethod::Rays { spheroids },
            (None, RenderMode::Expected) => RenderMethod::Expected { spheroids, tolerance },
            (None, RenderMode::Waves) => RenderMethod::Waves { optics: self.wave_optics(), tolerance },
        };
        let (blur_um, field) = (self.optics.blur_um, self.optics.field);
        RendererSpec::from(method)
            .through(blur_um.unwrap_or_default(), field.unwrap_or_default())
            .with_single_images(self.render.images == Images::Single)
    }

    /// Factor by which a cylindrical lens before the camera stretches images, and the azimuth (degrees, from
    /// x toward y) of the direction in which it does; `None` without one.
    pub fn stretch(&self) -> Option<(f64, f64)> {
        let renderer = self.renderer();
        let optics = renderer.wave_optics()?;
        optics.cylinder.map(|cylinder| (cylinder.growth(), optics.cyl_angle_deg))
    }

    pub(super) fn walls_slow(&self) -> bool {
        matches!(&self.motion, Motion::Flow(flow) if flow.walls == Walls::Hindered)
    }

    /// What the pixels of images hold.
    pub fn image_format(&self) -> ImageFormat {
        self.image_format.unwrap_or_default()
    }

    /// Light and objective for wave optics. A missing wavelength, which is an error, becomes 0.
    fn wave_optics(&self) -> WaveOptics {
        let Optics { lens, pupil, layers, cyl_angle_deg, .. } = &self.optics;
        WaveOptics {
            wavelength_um: self.render.wavelength_um.unwrap_or_default(),
            bandwidth_um: self.render.bandwidth_um.unwrap_or_default(),
            emission: self.render.emission.unwrap_or_default(),
            lens: lens.unwrap_or_default(),
            pupil: pupil.clone().unwrap_or_default(),
            cyl_angle_deg: cyl_angle_deg.unwrap_or_default(),
            layers: *layers,
            cylinder: self.optics.cylinder_lens(),
            blur_um: self.optics.blur_um.unwrap_or_default(),
            field: self.optics.field.unwrap_or_default(),
        }
    }
}

/// MicroSIG's settings: from a preset or a settings file, and keys that replace single values.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default)]
#[schemars(transform = units_and_ranges)]
pub struct Optics {
    /// A set of settings of Rossi 2020, Table 1.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(extend("x-default" = "setting1, unless `settings` names a file"))]
    pub preset: Option<Preset>,
    /// Instead of a preset: a MicroSIG settings file, relative to the scenario.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(example = &"settings.txt")]
    pub settings: Option<String>,
    /// Physical depth over depth in MicroSIG's data files: 1 in air, about 1.33 for a dry objective over
    /// water.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(range(min = 0.1, max = 10.0))]
    pub depth_factor: Option<f64>,
    /// Gaussian spots, all in focus, instead of rays, as in synthetic images for classical PIV; `gain` is
    /// then 1 unless given.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub gaussian: Option<Gaussian>,
    /// Magnification M.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub magnification: Option<f64>,
    /// Numerical aperture NA; the larger it is, the faster images grow out of focus.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub numerical_aperture: Option<f64>,
    /// Focal length of the virtual spherical lens; 350 is recommended.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub focal_length: Option<f64>,
    /// Refractive index between particle and lens.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub ri_medium: Option<f64>,
    /// Refractive index of the lens.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub ri_lens: Option<f64>,
    /// Edge of a pixel on the sensor.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(extend("minimum" = 0.05, "maximum" = 1000))]
    pub pixel_size: Option<f64>,
    /// Width of the image.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub pixel_dim_x: Option<u32>,
    /// Height of the image.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub pixel_dim_y: Option<u32>,
    /// Constant background.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub background_mean: Option<f64>,
    /// Standard deviation of the Gaussian background noise.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub background_noise: Option<f64>,
    /// Source points per pixel of a particle image; more points: less grain, more time.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub points_per_pixel: Option<f64>,
    /// Rays per source point; more rays: less grain, brighter images, more time.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub n_rays: Option<u32>,
    /// Counts per ray.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(extend("minimum" = 0, "maximum" = 1e6))]
    pub gain: Option<f64>,
    /// Focal length of the cylindrical lens; 0: no cylindrical lens.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub cyl_focal_length: Option<f64>,
    /// Instead of `cyl_focal_length`: distance of the two focal planes in paraxial optics, i.e. the physical
    /// depth at which images are narrowest along x minus that at which they are narrowest along y; negative
    /// for a converging cylindrical lens.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(
        range(min = -1e5, max = 1e5),
        extend("x-default" = "that of `cyl_focal_length`, into which it is converted"),
        example = -20.0
    )]
    pub focal_planes_um: Option<f64>,
    /// A cylindrical lens before the camera, for `lens: aplanatic`.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(extend("x-default" = "none"))]
    pub cylinder: Option<Cylinder>,
    /// The model of the objective, for `mode: waves`.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(extend("x-default" = "microsig if `mode` is `waves`"))]
    pub lens: Option<Lens>,
    /// Mask and aberrations in the pupil of the objective, for `mode: waves`.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(extend("x-default" = "an open pupil without aberrations"), example = Pupil::default())]
    pub pupil: Option<Pupil>,
    /// Azimuth of the direction in which the cylindrical lens has power, from x toward y, for `mode: waves`.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(range(min = -180.0, max = 180.0), extend("x-unit" = "degrees", "x-default" = "0: along x"), example = 0.0)]
    pub cyl_angle_deg: Option<f64>,
    /// Standard deviation of the Gaussian blur by detector and relay optics, in the particles' space. A sensor
    /// with a modulation transfer of T at its Nyquist frequency, the part of its square pixels (0.64) divided out, has
    /// 0.45 sqrt(-ln T) px, times pixel size over magnification.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(range(min = 0.0, max = 1e3), extend("x-default" = "0: none"), example = 0.8)]
    pub blur_um: Option<f64>,
    /// How the optics vary over the field of view; X and Y are distances from its center in the particles'
    /// space.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(extend("x-default" = "the same optics everywhere"), example = FieldOptics::default())]
    pub field: Option<FieldOptics>,
    /// Medium, cover slip and immersion, for `mode: waves`.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(extend("x-default" = "those that the objective was designed for"), example = Layers::default())]
    pub layers: Option<Layers>,
}

/// Defaults of MicroSIG's settings are the preset's; units and ranges are as in its settings files.
fn units_and_ranges(schema: &mut schemars::Schema) {
    let properties = schema.get_mut("properties").and_then(Value::as_object_mut);
    for (name, site) in properties.into_iter().flatten() {
        let (Some(key), Some(site)) = (KEYS.iter().find(|key| key.name == name), site.as_object_mut()) else {
            continue;
        };
        site.insert("x-default".to_owned(), "from the preset".into());
        // A key of the scenario may be bounded more closely. The type of whole numbers says that they are >= 0.
        let bounds = ["minimum", "exclusiveMinimum", "maximum", "exclusiveMaximum"];
        let type_bound = key.is_whole.then(|| Value::from(0));
        let is_bounded =
            bounds.iter().any(|bound| site.get(*bound).is_some_and(|b| Some(b) != type_bound.as_ref()));
        for (keyword, bound) in key.range.keywords().filter(|_| !is_bounded) {
            site.insert(keyword.to_owned(), bound.into());
        }
        if !key.condition.is_empty() {
            site.entry("x-condition").or_insert(key.condition.into());
        }
        if !key.unit.is_empty() {
            site.entry("x-unit").or_insert(key.unit.into());
        }
    }
}

macro_rules! settings_keys {
    ($optics:ident, $settings:ident, $each:ident) => {
        $each!($optics, $settings, magnification, numerical_aperture, focal_length, ri_medium, ri_lens);
        $each!($optics, $settings, pixel_size, pixel_dim_x, pixel_dim_y, background_mean, background_noise);
        $each!($optics, $settings, points_per_pixel, n_rays, gain, cyl_focal_length);
    };
}

impl Optics {
    /// Overwrites the settings whose keys are given.
    pub fn apply(&self, settings: &mut Settings) {
        macro_rules! apply {
            ($o:ident, $s:ident, $($key:ident),*) => { $( if let Some(value) = $o.$key { $s.$key = value; } )* };
        }
        settings_keys!(self, settings, apply);
    }

    /// Sets all keys to the given settings.
    pub fn fill(&mut self, settings: &Settings) {
        macro_rules! fill {
            ($o:ident, $s:ident, $($key:ident),*) => { $( $o.$key = Some($s.$key); )* };
        }
        settings_keys!(self, settings, fill);
    }
}

/// A set of settings of Rossi 2020, Table 1.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Preset {
    /// M 10, NA 0.3, 752 x 366 px.
    Setting1,
    /// Setting 1 with a cylindrical lens: astigmatic images.
    Setting1a,
    /// M 63, NA 0.75, 141 x 141 px.
    Setting2,
}

/// A camera (`microsig_core::sensor::Detector` defines each value). Effects that are not given are off.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default)]
pub struct Sensor {
    /// Photons per count of the ideal image.
    #[schemars(extend("x-unit" = "photons/count", "exclusiveMinimum" = 0, "maximum" = 1e12))]
    pub photons_per_count: f64,
    /// Quantum efficiency: electrons per photon.
    #[schemars(extend("x-unit" = "e/photon", "exclusiveMinimum" = 0, "maximum" = 1))]
    pub quantum_efficiency: f64,
    /// Whether the number of electrons fluctuates (Poisson).
    pub shot_noise: bool,
    /// Mean dark electrons per pixel and frame.
    #[schemars(range(min = 0.0, max = 1e12))]
    pub dark_e: f64,
    /// Standard deviation of the read noise.
    #[schemars(range(min = 0.0, max = 1e12))]
    pub read_noise_e: f64,
    /// Full-well capacity: a pixel saturates at this many electrons.
    #[serde(deserialize_with = "or_infinite")]
    #[schemars(extend("type" = ["number", "null"], "exclusiveMinimum" = 0, "x-infinite" = true))]
    pub full_well_e: f64,
    /// Counts per electron.
    #[schemars(extend("exclusiveMinimum" = 0, "maximum" = 1e12))]
    pub gain_counts_per_e: f64,
    /// Counts of a pixel without electrons.
    #[schemars(range(min = -65535.0, max = 65535.0))]
    pub offset_counts: f64,
    /// Bit depth of the image.
    #[schemars(extend("enum" = [8, 10, 12, 14, 16]))]
    pub bits: u8,
    /// Photo-response non-uniformity: relative standard deviation of the pixels' sensitivities, the same in
    /// all frames.
    #[schemars(range(min = 0.0, max = 0.3))]
    pub prnu: f64,
    /// Dark-signal non-uniformity: standard deviation of the pixels' dark electrons, the same in all frames.
    #[schemars(range(min = 0.0, max = 1e12))]
    pub dsnu_e: f64,
    /// Pixels with a large dark signal, the same in all frames.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(example = HotPixels { fraction: 0.0001, dark_e: 5000.0 })]
    pub hot_pixels: Option<HotPixels>,
    /// Fraction of the light lost in the corners; it grows with the square of the radius.
    #[schemars(range(min = 0.0, max = 1.0))]
    pub vignetting: f64,
    /// A gray-scale TIFF of the image's size whose counts are added to the ideal image, relative to the
    /// scenario.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(example = &"background.tif")]
    pub background: Option<String>,
    /// Offset, gain and read noise of every pixel, as measured for sCMOS cameras: gray-scale TIFF files (also of
    /// floating-point numbers) or `.npy` arrays (f4 or f8; rows, columns) of the image's size, relative to the
    /// scenario.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(extend("x-default" = "all pixels are alike"), example = Maps::default())]
    pub maps: Option<Maps>,
}

/// JSON has no infinite numbers: `null` represents infinity.
fn or_infinite<'de, D: Deserializer<'de>>(deserializer: D) -> Result<f64, D::Error> {
    Option::deserialize(deserializer).map(|value| value.unwrap_or(f64::INFINITY))
}

/// A camera of one type with the values that it has in common with one of another type.
macro_rules! camera {
    ($camera:ident of $of:ident, $($key:ident: $value:expr),*) => {
        camera!($camera, $of, photons_per_count, quantum_efficiency, shot_noise, dark_e, read_noise_e, full_well_e,
            gain_counts_per_e, offset_counts, bits, prnu, dsnu_e, hot_pixels, vignetting; $($key: $value),*)
    };
    ($camera:ident, $of:ident, $($same:ident),*; $($key:ident: $value:expr),*) => {
        $camera { $($same: $of.$same,)* $($key: $value),* }
    };
}

impl Default for Sensor {
    fn default() -> Self {
        let detector = Detector::default();
        camera!(Sensor of detector, background: None, maps: None)
    }
}

impl Sensor {
    /// The detector, with the counts of its background image and its maps.
    pub fn detector(&self, background: Option<Vec<f64>>, maps: PixelMaps) -> Detector {
        camera!(Detector of self, background: background, maps: PixelMaps::default()).with_maps(maps)
    }
}

/// The box that holds the particles.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default)]
pub struct Boundaries {
    /// Depth range, lower end first; z = 0 is the paraxial object plane, z grows away from the lens.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(extend("minimum" = -1e6, "maximum" = 1e6))]
    pub z_um: Option<(f64, f64)>,
    /// Instead of `z_um`: length of a depth range in the middle between the two focal planes of a cylindrical
    /// lens, about z = 0 without one; it is converted into `z_um`.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(extend("exclusiveMinimum" = 0, "maximum" = 1e6), example = 40.0)]
    pub depth_um: Option<f64>,
    /// Type of the left and right boundaries.
    pub x: Boundary,
    /// Type of the upper and lower boundaries.
    pub y: Boundary,
    /// Type of the boundaries at the two ends of the depth range.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub z: Option<Boundary>,
    /// Distance by which the box extends beyond the image on each side.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(
        range(min = 0.0, max = 1e5),
        extend("x-default" = "as far as the largest particle image, at most half the longer side of the sensor (or 50 px)")
    )]
    pub margin_px: Option<f64>,
    /// Solid bodies that particles cannot enter.
    pub bodies: Vec<Body>,
    /// Whether a particle that crosses a periodic boundary keeps its track number.
    pub keep_ids: bool,
}
