//! What is known of the particles of a recording: the height of the plane that all of them are in, and the
//! positions of some or all of them.

use std::collections::BTreeMap;
use std::path::Path;

use storage::advice;
use storage::advice::{flag, option};
use storage::dataset::manifest::KnownFacts;
use storage::dataset::{
    FrameRow, PlaneRow, Row, Table, TableReader, TrackRow, check_frame, check_position, write_table,
};
use storage::error::{Error, Result};
use storage::{InputFile, OutputFolder};

use super::frames::Frames;

#[derive(Debug, Default)]
pub(crate) struct Known {
    planes: Vec<PlaneRow>,
    particles: Vec<TrackRow>,
    /// Columns of the table of particles.
    columns: Vec<&'static str>,
    all_particles: bool,
}

/// A column that one table of particles has and another has not: its absent values are not zeros.
fn same_columns(a: (&Path, &[&str]), b: (&Path, &[&str])) -> Result<()> {
    let missing = |(path, of): (&Path, &[&str]), (_, there): (&Path, &[&str])| {
        there.iter().find(|name| !of.contains(name)).map(|name| (path.to_owned(), (*name).to_owned()))
    };
    match missing(a, b).map(|found| (found, b.0)).or_else(|| missing(b, a).map(|found| (found, a.0))) {
        None => Ok(()),
        Some(((path, name), other)) => Err(Error::input(format!(
            "{}: has no column {name}, which {} has: expected tables of particles with the same columns",
            path.display(),
            other.display()
        ))),
    }
}

/// Columns of tables of particles that are kept.
const COLUMNS: [&str; 6] = ["frame", "track", "x_px", "y_px", "z_um", "d_um"];

impl Known {
    /// Reads the tables: one with `frame, z_um` has heights of planes, one with `frame, x_px, y_px` (and
    /// `z_um`, `track`) positions of particles.
    /// Errors: a table with other columns, or tables of particles that differ in these; values that do not fit the
    /// recording, by file and line.
    pub(crate) fn read(
        files: &[InputFile],
        all_particles: bool,
        frames: usize,
        size: (usize, usize),
    ) -> Result<Self> {
        let mut known = Known { all_particles, ..Known::default() };
        let mut first: Option<(&InputFile, Vec<&'static str>)> = None;
        for file in files {
            let table = TableReader::open(file)?;
            let has = |name: &str| table.column(name).is_some();
            let (has_places, has_visible) = (has("x_px") && has("y_px"), has("visible"));
            if has_places {
                let columns = COLUMNS.into_iter().filter(|name| has(name)).collect();
                match &first {
                    None => first = Some((file, columns)),
                    Some((other, of)) => same_columns((other, of), (file, &columns))?,
                }
                table.rows(&["frame", "x_px", "y_px"], |_, row: TrackRow| {
                    check_frame(row.frame, frames)?;
                    // The truth of a dataset also lists particles that no image shows.
                    if has_visible && !row.visible {
                        return Ok(());
                    }
                    check_position([row.x_px, row.y_px], size)?;
                    known.particles.push(row);
                    Ok(())
                })?;
            } else {
                table.rows(&["frame", "z_um"], |_, row: PlaneRow| {
                    check_frame(row.frame, frames)?;
                    if !row.z_um.is_finite() {
                        return Err(format!("z_um = {}: expected a height in um", row.z_um));
                    }
                    if known.planes.iter().any(|other| other.frame == row.frame) {
                        return Err(format!("frame = {}: expected each frame once; with x_px and y_px it would be a table of particles", row.frame));
                    }
                    known.planes.push(row);
                    Ok(())
                })?;
            }
        }
        if all_particles && known.particles.is_empty() {
            let what =
                advice!(flag("all_particles"), ": expected with ", option("truth"), ", a table of particles");
            return Err(Error::option(what));
        }
        known.columns = first.map_or_else(Vec::new, |(_, columns)| columns);
        known.planes.sort_by_key(|row| row.frame);
        known.particles.sort_by_key(|row| row.frame);
        known.fill_in_heights();
        Ok(known)
    }

    /// Particles whose depth is unknown are in the plane of their frame.
    fn fill_in_heights(&mut self) {
        let planes: BTreeMap<u32, f64> = self.planes.iter().map(|row| (row.frame, row.z_um)).collect();
        if !planes.is_empty() && !self.columns.is_empty() && !self.columns.contains(&"z_um") {
            self.particles
                .iter_mut()
                .for_each(|row| row.z_um = planes.get(&row.frame).copied().unwrap_or(f64::NAN));
            if self.particles.iter().all(|row| row.z_um.is_finite()) {
                self.columns.push("z_um");
            }
        }
    }

    pub(crate) fn facts(&self) -> KnownFacts {
        KnownFacts {
            planes: self.planes.len() as u32,
            particles: self.particles.len() as u64,
            all_particles: self.all_particles,
        }
    }

    pub(crate) fn tables(&self) -> Vec<Table> {
        vec![frame_table(), PlaneRow::table(&[]), self.particle_table()]
    }

    fn particle_table(&self) -> Table {
        TrackRow::table(&[]).only(&self.columns).described("Known particles, one row per particle and frame.")
    }

    pub(crate) fn write(&self, folder: &OutputFolder, frames: &Frames, dt_s: Option<f64>) -> Result<()> {
        folder.subfolder("truth")?;
        let row = |frame: usize| FrameRow {
            frame: frame as u32,
            pair: frames.are_pairs().then_some(frame as u32 / 2),
            role: if frames.are_pairs() { ["a", "b"][frame % 2].to_owned() } else { String::new() },
            // The time between pairs is unknown.
            t_s: dt_s.filter(|_| !frames.are_pairs()).map_or(f64::NAN, |dt_s| dt_s * frame as f64),
            image: frames.path(frame),
            ..FrameRow::default()
        };
        let rows: Vec<FrameRow> = (0..frames.len()).map(row).collect();
        write_table(folder, &frame_table(), &rows)?;
        if !self.planes.is_empty() {
            write_table(folder, &PlaneRow::table(&[]), &self.planes)?;
        }
        if !self.particles.is_empty() {
            write_table(folder, &self.particle_table(), &self.particles)?;
        }
        Ok(())
    }
}

fn frame_table() -> Table {
    FrameRow::table(&[]).only(&["frame", "pair", "role", "t_s", "image"])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tables_of_particles_have_the_same_columns() {
        let said = |a: &[&str], b: &[&str]| {
            same_columns((Path::new("a.csv"), a), (Path::new("b.csv"), b)).map_err(|e| e.to_string())
        };
        assert_eq!(said(&["frame", "x_px"], &["frame", "x_px"]), Ok(()));
        let more = ["frame", "x_px", "track"];
        assert!(
            said(&["frame", "x_px"], &more)
                .unwrap_err()
                .starts_with("a.csv: has no column track, which b.csv has")
        );
        assert!(
            said(&more, &["frame", "x_px"])
                .unwrap_err()
                .starts_with("b.csv: has no column track, which a.csv has")
        );
    }
}
