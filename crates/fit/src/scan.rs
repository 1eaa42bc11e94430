//! A calibration scan: images of particles at rest at known stage positions.

mod files;

use std::path::Path;

use serde::Deserialize;

use storage::InputFile;

pub use files::chosen_channel;
use storage::advice;
use storage::advice::option;
use storage::error::{Error, Result};

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
        match self {
            StagePositions::Table(file) => read_positions(file, &[], n)?.into_iter().collect::<Option<_>>(),
            StagePositions::Given(stage_um) => Some(stage_um.clone()),
            StagePositions::Step(step) => Some(steps(*step, 0..n)?),
            StagePositions::FromFile => None,
        }
        .ok_or_else(|| {
            Error::option(advice!(
                "stage positions are unknown; give ",
                option("z"),
                " or ",
                option("z_step_um")
            ))
        })
    }
}

fn steps(step: f64, planes: impl Iterator<Item = usize>) -> Result<Vec<f64>> {
    if !step.is_finite() {
        return Err(Error::option(advice!(option("z_step_um").of(step), ": expected a finite number")));
    }
    Ok(planes.map(|plane| step * plane as f64).collect())
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
        if n != given || stage_um.iter().any(|z_um| !z_um.is_finite()) {
            let what = format!(": {given} positions; expected a finite one for each of the {n} planes");
            return Err(Error::option(advice!(option("z"), what)));
        }
        let depths = stage_um.chunk_by(|a, b| a == b).count();
        if depths < MIN_PLANES {
            let what = format!("{depths} planes; expected at least {MIN_PLANES}, on both sides of the focus");
            return Err(Error::input(what));
        }
        check_monotonic(&stage_um)?;
        let full_scale = saturation(&planes, full_scale);
        Ok(Scan { width, height, planes, stage_um, full_scale, warnings: Vec::new() })
    }

    /// Reads a scan from a multi-page TIFF, or from a folder of TIFF files in the natural order of their
    /// names. Where a file states slices and times, times are repeated frames of their slice. `channel`: the
    /// one to read if it states several.
    ///
    /// # Errors
    /// [`Error::Input`] if an image cannot be read, is not gray, or if positions are missing, not monotonic
    /// or too few; [`Error::Options`] if the channel is not one of the file's.
    pub fn read(path: &Path, positions: &StagePositions, channel: Option<usize>) -> Result<Scan> {
        let mut found = files::ScanFiles::read(path, channel)?;
        let (stage_um, warnings) = found.positions(path, positions)?;
        let named = |name: String| {
            move |e: Error| match e {
                Error::Input(what) => Error::input(format!("{name}: {}", what.join("; "))),
                other => other,
            }
        };
        if let StagePositions::Table(file) = positions {
            check_monotonic(&stage_um).map_err(named(file.display().to_string()))?;
        }
        let scan = Scan::new((found.width, found.height), found.counts(), stage_um, found.full_scale)
            .map_err(named(path.display().to_string()))?;
        Ok(Scan { warnings, ..scan })
    }

    /// Number of channels that the file of a scan, or the first of a folder, states.
    pub fn channels(path: &Path) -> Result<usize> {
        files::channels(path)
    }

    /// The scan restricted to planes `first` to `last`, counted from 0; all frames of a position are one plane.
    ///
    /// # Errors
    /// [`Error::Input`] if the range has too few planes or exceeds the scan.
    pub fn cut(mut self, first: usize, last: usize) -> Result<Scan> {
        let frames: Vec<usize> = self.stage_um.chunk_by(|a, b| a == b).map(<[f64]>::len).collect();
        let n = frames.len();
        if last >= n || first > last || last - first + 1 < MIN_PLANES {
            let what = format!(": expected a range of at least {MIN_PLANES} planes within 0-{}", n - 1);
            return Err(Error::option(advice!(option("planes").of(format!("{first}-{last}")), what)));
        }
        let [start, end]: [usize; 2] = [first, last + 1].map(|plane| frames[..plane].iter().sum());
        let range = start..end;
        self.planes = self.planes.drain(range.clone()).collect();
        self.stage_um = self.stage_um[range].to_vec();
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

    pub(super) fn mean_stage_um(&self) -> f64 {
        self.stage_um.iter().sum::<f64>() / self.stage_um.len() as f64
    }

    /// Distance between the first and the last stage position, um.
    pub(super) fn range_um(&self) -> f64 {
        self.stage_um.last().zip(self.stage_um.first()).map_or(0.0, |(a, b)| (a - b).abs())
    }
}

/// The count of saturated pixels: the highest one if it is the full scale of a camera or if many pixels have
/// it, otherwise the range of the file's pixel type.
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

/// A row of the table of stage positions.
#[derive(Debug, Deserialize)]
struct Position {
    page: Option<usize>,
    image: Option<String>,
    z_um: f64,
}

/// Reads the stage positions (um) of `n` pages, or of the files of a folder with these names, from a table.
fn read_positions(file: &InputFile, names: &[String], n: usize) -> Result<Vec<Option<f64>>> {
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
    // In a dataset's table, the stacks of several sizes have the same names and depths.
    let mut stage_um = vec![None; n];
    for (page, z_um) in &found {
        if stage_um
            .get_mut(*page)
            .is_none_or(|place| place.replace(*z_um).is_some_and(|other| other != *z_um))
        {
            return Err(Error::input(format!(
                "{}: page {page} at {z_um} um: expected one position for each page, 0 to {}",
                file.display(),
                n - 1
            )));
        }
    }
    Ok(stage_um)
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
            StagePositions::Table(InputFile::from(&file)).of_planes(3).map_err(|e| e.to_string())
        };
        assert_eq!(read("page,z_um\n2,4\n0,0\n1,2\n"), Ok(vec![0.0, 2.0, 4.0]));
        assert!(read("page,z_um\n0,0\n1,2\n").unwrap_err().contains("positions are unknown"));
        for text in ["page,z_um\n0,0\n1,2\n2,4\n3,6\n", "page,z_um\n0,0\n1,2\n1,4\n"] {
            assert!(read(text).unwrap_err().contains("one position for each page, 0 to 2"), "{text}");
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
            assert_eq!(read_positions(&InputFile::from(&file), &names, 2).unwrap(), [Some(0.0), Some(6.0)]);
        }
        std::fs::write(&file, "image,z_um\na/1.tif,6\n").unwrap();
        let message = read_positions(&InputFile::from(&file), &names, 2).unwrap_err().to_string();
        assert!(message.contains("stack.csv:2: image \"a/1.tif\" is not in the scan's folder"), "{message}");
    }

    /// A file of `tests/data/tiff`, whose script says what its counts are.
    fn read(
        name: &str,
        channel: Option<usize>,
        positions: &StagePositions,
    ) -> std::result::Result<Scan, String> {
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/data/tiff");
        let scan = Scan::read(&folder.join(name), positions, channel).map_err(|e| e.to_string())?;
        // Planes by their counts, of which the file may state other positions.
        let planes = scan.planes.iter().map(|counts| counts[0] % 100 / 10).collect::<Vec<_>>();
        let repeats = scan.planes.len() / 7;
        assert_eq!(planes, (0..7).flat_map(|z| vec![z; repeats]).collect::<Vec<_>>(), "{name}");
        Ok(scan)
    }

    #[test]
    fn frames_of_other_programs_are_in_their_planes() {
        let step = |step_um: f64| (0..7).map(|z| step_um * f64::from(z)).collect::<Vec<_>>();
        let uneven: Vec<f64> = (0..7).map(|z| f64::from(z * z) / 4.0).collect();
        for (name, channel, repeats, z_um) in [
            ("imagej_tz.tif", None, 3, step(2.0)),
            ("imagej_zc.tif", Some(1), 1, step(2.0)),
            ("imagej_large.tif", None, 1, step(2.0)),
            ("imagej_nm.tif", None, 1, step(2.0)),
            ("latin1.tif", None, 1, step(2.0)),
            ("ome_zt.ome.tif", None, 3, step(2.0)),
            ("ome_falling.ome.tif", None, 1, step(-2.0).into_iter().rev().collect()),
            ("ome_uneven.ome.tif", None, 1, uneven),
            ("ome_only.ome.tif", None, 1, step(2.0)),
            ("set", None, 1, step(2.0)),
        ] {
            let scan = read(name, channel, &StagePositions::FromFile).unwrap();
            let levels = scan.levels();
            assert_eq!(levels.iter().map(|level| level.z_um).collect::<Vec<_>>(), z_um, "{name}");
            assert!(levels.iter().all(|level| level.planes.len() == repeats), "{name}");
            assert_eq!(scan.warnings.len(), 1, "{:?}", scan.warnings);
            let contradicts = scan.warnings[0].contains("contradicts");
            assert_eq!(contradicts, name == "ome_uneven.ome.tif", "{:?}", scan.warnings);
            assert_eq!(scan.planes[0][9], 1000 * channel.unwrap_or(0) as u16 + 9);
        }
        // A step counts planes, whatever else is between them; times alone are planes only if a step is given.
        for (name, repeats) in
            [("tifffile_zt.tif", 3), ("imagej_tz.tif", 3), ("imagej_t.tif", 1), ("white.tif", 1)]
        {
            let scan = read(name, None, &StagePositions::Step(0.5)).unwrap();
            assert_eq!(
                (scan.levels().len(), scan.levels()[6].z_um, scan.planes.len()),
                (7, 3.0, 7 * repeats),
                "{name}"
            );
        }
        let given = StagePositions::Given(step(-1.0));
        let scan = read("imagej_tz.tif", None, &given).unwrap();
        assert_eq!(scan.stage_um[20], -6.0);
        assert_eq!(scan.clone().cut(0, 6).unwrap().planes.len(), 21);
        assert!(scan.cut(0, 7).is_err());
        let few = Scan::new((1, 1), vec![vec![9]; 9], (0..9).map(|k| f64::from(k / 3)).collect(), u16::MAX);
        assert!(few.unwrap_err().to_string().starts_with("3 planes; expected at least 7"));
    }

    #[test]
    fn statements_that_tell_no_scan_are_refused() {
        let own = &StagePositions::FromFile;
        for (name, channel, found) in [
            ("imagej_zc.tif", None, "2 channels (ImageJ): expected --page to be one of 0 to 1"),
            ("imagej_zc.tif", Some(2), "--page 2 to be one of 0 to 1"),
            ("white.tif", Some(1), "1 channel (nothing is stated): expected --page 1 to be one of 0 to 0"),
            (
                "imagej_t.tif",
                None,
                "ImageJ states 7 times of one slice, which are no scan; give --z or --z-step",
            ),
            ("ome_fixed.ome.tif", None, "the position 5 um for all planes, and a step of 2 um; give --z"),
            ("tifffile_zt.tif", None, "stage positions are unknown"),
            (
                "set/part_0.ome.tif",
                None,
                "4 of 7 frames of a set of files (OME-XML): expected a folder with all of it",
            ),
            ("colors.tif", None, "a palette of colors"),
        ] {
            let message = read(name, channel, own).unwrap_err();
            assert!(message.contains(found), "{name}: {message}");
        }
    }

    #[test]
    fn counts_are_those_in_the_file() {
        let counts = |name: &str| read(name, None, &StagePositions::Step(1.0)).unwrap().planes;
        let expected = counts("tifffile_zt.tif").into_iter().step_by(3).collect::<Vec<_>>();
        for name in
            ["white.tif", "zstd.tif", "palette.tif", "packed_10.tif", "packed_12.tif", "imagej_large.tif"]
        {
            assert_eq!(counts(name), expected, "{name}");
        }
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
