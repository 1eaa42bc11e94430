//! Scores: [`results`] reads the output of trackers, [`evaluate`] compares it with the truth,
//! [`ranking`] orders the results of several.

pub mod evaluate;
pub mod ranking;
pub mod results;
