//! A first matching by auction with epsilon scaling (Bertsekas 1988).
//!
//! Where all columns must be taken, the last rows find theirs at the end of long paths, and a search for each is dear. In an
//! auction rows bid for columns, a little (epsilon) more than the best they could do elsewhere, until each has one: coarsely
//! at first, then finer. What is bought is within epsilon of the cheapest, so hardly any search has far to go.

use std::collections::VecDeque;

use super::NONE;
use super::cheapest::{Cheapest, Graph};

/// From one epsilon to the next.
const FINER: f64 = 5.0;

/// The last epsilon, as a share of the greatest cost.
const LAST: f64 = 1e-3;

/// Bids of a round, for each row: what is not sold by then would be fought for by ever so little.
const BIDS: usize = 200;

impl Cheapest {
    /// Matches rows with their cheapest columns at prices (less potentials) that an auction has found.
    pub(super) fn auction(&mut self, graph: &Graph) {
        let greatest = graph.costs.iter().fold(0.0f64, |most, c| most.max(c.abs()));
        let mut epsilon = greatest;
        while epsilon > LAST * greatest {
            self.of_row.fill(NONE);
            self.at.iter_mut().for_each(|column| column.row = NONE);
            self.sell(graph, epsilon, greatest);
            epsilon /= FINER;
        }
        for row in 0..graph.rows() {
            if self.of_row[row] != NONE && self.paid(graph, row) > self.two_cheapest(graph, row)[0].0 {
                self.release(graph, row);
            }
        }
    }

    /// One round, in which the first row without a column bids first.
    fn sell(&mut self, graph: &Graph, epsilon: f64, greatest: f64) {
        let mut waiting: VecDeque<u32> = (0..graph.rows() as u32).collect();
        for _ in 0..BIDS * graph.rows() {
            let Some(row) = waiting.pop_front() else { return };
            let [first, second] = self.two_cheapest(graph, row as usize);
            // Who has no alternative outbids all who have.
            let alternative = if second.0.is_finite() { second.0 } else { first.0 + 10.0 * greatest };
            let column = &mut self.at[graph.columns[first.1] as usize];
            column.potential -= alternative - first.0 + epsilon;
            let owner = std::mem::replace(&mut column.row, row);
            self.of_row[row as usize] = first.1 as u32;
            if owner != NONE {
                self.of_row[owner as usize] = NONE;
                waiting.push_back(owner);
            }
        }
    }
}
