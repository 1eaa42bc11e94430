//! A scenario as it is written: RON, everything optional that has a sensible default.
//!
//! The types mirror the file. A key left out is `None` (or a default); [`super::resolve`] fills them all, and the
//! filled form is what a dataset keeps as its `scenario.ron`.

use microsig_core::Settings;
use microsig_core::emission::SpheroidLaw;
use microsig_core::render::expected::{DEFAULT_TOLERANCE, ExpectedRenderer};
use microsig_core::render::{GaussianRenderer, RayRenderer, Renderer, Spot};
use microsig_core::sensor::{self, Detector};
use serde::{Deserialize, Serialize};

pub use super::field::{Changed, Field, Gridded};
pub use super::illumination::{Beam, Illumination, LightShape, Sheet, SheetProfile};
use super::license::LICENSES;
pub use super::motion::{FieldPlacement, Flow, Motion, Tracks};
pub use super::particles::{
    Brightness, Brownian, Diameter, Number, Obstacle, Orientation, Particles, Placement, Settling, Spheroids,
};
pub use super::timing::{Flashes, FourPulse, PairSeeding, Pairs, Sequence, Timing};
pub use super::truth_grid::{Grid, Planes, TruthGrid, Weighting};

/// A whole scenario.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Spec {
    /// Name of the dataset: lower-case letters, digits, `.`, `_`, `-`.
    pub name: String,
    /// What the dataset is for, free text.
    #[serde(default)]
    pub description: String,
    /// Licence of the dataset, one of [`super::license::LICENSES`].
    #[serde(default = "license")]
    pub license: String,
    /// Seed of all random numbers.
    #[serde(default)]
    pub seed: u64,
    /// Lenses, sensor size and background.
    #[serde(default)]
    pub optics: Optics,
    /// The camera behind the optics; left out, it is MicroSIG's own sensor.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub sensor: Option<Sensor>,
    /// What moves the particles.
    pub motion: Motion,
    /// How many particles of what kind.
    #[serde(default)]
    pub particles: Particles,
    /// The box that holds the particles.
    #[serde(default)]
    pub boundaries: Boundaries,
    /// When frames are taken.
    pub timing: Timing,
    /// Light on the particles; left out, it is the same everywhere and always.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub illumination: Option<Illumination>,
    /// How images are made.
    #[serde(default)]
    pub render: Render,
    /// Further columns of the truth.
    #[serde(default)]
    pub truth: Truth,
    /// The displacement field of the truth.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub truth_grid: Option<TruthGrid>,
    /// The calibration stack; left out, there is one unless all particles are in focus anyway.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub calibration: Option<Calibration>,
}

fn license() -> String {
    LICENSES[0].id.to_owned()
}

impl Spec {
    /// What draws the particles, on a sensor of these settings.
    ///
    /// # Errors
    /// Values out of range.
    pub fn renderer(&self, settings: &Settings) -> Result<Renderer, microsig_core::Error> {
        Ok(match (self.optics.gaussian, self.render.mode) {
            (Some(spot), _) => Renderer::Gaussian(GaussianRenderer::new(settings, spot.into())?),
            (None, Mode::Rays) => Renderer::Rays(RayRenderer::new(settings, self.render.spheroids.into())?),
            (None, Mode::Expected) => {
                let tolerance = self.render.tolerance.unwrap_or(DEFAULT_TOLERANCE);
                Renderer::Expected(ExpectedRenderer::new(settings, self.render.spheroids.into(), tolerance)?)
            }
        })
    }

    /// What draws the stack of a single particle: where expected images are asked for, rays, because tables for a stack
    /// would cost more than the mean of some ray images.
    ///
    /// # Errors
    /// Values out of range.
    pub fn single_renderer(&self, settings: &Settings) -> Result<Renderer, microsig_core::Error> {
        match self.renderer(settings)? {
            Renderer::Expected(_) => {
                Ok(Renderer::Rays(RayRenderer::new(settings, self.render.spheroids.into())?))
            }
            other => Ok(other),
        }
    }
}

/// Gaussian spots, all in focus, instead of rays (`microsig_core::render::gaussian` says what each value does).
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct Gaussian {
    /// e^-2 diameter, px.
    pub diameter_px: f64,
    /// The particle diameter that has a spot of `diameter_px`, um; left out, all have.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub reference_um: Option<f64>,
    /// Peak of the irradiance of a particle of c_int 1, counts per pixel before gain.
    pub peak_counts: f64,
}

impl Default for Gaussian {
    /// The diameter at which PIV errors are smallest, a hundred times as bright as the noise of setting 1.
    fn default() -> Self {
        Gaussian { diameter_px: 2.5, reference_um: None, peak_counts: 1000.0 }
    }
}

impl From<Gaussian> for Spot {
    fn from(g: Gaussian) -> Self {
        Spot { diameter_px: g.diameter_px, reference_um: g.reference_um, peak_counts: g.peak_counts }
    }
}

/// Further columns of `truth/tracks.csv`.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default)]
pub struct Truth {
    /// The velocity gradient at each particle: nine columns, which nearly double the table.
    pub gradient: bool,
}

/// MicroSIG's settings: from a preset or a settings file, and keys that replace single values.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct Optics {
    /// One of the sets of Rossi 2020, Table 1.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub preset: Option<Preset>,
    /// A MicroSIG settings file, relative to the scenario.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub settings: Option<String>,
    /// Physical depth over depth in MicroSIG's data files.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub depth_factor: Option<f64>,
    /// Classical in-focus images instead of rays.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub gaussian: Option<Gaussian>,
    /// MicroSIG's key of this name; so are all that follow.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub magnification: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    #[allow(missing_docs)]
    pub numerical_aperture: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    #[allow(missing_docs)]
    pub focal_length: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    #[allow(missing_docs)]
    pub ri_medium: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    #[allow(missing_docs)]
    pub ri_lens: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    #[allow(missing_docs)]
    pub pixel_size: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    #[allow(missing_docs)]
    pub pixel_dim_x: Option<u32>,
    #[serde(skip_serializing_if = "Option::is_none")]
    #[allow(missing_docs)]
    pub pixel_dim_y: Option<u32>,
    #[serde(skip_serializing_if = "Option::is_none")]
    #[allow(missing_docs)]
    pub background_mean: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    #[allow(missing_docs)]
    pub background_noise: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    #[allow(missing_docs)]
    pub points_per_pixel: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    #[allow(missing_docs)]
    pub n_rays: Option<u32>,
    #[serde(skip_serializing_if = "Option::is_none")]
    #[allow(missing_docs)]
    pub gain: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    #[allow(missing_docs)]
    pub cyl_focal_length: Option<f64>,
}

macro_rules! settings_keys {
    ($optics:ident, $settings:ident, $each:ident) => {
        $each!($optics, $settings, magnification, numerical_aperture, focal_length, ri_medium, ri_lens);
        $each!($optics, $settings, pixel_size, pixel_dim_x, pixel_dim_y, background_mean, background_noise);
        $each!($optics, $settings, points_per_pixel, n_rays, gain, cyl_focal_length);
    };
}

impl Optics {
    /// Replaces the settings that are written here.
    pub fn apply(&self, settings: &mut Settings) {
        macro_rules! apply {
            ($o:ident, $s:ident, $($key:ident),*) => { $( if let Some(value) = $o.$key { $s.$key = value; } )* };
        }
        settings_keys!(self, settings, apply);
    }

    /// Writes all settings here.
    pub fn fill(&mut self, settings: &Settings) {
        macro_rules! fill {
            ($o:ident, $s:ident, $($key:ident),*) => { $( $o.$key = Some($s.$key); )* };
        }
        settings_keys!(self, settings, fill);
    }
}

/// A set of settings of Rossi 2020, Table 1.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Preset {
    /// M 10, NA 0.3, 752 x 366 px.
    Setting1,
    /// Setting 1 with a cylindrical lens.
    Setting1a,
    /// M 63, NA 0.75, 141 x 141 px.
    Setting2,
}

/// A camera (`microsig_core::sensor::Detector` says what each value does). What is left out is off.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct Sensor {
    /// Photons that make one count of the ideal image.
    pub photons_per_count: f64,
    /// Electrons per photon.
    pub quantum_efficiency: f64,
    /// Whether the number of electrons fluctuates.
    pub shot_noise: bool,
    /// Mean dark electrons of a pixel and frame.
    pub dark_e: f64,
    /// Standard deviation of the read noise, electrons.
    pub read_noise_e: f64,
    /// Electrons that a pixel holds.
    pub full_well_e: f64,
    /// Counts per electron.
    pub gain_counts_per_e: f64,
    /// Counts of a pixel without electrons.
    pub offset_counts: f64,
    /// Bit depth: 8, 10, 12, 14 or 16.
    pub bits: u8,
    /// Relative standard deviation of the pixels' sensitivities.
    pub prnu: f64,
    /// Standard deviation of the pixels' dark electrons.
    pub dsnu_e: f64,
    /// Pixels with a large dark signal.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub hot_pixels: Option<HotPixels>,
    /// Loss of light in the corners, as a share.
    pub vignetting: f64,
    /// A grey TIFF of the image's size whose counts are added to the ideal image, relative to the scenario.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub background: Option<String>,
}

impl Default for Sensor {
    fn default() -> Self {
        let d = Detector::default();
        Sensor {
            photons_per_count: d.photons_per_count,
            quantum_efficiency: d.quantum_efficiency,
            shot_noise: d.shot_noise,
            dark_e: d.dark_e,
            read_noise_e: d.read_noise_e,
            full_well_e: d.full_well_e,
            gain_counts_per_e: d.gain_counts_per_e,
            offset_counts: d.offset_counts,
            bits: d.bits,
            prnu: d.prnu,
            dsnu_e: d.dsnu_e,
            hot_pixels: None,
            vignetting: d.vignetting,
            background: None,
        }
    }
}

impl Sensor {
    /// The detector, with the counts of its background image.
    pub fn detector(&self, background: Option<Vec<f64>>) -> Detector {
        Detector {
            photons_per_count: self.photons_per_count,
            quantum_efficiency: self.quantum_efficiency,
            shot_noise: self.shot_noise,
            dark_e: self.dark_e,
            read_noise_e: self.read_noise_e,
            full_well_e: self.full_well_e,
            gain_counts_per_e: self.gain_counts_per_e,
            offset_counts: self.offset_counts,
            bits: self.bits,
            prnu: self.prnu,
            dsnu_e: self.dsnu_e,
            hot_pixels: self.hot_pixels.map(|h| sensor::HotPixels { fraction: h.fraction, dark_e: h.dark_e }),
            vignetting: self.vignetting,
            background,
        }
    }
}

/// Hot pixels.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct HotPixels {
    /// Their share.
    pub fraction: f64,
    /// Their dark electrons in a frame.
    pub dark_e: f64,
}

/// The box that holds the particles.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct Boundaries {
    /// The depth range, um.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub z_um: Option<(f64, f64)>,
    /// What the left and right ends are.
    pub x: Boundary,
    /// What the upper and lower ends are.
    pub y: Boundary,
    /// What the two ends of the depth range are.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub z: Option<Boundary>,
    /// How far the box reaches beyond the image on each side, px; unless given, as far as the largest particle image, but
    /// at most half the longer side of the sensor (or 50 px).
    #[serde(skip_serializing_if = "Option::is_none")]
    pub margin_px: Option<f64>,
    /// Bodies that particles cannot enter.
    pub bodies: Vec<Obstacle>,
    /// Whether a particle that passes a periodic end keeps its number.
    pub keep_ids: bool,
}

/// What a face of the box is.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Boundary {
    /// Particles go through; outside there are as many as inside.
    #[default]
    Open,
    /// Particles keep their radius away from it.
    Wall,
    /// What leaves on one side comes in on the other.
    Periodic,
}

/// How images are made.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct Render {
    /// The renderer.
    pub mode: Mode,
    /// Which points of spheroids shine.
    pub spheroids: Law,
    /// Error of an expected image as a share of its peak (`microsig_core::render::expected::DEFAULT_TOLERANCE`); left out
    /// where images are not `expected`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub tolerance: Option<f64>,
}

/// Which points of a spheroid shine.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Law {
    /// As in MicroSIG's program.
    #[default]
    Original,
    /// Uniform in area.
    Uniform,
}

impl From<Law> for SpheroidLaw {
    fn from(law: Law) -> Self {
        match law {
            Law::Original => SpheroidLaw::Original,
            Law::Uniform => SpheroidLaw::Uniform,
        }
    }
}

/// A renderer.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Mode {
    /// Counts of discrete rays, the paper's method.
    #[default]
    Rays,
    /// The limit of many rays, without their noise; shot noise is the sensor's.
    Expected,
}

/// The calibration stack.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Calibration {
    /// One particle, scanned through the depth range in steps of 2 um.
    #[default]
    Stack,
    /// No stack.
    None,
}
