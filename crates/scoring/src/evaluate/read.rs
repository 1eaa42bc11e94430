use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Arc;

use super::field::true_field::{self, TrueFields};
use super::measurement::{self, TableSize};
use super::truth::{self, TrueParticles};
use super::{EvaluateOptions, Evaluation, Score, evaluate};
use crate::results::{Conventions, Limits, Source, TrackerResult};
use scenario::{Scenario, ScenarioFlow};
use storage::InputFile;
use storage::advice;
use storage::advice::flag;
use storage::dataset::{BoxRow, DatasetInMemory, FieldRow, PlaneRow, RecordingFacts, Row, TrackRow};
use storage::error::{Error, Result};

/// What results are scored against: the parts of a dataset's truth that a result of its kind needs.
#[derive(Debug, Default)]
pub struct Truth {
    /// Facts about the recording.
    pub facts: RecordingFacts,
    /// The true particles.
    pub particles: Option<TrueParticles>,
    /// Heights of the planes of frames, of a recording.
    pub planes: Option<Vec<PlaneRow>>,
    /// The true boxes.
    pub boxes: Option<Vec<BoxRow>>,
    /// The true displacement fields.
    pub fields: Option<TrueFields>,
    /// The scenario, for the Cramér-Rao bound.
    pub scenario: Option<Arc<Scenario>>,
    /// Values on the axes of a sweep.
    pub axes: BTreeMap<String, serde_json::Value>,
    /// Caveats about the truth.
    pub warnings: Vec<String>,
}

impl Truth {
    /// Reads the particles (or `fields`) of a dataset, or a bare table; returns the limits of its results,
    /// too.
    /// Errors: files that are unreadable or malformed; a Cramér-Rao bound of a bare table.
    pub fn read(path: &Path, is_field: bool, options: &EvaluateOptions) -> Result<(Self, Limits)> {
        let facts = measurement::facts_of(path, &options.conventions)?;
        if !path.is_dir() {
            let limits = measurement::limits(path, &facts)?;
            return Ok((Truth::bare(path, facts, is_field, options)?, limits));
        }
        let mut truth = Truth { axes: measurement::axes(path)?, ..Truth::default() };
        if options.crlb && facts.is_recording {
            truth.warnings.push("no Cramér-Rao bound: a recording has no scenario".to_owned());
        } else if options.crlb {
            truth.scenario = Some(Arc::new(scenario::of_dataset(path, &options.context)?.0));
        }
        if is_field {
            let limits = measurement::limits(path, &facts)?;
            let fields = true_field::from_recording(path, facts.clone(), options.plane_um)?;
            truth.fields = Some(fields.with_flow(ScenarioFlow::of_dataset(path, &options.context)));
            return Ok((Truth { facts, ..truth }, limits));
        }
        if facts.is_recording {
            if path.join(PlaneRow::PATH).exists() {
                truth.planes = Some(storage::dataset::read_rows(path, &["frame", "z_um"])?);
            }
            if !path.join(TrackRow::PATH).exists() {
                return Ok((Truth { facts, ..truth }, Limits::default()));
            }
        }
        let (particles, size) = TrueParticles::from_dataset(path, facts.clone())?;
        if particles.facts.sha256 != facts.sha256 {
            let what = format!("{} has changed since the dataset was made", TrackRow::PATH);
            truth.warnings.push(what);
        }
        truth.particles = Some(particles);
        if path.join(BoxRow::PATH).exists() {
            let needed = ["frame", "x_px", "y_px", "w_px", "h_px", "visible"];
            truth.boxes = Some(storage::dataset::read_rows(path, &needed)?);
        }
        let field = path.join(FieldRow::PATH);
        let field = if field.exists() { TableSize::of(&field)? } else { TableSize::default() };
        let limits = TableSize::limits(&[size, field], &facts);
        Ok((Truth { facts, ..truth }, limits))
    }

    /// Reads a bare table of particles (or of a field).
    fn bare(path: &Path, facts: RecordingFacts, is_field: bool, options: &EvaluateOptions) -> Result<Self> {
        if options.crlb {
            let what = ": a bare table of the truth does not contain the optics";
            return Err(Error::option(advice!(flag("crlb"), what)));
        }
        let truth = match is_field {
            true => Truth { fields: Some(true_field::bare(path)?), ..Truth::default() },
            false => Truth { particles: Some(truth::bare(path, facts.clone())?), ..Truth::default() },
        };
        Ok(Truth { facts, ..truth })
    }

    /// The particles (or `fields`) of a dataset in memory, which has been made from `scenario`.
    pub fn from_memory(
        made: &dyn DatasetInMemory,
        scenario: &Arc<Scenario>,
        is_field: bool,
        options: &EvaluateOptions,
    ) -> Result<(Self, Limits)> {
        let facts = RecordingFacts::of(made.manifest()?);
        let facts = measurement::with_given(facts, &options.conventions);
        let mut truth = Truth { scenario: Some(Arc::clone(scenario)), ..Truth::default() };
        if is_field {
            truth.fields = Some(true_field::from_memory(made, facts.clone(), options.plane_um)?);
        } else {
            truth.particles = Some(TrueParticles::from_rows(facts.clone(), made.tracks(), &made.frames())?);
            truth.boxes = made.boxes();
        }
        Ok((Truth { facts, ..truth }, Limits::default()))
    }
}

/// Scores a result file against a dataset's folder or a bare table of the truth.
/// Errors: files that are unreadable or malformed; options that do not apply to them.
pub fn evaluate_files(
    dataset: &Path,
    result: impl Into<InputFile>,
    options: &EvaluateOptions,
) -> Result<Evaluation> {
    options.check()?;
    let result = result.into();
    measurement::check_order(dataset, &result)?;
    let result = Source::at(result)?;
    if dataset.is_dir() {
        return evaluate_source(|is_field| Truth::read(dataset, is_field, options), result, options);
    }
    // First the result: a table of the other kind may be no truth at all.
    let (name, format) = (result.name(), result.format(&options.conventions)?);
    let facts = measurement::facts_of(dataset, &options.conventions)?;
    let limits = measurement::limits(dataset, &facts)?;
    let found = result.read(format, &Conventions { limits, ..options.conventions.completed(&facts) })?;
    let truth = Truth::bare(dataset, facts, format.is_field(), options)?;
    scored(&truth, found, name, options)
}

/// Scores a result against the truth that `truth` returns for a result that is, or is not, a field.
/// Errors: errors of `truth`; a result that is malformed; options that do not apply.
pub fn evaluate_source(
    truth: impl FnOnce(bool) -> Result<(Truth, Limits)>,
    result: Source,
    options: &EvaluateOptions,
) -> Result<Evaluation> {
    options.check()?;
    let (name, format) = (result.name(), result.format(&options.conventions)?);
    let (truth, limits) = truth(format.is_field())?;
    let given = Conventions { limits, ..options.conventions.completed(&truth.facts) };
    scored(&truth, result.read(format, &given)?, name, options)
}

fn scored(
    truth: &Truth,
    mut found: TrackerResult,
    name: String,
    options: &EvaluateOptions,
) -> Result<Evaluation> {
    if let (TrackerResult::Points(points), Some(particles)) = (&mut found, &truth.particles)
        && particles.axes.is_empty()
    {
        // Large results take a tenth less memory.
        points.axes = Vec::new();
    }
    let evaluation = evaluate(truth, &found, options)?;
    Ok(Evaluation { score: Score { result: name, ..evaluation.score }, ..evaluation })
}
