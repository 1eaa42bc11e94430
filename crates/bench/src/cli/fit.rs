//! `microsig fit`: fits the settings of a real microscope to its calibration scan.

use std::path::{Path, PathBuf};

use clap::{Args, ValueEnum};

use super::Common;
use super::argument::{folder, input, out_of_range};
use super::choice::choice;
use super::options::{Random, Replace};
use super::output::{progress, summarize, warn};
use arena::report::{field_page, fit_page};
use fit::{
    Astigmatic, ExtraParameter, FieldFit, FieldOptions, FitOptions, Fitted, Given, Scan, StagePositions,
    Verdict, WaveModel, fit, fit_field,
};
use import::ImportOptions;
use microsig_core::render::waves::{Emission, Layers, Lens};
use storage::error::{Error, Result};
use storage::folder::{Earlier, Partial, check_replaceable};
use storage::{InputFile, NumberRange};

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
    /// Step of the stage between planes, um
    #[arg(long, value_name = "UM")]
    z_step: Option<f64>,
    /// Whether stage positions increase away from the lens
    #[arg(long, value_enum, default_value_t = Direction::Auto, value_name = "DIRECTION")]
    z_direction: Direction,
    /// Ratio of depth in the fluid to depth in the model: about the refractive index of the fluid for a dry
    /// objective. Positions are then depths in the fluid; not with --fluid or --field
    #[arg(long, default_value_t = 1.0, value_name = "F")]
    depth_factor: f64,
    /// Refractive index of the medium in the model
    #[arg(long, default_value_t = 1.0, value_name = "N")]
    medium: f64,
    /// Particle diameter, um [default: fitted]
    #[arg(long, value_name = "UM")]
    diameter: Option<f64>,
    /// CSV file with the columns `x_px` and `y_px` of the particles to use [default: detected]
    #[arg(long, value_name = "FILE", value_parser = input())]
    particles: Option<InputFile>,
    /// Whether the microscope has a cylindrical lens
    #[arg(long, value_enum, default_value_t = Cylinder::Auto, value_name = "ANSWER")]
    astigmatic: Cylinder,
    /// Brightness of each plane: fitted (for real objectives), or as the model predicts
    #[arg(long, value_enum, default_value_t = Flux::Free)]
    flux: Flux,
    /// Additional quantities to fit; for experts
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
    /// The objective; for `--model waves`
    #[arg(long, value_parser = choice::<Lens>(), default_value = "aplanatic", value_name = "LENS")]
    lens: Lens,
    /// Refractive index of the fluid below a cover slip of 0.17 mm, whose spherical aberration is fitted; for
    /// `--model waves`. Positions are then depths in the fluid [default: the medium that the objective is designed for]
    #[arg(long, value_name = "N")]
    fluid: Option<f64>,
    /// Depth of the plane in focus below the cover slip, um, from which the fit starts; for `--fluid`
    #[arg(long, value_name = "UM", default_value_t = 100.0, requires = "fluid")]
    fluid_depth: f64,
    /// Fit how the optics vary over the field of view: curvature and tilt of the focus, chief ray, vignetting,
    /// coma, astigmatism, blur; for `--model waves`, with --diameter
    #[arg(long, requires = "diameter")]
    field: bool,
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
    random: Random,
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
    /// Diffraction, with aberrations of the objective; also fits rays and reports which model is better
    Waves,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Flux {
    /// Fitted for each plane
    Free,
    /// As the model predicts
    Model,
}

/// The result of a fit of a field for a terminal.
fn field_text(fitted: &FieldFit, out: &Path) -> String {
    let singles = fitted.particles.iter().filter(|particle| particle.is_single).count();
    let mut text = format!(
        "Optics over the field from the {singles} of {} particles that are single:\n",
        fitted.particles.len()
    );
    for coefficient in &fitted.coefficients {
        let fit::Coefficient { key, value, sd, unit } = coefficient;
        text += &format!("  {key:<34} {value:>10.5} +- {:.5} {unit}\n", 1.96 * sd);
    }
    text += &format!(
        "Images with these coefficients: R^2 {:.4}, chi^2 per pixel {:.2} (noise of one frame)\n{}: report.html, scenario.ron (twin), settings.txt, field.json, particles.csv",
        fitted.r2_of_field,
        fitted.chi2_of_field,
        out.display()
    );
    text
}

/// The allowed values of options.
const RANGES: [NumberRange; 3] = [
    NumberRange { key: "wavelength_um", least: 0.1, most: 2.0, unit: "um" },
    NumberRange { key: "fluid", least: 1.0, most: 4.0, unit: "" },
    NumberRange { key: "fluid_depth_um", least: 0.0, most: 1e5, unit: "um" },
];

impl Fit {
    pub(super) fn run(&self, common: &Common) -> Result<()> {
        let options = self.options(self.random.seed.unwrap_or(0))?;
        let positions = match (&self.z, self.z_step) {
            (Some(file), _) => StagePositions::Table(file.clone()),
            (None, Some(step)) => StagePositions::Step(step),
            (None, None) => StagePositions::FromFile,
        };
        let mut scan = Scan::read(&self.scan, &positions)?;
        if let Some((first, last)) = self.range()? {
            scan = scan.cut(first, last)?;
        }
        if let Some(n) = self.fluid.or((self.depth_factor != 1.0).then_some(self.depth_factor)) {
            let what = "depths in the fluid, not readings of the stage: under a dry objective, multiply those by about";
            warn(&[format!("positions of planes are taken as {what} {n}")], common);
        }
        if self.field {
            return self.run_field(&scan, &options, common);
        }
        let earlier = Earlier::new("fit.json", self.replace.force);
        check_replaceable(&self.out, earlier)?;
        let partial = Partial::start(&self.out)?;
        warn(partial.warning(), common);
        let spinner = progress(common).spinner("fit");
        let made = fit(&scan, &options, &|what| spinner.set_message(format!("fit: {what}")))?;
        spinner.finish();
        let (scan_name, out) = (self.scan.display().to_string(), self.out.display().to_string());
        let page = fit_page(&made.fitted, &made.evidence, &scan_name, &out)?;
        partial.folder().save_bytes("report.html", page)?;
        for (name, bytes) in &made.files {
            partial.folder().save_bytes(name, bytes)?;
        }
        partial.finish(earlier)?;
        warn(&made.fitted.warnings, common);
        summarize(&text(&made.fitted, &self.out), &made.fitted, common)?;
        if made.fitted.verdict == Verdict::NotDescribed {
            return Err(Error::Failed(vec![made.fitted.sentence()]));
        }
        Ok(())
    }

    fn run_field(&self, scan: &Scan, options: &FitOptions, common: &Common) -> Result<()> {
        let (Some(waves), Some(diameter_um)) = (options.waves, options.diameter_um) else {
            return Err(Error::input("--field: expected with --model waves and --diameter"));
        };
        if waves.lens != Lens::Aplanatic {
            return Err(Error::input("--field: expected --lens aplanatic, as of microscope objectives"));
        }
        let options = FieldOptions {
            given: options.given,
            diameter_um,
            direction: options.direction.unwrap_or(1.0),
            waves,
            half_window: options.half_window,
            places_px: match &options.places_px {
                Some(places_px) => places_px.clone(),
                None => import::locate(scan)?,
            },
        };
        let earlier = Earlier::new("field.json", self.replace.force);
        check_replaceable(&self.out, earlier)?;
        let partial = Partial::start(&self.out)?;
        warn(partial.warning(), common);
        let spinner = progress(common).spinner("fit");
        let made = fit_field(scan, &options, &|what| spinner.set_message(format!("fit: {what}")))?;
        spinner.finish();
        let page = field_page(&made, &self.scan.display().to_string(), [scan.width, scan.height])?;
        partial.folder().save_bytes("report.html", page)?;
        for (name, bytes) in &made.files {
            partial.folder().save_bytes(name, bytes)?;
        }
        partial.finish(earlier)?;
        warn(&made.fitted.warnings, common);
        summarize(&field_text(&made.fitted, &self.out), &made.fitted, common)
    }

    fn options(&self, seed: u64) -> Result<FitOptions> {
        let mut problems = Vec::new();
        let mut positive = |name: &str, value: f64, most: f64| {
            if !(value > 0.0 && value <= most) {
                problems.push(format!("--{name} {value}: expected a number > 0, at most {most}"));
            }
        };
        positive("magnification", self.magnification, 1000.0);
        positive("depth-factor", self.depth_factor, 10.0);
        positive("medium", self.medium, 1.4);
        if let Some(diameter) = self.diameter {
            positive("diameter", diameter, 100.0);
        }
        let is_physical = [("fluid", self.fluid.is_some()), ("field", self.field)];
        if let Some((name, _)) = is_physical.iter().find(|(_, given)| *given && self.depth_factor != 1.0) {
            let what = "expected 1, because depths are those in the fluid";
            problems.push(format!("--depth-factor {}: with --{name}, {what}", self.depth_factor));
        }
        if self.model == Model::Geometric {
            let idle = [("wavelength", self.wavelength.is_some()), ("fluid", self.fluid.is_some())];
            let idle = idle.into_iter().filter(|(_, given)| *given);
            problems.extend(idle.map(|(name, _)| format!("--{name}: expected with --model waves only")));
        }
        let ([wavelength, fluid, fluid_depth], pixel_size) = (&RANGES, ImportOptions::PIXEL_SIZE_UM);
        if !pixel_size.allows(self.pixel_size) {
            // The same hint as for scenarios (`scenario::language::read`).
            let um = (self.pixel_size * 1e12).round() / 1e6;
            let hint = format!("; in um, {:e} m is {um}", self.pixel_size);
            let hint = if pixel_size.allows(um) { hint } else { String::new() };
            problems.push(format!("--pixel-size {}: expected a number, {pixel_size}{hint}", self.pixel_size));
        }
        problems.extend(out_of_range(&[
            ("wavelength", self.wavelength, wavelength),
            ("fluid", self.fluid, fluid),
            ("fluid-depth", Some(self.fluid_depth), fluid_depth),
        ]));
        if !problems.is_empty() {
            return Err(Error::Input(problems));
        }
        let places_px = self.particles.as_ref().map(read_positions).transpose()?;
        Ok(FitOptions {
            given: Given {
                magnification: self.magnification,
                pixel_size_um: self.pixel_size,
                ri_medium: self.medium,
                ri_lens: 1.5 * self.medium,
                depth_factor: self.depth_factor,
            },
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
            places_px,
            waves: self.wavelength.map(|wavelength_um| WaveModel {
                wavelength_um,
                emission: self.emission,
                lens: self.lens,
                layers: self.fluid.map(|n_s| Layers {
                    n_s,
                    focus_depth_um: self.fluid_depth,
                    ..Layers::default()
                }),
            }),
            free: self.free.clone(),
            bootstrap: usize::from(self.bootstrap),
            seed,
        })
    }

    fn range(&self) -> Result<Option<(usize, usize)>> {
        let Some(text) = &self.planes else { return Ok(None) };
        let range =
            text.split_once('-').and_then(|(a, b)| Some((a.trim().parse().ok()?, b.trim().parse().ok()?)));
        range.map(Some).ok_or_else(|| Error::input(format!("--planes {text}: expected A-B, such as 3-40")))
    }
}

/// Reads particle positions (px) from a table; rows closer than 3 px in x and y, such as those of several
/// frames, count once.
fn read_positions(file: &InputFile) -> Result<Vec<[f64; 2]>> {
    #[derive(serde::Deserialize)]
    struct Row {
        #[serde(alias = "x", alias = "X")]
        x_px: f64,
        #[serde(alias = "y", alias = "Y")]
        y_px: f64,
    }
    let mut reader = csv::ReaderBuilder::new().trim(csv::Trim::All).from_reader(file.open()?);
    let mut places: Vec<[f64; 2]> = Vec::new();
    for (i, row) in reader.deserialize::<Row>().enumerate() {
        let row = row.map_err(|e| Error::input(format!("{}:{}: {e}", file.display(), i + 2)))?;
        if !(row.x_px.is_finite() && row.y_px.is_finite() && row.x_px >= 1.0 && row.y_px >= 1.0) {
            return Err(Error::input(format!(
                "{}:{}: ({}, {}): expected a position in px on the image, with the first pixel's center at (1, 1)",
                file.display(),
                i + 2,
                row.x_px,
                row.y_px
            )));
        }
        if !places.iter().any(|[x, y]| (x - row.x_px).abs() < 3.0 && (y - row.y_px).abs() < 3.0) {
            places.push([row.x_px, row.y_px]);
        }
    }
    if places.is_empty() {
        return Err(Error::input(format!(
            "{}: no rows: expected the positions of particles",
            file.display()
        )));
    }
    Ok(places)
}

/// The table of parameters and the conclusion as text.
fn text(fitted: &Fitted, out: &Path) -> String {
    let mut lines = vec![format!("{:<22} {:>12} {:>10}  95 % interval", "parameter", "value", "sd")];
    for p in &fitted.parameters {
        let unit = if p.unit.is_empty() { String::new() } else { format!(" {}", p.unit) };
        lines.push(if p.free {
            format!(
                "{:<22} {:>12.5} {:>10.5}  {:.5} to {:.5}{unit}",
                p.name, p.value, p.sd, p.low_95, p.high_95
            )
        } else {
            format!("{:<22} {:>12.5} {:>10}  given{unit}", p.name, p.value, "")
        });
    }
    lines.push(format!(
        "{} particles, {} planes, {} windows rejected; stage positions increase {} the lens",
        fitted.particles.len(),
        fitted.planes.len(),
        fitted.rejected.len(),
        if fitted.direction > 0.0 { "away from" } else { "toward" }
    ));
    lines.extend(fitted.comparison.map(|c| {
        format!(
            "rays: chi2 {:.3}, {:.1} % explained; waves: chi2 {:.3}, {:.1} % explained; {} are better by {:.0} in BIC",
            c.geometric.chi2,
            100.0 * c.geometric.r2,
            c.waves.chi2,
            100.0 * c.waves.r2,
            if c.recommends_waves() { "waves" } else { "rays" },
            (c.geometric.bic - c.waves.bic).abs()
        )
    }));
    lines.push(fitted.sentence());
    let next = format!(": next, `microsig generate {}`", out.join("scenario.ron").display());
    let next = if fitted.verdict == Verdict::NotDescribed { "" } else { &next };
    lines.push(format!("in {}{next}", out.display()));
    lines.join("\n")
}
