//! `microsig generate`: a scenario becomes a dataset.
//!
//! Frames go through in batches: while clouds are advanced to the next batch, the images and the truth of one are made in
//! parallel, each frame by itself. Memory does not grow with the number of frames.

use std::path::{Path, PathBuf};
use std::time::Instant;

use flows::Frame;
use microsig_core::formats::{data_file, settings_file};
use microsig_core::sensor::Image;
use microsig_core::shelf::Shelf;
use rayon::prelude::*;
use serde::Serialize;

use super::camera::Camera;
use super::progress::Progress;
use super::recording::Frames;
use crate::dataset::checksums::{Fingerprint, fingerprint};
use crate::dataset::folder::{Partial, files_below, may_stand, partial_name};
use crate::dataset::truth::{self, Census, FrameTruth, Truth, TruthWriter};
use crate::dataset::{
    FrameEntry, Ledger, Preview, Stem, TEMPORARY, calibration, card, manifest, save_bytes, seal, secret,
};
use crate::error::{Error, Result};
use crate::light::NoiseFree;
use crate::scenario::license::LICENSE;
use crate::scenario::{SCENARIO, Scenario, spec, write};

/// How to generate.
#[derive(Debug, Clone)]
pub struct Options {
    /// The folder that the dataset becomes.
    pub out: PathBuf,
    /// Replace a dataset of that name.
    pub force: bool,
    /// Go on with an interrupted run.
    pub resume: bool,
    /// Whether to show a bar.
    pub progress: Progress,
}

/// What was generated.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Generated {
    /// The dataset.
    pub out: PathBuf,
    /// Its name.
    pub name: String,
    /// Number of images, without the calibration stack.
    pub images: u32,
    /// Visible particles, summed over frames.
    pub particles: u64,
    /// Rows of the table of displacements.
    pub displacements: u64,
    /// Largest displacement of a visible particle, px.
    pub max_displacement_px: f64,
    /// Duration, s.
    pub seconds: f64,
    /// What should be known about the dataset.
    pub warnings: Vec<String>,
}

/// Frames that go through at a time, for each thread: no more than this,
const FRAMES_PER_THREAD: usize = 3;

/// and no more than have so many tracers.
const TRACERS_PER_THREAD: usize = 8_192;

/// Makes the dataset.
///
/// # Errors
/// A dataset or an interrupted run that stands in the way; a trajectory that cannot be followed; writing.
pub fn generate(scenario: &Scenario, options: &Options) -> Result<Generated> {
    let start = Instant::now();
    // Whether the particles find room is known when they are placed; better before anything is written.
    Frames::new(scenario)?.next().transpose()?;
    let text = write(&scenario.spec)?;
    let partial = begin(&text, options)?;
    let folder = partial.folder();

    let write_file = |path: &str, bytes: &[u8]| save_bytes(&folder.join(path), bytes);
    write_file(SCENARIO, text.as_bytes())?;
    if let Some(key) = scenario.streams.key() {
        write_file(secret::KEY_FILE, secret::text(&key).as_bytes())?;
    }
    for input in &scenario.inputs {
        write_file(&input.path, &input.bytes)?;
    }
    let mut settings = Vec::new();
    settings_file::write(&mut settings, &scenario.settings).map_err(Error::write(folder))?;
    write_file("settings.txt", &settings)?;

    let camera = Camera::new(scenario.renderer.clone(), scenario.detector.as_ref(), scenario.streams)?
        .every(scenario.recordings.dt_s());
    let noise_free = scenario.noise_free()?;
    let (census, ledger) =
        frames(folder, scenario, &camera, &noise_free, options).map_err(|e| e.below(folder))?;
    if scenario.spec.calibration == Some(spec::Calibration::Stack) {
        calibration::write(folder, scenario, &camera).map_err(|e| e.below(folder))?;
    }
    let stack = scenario.stack(&noise_free)?;
    let image = truth::depth::write(folder, scenario, &stack)?;
    truth::field::write(folder, scenario, &stack)?;
    let license = scenario.license.text(&format!("The dataset {}", scenario.spec.name));
    write_file(LICENSE, license.as_bytes())?;
    write_file("README.md", card(scenario, &census, &image)?.as_bytes())?;
    if scenario.inputs.is_empty() {
        let inputs = folder.join("inputs");
        std::fs::remove_dir(&inputs).map_err(Error::write(&inputs))?;
    }
    let tables = crate::dataset::tables(scenario);
    seal(folder, manifest::manifest(scenario, &census, &image), |path: &str| {
        manifest::entry(scenario, &ledger, &tables, folder, path)
    })?;
    partial.finish(options.force.then_some(manifest::MANIFEST))?;
    Ok(Generated {
        out: options.out.clone(),
        name: scenario.spec.name.clone(),
        images: census.frames,
        particles: census.visible,
        displacements: census.displacements,
        max_displacement_px: census.max_displacement_px,
        seconds: start.elapsed().as_secs_f64(),
        warnings: scenario.warnings.iter().cloned().chain(camera.renderer().shortfall()).collect(),
    })
}

/// Whether a finished dataset of this scenario is in a folder: there is nothing to go on with.
///
/// # Errors
/// A dataset of another scenario.
pub fn is_made(scenario: &Scenario, out: &Path) -> Result<bool> {
    if !out.join(manifest::MANIFEST).is_file() {
        return Ok(false);
    }
    let text = std::fs::read_to_string(out.join(SCENARIO)).unwrap_or_default();
    if text == write(&scenario.spec)? {
        return Ok(true);
    }
    let hint = "holds another scenario; cannot resume; --force replaces it";
    Err(Error::input(format!("{}: {hint}", out.display())))
}

/// Makes the unfinished folder, or takes up that of an interrupted run of the same scenario.
fn begin(scenario: &str, options: &Options) -> Result<Partial> {
    may_stand(&options.out, options.force.then_some(manifest::MANIFEST))?;
    let left_over = partial_name(&options.out);
    if left_over.exists() {
        if options.resume && !may_go_on(&left_over, scenario)? {
            let hint = "holds another scenario; cannot resume";
            return Err(Error::input(format!("{}: {hint}", left_over.display())));
        }
        if !options.resume {
            if !options.force {
                let hint = "left by an interrupted run; --resume goes on with it, --force starts anew";
                return Err(Error::input(format!("{}: {hint}", left_over.display())));
            }
            std::fs::remove_dir_all(&left_over).map_err(Error::write(&left_over))?;
        }
    }
    let partial = Partial::create(&options.out, false)?;
    for part in ["particles", "images", "truth", "inputs"] {
        let path = partial.folder().join(part);
        std::fs::create_dir_all(&path).map_err(Error::write(&path))?;
    }
    for file in files_below(partial.folder())?.into_iter().filter(|file| is_temporary(file)) {
        let path = partial.folder().join(file);
        std::fs::remove_file(&path).map_err(Error::write(&path))?;
    }
    Ok(partial)
}

/// Whether an unfinished folder was begun for this scenario; one that was left before its first file may be any's.
fn may_go_on(folder: &Path, scenario: &str) -> Result<bool> {
    let is_empty = files_below(folder)?.iter().all(|file| is_temporary(file));
    let same = || std::fs::read_to_string(folder.join(SCENARIO)).is_ok_and(|text| text == scenario);
    Ok(is_empty || same())
}

fn is_temporary(file: &str) -> bool {
    file.rsplit('/').next().is_some_and(|name| name.starts_with(TEMPORARY))
}

/// Advances all clouds and draws all frames.
fn frames(
    folder: &Path,
    scenario: &Scenario,
    camera: &Camera,
    noise_free: &NoiseFree,
    options: &Options,
) -> Result<(Census, Ledger)> {
    let recordings = scenario.recordings;
    let truth = Truth::new(scenario, camera.renderer(), noise_free)?;
    let studio = Studio { folder, scenario, camera, truth: &truth, files: Shelf::default() };
    let mut album = Album {
        truth: &truth,
        tables: TruthWriter::create(folder, scenario)?,
        ledger: Ledger::new(),
        preview: Preview::default(),
    };
    let shown = Preview::chosen(recordings.frames(), recordings.are_pairs());
    let bar = options.progress.images(u64::from(recordings.frames()));

    let mut all = Frames::new(scenario)?;
    let (mut before, mut batch, mut taken) = (None, next_batch(&mut all)?, Vec::new());
    while !batch.is_empty() {
        let take = || {
            let numbered = batch.par_iter().enumerate();
            let shots = numbered.map(|(i, frame)| {
                let before = if i > 0 { batch.get(i - 1) } else { before.as_ref() };
                let shot = studio.take(frame, before, shown.contains(&frame.index));
                bar.inc(1);
                shot
            });
            shots.collect::<Result<Vec<Shot>>>()
        };
        // What must be done in order, before these frames and after them, is done meanwhile.
        let meanwhile = || (album.add_all(std::mem::take(&mut taken)), next_batch(&mut all));
        let ((added, next), shots) = rayon::join(meanwhile, take);
        added?;
        taken = shots?;
        before = batch.pop();
        batch = next?;
    }
    album.add_all(taken)?;
    bar.finish_and_clear();
    album.finish(folder)
}

/// Where the frames go, in their order.
struct Album<'a> {
    truth: &'a Truth<'a>,
    tables: TruthWriter,
    ledger: Ledger,
    preview: Preview,
}

impl Album<'_> {
    fn add_all(&mut self, shots: Vec<Shot>) -> Result<()> {
        for Shot { index, truth, particles, image, picture } in shots {
            self.tables.add(&truth)?;
            self.ledger.add_frame(&FrameEntry { visible: truth.visible, particles, image })?;
            self.truth.put_back(truth);
            if let Some(picture) = picture {
                self.preview.add(index, &picture);
            }
        }
        Ok(())
    }

    fn finish(mut self, folder: &Path) -> Result<(Census, Ledger)> {
        self.preview.write(&folder.join("preview.png"))?;
        let census = self.tables.finish(&mut self.ledger)?;
        Ok((census, self.ledger))
    }
}

/// The frames that follow, as many as go through at a time.
fn next_batch(frames: &mut Frames) -> Result<Vec<Frame>> {
    let threads = rayon::current_num_threads();
    let (mut batch, mut room) = (Vec::new(), TRACERS_PER_THREAD * threads);
    while batch.len() < FRAMES_PER_THREAD * threads && room > 0 {
        let Some(frame) = frames.next().transpose()? else { break };
        room = room.saturating_sub(frame.tracers.len());
        batch.push(frame);
    }
    Ok(batch)
}

/// Makes a frame's files.
struct Studio<'a> {
    folder: &'a Path,
    scenario: &'a Scenario,
    camera: &'a Camera,
    truth: &'a Truth<'a>,
    files: Shelf<Vec<u8>>,
}

/// A frame that was taken.
struct Shot {
    index: u32,
    truth: FrameTruth,
    particles: Fingerprint,
    image: Fingerprint,
    /// The image itself, if it is wanted for the preview.
    picture: Option<Image>,
}

impl Studio<'_> {
    /// Writes a frame's data file and image; gives its truth.
    fn take(&self, frame: &Frame, before: Option<&Frame>, wanted: bool) -> Result<Shot> {
        let (mut truth, index) = (self.truth.frame(frame, before)?, frame.index);
        let rows = std::mem::take(&mut truth.particles);
        let stem = Stem::of(&self.scenario.recordings, index);
        let (data, image) = (self.folder.join(stem.particles()), self.folder.join(stem.image()));
        let mut text = self.files.lend();
        data_file::write(&mut *text, &rows, self.scenario.layout).map_err(Error::write(&data))?;
        save_bytes(&data, &text)?;
        let particles = Fingerprint::of(&text);
        drop(text);
        // An image is whole if it is there, so an interrupted run need not draw it again.
        if image.exists() && !wanted {
            return Ok(Shot { index, truth, particles, image: fingerprint(&image)?, picture: None });
        }
        let drawn = self.camera.image(&rows, index);
        let image = Fingerprint::of(&self.camera.save(&image, &drawn)?);
        Ok(Shot { index, truth, particles, image, picture: wanted.then_some(drawn) })
    }
}
