//! Datasets with their truth from scenarios.
//!
//! [`dataset`] defines the files of a dataset, [`runner`] writes them, [`stream`] makes training samples from
//! the same scenarios, and [`preview`] shows what the optics give before anything is generated.

pub mod dataset;
pub mod preview;
pub mod runner;
pub mod stream;
