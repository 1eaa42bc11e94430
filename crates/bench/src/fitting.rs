//! A fit of a microscope with its report, for the command and for Python.

use std::fmt::Write as _;
use std::path::Path;

use arena::report::{field_page, fit_page};
use fit::{Astigmatic, FieldFiles, FieldFit, FitFiles, FitOptions, Fitted, Scan, Verdict, WaveOptions};
use serde_json::Value;
use storage::advice;
use storage::advice::{flag, option};
use storage::dataset::{ScanParticleRow, TableReader};
use storage::error::{Error, Result};
use storage::folder::{Earlier, Partial, check_replaceable};
use storage::{InputFile, OutputFolder, Progress};

/// A fit of one microscope, or of how its optics vary over the field of view.
#[derive(Debug)]
pub enum FittedScan {
    /// By rays.
    Geometric(Box<FitFiles>),
    /// By waves.
    Waves {
        /// The fit.
        made: Box<FieldFiles>,
        /// Width and height of the images, px.
        size_px: [usize; 2],
    },
}

impl FittedScan {
    /// Fits a scan.
    pub fn of(scan: &Scan, options: &FitOptions, is_field: bool, progress: &Progress) -> Result<Self> {
        FittedScan::check(options, is_field)?;
        let by_waves = by_waves(scan, options, is_field)?;
        let bar = if by_waves.is_some() { progress.percent("% of the fit") } else { progress.spinner("fit") };
        let watch = |what: &str, share: Option<f64>| {
            bar.set_message(what.to_owned());
            share.into_iter().for_each(|share| bar.set_share(share));
        };
        let made = match by_waves {
            None => FittedScan::Geometric(Box::new(fit::fit(scan, options, &watch)?)),
            Some(options) => {
                let made = Box::new(fit::fit_waves(scan, &options, &watch)?);
                FittedScan::Waves { made, size_px: [scan.width, scan.height] }
            }
        };
        bar.finish();
        Ok(made)
    }

    /// Checks the options before the scan is read and the folder claimed.
    pub fn check(options: &FitOptions, is_field: bool) -> Result<()> {
        options.check()?;
        let (waves, geometric) = (option("model").is("waves"), option("model").is("geometric"));
        if options.waves.is_none() {
            let what = advice!(flag("field"), ": expected with ", waves);
            return if is_field { Err(Error::option(what)) } else { Ok(()) };
        }
        if options.given.depth_factor != 1.0 {
            let factor = option("depth_factor").of(options.given.depth_factor);
            let what = ": expected 1, because depths are those in the fluid";
            return Err(Error::option(advice!(factor, " with ", waves, what)));
        }
        let of_rays = [
            ("free", !options.free.is_empty()),
            ("bootstrap", options.bootstrap > 0),
            ("flux", !options.free_flux),
            ("astigmatic", options.astigmatic == Astigmatic::Known(true)),
        ];
        match of_rays.into_iter().find(|(_, is_given)| *is_given) {
            Some((key, _)) => {
                Err(Error::option(advice!(option(key), ": expected with ", geometric, " only")))
            }
            None => Ok(()),
        }
    }

    /// The result, as in `fit.json` or `field.json`.
    pub fn result(&self) -> Result<Value> {
        let result = match self {
            FittedScan::Geometric(made) => serde_json::to_value(&made.fitted),
            FittedScan::Waves { made, .. } => serde_json::to_value(&made.fitted),
        };
        result.map_err(|e| Error::input(e.to_string()))
    }

    /// What should be known about the fit.
    pub fn warnings(&self) -> &[String] {
        match self {
            FittedScan::Geometric(made) => &made.fitted.warnings,
            FittedScan::Waves { made, .. } => &made.fitted.warnings,
        }
    }

    /// Why the fit must not be used, if the model does not describe the scan.
    pub fn failure(&self) -> Option<String> {
        match self {
            FittedScan::Geometric(made) if made.fitted.verdict == Verdict::NotDescribed => {
                Some(made.fitted.sentence())
            }
            FittedScan::Waves { made, .. } if made.fitted.verdict == Verdict::NotDescribed => {
                Some(made.fitted.sentence())
            }
            _ => None,
        }
    }

    /// The names of the files, other than the report, and their contents.
    pub fn files(&self) -> &[(&'static str, Vec<u8>)] {
        match self {
            FittedScan::Geometric(made) => &made.files,
            FittedScan::Waves { made, .. } => &made.files,
        }
    }

    /// The fitted quantities and the conclusion as text.
    pub fn text(&self) -> String {
        match self {
            FittedScan::Geometric(made) => text_of_fit(&made.fitted),
            FittedScan::Waves { made, .. } => text_of_field(&made.fitted),
        }
    }

    /// Writes report and files; `scan` and `out` are the names of scan and folder.
    fn write(&self, folder: &OutputFolder, scan: &str, out: &Path) -> Result<()> {
        let page = match self {
            FittedScan::Geometric(made) => {
                fit_page(&made.fitted, &made.evidence, scan, &out.display().to_string())?
            }
            FittedScan::Waves { made, size_px } => field_page(made, scan, *size_px)?,
        };
        folder.save_bytes("report.html", page)?;
        self.files().iter().try_for_each(|(name, bytes)| folder.save_bytes(name, bytes))
    }
}

/// The folder of a fit, under construction.
#[derive(Debug)]
pub struct FitFolder {
    partial: Partial,
    earlier: Earlier,
}

impl FitFolder {
    /// Claims the folder, before a fit that may take long.
    pub fn start(out: &Path, is_of_waves: bool, force: bool) -> Result<Self> {
        let earlier = Earlier::new(if is_of_waves { "field.json" } else { "fit.json" }, force);
        check_replaceable(out, earlier)?;
        Ok(FitFolder { partial: Partial::start(out)?, earlier })
    }

    /// What should be known about the folder.
    pub fn warning(&self) -> Option<&str> {
        self.partial.warning()
    }

    /// Writes a fit of the scan of this name.
    pub fn finish(self, made: &FittedScan, scan: &str, out: &Path) -> Result<()> {
        made.write(self.partial.folder(), scan, out)?;
        self.partial.finish(self.earlier)
    }
}

/// The options of a fit by waves, if it is one.
fn by_waves(scan: &Scan, options: &FitOptions, is_field: bool) -> Result<Option<WaveOptions>> {
    let Some(waves) = options.waves else { return Ok(None) };
    let all_px = match (import::locate(scan), &options.places_px) {
        (Err(e), None) => return Err(e),
        // Given particles may be too faint to be located.
        (located, _) => located.unwrap_or_default(),
    };
    Ok(Some(WaveOptions {
        given: options.given,
        diameter_um: options.diameter_um,
        direction: options.direction.unwrap_or(1.0),
        waves,
        is_field,
        half_window: options.half_window,
        places_px: options.places_px.clone().unwrap_or_else(|| all_px.clone()),
        all_px,
    }))
}

/// Reads particle positions (px) from a table with the columns `x_px` and `y_px`.
pub fn read_places(file: &InputFile) -> Result<Vec<[f64; 2]>> {
    let mut places = Vec::new();
    let names = [("x", "x_px"), ("X", "x_px"), ("y", "y_px"), ("Y", "y_px")];
    let table = names.iter().fold(TableReader::open(file)?, |table, (own, name)| table.renamed(own, name));
    table.rows(&["x_px", "y_px"], |_, row: ScanParticleRow| {
        let [x, y] = [row.x_px, row.y_px];
        if ![x, y].iter().all(|px| px.is_finite() && *px >= 1.0) {
            let what = "expected a position in px on the image, with the first pixel's center at (1, 1)";
            return Err(format!("({x}, {y}): {what}"));
        }
        places.push([x, y]);
        Ok(())
    })?;
    Ok(places)
}

fn text_of_field(fitted: &FieldFit) -> String {
    let singles = fitted.particles.iter().filter(|particle| particle.is_single).count();
    let mut text =
        format!("Optics from the {singles} of {} particles that are single:\n", fitted.particles.len());
    for coefficient in &fitted.coefficients {
        let fit::Coefficient { key, value, sd, unit } = coefficient;
        // Writing to a string cannot fail.
        let _ = writeln!(text, "  {key:<34} {value:>10.5} +- {:.5} {unit}", 1.96 * sd);
    }
    let (r2, chi2) = (fitted.r2_of_field, fitted.chi2_of_field);
    let _ = write!(
        text,
        "Images with these coefficients: R^2 {r2:.4}, chi^2 per pixel {chi2:.2} (noise of one frame)\n{}",
        fitted.sentence()
    );
    text
}

fn text_of_fit(fitted: &Fitted) -> String {
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
    lines.push(fitted.sentence());
    lines.join("\n")
}
