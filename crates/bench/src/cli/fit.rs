//! `microsig fit`: fits the settings of a real microscope to its calibration scan.

use std::path::PathBuf;

use clap::{Args, ValueEnum};

use super::Common;
use super::options::{Drawing, Replace};
use super::output::{progress, summarize, warn};
use crate::fitting::{FitFolder, FittedScan, read_places};
use fit::{Astigmatic, ExtraParameter, FitOptions, Given, Scan, StagePositions, WaveModel};
use microsig_core::render::waves::{Emission, Layers};
use storage::InputFile;
use storage::advice;
use storage::advice::option;
use storage::argument::{choice, folder, input};
use storage::error::{Error, Result};

/// Fit the settings of a real microscope to its calibration scan
#[derive(Debug, Args)]
#[command(
    after_help = "Example: microsig fit scan.tif --z z.csv --magnification 10 --pixel-size 6.45 --out fitted"
)]
pub(super) struct Fit {
    /// A multi-page TIFF (8 or 16 bit), or a folder of TIFF files in natural order
    scan: PathBuf,
    /// Magnification of the microscope
    #[arg(long, value_name = "M")]
    magnification: f64,
    /// Edge of a pixel on the sensor, um
    #[arg(long, value_name = "UM")]
    pixel_size: f64,
    /// Positions of the planes: a CSV file with the columns `page` (from 0) or `image`, and `z_um`, the distance
    /// by which the particles moved along the axis, in their medium
    #[arg(long, value_name = "FILE", conflicts_with = "z_step", value_parser = input())]
    z: Option<InputFile>,
    /// Step of the stage between planes, um; frames that the file states to be of one plane share a position
    #[arg(long, value_name = "UM")]
    z_step: Option<f64>,
    /// Whether stage positions increase away from the lens
    #[arg(long, value_enum, default_value_t = Direction::Auto, value_name = "DIRECTION")]
    z_direction: Direction,
    /// Ratio of depth in the fluid to depth in the model: about the refractive index of the fluid for a dry
    /// objective. Positions are then depths in the fluid; not with --model waves
    #[arg(long, default_value_t = 1.0, value_name = "F")]
    depth_factor: f64,
    /// Refractive index of the medium in the model
    #[arg(long, default_value_t = 1.0, value_name = "N")]
    medium: f64,
    /// Particle diameter, um [default: fitted; with `--model waves`, it then includes the blur of the camera]
    #[arg(long, value_name = "UM")]
    diameter: Option<f64>,
    /// CSV file with the columns `x_px` and `y_px` of the particles to use [default: detected]
    #[arg(long, value_name = "FILE", value_parser = input())]
    particles: Option<InputFile>,
    /// Whether the microscope has a cylindrical lens
    #[arg(long, value_enum, default_value_t = Cylinder::Auto, value_name = "ANSWER")]
    astigmatic: Cylinder,
    /// Brightness of each plane: fitted (for real objectives), or as the ray model predicts
    #[arg(long, value_enum, default_value_t = Flux::Free)]
    flux: Flux,
    /// Additional quantities to fit, for experts; for `--model geometric`
    #[arg(long, value_parser = choice::<ExtraParameter>(), value_delimiter = ',', value_name = "KEYS")]
    free: Vec<ExtraParameter>,
    /// Optical model of the images
    #[arg(long, value_enum, default_value_t = Model::Geometric)]
    model: Model,
    /// Wavelength in vacuum, um; for `--model waves`
    #[arg(long, value_name = "UM", required_if_eq("model", "waves"))]
    wavelength: Option<f64>,
    /// The part of a particle that emits light; for `--model waves`
    #[arg(long, value_parser = choice::<Emission>(), default_value = "surface", value_name = "PART")]
    emission: Emission,
    /// Refractive index of the fluid below a cover slip of 0.17 mm, for the spherical aberration it causes; for
    /// `--model waves`. Positions are then depths in the fluid [default: the medium that the objective is designed for]
    #[arg(long, value_name = "N")]
    fluid: Option<f64>,
    /// Depth of the plane in focus below the cover slip, um; for `--fluid`
    #[arg(long, value_name = "UM", default_value_t = Layers::default().focus_depth_um, requires = "fluid")]
    fluid_depth: f64,
    /// Fit how the optics vary over the field of view: curvature and tilt of the focus, chief ray, vignetting,
    /// coma, astigmatism; for `--model waves`
    #[arg(long)]
    field: bool,
    /// The channel with the particles, from 0, if the file states several
    #[arg(long, value_name = "K")]
    page: Option<usize>,
    /// Planes to use, counted from 0
    #[arg(long, value_name = "A-B")]
    planes: Option<String>,
    /// Width of the window around each particle, px [default: chosen from the images]
    #[arg(long, value_name = "PX", value_parser = clap::value_parser!(u16).range(7..=129))]
    window: Option<u16>,
    /// Number of bootstrap resamples of the particles for a second estimate of standard deviations
    #[arg(long, value_name = "N", default_value_t = 0, value_parser = clap::value_parser!(u16).range(0..=10_000))]
    bootstrap: u16,
    /// Output folder for settings, parameters and images of the model
    #[arg(long, short, value_name = "DIR", value_parser = folder())]
    out: PathBuf,
    #[command(flatten)]
    drawing: Drawing,
    #[command(flatten)]
    replace: Replace,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Direction {
    /// Determined from the images
    Auto,
    /// Away from the lens
    Away,
    /// Toward the lens
    Toward,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Cylinder {
    /// Determined from the images
    Auto,
    /// With a cylindrical lens
    Yes,
    /// Without a cylindrical lens
    No,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Model {
    /// Rays, for images far from focus
    Geometric,
    /// Diffraction, with aberrations of the objective
    Waves,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Flux {
    /// Fitted for each plane
    Free,
    /// As the model predicts
    Model,
}

impl Fit {
    pub(super) fn run(&self, common: &Common) -> Result<()> {
        let options = self.options(self.drawing.seed)?;
        let positions = match (&self.z, self.z_step) {
            (Some(file), _) => StagePositions::Table(file.clone()),
            (None, Some(step)) => StagePositions::Step(step),
            (None, None) => StagePositions::FromFile,
        };
        let mut scan = Scan::read(&self.scan, &positions, self.page)?;
        if let Some((first, last)) = self.range()? {
            scan = scan.cut(first, last)?;
        }
        warn(options.warning(), common);
        let folder = FitFolder::start(&self.out, options.waves.is_some(), self.replace.force)?;
        warn(folder.warning(), common);
        let made = FittedScan::of(&scan, &options, self.field, &progress(common))?;
        folder.finish(&made, &self.scan.display().to_string(), &self.out)?;
        warn(made.warnings(), common);
        let out = self.out.display();
        let next = match made.failure() {
            None => format!(": next, `microsig generate {}`", self.out.join("scenario.ron").display()),
            Some(_) => String::new(),
        };
        summarize(&format!("{}\nin {out}{next}", made.text()), &made.result()?, common)?;
        made.failure().map_or(Ok(()), |failure| Err(Error::Failed(vec![failure])))
    }

    fn options(&self, seed: u64) -> Result<FitOptions> {
        if self.model == Model::Geometric {
            let idle = [("wavelength_um", self.wavelength.is_some()), ("fluid", self.fluid.is_some())];
            if let Some((key, _)) = idle.into_iter().find(|(_, is_given)| *is_given) {
                let waves = option("model").is("waves");
                return Err(Error::option(advice!(option(key), ": expected with ", waves, " only")));
            }
        }
        let options = FitOptions {
            given: Given::new(self.magnification, self.pixel_size, self.medium, self.depth_factor),
            diameter_um: self.diameter,
            direction: match self.z_direction {
                Direction::Auto => None,
                Direction::Away => Some(1.0),
                Direction::Toward => Some(-1.0),
            },
            astigmatic: match self.astigmatic {
                Cylinder::Auto => Astigmatic::Auto,
                Cylinder::Yes => Astigmatic::Known(true),
                Cylinder::No => Astigmatic::Known(false),
            },
            free_flux: self.flux == Flux::Free,
            half_window: self.window.map(|width| usize::from(width) / 2),
            places_px: None,
            waves: self.wavelength.map(|wavelength_um| WaveModel {
                wavelength_um,
                emission: self.emission,
                layers: self.fluid.map(|n_s| Layers {
                    n_s,
                    focus_depth_um: self.fluid_depth,
                    ..Layers::default()
                }),
            }),
            free: self.free.clone(),
            bootstrap: usize::from(self.bootstrap),
            seed,
        };
        FittedScan::check(&options, self.field)?;
        Ok(FitOptions { places_px: self.particles.as_ref().map(read_places).transpose()?, ..options })
    }

    fn range(&self) -> Result<Option<(usize, usize)>> {
        let Some(text) = &self.planes else { return Ok(None) };
        let range =
            text.split_once('-').and_then(|(a, b)| Some((a.trim().parse().ok()?, b.trim().parse().ok()?)));
        let wrong = || Error::option(advice!(option("planes").of(text), ": expected A-B, such as 3-40"));
        range.map(Some).ok_or_else(wrong)
    }
}
