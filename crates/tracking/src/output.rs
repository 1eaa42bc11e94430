//! Writes results of the baseline trackers as microsig's tables of particles or displacements.

use std::path::Path;

use storage::error::{Error, Result};
use storage::save_result;

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

/// A displacement vector of a result.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct DisplacementVector {
    /// Center of its interrogation window, relative to the center of the first pixel, px.
    pub(super) at: [f32; 2],
    /// Displacement, px.
    pub(super) d: [f32; 2],
    /// Whether it is an outlier replaced by the median of its neighbors.
    pub(super) replaced: bool,
}

/// A complete result.
#[derive(Debug)]
pub(super) enum Output {
    /// Particles.
    Points(Vec<Row>),
    /// Number and displacement field of each image pair.
    Fields(Vec<(usize, Vec<DisplacementVector>)>),
    /// One displacement field for all image pairs.
    MeanField(Vec<DisplacementVector>),
}

impl Output {
    /// Number of rows of the table.
    pub(super) fn rows(&self) -> usize {
        match self {
            Output::Points(points) => points.len(),
            Output::Fields(fields) => fields.iter().map(|(_, vectors)| vectors.len()).sum(),
            Output::MeanField(vectors) => vectors.len(),
        }
    }

    /// Writes the table atomically; returns its number of rows.
    ///
    /// # Errors
    /// An existing file, unless `force`; an I/O error.
    pub(super) fn save(&self, path: &Path, force: bool) -> Result<usize> {
        let table = self.table().map_err(|e| Error::write(path)(std::io::Error::other(e)))?;
        save_result(path, force, &table)?;
        Ok(self.rows())
    }

    /// The table as CSV.
    fn table(&self) -> std::result::Result<Vec<u8>, Box<dyn std::error::Error + Send + Sync>> {
        let mut table = csv::Writer::from_writer(Vec::new());
        match self {
            Output::Points(points) => {
                let flat = !points.is_empty() && points.iter().all(|p| p.z_um.is_none());
                let columns = ["frame", "track", "x_px", "y_px", "z_um"];
                table.write_record(if flat { &columns[..4] } else { &columns[..] })?;
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
                    table.write_record(&cells)?;
                }
            }
            Output::Fields(fields) => {
                table.write_record(["pair", "x_px", "y_px", "dx_px", "dy_px", "flag"])?;
                for (pair, vectors) in fields {
                    let pair = pair.to_string();
                    for v in vectors {
                        table.write_record([&[pair.clone()][..], &cells(v)].concat())?;
                    }
                }
            }
            Output::MeanField(vectors) => {
                table.write_record(["x_px", "y_px", "dx_px", "dy_px", "flag"])?;
                vectors.iter().try_for_each(|v| table.write_record(cells(v)))?;
            }
        }
        Ok(table.into_inner()?)
    }
}

/// Position, displacement and flag of a vector.
fn cells(vector: &DisplacementVector) -> [String; 5] {
    let flag = if vector.replaced { 2 } else { 0 };
    let [x, y] = vector.at.map(|c| (c + 1.0).to_string());
    let [dx, dy] = vector.d.map(|d| d.to_string());
    [x, y, dx, dy, flag.to_string()]
}
