//! Arrays in NumPy's format (`numpy.lib.format`), as f64.

use std::path::Path;

use anyhow::{Context, bail, ensure};

/// An array of one or two dimensions in row-major order.
#[derive(Debug, Clone, PartialEq)]
pub struct Array {
    /// Rows and columns; one row for a vector.
    pub shape: (usize, usize),
    /// Values, row by row.
    pub values: Vec<f64>,
}

/// Reads an array of floating-point or unsigned 16-bit numbers.
pub fn read(path: &Path) -> anyhow::Result<Array> {
    let bytes = std::fs::read(path).with_context(|| path.display().to_string())?;
    parse(&bytes).with_context(|| path.display().to_string())
}

fn parse(bytes: &[u8]) -> anyhow::Result<Array> {
    ensure!(bytes.len() > 10 && bytes.starts_with(b"\x93NUMPY\x01"), "not an array of version 1");
    let (header, data) = bytes[10..].split_at(usize::from(u16::from_le_bytes([bytes[8], bytes[9]])));
    // A Python dictionary: {'descr': '<f8', 'fortran_order': False, 'shape': (3, 4), }.
    let header = std::str::from_utf8(header)?;
    let value = |key: &str| Some(header.split_once(&format!("'{key}': "))?.1);
    let shape = value("shape").and_then(|text| text.split(['(', ')']).nth(1)).context("shape")?;
    let shape: Vec<usize> = shape.split(',').filter_map(|size| size.trim().parse().ok()).collect();
    let (rows, columns) = match shape[..] {
        [n] => (1, n),
        [rows, columns] => (rows, columns),
        _ => bail!("{} dimensions", shape.len()),
    };
    let stored: Vec<f64> = match value("descr").and_then(|text| text.get(1..4)) {
        Some("<f4") => data.as_chunks().0.iter().map(|b| f32::from_le_bytes(*b).into()).collect(),
        Some("<f8") => data.as_chunks().0.iter().map(|b| f64::from_le_bytes(*b)).collect(),
        Some("<u2") => data.as_chunks().0.iter().map(|b| u16::from_le_bytes(*b).into()).collect(),
        other => bail!("type {other:?}"),
    };
    ensure!(stored.len() == rows * columns, "{} values in {rows} x {columns}", stored.len());
    let by_columns = value("fortran_order").is_some_and(|text| text.starts_with("True"));
    let at = |i: usize| if by_columns { stored[(i % columns) * rows + i / columns] } else { stored[i] };
    Ok(Array { shape: (rows, columns), values: (0..stored.len()).map(at).collect() })
}
