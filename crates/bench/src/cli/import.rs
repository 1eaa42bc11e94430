//! `microsig import`: a recording of one's own as a folder like a dataset.

use std::path::{Path, PathBuf};

use clap::Args;

use super::Common;
use super::options::ImageTables;
use super::output::{progress, summarize, warn};
use fit::StagePositions;
use import::{ImportOptions, Imported, import};
use storage::InputFile;
use storage::argument::{folder, input};
use storage::error::{Error, Result};
use storage::range::faults;

/// Make a folder like a dataset's from recorded images, with a calibration scan or without
#[derive(Debug, Args)]
#[command(
    after_help = "Example: microsig import --images 'run3/*.tif' --scan scan.tif --z z.csv --magnification 10 --pixel-size 16 --out recording"
)]
pub(super) struct Import {
    #[command(flatten)]
    options: ImportOptions,
    /// Stage positions of the scan: a CSV file with the columns `page` (from 0) or `image`, and `z_um`;
    /// several pages may have the same position
    #[arg(long, value_name = "FILE", conflicts_with = "z_step", value_parser = input())]
    z: Option<InputFile>,
    /// Step of the stage between planes, um
    #[arg(long, value_name = "UM")]
    z_step: Option<f64>,
    /// Magnification of the microscope [default: from the optics]
    #[arg(long, value_name = "M", requires = "pixel_size")]
    magnification: Option<f64>,
    /// Edge of a pixel on the sensor, um [default: from the optics]
    #[arg(long, value_name = "UM", requires = "magnification")]
    pixel_size: Option<f64>,
    /// Output folder
    #[arg(long, short, value_name = "DIR", value_parser = folder())]
    out: PathBuf,
    #[command(flatten)]
    tables: ImageTables,
}

impl Import {
    pub(super) fn run(&self, common: &Common) -> Result<()> {
        let options = self.options(common)?;
        let made = import(&self.out, &options)?;
        warn(&made.warnings, common);
        summarize(&text(&made, &options), &made, common)
    }

    fn options(&self, common: &Common) -> Result<ImportOptions> {
        let [magnification, pixel_size, dt, step] = ImportOptions::RANGES;
        let wrong = faults(&[
            (self.magnification, magnification),
            (self.pixel_size, pixel_size),
            (self.options.dt_s, dt),
            (self.z_step.map(f64::abs), step),
        ]);
        if !wrong.is_empty() {
            return Err(Error::Options(wrong));
        }
        let positions = match (&self.z, self.z_step) {
            (Some(file), _) => StagePositions::Table(file.clone()),
            (None, Some(step)) => StagePositions::Step(step),
            (None, None) => StagePositions::FromFile,
        };
        Ok(ImportOptions {
            positions,
            um_per_px: self.pixel_size.zip(self.magnification).map(|(pixel, m)| pixel / m),
            progress: progress(common),
            context: common.context.clone(),
            ..self.options.clone()
        })
    }
}

fn text(made: &Imported, options: &ImportOptions) -> String {
    let how = [(made.linked, "linked"), (made.copied, "copied"), (made.written, "written")];
    let how: Vec<String> = how.iter().filter(|(n, _)| *n > 0).map(|(n, how)| format!("{n} {how}")).collect();
    let frames = format!("{} images ({})", made.frames, how.join(", "));
    if options.scan.is_none() {
        let out = shown(&made.out);
        return format!("{frames}, without calibration, in {out}; next, `microsig track {out} --method piv`");
    }
    let counts: Vec<String> = made.places.iter().map(|p| p.particles.unwrap_or(0).to_string()).collect();
    let stacks = if options.field > 1 {
        format!("stacks at {} of {} places", made.places.len(), options.field * options.field)
    } else {
        "one stack".to_owned()
    };
    let unused = made.unused;
    let next = format!("microsig track {} --method ncc", shown(&made.out));
    format!(
        "{frames}, {stacks} with {} depths, averages of {} particles ({} cut by the edge, {} crowded, {} saturated, {} unlike \
         the others are left out), in {}; next, `{next}`",
        made.depths,
        counts.join(" + "),
        unused.cut,
        unused.crowded,
        unused.saturated,
        unused.unlike,
        shown(&made.out),
    )
}

fn shown(path: &Path) -> String {
    path.display().to_string()
}
