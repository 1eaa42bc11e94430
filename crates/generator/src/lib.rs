//! Generates datasets with ground truth from scenarios.
//!
//! [`dataset`] defines the files of a dataset, [`runner`] writes them, [`stream`] generates training samples
//! from the same scenarios, and [`preview`] predicts particle images before anything is generated. [`setup`] is
//! the short way for programs: images and truth of a flow under a microscope, in memory.

pub mod dataset;
pub mod preview;
pub mod runner;
pub mod setup;
pub mod stream;
