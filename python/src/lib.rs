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
mod _microsig {
    use pyo3::prelude::*;

    #[pymodule_export]
    use super::{
        columns::arrow_stream,
        command,
        dataset::{
            Made, copy_dataset, generate, manifest, read_images, read_scenario, read_table, resolve,
            scenario_of, unpack_scenarios,
        },
        fields::{FlowField, field, fields},
        fit::{FittedMicroscope, fit_scan},
        render::{image_size, read_settings, render},
        run::set_threads,
        scores::{Scored, SweepCases, compare, evaluate, methods, sweep, track},
        stream::{Ahead, Samples},
        verbs::{call, export, optics, write_stack},
    };

    #[pymodule_init]
    fn init(module: &Bound<'_, PyModule>) -> PyResult<()> {
        module.add("__version__", storage::dataset::manifest::GENERATOR_VERSION)?;
        module.add("PARTICLE_COLUMNS", generator::stream::PARTICLE_COLUMNS.to_vec())
    }
}
