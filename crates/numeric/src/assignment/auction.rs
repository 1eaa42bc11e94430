//! An initial matching by an auction with epsilon scaling (Bertsekas, 1988).
//!
//! If every column must be matched, the augmenting paths of the last rows are long and expensive to find. In
//! an auction, unmatched rows bid for their cheapest column, raising its price by the difference to their
//! second-best choice plus epsilon, until every row has a column; epsilon is then reduced. Each row ends
//! within epsilon of its optimum, so the augmenting paths that remain are short.

use std::collections::VecDeque;

use super::NONE;
use super::min_cost::{Graph, MinCostMatching};

/// Factor by which epsilon is reduced from round to round.
const FINER: f64 = 5.0;

/// The smallest epsilon, relative to the largest cost.
const LAST: f64 = 1e-3;

/// Maximum number of bids per row in one round: later bids would raise prices only by tiny amounts.
const BIDS: usize = 200;

impl MinCostMatching {
    /// Matches rows with their cheapest columns at the prices (negative potentials) found by an auction.
    pub(super) fn auction(&mut self, graph: &Graph) {
        let greatest = graph.costs.iter().fold(0.0f64, |most, c| most.max(c.abs()));
        let mut epsilon = greatest;
        while epsilon > LAST * greatest {
            self.edge_of_row.fill(NONE);
            self.at.iter_mut().for_each(|column| column.row = NONE);
            self.auction_round(graph, epsilon, greatest);
            epsilon /= FINER;
        }
        for row in 0..graph.rows() {
            if self.edge_of_row[row] != NONE
                && self.matched_reduced_cost(graph, row) > self.two_cheapest(graph, row)[0].0
            {
                self.release(graph, row);
            }
        }
    }

    /// One round; unmatched rows bid in first-in, first-out order.
    fn auction_round(&mut self, graph: &Graph, epsilon: f64, greatest: f64) {
        let mut waiting: VecDeque<u32> = (0..graph.rows() as u32).collect();
        for _ in 0..BIDS * graph.rows() {
            let Some(row) = waiting.pop_front() else { return };
            let [first, second] = self.two_cheapest(graph, row as usize);
            // A row without an alternative outbids every row that has one.
            let alternative = if second.0.is_finite() { second.0 } else { first.0 + 10.0 * greatest };
            let column = &mut self.at[graph.columns[first.1] as usize];
            column.potential -= alternative - first.0 + epsilon;
            let owner = std::mem::replace(&mut column.row, row);
            self.edge_of_row[row as usize] = first.1 as u32;
            if owner != NONE {
                self.edge_of_row[owner as usize] = NONE;
                waiting.push_back(owner);
            }
        }
    }
}
