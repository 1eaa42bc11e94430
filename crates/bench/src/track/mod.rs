//! Baseline trackers: what a plain method of each school finds in a dataset.
//!
//! They see what a participant sees: images, the calibration stack, the optics. The anchors are the exception, made from
//! the truth to show what a score looks like for a result of known quality. Definitions and measured scores are in
//! docs/baselines.md.

mod anchors;
mod aptv;
mod fit;
mod fourier;
mod link;
mod maps;
mod ncc;
mod output;
mod picture;
mod piv;
mod recording;
mod spots;
mod templates;

use std::path::{Path, PathBuf};
use std::time::Instant;

use clap::ValueEnum;
use rayon::prelude::*;
use serde::Serialize;

use crate::error::{Error, Result};
use output::Output;
use picture::Picture;
use recording::Recording;

/// A method.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Method {
    /// Spots of about one size, in the image plane (Laplacian of Gaussian), linked
    Spots,
    /// Depth by correlation with the calibration stack (GDPT), linked
    Ncc,
    /// Depth from the two widths of astigmatic particle images, linked
    Aptv,
    /// Displacement field by correlation of windows
    Piv,
    /// Anchor: the visible truth with normal noise added
    TruthNoise,
    /// Anchor: the visible truth one pixel off along x and y
    Offset,
    /// Anchor: a displacement field of zeros
    Static,
    /// Anchor: nothing found
    Empty,
}

/// How to track.
#[derive(Debug, Clone)]
pub struct Options {
    /// The method.
    pub method: Method,
    /// Longest way from frame to frame, px.
    pub max_displacement_px: f64,
    /// Diameter of a spot, px.
    pub diameter_px: f64,
    /// Standard deviation that [`Method::TruthNoise`] adds in x and y, px.
    pub noise_px: f64,
    /// Standard deviation that [`Method::TruthNoise`] adds in z, um.
    pub noise_um: f64,
    /// Seed of that noise.
    pub seed: u64,
    /// Whether a result that exists is replaced.
    pub force: bool,
}

/// What was found.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Tracked {
    /// The result's file.
    pub out: PathBuf,
    /// The method.
    pub method: Method,
    /// Frames that were looked at.
    pub frames: usize,
    /// Rows of the result.
    pub rows: usize,
    /// Duration, s.
    pub seconds: f64,
    /// What should be known about the result.
    pub warnings: Vec<String>,
}

/// A particle found in a frame, in pixels of the dataset (the first pixel's centre is 1).
#[derive(Debug, Clone, Copy, PartialEq)]
struct Found {
    x_px: f64,
    y_px: f64,
    /// `None` for methods of the image plane.
    z_um: Option<f64>,
}

/// Runs a baseline on a dataset and writes its result.
///
/// # Errors
/// A dataset without what the method needs; a result that exists; writing.
pub fn track(dataset: &Path, out: &Path, options: &Options) -> Result<Tracked> {
    let start = Instant::now();
    if out.exists() && !options.force {
        return Err(Error::Exists(out.to_owned()));
    }
    let recording = Recording::open(dataset)?;
    let mut warnings = Vec::new();
    let output = match options.method {
        Method::Spots => {
            let finder = spots::Finder::new(options.diameter_px);
            linked(&recording, options, |picture| finder.find(picture))?
        }
        Method::Ncc => {
            let stack = ncc::Stack::new(&recording.calibration()?);
            linked(&recording, options, |picture| stack.find(picture))?
        }
        Method::Aptv => {
            let curve = aptv::Curve::new(&recording.calibration()?)?;
            warnings.extend(curve.warning());
            linked(&recording, options, |picture| curve.find(picture))?
        }
        Method::Piv => fields(&recording, piv::displacements)?,
        Method::Static => fields(&recording, piv::zeros)?,
        Method::TruthNoise => anchors::noisy(dataset, options)?,
        Method::Offset => anchors::offset(dataset)?,
        Method::Empty => Output::Points(Vec::new()),
    };
    let rows = output.write(out)?;
    Ok(Tracked {
        out: out.to_owned(),
        method: options.method,
        frames: recording.frames(),
        rows,
        seconds: start.elapsed().as_secs_f64(),
        warnings,
    })
}

/// Finds particles in every frame and links them.
fn linked(
    recording: &Recording,
    options: &Options,
    find: impl Fn(&Picture) -> Vec<Found> + Sync,
) -> Result<Output> {
    let frames: Vec<Vec<Found>> = (0..recording.frames())
        .into_par_iter()
        .map(|k| Ok(find(&recording.frame(k)?)))
        .collect::<Result<_>>()?;
    let reach = link::Reach { px: options.max_displacement_px, um: recording.depth_h_um() };
    Ok(Output::Points(link::link(&frames, reach, recording.pairs())))
}

/// Finds the displacement field of every pair of frames.
fn fields(
    recording: &Recording,
    measure: impl Fn(&Picture, &Picture) -> Vec<piv::Vector> + Sync,
) -> Result<Output> {
    let step = if recording.pairs() { 2 } else { 1 };
    let firsts: Vec<usize> = (0..recording.frames().saturating_sub(1)).step_by(step).collect();
    let fields: Vec<Vec<piv::Vector>> = firsts
        .par_iter()
        .map(|&first| Ok(measure(&recording.frame(first)?, &recording.frame(first + 1)?)))
        .collect::<Result<_>>()?;
    Ok(Output::Fields(fields))
}
