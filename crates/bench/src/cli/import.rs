//! `microsig import`: a recording of one's own as a folder like a dataset.

use std::path::{Path, PathBuf};

use clap::Args;

use super::Common;
use super::argument::{folder, input};
use super::options::{ImageTables, Replace};
use super::output::{progress, summarize, warn};
use fit::StagePositions;
use import::{ImportOptions, Imported, import};
use storage::InputFile;
use storage::error::{Error, Result};
use storage::range::faults;

/// Make a folder like a dataset's from recorded images, with a calibration scan or without
#[derive(Debug, Args)]
#[command(
    after_help = "Example: microsig import --images 'run3/*.tif' --scan scan.tif --z z.csv --magnification 10 --pixel-size 16 --out recording"
)]
pub(super) struct Import {
    /// The recorded images: TIFF files of 8 or 16 bit with one page or many, folders, or names with `*` and
    /// `?`; in natural order
    #[arg(long, value_name = "PATH", required = true, num_args = 1..)]
    images: Vec<PathBuf>,
    /// Pages that belong to one time, such as channels [default: as the file says, otherwise 1]
    #[arg(long, value_name = "N")]
    pages_per_time: Option<u32>,
    /// Which of these pages is the image, from 0; also the channel of a scan that states several
    #[arg(long, value_name = "K")]
    page: Option<u32>,
    /// The calibration scan, of the same field of view: a multi-page TIFF (8 or 16 bit), or a folder of TIFF
    /// files; without one, images in focus, for `piv` and `spots`
    #[arg(long, value_name = "PATH")]
    scan: Option<PathBuf>,
    /// Stage positions of the scan: a CSV file with the columns `page` (from 0) or `image`, and `z_um`;
    /// several pages may have the same position
    #[arg(long, value_name = "FILE", conflicts_with = "z_step", value_parser = input())]
    z: Option<InputFile>,
    /// Step of the stage between planes, um
    #[arg(long, value_name = "UM")]
    z_step: Option<f64>,
    /// Stage positions increase toward the lens, not away from it
    #[arg(long)]
    z_toward: bool,
    /// A scenario with the optics, such as `microsig fit` writes; for `mle`
    #[arg(long, value_name = "SCENARIO", value_parser = input())]
    optics: Option<InputFile>,
    /// Magnification of the microscope [default: from the optics]
    #[arg(long, value_name = "M", requires = "pixel_size")]
    magnification: Option<f64>,
    /// Edge of a pixel on the sensor, um [default: from the optics]
    #[arg(long, value_name = "UM", requires = "magnification")]
    pixel_size: Option<f64>,
    /// Time between frames (with `--pairs` between the two of a pair), s
    #[arg(long, value_name = "S")]
    dt: Option<f64>,
    /// Frames 2k and 2k + 1 are an image pair; files whose names differ in a and b only are paired by these
    #[arg(long)]
    pairs: bool,
    /// What is known: a CSV file with `frame, z_um` (the height of a plane that all particles are in), or with
    /// `frame, x_px, y_px` and perhaps `z_um, track` (positions of particles)
    #[arg(long, value_name = "FILE", num_args = 1.., value_parser = input())]
    truth: Vec<InputFile>,
    /// The known positions include all particles of their frames, so that ghosts can be counted
    #[arg(long, requires = "truth")]
    all_particles: bool,
    /// An image without light, or several pages of it, to be subtracted
    #[arg(long, value_name = "FILE")]
    dark: Option<PathBuf>,
    /// An image of uniform light, or several pages of it, to be divided by
    #[arg(long, value_name = "FILE")]
    flat: Option<PathBuf>,
    /// Calibration stacks at N x N places of the field of view
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u8).range(1..=ImportOptions::LARGEST_FIELD as i64))]
    field: u8,
    /// Largest number of particles that are averaged to a calibration stack
    #[arg(long, value_name = "N", default_value_t = ImportOptions::PARTICLES as u16, value_parser = clap::value_parser!(u16).range(1..=1000))]
    particles: u16,
    /// Width of the calibration images, px [default: chosen from the images]
    #[arg(long, value_name = "PX", value_parser = clap::value_parser!(u16).range(11..=1023))]
    window: Option<u16>,
    /// Copy images that could be linked
    #[arg(long)]
    copy: bool,
    /// Output folder
    #[arg(long, short, value_name = "DIR", value_parser = folder())]
    out: PathBuf,
    #[command(flatten)]
    replace: Replace,
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
            (self.dt, dt),
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
            images: self.images.clone(),
            pages_per_time: self.pages_per_time.map(|n| n as usize),
            page: self.page.map(|k| k as usize),
            scan: self.scan.clone(),
            positions,
            toward_lens: self.z_toward,
            optics: self.optics.clone(),
            um_per_px: self.pixel_size.zip(self.magnification).map(|(pixel, m)| pixel / m),
            dt_s: self.dt,
            pairs: self.pairs,
            truth: self.truth.clone(),
            all_particles: self.all_particles,
            dark: self.dark.clone(),
            flat: self.flat.clone(),
            field: usize::from(self.field),
            particles: usize::from(self.particles),
            window_px: self.window.map(usize::from),
            copy: self.copy,
            force: self.replace.force,
            progress: progress(common),
            context: common.context.clone(),
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
