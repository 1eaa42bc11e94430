//! A calibration scan: images of particles at rest at known stage positions.

use std::io::{BufReader, Read, Seek};
use std::path::Path;

use microsig_core::formats::pages::{PageSize, Pages};
use serde::Deserialize;

use storage::advice;
use storage::advice::option;
use storage::error::{Error, Result};
use storage::{InputFile, input};

/// Minimum number of planes.
const MIN_PLANES: usize = 7;

/// Maximum number of pixels of a scan, over all planes, of two bytes each.
const MAX_PIXELS: usize = 1 << 28;

/// The images of a scan with their stage positions.
#[derive(Debug, Clone)]
pub struct Scan {
    /// Width of every plane, px.
    pub width: usize,
    /// Height of every plane, px.
    pub height: usize,
    /// Counts of each plane, row by row.
    pub planes: Vec<Vec<u16>>,
    /// Stage position of each plane, um, strictly or weakly monotonic.
    pub stage_um: Vec<f64>,
    /// The count of saturated pixels.
    pub full_scale: u16,
    /// Warnings about how the scan was read.
    pub warnings: Vec<String>,
}

/// The frames of a scan at one stage position.
#[derive(Debug, Clone)]
pub struct Level {
    /// The position, um.
    pub z_um: f64,
    /// Their planes.
    pub planes: Vec<usize>,
}

/// Source of the stage positions.
#[derive(Debug, Clone)]
pub enum StagePositions {
    /// A CSV table with the columns `page` (from 0) or `image`, and `z_um`.
    Table(InputFile),
    /// The position of each plane, um.
    Given(Vec<f64>),
    /// A constant step between planes, um.
    Step(f64),
    /// The slice spacing that ImageJ or OME-XML states in the file's description.
    FromFile,
}

impl StagePositions {
    /// The position of each of `n` planes in memory, um.
    ///
    /// # Errors
    /// A table that cannot be read or does not have a row for each plane; [`StagePositions::FromFile`].
    pub fn of_planes(&self, n: usize) -> Result<Vec<f64>> {
        let unknown =
            || advice!("stage positions are unknown; give ", option("z"), " or ", option("z_step_um"));
        self.find(&[], n).transpose().unwrap_or_else(|| Err(Error::option(unknown())))
    }

    /// The positions of `n` planes of files with these names; `None` if the file states them.
    fn find(&self, names: &[String], n: usize) -> Result<Option<Vec<f64>>> {
        Ok(match self {
            StagePositions::Table(file) => Some(read_positions(file, names, n)?),
            StagePositions::Given(stage_um) => Some(stage_um.clone()),
            StagePositions::Step(step) if !step.is_finite() => {
                return Err(Error::option(advice!(
                    option("z_step_um").of(step),
                    ": expected a finite number"
                )));
            }
            StagePositions::Step(step) => Some((0..n).map(|i| step * i as f64).collect()),
            StagePositions::FromFile => None,
        })
    }
}

/// The planes of a file or folder, without their positions.
struct Planes {
    width: usize,
    height: usize,
    planes: Vec<Vec<u16>>,
    names: Vec<String>,
    full_scale: u16,
    spacing_um: Option<f64>,
}

impl Scan {
    /// A scan of planes of counts in memory, row by row; `full_scale`: the largest count of their type.
    ///
    /// # Errors
    /// Planes of different sizes, too many pixels; positions that are not as many, not monotonic or too few.
    pub fn new(
        (width, height): (usize, usize),
        planes: Vec<Vec<u16>>,
        stage_um: Vec<f64>,
        full_scale: u16,
    ) -> Result<Scan> {
        let pixels = width.saturating_mul(height);
        if pixels == 0 || planes.iter().any(|plane| plane.len() != pixels) {
            return Err(Error::input(format!("expected planes of {width} x {height} px")));
        }
        if pixels.saturating_mul(planes.len()) > MAX_PIXELS {
            return Err(Error::input(format!("more than {MAX_PIXELS} pixels: crop the scan or omit planes")));
        }
        let (n, given) = (planes.len(), stage_um.len());
        if n < MIN_PLANES {
            let what = format!("{n} planes; expected at least {MIN_PLANES}, on both sides of the focus");
            return Err(Error::input(what));
        }
        if n != given || stage_um.iter().any(|z_um| !z_um.is_finite()) {
            let what = format!(": {given} positions; expected a finite one for each of the {n} planes");
            return Err(Error::option(advice!(option("z"), what)));
        }
        check_monotonic(&stage_um)?;
        let full_scale = saturation(&planes, full_scale);
        Ok(Scan { width, height, planes, stage_um, full_scale, warnings: Vec::new() })
    }

    /// Reads a scan from a multi-page TIFF, or from a folder of TIFF files in the natural order of their
    /// names.
    ///
    /// # Errors
    /// [`Error::Input`] if an image cannot be read, is not gray, or if positions are missing, not monotonic
    /// or too few.
    pub fn read(path: &Path, positions: &StagePositions) -> Result<Scan> {
        let planes = if path.is_dir() { read_folder(path)? } else { read_pages(path)? };
        let n = planes.planes.len();
        let mut warnings = Vec::new();
        let stage_um = match positions.find(&planes.names, n)? {
            Some(stage_um) => stage_um,
            None => {
                let step = planes.spacing_um.ok_or_else(|| {
                    let what = format!("{}: stage positions are unknown; give ", path.display());
                    Error::option(advice!(what, option("z"), " or ", option("z_step_um")))
                })?;
                warnings.push(format!("stage step of {step} um taken from the image description"));
                (0..n).map(|i| step * i as f64).collect()
            }
        };
        let named = |name: String| {
            move |e: Error| match e {
                Error::Input(what) => Error::input(format!("{name}: {}", what.join("; "))),
                other => other,
            }
        };
        if let StagePositions::Table(file) = positions {
            check_monotonic(&stage_um).map_err(named(file.display().to_string()))?;
        }
        let Planes { width, height, planes, full_scale, .. } = planes;
        let scan = Scan::new((width, height), planes, stage_um, full_scale)
            .map_err(named(path.display().to_string()))?;
        Ok(Scan { warnings, ..scan })
    }

    /// The scan restricted to planes `first` to `last`, counted from 0.
    ///
    /// # Errors
    /// [`Error::Input`] if the range has too few planes or exceeds the scan.
    pub fn cut(mut self, first: usize, last: usize) -> Result<Scan> {
        let n = self.planes.len();
        if last >= n || first > last || last - first + 1 < MIN_PLANES {
            let what = format!(": expected a range of at least {MIN_PLANES} planes within 0-{}", n - 1);
            return Err(Error::option(advice!(option("planes").of(format!("{first}-{last}")), what)));
        }
        self.planes = self.planes.drain(first..=last).collect();
        self.stage_um = self.stage_um[first..=last].to_vec();
        Ok(self)
    }

    /// The stage positions, increasing, each with its frames.
    pub fn levels(&self) -> Vec<Level> {
        let mut order: Vec<usize> = (0..self.planes.len()).collect();
        order.sort_by(|a, b| self.stage_um[*a].total_cmp(&self.stage_um[*b]).then(a.cmp(b)));
        let mut levels: Vec<Level> = Vec::new();
        for plane in order {
            let z_um = self.stage_um[plane];
            match levels.last_mut().filter(|level| level.z_um == z_um) {
                Some(level) => level.planes.push(plane),
                None => levels.push(Level { z_um, planes: vec![plane] }),
            }
        }
        levels
    }

    /// Mean of the stage positions, um.
    pub(super) fn mean_stage_um(&self) -> f64 {
        self.stage_um.iter().sum::<f64>() / self.stage_um.len() as f64
    }

    /// Distance between the first and the last stage position, um.
    pub(super) fn range_um(&self) -> f64 {
        self.stage_um.last().zip(self.stage_um.first()).map_or(0.0, |(a, b)| (a - b).abs())
    }
}

/// The count of saturated pixels: the highest one if it is the full scale of a camera or if many pixels have
/// it, otherwise that of the file's pixel type.
fn saturation(planes: &[Vec<u16>], of_type: u16) -> u16 {
    let mut histogram = vec![0_u64; 1 << 16];
    planes.iter().flatten().for_each(|count| histogram[usize::from(*count)] += 1);
    let mut occupied = (0..=u16::MAX).rev().filter(|count| histogram[usize::from(*count)] > 0);
    let Some(most) = occupied.next() else { return of_type };
    let pixels = |count: u16| histogram[usize::from(count)];
    // Few pixels are brightest unless their counts are cut off.
    let below = occupied.take(8).map(pixels).max();
    let is_cut_off = below.is_some_and(|below| pixels(most) >= MANY_SATURATED.max(4 * below));
    if is_cut_off || [1023, 4095, 16_383].contains(&most) { most } else { of_type }
}

/// Least number of pixels with the highest count of a scan by which it is known to be cut off.
const MANY_SATURATED: u64 = 16;

fn check_monotonic(stage_um: &[f64]) -> Result<()> {
    let falls = |pair: &[f64]| pair[1] < pair[0];
    let rises = |pair: &[f64]| pair[1] > pair[0];
    if stage_um.windows(2).any(falls) && stage_um.windows(2).any(rises) {
        let descending = stage_um.last() < stage_um.first();
        let wrong = stage_um.windows(2).position(if descending { rises } else { falls }).unwrap_or(0) + 1;
        return Err(Error::input(format!(
            "stage position of plane {wrong} is {} um after {} um: expected positions that only increase or only decrease; \
             are the planes in the wrong order?",
            stage_um[wrong],
            stage_um[wrong - 1]
        )));
    }
    if stage_um.last() == stage_um.first() {
        return Err(Error::input("all stage positions are equal: expected a scan over depth".to_owned()));
    }
    Ok(())
}

fn read_pages(path: &Path) -> Result<Planes> {
    let file = input::open(path)?;
    let mut all = Planes {
        width: 0,
        height: 0,
        planes: Vec::new(),
        names: Vec::new(),
        full_scale: 0,
        spacing_um: None,
    };
    read_tiff(&mut all, BufReader::new(file), &path.display().to_string())?;
    Ok(all)
}

fn read_folder(path: &Path) -> Result<Planes> {
    let entries = std::fs::read_dir(path).map_err(|e| Error::read(path, e))?;
    let mut names: Vec<String> = entries
        .filter_map(|entry| entry.ok()?.file_name().into_string().ok())
        .filter(|name| {
            let lower = name.to_ascii_lowercase();
            lower.ends_with(".tif") || lower.ends_with(".tiff")
        })
        .collect();
    names.sort_by(|a, b| natord::compare(a, b));
    if names.is_empty() {
        let stacks = std::fs::read_dir(path).map_err(|e| Error::read(path, e))?;
        let stacks = stacks.filter_map(|entry| entry.ok()?.file_name().into_string().ok());
        let stack = stacks.filter(|name| name.starts_with("d_") && name.ends_with("um")).min();
        let hint = stack.map_or_else(String::new, |name| {
            format!(
                "; this folder contains stacks for several particle sizes; give one of them, such as {name}"
            )
        });
        return Err(Error::input(format!(
            "{}: no *.tif files: expected one image per plane{hint}",
            path.display()
        )));
    }
    let mut all = Planes {
        width: 0,
        height: 0,
        planes: Vec::new(),
        names: Vec::new(),
        full_scale: 0,
        spacing_um: None,
    };
    for name in names {
        let file = path.join(&name);
        let reader = BufReader::new(input::open(&file)?);
        let before = all.planes.len();
        read_tiff(&mut all, reader, &file.display().to_string())?;
        if all.planes.len() != before + 1 {
            return Err(Error::input(format!(
                "{}: {} images: expected one per file in a folder",
                file.display(),
                all.planes.len() - before
            )));
        }
        all.names.push(name);
    }
    Ok(all)
}

/// Appends all pages of a TIFF file.
fn read_tiff(all: &mut Planes, reader: BufReader<impl Read + Seek>, name: &str) -> Result<()> {
    let mut pages = Pages::open(reader, name)?;
    loop {
        let page = all.planes.len();
        let size = pages.size()?;
        if page == 0 {
            (all.width, all.height) = (size.width as usize, size.height as usize);
            all.spacing_um = pages.spacing_um();
        }
        // Checked before memory is allocated for the pixels.
        if all.width.saturating_mul(all.height).saturating_mul(page + 1) > MAX_PIXELS {
            let message = format!("{name}: more than {MAX_PIXELS} pixels: crop the scan or omit planes");
            return Err(Error::input(message));
        }
        let first = PageSize { width: all.width as u32, height: all.height as u32, ..size };
        all.planes.push(pages.counts(first)?);
        all.full_scale = all.full_scale.max(if size.bits == 8 { 255 } else { u16::MAX });
        if !pages.go_on()? {
            return Ok(());
        }
    }
}

/// A row of the table of stage positions.
#[derive(Debug, Deserialize)]
struct Position {
    page: Option<usize>,
    image: Option<String>,
    z_um: f64,
}

/// Reads the stage position of each of the `n` planes (um) from a table.
fn read_positions(file: &InputFile, names: &[String], n: usize) -> Result<Vec<f64>> {
    let mut reader = csv::ReaderBuilder::new().trim(csv::Trim::All).from_reader(file.open()?);
    let mut found: Vec<(usize, f64)> = Vec::new();
    for (row, record) in reader.deserialize::<Position>().enumerate() {
        let line = row + 2;
        let refuse = |message: String| Error::input(format!("{}:{line}: {message}", file.display()));
        let record = record.map_err(|e| refuse(e.to_string()))?;
        if !record.z_um.is_finite() {
            return Err(refuse(format!("z_um = {}: expected a finite number", record.z_um)));
        }
        let page = match (record.page, record.image) {
            (Some(page), _) => page,
            // Paths as in the table of a dataset's calibration stack: the names identify the planes.
            (None, Some(image)) => names
                .iter()
                .position(|name| {
                    let image = image.rsplit(['/', '\\']).next().unwrap_or_default();
                    *name == image || name.rsplit_once('.').is_some_and(|(stem, _)| stem == image)
                })
                .ok_or_else(|| refuse(format!("image {image:?} is not in the scan's folder")))?,
            (None, None) => return Err(refuse("expected a column `page` or `image`".to_owned())),
        };
        found.push((page, record.z_um));
    }
    found.sort_by_key(|(page, _)| *page);
    // In a dataset's table, the stacks of several sizes have the same names and depths.
    found.dedup();
    if found.len() != n || found.iter().enumerate().any(|(i, (page, _))| i != *page) {
        return Err(Error::input(format!(
            "{}: {} positions: expected one for each of the {n} planes, pages counted from 0",
            file.display(),
            found.len()
        )));
    }
    Ok(found.into_iter().map(|(_, z)| z).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_plane_needs_one_position() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("z.csv");
        let read = |text: &str| {
            std::fs::write(&file, text).unwrap();
            read_positions(&InputFile::from(&file), &[], 3).map_err(|e| e.to_string())
        };
        assert_eq!(read("page,z_um\n2,4\n0,0\n1,2\n"), Ok(vec![0.0, 2.0, 4.0]));
        for text in ["page,z_um\n0,0\n1,2\n", "page,z_um\n0,0\n1,2\n2,4\n3,6\n", "page,z_um\n0,0\n1,2\n1,4\n"]
        {
            assert!(read(text).unwrap_err().contains("expected one for each of the 3 planes"), "{text}");
        }
        assert!(read("page,z_um\n0,NaN\n").unwrap_err().contains("z.csv:2: z_um = NaN"));
    }

    #[test]
    fn images_of_a_folder_are_named_as_in_a_dataset() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("stack.csv");
        let names = ["00000.tif", "00001.tif"].map(str::to_owned);
        for images in
            [["calibration/images/00001.tif", "calibration/images/00000.tif"], ["00001.tif", "00000"]]
        {
            std::fs::write(&file, format!("image,z_um\n{},6\n{},0\n", images[0], images[1])).unwrap();
            assert_eq!(read_positions(&InputFile::from(&file), &names, 2).unwrap(), [0.0, 6.0]);
        }
        std::fs::write(&file, "image,z_um\na/1.tif,6\n").unwrap();
        let message = read_positions(&InputFile::from(&file), &names, 2).unwrap_err().to_string();
        assert!(message.contains("stack.csv:2: image \"a/1.tif\" is not in the scan's folder"), "{message}");
    }

    #[test]
    fn counts_that_are_cut_off_are_saturated() {
        let ramp: Vec<u16> = (0..2000).collect();
        assert_eq!(saturation(std::slice::from_ref(&ramp), u16::MAX), u16::MAX);
        assert_eq!(saturation(&[ramp.iter().map(|v| 2 * v + 97).collect()], u16::MAX), 4095);
        assert_eq!(saturation(&[ramp.iter().map(|v| *v.min(&1900)).collect()], u16::MAX), 1900);
        // Eight bits, and an image without light.
        assert_eq!(saturation(&[ramp.iter().map(|v| v / 10).collect()], 255), 255);
        assert_eq!(saturation(&[vec![0; 50]], 255), 255);
    }

    #[test]
    fn positions_must_be_monotonic() {
        assert!(check_monotonic(&[0.0, 1.0, 1.0, 2.0]).is_ok());
        assert!(check_monotonic(&[3.0, 1.0, 0.0]).is_ok());
        let message = check_monotonic(&[0.0, 2.0, 1.0, 3.0]).unwrap_err().to_string();
        assert!(message.contains("plane 2 is 1 um after 2 um"), "{message}");
        assert!(check_monotonic(&[1.0, 1.0]).is_err());
    }
}
