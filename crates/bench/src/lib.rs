//! Benchmark datasets for PIV and PTV with defocused and astigmatic particle images: made, checked and measured.
//!
//! The `microsig` command is a thin layer over this library: [`scenario`] says what is wanted, [`runner`] does it,
//! [`dataset`] knows how it lies on disk.

pub mod dataset;
pub mod error;
pub mod runner;
pub mod scenario;

pub use error::{Error, Result};
