//! `microsig sweep`: generates a dataset for each case of a sweep.
//!
//! Each case yields a dataset, `case_00000/`, or the reason of its failure, `case_00000.failed`. The result
//! does not depend on how the cases are distributed: shards in one folder, or in folders that are merged
//! later, yield the same files as a single run. The table of all cases, `cases.csv`, is written when all
//! cases are complete.

use std::path::{Path, PathBuf};
use std::time::Instant;

use microsig_core::render::Context;
use serde::Serialize;
use serde_json::json;

use super::generate::{GenerateOptions, generate_or_find};
use super::shard::Shard;
use scenario::{Case, Scenario, Sweep, resolve};
use storage::dataset::cases::{BEFORE_AXES, CASES, STATUS};
use storage::dataset::manifest::{MANIFEST, Manifest};
use storage::folder::{FolderClaim, is_empty};
use storage::{Error, Progress, Result, advice, read_text, save_bytes, save_changed};

/// Options of [`sweep`].
#[derive(Debug, Clone)]
pub struct SweepOptions {
    /// The sweep's folder.
    pub out: PathBuf,
    /// Folder that paths in the base scenario are relative to.
    pub inputs: PathBuf,
    /// The cases to run.
    pub shard: Shard,
    /// Only this one of them.
    pub case: Option<String>,
    /// Replace existing cases.
    pub force: bool,
    /// Skip finished cases and continue interrupted ones.
    pub resume: bool,
    /// How progress is shown.
    pub progress: Progress,
    /// Where renderers keep their tables.
    pub context: Context,
}

impl SweepOptions {
    /// The cases to run.
    pub fn cases<'a>(&self, sweep: &'a Sweep) -> Result<Vec<&'a Case>> {
        let mine = sweep.cases.iter().filter(|case| self.shard.has(case.index));
        let Some(name) = &self.case else { return Ok(mine.collect()) };
        let found: Vec<&Case> = mine.filter(|case| case.name == *name).collect();
        match (&*found, sweep.cases.first().zip(sweep.cases.last())) {
            ([], Some((first, last))) => {
                let expected = format!("expected {} to {}", first.name, last.name);
                Err(Error::input(format!("case {name}: {expected}")))
            }
            _ => Ok(found),
        }
    }
}

/// Summary of a sweep.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Swept {
    /// The sweep's folder.
    pub out: PathBuf,
    /// The shard of this run.
    pub shard: Shard,
    /// Number of cases of the sweep.
    pub cases: usize,
    /// Number of finished cases, by this run or others.
    pub done: usize,
    /// Number of failed cases.
    pub failed: usize,
    /// Number of cases that this run generated.
    pub made: usize,
    /// Number of cases that failed in this run.
    pub failed_now: usize,
    /// Duration, s.
    pub seconds: f64,
}

/// Runs the cases of a shard. A case that fails is recorded with the reason and does not stop the sweep.
/// Errors: an existing case, unless `resume` or `force`; an I/O error.
pub fn sweep(sweep: &Sweep, options: &SweepOptions) -> Result<Swept> {
    let start = Instant::now();
    // Cases written into a dataset's folder would corrupt the dataset.
    if options.out.join(MANIFEST).exists() {
        return Err(Error::input(format!(
            "{}: is a dataset; a sweep needs a separate folder",
            options.out.display()
        )));
    }
    let mine = options.cases(sweep)?;
    std::fs::create_dir_all(&options.out).map_err(Error::write(&options.out))?;
    if !options.resume && !options.force {
        for case in &mine {
            refuse_existing(&options.out.join(&case.name))?;
        }
    }
    let (bar, within) = options.progress.cases(mine.len() as u64);
    let mut made = 0;
    for case in &mine {
        bar.set_message(case.name.clone());
        made += usize::from(run(sweep, case, options, &within)?);
        bar.inc(1);
    }
    bar.finish();
    let (done, failed) = tabulate(sweep, &options.out, options.force)?;
    let failed_now = mine.iter().filter(|case| reason(&options.out.join(&case.name)).exists()).count();
    let cases = sweep.cases.len();
    let (out, shard) = (options.out.clone(), options.shard);
    Ok(Swept { out, shard, cases, done, failed, made, failed_now, seconds: start.elapsed().as_secs_f64() })
}

/// Generates one case; returns `false` if it is already finished, or if it fails and the reason is written
/// instead.
fn run(sweep: &Sweep, case: &Case, options: &SweepOptions, progress: &Progress) -> Result<bool> {
    let out = options.out.join(&case.name);
    let scenario = sweep.scenario(case).and_then(|spec| resolve(spec, &options.inputs, &options.context));
    attempt(scenario, &out, (options.force, options.resume), progress)
}

/// Generates one of many datasets; returns `false` if it is already finished, or if it fails and the reason
/// is written beside its folder instead. The caller has checked that it does not exist, unless `resume` or
/// `force` is set.
pub(super) fn attempt(
    scenario: Result<Scenario>,
    out: &Path,
    (force, resume): (bool, bool),
    progress: &Progress,
) -> Result<bool> {
    let reason = reason(out);
    // A failed case is tried again, because the cause may be gone.
    if reason.exists() {
        std::fs::remove_file(&reason).map_err(Error::write(&reason))?;
    }
    let generated = scenario.and_then(|scenario| {
        // Without --resume an unfinished dataset starts over.
        let (out, force) = (out.to_owned(), force || !resume);
        generate_or_find(&scenario, &GenerateOptions { out, force, resume, progress: progress.clone() })
    });
    match generated {
        Ok(generated) => Ok(generated.is_some()),
        // A full disk or a dataset of another sweep is not a failure of the case.
        Err(error) if error.is_io() || (out.exists() && !is_empty(out) && !force) => Err(error),
        Err(error) => {
            let mut text = format!("{error}\n");
            match FolderClaim::take(out).and_then(FolderClaim::discard) {
                Ok(()) => {}
                Err(error) if error.is_io() => return Err(error),
                // Files of an interrupted run stay where they are.
                Err(kept) if kept.to_string() != error.to_string() => text += &format!("{kept}\n"),
                Err(_) => {}
            }
            save_bytes(&reason, text.as_bytes())?;
            Ok(false)
        }
    }
}

/// Refuses a dataset that exists, or the reason why it could not be generated.
pub(super) fn refuse_existing(out: &Path) -> Result<()> {
    match [out.to_owned(), reason(out)].iter().find(|path| path.exists() && !is_empty(path)) {
        Some(path) => {
            let hint = advice!(
                "already exists; ",
                advice::flag("force"),
                " replaces it, ",
                advice::flag("resume"),
                " continues the run"
            );
            Err(Error::Exists { path: path.clone(), hint })
        }
        None => Ok(()),
    }
}

/// The file beside a dataset's folder with the reason why it could not be generated.
pub(super) fn reason(out: &Path) -> PathBuf {
    let name = out.file_name().unwrap_or_default().to_string_lossy();
    out.with_file_name(format!("{name}.failed"))
}

/// Outcome of one of many datasets: facts from its manifest, or the reason of its failure.
pub(super) enum Outcome {
    Done([String; 4]),
    Failed(String),
}

impl Outcome {
    /// The columns of [`Outcome::cells`].
    pub(super) const COLUMNS: [&str; 6] = [STATUS, "n_p", "n_ppp", "n_s", "max_displacement_px", "reason"];

    /// The outcome of the dataset in this folder, which must have this name and seed; `None` if it is
    /// unfinished. `of` names in messages what the datasets belong to.
    pub(super) fn of(dataset: &Path, (name, seed): (&str, u64), of: &str) -> Result<Option<Self>> {
        if dataset.join(MANIFEST).exists() {
            let Manifest { name: found, microsig: facts, .. } = Manifest::read(dataset)?;
            if (found.as_str(), facts.seed.flatten()) != (name, Some(seed)) {
                let path = dataset.join(MANIFEST);
                let hint = format!("belongs to another {of}; expected `{name}` with seed {seed}");
                return Err(Error::input(format!("{}: {hint}", path.display())));
            }
            let numbers = [facts.n_p, facts.n_ppp, facts.n_s, facts.max_displacement_px];
            return Ok(Some(Outcome::Done(numbers.map(|number| json!(number).to_string()))));
        }
        let reason = reason(dataset);
        if !reason.exists() {
            return Ok(None);
        }
        Ok(Some(Outcome::Failed(read_text(&reason)?.trim().to_owned())))
    }

    pub(super) fn is_done(&self) -> bool {
        matches!(self, Outcome::Done(_))
    }

    pub(super) fn cells(self) -> [String; 6] {
        let empty = || [const { String::new() }; 4];
        let (status, [n_p, n_ppp, n_s, moved], reason) = match self {
            Outcome::Done(facts) => ("done", facts, String::new()),
            Outcome::Failed(reason) => ("failed", empty(), reason),
        };
        [status.to_owned(), n_p, n_ppp, n_s, moved, reason]
    }
}

/// Counts finished and failed cases, and writes the table if none is outstanding. Returns both numbers.
/// Errors: a dataset without a readable manifest; an I/O error.
pub fn collect(sweep: &Sweep, out: &Path) -> Result<(usize, usize)> {
    tabulate(sweep, out, false)
}

/// [`collect`]; `replacing`: cases of another sweep are yet to be replaced, by other runs.
fn tabulate(sweep: &Sweep, out: &Path, replacing: bool) -> Result<(usize, usize)> {
    let (mut done, mut failures) = (0, 0);
    let mut table = csv::Writer::from_writer(Vec::new());
    let unwritable = |e: csv::Error| Error::Write { path: out.join(CASES), source: std::io::Error::other(e) };
    // The seed has its own column.
    let axes =
        || sweep.spec.axes.iter().map(|a| a.path.as_str()).enumerate().filter(|(_, path)| *path != "seed");
    let header: Vec<&str> =
        BEFORE_AXES.into_iter().chain(axes().map(|(_, path)| path)).chain(Outcome::COLUMNS).collect();
    table.write_record(&header).map_err(unwritable)?;
    for case in &sweep.cases {
        let mut row = vec![
            case.index.to_string(),
            case.name.clone(),
            case.repetition.to_string(),
            case.seed.to_string(),
        ];
        row.extend(axes().map(|(i, _)| case.values[i].clone()));
        let name = sweep.name_of(case);
        let dataset = out.join(&case.name);
        let outcome = match Outcome::of(&dataset, (&name, case.seed), "sweep") {
            Err(Error::Input(_)) if replacing => None,
            outcome => outcome?,
        };
        let Some(outcome) = outcome else { continue };
        *(if outcome.is_done() { &mut done } else { &mut failures }) += 1;
        row.extend(outcome.cells());
        table.write_record(&row).map_err(unwritable)?;
    }
    if done + failures == sweep.cases.len() {
        let bytes = table.into_inner().map_err(|e| unwritable(csv::Error::from(e.into_error())))?;
        save_changed(&out.join(CASES), &bytes)?;
    }
    Ok((done, failures))
}
