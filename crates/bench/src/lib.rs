//! Generates, checks and scores benchmark datasets for PIV and PTV with defocused and astigmatic particle
//! images.
//!
//! [`scenario`] parses scenarios, [`runner`] generates datasets, [`dataset`] defines their files and
//! [`tables`] the columns of their tables; [`storage`] writes files and folders atomically. [`track`] has
//! baseline trackers, [`results`] reads the output of trackers, [`evaluate`] scores it and [`report`]
//! presents the scores; `view` shows all of it in a browser. [`preview`] shows what the optics give,
//! [`stream`] generates training samples. [`cli`] is the `microsig` command.

pub mod cli;
pub mod dataset;
pub mod error;
pub mod evaluate;
pub mod export;
pub mod fit;
pub mod flow_plot;
pub mod preview;
pub mod problem;
pub mod release;
pub mod report;
pub mod results;
pub mod runner;
pub mod scenario;
pub mod storage;
pub mod stream;
pub mod tables;
pub mod track;
#[cfg(feature = "view")]
pub mod view;
pub mod visibility;

pub use error::{Error, Result};
