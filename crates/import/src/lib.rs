//! Your own recordings as folders that are read like datasets.
//!
//! The images stay as they were recorded (`frames`), the calibration stacks are averages of particles of a
//! scan (`particles`, `alignment`, `stacks`), the noise comes from its repeated frames (`stacks`), and
//! the truth is what is known: heights of planes, positions of particles (`known`). Trackers, scores and
//! views read such a folder as they read a dataset; `kind: recording` in its manifest tells the difference.
#![allow(missing_docs, reason = "the command is what users see; fields are named after what they are")]

mod alignment;
mod card;
mod correction;
mod extent;
mod files;
mod frames;
mod known;
mod located;
mod manifest;
mod optics;
mod particles;
mod stacks;

use std::ops::RangeInclusive;
use std::path::{Path, PathBuf};

use clap::Args;
use clap::builder::RangedU64ValueParser;
use microsig_core::render::Context;
use serde::Serialize;

use correction::Correction;
use fit::{Given, Scan, StagePositions};
use frames::Frames;
use known::Known;
use storage::advice;
use storage::advice::option;
use storage::argument::input;
use storage::dataset::manifest::{MANIFEST, NoiseFacts, PlaceFacts};
use storage::error::{Error, Result};
use storage::folder::{Earlier, Partial, check_replaceable};
use storage::{InputFile, NumberRange, Progress};

#[derive(Debug, Clone, Args)]
pub struct ImportOptions {
    /// The recorded images: TIFF files of 8 or 16 bit with one page or many, folders, or names with `*` and
    /// `?`; in natural order
    #[arg(long, value_name = "PATH", required = true, num_args = 1..)]
    pub images: Vec<PathBuf>,
    /// Pages that belong to one time, such as channels [default: as the file says, otherwise 1]
    #[arg(long, value_name = "N")]
    pub pages_per_time: Option<usize>,
    /// Which of these pages is the image, from 0; also the channel of a scan that states several
    #[arg(long, value_name = "K")]
    pub page: Option<usize>,
    /// The calibration scan, of the same field of view: a multi-page TIFF (8 or 16 bit), or a folder of TIFF
    /// files; without one, images in focus, for `piv` and `spots`
    #[arg(long, value_name = "PATH")]
    pub scan: Option<PathBuf>,
    /// Stage positions of the scan.
    #[arg(skip = StagePositions::FromFile)]
    pub positions: StagePositions,
    /// Stage positions increase toward the lens, not away from it
    #[arg(long = "z-toward")]
    pub toward_lens: bool,
    /// A scenario with the optics, such as `microsig fit` writes; for `mle`
    #[arg(long, value_name = "SCENARIO", value_parser = input())]
    pub optics: Option<InputFile>,
    /// Edge of a pixel in object space, um; taken from the optics if `None`.
    #[arg(skip)]
    pub um_per_px: Option<f64>,
    /// Time between frames (with `--pairs` between the two of a pair), s
    #[arg(long = "dt", value_name = "S")]
    pub dt_s: Option<f64>,
    /// Frames 2k and 2k + 1 are an image pair; files whose names differ in a and b only are paired by these
    #[arg(long)]
    pub pairs: bool,
    /// What is known: a CSV file with `frame, z_um` (the height of a plane that all particles are in), or with
    /// `frame, x_px, y_px` and perhaps `z_um, track` (positions of particles)
    #[arg(long, value_name = "FILE", num_args = 1.., value_parser = input())]
    pub truth: Vec<InputFile>,
    /// The known positions include all particles of their frames, so that ghosts can be counted
    #[arg(long, requires = "truth")]
    pub all_particles: bool,
    /// An image without light, or several pages of it, to be subtracted
    #[arg(long, value_name = "FILE")]
    pub dark: Option<PathBuf>,
    /// An image of uniform light, or several pages of it, to be divided by
    #[arg(long, value_name = "FILE")]
    pub flat: Option<PathBuf>,
    /// Calibration stacks at N x N places of the field of view
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = whole(1..=ImportOptions::LARGEST_FIELD as u64))]
    pub field: usize,
    /// Largest number of particles that are averaged to a calibration stack
    #[arg(long, value_name = "N", default_value_t = ImportOptions::PARTICLES, value_parser = whole(1..=1000))]
    pub particles: usize,
    /// Width of the calibration images, px [default: chosen from the images]
    #[arg(long = "window", value_name = "PX", value_parser = whole(11..=1023))]
    pub window_px: Option<usize>,
    /// Copy images that could be linked
    #[arg(long)]
    pub copy: bool,
    /// Replace existing output
    #[arg(long, short)]
    pub force: bool,
    #[arg(skip)]
    pub progress: Progress,
    #[arg(skip)]
    pub context: Context,
}

/// Parser of a whole number.
fn whole(range: RangeInclusive<u64>) -> RangedU64ValueParser<usize> {
    RangedU64ValueParser::new().range(range)
}

impl ImportOptions {
    /// Default of `particles`.
    pub const PARTICLES: usize = 6;
    /// Largest `field`.
    pub const LARGEST_FIELD: usize = 9;

    /// The allowed values: of the two numbers that give `um_per_px`, of `dt_s`, and of a step of the scan up to its sign.
    pub const RANGES: [NumberRange; 4] = [
        Given::MAGNIFICATIONS,
        Given::PIXEL_SIZES_UM,
        NumberRange { key: "dt_s", least: 1e-9, most: 1e6, unit: "s" },
        NumberRange { key: "z_step_um", least: 1e-4, most: 1e4, unit: "um" },
    ];
}

#[derive(Debug, Clone, Serialize)]
pub struct Imported {
    pub out: PathBuf,
    pub frames: usize,
    /// Number of images that are hard links to the given files.
    pub linked: usize,
    /// Number of images that are copies of the given files.
    pub copied: usize,
    /// Number of images written from a page of a file, or after a correction.
    pub written: usize,
    /// Depths of the calibration stacks.
    pub depths: usize,
    /// Places of the calibration stacks, with the number of their particles.
    pub places: Vec<PlaceFacts>,
    /// Particles of the scan that are not used, and why.
    pub unused: Unused,
    /// Noise of a frame; `None` without a scan.
    pub noise: Option<NoiseFacts>,
    pub warnings: Vec<String>,
}

/// Numbers of particles of a scan that are not used.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize)]
pub struct Unused {
    /// Cut by the edge of the image.
    pub cut: usize,
    /// Too close to others.
    pub crowded: usize,
    /// With saturated pixels.
    pub saturated: usize,
    /// Unlike the others, as two particles side by side are.
    pub unlike: usize,
}

/// Imports a recording into a new folder, which is complete or not there.
/// Errors: input that cannot be used, by file, page or line, and value; an existing folder, unless `force`; writing.
pub fn import(out: &Path, options: &ImportOptions) -> Result<Imported> {
    if options.scan.is_none() {
        needs_scan(options)?;
    }
    let earlier = Earlier::new(MANIFEST, options.force);
    check_replaceable(out, earlier)?;
    let spinner = options.progress.spinner("reading the scan");
    let optics = options.optics.as_ref();
    let optics = optics.map(|file| optics::Optics::read(file, &options.context)).transpose()?;
    let um_per_px =
        options.um_per_px.or(optics.as_ref().map(optics::Optics::um_per_px)).ok_or_else(|| {
            Error::option(advice!(
                "the size of a pixel in object space is unknown: give ",
                option("pixel_size_um"),
                " and ",
                option("magnification"),
                ", or ",
                option("optics"),
                ", a scenario of `microsig fit`"
            ))
        })?;
    let scan = options.scan.as_deref().map(|file| scan_of(file, options).map(|scan| (file, scan)));
    let mut scan: Option<(&Path, Scan)> = scan.transpose()?;
    let size = scan.as_ref().map(|(_, scan)| (scan.width, scan.height));
    let frames = Frames::find(options, size)?;
    let size = (frames.size().width as usize, frames.size().height as usize);
    let correction = Correction::read(options, size)?;
    if let Some((_, scan)) = &mut scan {
        scan.planes.iter_mut().for_each(|plane| correction.apply(plane));
        if options.toward_lens {
            scan.stage_um.iter_mut().for_each(|z| *z = -*z);
        }
    }
    let known = Known::read(&options.truth, options.all_particles, frames.len(), size)?;
    spinner.set_message("particles of the scan");
    let mut warnings = scan.as_ref().map_or_else(Vec::new, |(_, scan)| scan.warnings.clone());
    let made = scan.as_ref().map(|(file, scan)| stacks::Stacks::cut(scan, file, options)).transpose()?;
    let noise = scan
        .as_ref()
        .zip(made.as_ref())
        .map(|((_, scan), made)| stacks::noise_of_scan(scan, made.background));
    warnings.extend(made.iter().flat_map(|made| made.warnings.iter().cloned()));
    let model =
        optics.as_ref().zip(made.as_ref()).map(|(optics, made)| optics.at(made, &spinner)).transpose()?;
    warnings.extend(model.iter().filter_map(optics::Model::warning));
    spinner.finish();

    let partial = Partial::start(out)?;
    let folder = partial.folder();
    options.progress.warn(partial.warning());
    let mut written = frames.write(folder, um_per_px, &correction, options)?;
    if let Some(noise) = &noise {
        let deviation = noise.variance.first().map_or(0.0, |variance| libm::sqrt(*variance));
        let [own, scan] = [written.background[0], noise.background_counts];
        if (own - scan).abs() > deviation {
            written.warnings.push(format!(
                "the background is {own:.1} counts, in the scan {scan:.1}: stray light, particles far from focus or another \
                 offset add noise that the scan does not show"
            ));
        }
        written.background = [noise.background_counts, deviation];
    }
    warnings.extend(written.warnings.iter().cloned());
    if let Some(made) = &made {
        made.write(folder, um_per_px, model.as_ref())?;
    }
    known.write(folder, &frames, options.dt_s)?;
    let about = manifest::About {
        name: name(out),
        um_per_px,
        options,
        frames: &frames,
        written: &written,
        made: made.as_ref(),
        noise: noise.as_ref(),
        known: &known,
        model: model.as_ref(),
        correction: correction.clause(),
    };
    card::write(folder, &about)?;
    manifest::seal(&partial, &about)?;
    partial.finish_without_journal(earlier)?;
    Ok(Imported {
        out: out.to_owned(),
        frames: frames.len(),
        linked: written.linked,
        copied: written.copied,
        written: written.written,
        depths: made.as_ref().map_or(0, |made| made.depths_um.len()),
        places: made.iter().flat_map(|made| &made.places).map(|stack| stack.place).collect(),
        unused: made.map_or_else(Unused::default, |made| made.unused),
        noise,
        warnings,
    })
}

/// Refuses options that say something about a scan that is not given.
fn needs_scan(options: &ImportOptions) -> Result<()> {
    let given = [
        ("z", !matches!(options.positions, StagePositions::FromFile)),
        ("z_toward", options.toward_lens),
        ("optics", options.optics.is_some()),
        ("field", options.field > 1),
        ("window_px", options.window_px.is_some()),
    ];
    match given.into_iter().find(|(_, is_given)| *is_given) {
        None => Ok(()),
        Some((key, _)) => {
            Err(Error::option(advice!(option(key), ": expected with ", option("scan"), " only")))
        }
    }
}

fn scan_of(file: &Path, options: &ImportOptions) -> Result<Scan> {
    // A scan of one channel has no other page.
    let channel = match options.page {
        Some(page) if Scan::channels(file)? > 1 => Some(page),
        _ => None,
    };
    Scan::read(file, &options.positions, channel)
}

/// Positions of all particles of a scan, px, with the first pixel's center at (1, 1), most contrast first.
pub fn locate(scan: &Scan) -> Result<Vec<[f64; 2]>> {
    let located = located::Located::of(scan, &scan.levels())?;
    Ok(located.places.into_iter().map(|at| at.map(|at| at + 1.0)).collect())
}

fn name(out: &Path) -> String {
    out.file_name().map_or_else(|| "recording".to_owned(), |name| name.to_string_lossy().into_owned())
}
