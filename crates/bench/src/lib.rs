//! Benchmark datasets for PIV and PTV with defocused and astigmatic particle images: made, checked and measured.
//!
//! The `microsig` command is a thin layer over this library: [`scenario`] says what is wanted, [`runner`] does it,
//! [`dataset`] knows how it lies on disk, [`track`] has baseline trackers, [`results`] reads what trackers write,
//! [`evaluate`] scores it, [`report`] shows it.

pub mod dataset;
pub mod error;
pub mod evaluate;
pub mod export;
pub mod flow_plot;
pub mod light;
pub mod release;
pub mod report;
pub mod results;
pub mod runner;
pub mod scenario;
pub mod track;

pub use error::{Error, Result};
