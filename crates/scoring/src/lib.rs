//! Scores: [`results`] reads the output of trackers, [`evaluate`] compares it with the truth.

pub mod evaluate;
pub mod results;
