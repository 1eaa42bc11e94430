//! Tables as NumPy arrays, and by Arrow's PyCapsule interface: `__arrow_c_stream__`
//! (arrow.apache.org/docs/format/CDataInterface/PyCapsuleInterface.html), which pandas, polars, pyarrow,
//! DuckDB and others read.

use std::sync::Arc;

use arrow_array::ffi_stream::FFI_ArrowArrayStream;
use arrow_array::{ArrayRef, Float64Array, Int64Array, RecordBatch, RecordBatchIterator, StringArray};
use numpy::{PyArray1, PyReadonlyArray1};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::{PyCapsule, PyDict, PyList};
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

/// A stream of one batch with these columns.
#[pyfunction]
pub(crate) fn arrow_stream<'py>(
    py: Python<'py>,
    given: Vec<(String, Given<'py>)>,
) -> PyResult<Bound<'py, PyCapsule>> {
    let wrong = |e: arrow_schema::ArrowError| PyValueError::new_err(e.to_string());
    let array = |values| -> ArrayRef {
        match values {
            Values::Whole(values) => Arc::new(Int64Array::from(values)),
            Values::Numbers(values) => Arc::new(Float64Array::from(values)),
            Values::Texts(values) => Arc::new(StringArray::from(values)),
        }
    };
    let arrays = columns(given).0.into_iter().map(|(name, values)| (name, array(values), false));
    let batch = RecordBatch::try_from_iter_with_nullable(arrays).map_err(wrong)?;
    let schema = batch.schema();
    let reader = RecordBatchIterator::new([Ok(batch)], schema);
    let stream = FFI_ArrowArrayStream::new(Box::new(reader));
    // A stream that nobody took is released when it is dropped.
    PyCapsule::new_with_value(py, stream, c"arrow_array_stream")
}
