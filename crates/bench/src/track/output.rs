//! A result as trackers hand it in: the canonical table of particles or of displacements.

use std::path::Path;

use super::piv::Vector;
use crate::dataset::save;
use crate::error::{Error, Result};

/// A particle of a result.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Row {
    pub(super) frame: u32,
    /// -1: not linked.
    pub(super) track: i64,
    pub(super) x_px: f64,
    pub(super) y_px: f64,
    pub(super) z_um: Option<f64>,
}

/// A whole result.
#[derive(Debug)]
pub(super) enum Output {
    /// Particles.
    Points(Vec<Row>),
    /// A displacement field per pair.
    Fields(Vec<Vec<Vector>>),
}

impl Output {
    /// Writes the table, whole or not at all; gives its number of rows.
    pub(super) fn write(&self, path: &Path) -> Result<usize> {
        let mut rows = 0;
        save(path, |file| {
            let mut table = csv::Writer::from_writer(file);
            let mut put = |cells: &[String]| {
                table.write_record(cells).map_err(|e| Error::write(path)(std::io::Error::other(e)))
            };
            let header = |names: &str| names.split(' ').map(str::to_owned).collect::<Vec<_>>();
            match self {
                Output::Points(points) => {
                    let flat = !points.is_empty() && points.iter().all(|p| p.z_um.is_none());
                    put(&header(if flat { "frame track x_px y_px" } else { "frame track x_px y_px z_um" }))?;
                    for p in points {
                        let mut cells = vec![
                            p.frame.to_string(),
                            p.track.to_string(),
                            p.x_px.to_string(),
                            p.y_px.to_string(),
                        ];
                        if !flat {
                            cells.push(p.z_um.map_or(String::new(), |z| z.to_string()));
                        }
                        put(&cells)?;
                    }
                    rows = points.len();
                }
                Output::Fields(fields) => {
                    put(&header("pair x_px y_px dx_px dy_px flag"))?;
                    for (pair, vectors) in fields.iter().enumerate() {
                        for v in vectors {
                            let flag = if v.replaced { 2 } else { 0 };
                            let [x, y] = v.at.map(|c| (c + 1.0).to_string());
                            let [dx, dy] = v.d.map(|d| d.to_string());
                            put(&[pair.to_string(), x, y, dx, dy, flag.to_string()])?;
                        }
                        rows += vectors.len();
                    }
                }
            }
            table.flush().map_err(Error::write(path))
        })?;
        Ok(rows)
    }
}
