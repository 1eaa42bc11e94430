//! Results as Python objects.

use pyo3::prelude::*;
use pythonize::{PythonizeError, pythonize};
use serde::Serialize;
use serde_json::Value;

/// A result as Python receives it: dicts, lists, numbers, texts and None, with the keys of its JSON.
#[derive(Debug)]
pub(crate) struct Object<T = Value>(pub(crate) T);

impl Object {
    /// The result.
    pub(crate) fn of(result: &impl Serialize) -> storage::Result<Self> {
        serde_json::to_value(result).map(Object).map_err(|e| storage::Error::input(e.to_string()))
    }
}

impl<'py, T: Serialize> IntoPyObject<'py> for Object<T> {
    type Target = PyAny;
    type Output = Bound<'py, PyAny>;
    type Error = PythonizeError;

    fn into_pyobject(self, py: Python<'py>) -> Result<Self::Output, Self::Error> {
        pythonize(py, &self.0)
    }
}
