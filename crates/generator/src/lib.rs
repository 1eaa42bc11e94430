//! Generates datasets with ground truth from scenarios.
//!
//! [`dataset`] defines the files of a dataset, [`runner`] writes them, [`stream`] generates training samples
//! from the same scenarios, and [`preview`] predicts particle images before anything is generated.

pub mod dataset;
pub mod preview;
pub mod runner;
pub mod stream;
