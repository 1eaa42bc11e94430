//! Tables as NumPy arrays.

use numpy::{PyArray1, PyReadonlyArray1};
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyList};
use storage::dataset::{Columns, Table, Values};

/// A table as Python receives it: its path in a dataset, meaning of a row, units and descriptions by column,
/// values by column.
pub(crate) fn table<'py>(
    py: Python<'py>,
    table: &Table,
    columns: Columns,
) -> PyResult<(String, String, Bound<'py, PyDict>, Bound<'py, PyDict>)> {
    let about = PyDict::new(py);
    for column in table.columns.iter() {
        about.set_item(column.name, (column.unit, column.description))?;
    }
    Ok((table.path.to_owned(), table.description.to_owned(), about, arrays(py, columns)?))
}

/// A column that Python gives.
#[derive(FromPyObject)]
pub(crate) enum Given<'py> {
    Whole(PyReadonlyArray1<'py, i64>),
    Numbers(PyReadonlyArray1<'py, f64>),
    Texts(Vec<String>),
}

/// The columns of a table that Python gives.
pub(crate) fn columns(given: Vec<(String, Given<'_>)>) -> Columns {
    let values = |given: Given<'_>| match given {
        Given::Whole(values) => Values::Whole(values.as_array().to_vec()),
        Given::Numbers(values) => Values::Numbers(values.as_array().to_vec()),
        Given::Texts(values) => Values::Texts(values),
    };
    Columns(given.into_iter().map(|(name, given)| (name, values(given))).collect())
}

/// Columns as arrays: int64, float64, or lists of texts.
pub(crate) fn arrays(py: Python<'_>, columns: Columns) -> PyResult<Bound<'_, PyDict>> {
    let arrays = PyDict::new(py);
    for (name, values) in columns.0 {
        match values {
            Values::Whole(values) => arrays.set_item(name, PyArray1::from_vec(py, values))?,
            Values::Numbers(values) => arrays.set_item(name, PyArray1::from_vec(py, values))?,
            Values::Texts(values) => arrays.set_item(name, PyList::new(py, values)?)?,
        }
    }
    Ok(arrays)
}
