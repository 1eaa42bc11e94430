//! Export of the true displacement field to the formats of PIV programs, interpolated bilinearly between the
//! nodes of `truth/field.csv` as in scoring.

use std::fmt::Write;

use super::{ExportFormat, ExportOptions};
use generator::runner::DatasetPlace;
use scoring::evaluate::field::true_field::{TrueField, TrueFields, of_place};
use scoring::results::{FlowVector, Position};
use storage::advice;
use storage::advice::option;
use storage::error::{Error, Result};

/// Value of an unknown component in Middlebury's format.
const UNKNOWN: f32 = 1e10;

/// The contents of the file, and the number of known vectors.
pub(super) fn write(dataset: &DatasetPlace, options: &ExportOptions) -> Result<(Vec<u8>, usize)> {
    let path = dataset.shown("truth/field.csv");
    let wanted = options.displacement.name();
    let TrueFields { fields, plane_um, facts, .. } = of_place(dataset)?;
    let (_, grid) = fields
        .into_iter()
        .find(|(kind, _)| *kind == Some(options.displacement))
        .ok_or_else(|| Error::input(format!("{}: no column {wanted}_dx_px", path)))?;
    if grid.needs_pairs() && options.pair.is_none() {
        let what = format!("{}: the field changes with time; give ", path);
        return Err(Error::option(advice!(what, option("pair"))));
    }
    if let Some(pair) = options.pair.filter(|p| !grid.has_pair(*p) || !facts.has_pair(*p)) {
        return Err(Error::input(format!("{}: no pair {pair}", path)));
    }
    let known = |x_px: f64, y_px: f64| {
        let at = Position { x_px, y_px, z_um: 0.0 };
        grid.at(&FlowVector { pair: options.pair, at, ..FlowVector::default() })
    };
    let (bytes, n) = if options.format == ExportFormat::Openpiv {
        openpiv(&grid, known)
    } else {
        let size = facts.sensor_px;
        let (width, height) =
            size.ok_or_else(|| Error::input("the manifest lacks the size of the sensor"))?;
        flo(width as u32, height as u32, known)
    };
    if n == 0 {
        let what = format!("the {wanted} field has no known vector at z = {} um", plane_um.unwrap_or(0.0));
        return Err(Error::input(format!("{}: {what}", path)));
    }
    Ok((bytes, n))
}

/// Middlebury's `.flo`: rows from top to bottom, float32, little endian.
fn flo(width: u32, height: u32, known: impl Fn(f64, f64) -> Option<[f64; 3]>) -> (Vec<u8>, usize) {
    let mut bytes = b"PIEH".to_vec();
    bytes.extend(width.to_le_bytes());
    bytes.extend(height.to_le_bytes());
    let mut n = 0;
    for (row, column) in (1..=height).flat_map(|row| (1..=width).map(move |column| (row, column))) {
        let [u, v] = match known(f64::from(column), f64::from(row)) {
            Some([u, v, _]) => [u as f32, v as f32],
            None => [UNKNOWN; 2],
        };
        n += usize::from(u != UNKNOWN);
        bytes.extend(u.to_le_bytes());
        bytes.extend(v.to_le_bytes());
    }
    (bytes, n)
}

/// OpenPIV's tab-separated text file as written by `openpiv.tools.save`; nodes outside the fluid are masked.
fn openpiv(grid: &TrueField, known: impl Fn(f64, f64) -> Option<[f64; 3]>) -> (Vec<u8>, usize) {
    let (mut text, mut n) = ("# x\ty\tu\tv\tflags\tmask\n".to_owned(), 0);
    let (columns, rows) = grid.nodes();
    for (&y, &x) in rows.iter().flat_map(|y| columns.iter().map(move |x| (y, x))) {
        // Writing to a string cannot fail.
        let _ = match known(x, y) {
            Some([u, v, _]) => writeln!(text, "{x:e}\t{y:e}\t{u:e}\t{v:e}\t0e0\t0e0"),
            None => writeln!(text, "{x:e}\t{y:e}\tnan\tnan\t1e0\t1e0"),
        };
        n += usize::from(known(x, y).is_some());
    }
    (text.into_bytes(), n)
}
