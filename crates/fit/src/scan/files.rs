//! The files of a scan: which page is a frame of which plane, and the positions that they state.

use std::fs::File;
use std::io::BufReader;
use std::path::{Path, PathBuf};

use microsig_core::formats::arrangement::{Arrangement, AxisPosition};
use microsig_core::formats::pages::{PageSize, Pages};
use storage::advice;
use storage::advice::option;
use storage::error::{Error, Result};
use storage::{input, walk};

use super::{MAX_PIXELS, StagePositions, read_positions, steps};

/// A frame of a scan.
struct Frame {
    /// The plane and the number among the frames of the plane.
    slice: usize,
    time: usize,
    /// The page, or in a folder the file, which a table of positions names.
    source: usize,
    position: Option<AxisPosition>,
    counts: Vec<u16>,
}

/// The frames of a file or folder.
pub(super) struct ScanFiles {
    pub(super) width: usize,
    pub(super) height: usize,
    pub(super) full_scale: u16,
    /// In the order of the pages, until there are positions.
    frames: Vec<Frame>,
    /// Pages of the file, or files of the folder.
    sources: usize,
    /// Names of the files of a folder.
    names: Vec<String>,
    /// The step between slices, um.
    step_um: Option<f64>,
    by: &'static str,
    /// What is wrong with the step or the positions that the files state.
    wrong: Option<String>,
    /// Whether the frames are stated to be times of one slice.
    are_times: bool,
}

/// Relative difference of positions from equal steps, or from a stated step, of which nothing is said.
const SAME_STEP: f64 = 0.01;

/// Difference of the positions of the frames of a slice, as a share of the step, that a mean hides.
const SAME_SLICE: f64 = 0.1;

fn open(file: &Path) -> Result<Pages<BufReader<File>>> {
    Ok(Pages::open(BufReader::new(input::open(file)?), &file.display().to_string())?)
}

/// Number of channels that a file, or the first of a folder, states.
pub(super) fn channels(path: &Path) -> Result<usize> {
    let first = if path.is_dir() { path.join(&names(path)?[0]) } else { path.to_owned() };
    let mut pages = open(&first)?;
    while pages.go_on()? {}
    let n = pages.page() + 1;
    Ok(pages.arrangement(n)?.map_or(1, |of| of.sizes[0]))
}

fn names(folder: &Path) -> Result<Vec<String>> {
    let names = walk::names(folder, walk::is_tiff)?;
    if names.is_empty() {
        let stacks = walk::names(folder, |name| name.starts_with("d_") && name.ends_with("um"))?;
        let hint = stacks.first().map_or_else(String::new, |name| {
            format!(
                "; this folder contains stacks for several particle sizes; give one of them, such as {name}"
            )
        });
        let folder = folder.display();
        return Err(Error::input(format!("{folder}: no *.tif files: expected one image per plane{hint}")));
    }
    Ok(names)
}

/// The channel that is given, or the only one that a file states.
///
/// # Errors
/// Several channels of which none is given, or none of them.
pub fn chosen_channel(file: &str, stated: Option<&Arrangement>, given: Option<usize>) -> Result<usize> {
    let channels = stated.map_or(1, |of| of.sizes[0]);
    match given {
        None if channels == 1 => Ok(0),
        Some(channel) if channel < channels => Ok(channel),
        _ => {
            let by = stated.map_or("nothing is stated", |of| of.by);
            let s = if channels == 1 { "" } else { "s" };
            let what = format!("{file}: {channels} channel{s} ({by}): expected ");
            let given = given.map_or(option("page"), |channel| option("page").of(channel));
            let last = format!(" to be one of 0 to {}, the channel with the particles", channels - 1);
            Err(Error::option(advice!(what, given, last)))
        }
    }
}

impl ScanFiles {
    pub(super) fn read(path: &Path, channel: Option<usize>) -> Result<Self> {
        let names = if path.is_dir() { names(path)? } else { Vec::new() };
        let files: Vec<PathBuf> = match names.is_empty() {
            true => vec![path.to_owned()],
            false => names.iter().map(|name| path.join(name)).collect(),
        };
        let mut all = ScanFiles {
            width: 0,
            height: 0,
            full_scale: 0,
            frames: Vec::new(),
            sources: names.len(),
            names,
            step_um: None,
            by: "",
            wrong: None,
            are_times: false,
        };
        let mut sets = Vec::new();
        for (number, file) in files.iter().enumerate() {
            sets.push(all.append(number, file, channel)?);
        }
        let (whole, set) = sets[0].clone();
        if sets.iter().any(|(_, other)| *other != set) {
            let what = "files of different sets (OME-XML): expected those of one scan";
            return Err(Error::input(format!("{}: {what}", path.display())));
        }
        if !set.is_empty() {
            let mut places: Vec<_> = all.frames.iter().map(|frame| (frame.slice, frame.time)).collect();
            places.sort_unstable();
            places.dedup();
            if places.len() != whole || all.frames.len() != whole {
                return Err(Error::input(format!(
                    "{}: {} of {whole} frames of a set of files (OME-XML): expected a folder with all of it: {}",
                    path.display(),
                    all.frames.len(),
                    set.join(", ")
                )));
            }
        }
        Ok(all)
    }

    /// Appends the frames of a file; gives the number of frames and the files of the set that it is part of.
    fn append(&mut self, number: usize, file: &Path, channel: Option<usize>) -> Result<(usize, Vec<String>)> {
        let name = file.display();
        let (mut pages, mut counts) = (open(file)?, Vec::new());
        loop {
            let size = pages.size()?;
            if self.width == 0 {
                (self.width, self.height) = (size.width as usize, size.height as usize);
            }
            // Checked before memory is allocated for the pixels.
            let n = self.frames.len() + counts.len() + 1;
            if self.width.saturating_mul(self.height).saturating_mul(n) > MAX_PIXELS {
                let what = format!("{name}: more than {MAX_PIXELS} pixels: crop the scan or omit planes");
                return Err(Error::input(what));
            }
            let first = PageSize { width: self.width as u32, height: self.height as u32, ..size };
            counts.push(pages.counts(first)?);
            self.full_scale = self.full_scale.max(if size.bits == 8 { 255 } else { u16::MAX });
            if !pages.go_on()? {
                break;
            }
        }
        let n = counts.len();
        let is_folder = !self.names.is_empty();
        let stated = pages.arrangement(n)?;
        let [_, slices, times] = stated.as_ref().map_or([1, n, 1], |of| of.sizes);
        let is_part = stated.as_ref().is_some_and(|of| !of.set.is_empty());
        if is_folder && slices > 1 && !is_part {
            return Err(Error::input(format!("{name}: {n} images: expected one per file in a folder")));
        }
        let chosen = chosen_channel(&name.to_string(), stated.as_ref(), channel)?;
        let wrong = |what: String| Error::input(format!("{name}: {what}"));
        if let Some(of) = &stated {
            let step = self.or_wrong(of.step_um());
            if number > 0 && step != self.step_um {
                return Err(wrong(format!("{} states another step than in the files before", of.by)));
            }
            (self.step_um, self.by) = (step, of.by);
            self.are_times = !is_folder && slices == 1 && times > 1;
        }
        self.sources = if is_folder { self.names.len() } else { n };
        for (page, counts) in counts.into_iter().enumerate() {
            let [c, z, time] = stated.as_ref().map_or([0, page, 0], |of| of.pages[page]);
            if c == chosen {
                let slice = if is_folder && !is_part { number } else { z };
                let source = if is_folder { number } else { page };
                let position = stated.as_ref().and_then(|of| self.or_wrong(of.position(page)));
                self.frames.push(Frame { slice, time, source, position, counts });
            }
        }
        Ok((slices * times, stated.map_or_else(Vec::new, |of: Arrangement| of.set)))
    }

    /// Positions that are given replace wrong ones of the file.
    fn or_wrong<T>(&mut self, value: std::result::Result<Option<T>, String>) -> Option<T> {
        value.unwrap_or_else(|what| {
            self.wrong.get_or_insert(what);
            None
        })
    }

    /// Puts the frames in the order of planes; gives the position of each, um, and what there is to say.
    pub(super) fn positions(
        &mut self,
        path: &Path,
        given: &StagePositions,
    ) -> Result<(Vec<f64>, Vec<String>)> {
        let n = self.frames.len();
        let mut said = Vec::new();
        let stage_um = match given {
            StagePositions::Table(file) => {
                let table = read_positions(file, &self.names, self.sources)?;
                let of = |frame: &Frame| {
                    let lacks = || format!("{}: has no position of page {}", file.display(), frame.source);
                    table[frame.source].ok_or_else(|| Error::input(lacks()))
                };
                self.frames.iter().map(of).collect::<Result<Vec<f64>>>()?
            }
            StagePositions::Given(stage_um) if stage_um.len() == self.planes() => {
                self.frames.iter().map(|frame| stage_um[frame.slice]).collect()
            }
            StagePositions::Given(stage_um) if stage_um.len() == n => stage_um.clone(),
            StagePositions::Given(stage_um) => {
                let (planes, given) = (self.planes(), stage_um.len());
                let what =
                    format!(": {given} positions: expected one for each of {planes} planes or {n} frames");
                return Err(Error::option(advice!(option("z"), what)));
            }
            StagePositions::Step(step) if self.are_times => {
                said.push(format!("{} states {n} times of one slice, which are taken for planes", self.by));
                steps(*step, self.frames.iter().map(|frame| frame.time))?
            }
            StagePositions::Step(step) => steps(*step, self.frames.iter().map(|frame| frame.slice))?,
            StagePositions::FromFile => self.stated(&mut said).map_err(|what| {
                let what = format!("{}: {what}; give ", path.display());
                Error::option(advice!(what, option("z"), " or ", option("z_step_um")))
            })?,
        };
        let frames = std::mem::take(&mut self.frames);
        let mut both: Vec<(Frame, f64)> = frames.into_iter().zip(stage_um).collect();
        both.sort_by_key(|(frame, _)| (frame.slice, frame.time));
        let stage_um;
        (self.frames, stage_um) = both.into_iter().unzip();
        Ok((stage_um, said))
    }

    fn planes(&self) -> usize {
        self.frames.iter().map(|frame| frame.slice + 1).max().unwrap_or(0)
    }

    /// The counts of the frames, in their order.
    pub(super) fn counts(&mut self) -> Vec<Vec<u16>> {
        self.frames.drain(..).map(|frame| frame.counts).collect()
    }

    /// The positions that the files state, um, one for each frame.
    fn stated(&self, said: &mut Vec<String>) -> std::result::Result<Vec<f64>, String> {
        if let Some(wrong) = &self.wrong {
            return Err(format!("{} states {wrong}", self.by));
        }
        let (by, n) = (self.by, self.frames.len());
        if self.are_times {
            return Err(format!("{by} states {n} times of one slice, which are no scan"));
        }
        let mut positions: Vec<(usize, AxisPosition)> =
            self.frames.iter().filter_map(|frame| Some((frame.slice, frame.position?))).collect();
        let is_moved = positions.iter().any(|(_, at)| at.um != positions[0].1.um);
        if !self.names.is_empty() && !is_moved {
            // Each file of a folder of planes states the origin of its own stack.
            positions.clear();
        }
        if positions.is_empty() {
            let step = self.step_um.ok_or("stage positions are unknown")?;
            said.push(format!("stage step of {step} um between {} planes, as {by} states", self.planes()));
            return Ok(self.frames.iter().map(|frame| step * frame.slice as f64).collect());
        }
        if positions.len() < n {
            return Err(format!("{by} states positions of {} of {n} frames", positions.len()));
        }
        let step = self.step_um.map_or_else(String::new, |step| format!(", and a step of {step} um"));
        if !is_moved {
            return Err(format!("{by} states the position {} um for all planes{step}", positions[0].1.um));
        }
        // Means over the frames of each plane.
        let mut planes = vec![(0.0, 0.0, f64::INFINITY, f64::NEG_INFINITY); self.planes()];
        for (slice, at) in &positions {
            let (sum, frames, low, high) = &mut planes[*slice];
            (*sum, *frames, *low, *high) = (*sum + at.um, *frames + 1.0, low.min(at.um), high.max(at.um));
        }
        let mean = |(sum, frames, low, high): &(f64, f64, f64, f64)| {
            if low == high { *low } else { sum / frames }
        };
        let means: Vec<f64> = planes.iter().map(mean).collect();
        let (first, last) = (means[0], means[means.len() - 1]);
        let mean_step = (last - first) / (means.len() - 1).max(1) as f64;
        let has_steps = |step: f64| {
            means
                .windows(2)
                .all(|pair| ((pair[1] - pair[0]).abs() - step.abs()).abs() <= SAME_STEP * step.abs())
        };
        let spread = planes.iter().map(|(_, _, low, high)| high - low).fold(0.0, f64::max);
        if spread > SAME_SLICE * mean_step.abs() {
            return Err(format!("{by} states positions of the frames of a plane that differ by {spread} um"));
        }
        if !positions.iter().all(|(_, at)| at.has_unit) && !self.step_um.is_some_and(has_steps) {
            return Err(format!("{by} states positions {first} to {last} without a unit{step}"));
        }
        let mut text =
            format!("stage positions {first} to {last} um of {} planes, as {by} states", means.len());
        if spread > 0.0 {
            text += &format!(", means of frames up to {spread} um apart");
        }
        if !has_steps(mean_step) {
            text += ", in unequal steps";
        }
        if let Some(step) = self.step_um.filter(|step| !has_steps(*step)) {
            text += &format!(
                "; the step of {step} um that it also states contradicts these positions and is not used"
            );
        }
        said.push(text);
        Ok(self.frames.iter().map(|frame| means[frame.slice]).collect())
    }
}
