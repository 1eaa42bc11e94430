//! The verbs `evaluate` and `compare`: their arguments, and what is said about them.

use std::fmt::Write as _;
use std::path::PathBuf;

use bench::evaluate::gate::Shape;
use bench::evaluate::truth::Facts;
use bench::evaluate::{Options, evaluate};
use bench::release::{self, SubmissionFiles, Validated};
use bench::results::{self, Conventions, Format, Found, Origin};
use bench::{Error, Result, report};
use clap::{Args, ValueEnum};
use serde_json::json;

use crate::cli::Common;
use crate::{report as print, warn};

/// Arguments of `evaluate`.
#[derive(Debug, Args)]
pub(crate) struct Evaluate {
    /// The dataset's folder, or a bare table of the truth (canonical CSV)
    dataset: PathBuf,
    /// What a tracker wrote: particles or a displacement field; or a submission to a challenge (a folder or zip archive)
    result: PathBuf,
    /// The result's format [default: from its header]
    #[arg(long, value_enum)]
    format: Option<ResultFormat>,
    /// Shape of the gate [default: ellipsoid with depth, radial without]
    #[arg(long, value_enum)]
    gate: Option<GateShape>,
    /// Width of the gate in the image plane [default: 2]
    #[arg(long, value_name = "PX")]
    gate_xy: Option<f64>,
    /// Height of the gate [default: a tenth of the depth range]
    #[arg(long, value_name = "UM")]
    gate_z: Option<f64>,
    /// Score in 2 or 3 dimensions [default: 3 if truth and result have a depth]
    #[arg(long, value_name = "N")]
    dims: Option<u8>,
    /// Gate of the ISBI scores [default: 5]
    #[arg(long, value_name = "PX")]
    isbi_gate: Option<f64>,
    /// Do not score particles this near to the edge of the image
    #[arg(long, value_name = "PX", default_value_t = 0.0)]
    border: f64,
    /// Where the result has the first pixel's centre [default: as usual in its format]
    #[arg(long, value_enum)]
    origin: Option<PixelOrigin>,
    /// Which way y grows in the result [default: down]
    #[arg(long, value_enum)]
    y: Option<Direction>,
    /// Number of the result's first frame [default: as usual in its format]
    #[arg(long, value_name = "N", allow_negative_numbers = true)]
    frame_base: Option<i64>,
    /// Object-space length of a pixel [default: the dataset's]
    #[arg(long, value_name = "UM")]
    um_per_px: Option<f64>,
    /// Depth range [default: the dataset's]
    #[arg(long, value_names = ["UM", "UM"], num_args = 2, allow_negative_numbers = true)]
    depth: Option<Vec<f64>>,
    /// Score a field against the plane of the truth nearest to this depth [default: where particles are sharpest]
    #[arg(long, value_name = "UM", allow_negative_numbers = true)]
    plane: Option<f64>,
    /// Report which shift of the whole result would fit best; it is never applied
    #[arg(long)]
    auto_offset: bool,
    /// Add the Cramer-Rao bound of the dataset's optics over depth, and the result's efficiency (takes a while)
    #[arg(long)]
    crlb: bool,
    /// Write score.json and tables into this folder
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Write report.html beside them
    #[arg(long, requires = "out")]
    report: bool,
    /// Only check that the result can be read, or that a submission is complete and fits the split; needs no truth
    #[arg(long)]
    validate_only: bool,
}

/// Formats of results.
#[derive(Debug, Clone, Copy, ValueEnum)]
enum ResultFormat {
    Canonical,
    Trackpy,
    TrackmateSpots,
    TrackmateXml,
    Isbi,
    Defocustracker,
    DefocustrackerAscii,
    Napari,
    Field,
    Openpiv,
    Pivlab,
    Flo,
}

#[derive(Debug, Clone, Copy, ValueEnum)]
enum GateShape {
    Ellipsoid,
    Radial,
    Box,
}

#[derive(Debug, Clone, Copy, ValueEnum)]
enum PixelOrigin {
    /// (1, 1)
    Center1,
    /// (0, 0)
    Center0,
    /// (0.5, 0.5)
    Corner0,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Direction {
    Down,
    Up,
}

/// Arguments of `compare`.
#[derive(Debug, Args)]
pub(crate) struct Compare {
    /// Files score.json, or folders that hold one
    #[arg(required = true)]
    scores: Vec<PathBuf>,
    /// Folder for leaderboard.csv, curves.csv and leaderboard.html
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
}

impl Evaluate {
    fn conventions(&self) -> Result<Conventions> {
        if let Some(um) = self.um_per_px.filter(|um| !(1e-6..=1e6).contains(um)) {
            return Err(Error::input(format!("--um-per-px {um}: expected a number from 1e-6 to 1e6")));
        }
        let depth_um = match self.depth.as_deref() {
            Some(&[low, high]) if low < high && high - low <= 1e9 => Some((low, high)),
            Some(wrong) => {
                let given: Vec<String> = wrong.iter().map(f64::to_string).collect();
                return Err(Error::input(format!(
                    "--depth {}: expected two depths in um, the lower one first, at most 1e9 um apart",
                    given.join(" ")
                )));
            }
            None => None,
        };
        Ok(Conventions {
            format: self.format.map(|f| match f {
                ResultFormat::Canonical => Format::Canonical,
                ResultFormat::Trackpy => Format::Trackpy,
                ResultFormat::TrackmateSpots => Format::TrackmateSpots,
                ResultFormat::TrackmateXml => Format::TrackmateXml,
                ResultFormat::Isbi => Format::Isbi,
                ResultFormat::Defocustracker => Format::Defocustracker,
                ResultFormat::DefocustrackerAscii => Format::DefocustrackerAscii,
                ResultFormat::Napari => Format::Napari,
                ResultFormat::Field => Format::Field,
                ResultFormat::Openpiv => Format::Openpiv,
                ResultFormat::Pivlab => Format::Pivlab,
                ResultFormat::Flo => Format::Flo,
            }),
            origin: self.origin.map(|o| match o {
                PixelOrigin::Center1 => Origin::Center1,
                PixelOrigin::Center0 => Origin::Center0,
                PixelOrigin::Corner0 => Origin::Corner0,
            }),
            y_up: self.y.map(|y| y == Direction::Up),
            frame_base: self.frame_base,
            um_per_px: self.um_per_px,
            depth_um,
            height_px: None,
        })
    }
}

pub(crate) fn run_evaluate(arguments: &Evaluate, common: &Common) -> Result<()> {
    let conventions = arguments.conventions()?;
    if !(0.0..=1e7).contains(&arguments.border) {
        return Err(Error::input(format!("--border {}: expected 0 to 1e7 px", arguments.border)));
    }
    if let Some(plane) = arguments.plane.filter(|z| !z.is_finite()) {
        return Err(Error::input(format!("--plane {plane}: expected a depth in um")));
    }
    if arguments.validate_only {
        return validate(arguments, conventions, common);
    }
    let options = Options {
        conventions,
        shape: arguments.gate.map(|g| match g {
            GateShape::Ellipsoid => Shape::Ellipsoid,
            GateShape::Radial => Shape::Radial,
            GateShape::Box => Shape::Box,
        }),
        gate_xy_px: arguments.gate_xy,
        gate_z_um: arguments.gate_z,
        dims: arguments.dims,
        isbi_gate_px: arguments.isbi_gate,
        border_px: arguments.border,
        plane_um: arguments.plane,
        auto_offset: arguments.auto_offset,
        crlb: arguments.crlb,
        seed: common.seed.unwrap_or(0),
    };
    // Before the work: what would be refused after it.
    if let Some(out) = arguments.out.as_ref().filter(|out| out.exists() && !common.force) {
        return Err(Error::Exists(out.clone()));
    }
    let (result, _unpacked) = if SubmissionFiles::are_at(&arguments.result) {
        let files = SubmissionFiles::open(&arguments.result)?;
        warn(&release::validate(&arguments.dataset, &files)?.warnings, common);
        (files.results(), Some(files))
    } else {
        (arguments.result.clone(), None)
    };
    let evaluation = evaluate(&arguments.dataset, &result, &options)?;
    let mut text = report::table(&evaluation.score);
    if let Some(out) = &arguments.out {
        for path in report::write(out, &evaluation, arguments.report, common.force)? {
            // Writing to a string cannot fail.
            let _ = writeln!(text, "  wrote      {}", path.display());
        }
    }
    if common.json {
        warn(&evaluation.score.warnings, common);
    }
    print(text.trim_end(), &evaluation.score, common)
}

fn validate(arguments: &Evaluate, mut given: Conventions, common: &Common) -> Result<()> {
    if SubmissionFiles::are_at(&arguments.result) {
        let validated = release::validate(&arguments.dataset, &SubmissionFiles::open(&arguments.result)?)?;
        warn(&validated.warnings, common);
        let Validated { submission, kind, rows, .. } = &validated;
        let text = format!(
            "{}: a valid submission of {}: {rows} {kind} by {} {}",
            arguments.result.display(),
            submission.team,
            submission.method,
            submission.version
        );
        return print(&text, &validated, common);
    }
    if arguments.dataset.is_dir() {
        given = bench::evaluate::truth::conventions(&arguments.dataset, given)?;
    }
    let found = results::read(&arguments.result, &given)?;
    let beyond = Facts::of(&arguments.dataset, &given)?.beyond(&arguments.result, &found);
    if !beyond.is_empty() {
        return Err(Error::Input(beyond));
    }
    let (kind, rows, n_nan, notes) = match found {
        Found::Points(p) => ("particles", p.rows.len(), p.n_nan, p.notes),
        Found::Field(f) => ("vectors", f.vectors.len(), f.n_nan, f.notes),
    };
    let text = format!("{}: {rows} {kind}; {}", arguments.result.display(), notes.join("; "));
    print(&text, &json!({ "kind": kind, "rows": rows, "n_nan": n_nan, "assumptions": notes }), common)
}

pub(crate) fn run_compare(arguments: &Compare, common: &Common) -> Result<()> {
    let compared = report::compare(&arguments.scores, &arguments.out, common.force)?;
    print(compared.text.trim_end(), &compared, common)
}
