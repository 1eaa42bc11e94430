//! Conventions of result files (coordinates, units, frame numbers) and their conversion to microsig's.

use std::ops::RangeInclusive;
use std::path::Path;
use std::str::FromStr;

use clap::Args;
use clap::builder::{PossibleValuesParser, TypedValueParser};
use schemars::JsonSchema;
use serde::Deserialize;

use super::Format;
use super::table::{BoxSize, Position, TrackRow};
use microsig_core::formats::arrangement::unit_um;
use storage::advice::{Advice, option};
use storage::argument::choice;
use storage::dataset::{LARGEST_UM, RecordingFacts};
use storage::error::{Error, Result};
use storage::range::faults;
use storage::{NumberRange, advice};

/// The allowed sizes of a pixel and times between frames.
const SCALE: [NumberRange; 2] = [
    NumberRange { key: "um_per_px", least: 1e-6, most: 1e6, unit: "um" },
    NumberRange { key: "dt_s", least: 1e-12, most: 1e9, unit: "s" },
];

/// Coordinates of the first pixel's center.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Origin {
    /// (1, 1)
    Center1,
    /// (0, 0)
    Center0,
    /// (0.5, 0.5)
    Corner0,
    /// Half the size of the image from (0, 0), which is its middle
    Middle,
}

impl Origin {
    pub(crate) const ALL: [Self; 4] = [Self::Center0, Self::Corner0, Self::Center1, Self::Middle];

    /// Shift to be added to x and y so that the first center is (1, 1), px.
    pub(crate) fn shift_px(self, given: &Conventions) -> Result<[f64; 2]> {
        match (self, given.width_px.zip(given.height_px)) {
            (Origin::Center1, _) => Ok([0.0; 2]),
            (Origin::Center0, _) => Ok([1.0; 2]),
            (Origin::Corner0, _) => Ok([0.5; 2]),
            (Origin::Middle, Some((width, height))) => Ok([0.5 * (width + 1.0), 0.5 * (height + 1.0)]),
            (Origin::Middle, None) => {
                let what = ": a bare table does not contain the size of the images";
                Err(Error::option(advice!(option("origin").is("middle"), what)))
            }
        }
    }

    /// The name as an option, and in words.
    pub(crate) fn names(self) -> [&'static str; 2] {
        match self {
            Origin::Center1 => ["center1", "first pixel's center at (1, 1)"],
            Origin::Center0 => ["center0", "first pixel's center at (0, 0)"],
            Origin::Corner0 => ["corner0", "first pixel's center at (0.5, 0.5)"],
            Origin::Middle => ["middle", "middle of the image at (0, 0)"],
        }
    }
}

/// A unit of length.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum LengthUnit {
    /// Pixels
    Px,
    /// Nanometers
    Nm,
    /// Micrometers
    Um,
    /// Millimeters
    Mm,
    /// Centimeters
    Cm,
    /// Meters
    M,
    /// Inches
    Inch,
}

/// Every unit with its symbol, which is also its name as an option, and its size in um.
const UNITS: [(LengthUnit, &str, Option<f64>); 7] = [
    (LengthUnit::Px, "px", None),
    (LengthUnit::Nm, "nm", Some(1e-3)),
    (LengthUnit::Um, "um", Some(1.0)),
    (LengthUnit::Mm, "mm", Some(1e3)),
    (LengthUnit::Cm, "cm", Some(1e4)),
    (LengthUnit::M, "m", Some(1e6)),
    (LengthUnit::Inch, "inch", Some(25_400.0)),
];

impl LengthUnit {
    pub(crate) fn all() -> impl Iterator<Item = Self> {
        UNITS.iter().map(|unit| unit.0)
    }

    /// The unit in um; `None`: pixels.
    pub(crate) fn um(self) -> Option<f64> {
        UNITS[self as usize].2
    }

    pub(crate) fn symbol(self) -> &'static str {
        UNITS[self as usize].1
    }

    /// The unit of this symbol or English name, in any of the spellings of ImageJ and its plugins.
    pub(crate) fn from_name(name: &str) -> Option<Self> {
        // The micro sign may be XML, bytes of UTF-8 read as Latin-1, or a byte that is no UTF-8.
        let micro = ["&#181;", "\u{c2}\u{b5}", "\u{e2}\u{b5}", "\u{fffd}"];
        let name = &micro.iter().fold(name.to_owned(), |name, sign| name.replace(sign, "u"));
        let word = name.trim().to_lowercase();
        let is_px = ["px", "pix", "pixel", "voxel"].contains(&word.strip_suffix('s').unwrap_or(&word));
        let um = if is_px { None } else { Some(unit_um(name).or_else(|| unit_um(&word))?) };
        UNITS.iter().find(|unit| unit.2 == um).map(|unit| unit.0)
    }
}

/// Image pairs of a field whose file does not state them.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum PairChoice {
    /// All, as for an ensemble correlation.
    All,
    /// This one; of several files, the first has it.
    First(u32),
}

impl FromStr for PairChoice {
    type Err = String;

    fn from_str(text: &str) -> std::result::Result<Self, String> {
        match text {
            "all" => Ok(PairChoice::All),
            text => text
                .parse()
                .map(PairChoice::First)
                .map_err(|_| "expected a number from 0 on, or all".to_owned()),
        }
    }
}

/// Conventions given by the user or the dataset; `None` means the default of the format.
#[derive(Debug, Clone, Copy, Default, PartialEq, Args)]
pub struct Conventions {
    /// The result's format [default: detected from its header]
    #[arg(long, value_parser = choice::<Format>())]
    pub format: Option<Format>,
    /// Coordinate of the first pixel's center in the result [default: the format's]
    #[arg(long, value_parser = choice::<Origin>())]
    pub origin: Option<Origin>,
    /// Unit of x and y in the result, in tables with one unit for all axes also of z [default: as stated in it, or the
    /// unit of the format]
    #[arg(long, value_parser = choice::<LengthUnit>())]
    pub unit: Option<LengthUnit>,
    /// Direction of the y axis in the result [default: down]
    #[arg(long = "y", value_name = "Y", value_parser = PossibleValuesParser::new(["down", "up"]).map(|y| y == "up"))]
    pub y_up: Option<bool>,
    /// Added to x and y in the image, px.
    #[arg(skip)]
    pub shift_px: [f64; 2],
    /// Number of the result's first frame [default: the format's]
    #[arg(long, value_name = "N")]
    pub frame_base: Option<i64>,
    /// Pixel size in object space [default: the dataset's]. A field without stated units is then in m, mm or
    /// um
    #[arg(long, value_name = "UM")]
    pub um_per_px: Option<f64>,
    /// Time between the frames of a pair [default: the dataset's]. A field without stated units is then of
    /// velocities per s
    #[arg(long = "dt", value_name = "S", alias = "dt-s")]
    pub dt_s: Option<f64>,
    /// `um_per_px` and `dt_s` given by the user: a field whose file states no units is then in physical units.
    #[arg(skip)]
    pub stated: (Option<f64>, Option<f64>),
    /// Image pair of a field, or of its first file, where the file does not state it; `all` for an ensemble
    #[arg(long, value_name = "N|all")]
    pub pair: Option<PairChoice>,
    /// Number of image pairs, and whether frames come in bursts of four.
    #[arg(skip)]
    pub pairs: Option<(u32, bool)>,
    /// Smallest and largest depth, um.
    #[arg(skip)]
    pub depth_um: Option<(f64, f64)>,
    /// Width of the images, px.
    #[arg(skip)]
    pub width_px: Option<f64>,
    /// Height of the images, px.
    #[arg(skip)]
    pub height_px: Option<f64>,
    /// Limits on the size of the file.
    #[arg(skip)]
    pub limits: Limits,
}

impl Conventions {
    /// What is out of range.
    pub fn faults(&self) -> Vec<Advice> {
        let [um_per_px, dt_s] = SCALE;
        let mut wrong = faults(&[(self.um_per_px, um_per_px), (self.dt_s, dt_s)]);
        if !self.shift_px.iter().all(|by| by.abs() <= LARGEST_PX) {
            wrong.push(advice!(option("shift_px"), format!(": expected at most {LARGEST_PX:e} px in size")));
        }
        let is_wrong = |(low, high): &(f64, f64)| !(low < high && high - low <= LARGEST_UM);
        wrong.extend(self.depth_um.filter(is_wrong).map(|(low, high)| {
            let what = ": expected two depths in um, the lower one first, at most 1e9 um apart";
            advice!(option("depth_um").of(format!("{low} {high}")), what)
        }));
        wrong
    }

    pub(super) fn shifted(&self) -> String {
        let [x, y] = self.shift_px;
        if [x, y] == [0.0; 2] { String::new() } else { format!("; shifted by ({x}, {y}) px") }
    }

    /// These conventions, completed by facts of the dataset.
    pub fn completed(self, facts: &RecordingFacts) -> Self {
        let pair_count = |frames: u32| (0..frames).filter(|pair| facts.has_pair(*pair)).count() as u32;
        Conventions {
            stated: (self.um_per_px, self.dt_s),
            pairs: facts.frames.map(|frames| (pair_count(frames), facts.bursts)),
            um_per_px: facts.um_per_px,
            dt_s: facts.dt_s,
            depth_um: facts.depth_um,
            width_px: facts.sensor_px.map(|s| s.0),
            height_px: facts.sensor_px.map(|s| s.1),
            ..self
        }
    }
}

/// Maximum number of rows of a table.
pub(super) const MAX_ROWS: usize = 20_000_000;

/// Limits on the size of result files: a plausible result is not larger, and reading would exhaust memory.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Limits {
    /// Maximum size of the file, bytes.
    pub bytes: u64,
    /// Maximum number of rows.
    pub rows: usize,
}

impl Default for Limits {
    fn default() -> Self {
        Limits { bytes: 4 << 30, rows: MAX_ROWS }
    }
}

impl Limits {
    /// Maximum ratio of the sizes of result and truth.
    pub const TIMES: u64 = 100;

    /// Limits for a truth of this size: 100 times as large, with a minimum for small truths and dense fields;
    /// `pixels` is the number of pixels of an image.
    pub fn for_truth(bytes: u64, rows: u64, pixels: u64) -> Self {
        let most = Limits::default();
        let rows = (Self::TIMES * rows).max(2 * pixels).max(100_000).min(most.rows as u64);
        let bytes = bytes.saturating_mul(Self::TIMES).max(64 * pixels).max(16 << 20).min(most.bytes);
        Limits { bytes, rows: rows as usize }
    }

    /// Refuses a file that is too large.
    pub fn check(&self, path: &Path, bytes: u64) -> Result<()> {
        if bytes <= self.bytes {
            return Ok(());
        }
        let (name, most) = (path.display(), self.bytes);
        Err(Error::input(format!(
            "{name}: {bytes} bytes; expected at most {most}, {} times the size of the truth",
            Self::TIMES
        )))
    }
}

/// Default conventions of a format.
#[derive(Debug, Clone, Copy)]
pub(crate) struct FormatDefaults {
    /// Name of the format.
    pub name: &'static str,
    /// Coordinates of the first pixel's center.
    pub origin: Origin,
    /// Number of the first frame.
    pub frame_base: i64,
    /// Unit of lengths in the image plane.
    pub unit: LengthUnit,
}

impl FormatDefaults {
    /// Lengths in px, frames from 0.
    pub(crate) const fn px(name: &'static str, origin: Origin) -> Self {
        FormatDefaults { name, origin, frame_base: 0, unit: LengthUnit::Px }
    }
}

/// Converts rows of a file to microsig's conventions.
#[derive(Debug)]
pub(crate) struct Converter {
    shift: [f64; 2],
    flip_at: Option<f64>,
    scale: f64,
    /// Factor from z in the file to um.
    z_scale: f64,
    frame_base: i64,
    /// The conventions by which it converts.
    pub conventions: Conventions,
    pub notes: Vec<String>,
}

/// Counts rows that were dropped because a coordinate is missing.
#[derive(Debug, Default)]
pub(crate) struct DroppedRows {
    n: usize,
    first: Vec<u64>,
}

impl DroppedRows {
    /// Counts one row.
    pub(crate) fn at(&mut self, line: u64) {
        self.n += 1;
        let place = self.first.partition_point(|first| *first <= line);
        self.first.insert(place, line);
        self.first.truncate(5);
    }

    /// Number of dropped rows; adds a note if there are any.
    pub(crate) fn finish(self, notes: &mut Vec<String>) -> usize {
        if self.n > 0 {
            let lines: Vec<String> = self.first.iter().map(u64::to_string).collect();
            let more = if self.n > lines.len() { ", ..." } else { "" };
            let lines = format!("lines {}{more}", lines.join(", "));
            notes.push(format!("{} rows without coordinates were dropped ({lines})", self.n));
        }
        self.n
    }
}

/// Largest plausible values; their squares are far from overflow.
pub(super) const LARGEST_PX: f64 = 1e7;
const LARGEST_SPEED: f64 = 1e12;

impl Converter {
    pub(crate) fn new(usual: FormatDefaults, given: &Conventions) -> Result<Self> {
        let origin = given.origin.unwrap_or(usual.origin);
        let frame_base = given.frame_base.unwrap_or(usual.frame_base);
        let y_up = given.y_up.unwrap_or(false);
        let unit = given.unit.unwrap_or(usual.unit);
        let scale = match (unit.um(), given.um_per_px) {
            (None, _) => 1.0,
            (Some(um), Some(um_per_px)) => um / um_per_px,
            (Some(_), None) => {
                let what = format!("{}: lengths are in {}; give ", usual.name, unit.symbol());
                return Err(Error::option(advice!(what, option("um_per_px"))));
            }
        };
        // TrackMate has one unit for all axes. Depth in pixels of unknown size is no depth.
        let (z_scale, z_unit) = match given.format {
            Some(Format::TrackmateSpots | Format::TrackmateXml) => {
                (unit.um().or(given.um_per_px).unwrap_or(0.0), unit.symbol())
            }
            _ => (1.0, "um"),
        };
        let flip_at = match (y_up, given.height_px) {
            (false, _) => None,
            (true, Some(height)) => Some(height + 1.0),
            (true, None) => {
                let what = ": a bare table does not contain the height of the images";
                return Err(Error::option(advice!(option("y").is("up"), what)));
            }
        };
        let size = given.um_per_px.filter(|_| unit != LengthUnit::Px);
        let notes = vec![format!(
            "{}: x, y in {}{}; {}; y {}{}; z in {z_unit}; frames from {frame_base}",
            usual.name,
            unit.symbol(),
            size.map_or(String::new(), |um| format!(", {um} um per px")),
            origin.names()[1],
            if y_up { "up" } else { "down" },
            given.shifted(),
        )];
        let conventions = Conventions {
            origin: Some(origin),
            unit: Some(unit),
            y_up: Some(y_up),
            frame_base: Some(frame_base),
            ..*given
        };
        let shift = origin.shift_px(given)?;
        Ok(Converter { shift, flip_at, scale, z_scale, frame_base, conventions, notes })
    }

    /// The row of a file that these conventions turn into `row`: frame, x, y and z.
    pub(crate) fn unconverted(&self, row: &TrackRow) -> (f64, [f64; 3]) {
        let Position { x_px, y_px, z_um } = row.at;
        let [dx, dy] = self.conventions.shift_px;
        let (x_px, y_px) = (x_px - dx, y_px - dy);
        let y_px = self.flip_at.map_or(y_px, |height| height - y_px);
        let z = if self.z_scale == 0.0 { 0.0 } else { z_um / self.z_scale };
        let at = [(x_px - self.shift[0]) / self.scale, (y_px - self.shift[1]) / self.scale, z];
        (f64::from(row.frame) + self.frame_base as f64, at)
    }

    /// Converts a position; `None` if a coordinate is missing, `Err` with a message if it is out of range.
    pub(crate) fn position(&self, x: f64, y: f64, z: f64) -> std::result::Result<Option<Position>, String> {
        if x.is_nan() || y.is_nan() || z.is_nan() {
            return Ok(None);
        }
        let (x_px, y_px) = (x * self.scale + self.shift[0], y * self.scale + self.shift[1]);
        let z_um = z * self.z_scale;
        for (name, value, most, unit) in
            [("x", x_px, LARGEST_PX, "px"), ("y", y_px, LARGEST_PX, "px"), ("z", z_um, LARGEST_UM, "um")]
        {
            // Also refuses infinite values.
            if value.abs() > most {
                return Err(format!("{name} = {value:?} {unit}: expected at most {most:e} {unit} in size"));
            }
        }
        let y_px = self.flip_at.map_or(y_px, |height| height - y_px);
        let [dx, dy] = self.conventions.shift_px;
        Ok(Some(Position { x_px: x_px + dx, y_px: y_px + dy, z_um }))
    }

    /// Converts a frame number to one counted from 0, or returns an error message.
    pub(crate) fn frame(&self, value: f64) -> std::result::Result<u32, String> {
        whole("frame", value, self.frame_base)
    }

    /// Converts a velocity from columns with these names, y downward; lengths are not scaled.
    pub(crate) fn velocity(
        &self,
        given: [f64; 3],
        names: [&str; 3],
    ) -> std::result::Result<[f64; 3], String> {
        let [u, v, w] = given;
        let v = if self.flip_at.is_some() { -v } else { v };
        within(given, names, -LARGEST_SPEED..=LARGEST_SPEED).map(|()| [u, v, w])
    }

    /// Adds a note on columns that are not used.
    pub(crate) fn ignores(&mut self, others: &[&str]) {
        self.notes.extend(unused(others));
    }

    /// Converts the size of a box to px and checks size and score.
    pub(crate) fn size(&self, [w, h]: [f64; 2], score: f64) -> std::result::Result<BoxSize, String> {
        let (w_px, h_px) = (w * self.scale, h * self.scale);
        for (name, value) in [("width", w_px), ("height", h_px)] {
            if !(0.0..=LARGEST_PX).contains(&value) {
                return Err(format!("{name} = {value:?} px: expected a box of 0 to {LARGEST_PX:e} px"));
            }
        }
        if !score.is_finite() {
            return Err(format!("score = {score:?}: expected a number"));
        }
        Ok(BoxSize { w_px, h_px, score })
    }

    /// Checks a diameter, um.
    pub(crate) fn diameter(&self, d_um: f64) -> std::result::Result<f64, String> {
        within([d_um; 3], ["d_um"; 3], 0.0..=LARGEST_UM).map(|()| d_um)
    }

    /// Converts claimed uncertainties from columns with these names: x and y to px, z unchanged.
    pub(crate) fn uncertainty(
        &self,
        given: [f64; 3],
        names: [&str; 3],
    ) -> std::result::Result<[f64; 3], String> {
        let scaled = [given[0] * self.scale, given[1] * self.scale, given[2]];
        within(given, names, 0.0..=LARGEST_UM).map(|()| scaled)
    }
}

/// Refuses numbers beyond these.
fn within(given: [f64; 3], names: [&str; 3], range: RangeInclusive<f64>) -> std::result::Result<(), String> {
    let is_wrong = |value: f64| !value.is_nan() && !range.contains(&value);
    given.iter().zip(names).find(|(value, _)| is_wrong(**value)).map_or(Ok(()), |(value, name)| {
        Err(format!("{name} = {value:?}: expected {:?} to {:e}", range.start(), range.end()))
    })
}

/// The number of a frame or image pair counted from 0, of one counted from `base`, or an error message.
pub(super) fn whole(column: &str, value: f64, base: i64) -> std::result::Result<u32, String> {
    let number = value - base as f64;
    if value.fract() != 0.0 || !(0.0..=f64::from(u32::MAX - 1)).contains(&number) {
        let option = if value < base as f64 { " (--frame-base, in Python frame_base)" } else { "" };
        return Err(format!("{column} = {value:?}: expected a whole number from {base} on{option}"));
    }
    Ok(number as u32)
}

/// A note on columns that are not used, if there are any.
pub(super) fn unused(others: &[&str]) -> Option<String> {
    let (shown, more) = (&others[..others.len().min(8)], others.len().saturating_sub(8));
    let more = if more > 0 { format!(" and {more} more") } else { String::new() };
    (!shown.is_empty()).then(|| format!("columns not used: {}{more}", shown.join(", ")))
}
