//! `microsig evaluate`: scores a result.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use clap::Args;
use serde_json::{Value, json};

use super::Common;
use super::options::{Drawing, ImageTables, Replace};
use super::output::{report as print, summarize, warn};
use arena::release::{self, SubmissionFiles, Validated};
use arena::report;
use scoring::evaluate::measurement::{beyond, check_order, facts_of};
use scoring::evaluate::{EvaluateOptions, evaluate_files};
use scoring::results::{self, Conventions, TrackerResult};
use storage::InputFile;
use storage::argument::{folder, input};
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
    #[command(flatten)]
    options: EvaluateOptions,
    /// Added to x and y in the image, for a result with an origin of its own
    #[arg(long, value_names = ["PX", "PX"], num_args = 2)]
    shift: Option<Vec<f64>>,
    /// Depth range in which particles are scored; its extent is h [default: the dataset's]
    #[arg(long, value_names = ["UM", "UM"], num_args = 2)]
    depth: Option<Vec<f64>>,
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

impl Evaluate {
    pub(super) fn run(&self, common: &Common) -> Result<()> {
        let two = |of: &Option<Vec<f64>>| of.as_deref().and_then(|of| <[f64; 2]>::try_from(of).ok());
        let conventions = Conventions {
            shift_px: two(&self.shift).unwrap_or_default(),
            depth_um: two(&self.depth).map(|[low, high]| (low, high)),
            ..self.options.conventions
        };
        let (seed, context) = (self.drawing.seed, common.context.clone());
        let options = EvaluateOptions { conventions, seed, context, ..self.options.clone() };
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
