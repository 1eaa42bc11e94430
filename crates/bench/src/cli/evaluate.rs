//! `microsig evaluate`: scores a result.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use clap::{Args, ValueEnum};
use serde_json::{Value, json};

use super::Common;
use super::argument::{folder, input};
use super::choice::choice;
use super::options::{Drawing, ImageTables, Replace};
use super::output::{report as print, summarize, warn};
use arena::release::{self, SubmissionFiles, Validated};
use arena::report;
use scoring::evaluate::gate::Shape;
use scoring::evaluate::measurement::{beyond, check_order, facts_of};
use scoring::evaluate::{EvaluateOptions, evaluate_files};
use scoring::results::{self, Conventions, Format, LengthUnit, Origin, PairChoice, TrackerResult};
use storage::InputFile;
use storage::error::{Error, Result};

/// Score a tracker's result against the ground truth
#[derive(Debug, Args)]
#[command(
    after_help = "Example: microsig evaluate datasets/quickstart result.csv --out scores/mine --report"
)]
pub(super) struct Evaluate {
    /// The dataset's folder, or a truth table alone (canonical CSV)
    #[arg(value_parser = input())]
    dataset: InputFile,
    /// A tracker's result (particles or a displacement field), a folder or quoted pattern (`f*.txt`) of
    /// fields with a file for each image pair, or a submission to a challenge (a folder or zip archive)
    #[arg(value_parser = input())]
    result: InputFile,
    /// The result's format [default: detected from its header]
    #[arg(long, value_parser = choice::<Format>())]
    format: Option<Format>,
    /// Shape of the gate [default: ellipsoid with depth, radial without]
    #[arg(long, value_parser = choice::<Shape>())]
    gate: Option<Shape>,
    /// Radius of the gate in the image plane, of `--gate box` half its width [default: the
    /// dataset's, or 2]
    #[arg(long, value_name = "PX")]
    gate_xy: Option<f64>,
    /// Half height of the gate along z [default: the dataset's, or a tenth of the depth range]
    #[arg(long, value_name = "UM")]
    gate_z: Option<f64>,
    /// Score in 2 or 3 dimensions [default: the dataset's, or 3 if truth and result have a depth]
    #[arg(long, value_name = "N")]
    dims: Option<u8>,
    /// Radius of the gate of the ISBI scores [default: 5]
    #[arg(long, value_name = "PX")]
    isbi_gate: Option<f64>,
    /// Exclude particles within this distance of the image edge from scoring
    #[arg(long, value_name = "PX", default_value_t = 0.0)]
    border: f64,
    /// Coordinate of the first pixel's center in the result [default: the format's]
    #[arg(long, value_parser = choice::<Origin>())]
    origin: Option<Origin>,
    /// Unit of x and y in the result [default: as stated in it, or the unit of the format]
    #[arg(long, value_parser = choice::<LengthUnit>())]
    unit: Option<LengthUnit>,
    /// Direction of the y axis in the result [default: down]
    #[arg(long, value_enum)]
    y: Option<Direction>,
    /// Added to x and y in the image, for a result with an origin of its own
    #[arg(long, value_names = ["PX", "PX"], num_args = 2)]
    shift: Option<Vec<f64>>,
    /// Number of the result's first frame [default: the format's]
    #[arg(long, value_name = "N")]
    frame_base: Option<i64>,
    /// Pixel size in object space [default: the dataset's]. A field without stated units is then in m, mm or
    /// um
    #[arg(long, value_name = "UM")]
    um_per_px: Option<f64>,
    /// Time between the frames of a pair [default: the dataset's]. A field without stated units is then of
    /// velocities per s
    #[arg(long, value_name = "S", alias = "dt-s")]
    dt: Option<f64>,
    /// Image pair of a field, or of its first file, where the file does not state it; `all` for an ensemble
    #[arg(long, value_name = "N|all")]
    pair: Option<PairChoice>,
    /// Depth range in which particles are scored; its extent is h [default: the dataset's]
    #[arg(long, value_names = ["UM", "UM"], num_args = 2)]
    depth: Option<Vec<f64>>,
    /// Score a field against the truth plane nearest to this depth [default: where particles are in best
    /// focus]
    #[arg(long, value_name = "UM")]
    plane: Option<f64>,
    /// Report the uniform shift that best aligns the result with the truth; it is not applied
    #[arg(long)]
    auto_offset: bool,
    /// Add the Cramér-Rao bound of the dataset's optics over depth, and the efficiency of the result (takes a
    /// while)
    #[arg(long)]
    crlb: bool,
    /// Print all scores instead of a summary; `--json` and files always have all
    #[arg(long)]
    all: bool,
    /// Write score.json and tables into this folder
    #[arg(long, short, value_name = "DIR", value_parser = folder())]
    out: Option<PathBuf>,
    /// Also write report.html
    #[arg(long, requires = "out")]
    report: bool,
    /// Only check that the result can be read or that a submission is complete and fits the split; needs no
    /// truth
    #[arg(long)]
    validate_only: bool,
    #[command(flatten)]
    drawing: Drawing,
    #[command(flatten)]
    replace: Replace,
    #[command(flatten)]
    tables: ImageTables,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Direction {
    Down,
    Up,
}

impl Evaluate {
    fn conventions(&self) -> Conventions {
        Conventions {
            format: self.format,
            origin: self.origin,
            unit: self.unit,
            y_up: self.y.map(|y| y == Direction::Up),
            shift_px: self.shift.as_deref().and_then(|by| by.try_into().ok()).unwrap_or_default(),
            frame_base: self.frame_base,
            um_per_px: self.um_per_px,
            dt_s: self.dt,
            pair: self.pair,
            // Two values, as the parser sees to.
            depth_um: self.depth.as_deref().and_then(|depths| Some((*depths.first()?, *depths.get(1)?))),
            ..Conventions::default()
        }
    }

    pub(super) fn run(&self, common: &Common) -> Result<()> {
        let options = EvaluateOptions {
            conventions: self.conventions(),
            shape: self.gate,
            gate_xy_px: self.gate_xy,
            gate_z_um: self.gate_z,
            dims: self.dims,
            isbi_gate_px: self.isbi_gate,
            border_px: self.border,
            plane_um: self.plane,
            auto_offset: self.auto_offset,
            crlb: self.crlb,
            seed: self.drawing.seed,
            context: common.context.clone(),
        };
        options.check()?;
        check_order(&self.dataset, &self.result)?;
        if self.validate_only {
            return self.validate(options.conventions, common);
        }
        // Checked first, because an evaluation may take a long time.
        if let Some(out) = &self.out {
            report::check(out, self.replace.force)?;
        }
        let (result, _unpacked) = if SubmissionFiles::are_at(&self.result) {
            let files = self.submission()?;
            warn(&release::validate(&self.dataset, &files)?.warnings, common);
            (files.results(), Some(files))
        } else {
            (self.result.clone(), None)
        };
        let evaluation = evaluate_files(&self.dataset.file()?, &result, &options)?;
        let of = if self.all { report::table } else { report::summary };
        let mut text = of(&evaluation.score);
        if let Some(out) = &self.out {
            let written = report::write(out, &evaluation, self.report, self.replace.force)?;
            warn(&written.warning, common);
            for path in written.files {
                // Writing to a string cannot fail.
                let _ = writeln!(text, "  wrote      {}", path.display());
            }
        }
        if common.json {
            warn(evaluation.score.caveats(), common);
        }
        match self.out {
            Some(_) => summarize(text.trim_end(), &evaluation.score, common),
            None => print(text.trim_end(), &evaluation.score, common),
        }
    }

    fn submission(&self) -> Result<SubmissionFiles> {
        SubmissionFiles::open(&self.result, release::limits(&self.dataset)?)
    }

    fn validate(&self, given: Conventions, common: &Common) -> Result<()> {
        let Checked { text, value, warnings } = checked(&self.dataset.file()?, &self.result, given)?;
        warn(&warnings, common);
        summarize(&text, &value, common)
    }
}

/// A result or submission that can be scored.
pub(super) struct Checked {
    pub(super) text: String,
    pub(super) value: Value,
    pub(super) warnings: Vec<String>,
}

/// Checks, without the truth, that a result can be read, or that a submission is complete and fits the split.
pub(super) fn checked(dataset: &Path, result: &InputFile, given: Conventions) -> Result<Checked> {
    check_order(dataset, result)?;
    if SubmissionFiles::are_at(result) {
        let files = SubmissionFiles::open(result, release::limits(dataset)?)?;
        let validated = release::validate(dataset, &files)?;
        let Validated { submission, kind, rows, deadline, .. } = &validated;
        let until = deadline.as_ref().map(|day| format!("; deadline {day}")).unwrap_or_default();
        let text = format!(
            "{}: a valid submission of {}: {rows} {kind} by {} {}{until}",
            result.display(),
            submission.team,
            submission.method,
            submission.version
        );
        let value = serde_json::to_value(&validated).map_err(|e| Error::input(e.to_string()))?;
        return Ok(Checked { text, value, warnings: validated.warnings });
    }
    let facts = facts_of(dataset, &given)?;
    let found = results::read(result, &given.completed(&facts))?;
    let beyond = beyond(&facts, result, &found);
    if !beyond.is_empty() {
        return Err(Error::Input(beyond));
    }
    let (kind, rows, n_nan, notes) = match found {
        TrackerResult::Points(p) => ("particles", p.rows.len(), p.n_nan, p.notes),
        TrackerResult::Field(f) => ("vectors", f.vectors.len(), f.n_nan, f.notes),
    };
    let text = format!("{}: {rows} {kind}; {}", result.display(), notes.join("; "));
    let value = json!({ "kind": kind, "rows": rows, "n_nan": n_nan, "assumptions": notes });
    Ok(Checked { text, value, warnings: Vec::new() })
}
