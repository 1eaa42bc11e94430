//! Ranking of results for the same dataset by several criteria in order of priority.
//!
//! Two results are compared on the units that both share (`paired.rs`), by all criteria: of two results of equal skill, the
//! probability that any criterion separates them is at most 5 % (Bonferroni). The first criterion that separates them
//! decides. The level of a criterion does not depend on the others: by Holm's procedure, a result could gain by a worse
//! second score, whose rejection raises the level of the first. Ranks follow from these pairs (`order.rs`).

mod metric;
mod order;
mod paired;
#[cfg(test)]
mod simulated;
#[cfg(test)]
mod tests;

use std::cmp::Ordering;

use storage::dataset::manifest::Metric;

use crate::evaluate::{Score, UnitScores};
pub use metric::{Better, Published, SCORES, ScoreDef, Subject, ranks_fields};
pub use order::Pairs;
use paired::{Draws, Paired};

/// A result that is ranked.
#[derive(Debug, Clone, Copy)]
pub struct Contestant<'a> {
    /// Its scores.
    pub score: &'a Score,
    /// Its sums over units; without these, intervals are compared.
    pub units: Option<&'a UnitScores>,
}

/// Probability that two results of equal skill are separated by any of their criteria.
pub const FAMILY_ERROR: f64 = 0.05;

/// Which results are better than which others. `seed`: of the bootstrap.
pub fn pairs(contestants: &[Contestant<'_>], criteria: &[Metric], seed: u64) -> Pairs {
    let draws = Draws::new(seed);
    let compared: Vec<Vec<Paired<'_>>> = criteria
        .iter()
        .map(|metric| contestants.iter().map(|of| Paired::new(*metric, of, &draws)).collect())
        .collect();
    Pairs::new(contestants.len(), |a, b| {
        let level = FAMILY_ERROR / criteria.len().max(1) as f64;
        let orders = compared.iter().map(|of| of[a].difference(&of[b], &draws).significant(level));
        let decided = orders.enumerate().find(|(_, order)| order.is_ne());
        // A positive difference: a is better and comes first.
        decided.map_or((Ordering::Equal, 0), |(criterion, order)| (order.reverse(), criterion))
    })
}

/// Indices of the results in order, each with its rank from 1; see [`Pairs::ranks`].
pub fn rank(contestants: &[Contestant<'_>], criteria: &[Metric], seed: u64) -> Vec<(usize, usize)> {
    pairs(contestants, criteria, seed).ranks()
}
