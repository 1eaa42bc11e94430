//! Recorded tracks instead of a flow: where each particle is in each frame, from a table.
//!
//! A CSV table with a header; columns are found by name, in any order. `frame` and `track` are whole numbers >= 0, frames
//! counting as those of the dataset. Positions are `x_um, y_um, z_um` in object space (origin in the middle of the image) or
//! `x_px, y_px, z_um` in the image (first pixel's centre 1, z physical); where both are there, those in um count. Optional:
//! `d_um`; `c_int`; `e_p` with the axis, as `axis_x, axis_y, axis_z` (any length) or as `alpha_rad, beta_rad` of MicroSIG;
//! `u_um_s, v_um_s, w_um_s`. An empty cell of an optional column is a value that is not there. So the table of tracks of a dataset is
//! itself a table of recorded tracks.
//!
//! Where the table has no velocities they are the slope, at the frame, of the parabola through the places of the track in
//! the frame before, this one and the next (central differences where times are even); at an end of a track, or beside
//! a gap, the difference to the one neighbour there is. Between frames and during an exposure particles go straight on.

use crate::diameters::Diameters;
use crate::error::{Error, Result};
use crate::exposure::Shutter;
use crate::frame::{Displacement, Frame, Tracer};
use crate::intensities::Intensities;
use crate::orientation::Spheroids;
use crate::scale::{ImagePoint, Scale};
use crate::sequence::Start;
use glam::DVec3;
use microsig_core::Spheroid;
use microsig_core::stream::{Purpose, Streams};
use std::collections::BTreeSet;
use std::io::BufRead;

/// Most rows of a table.
const MAX_ROWS: usize = 50_000_000;

/// Faults listed before the reader gives up.
const MAX_FAULTS: usize = 20;

/// Greatest number of a track, 2^53: it stays whole in every format.
const MAX_TRACK: f64 = 9_007_199_254_740_992.0;

/// Tracks of particles, by frame and number.
#[derive(Debug, Clone, PartialEq)]
pub struct Tracks {
    /// In the order of frames, and of tracks within.
    rows: Vec<Row>,
    unused: Vec<String>,
    units: &'static str,
}

/// A particle in a frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Row {
    /// Number of the frame in the dataset.
    pub frame: u32,
    /// Number of the track.
    pub track: u64,
    /// The centre, um.
    pub position: DVec3,
    /// Diameter, um.
    pub d_um: Option<f64>,
    /// Factor on the light of a particle of its size.
    pub c_int: Option<f64>,
    /// Length along the axis over length across it.
    pub aspect: Option<f64>,
    /// Direction of the axis, of length 1.
    pub axis: Option<DVec3>,
    /// Velocity, um/s.
    pub velocity: Option<DVec3>,
    /// Line of the file.
    pub line: usize,
}

/// What particles are where the table does not say.
#[derive(Debug, Clone, Copy)]
pub struct Kind<'a> {
    /// Diameters, drawn by the number of the track.
    pub diameters: &'a Diameters,
    /// Factors on brightness, drawn by the number of the track.
    pub intensities: Intensities,
    /// Shape and directions of axes, drawn by the number of the track: they stay as they are.
    pub spheroids: Option<Spheroids>,
}

const OPTIONAL: [&str; 11] = [
    "d_um",
    "c_int",
    "e_p",
    "axis_x",
    "axis_y",
    "axis_z",
    "alpha_rad",
    "beta_rad",
    "u_um_s",
    "v_um_s",
    "w_um_s",
];

/// Columns of the table: where each that is known stands.
struct Columns {
    frame: usize,
    track: usize,
    place: [usize; 3],
    in_px: bool,
    optional: [Option<usize>; OPTIONAL.len()],
    count: usize,
}

fn fault(line: usize, found: impl Into<String>, expected: impl Into<String>) -> Error {
    Error::Data { format: "tracks", line: Some(line), found: found.into(), expected: expected.into() }
}

impl Columns {
    fn read(header: &str) -> std::result::Result<(Columns, Vec<String>), Vec<Error>> {
        let names: Vec<&str> = header.trim_start_matches('\u{feff}').split(',').map(str::trim).collect();
        let column = |name: &str| names.iter().position(|found| *found == name);
        let found = || format!("the columns {}", names.join(", "));
        let mut faults = Vec::new();
        if let Some(twice) = names.iter().enumerate().find(|(i, name)| names[..*i].contains(name)) {
            faults.push(fault(1, format!("the column {} twice", twice.1), "it once"));
        }
        for name in ["frame", "track"].into_iter().filter(|name| column(name).is_none()) {
            faults.push(fault(1, found(), name));
        }
        let all = |names: [&str; 3]| {
            let [Some(x), Some(y), Some(z)] = names.map(column) else { return None };
            Some([x, y, z])
        };
        let um = all(["x_um", "y_um", "z_um"]);
        let place = um.or_else(|| all(["x_px", "y_px", "z_um"]));
        if place.is_none() {
            faults.push(fault(1, found(), "x_um, y_um and z_um, or x_px, y_px and z_um"));
        }
        // Half an axis would be taken for none.
        for group in [&OPTIONAL[3..6], &OPTIONAL[6..8], &OPTIONAL[8..11]] {
            let there = group.iter().filter(|name| column(name).is_some()).count();
            if there != 0 && there != group.len() {
                faults.push(fault(1, found(), format!("all of {} or none", group.join(", "))));
            }
        }
        let (Some(frame), Some(track), Some(place), true) =
            (column("frame"), column("track"), place, faults.is_empty())
        else {
            return Err(faults);
        };
        let known = ["frame", "track", "x_um", "y_um", "z_um", "x_px", "y_px"];
        let unused = names.iter().filter(|name| !known.contains(name) && !OPTIONAL.contains(name));
        let unused = unused.map(|name| (*name).to_owned()).collect();
        let optional = OPTIONAL.map(column);
        Ok((Columns { frame, track, place, in_px: um.is_none(), optional, count: names.len() }, unused))
    }

    fn row(&self, text: &str, line: usize, scale: &Scale) -> Result<Row> {
        let cells: Vec<&str> = text.split(',').map(str::trim).collect();
        if cells.len() != self.count {
            let expected = format!("{}, as in the header", self.count);
            return Err(fault(line, format!("{} columns", cells.len()), expected));
        }
        let number = |name: &str, column: usize, allowed: &str, fits: &dyn Fn(f64) -> bool| {
            let value = cells[column].parse().ok().filter(|value: &f64| value.is_finite() && fits(*value));
            value.ok_or_else(|| fault(line, format!("{name} = {:?}", cells[column]), allowed))
        };
        let whole = |name: &str, column: usize, most: f64| {
            let allowed = format!("a whole number from 0 to {most}");
            number(name, column, &allowed, &|value| value >= 0.0 && value <= most && value % 1.0 == 0.0)
        };
        let place =
            |axis: usize| number(["x", "y", "z"][axis], self.place[axis], "a finite number", &|_| true);
        let optional = |i: usize, allowed: &str, fits: &dyn Fn(f64) -> bool| match self.optional[i] {
            Some(column) if !cells[column].is_empty() => number(OPTIONAL[i], column, allowed, fits).map(Some),
            _ => Ok(None),
        };
        let finite = |i: usize| optional(i, "a finite number", &|_| true);
        let [x, y, z] = [place(0)?, place(1)?, place(2)?];
        let position = if self.in_px {
            // The file's depth is physical, unlike that of a data file.
            scale.to_object(ImagePoint { x_px: x, y_px: y, z_um: 0.0 }).with_z(z)
        } else {
            DVec3::new(x, y, z)
        };
        let aspect = optional(2, "a number > 0", &|e_p| e_p > 0.0)?;
        let axis = match (finite(3)?, finite(4)?, finite(5)?, finite(6)?, finite(7)?) {
            (Some(x), Some(y), Some(z), _, _) => {
                let unit = DVec3::new(x, y, z).try_normalize();
                Some(unit.ok_or_else(|| fault(line, "an axis of length 0", "a direction"))?)
            }
            (_, _, _, Some(alpha_rad), Some(beta_rad)) => {
                let axis = Spheroid { e_p: 1.0, alpha_rad, beta_rad }.axis();
                aspect.filter(|e_p| *e_p != 1.0).map(|_| DVec3::from_array(axis))
            }
            _ => None,
        };
        let velocity = match [finite(8)?, finite(9)?, finite(10)?] {
            [Some(u), Some(v), Some(w)] => Some(DVec3::new(u, v, w)),
            _ => None,
        };
        Ok(Row {
            frame: whole("frame", self.frame, f64::from(u32::MAX - 1))? as u32,
            track: whole("track", self.track, MAX_TRACK)? as u64,
            position,
            d_um: optional(0, "a number > 0", &|d| d > 0.0)?,
            c_int: optional(1, "a number >= 0", &|c| c >= 0.0)?,
            aspect,
            axis,
            velocity,
            line,
        })
    }
}

impl Tracks {
    /// Reads a table; `scale` turns px into um. `Err` lists up to 20 faults with their lines.
    pub fn from_csv(source: impl BufRead, scale: &Scale) -> std::result::Result<Self, Vec<Error>> {
        let mut lines = source.lines().enumerate();
        let header = match lines.next() {
            Some((_, Ok(line))) => line,
            Some((_, Err(error))) => return Err(vec![fault(1, error.to_string(), "text")]),
            None => return Err(vec![fault(1, "nothing", "a header")]),
        };
        let (columns, unused) = Columns::read(&header)?;
        let (mut rows, mut faults) = (Vec::new(), Vec::new());
        for (i, text) in lines {
            let line = i + 1;
            let row = match text {
                Err(error) => Err(fault(line, error.to_string(), "text")),
                Ok(text) if text.trim().is_empty() => continue,
                Ok(_) if rows.len() == MAX_ROWS => Err(fault(line, "one more row", "at most 50000000")),
                Ok(text) => columns.row(&text, line, scale),
            };
            match row {
                Ok(row) => rows.push(row),
                Err(error) => faults.push(error),
            }
            if faults.len() == MAX_FAULTS {
                break;
            }
        }
        rows.sort_by_key(|row| (row.frame, row.track));
        for pair in
            rows.windows(2).filter(|pair| (pair[0].frame, pair[0].track) == (pair[1].frame, pair[1].track))
        {
            let (first, second) = (pair[0].line.min(pair[1].line), pair[0].line.max(pair[1].line));
            let found = format!("track {} in frame {} again", pair[0].track, pair[0].frame);
            faults.push(fault(second, found, format!("one row for it, which is in line {first}")));
        }
        if rows.is_empty() && faults.is_empty() {
            faults.push(fault(1, "a header only", "one row or more"));
        }
        faults.truncate(MAX_FAULTS);
        if !faults.is_empty() {
            return Err(faults);
        }
        let units = if columns.in_px { "px" } else { "um" };
        Ok(Tracks { rows, unused, units })
    }

    /// All rows, in the order of frames, and of tracks within.
    pub fn rows(&self) -> &[Row] {
        &self.rows
    }

    /// Number of tracks.
    pub fn count(&self) -> usize {
        self.rows.iter().map(|row| row.track).collect::<BTreeSet<_>>().len()
    }

    /// Columns of the table that mean nothing here.
    pub fn unused_columns(&self) -> &[String] {
        &self.unused
    }

    /// Unit of x and y that was read: um or px.
    pub fn units(&self) -> &'static str {
        self.units
    }

    fn of_frame(&self, frame: u32) -> &[Row] {
        let first = self.rows.partition_point(|row| row.frame < frame);
        let rest = &self.rows[first..];
        &rest[..rest.partition_point(|row| row.frame == frame)]
    }

    /// The frames of a recording that begins with frame `start.first_frame` and has frames at `times_s` (s, increasing). If the
    /// recording only stops, and would have another frame at `next_s`, the velocities of its last know that frame too: a shorter
    /// recording is the beginning of a longer one.
    pub fn record<'a>(
        &'a self,
        mut times_s: Vec<f64>,
        next_s: Option<f64>,
        kind: Kind<'a>,
        shutter: Option<Shutter>,
        streams: Streams,
        start: Start,
    ) -> impl Iterator<Item = Frame> + 'a {
        let frames = times_s.len();
        times_s.extend(next_s);
        (0..frames).map(move |k| {
            let index = start.first_frame + k as u32;
            let near = |step: i64| -> (&[Row], f64) {
                let time = usize::try_from(k as i64 + step).ok().and_then(|k| times_s.get(k));
                time.map_or((&[][..], 0.0), |t| (self.of_frame((i64::from(index) + step) as u32), *t))
            };
            let (before, now, after) = (near(-1), near(0), near(1));
            let find = |rows: &'a [Row], track: u64| {
                rows.binary_search_by_key(&track, |row| row.track).ok().map(|i| rows[i].position)
            };
            let tracer = |row: &Row| {
                let (last, next) = (find(before.0, row.track), find(after.0, row.track));
                let slope = |x: DVec3, t: f64| (x - row.position) / (t - now.1);
                let velocity = match (last, next) {
                    (Some(last), Some(next)) => {
                        let (h0, h1) = (now.1 - before.1, after.1 - now.1);
                        Some((slope(last, before.1) * h1 + slope(next, after.1) * h0) / (h0 + h1))
                    }
                    (Some(last), None) => Some(slope(last, before.1)),
                    (None, Some(next)) => Some(slope(next, after.1)),
                    (None, None) => None,
                };
                let way = last.map(|last| row.position - last);
                Tracer {
                    velocity: row.velocity.or(velocity),
                    step: way.map(|way| Displacement { actual: way, drift: way }),
                    ..particle(row, &kind, streams)
                }
            };
            let tracers: Vec<Tracer> = now.0.iter().map(tracer).collect();
            let streaks =
                shutter.iter().flat_map(|s| tracers.iter().map(|tracer| s.straight(tracer))).collect();
            Frame { index, t_s: now.1, tracers, streaks }
        })
    }
}

/// What the table says of a particle, and what its number makes of the rest.
fn particle(row: &Row, kind: &Kind<'_>, streams: Streams) -> Tracer {
    let stream = |purpose| streams.stream(purpose, 0, row.track as u32);
    let d_um = row.d_um.unwrap_or_else(|| kind.diameters.draw(&mut stream(Purpose::Diameter)));
    let drawn_axis = || kind.spheroids.map(|s| s.orientations.draw(&mut stream(Purpose::Orientation)));
    Tracer {
        id: row.track,
        position: row.position,
        d_um,
        aspect: row.aspect.or(kind.spheroids.map(|s| s.aspect)).unwrap_or(1.0),
        axis: row.axis.or_else(drawn_axis).unwrap_or(DVec3::Y),
        c_int: row.c_int.unwrap_or_else(|| kind.intensities.draw(d_um, &mut stream(Purpose::Intensity))),
        velocity: None,
        step: None,
    }
}
