//! `microsig generate`: generates a dataset from a scenario.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::time::Instant;

use serde::Serialize;

use super::cost::{Cost, FirstFrames};
use super::frames;
use super::plausibility;
use crate::dataset::manifest;
use crate::dataset::truth::{Totals, Truth};
use crate::dataset::{Camera, FileHashes, calibration, card, source, truth};
use crate::preview::{self, Preview};
use microsig_core::visibility::DepthScan;
use scenario::{SCENARIO, Scenario, write};
use storage::checksums::{Fingerprint, fingerprint};
use storage::dataset::manifest::{GENERATOR_VERSION, MANIFEST};
use storage::folder::{Earlier, FolderClaim, Partial, check_replaceable, partial_name};
use storage::{Error, Progress, Result, advice};

/// Options of [`generate`].
#[derive(Debug, Clone)]
pub struct GenerateOptions {
    /// Folder of the dataset.
    pub out: PathBuf,
    /// Replace an existing dataset.
    pub force: bool,
    /// Continue an interrupted run.
    pub resume: bool,
    /// How progress is shown.
    pub progress: Progress,
}

/// Summary of a generated dataset.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Generated {
    /// Folder of the dataset.
    pub out: PathBuf,
    /// Name of the dataset.
    pub name: String,
    /// Number of images, without the calibration stack.
    pub images: u32,
    /// Visible particles, summed over frames.
    pub particles: u64,
    /// Rows of the table of displacements.
    pub displacements: u64,
    /// Largest displacement of a visible particle, px.
    pub max_displacement_px: f64,
    /// How far such a particle moves while the shutter is open, px; 0: exposures are instantaneous.
    pub max_streak_px: f64,
    /// Duration, s.
    pub seconds: f64,
    /// Descriptions of focus and light.
    pub optics: [String; 2],
    /// Warnings about the dataset.
    pub warnings: Vec<String>,
}

/// Generates a dataset. Errors: an existing dataset or interrupted run; another process that is writing the
/// dataset; a trajectory that cannot be integrated; an I/O error.
pub fn generate(scenario: &Scenario, options: &GenerateOptions) -> Result<Generated> {
    generate_or_find(scenario, options)?.ok_or_else(|| Error::exists(&options.out))
}

/// Generates a dataset; returns `None` if it is to be resumed but is already finished.
pub fn generate_or_find(scenario: &Scenario, options: &GenerateOptions) -> Result<Option<Generated>> {
    let start = Instant::now();
    let cost = Cost::of(scenario, &options.out)?;
    cost.check_resources(scenario)?;
    // Placing the particles reveals whether they fit into the box; done here, before anything is written.
    let placing = options.progress.spinner("placing particles and following the first trajectories");
    let first = FirstFrames::new(scenario)?;
    placing.finish();
    let Some(partial) = begin(scenario, options)? else { return Ok(None) };
    let camera = camera(scenario)?;
    let truth = Truth::new(scenario, camera.renderer())?;
    let progress = &options.progress;
    if progress.has_notes() {
        let cost = cost.timed_by(&first, &truth, &camera)?;
        cost.warning().iter().for_each(|text| progress.note(text));
    }
    drop(first);
    let scan = scenario.scan_of_mean()?;
    let frames = |partial: &Partial| frames::write(partial, scenario, &camera, &truth, progress);
    let generated = assemble(partial, scenario, options, (&camera, &scan), frames)?;
    Ok(Some(Generated { seconds: start.elapsed().as_secs_f64(), ..generated }))
}

/// The camera that records the frames of a scenario.
pub(crate) fn camera(scenario: &Scenario) -> Result<Camera> {
    let camera = Camera::of_dataset(scenario, scenario.renderer.clone(), scenario.detector.as_ref())?;
    Ok(camera.every(scenario.recordings.dt_s()))
}

/// Writes all files of a dataset into an unfinished folder, then gives the folder its final name; `frames`
/// writes the files of single frames.
pub(super) fn assemble(
    partial: Partial,
    scenario: &Scenario,
    options: &GenerateOptions,
    (camera, scan): (&Camera, &DepthScan),
    frames: impl FnOnce(&Partial) -> Result<(Totals, FileHashes, f64)>,
) -> Result<Generated> {
    let folder = partial.folder();
    source::write(folder, scenario)?;
    let (totals, hashes, saturated) = frames(&partial).map_err(|e| e.below(folder.path()))?;
    calibration::write(folder, scenario, camera, scan, || options.progress.check())
        .map_err(|e| e.below(folder.path()))?;
    options.progress.check()?;
    let image = truth::write(folder, scenario, scan)?;
    let preview = Preview::from_scan(scenario, scan)?;
    let sizes = manifest::sizes(&preview);
    card::write(folder, scenario, &totals, &image, &sizes)?;
    options.progress.check()?;
    manifest::write(&partial, scenario, &hashes, manifest::manifest(scenario, &totals, &image, &sizes))?;

    let shortfall = camera.renderer().shortfall()?;
    let implausible = plausibility::warnings(scenario, &totals, &image, saturated)?;
    partial.finish_without_journal(Earlier::new(MANIFEST, options.force))?;
    Ok(Generated {
        out: options.out.clone(),
        name: scenario.spec.name.clone(),
        images: totals.frames,
        particles: totals.visible,
        displacements: totals.displacements,
        max_displacement_px: totals.max_displacement_px,
        max_streak_px: scenario.shutter.map_or(0.0, |shutter| {
            totals.max_displacement_px * shutter.open_s() / scenario.recordings.dt_s()
        }),
        seconds: 0.0,
        optics: preview::lines(&preview),
        warnings: scenario.warnings.iter().cloned().chain(shortfall).chain(implausible).collect(),
    })
}

/// SHA-256 hashes of everything that determines the bytes of a dataset, by name.
fn sources(scenario: &Scenario) -> Result<BTreeMap<String, String>> {
    let sha256 = |bytes: &[u8]| Fingerprint::of(bytes).sha256.to_string();
    let mut sources = BTreeMap::from([
        ("the program".to_owned(), format!("{GENERATOR_VERSION} {}", storage::COMMIT)),
        (SCENARIO.to_owned(), sha256(write(&scenario.spec)?.as_bytes())),
    ]);
    sources.extend(scenario.inputs.iter().map(|input| (input.path.clone(), sha256(&input.bytes))));
    if let Some(key) = scenario.streams.key() {
        sources.insert("the secret key".to_owned(), sha256(&key));
    }
    Ok(sources)
}

/// Describes the first difference between the sources of an interrupted run and of this one.
fn difference(before: &BTreeMap<String, String>, now: &BTreeMap<String, String>) -> Option<String> {
    let differs = |name: &&String| before.get(*name) != now.get(*name);
    let names: Vec<&String> = now.keys().chain(before.keys()).filter(differs).collect();
    match names.as_slice() {
        [] => None,
        names if names.iter().any(|name| *name == SCENARIO) => Some("contains another scenario".to_owned()),
        [name, ..] => Some(format!("{name} has changed since")),
    }
}

/// Whether a folder contains a finished dataset of this scenario and its inputs. Errors: a dataset of another
/// scenario or of other inputs.
fn is_finished(scenario: &Scenario, out: &Path) -> Result<bool> {
    if !out.join(MANIFEST).is_file() {
        return Ok(false);
    }
    let refuse = |what: String| {
        let hint = advice!(what, "; cannot resume; ", advice::flag("force"), " replaces it");
        Err(Error::Exists { path: out.to_owned(), hint })
    };
    let text = storage::read_text(&out.join(SCENARIO)).unwrap_or_default();
    if text != write(&scenario.spec)? {
        return refuse("contains another scenario".to_owned());
    }
    for input in &scenario.inputs {
        if !fingerprint(&out.join(&input.path)).is_ok_and(|found| found == Fingerprint::of(&input.bytes)) {
            return refuse(format!("{} has changed since", input.path));
        }
    }
    Ok(true)
}

/// Locks the output folder, then creates the unfinished folder or resumes an interrupted run's with the
/// same sources. `None` if the dataset is to be resumed but is already finished.
fn begin(scenario: &Scenario, options: &GenerateOptions) -> Result<Option<Partial>> {
    let claim = FolderClaim::take(&options.out)?;
    options.progress.warn(claim.warning());
    if options.resume && !options.force && is_finished(scenario, &options.out)? {
        return Ok(None);
    }
    check_replaceable(&options.out, Earlier { resumable: true, ..Earlier::new(MANIFEST, options.force) })?;
    let (now, left_over) = (sources(scenario)?, partial_name(&options.out));
    let partial = match claim.left_over()? {
        Some(before) if options.resume => {
            // A run that stopped before recording its sources has written no frames.
            match before.source.as_ref().and_then(|before| difference(before, &now)) {
                None => claim.resume()?,
                Some(what) => {
                    let (force, resume) = (advice::flag("force"), advice::flag("resume"));
                    let hint = advice!(what, "; cannot resume; ", force, " without ", resume, " starts over");
                    return Err(Error::Exists { path: left_over, hint });
                }
            }
        }
        Some(_) if !options.force => {
            let (force, resume) = (advice::flag("force"), advice::flag("resume"));
            let hint =
                advice!("left by an interrupted run; ", resume, " continues it, ", force, " starts over");
            return Err(Error::Exists { path: left_over, hint });
        }
        _ => claim.start(false)?,
    };
    partial.source(&now)?;
    folders(&partial)?;
    Ok(Some(partial))
}

/// Creates the folders for frames and truth.
pub(super) fn folders(partial: &Partial) -> Result<()> {
    for part in ["particles", "images", "truth"] {
        partial.folder().subfolder(part)?;
    }
    Ok(())
}
