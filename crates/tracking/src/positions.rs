//! Given positions of particles, where depths are measured and nothing else is searched for.

use std::collections::{BTreeMap, BTreeSet};

use numeric::cell_grid::CellGrid;
use storage::InputFile;
use storage::dataset::{TableReader, TrackRow, check_frame, check_position};
use storage::error::{Error, Result};

/// How far from its given position a particle is searched for, along x and y, px.
pub(super) const REACH_PX: f64 = 3.0;

/// Positions of two particles of a frame are at least this far apart, px.
const APART_PX: f64 = 0.5;

/// Columns with the number of a particle, in tables of microsig and of others.
const IDENTITIES: [&str; 3] = ["track", "track_id", "particle"];

/// A given position.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Position {
    /// Relative to the center of the first pixel, px.
    pub(super) at: [f64; 2],
    /// The particle, if it is known.
    pub(super) track: Option<i64>,
}

impl Position {
    /// In other coordinates of the image.
    pub(super) fn mapped(self, map: impl Fn([f64; 2]) -> [f64; 2]) -> Self {
        Position { at: map(self.at), ..self }
    }
}

/// The positions of each frame, or of all.
#[derive(Debug)]
pub(super) struct Positions {
    has_frames: bool,
    of: BTreeMap<Option<u32>, Vec<Position>>,
}

impl Positions {
    /// Reads the columns `x_px, y_px`, `frame` (without it, positions hold for every frame) and the number of the particle,
    /// which without either is the number of the row. Errors: no position; positions beyond the images, or twice.
    pub(super) fn read(file: &InputFile, frames: usize, size: (usize, usize)) -> Result<Self> {
        let table = TableReader::open(file)?;
        let identity = IDENTITIES.into_iter().find(|name| table.column(name).is_some());
        let [has_frames, has_visible] = ["frame", "visible"].map(|name| table.column(name).is_some());
        let table = table.renamed(identity.unwrap_or("track"), "track");
        let mut of: BTreeMap<Option<u32>, Vec<Position>> = BTreeMap::new();
        let mut lines: BTreeMap<Option<u32>, Vec<u64>> = BTreeMap::new();
        let mut tracks = BTreeSet::new();
        table.rows(&["x_px", "y_px"], |line, row: TrackRow| {
            check_frame(row.frame, frames)?;
            // The truth of a dataset also lists particles that no image shows.
            if has_visible && !row.visible {
                return Ok(());
            }
            check_position([row.x_px, row.y_px], size)?;
            let frame = has_frames.then_some(row.frame);
            let number = of.get(&frame).map_or(0, Vec::len) as i64;
            let track = match identity {
                Some(name) if !tracks.insert((frame, row.track)) => {
                    return Err(format!("{name} = {}: expected once in a frame", row.track));
                }
                Some(_) => Some(row.track.cast_signed()),
                None => (!has_frames).then_some(number),
            };
            of.entry(frame).or_default().push(Position { at: [row.x_px - 1.0, row.y_px - 1.0], track });
            lines.entry(frame).or_default().push(line);
            Ok(())
        })?;
        if of.is_empty() {
            return Err(Error::input(format!(
                "{}: expected positions of particles, found none",
                file.display()
            )));
        }
        let twice = of.iter().flat_map(|(frame, positions)| twice(positions, &lines[frame]));
        let twice: Vec<String> = twice.map(|what| format!("{}:{what}", file.display())).collect();
        if twice.is_empty() { Ok(Positions { has_frames, of }) } else { Err(Error::Input(twice)) }
    }

    /// Whether the particles are at rest in the image.
    pub(super) fn hold_for_all_frames(&self) -> bool {
        !self.has_frames
    }

    /// The positions in a frame.
    pub(super) fn in_frame(&self, frame: usize) -> &[Position] {
        self.of.get(&self.has_frames.then_some(frame as u32)).map_or(&[], Vec::as_slice)
    }
}

/// Line and fault of each position that repeats one above it.
fn twice(positions: &[Position], lines: &[u64]) -> Vec<String> {
    let places: Vec<[f64; 2]> = positions.iter().map(|position| position.at).collect();
    let grid = CellGrid::new(&places, APART_PX);
    let mut faults = Vec::new();
    for (k, [x, y]) in places.iter().enumerate() {
        let mut first = None;
        grid.around([*x, *y], |other| {
            let other = other as usize;
            let apart_px = (places[other][0] - x).hypot(places[other][1] - y);
            if other < k && apart_px < APART_PX && first.is_none_or(|first| other < first) {
                first = Some(other);
            }
        });
        if let Some(first) = first {
            faults.push(format!(
                "{}: x_px = {}, y_px = {}: expected at least {APART_PX} px from line {}, or a column `frame`",
                lines[k],
                x + 1.0,
                y + 1.0,
                lines[first]
            ));
        }
    }
    faults
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(text: &str) -> std::result::Result<Positions, String> {
        let file = tempfile::NamedTempFile::new().unwrap();
        std::fs::write(file.path(), text).unwrap();
        Positions::read(&file.path().into(), 5, (100, 80)).map_err(|e| e.to_string())
    }

    #[test]
    fn positions_hold_for_their_frame_or_for_all() {
        let all = read("x_px, y_px\n1,1\n50.5,40\n").unwrap();
        assert_eq!(all.in_frame(0), all.in_frame(4));
        assert_eq!(all.in_frame(4)[1], Position { at: [49.5, 39.0], track: Some(1) });
        let one = read("frame,x_px,y_px,other_z_um\n3,1,1,\n3,9,9,2\n").unwrap();
        assert_eq!(one.in_frame(3)[1], Position { at: [8.0; 2], track: None });
        assert_eq!(one.in_frame(0), []);
        for name in IDENTITIES {
            let named = read(&format!("y_px,x_px,{name},frame\n2,1,7,0\n2,1,7,1\n")).unwrap();
            assert_eq!(named.in_frame(1), [Position { at: [0.0, 1.0], track: Some(7) }], "{name}");
        }
    }

    #[test]
    fn other_tables_are_refused_with_line_value_and_range() {
        for (text, what) in [
            ("x_um,y_um\n1,1\n", "column x_px is missing; found x_um, y_um"),
            ("x,y\n1,1\n", "column x_px is missing"),
            ("1,1\n2,2\n", "column x_px is missing"),
            ("x_px,y_px\n", "found none"),
            ("x_px,y_px\n9,9\n100.6,9\n", ":3: x_px = 100.6: expected 0.5 to 100.5"),
            ("x_px,y_px\n9,0\n", ":2: y_px = 0: expected 0.5 to 80.5"),
            ("x_px,y_px\n,9\n", ":2: x_px = NaN"),
            ("x_px,y_px\nleft,9\n", ":2: x_px = \"left\""),
            ("x_px,y_px,frame\n9,9,5\n", ":2: frame = 5: expected 0 to 4"),
            ("x_px,y_px,frame\n9,9,\n", ":2: frame = \"\""),
            ("x_px,y_px\n9,9\n9.1,9\n", ":3: x_px = 9.1, y_px = 9: expected at least 0.5 px from line 2"),
            ("x_px,y_px,track\n9,9,4\n19,9,4\n", ":3: track = 4: expected once"),
        ] {
            let said = read(text).unwrap_err();
            assert!(said.contains(what), "{text:?}: {said}");
        }
    }
}
