//! Rows of displacement fields: conversion to px, direction of the axes, and vectors at one place.

use super::conventions::{LARGEST_PX, unused, whole};
use super::sheet::{self, TextTable};
use super::table::{Placement, Reversal};
use super::{Cells, Conventions, DroppedRows, Field, FlowVector, FormatDefaults, LengthUnit, Position};
use crate::evaluate::statistics::distinct;
use storage::advice;
use storage::advice::option;
use storage::error::{Error, Result};

/// Positions of columns and rows that differ by less than this are the same, px: rounding in single precision.
const SAME_PX: f64 = 1e-3;

/// The unit of a column: a length, per frame or per unit of time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Unit {
    /// um; `None` for px.
    um: Option<f64>,
    /// s; `None` for a frame.
    s: Option<f64>,
}

impl Unit {
    /// The unit of a text such as `px`, `mm`, `m/s` or `px/frame`.
    pub(super) fn parse(text: &str) -> Option<Self> {
        let text = text.trim().to_lowercase();
        let (length, time) = text.split_once('/').unwrap_or((&text, "frame"));
        let um = LengthUnit::from_name(length)?.um();
        let s = match time {
            "frame" | "frames" | "dt" => None,
            "s" | "sec" => Some(1.0),
            "ms" => Some(1e-3),
            "us" | "\u{b5}s" | "\u{3bc}s" => Some(1e-6),
            _ => return None,
        };
        Some(Unit { um, s })
    }

    /// A length in um, `None` if it is in px; nothing for a velocity.
    pub(super) fn length_um(self) -> Option<Option<f64>> {
        self.s.is_none().then_some(self.um)
    }

    /// px per unit: the scale and the time between frames are needed for lengths and velocities.
    pub(super) fn px(self, given: &Conventions, name: &str) -> Result<f64> {
        let needs = |value: Option<f64>, what: &str, key| {
            let what = format!("{name}: {what}; give ");
            value.ok_or_else(|| Error::option(advice!(what, option(key))))
        };
        let length = match self.um {
            None => 1.0,
            Some(um) => um / needs(given.um_per_px, "lengths are not in px", "um_per_px")?,
        };
        let time = match self.s {
            None => 1.0,
            Some(s) => needs(given.dt_s, "velocities are per unit of time", "dt_s")? / s,
        };
        Ok(length * time)
    }
}

/// Units of lengths in files that do not state them, from the largest.
pub(crate) const LENGTHS: [(&str, f64); 3] = [("m", 1e6), ("mm", 1e3), ("um", 1.0)];

/// How a file has its vectors.
#[derive(Debug, Clone)]
pub(super) struct FieldLayout {
    pub(super) defaults: FormatDefaults,
    /// px per unit of positions and of displacements (negative: x to the left), and their units in words;
    /// `None` if the file states no units: px, or m, mm or um if the scale is given.
    pub(super) scale: Option<([f64; 2], String)>,
    /// Where the origin of positions is in the image, px.
    pub(super) origin_px: [f64; 2],
    /// How `y` upward is reversed.
    pub(super) reversal: Reversal,
    /// How the file is read apart from that.
    pub(super) notes: Vec<String>,
}

impl FieldLayout {
    /// Positions and displacements in px.
    pub(super) fn px(defaults: FormatDefaults) -> Self {
        FieldLayout { scale: Some(([1.0; 2], "px".to_owned())), ..FieldLayout::new(defaults) }
    }

    pub(super) fn new(defaults: FormatDefaults) -> Self {
        FieldLayout {
            defaults,
            scale: None,
            origin_px: [0.0; 2],
            reversal: Reversal::Image,
            notes: Vec::new(),
        }
    }
}

/// Columns of a field along x and y.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct FieldColumns {
    pub(super) at: [usize; 2],
    pub(super) moved: [usize; 2],
    pub(super) z: Option<usize>,
    pub(super) dz: Option<usize>,
    pub(super) pair: Option<usize>,
    /// Claimed uncertainties.
    pub(super) sigma: [Option<usize>; 2],
    /// What the flag depends on.
    pub(super) flags: [Option<usize>; 3],
}

/// Vectors in the units of a file.
#[derive(Debug, Default)]
pub(super) struct FieldRows {
    pub(super) vectors: Vec<FlowVector>,
    pub(super) lines: Vec<u32>,
    pub(super) dropped: DroppedRows,
}

/// Reads a field from a table; `flag` returns the flag of a row.
pub(super) fn read(
    sheet: TextTable,
    columns: FieldColumns,
    mut layout: FieldLayout,
    given: &Conventions,
    flag: impl Fn(&Cells<'_>) -> std::result::Result<u8, String>,
) -> Result<Field> {
    let (mut rows, mut numbered, name) = (FieldRows::default(), false, sheet.name().to_owned());
    let base = given.frame_base.unwrap_or(layout.defaults.frame_base);
    let has_no_pair = columns.pair.is_none();
    let FieldColumns { at, moved, z, dz, pair, sigma, flags } = columns;
    let used = [&sigma[..], &[z, dz, pair], &flags, &[at[0], at[1], moved[0], moved[1]].map(Some)].concat();
    let used: Vec<&str> = used.into_iter().flatten().map(|column| sheet.names()[column].as_str()).collect();
    layout.notes.extend(unused(&sheet.others(&used)));
    let style = sheet.rows(|cells| {
        let pair = match (cells.number_or_nan(pair)?, cells.zone) {
            (pair, _) if !pair.is_nan() => Some(whole("pair", pair, base)?),
            (_, Some((zone, is_numbered))) => {
                numbered |= is_numbered;
                let base = if is_numbered { base } else { 0 };
                Some(whole("zone", f64::from(zone), base)?)
            }
            _ => None,
        };
        let [x_px, y_px] = [cells.number(at[0])?, cells.number(at[1])?];
        let z_um = z.map_or(Ok(0.0), |z| cells.number(z))?;
        if x_px.is_nan() || y_px.is_nan() || z_um.is_nan() {
            rows.dropped.at(cells.line);
            return Ok(());
        }
        let [dx, dy] = [cells.number(moved[0])?, cells.number(moved[1])?];
        let flag = flag(cells)?;
        let flag = if dx.is_nan() || dy.is_nan() { 1 } else { flag };
        let [sx, sy] = sigma.map(|column| cells.number_or_nan(column));
        let at = Position { x_px, y_px, z_um };
        let moved = [dx, dy, cells.number_or_nan(dz)?];
        rows.vectors.push(FlowVector { pair, at, moved, flag, sigma: [sx?, sy?] });
        rows.lines.push(u32::try_from(cells.line).unwrap_or(u32::MAX));
        Ok(())
    })?;
    let first = rows.vectors.first().and_then(|v| v.pair);
    if !numbered && has_no_pair && rows.vectors.iter().all(|v| v.pair == first) {
        // A single zone without a number.
        rows.vectors.iter_mut().for_each(|v| v.pair = None);
    }
    layout.notes.extend(style);
    rows.field(layout, given, &name)
}

impl FieldRows {
    /// The field, in px from the center of the first pixel at (1, 1), y downward.
    pub(super) fn field(mut self, layout: FieldLayout, given: &Conventions, name: &str) -> Result<Field> {
        let FieldLayout { defaults, scale, origin_px, reversal, mut notes } = layout;
        let is_stated = scale.is_some();
        let ([length, moved], unit) = match (scale, given.unit) {
            (Some(_), Some(unit)) => {
                let what = format!(": {name} states its units");
                return Err(Error::option(advice!(option("unit").is(unit.symbol()), what)));
            }
            (Some(scale), None) => scale,
            (None, _) => self.stated_by_options(given, name)?,
        };
        let origin = given.origin.unwrap_or(defaults.origin);
        let placement = Placement {
            shift_px: origin.shift_px(given)?,
            asked_px: given.shift_px,
            reversal,
            is_y_up: given.y_up.unwrap_or(false),
            is_stated,
            is_per_s: unit.contains("/s"),
            is_calibrated: !unit.starts_with("px"),
        };
        let size = given.width_px.zip(given.height_px);
        let needs_size = || {
            let what = ": a bare table does not contain the size of the images";
            Error::option(advice!(option("y").is("up"), what))
        };
        let mut problems = Vec::new();
        let from_left = match (moved < 0.0, size) {
            (true, None) => return Err(needs_size()),
            (is_left, size) => size.filter(|_| is_left).map(|(width, _)| placement.reversed_px(0, width)),
        };
        for (i, v) in self.vectors.iter_mut().enumerate() {
            v.at.x_px = length * v.at.x_px + origin_px[0] + placement.shift_px[0];
            v.at.y_px = length * v.at.y_px + origin_px[1] + placement.shift_px[1];
            v.at.x_px = from_left.map_or(v.at.x_px, |sum| sum - v.at.x_px);
            (v.moved[0], v.moved[1]) = (moved * v.moved[0], moved.abs() * v.moved[1]);
            v.sigma = v.sigma.map(|sigma| moved.abs() * sigma);
            let large =
                [("x", v.at.x_px), ("y", v.at.y_px)].into_iter().find(|(_, at)| at.abs() > LARGEST_PX);
            let mut sizes = v.moved.iter().chain(&v.sigma);
            let what = match (large, sizes.find(|size| size.abs() > LARGEST_PX)) {
                (Some((axis, at)), _) => {
                    format!("{axis} = {at:?} px: expected at most {LARGEST_PX:e} px in size")
                }
                (_, Some(size)) => format!("{size:?}: expected a displacement of at most 1e7 px"),
                _ if v.at.z_um.abs() > storage::dataset::LARGEST_UM => {
                    format!(
                        "z = {:?} um: expected at most {:e} um in size",
                        v.at.z_um,
                        storage::dataset::LARGEST_UM
                    )
                }
                _ => continue,
            };
            problems.push(match self.lines.get(i) {
                Some(line) => format!("{name}:{line}: {what}"),
                None => format!("{name}: {what}"),
            });
        }
        if placement.is_y_up {
            let sum = placement.sum_px(&self.vectors, given.height_px).ok_or_else(needs_size)?;
            for v in &mut self.vectors {
                (v.at.y_px, v.moved[1]) = (sum - v.at.y_px, -v.moved[1]);
            }
        }
        for v in &mut self.vectors {
            v.at.x_px += given.shift_px[0];
            v.at.y_px += given.shift_px[1];
        }
        if placement.is_calibrated
            && let Some((width, height)) = size
        {
            problems.extend(self.beyond(name, &unit, (width, height)));
        }
        self.snap();
        if problems.is_empty() {
            problems = self.twice(name);
        }
        sheet::shorten(&mut problems);
        if !problems.is_empty() {
            return Err(Error::Input(problems));
        }
        let up = match (placement.is_y_up, reversal) {
            (false, _) => "down",
            (true, Reversal::Grid) => "up, reversed within its grid",
            (true, _) => "up",
        };
        let (words, left) = (origin.names()[1], if from_left.is_some() { "; x to the left" } else { "" });
        let base = given.frame_base.unwrap_or(defaults.frame_base);
        let pairs = if self.vectors.iter().any(|v| v.pair.is_some()) {
            format!("; pairs from {base}")
        } else {
            String::new()
        };
        let read =
            format!("{}: x, y in {unit}; {words}; y {up}{left}{}{pairs}", defaults.name, given.shifted());
        notes.insert(0, read);
        let n_nan = self.dropped.finish(&mut notes);
        Ok(Field { vectors: self.vectors, lines: self.lines, n_nan, notes, placement, warnings: Vec::new() })
    }

    /// px per unit of a file that states no units, and these in words: px, unless the scale is given. Of m, mm
    /// and um it is the largest in which the positions are in the image.
    fn stated_by_options(&self, given: &Conventions, name: &str) -> Result<([f64; 2], String)> {
        let (um_per_px, dt_s) = given.stated;
        let per_s = if dt_s.is_some() { "/s" } else { "" };
        if let Some(unit) = given.unit {
            let px = Unit { um: unit.um(), s: None }.px(given, name)?;
            let words = format!("{0}, u, v in {0}{per_s}", unit.symbol());
            return Ok(([px, px * dt_s.unwrap_or(1.0)], words));
        }
        let Some(um_per_px) = um_per_px else {
            let words = dt_s.map_or("px".to_owned(), |dt_s| format!("px; u, v in px/s, {dt_s} s per frame"));
            return Ok(([1.0, dt_s.unwrap_or(1.0)], words));
        };
        let Some((width, height)) = given.width_px.zip(given.height_px) else {
            let what = ": the file states no units, and a bare table does not contain the size of the images";
            return Err(Error::option(advice!(option("um_per_px").of(um_per_px), what)));
        };
        let largest =
            |of: fn(&Position) -> f64| self.vectors.iter().map(|v| of(&v.at).abs()).fold(0.0, f64::max);
        let (x, y) = (largest(|at| at.x_px), largest(|at| at.y_px));
        let fits = |px: f64| x * px <= width + 1.0 && y * px <= height + 1.0;
        let found = LENGTHS.iter().find(|(_, um)| fits(um / um_per_px));
        let (unit, um) = found.ok_or_else(|| {
            Error::input(format!(
                "{name}: positions up to ({x}, {y}) are beyond the image in m, mm and um at {um_per_px} um per px"
            ))
        })?;
        let px = um / um_per_px;
        let time = dt_s.map(|dt_s| format!(", {dt_s} s")).unwrap_or_default();
        let words = format!("{unit}, u, v in {unit}{per_s} ({um_per_px} um per px{time})");
        Ok(([px, px * dt_s.unwrap_or(1.0)], words))
    }

    /// Describes positions in a physical unit beyond the image: their origin is not at the first pixel.
    fn beyond(&self, name: &str, unit: &str, (width, height): (f64, f64)) -> Option<String> {
        let range = |of: fn(&Position) -> f64| {
            let values = || self.vectors.iter().map(|v| of(&v.at));
            (values().fold(f64::INFINITY, f64::min), values().fold(f64::NEG_INFINITY, f64::max))
        };
        let ((left, right), (top, bottom)) = (range(|at| at.x_px), range(|at| at.y_px));
        let is_inside = left > -0.5 && top > -0.5 && right < width + 1.5 && bottom < height + 1.5;
        (!is_inside && !self.vectors.is_empty()).then(|| {
            format!(
                "{name}: x, y in {} are {left:.1} to {right:.1} px and {top:.1} to {bottom:.1} px, beyond the image of \
                 {width} x {height} px: the file has another scale, or an origin of its own (--shift, in Python shift_px); or export it in px",
                unit.split(',').next().unwrap_or_default()
            )
        })
    }

    /// Moves positions on a grid that differ only by rounding to the same columns and rows.
    fn snap(&mut self) {
        let first = |of: fn(&Position) -> f64| {
            // In a wrong unit, a whole field may be smaller.
            let mut values = distinct(self.vectors.iter().map(|v| of(&v.at)));
            let (all, range) = (values.len(), values.last().zip(values.first()).map_or(0.0, |(b, a)| b - a));
            values.dedup_by(|next, kept| *next - *kept < SAME_PX.min(1e-5 * range));
            (all, values)
        };
        let ((n_x, x_px), (n_y, y_px)) = (first(|at| at.x_px), first(|at| at.y_px));
        // A grid is mostly full; scattered vectors would each have a column and a row of their own.
        if n_x * n_y == x_px.len() * y_px.len() || x_px.len() * y_px.len() > 4 * self.vectors.len() {
            return;
        }
        let nearest = |axis: &[f64], at: f64| axis[axis.partition_point(|first| *first <= at) - 1];
        for v in &mut self.vectors {
            (v.at.x_px, v.at.y_px) = (nearest(&x_px, v.at.x_px), nearest(&y_px, v.at.y_px));
        }
    }

    /// Describes vectors of one image pair at one place.
    fn twice(&self, name: &str) -> Vec<String> {
        let key = |i: usize| {
            let Position { x_px, y_px, z_um } = self.vectors[i].at;
            (self.vectors[i].pair, [z_um, y_px, x_px].map(|at| (at + 0.0).to_bits()))
        };
        let mut order: Vec<usize> = (0..self.vectors.len()).collect();
        order.sort_by_key(|i| key(*i));
        let twice = order.windows(2).filter(|w| key(w[0]) == key(w[1]));
        let line = |i: usize| self.lines.get(i).map_or(String::new(), |line| format!(":{line}"));
        let what = |w: &[usize]| {
            let FlowVector { at, pair, .. } = self.vectors[w[1]];
            let pair = pair.map(|pair| format!(" of pair {pair}")).unwrap_or_default();
            format!("{name}{}: a second vector{pair} at ({}, {}) px", line(w[1]), at.x_px, at.y_px)
        };
        twice.map(what).collect()
    }
}

/// A flag: 0 valid, 1 invalid, 2 interpolated; 0 if it is missing.
pub(super) fn flag(cells: &Cells<'_>, column: Option<usize>, name: &str) -> std::result::Result<u8, String> {
    match cells.number_or_nan(column)? {
        f if f.is_nan() => Ok(0),
        f if [0.0, 1.0, 2.0].contains(&f) => Ok(f as u8),
        f => Err(format!("{name} = {f}: expected 0 (valid), 1 (invalid) or 2 (interpolated)")),
    }
}
