//! Recorded tracks instead of a flow: the position of each particle in each frame, read from a table.
//!
//! The table is CSV with a header; columns are identified by name, in any order. `frame` (the frame number in
//! the dataset) and `track` are integers >= 0. Positions are `x_um, y_um, z_um` in object space (origin in
//! the middle of the image) or `x_px, y_px, z_um` in the image (the center of the first pixel is 1, z is
//! physical depth); if both are present, those in um are used. Optional columns: `d_um`; `c_int`; `e_p` with
//! the axis, as `axis_x, axis_y, axis_z` (any non-zero length) or as MicroSIG's `alpha_rad, beta_rad`;
//! `u_um_s, v_um_s, w_um_s`. An empty cell of an optional column means that the value is missing. The track
//! table of a generated dataset has this format.
//!
//! A missing velocity is the slope, at the frame, of the parabola through the positions of the track in the
//! previous, this and the next frame (central differences for equal time steps); at an end of a track or next
//! to a gap, it is the difference to the one adjacent frame. Between frames and during an exposure particles
//! move on straight lines.

use crate::scale::{ImagePoint, Scale};
use crate::{
    Diameters, Displacement, Error, Frame, Intensities, RecordingStart, Result, Shutter, Spheroids, Tracer,
};

use glam::DVec3;
use microsig_core::Spheroid;
use microsig_core::problem::Problem;
use microsig_core::stream::{Purpose, Streams};
use std::collections::BTreeSet;
use std::fmt::Display;
use std::io::BufRead;

/// Maximum number of rows of a table.
const MAX_ROWS: usize = 50_000_000;

/// Number of errors after which reading stops.
const MAX_FAULTS: usize = 20;

/// Largest track number, 2^53: up to here integers are exact in f64, and so in every file format.
const MAX_TRACK: f64 = 9_007_199_254_740_992.0;

/// Recorded particle tracks.
#[derive(Debug, Clone, PartialEq)]
pub struct RecordedTracks {
    /// Sorted by frame, then by track.
    rows: Vec<TrackRow>,
    unused: Vec<String>,
    units: &'static str,
}

/// One particle in one frame: a row of the table. `None`: not given.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TrackRow {
    /// Frame number in the dataset.
    pub frame: u32,
    /// Track number.
    pub track: u64,
    /// Position of the center, um.
    pub position: DVec3,
    /// Diameter, um.
    pub d_um: Option<f64>,
    /// Brightness factor relative to a particle of its size.
    pub c_int: Option<f64>,
    /// Aspect ratio: length along the symmetry axis over length across it.
    pub aspect: Option<f64>,
    /// Unit vector along the symmetry axis.
    pub axis: Option<DVec3>,
    /// Velocity, um/s.
    pub velocity: Option<DVec3>,
    /// Line number in the file.
    pub line: usize,
}

/// Distributions of the particle properties that the table does not give.
#[derive(Debug, Clone, Copy)]
pub struct ParticleDefaults<'a> {
    /// Diameters, drawn from the random stream of the track number.
    pub diameters: &'a Diameters,
    /// Brightness factors, drawn from the random stream of the track number.
    pub intensities: Intensities,
    /// Aspect ratio and orientations, drawn from the random stream of the track number and constant in time.
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

/// Positions of the known columns in the table.
struct Columns {
    frame: usize,
    track: usize,
    place: [usize; 3],
    in_px: bool,
    optional: [Option<usize>; OPTIONAL.len()],
    count: usize,
}

fn fault(line: usize, found: impl Display, expected: &str) -> Error {
    Error::Data { format: "tracks", line: Some(line), problem: Problem::value("", found, expected).into() }
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
        // An incomplete group would otherwise be ignored silently.
        for group in [&OPTIONAL[3..6], &OPTIONAL[6..8], &OPTIONAL[8..11]] {
            let there = group.iter().filter(|name| column(name).is_some()).count();
            if there != 0 && there != group.len() {
                faults.push(fault(1, found(), &format!("all of {} or none", group.join(", "))));
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

    fn row(&self, text: &str, line: usize, scale: &Scale) -> Result<TrackRow> {
        let cells: Vec<&str> = text.split(',').map(str::trim).collect();
        if cells.len() != self.count {
            let expected = format!("{}, as in the header", self.count);
            return Err(fault(line, format!("{} columns", cells.len()), &expected));
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
            // The depth in the table is physical, unlike that in a MicroSIG data file.
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
        Ok(TrackRow {
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

impl RecordedTracks {
    /// Reads a table; `scale` converts px to um. `Err` lists up to 20 errors with their lines.
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
            let found = format!("a second row for track {} in frame {}", pair[0].track, pair[0].frame);
            faults.push(fault(second, found, &format!("one, as in line {first}")));
        }
        if rows.is_empty() && faults.is_empty() {
            faults.push(fault(1, "a header only", "at least one row"));
        }
        faults.truncate(MAX_FAULTS);
        if !faults.is_empty() {
            return Err(faults);
        }
        let units = if columns.in_px { "px" } else { "um" };
        Ok(RecordedTracks { rows, unused, units })
    }

    /// All rows, sorted by frame, then by track.
    pub fn rows(&self) -> &[TrackRow] {
        &self.rows
    }

    /// Number of tracks.
    pub fn count(&self) -> usize {
        self.rows.iter().map(|row| row.track).collect::<BTreeSet<_>>().len()
    }

    /// Names of columns that are not recognized and were ignored.
    pub fn unused_columns(&self) -> &[String] {
        &self.unused
    }

    /// Unit of x and y in the table: "um" or "px".
    pub fn units(&self) -> &'static str {
        self.units
    }

    fn frame_rows(&self, frame: u32) -> &[TrackRow] {
        let first = self.rows.partition_point(|row| row.frame < frame);
        let rest = &self.rows[first..];
        &rest[..rest.partition_point(|row| row.frame == frame)]
    }

    /// The frames of a recording that starts with frame number `start.first_frame` and has frames at
    /// `times_s` (s, increasing). If the tracks continue after the recording, `next_s` is the time of the
    /// next frame, which is used for the velocities of the last one: a shorter recording is then the
    /// beginning of a longer one.
    pub fn record<'a>(
        &'a self,
        mut times_s: Vec<f64>,
        next_s: Option<f64>,
        kind: ParticleDefaults<'a>,
        shutter: Option<Shutter>,
        streams: Streams,
        start: RecordingStart,
    ) -> impl Iterator<Item = Frame> + 'a {
        let frames = times_s.len();
        times_s.extend(next_s);
        (0..frames).map(move |k| {
            let index = start.first_frame + k as u32;
            let near = |step: i64| -> (&[TrackRow], f64) {
                let time = usize::try_from(k as i64 + step).ok().and_then(|k| times_s.get(k));
                time.map_or((&[][..], 0.0), |t| (self.frame_rows((i64::from(index) + step) as u32), *t))
            };
            let (before, now, after) = (near(-1), near(0), near(1));
            let find = |rows: &'a [TrackRow], track: u64| {
                rows.binary_search_by_key(&track, |row| row.track).ok().map(|i| rows[i].position)
            };
            let tracer = |row: &TrackRow| {
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

/// The tracer of a row; missing properties are drawn from the random streams of the track number.
fn particle(row: &TrackRow, kind: &ParticleDefaults<'_>, streams: Streams) -> Tracer {
    let stream = |purpose| streams.stream(purpose, 0, row.track as u32);
    let d_um = row.d_um.unwrap_or_else(|| kind.diameters.draw(&mut stream(Purpose::Diameter)));
    let drawn_axis = || kind.spheroids.map(|s| s.orientation.draw(&mut stream(Purpose::Orientation)));
    Tracer {
        id: row.track,
        position: row.position,
        d_um,
        aspect: row.aspect.or(kind.spheroids.map(|s| s.e_p)).unwrap_or(1.0),
        axis: row.axis.or_else(drawn_axis).unwrap_or(DVec3::Y),
        c_int: row.c_int.unwrap_or_else(|| kind.intensities.draw(d_um, &mut stream(Purpose::Intensity))),
        velocity: None,
        step: None,
    }
}
