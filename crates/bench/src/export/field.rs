//! Export of the true displacement field to the formats of PIV programs: computed from the flow, or else
//! interpolated between the nodes of `truth/field.csv`, as in scoring.

use std::fmt::Write;

use super::{ExportFormat, ExportOptions};
use scoring::evaluate::field::true_field;
use scoring::results::{FlowVector, Position};
use storage::advice;
use storage::advice::option;
use storage::dataset::DatasetPlace;
use storage::error::{Error, Result};

/// Value of an unknown component in Middlebury's format.
const UNKNOWN: f32 = 1e10;

/// The contents of the file, and the number of known vectors.
pub(super) fn write(dataset: &DatasetPlace, options: &ExportOptions) -> Result<(Vec<u8>, usize)> {
    let path = dataset.shown("truth/field.csv");
    let wanted = options.displacement.name();
    let mut truth = true_field::from_place(dataset)?;
    truth.fields.retain(|(kind, _)| *kind == Some(options.displacement));
    let (_, grid) =
        truth.fields.first().ok_or_else(|| Error::input(format!("{path}: no column {wanted}_dx_px")))?;
    if grid.needs_pairs() && options.pair.is_none() {
        let what = format!("{path}: the field changes with time; give ");
        return Err(Error::option(advice!(what, option("pair"))));
    }
    if let Some(pair) = options.pair.filter(|p| !grid.has_pair(*p) || !truth.facts.has_pair(*p)) {
        return Err(Error::input(format!("{path}: no pair {pair}")));
    }
    let known = |x_px: &[f64], y_px: &[f64]| -> Vec<([f64; 2], Option<[f64; 3]>)> {
        let places: Vec<[f64; 2]> = y_px.iter().flat_map(|&y| x_px.iter().map(move |&x| [x, y])).collect();
        let vector = |&[x_px, y_px]: &[f64; 2]| {
            let at = Position { x_px, y_px, z_um: 0.0 };
            FlowVector { pair: options.pair, at, ..FlowVector::default() }
        };
        let vectors: Vec<FlowVector> = places.iter().map(vector).collect();
        places.into_iter().zip(truth.at(&vectors).swap_remove(0)).collect()
    };
    let (bytes, n) = if options.format == ExportFormat::Openpiv {
        let (columns, rows) = grid.nodes();
        openpiv(&known(columns, rows))
    } else {
        let size = truth.facts.sensor_px;
        let (width, height) =
            size.ok_or_else(|| Error::input("the manifest lacks the size of the sensor"))?;
        let pixels = |size: f64| (1..=size as u32).map(f64::from).collect::<Vec<f64>>();
        flo(width as u32, height as u32, &known(&pixels(width), &pixels(height)))
    };
    if n == 0 {
        let what =
            format!("the {wanted} field has no known vector at z = {} um", truth.plane_um.unwrap_or(0.0));
        return Err(Error::input(format!("{path}: {what}")));
    }
    Ok((bytes, n))
}

/// Displacements by position, row by row.
type Known = [([f64; 2], Option<[f64; 3]>)];

/// Middlebury's `.flo`: rows from top to bottom, float32, little endian.
fn flo(width: u32, height: u32, known: &Known) -> (Vec<u8>, usize) {
    let mut bytes = b"PIEH".to_vec();
    bytes.extend(width.to_le_bytes());
    bytes.extend(height.to_le_bytes());
    let mut n = 0;
    for (_, moved) in known {
        let [u, v] = match *moved {
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
fn openpiv(known: &Known) -> (Vec<u8>, usize) {
    let (mut text, mut n) = ("# x\ty\tu\tv\tflags\tmask\n".to_owned(), 0);
    for ([x, y], moved) in known {
        // Writing to a string cannot fail.
        let _ = match moved {
            Some([u, v, _]) => writeln!(text, "{x:e}\t{y:e}\t{u:e}\t{v:e}\t0e0\t0e0"),
            None => writeln!(text, "{x:e}\t{y:e}\tnan\tnan\t1e0\t1e0"),
        };
        n += usize::from(moved.is_some());
    }
    (text.into_bytes(), n)
}
