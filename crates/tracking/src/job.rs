//! A run of a tracker on a dataset: frames in parallel, progress, timing, warnings.

use std::collections::HashMap;
use std::sync::Mutex;

use rayon::prelude::*;

use super::cpu_time::Consumer;
use super::gray_image::GrayImage;
use super::output::{DisplacementVector, Output, Row};
use super::positions::{Position, Positions};
use super::recording::Recording;
use super::{Localization, TrackOptions, link, sides};
use storage::dataset::DatasetPlace;
use storage::error::Result;

/// A dataset and the options of the tracker.
#[derive(Debug)]
pub(super) struct Job<'a> {
    pub(super) dataset: &'a DatasetPlace,
    pub(super) options: &'a TrackOptions,
    pub(super) recording: Recording,
    pub(super) positions: Option<Positions>,
    log: Mutex<Log>,
}

/// Timing and warnings collected over frames.
#[derive(Debug, Default)]
struct Log {
    seconds: Vec<f64>,
    warnings: Vec<String>,
    notes: Vec<String>,
}

impl<'a> Job<'a> {
    pub(super) fn new(dataset: &'a DatasetPlace, options: &'a TrackOptions) -> Result<Self> {
        let recording = Recording::open(dataset)?;
        let read = |file| Positions::read(file, recording.frames(), recording.size());
        let positions = options.positions.as_ref().map(read).transpose()?;
        Ok(Job { dataset, options, recording, positions, log: Mutex::default() })
    }

    fn log(&self) -> std::sync::MutexGuard<'_, Log> {
        // The log stays consistent if a thread panics.
        self.log.lock().unwrap_or_else(std::sync::PoisonError::into_inner)
    }

    /// The positions of particles in a frame, if they are given.
    pub(super) fn given(&self, frame: usize) -> Option<&[Position]> {
        self.positions.as_ref().map(|positions| positions.in_frame(frame))
    }

    /// Adds a warning to the run.
    pub(super) fn warn(&self, warning: impl Into<String>) {
        self.log().warnings.push(warning.into());
    }

    /// Says how the run works.
    pub(super) fn note(&self, note: impl Into<String>) {
        self.log().notes.push(note.into());
    }

    /// Warnings, then notes.
    pub(super) fn into_messages(self) -> (Vec<String>, Vec<String>) {
        let log = self.log.into_inner().unwrap_or_else(std::sync::PoisonError::into_inner);
        (log.warnings, log.notes)
    }

    /// Mean and maximum CPU time per frame, s.
    pub(super) fn frame_seconds(&self) -> Option<(f64, f64)> {
        let seconds = &self.log().seconds;
        let mean = seconds.iter().sum::<f64>() / seconds.len() as f64;
        (!seconds.is_empty()).then(|| (mean, seconds.iter().copied().fold(0.0, f64::max)))
    }

    /// Processes items in parallel with timing and a progress bar; results are in the order of the items.
    fn timed<I: Copy + Sync, T: Send>(
        &self,
        items: &[I],
        work: impl Fn(I) -> Result<T> + Sync,
    ) -> Result<Vec<T>> {
        let bar = self.options.progress.images(items.len() as u64);
        let done = items
            .par_iter()
            .map(|&item| {
                self.options.progress.check()?;
                let start = Consumer::Thread.seconds();
                let result = work(item)?;
                self.log().seconds.push(Consumer::Thread.seconds() - start);
                bar.inc(1);
                Ok(result)
            })
            .collect();
        bar.finish();
        done
    }

    /// Processes items sequentially with timing and a progress bar.
    pub(super) fn sequentially<I: Copy>(
        &self,
        items: &[I],
        mut work: impl FnMut(usize, I) -> Result<()>,
    ) -> Result<()> {
        let bar = self.options.progress.images(items.len() as u64);
        let done = items.iter().enumerate().try_for_each(|(k, &item)| {
            self.options.progress.check()?;
            // All threads work on one item.
            let start = Consumer::Process.seconds();
            work(k, item)?;
            self.log().seconds.push(Consumer::Process.seconds() - start);
            bar.inc(1);
            Ok(())
        });
        bar.finish();
        done
    }

    /// Localizes particles in every frame and links those that are not known.
    pub(super) fn particles(
        &self,
        find: impl Fn(usize, &GrayImage) -> Vec<Localization> + Sync,
    ) -> Result<Output> {
        let frames: Vec<usize> = (0..self.recording.frames()).collect();
        let found = self.timed(&frames, |k| Ok(find(k, &self.recording.frame(k)?)))?;
        let range =
            link::SearchRange { px: self.options.max_displacement_px, um: self.recording.depth_h_um() };
        let known: Option<Vec<Row>> = (found.iter().zip(0..))
            .flat_map(|(points, frame)| {
                points.iter().map(move |point| Some(Row { frame, track: point.track?, found: *point }))
            })
            .collect();
        let is_known = known.is_some();
        let mut rows = known.unwrap_or_else(|| link::link(&found, range, self.recording.pairs()));
        let at_rest = self.positions.as_ref().is_some_and(Positions::hold_for_all_frames);
        sides::choose(&mut rows, range.um.map_or(f64::INFINITY, |depth_h_um| depth_h_um / 3.0), at_rest);
        let unsure = rows.iter().filter(|row| row.found.other.is_some()).count();
        if unsure > 0 {
            self.note(format!(
                "{unsure} of {} particles may be on the other side of the focus as well (`other_z_um`, `other_likelihood`)",
                rows.len()
            ));
        }
        if let Some(positions) = &self.positions {
            self.say_of_positions(positions, rows.len());
        }
        self.warn_of_streaks();
        self.recording.hopeless().iter().for_each(|why| self.warn(why));
        if rows.is_empty() {
            self.warn("no particle was found in any frame; check that size, shape and optics are those of the images");
        } else if !is_known && !self.warn_of_displacements() {
            self.warn_of_few_links(&rows);
        }
        Ok(Output::Points(rows))
    }

    /// How many given positions have a particle, and whether there are frames without any.
    fn say_of_positions(&self, positions: &Positions, measured: usize) {
        let given: Vec<usize> =
            (0..self.recording.frames()).map(|frame| positions.in_frame(frame).len()).collect();
        self.note(format!("particles at {measured} of {} given positions", given.iter().sum::<usize>()));
        let without = given.iter().filter(|n| **n == 0).count();
        if without > 0 {
            self.warn(format!(
                "no positions are given in {without} of {} frames, and nothing is searched there; without the column `frame`, \
                 positions hold for all frames",
                given.len()
            ));
        }
    }

    /// Warns if the dataset states displacements beyond the search range.
    fn warn_of_displacements(&self) -> bool {
        let range_px = self.options.max_displacement_px;
        let beyond = self.recording.max_displacement_px().filter(|moved_px| *moved_px > range_px);
        if let Some(moved_px) = beyond {
            self.warn(format!(
                "particles of this dataset move by up to {moved_px:.1} px from frame to frame, and are searched for \
                 within {range_px} px: links are missed or wrong; try a maximum displacement of {} px",
                moved_px.ceil()
            ));
        }
        beyond.is_some()
    }

    /// Warns if particles move within an exposure, of which their calibration images show nothing.
    fn warn_of_streaks(&self) {
        /// Streaks up to this length hardly change images, px.
        const SHORT_PX: f64 = 1.0;
        if let Some(streak_px) = self.recording.max_streak_px().filter(|streak_px| *streak_px > SHORT_PX) {
            self.warn(format!(
                "particles of this dataset move by up to {streak_px:.1} px within an exposure. The method takes them as at \
                 rest: streaks resemble its images the less, the brighter they are, and may be missed or found in pieces"
            ));
        }
    }

    /// Warns if hardly any particle is found in two frames, which suggests displacements beyond the search
    /// range.
    fn warn_of_few_links(&self, rows: &[Row]) {
        /// Number of particles below which this may be chance, and the minimum fraction of linked particles.
        const MANY: usize = 20;
        const LEAST_LINKED: f64 = 0.2;
        let mut points: HashMap<i64, usize> = HashMap::new();
        for row in rows {
            *points.entry(row.track).or_default() += 1;
        }
        let linked = rows.iter().filter(|row| points[&row.track] > 1).count();
        let share = linked as f64 / rows.len() as f64;
        if self.recording.frames() > 1 && rows.len() >= MANY && share < LEAST_LINKED {
            self.warn(format!(
                "only {linked} of {} particles are found again in another frame; check whether they move by more than \
                 the maximum displacement ({} px) or leave the image",
                rows.len(),
                self.options.max_displacement_px
            ));
        }
    }

    /// Measures the displacement field of every image pair.
    pub(super) fn fields(
        &self,
        measure: impl Fn(&GrayImage, &GrayImage) -> Vec<DisplacementVector> + Sync,
    ) -> Result<Output> {
        let fields = self.timed(&self.recording.image_pairs(), |(pair, first)| {
            let (a, b) = (self.recording.frame(first)?, self.recording.frame(first + 1)?);
            Ok((pair, measure(&a, &b)))
        })?;
        Ok(Output::Fields(fields))
    }
}
