//! Baseline trackers: one simple method of each kind, applied to a dataset.
//!
//! They use only what is available to participants: images, the calibration stack, the optical settings.
//! Anchors are the exception: they are made from the truth, as reference results of known quality.
//! docs/baselines.md describes the methods and their measured scores.
//!
//! To add a tracker, write a file in this folder that defines a [`Method`], and list it in [`METHODS`].

mod acceptance;
mod anchors;
mod aptv;
mod calibration;
mod cpu_time;
mod deform;
mod denoise;
mod field_images;
mod fit;
mod gray_image;
mod images;
mod job;
mod joint_fit;
mod link;
mod locate;
mod maps;
mod mle;
mod ncc;
mod opposite;
mod output;
mod piv;
mod positions;
mod recording;
mod regions;
mod search;
mod shape_correlation;
mod shape_fit;
mod shape_table;
mod shape_templates;
mod sides;
mod spheroids;
mod spots;
mod stack;
mod templates;
mod uneven;

pub use calibration::{check as check_calibration, zero_um};
pub use gray_image::{GrayImage, Spline};
pub use spheroids::weighted_median;

use std::path::{Path, PathBuf};
use std::time::Instant;

use glam::DVec3;
use microsig_core::render::Context;
use serde::Serialize;

use job::Job;
use output::Output;
use storage::advice::{Advice, flag, option};
use storage::dataset::{Columns, DatasetPlace};
use storage::error::{Error, Result};
use storage::range::faults;
use storage::{InputFile, NumberRange, OutputFile, Progress, advice};

/// A tracking method.
#[derive(Debug)]
pub struct Method {
    /// Name on the command line.
    pub name: &'static str,
    /// One-line description.
    pub about: &'static str,
    run: fn(&Job) -> Result<Output>,
}

/// All methods, in the order of listings.
pub static METHODS: &[&Method] = &[
    &spots::METHOD,
    &ncc::METHOD,
    &mle::METHOD,
    &aptv::METHOD,
    &piv::METHOD,
    &anchors::TRUTH_NOISE,
    &anchors::OFFSET,
    &anchors::STATIC,
    &anchors::EMPTY,
];

/// Shape of the particles that `ncc` and `mle` measure.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum ParticleShape {
    /// Spheres.
    Sphere,
    /// Spheroids with the equatorial diameter of the calibration particle.
    Spheroid {
        /// Polar over equatorial diameter.
        aspect: AspectRatio,
    },
}

/// What is known of the aspect ratio of spheroids, polar over equatorial diameter.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum AspectRatio {
    /// Its value, within [`ParticleShape::ASPECTS`].
    Given(f64),
    /// All particles have the same, which is measured.
    Common,
    /// Each particle has its own: `mle` fits it, `ncc` chooses the best of a few.
    Each,
}

impl std::str::FromStr for AspectRatio {
    type Err = String;

    fn from_str(text: &str) -> std::result::Result<Self, String> {
        match text {
            "common" => Ok(AspectRatio::Common),
            "each" => Ok(AspectRatio::Each),
            _ => text
                .parse()
                .map(AspectRatio::Given)
                .map_err(|_| "expected a number, common or each".to_owned()),
        }
    }
}

/// Options of a tracker run.
#[derive(Debug, Clone)]
pub struct TrackOptions {
    /// Name of the method, one of [`METHODS`].
    pub method: String,
    /// Largest displacement from frame to frame, px, > 0.
    pub max_displacement_px: f64,
    /// Diameter of a particle image (`spots`), px.
    pub diameter_px: f64,
    /// Standard deviation of the noise that `truth-noise` adds in x and y, px.
    pub noise_xy_px: f64,
    /// Standard deviation of the noise that `truth-noise` adds in z, um.
    pub noise_z_um: f64,
    /// Seed of that noise.
    pub seed: u64,
    /// Whether to replace an existing result.
    pub force: bool,
    /// Whether `piv` averages the correlation planes of all image pairs, for one field of a steady flow.
    pub ensemble: bool,
    /// Shape of the particles that `ncc` and `mle` measure.
    pub shape: ParticleShape,
    /// Whether `mle` fits the diameter of each sphere.
    pub fit_diameter: bool,
    /// A table of positions at which `ncc` and `mle` measure spheres, instead of searching for them.
    pub positions: Option<InputFile>,
    /// Progress display.
    pub progress: Progress,
    /// Where the renderers of `mle` keep their tables.
    pub context: Context,
}

impl TrackOptions {
    /// Default of `max_displacement_px`.
    pub const MAX_DISPLACEMENT_PX: f64 = 15.0;
    /// Default of `diameter_px`.
    pub const DIAMETER_PX: f64 = 3.0;
    /// Default of `noise_xy_px`.
    pub const NOISE_PX: f64 = 0.1;
    /// Default of `noise_z_um`.
    pub const NOISE_UM: f64 = 1.0;

    /// The allowed values: of `max_displacement_px`, `diameter_px`, `noise_xy_px` and `noise_z_um`.
    pub const RANGES: [NumberRange; 4] = [
        NumberRange { key: "max_displacement_px", least: 0.001, most: 1e5, unit: "px" },
        NumberRange { key: "diameter_px", least: 0.5, most: 1e3, unit: "px" },
        NumberRange { key: "noise_xy_px", least: 0.0, most: 1e3, unit: "px" },
        NumberRange { key: "noise_z_um", least: 0.0, most: 1e3, unit: "um" },
    ];

    /// Refuses values out of range, an unknown method and options of other methods.
    fn check(&self) -> Result<&'static Method> {
        let method = method(&self.method)?;
        let [displacement, diameter, noise_xy, noise_z] = Self::RANGES;
        let mut wrong = faults(&[
            (Some(self.max_displacement_px), displacement),
            (Some(self.diameter_px), diameter),
            (Some(self.noise_xy_px), noise_xy),
            (Some(self.noise_z_um), noise_z),
        ]);
        if self.ensemble && method.name != "piv" {
            let (ensemble, piv) = (flag("ensemble"), option("method").is("piv"));
            wrong.push(advice!(ensemble, ": expected with ", piv, format!(", not {}", method.name)));
        }
        wrong.extend(self.shape.faults(method.name));
        if self.fit_diameter && (method.name != "mle" || self.shape != ParticleShape::Sphere) {
            let (fit, mle) = (flag("fit_diameter"), option("method").is("mle"));
            wrong.push(advice!(fit, ": expected with ", mle, " and spheres"));
        }
        if self.positions.is_some()
            && (!["ncc", "mle"].contains(&method.name) || self.shape != ParticleShape::Sphere)
        {
            let (positions, ncc) = (option("positions"), option("method").is("ncc"));
            wrong.push(advice!(positions, ": expected with ", ncc, " or mle and spheres"));
        }
        if wrong.is_empty() { Ok(method) } else { Err(Error::Options(wrong)) }
    }

    /// The defaults of a method.
    pub fn of(method: &str, progress: Progress) -> Self {
        TrackOptions {
            method: method.to_owned(),
            max_displacement_px: Self::MAX_DISPLACEMENT_PX,
            diameter_px: Self::DIAMETER_PX,
            noise_xy_px: Self::NOISE_PX,
            noise_z_um: Self::NOISE_UM,
            seed: 0,
            force: false,
            ensemble: false,
            shape: ParticleShape::Sphere,
            fit_diameter: false,
            positions: None,
            progress,
            context: Context::default(),
        }
    }
}

/// Summary of a tracker run.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Tracked {
    /// Path of the result.
    pub out: PathBuf,
    /// Name of the method.
    pub method: &'static str,
    /// Number of frames of the dataset.
    pub frames: usize,
    /// Number of rows of the result.
    pub rows: usize,
    /// Duration, s.
    pub seconds: f64,
    /// Mean CPU time of one frame (for `piv` an image pair, with `--ensemble` a pair in one pass), s; `None`
    /// for anchors made from the truth.
    pub seconds_per_frame: Option<f64>,
    /// Maximum of these times, s.
    pub slowest_frame_seconds: Option<f64>,
    /// Warnings about the result.
    pub warnings: Vec<String>,
    /// What the method used, if it had a choice.
    pub notes: Vec<String>,
}

/// A particle found in a frame, in pixels of the dataset (the center of the first pixel is 1).
#[derive(Debug, Clone, Copy, Default, PartialEq)]
struct Localization {
    x_px: f64,
    y_px: f64,
    /// `None` for methods that measure in the image plane only.
    z_um: Option<f64>,
    /// Standard deviations of x, y (px) and z (um); `None` for methods that do not estimate them.
    deviations: Option<[f64; 3]>,
    /// Diameter, um; `None` for methods that do not measure it.
    d_um: Option<f64>,
    /// `None` for methods that measure positions only.
    shape: Option<ShapeEstimate>,
    other: Option<OtherSide>,
    /// The particle, if it is known.
    track: Option<i64>,
}

/// Where a particle may be instead: another fit, on the other side of the focus.
#[derive(Debug, Clone, Copy, PartialEq)]
struct OtherSide {
    at: [f64; 2],
    z_um: f64,
    deviations: Option<[f64; 3]>,
    /// -2 ln of its likelihood relative to the first fit.
    cost: f64,
}

impl OtherSide {
    fn likelihood(&self) -> f64 {
        (-0.5 * self.cost).exp()
    }
}

impl Localization {
    /// The particle on the other side of the focus.
    fn on_other_side(&self) -> Option<Self> {
        let OtherSide { at: [x_px, y_px], z_um, deviations, cost } = self.other?;
        let here = OtherSide {
            at: [self.x_px, self.y_px],
            z_um: self.z_um?,
            deviations: self.deviations,
            cost: -cost,
        };
        Some(Localization { x_px, y_px, z_um: Some(z_um), deviations, other: Some(here), ..*self })
    }
}

#[derive(Debug, Clone, Copy, PartialEq)]
struct ShapeEstimate {
    /// Unit vector up to its sign (x right, y down, z away from the lens).
    axis: DVec3,
    /// Aspect ratio, if it is not given.
    aspect: Option<f64>,
    /// `None` for methods that do not estimate it.
    uncertainty: Option<ShapeUncertainty>,
}

/// What is uncertain about a spheroid.
#[derive(Debug, Clone, Copy, PartialEq)]
struct ShapeUncertainty {
    /// Largest and smallest standard deviation of the axis, rad, and the direction of the largest one.
    axis_deviations: [f64; 2],
    uncertain: DVec3,
    /// Depth (um) and axis of another fit, and its likelihood relative to the first.
    other: Option<(f64, DVec3, f64)>,
    /// Standard deviation of the aspect ratio, if that is fitted.
    aspect: f64,
}

/// The method of this name.
pub fn method(name: &str) -> Result<&'static Method> {
    METHODS.iter().find(|m| m.name == name).copied().ok_or_else(|| {
        let names: Vec<&str> = METHODS.iter().map(|m| m.name).collect();
        Error::input(format!("method `{name}`: expected one of {}", names.join(", ")))
    })
}

impl ParticleShape {
    /// The allowed aspect ratios.
    pub const ASPECTS: NumberRange = NumberRange { key: "aspect_ratio", least: 0.1, most: 10.0, unit: "" };

    /// Spheroids for methods other than `ncc` and `mle`, and aspect ratios out of range.
    fn faults(self, method: &str) -> Option<Advice> {
        let ParticleShape::Spheroid { aspect } = self else { return None };
        if !["ncc", "mle"].contains(&method) {
            let (shape, ncc) = (option("shape").is("spheroid"), option("method").is("ncc"));
            return Some(advice!(shape, ": expected with ", ncc, format!(" or mle, not {method}")));
        }
        match aspect {
            AspectRatio::Given(aspect) => Self::ASPECTS.fault(aspect),
            _ => None,
        }
    }
}

/// Tracks a dataset by one of the [`METHODS`] and writes the result. Errors: an unknown method; a dataset
/// that lacks data for the method; an existing result; an I/O error.
pub fn track(dataset: &Path, out: impl Into<OutputFile>, options: &TrackOptions) -> Result<Tracked> {
    let out = out.into();
    let start = Instant::now();
    let method = options.check()?;
    out.may_write(options.force)?;
    let place = dataset.into();
    let job = Job::new(&place, options)?;
    let table = (method.run)(&job)?.columns();
    out.save(options.force, table.csv())?;
    let frames = job.recording.frames();
    let (seconds_per_frame, slowest_frame_seconds) = job.frame_seconds().unzip();
    let (warnings, notes) = job.into_messages();
    Ok(Tracked {
        out: out.to_path_buf(),
        method: method.name,
        frames,
        rows: table.rows(),
        seconds: start.elapsed().as_secs_f64(),
        seconds_per_frame,
        slowest_frame_seconds,
        warnings,
        notes,
    })
}

/// Tracks a dataset by one of the [`METHODS`]; returns the result and warnings about it.
pub fn result(dataset: &DatasetPlace, options: &TrackOptions) -> Result<(Columns, Vec<String>)> {
    let method = options.check()?;
    let job = Job::new(dataset, options)?;
    let table = (method.run)(&job)?.columns();
    Ok((table, job.into_messages().0))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_of_methods_are_unique() {
        for (i, a) in METHODS.iter().enumerate() {
            assert!(METHODS[i + 1..].iter().all(|b| a.name != b.name), "{}", a.name);
        }
        let said = method("nnc").unwrap_err().to_string();
        assert!(said.contains("`nnc`") && said.contains("ncc"), "{said}");
    }
}
