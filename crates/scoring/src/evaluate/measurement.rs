//! Facts about a measurement, and how large and of what form its results may be.

use std::collections::BTreeMap;
use std::io::{BufRead, BufReader};
use std::path::Path;

use crate::results::sheet::shorten;
use crate::results::{Conventions, Limits, TrackerResult};
use storage::checksums::fingerprint;
use storage::dataset::cases::{CASES, CaseReader};
use storage::dataset::manifest::MANIFEST;
use storage::dataset::{FieldRow, RecordingFacts, Row, TrackRow};
use storage::error::{Error, Result};
use storage::input;

/// Facts of a dataset or a bare table; `given` values take precedence.
pub fn facts_of(path: &Path, given: &Conventions) -> Result<RecordingFacts> {
    let facts = if path.is_dir() {
        RecordingFacts::read(path)?
    } else {
        RecordingFacts {
            name: path.file_stem().unwrap_or_default().to_string_lossy().into_owned(),
            sha256: Some(fingerprint(path)?.sha256.to_string()),
            ..RecordingFacts::default()
        }
    };
    Ok(with_given(facts, given))
}

/// The facts, of which `given` ones take precedence.
pub(super) fn with_given(facts: RecordingFacts, given: &Conventions) -> RecordingFacts {
    let um_per_px = given.um_per_px.or(facts.um_per_px);
    let (depth_um, dt_s) = (given.depth_um.or(facts.depth_um), given.dt_s.or(facts.dt_s));
    RecordingFacts { um_per_px, depth_um, dt_s, ..facts }
}

/// Describes rows of a result in frames or image pairs that the dataset does not have, each with file and
/// line.
pub fn beyond(facts: &RecordingFacts, path: &Path, found: &TrackerResult) -> Vec<String> {
    // The list is cut off for files in which most rows are wrong.
    const MOST: usize = 100;
    let place = |lines: &[u32], i: usize| match lines.get(i) {
        Some(line) => format!("{}:{line}", path.display()),
        None => path.display().to_string(),
    };
    let frames = facts.frames.unwrap_or(u32::MAX);
    let mut wrong: Vec<String> = match found {
        TrackerResult::Points(points) => {
            let rows = points.rows.iter().enumerate().filter(|(_, row)| row.frame >= frames);
            let what = |frame: u32| format!("frame = {frame}: expected 0 to {}", frames.saturating_sub(1));
            rows.take(MOST)
                .map(|(i, row)| format!("{}: {}", place(&points.lines, i), what(row.frame)))
                .collect()
        }
        TrackerResult::Field(field) => {
            let pairs = field.vectors.iter().enumerate().filter_map(|(i, v)| Some((i, v.pair?)));
            let wrong = pairs.filter(|(_, pair)| !facts.has_pair(*pair)).take(MOST);
            let what = |pair: u32| format!("pair = {pair}: the dataset has no such image pair");
            wrong.map(|(i, pair)| format!("{}: {}", place(&field.lines, i), what(pair))).collect()
        }
    };
    shorten(&mut wrong);
    wrong
}

/// Refuses a dataset and a result in the wrong order.
/// Errors: a file in place of the dataset, and a dataset in place of the result.
pub fn check_order(dataset: &Path, result: &Path) -> Result<()> {
    if dataset.is_file() && result.join(MANIFEST).is_file() {
        return Err(Error::input(format!(
            "{} is a dataset and {} a file: give the dataset first, then the result",
            result.display(),
            dataset.display()
        )));
    }
    Ok(())
}

/// Upper limits on the size of a result, from the size of the truth (a dataset or a bare table).
pub fn limits(dataset: &Path, facts: &RecordingFacts) -> Result<Limits> {
    let parts = [TrackRow::PATH, FieldRow::PATH];
    let files = if dataset.is_dir() {
        parts.map(|path| dataset.join(path)).to_vec()
    } else {
        vec![dataset.to_owned()]
    };
    let sizes: Vec<TableSize> =
        files.iter().filter(|path| path.exists()).map(|path| TableSize::of(path)).collect::<Result<_>>()?;
    // A test split has no truth.
    Ok(if sizes.is_empty() { Limits::default() } else { TableSize::limits(&sizes, facts) })
}

#[derive(Debug, Clone, Copy, Default)]
pub(super) struct TableSize {
    pub(super) bytes: u64,
    pub(super) rows: u64,
}

impl TableSize {
    /// The size of a file.
    pub(super) fn of(path: &Path) -> Result<Self> {
        let mut size = TableSize::default();
        let mut reader = BufReader::with_capacity(1 << 16, input::open(path)?);
        loop {
            let piece = reader.fill_buf().map_err(|e| Error::read(path, e))?;
            if piece.is_empty() {
                return Ok(size);
            }
            let n = piece.len();
            size.rows += piece.iter().filter(|byte| **byte == b'\n').count() as u64;
            size.bytes += n as u64;
            reader.consume(n);
        }
    }

    /// Limits on a result for these tables.
    pub(super) fn limits(sizes: &[TableSize], facts: &RecordingFacts) -> Limits {
        let pixels = facts.sensor_px.map_or(0.0, |(width, height)| width * height);
        let sum = |of: fn(&TableSize) -> u64| sizes.iter().map(of).sum();
        Limits::for_truth(sum(|size| size.bytes), sum(|size| size.rows), pixels as u64)
    }
}

/// The parameter values of a dataset that is a case of a sweep, from the table of cases in the parent folder.
/// Empty for other datasets.
pub(super) fn axes(dataset: &Path) -> Result<BTreeMap<String, serde_json::Value>> {
    let Ok(whole) = dataset.canonicalize() else { return Ok(BTreeMap::new()) };
    let (Some(sweep), Some(name)) = (whole.parent(), whole.file_name()) else { return Ok(BTreeMap::new()) };
    if !whole.join(MANIFEST).is_file() || !sweep.join(CASES).is_file() {
        return Ok(BTreeMap::new());
    }
    let Some(mut cases) = CaseReader::open(sweep)? else { return Ok(BTreeMap::new()) };
    while let Some((dataset, values)) = cases.next_case()? {
        if *name == *dataset {
            let axes = cases.axes().iter().cloned();
            return Ok(axes.zip(values.iter().map(|text| value(text))).collect());
        }
    }
    Ok(BTreeMap::new())
}

/// Converts a cell to a number if possible, otherwise to text.
fn value(text: &str) -> serde_json::Value {
    scenario::number(text).map_or_else(|| text.into(), serde_json::Value::from)
}
