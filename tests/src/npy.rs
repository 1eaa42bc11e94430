//! Arrays in NumPy's format, as f64.

use std::path::Path;

use anyhow::{Context, bail};
use npyz::{DType, NpyFile, Order, TypeChar};

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
    let file = NpyFile::new(&bytes[..])?;
    let shape = match *file.shape() {
        [n] => (1, n as usize),
        [rows, columns] => (rows as usize, columns as usize),
        ref other => bail!("{}: {} dimensions", path.display(), other.len()),
    };
    let DType::Plain(kind) = file.dtype() else { bail!("{}: a structured array", path.display()) };
    let by_columns = file.order() == Order::Fortran;
    let stored: Vec<f64> = match (kind.type_char(), kind.size_field()) {
        (TypeChar::Float, 4) => file.into_vec::<f32>()?.into_iter().map(f64::from).collect(),
        (TypeChar::Float, 8) => file.into_vec::<f64>()?,
        (TypeChar::Uint, 2) => file.into_vec::<u16>()?.into_iter().map(f64::from).collect(),
        other => bail!("{}: type {other:?}", path.display()),
    };
    let (rows, columns) = shape;
    let values = if by_columns {
        (0..rows * columns).map(|i| stored[(i % columns) * rows + i / columns]).collect()
    } else {
        stored
    };
    Ok(Array { shape, values })
}
