//! The compiled part of the Python package `microsig`: the functions of `bench`, `flows` and `microsig-core`
//! on NumPy arrays.
//!
//! Names, defaults and documentation for users are in `microsig/*.py`; here arguments are plain and complete.

mod columns;
mod dataset;
mod fields;
mod fit;
mod object;
mod render;
mod run;
mod scores;
mod stream;
mod tables;
mod verbs;

use std::ffi::OsString;

use bench::cli::Cli;
use pyo3::prelude::*;

/// Runs the `microsig` command with these arguments, the first being the program's name; returns its exit
/// code.
#[pyfunction]
fn command(py: Python<'_>, arguments: Vec<OsString>) -> u8 {
    py.detach(|| Cli::run(arguments))
}

/// The functions on which `microsig/*.py` is built.
#[pymodule]
fn _microsig(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add("__version__", storage::dataset::manifest::GENERATOR_VERSION)?;
    module.add_function(wrap_pyfunction!(command, module)?)?;
    module.add_function(wrap_pyfunction!(run::set_threads, module)?)?;
    columns::add(module)?;
    dataset::add(module)?;
    render::add(module)?;
    fields::add(module)?;
    fit::add(module)?;
    scores::add(module)?;
    stream::add(module)?;
    verbs::add(module)
}
