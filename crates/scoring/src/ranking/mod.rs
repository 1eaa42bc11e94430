//! Ranking of results for the same dataset by several criteria in order of priority.
//!
//! Two results are compared on the units that both share (`paired.rs`), by all criteria together: of two results of
//! equal skill, the probability that any criterion separates them is at most 5 % (Holm, Scand. J. Stat. 6, 65, 1979).
//! The first criterion that separates them decides. Ranks follow from these pairs (`order.rs`), so that the order of a
//! pair does not depend on who else takes part.

mod metric;
mod order;
mod paired;
#[cfg(test)]
mod simulated;
#[cfg(test)]
mod tests;

use std::cmp::Ordering;

use scenario::Metric;

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
        let differences: Vec<_> = compared.iter().map(|of| of[a].difference(&of[b], &draws)).collect();
        // Holm: while criteria are left, those significant at the error divided by their number are settled.
        let mut found = vec![Ordering::Equal; differences.len()];
        loop {
            let left: Vec<usize> = (0..found.len()).filter(|&k| found[k].is_eq()).collect();
            let level = FAMILY_ERROR / left.len().max(1) as f64;
            left.iter().for_each(|&k| found[k] = differences[k].significant(level));
            if left.iter().all(|&k| found[k].is_eq()) {
                // A positive difference: a is better and comes first.
                return found
                    .into_iter()
                    .find(|order| order.is_ne())
                    .map_or(Ordering::Equal, Ordering::reverse);
            }
        }
    })
}

/// Indices of the results in order, each with its rank from 1; see [`Pairs::ranks`].
pub fn rank(contestants: &[Contestant<'_>], criteria: &[Metric], seed: u64) -> Vec<(usize, usize)> {
    pairs(contestants, criteria, seed).ranks()
}
