//! Readers of what trackers write, one format a file.
//!
//! Whatever the file's origin, units, direction of y and first frame: a reader gives px with the first pixel's centre at
//! (1, 1), y downward, z in um, frames from 0, and says in its notes what it took the file to mean. Files are hostile
//! until proven otherwise: no allocation is sized by what a header claims, lines and rows are bounded, numbers are
//! finite and of a size that can be computed with.
//!
//! To add a format (DaVis, LPT/DA, OpenPTV and MyPTV are wanted): a file here, a [`Format`], a line in [`detect`] and one
//! in [`read`].

mod canonical;
mod defocustracker;
mod flo;
mod napari;
mod openpiv;
mod pivlab;
pub(crate) mod sheet;
mod trackmate;
mod trackpy;
mod xml;

use std::io::Read;
use std::path::Path;

use crate::error::{Error, Result};
pub use canonical::{field as read_field, points as read_points};

/// A place.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Position {
    /// Column, px; the first pixel's centre is 1.
    pub x_px: f64,
    /// Row, downward, px; the first pixel's centre is 1.
    pub y_px: f64,
    /// Depth, um; 0 in data without depth.
    pub z_um: f64,
}

/// A particle in a frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Row {
    /// Frame, from 0.
    pub frame: u32,
    /// Track; -1: not linked.
    pub track: i64,
    /// Where.
    pub at: Position,
}

/// A table of particles.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Points {
    /// The rows that hold numbers.
    pub rows: Vec<Row>,
    /// Line of the file of every row; empty if there are none, as in XML.
    pub lines: Vec<u32>,
    /// Claimed standard uncertainties of every row along x, y (px) and z (um), NaN where none; empty if the file has none.
    pub sigma: Vec<[f64; 3]>,
    /// Velocities, if the file has any.
    pub velocities: Option<Velocities>,
    /// Whether there is a depth.
    pub has_z: bool,
    /// Rows that were dropped because a coordinate is missing or NaN.
    pub n_nan: usize,
    /// What the reader took the file to mean.
    pub notes: Vec<String>,
}

/// Velocities as a file has them, y downward.
#[derive(Debug, Clone, PartialEq)]
pub struct Velocities {
    /// Their unit.
    pub unit: Speed,
    /// Of every row along x, y, z; NaN where there is none.
    pub rows: Vec<[f64; 3]>,
}

/// A unit of velocities.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Speed {
    /// um/s.
    UmPerS,
    /// px per frame, along z um per frame.
    PerFrame,
}

/// A vector of a displacement field.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Vector {
    /// Image pair; `None`: the file does not tell.
    pub pair: Option<u32>,
    /// Where; z is 0 if the file does not tell.
    pub at: Position,
    /// Displacement along x, y (px) and z (um, NaN if not measured).
    pub moved: [f64; 3],
    /// 0 valid, 1 invalid, 2 interpolated.
    pub flag: u8,
    /// Claimed standard uncertainty along x and y, px; NaN if none.
    pub sigma: [f64; 2],
}

/// A displacement field.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Field {
    /// The vectors; of invalid ones displacements may be NaN.
    pub vectors: Vec<Vector>,
    /// Line of the file of every vector; empty if the reader does not tell.
    pub lines: Vec<u32>,
    /// Rows that were dropped because a position is missing.
    pub n_nan: usize,
    /// What the reader took the file to mean.
    pub notes: Vec<String>,
}

/// What a result holds.
#[derive(Debug, Clone, PartialEq)]
pub enum Found {
    /// Particles.
    Points(Points),
    /// A displacement field.
    Field(Field),
}

/// Formats that are read.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Format {
    /// Our own CSV of particles.
    Canonical,
    /// trackpy's data frame as CSV.
    Trackpy,
    /// TrackMate's table of spots.
    TrackmateSpots,
    /// TrackMate's tracks as XML.
    TrackmateXml,
    /// XML of the ISBI challenge.
    Isbi,
    /// DefocusTracker's table as CSV.
    Defocustracker,
    /// DefocusTracker's text file.
    DefocustrackerAscii,
    /// napari's tracks as CSV.
    Napari,
    /// Our own CSV of a field.
    Field,
    /// OpenPIV's text file.
    Openpiv,
    /// PIVlab's text file.
    Pivlab,
    /// Middlebury's dense flow.
    Flo,
}

/// Where the first pixel's centre is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Origin {
    /// (1, 1)
    Center1,
    /// (0, 0)
    Center0,
    /// (0.5, 0.5)
    Corner0,
}

impl Origin {
    /// What to add for centres at (1, 1), px.
    pub fn shift_px(self) -> f64 {
        match self {
            Origin::Center1 => 0.0,
            Origin::Center0 => 1.0,
            Origin::Corner0 => 0.5,
        }
    }

    fn words(self) -> &'static str {
        match self {
            Origin::Center1 => "(1, 1)",
            Origin::Center0 => "(0, 0)",
            Origin::Corner0 => "(0.5, 0.5)",
        }
    }
}

/// What is known about a file from outside; `None`: as usual in its format.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Conventions {
    /// The format.
    pub format: Option<Format>,
    /// Where the first pixel's centre is.
    pub origin: Option<Origin>,
    /// Whether y grows upward.
    pub y_up: Option<bool>,
    /// Number of the first frame.
    pub frame_base: Option<i64>,
    /// Object-space length of a pixel, um.
    pub um_per_px: Option<f64>,
    /// Least and greatest depth, um.
    pub depth_um: Option<(f64, f64)>,
    /// Height of the images, px.
    pub height_px: Option<f64>,
}

/// What a format means when nobody says otherwise.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Usual {
    name: &'static str,
    origin: Origin,
    frame_base: i64,
    /// px per unit of length in the image plane.
    unit: Unit,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Unit {
    Px,
    Um,
}

/// Rows as they stand in a file, turned into ours.
#[derive(Debug)]
pub(crate) struct Converter {
    shift: f64,
    flip_at: Option<f64>,
    scale: f64,
    frame_base: i64,
    pub(crate) notes: Vec<String>,
}

/// Rows that were dropped because a coordinate is missing.
#[derive(Debug, Default)]
pub(crate) struct Dropped {
    n: usize,
    first: Vec<u64>,
}

impl Dropped {
    /// One more.
    pub(crate) fn at(&mut self, line: u64) {
        self.n += 1;
        if self.first.len() < 5 {
            self.first.push(line);
        }
    }

    /// How many, with a note if there are any.
    pub(crate) fn told(self, notes: &mut Vec<String>) -> usize {
        if self.n > 0 {
            let lines: Vec<String> = self.first.iter().map(u64::to_string).collect();
            let more = if self.n > lines.len() { ", ..." } else { "" };
            let lines = format!("lines {}{more}", lines.join(", "));
            notes.push(format!("{} rows without coordinates were dropped ({lines})", self.n));
        }
        self.n
    }
}

/// Beyond this a coordinate is no place in an image; squares of it are still far from infinite.
const LARGEST_PX: f64 = 1e7;
const LARGEST_UM: f64 = 1e9;
const LARGEST_SPEED: f64 = 1e12;

impl Converter {
    pub(crate) fn new(usual: Usual, given: &Conventions) -> Result<Self> {
        let origin = given.origin.unwrap_or(usual.origin);
        let frame_base = given.frame_base.unwrap_or(usual.frame_base);
        let y_up = given.y_up.unwrap_or(false);
        let scale = match (usual.unit, given.um_per_px) {
            (Unit::Px, _) => 1.0,
            (Unit::Um, Some(um)) => 1.0 / um,
            (Unit::Um, None) => {
                return Err(Error::input(format!("{}: lengths are um; give --um-per-px", usual.name)));
            }
        };
        let flip_at = match (y_up, given.height_px) {
            (false, _) => None,
            (true, Some(height)) => Some(height + 1.0),
            (true, None) => {
                return Err(Error::input("--y up: the height of the images is not known from a bare table"));
            }
        };
        let unit = match usual.unit {
            Unit::Px => "px".to_owned(),
            Unit::Um => format!("um, {} um per px", 1.0 / scale),
        };
        let notes = vec![format!(
            "{}: x, y in {unit}; first pixel's centre at {}; y {}; z in um; frames from {frame_base}",
            usual.name,
            origin.words(),
            if y_up { "up" } else { "down" },
        )];
        Ok(Converter { shift: origin.shift_px(), flip_at, scale, frame_base, notes })
    }

    /// A place in our coordinates, or what is wrong with it. `None`: a coordinate is missing.
    pub(crate) fn place(&self, x: f64, y: f64, z_um: f64) -> std::result::Result<Option<Position>, String> {
        if x.is_nan() || y.is_nan() || z_um.is_nan() {
            return Ok(None);
        }
        let (x_px, y_px) = (x * self.scale + self.shift, y * self.scale + self.shift);
        for (name, value, most, unit) in
            [("x", x_px, LARGEST_PX, "px"), ("y", y_px, LARGEST_PX, "px"), ("z", z_um, LARGEST_UM, "um")]
        {
            // Infinite numbers are too large as well.
            if value.abs() > most {
                return Err(format!("{name} = {value:?} {unit}: expected at most {most:e} {unit} in size"));
            }
        }
        let y_px = self.flip_at.map_or(y_px, |height| height - y_px);
        Ok(Some(Position { x_px, y_px, z_um }))
    }

    /// A frame counted from 0, or what is wrong with it.
    pub(crate) fn frame(&self, value: f64) -> std::result::Result<u32, String> {
        let frame = value - self.frame_base as f64;
        if value.fract() != 0.0 || !(0.0..=f64::from(u32::MAX - 1)).contains(&frame) {
            return Err(format!("frame = {value:?}: expected a whole number from {} on", self.frame_base));
        }
        Ok(frame as u32)
    }

    /// A displacement, y downward.
    pub(crate) fn moved(&self, dx: f64, dy: f64) -> [f64; 2] {
        [dx * self.scale, if self.flip_at.is_some() { -dy } else { dy } * self.scale]
    }

    /// A velocity, of columns of these names, y downward.
    pub(crate) fn velocity(&self, told: [f64; 3], names: [&str; 3]) -> std::result::Result<[f64; 3], String> {
        let [u, v, w] = told;
        match told.iter().zip(names).find(|(c, _)| c.abs() > LARGEST_SPEED) {
            Some((c, name)) => {
                Err(format!("{name} = {c:?}: expected a velocity of at most {LARGEST_SPEED:e}"))
            }
            None => Ok([u, if self.flip_at.is_some() { -v } else { v }, w]),
        }
    }

    /// Says which columns are not used.
    pub(crate) fn ignores(&mut self, sheet: &sheet::Sheet, used: &[&str]) {
        let others = sheet.others(used);
        let (shown, more) = (&others[..others.len().min(8)], others.len().saturating_sub(8));
        if !shown.is_empty() {
            let more = if more > 0 { format!(" and {more} more") } else { String::new() };
            self.notes.push(format!("columns not used: {}{more}", shown.join(", ")));
        }
    }

    /// Claimed uncertainties, of columns of these names: of x and y in px, of z as it is.
    pub(crate) fn claimed(&self, told: [f64; 3], names: [&str; 3]) -> std::result::Result<[f64; 3], String> {
        match told.iter().zip(names).find(|(s, _)| **s < 0.0 || **s > LARGEST_UM) {
            Some((s, name)) => {
                Err(format!("{name} = {s:?}: expected an uncertainty from 0 to {LARGEST_UM:e}"))
            }
            None => Ok([told[0] * self.scale, told[1] * self.scale, told[2]]),
        }
    }
}

/// Reads a result.
///
/// # Errors
/// What is wrong with the file, with line numbers; a format that is not recognised.
pub fn read(path: &Path, given: &Conventions) -> Result<Found> {
    let format = match given.format {
        Some(format) => format,
        None => detect(path)?,
    };
    let mut found = match format {
        Format::Canonical => Found::Points(canonical::points(path, given)?),
        Format::Trackpy => Found::Points(trackpy::read(path, given)?),
        Format::TrackmateSpots => Found::Points(trackmate::spots(path, given)?),
        Format::TrackmateXml => Found::Points(xml::trackmate(path, given)?),
        Format::Isbi => Found::Points(xml::isbi(path, given)?),
        Format::Defocustracker => Found::Points(defocustracker::csv(path, given)?),
        Format::DefocustrackerAscii => Found::Points(defocustracker::ascii(path, given)?),
        Format::Napari => Found::Points(napari::read(path, given)?),
        Format::Field => Found::Field(canonical::field(path, given)?),
        Format::Openpiv => Found::Field(openpiv::read(path, given)?),
        Format::Pivlab => Found::Field(pivlab::read(path, given)?),
        Format::Flo => Found::Field(flo::read(path, given)?),
    };
    let how = if given.format.is_some() { "as --format says" } else { "recognised by its header" };
    let notes = match &mut found {
        Found::Points(points) => {
            unique(path, points)?;
            &mut points.notes
        }
        Found::Field(field) => &mut field.notes,
    };
    if let Some(first) = notes.first_mut() {
        *first = format!("{first} ({how})");
    }
    Ok(found)
}

/// A track is in one place at a time.
fn unique(path: &Path, points: &Points) -> Result<()> {
    let mut linked: Vec<(i64, u32, u32)> = (0..points.rows.len() as u32)
        .map(|i| (points.rows[i as usize].track, points.rows[i as usize].frame, i))
        .filter(|(track, ..)| *track >= 0)
        .collect();
    linked.sort_unstable();
    let line = |i: u32| points.lines.get(i as usize).map_or(String::new(), |line| format!(":{line}"));
    let mut twice: Vec<String> = linked
        .windows(2)
        .filter(|w| (w[0].0, w[0].1) == (w[1].0, w[1].1))
        .map(|w| format!("{}{}: track {} is twice in frame {}", path.display(), line(w[1].2), w[0].0, w[0].1))
        .collect();
    sheet::shorten(&mut twice);
    if twice.is_empty() { Ok(()) } else { Err(Error::Input(twice)) }
}

/// The format of a file, from its first lines.
///
/// # Errors
/// An empty file; a header that fits no format.
pub fn detect(path: &Path) -> Result<Format> {
    let mut head = Vec::new();
    let file = std::fs::File::open(path).map_err(|e| Error::read(path, e))?;
    file.take(4096).read_to_end(&mut head).map_err(|e| Error::read(path, e))?;
    let name = path.display();
    if head.is_empty() {
        return Err(Error::input(format!("{name}: empty; expected at least a header")));
    }
    if head.starts_with(b"PIEH") {
        return Ok(Format::Flo);
    }
    let instead = |what: &str, columns: &str| {
        let message = format!("{name}: {what} files cannot be read; write a CSV with the columns {columns}");
        Err(Error::Unsupported(vec![message]))
    };
    let later = |what: &str| instead(what, "frame, track, x_px, y_px, z_um");
    let later_field = |what: &str| instead(what, "x_px, y_px, dx_px, dy_px, flag [, pair]");
    if head.starts_with(b"\x89PNG") {
        return later_field("PNG (KITTI flow)");
    }
    if head.len() == 4096 && !head.contains(&b'\n') && !head.starts_with(b"<") {
        return Err(Error::input(format!("{name}:1: the first line is longer than 4096 bytes")));
    }
    let text = String::from_utf8_lossy(&head);
    let text = text.trim_start_matches('\u{feff}');
    if text.trim_start().starts_with('<') {
        return match () {
            () if text.contains("TrackContestISBI2012") => Ok(Format::Isbi),
            () if text.contains("<Tracks") => Ok(Format::TrackmateXml),
            () if text.contains("<TrackMate") => later("full TrackMate"),
            () => Err(Error::input(format!("{name}: XML, but neither TrackMate's tracks nor ISBI's"))),
        };
    }
    let lines: Vec<&str> = text.lines().take(4).collect();
    let first = lines.first().copied().unwrap_or_default();
    let second = lines.get(1).copied().unwrap_or_default();
    if first.starts_with("PIVlab") || lines.iter().any(|l| l.starts_with("x [")) {
        return Ok(Format::Pivlab);
    }
    if second.trim_start().starts_with("scaling") {
        return Ok(Format::DefocustrackerAscii);
    }
    if first.trim_start().to_ascii_lowercase().starts_with("title") {
        return match second.contains("PartID") {
            true => later("LPT/DA"),
            false => later_field("DaVis (Tecplot)"),
        };
    }
    if first.starts_with('#') && first.contains('x') && first.contains('u') {
        return Ok(Format::Openpiv);
    }
    // Numbers without a header: OpenPTV begins with the count of its rows, MyPTV has tabs.
    let numbers = |line: &str| {
        let words: Vec<&str> = line.split_whitespace().collect();
        if words.iter().all(|word| word.parse::<f64>().is_ok()) { words.len() } else { 0 }
    };
    match (numbers(first), numbers(second)) {
        (1, 5 | 8) => return later("OpenPTV"),
        (6.., _) if first.contains('\t') => return later("MyPTV"),
        _ => {}
    }
    let columns: Vec<&str> = first.split([',', '\t']).map(|c| c.trim().trim_matches('"')).collect();
    let has = |names: &[&str]| names.iter().all(|n| columns.contains(n));
    match () {
        () if has(&["POSITION_X", "POSITION_Y", "FRAME"]) => Ok(Format::TrackmateSpots),
        () if has(&["fr", "X", "Y"]) => Ok(Format::Defocustracker),
        () if has(&["x_px", "y_px", "dx_px", "dy_px"]) && !has(&["frame"]) => Ok(Format::Field),
        () if has(&["x_px", "y_px", "frame"]) => Ok(Format::Canonical),
        () if has(&["track_id", "t", "y", "x"]) => Ok(Format::Napari),
        () if has(&["x", "y", "frame"]) && (has(&["particle"]) || has(&["mass"])) => Ok(Format::Trackpy),
        () if first.contains(';') => Err(Error::input(format!(
            "{name}:1: semicolons separate the columns; expected commas, and points in numbers"
        ))),
        () if has(&["x", "y"]) => Err(Error::input(format!(
            "{name}:1: columns {first:?} have no units: name them frame, track, x_px, y_px, z_um (or x_px, y_px, dx_px, \
             dy_px of a field), or say with --format which program wrote them"
        ))),
        () => Err(Error::input(format!("{name}:1: header {:?} fits no format; say --format", shown(first)))),
    }
}

/// A line as messages show it.
pub(crate) fn shown(line: &str) -> String {
    let short: String = line.chars().take(80).collect();
    if short.len() < line.len() { short + "..." } else { short }
}
