//! Generates and writes the frames of a dataset: images, data files, truth, preview.
//!
//! Frames are processed in batches: while the tracers of the next batch are advanced, images and truth of the
//! current one are computed in parallel, each frame independently. Memory does not grow with the number of
//! frames.

use flows::Frame;
use image::GrayImage;
use microsig_core::Particle;
use microsig_core::formats::data_file;
use microsig_core::pool::BufferPool;
use microsig_core::sensor::Image;
use rayon::prelude::*;

use super::recording::Frames;
use crate::dataset::truth::{FrameText, FrameTruth, Totals, Truth, TruthWriter};
use crate::dataset::{Camera, ContactSheet, FileHashes, FrameEntry, frame_paths};
use scenario::Scenario;
use storage::checksums::{Fingerprint, fingerprint};
use storage::folder::Partial;
use storage::journal::Listing;
use storage::{Error, OutputFolder, Progress, Result};

/// Maximum number of frames in a batch, per thread.
const FRAMES_PER_THREAD: usize = 3;

/// Maximum number of pixels of a batch of several frames.
const BATCH_PIXELS: usize = 1 << 26;

/// A batch ends with the frame that reaches this number of tracers, per thread.
pub(super) const TRACERS_PER_THREAD: usize = 8_192;

/// Maximum number of frames in a batch: large ones are processed one by one.
pub(super) fn frames_per_batch(scenario: &Scenario) -> usize {
    let pixels = scenario.settings.pixel_dim_x as usize * scenario.settings.pixel_dim_y as usize;
    (BATCH_PIXELS / pixels).clamp(1, FRAMES_PER_THREAD * rayon::current_num_threads())
}

/// Computes all frames in batches; tables of images are made once for a batch. `take` is called in parallel
/// with each frame and the previous one; `add` receives its results in the order of frames.
pub(super) fn in_batches<T: Send>(
    scenario: &Scenario,
    truth: &Truth<'_>,
    progress: &Progress,
    take: impl Fn(&Frame, Option<&Frame>) -> Result<T> + Sync,
    mut add: impl FnMut(Vec<T>) -> Result<()> + Send,
) -> Result<()> {
    let bar = progress.images(u64::from(scenario.recordings.frames()));
    let most = frames_per_batch(scenario);
    let mut all = Frames::new(scenario)?;
    let (mut before, mut batch, mut taken) = (None, next_batch(&mut all, most)?, Vec::new());
    while !batch.is_empty() {
        let take_all = || {
            truth.prepare(&batch);
            let numbered = batch.par_iter().enumerate();
            let outputs = numbered.map(|(i, frame)| {
                progress.check()?;
                let before = if i > 0 { batch.get(i - 1) } else { before.as_ref() };
                let output = take(frame, before);
                bar.inc(1);
                output
            });
            outputs.collect::<Result<Vec<T>>>()
        };
        // Meanwhile, sequential work: adding the previous batch and advancing to the next one.
        let meanwhile = || (add(std::mem::take(&mut taken)), next_batch(&mut all, most));
        let ((added, next), outputs) = rayon::join(meanwhile, take_all);
        added?;
        taken = outputs?;
        before = batch.pop();
        batch = next?;
    }
    add(taken)?;
    bar.finish();
    Ok(())
}

/// Computes, renders and writes all frames. Returns the counts for the manifest, the fingerprints of the
/// files and the largest fraction of saturated pixels in a frame of the contact sheet.
pub(super) fn write(
    partial: &Partial,
    scenario: &Scenario,
    camera: &Camera,
    truth: &Truth<'_>,
    progress: &Progress,
) -> Result<(Totals, FileHashes, f64)> {
    let files = FrameFiles::new(partial, scenario, camera)?;
    let mut writer = DatasetWriter::new(partial.folder(), scenario)?;
    let take = |frame: &Frame, before: Option<&Frame>| {
        // Of the truth, only text and particles stay in memory while the image is made.
        let (text, rows) = {
            let truth = truth.frame(frame, before)?;
            (FrameText::of(scenario, &truth), truth.particles)
        };
        let stored = files.store(frame.index, &rows, || camera.image(&rows, frame.index))?;
        camera.renderer().shortfall()?;
        Ok((frame.index, text, stored))
    };
    let add = |outputs: Vec<(u32, FrameText, StoredFrame)>| {
        outputs.into_iter().try_for_each(|(index, text, stored)| writer.add(index, &text, stored))
    };
    in_batches(scenario, truth, progress, take, add)?;
    writer.finish(partial.folder())
}

/// Writes frames whose truth is in memory; `image` returns the image of a frame. Returns the same as
/// [`write`].
pub(super) fn write_from_memory(
    partial: &Partial,
    scenario: &Scenario,
    camera: &Camera,
    truths: &[FrameTruth],
    image: impl Fn(usize) -> Image + Sync,
    progress: &Progress,
) -> Result<(Totals, FileHashes, f64)> {
    let files = FrameFiles::new(partial, scenario, camera)?;
    let mut writer = DatasetWriter::new(partial.folder(), scenario)?;
    let bar = progress.images(truths.len() as u64);
    let group = frames_per_batch(scenario);
    for (first, truths) in (0..).step_by(group).zip(truths.chunks(group)) {
        let store = |(i, truth): (usize, &FrameTruth)| {
            progress.check()?;
            let stored = files.store((first + i) as u32, &truth.particles, || image(first + i));
            bar.inc(1);
            Ok(((first + i) as u32, FrameText::of(scenario, truth), stored?))
        };
        let outputs: Vec<_> = truths.par_iter().enumerate().map(store).collect::<Result<_>>()?;
        outputs.into_iter().try_for_each(|(index, text, stored)| writer.add(index, &text, stored))?;
    }
    bar.finish();
    writer.finish(partial.folder())
}

/// Writes the frames to tables, hashes and contact sheet, in order.
struct DatasetWriter {
    tables: TruthWriter,
    hashes: FileHashes,
    sheet: ContactSheet,
    /// Largest fraction of saturated pixels in a frame of the contact sheet.
    saturated: f64,
}

impl DatasetWriter {
    fn new(folder: &OutputFolder, scenario: &Scenario) -> Result<Self> {
        Ok(DatasetWriter {
            tables: TruthWriter::create(folder, scenario)?,
            hashes: FileHashes::default(),
            sheet: ContactSheet::default(),
            saturated: 0.0,
        })
    }

    fn add(&mut self, index: u32, text: &FrameText, stored: StoredFrame) -> Result<()> {
        let StoredFrame { particles, image, picture } = stored;
        self.tables.add(text)?;
        self.hashes.frames.push(FrameEntry { visible: text.visible(), particles, image });
        if let Some((tile, saturated)) = picture {
            self.sheet.add(index, tile);
            self.saturated = self.saturated.max(saturated);
        }
        Ok(())
    }

    fn finish(mut self, folder: &OutputFolder) -> Result<(Totals, FileHashes, f64)> {
        self.sheet.write(folder)?;
        let totals = self.tables.finish(&mut self.hashes)?;
        Ok((totals, self.hashes, self.saturated))
    }
}

/// Fraction of the pixels at or above the camera's highest count.
fn saturated_fraction(image: &Image, end_counts: f64) -> f64 {
    let last = end_counts.floor().max(1.0);
    image.counts.values().filter(|count| *count >= last).count() as f64 / image.counts.len().max(1) as f64
}

fn next_batch(frames: &mut Frames, most: usize) -> Result<Vec<Frame>> {
    let (mut batch, mut room) = (Vec::new(), TRACERS_PER_THREAD * rayon::current_num_threads());
    while batch.len() < most && room > 0 {
        let Some(frame) = frames.next().transpose()? else { break };
        room = room.saturating_sub(frame.tracers.len());
        batch.push(frame);
    }
    Ok(batch)
}

/// The files of frames: data files and images.
struct FrameFiles<'a> {
    folder: &'a OutputFolder,
    /// Files that an interrupted run has finished.
    before: &'a Listing,
    scenario: &'a Scenario,
    camera: &'a Camera,
    /// Frames that are on the contact sheet.
    shown: Vec<u32>,
    /// Saturation of the camera, counts.
    end_counts: f64,
    files: BufferPool<Vec<u8>>,
}

/// A frame whose files are written.
struct StoredFrame {
    particles: Fingerprint,
    image: Fingerprint,
    /// If the contact sheet shows it: its tile, and the fraction of saturated pixels.
    picture: Option<(GrayImage, f64)>,
}

impl<'a> FrameFiles<'a> {
    fn new(partial: &'a Partial, scenario: &'a Scenario, camera: &'a Camera) -> Result<Self> {
        Ok(FrameFiles {
            folder: partial.folder(),
            before: partial.before(),
            scenario,
            camera,
            shown: ContactSheet::chosen(scenario.recordings.frames(), scenario.recordings.are_pairs()),
            end_counts: scenario.sensor()?.saturation_counts(),
            files: BufferPool::default(),
        })
    }

    /// Writes a frame's data file and its image. The image is not computed if an interrupted run has finished
    /// it, unless the contact sheet needs it.
    fn store(&self, index: u32, rows: &[Particle], image: impl FnOnce() -> Image) -> Result<StoredFrame> {
        let wanted = self.shown.contains(&index);
        let [data, file] = frame_paths(&self.scenario.recordings, index);
        let mut text = self.files.get();
        data_file::write(&mut *text, rows, self.scenario.layout)
            .map_err(Error::write(&self.folder.join(&data)))?;
        self.folder.save_bytes(&data, &*text)?;
        let particles = Fingerprint::of(&text);
        drop(text);
        if let Some(image) = self.finished_before(&file).filter(|_| !wanted) {
            self.folder.finished(&file, &image)?;
            return Ok(StoredFrame { particles, image, picture: None });
        }
        let (drawn, path) = (image(), self.folder.join(&file));
        self.folder.save(&file, |writer| self.camera.write_tiff(writer, &drawn, None, &path))?;
        // Read back: the first bytes of the file, which name the place of the last, are written last.
        let image = fingerprint(&path)?;
        self.folder.finished(&file, &image)?;
        let picture = || (ContactSheet::tile(&drawn), saturated_fraction(&drawn, self.end_counts));
        Ok(StoredFrame { particles, image, picture: wanted.then(picture) })
    }

    /// The fingerprint of a file that an interrupted run has finished, if the file is unchanged.
    fn finished_before(&self, file: &str) -> Option<Fingerprint> {
        if !self.before.done.contains_key(file) {
            return None;
        }
        // A file that cannot be read is written again.
        fingerprint(&self.folder.join(file)).ok().filter(|found| self.before.has(file, found))
    }
}
