//! Ranking of results for the same dataset by several criteria in order of priority.
//!
//! Two results are compared on the units that both share (`paired.rs`). A result is behind another if it is
//! significantly worse. The results of a group that are behind no other come first (`order.rs`), and
//! the next criterion orders them; results that no criterion separates share a rank.

mod metric;
mod order;
mod paired;
#[cfg(test)]
mod tests;

use scenario::Metric;

use crate::evaluate::{Score, UnitScores};
pub use metric::{Better, SCORES, ScoreDef, Subject, ranks_fields};
use paired::{Draws, Paired};

/// A result that is ranked.
#[derive(Debug, Clone, Copy)]
pub struct Contestant<'a> {
    /// Its scores.
    pub score: &'a Score,
    /// Its sums over units; without these, intervals are compared.
    pub units: Option<&'a UnitScores>,
}

/// Indices of the results in order, each with its rank from 1. `seed` is that of the bootstrap.
pub fn rank(contestants: &[Contestant<'_>], criteria: &[Metric], seed: u64) -> Vec<(usize, usize)> {
    let draws = Draws::new(seed);
    let compared: Vec<Vec<Paired<'_>>> = criteria
        .iter()
        .map(|metric| contestants.iter().map(|of| Paired::new(*metric, of, &draws)).collect())
        .collect();
    order::ranks(contestants.len(), criteria.len(), &|criterion: usize, a: usize, b: usize| {
        let paired = &compared[criterion];
        paired[a].is_better_than(&paired[b], &draws)
    })
}
