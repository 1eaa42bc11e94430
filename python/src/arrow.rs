//! Tables by Arrow's PyCapsule interface: `__arrow_c_stream__`
//! (arrow.apache.org/docs/format/CDataInterface/PyCapsuleInterface.html), which pandas, polars, pyarrow,
//! DuckDB and others read.

use std::sync::Arc;

use arrow_array::ffi_stream::FFI_ArrowArrayStream;
use arrow_array::{ArrayRef, Float64Array, Int64Array, RecordBatch, RecordBatchIterator, StringArray};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::PyCapsule;
use storage::dataset::Values;

use crate::columns::{Given, columns};

/// A stream of one batch with these columns.
#[pyfunction]
fn arrow_stream<'py>(py: Python<'py>, given: Vec<(String, Given<'py>)>) -> PyResult<Bound<'py, PyCapsule>> {
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

pub(crate) fn add(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add_function(wrap_pyfunction!(arrow_stream, module)?)
}
