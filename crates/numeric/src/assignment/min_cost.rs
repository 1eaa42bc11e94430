//! The minimum-cost matching that covers all rows of a graph.
//!
//! Shortest augmenting paths with potentials (Jonker and Volgenant, 1987; Dijkstra's algorithm with a heap).
//! In a dense graph few edges matter: it is first solved with only the cheapest edges of each row; edges with
//! a negative reduced cost are then added, and the solution is continued until no such edge is left, so that
//! the result is optimal for the whole graph.

use std::cmp::{Ordering, Reverse};
use std::collections::BinaryHeap;
use std::ops::Range;

use super::NONE;

/// Edges by row. The first edges of each row are active, the others are ignored by the solver.
#[derive(Clone, Default)]
pub(super) struct Graph {
    ends: Vec<u32>,
    /// End of each row's active edges.
    active: Vec<u32>,
    pub(super) columns: Vec<u32>,
    pub(super) costs: Vec<f64>,
}

impl Graph {
    pub(super) fn push(&mut self, column: u32, cost: f64) {
        self.columns.push(column);
        self.costs.push(cost);
    }

    pub(super) fn end_row(&mut self) {
        self.ends.push(self.columns.len() as u32);
        self.active.push(self.columns.len() as u32);
    }

    pub(super) fn rows(&self) -> usize {
        self.ends.len()
    }

    fn start(&self, row: usize) -> usize {
        if row == 0 { 0 } else { self.ends[row - 1] as usize }
    }

    /// The active edges of a row.
    pub(super) fn range(&self, row: usize) -> Range<usize> {
        self.start(row)..self.active[row] as usize
    }

    /// The inactive edges of a row.
    fn idle(&self, row: usize) -> Range<usize> {
        self.active[row] as usize..self.ends[row] as usize
    }

    /// Activates an inactive edge.
    fn activate(&mut self, row: usize, edge: usize) {
        let at = self.active[row] as usize;
        self.columns.swap(at, edge);
        self.costs.swap(at, edge);
        self.active[row] += 1;
    }

    /// Keeps only the `keep` cheapest edges of each row active, and the edge to its column in `cover`.
    fn keep_cheapest(&mut self, keep: usize, cover: &[u32]) {
        let mut order: Vec<(f64, u32)> = Vec::new();
        for (row, &covered) in cover.iter().enumerate() {
            let all = self.start(row)..self.ends[row] as usize;
            if all.len() <= keep {
                continue;
            }
            order.clear();
            order.extend(all.clone().map(|e| (self.costs[e], self.columns[e])));
            order.select_nth_unstable_by(keep, |a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
            for (e, (cost, column)) in all.clone().zip(&order) {
                (self.costs[e], self.columns[e]) = (*cost, *column);
            }
            self.active[row] = (all.start + keep) as u32;
            if let Some(e) = self.idle(row).find(|&e| self.columns[e] == covered) {
                self.activate(row, e);
            }
        }
    }
}

/// Active edges per row when a dense graph is first solved.
const CORE: usize = 12;

/// Number of columns from which an auction is worthwhile.
const MANY: usize = 100;

/// The column of every row in the minimum-cost matching that covers all rows; `cover` is any matching that
/// covers them.
pub(super) fn cheapest_cover(mut graph: Graph, columns: usize, cover: &[u32]) -> Vec<u32> {
    if graph.costs.len() > CORE * graph.rows() {
        graph.keep_cheapest(CORE, cover);
    }
    // Bound on the rounding error of a path's cost.
    let rounding = 1e-12 * graph.costs.iter().fold(0.0f64, |most, c| most.max(c.abs()));
    let mut matching = MinCostMatching::new(&graph, columns);
    // If every column must be matched, searches for the last free ones are long.
    if graph.rows() == columns && columns >= MANY {
        matching.auction(&graph);
    }
    matching.reduce_rows(&graph);
    loop {
        for row in 0..graph.rows() {
            if matching.edge_of_row[row] == NONE {
                matching.search(&graph, row);
            }
        }
        matching.raise_free_columns(&graph);
        let mut complete = true;
        for row in 0..graph.rows() {
            let limit = matching.matched_reduced_cost(&graph, row) - rounding;
            let before = graph.range(row).end;
            for e in graph.idle(row) {
                if matching.reduced_cost(&graph, e) < limit {
                    graph.activate(row, e);
                }
            }
            if graph.range(row).end > before {
                matching.release(&graph, row);
                complete = false;
            }
        }
        if complete {
            return matching.edge_of_row.iter().map(|&e| graph.columns[e as usize]).collect();
        }
    }
}

/// A distance, whether the column is matched, and the column: among equal distances, free columns come first.
#[derive(PartialEq)]
struct Distance(f64, bool, u32);

impl Eq for Distance {}

impl Ord for Distance {
    fn cmp(&self, other: &Self) -> Ordering {
        self.0.total_cmp(&other.0).then((self.1, self.2).cmp(&(other.1, other.2)))
    }
}

impl PartialOrd for Distance {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

/// A column's state while the matching is built.
#[derive(Clone, Copy)]
pub(super) struct Column {
    /// Dual variable, at most 0.
    pub(super) potential: f64,
    /// Distance from the start of the current search, ...
    distance: f64,
    /// ... and whether that is final.
    done: bool,
    /// The row matched with it, or `NONE`.
    pub(super) row: u32,
}

/// A partial matching with column potentials such that every matched row uses an edge of least reduced cost.
pub(super) struct MinCostMatching {
    pub(super) at: Vec<Column>,
    /// The matched edge of each row, or `NONE`.
    pub(super) edge_of_row: Vec<u32>,
    /// The row and edge by which a search reached each column.
    predecessor: Vec<(u32, u32)>,
}

impl MinCostMatching {
    fn new(graph: &Graph, columns: usize) -> Self {
        let column = Column { potential: 0.0, distance: f64::INFINITY, done: false, row: NONE };
        MinCostMatching {
            at: vec![column; columns],
            edge_of_row: vec![NONE; graph.rows()],
            predecessor: vec![(NONE, NONE); columns],
        }
    }

    /// Reduced cost of an edge: cost minus the column's potential.
    fn reduced_cost(&self, graph: &Graph, edge: usize) -> f64 {
        graph.costs[edge] - self.at[graph.columns[edge] as usize].potential
    }

    /// Reduced cost of a matched row's edge.
    pub(super) fn matched_reduced_cost(&self, graph: &Graph, row: usize) -> f64 {
        self.reduced_cost(graph, self.edge_of_row[row] as usize)
    }

    /// A row's two active edges of least reduced cost: (reduced cost, edge), with infinite cost if there is
    /// none.
    pub(super) fn two_cheapest(&self, graph: &Graph, row: usize) -> [(f64, usize); 2] {
        let (mut first, mut second) = ((f64::INFINITY, usize::MAX), (f64::INFINITY, usize::MAX));
        for e in graph.range(row) {
            let cost = self.reduced_cost(graph, e);
            if cost < first.0 {
                (second, first) = (first, (cost, e));
            } else if cost < second.0 {
                second = (cost, e);
            }
        }
        [first, second]
    }

    /// Unmatches a row.
    pub(super) fn release(&mut self, graph: &Graph, row: usize) {
        let e = std::mem::replace(&mut self.edge_of_row[row], NONE);
        self.at[graph.columns[e as usize] as usize].row = NONE;
    }

    /// Jonker and Volgenant's augmenting row reduction: a row takes its cheapest column from its current
    /// owner and lowers the column's potential by the difference to its second-cheapest. Few rows remain for
    /// the shortest-path searches.
    fn reduce_rows(&mut self, graph: &Graph) {
        let mut free: Vec<u32> =
            (0..graph.rows() as u32).rev().filter(|&row| self.edge_of_row[row as usize] == NONE).collect();
        for _ in 0..3 {
            let mut waiting = Vec::new();
            // Rows can outbid each other in ever smaller steps; the searches match the rest.
            let mut steps = 20 * free.len();
            while let Some(row) = free.pop() {
                if steps == 0 {
                    waiting.push(row);
                    continue;
                }
                steps -= 1;
                let [first, second] = self.two_cheapest(graph, row as usize);
                let mut edge = first.1;
                let owner = self.at[graph.columns[edge] as usize].row;
                let better = first.0 < second.0;
                if second.1 == usize::MAX {
                    // Without a second choice the bid is undefined.
                    if owner != NONE {
                        waiting.push(row);
                        continue;
                    }
                } else if better {
                    self.at[graph.columns[edge] as usize].potential -= second.0 - first.0;
                } else if owner != NONE {
                    edge = second.1;
                }
                let column = graph.columns[edge] as usize;
                let owner = std::mem::replace(&mut self.at[column].row, row);
                self.edge_of_row[row as usize] = edge as u32;
                if owner != NONE {
                    self.edge_of_row[owner as usize] = NONE;
                    if better { free.push(owner) } else { waiting.push(owner) }
                }
            }
            waiting.reverse();
            free = waiting;
        }
    }

    /// Matches a row along the cheapest alternating path to a free column.
    fn search(&mut self, graph: &Graph, start: usize) {
        let (mut heap, mut touched, mut scanned) = (BinaryHeap::new(), Vec::new(), Vec::new());
        let (mut row, mut base) = (start, 0.0);
        // Distance of the nearest free column so far; columns farther away are skipped.
        let mut bound = f64::INFINITY;
        let free = loop {
            for e in graph.range(row) {
                let column = graph.columns[e] as usize;
                let d = base + self.reduced_cost(graph, e);
                if d < bound && d < self.at[column].distance && !self.at[column].done {
                    if self.at[column].distance.is_infinite() {
                        touched.push(column);
                    }
                    self.at[column].distance = d;
                    self.predecessor[column] = (row as u32, e as u32);
                    let taken = self.at[column].row != NONE;
                    if !taken {
                        bound = d;
                    }
                    heap.push(Reverse(Distance(d, taken, column as u32)));
                }
            }
            let nearest = loop {
                match heap.pop() {
                    Some(Reverse(Distance(d, _, column)))
                        if !self.at[column as usize].done && d == self.at[column as usize].distance =>
                    {
                        break Some(column as usize);
                    }
                    Some(_) => {}
                    None => break None,
                }
            };
            let Some(column) = nearest else { break None };
            if self.at[column].row == NONE {
                break Some(column);
            }
            self.at[column].done = true;
            scanned.push(column);
            row = self.at[column].row as usize;
            base = self.at[column].distance - self.matched_reduced_cost(graph, row);
        };
        if let Some(mut column) = free {
            let length = self.at[column].distance;
            for &c in &scanned {
                self.at[c].potential += self.at[c].distance - length;
            }
            loop {
                let (row, e) = self.predecessor[column];
                let left = std::mem::replace(&mut self.edge_of_row[row as usize], e);
                self.at[column].row = row;
                if row as usize == start {
                    break;
                }
                column = graph.columns[left as usize] as usize;
            }
        }
        for c in touched {
            self.at[c].distance = f64::INFINITY;
            self.at[c].done = false;
        }
    }

    /// In an optimal solution every free column has potential 0 (complementary slackness). A search against
    /// the direction of alternating paths finds the column to free instead, possibly the same one.
    fn raise_free_columns(&mut self, graph: &Graph) {
        let low = |c: &usize| self.at[*c].row == NONE && self.at[*c].potential < 0.0;
        // A column freed for one of them has potential 0, so the list stays complete.
        let low: Vec<usize> = (0..self.at.len()).filter(low).collect();
        if !low.is_empty() {
            let column_edges = ColumnEdges::new(graph, self.at.len());
            low.into_iter().for_each(|column| self.raise(graph, &column_edges, column));
        }
    }

    fn raise(&mut self, graph: &Graph, column_edges: &ColumnEdges, start: usize) {
        let (mut heap, mut touched, mut scanned) = (BinaryHeap::new(), vec![start], Vec::new());
        self.at[start].distance = 0.0;
        heap.push(Reverse(Distance(0.0, false, start as u32)));
        let mut best = (f64::INFINITY, start);
        while let Some(Reverse(Distance(d, _, column))) = heap.pop() {
            let column = column as usize;
            if d >= best.0 {
                break;
            }
            if self.at[column].done || d > self.at[column].distance {
                continue;
            }
            self.at[column].done = true;
            scanned.push(column);
            let end = d - self.at[column].potential;
            if end < best.0 {
                best = (end, column);
            }
            for &(row, e) in column_edges.range(column) {
                let had = graph.columns[self.edge_of_row[row as usize] as usize] as usize;
                let d =
                    d + self.reduced_cost(graph, e as usize) - self.matched_reduced_cost(graph, row as usize);
                if !self.at[had].done && d < self.at[had].distance && d < best.0 {
                    if self.at[had].distance.is_infinite() {
                        touched.push(had);
                    }
                    self.at[had].distance = d;
                    self.predecessor[had] = (row, e);
                    heap.push(Reverse(Distance(d, false, had as u32)));
                }
            }
        }
        for &c in &scanned {
            let more = (best.0 - self.at[c].distance).max(0.0);
            self.at[c].potential = (self.at[c].potential + more).min(0.0);
        }
        // Shifts the rows along the path toward the column that was free.
        let mut column = best.1;
        self.at[column].potential = 0.0;
        self.at[column].row = NONE;
        while column != start {
            let (row, e) = self.predecessor[column];
            self.edge_of_row[row as usize] = e;
            column = graph.columns[e as usize] as usize;
            self.at[column].row = row;
        }
        for c in touched {
            self.at[c].distance = f64::INFINITY;
            self.at[c].done = false;
        }
    }
}

/// The active edges by column: (row, edge).
struct ColumnEdges {
    starts: Vec<u32>,
    edges: Vec<(u32, u32)>,
}

impl ColumnEdges {
    fn new(graph: &Graph, columns: usize) -> Self {
        let edges =
            || (0..graph.rows()).flat_map(|row| graph.range(row).map(move |e| (row as u32, e as u32)));
        let mut starts = vec![0u32; columns + 1];
        edges().for_each(|(_, e)| starts[graph.columns[e as usize] as usize + 1] += 1);
        (0..columns).for_each(|c| starts[c + 1] += starts[c]);
        let mut next = starts.clone();
        let mut sorted = vec![(0, 0); starts[columns] as usize];
        for edge in edges() {
            let at = &mut next[graph.columns[edge.1 as usize] as usize];
            sorted[*at as usize] = edge;
            *at += 1;
        }
        ColumnEdges { starts, edges: sorted }
    }

    fn range(&self, column: usize) -> &[(u32, u32)] {
        &self.edges[self.starts[column] as usize..self.starts[column + 1] as usize]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Knuth's linear congruential generator, uniform on [0, 1).
    fn congruences(mut state: u64) -> impl FnMut() -> f64 {
        move || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (state >> 11) as f64 / (1u64 << 53) as f64
        }
    }

    /// Total cost of an assignment.
    fn sum(graph: &Graph, of_row: &[u32]) -> f64 {
        let cost = |(row, column): (usize, &u32)| {
            graph.range(row).find(|&e| graph.columns[e] == *column).map(|e| graph.costs[e]).unwrap()
        };
        of_row.iter().enumerate().map(cost).sum()
    }

    #[test]
    fn an_auction_does_not_change_the_optimum() {
        let mut random = congruences(7);
        for case in 0..30 {
            // In every third case costs are often equal, so that bids differ by epsilon alone.
            let (n, levels) = (MANY + case, if case % 3 == 0 { 4.0 } else { 1e9 });
            let mut graph = Graph::default();
            for row in 0..n {
                // A ring, so that a perfect matching exists, and random further edges.
                let mut columns = std::collections::BTreeSet::from([row, (row + 1) % n]);
                (0..case % 7).for_each(|_| _ = columns.insert((random() * n as f64) as usize));
                columns.into_iter().for_each(|c| graph.push(c as u32, (random() * levels).floor() / levels));
                graph.end_row();
            }
            let mut searched = MinCostMatching::new(&graph, n);
            (0..n).for_each(|row| searched.search(&graph, row));
            let least: f64 = (0..n).map(|row| graph.costs[searched.edge_of_row[row] as usize]).sum();

            let mut auctioned = MinCostMatching::new(&graph, n);
            auctioned.auction(&graph);
            for row in (0..n).filter(|&row| auctioned.edge_of_row[row] != NONE) {
                assert_eq!(
                    auctioned.matched_reduced_cost(&graph, row),
                    auctioned.two_cheapest(&graph, row)[0].0
                );
            }
            let cover: Vec<u32> = (0..n as u32).collect();
            let of_row = cheapest_cover(graph.clone(), n, &cover);
            let sum = sum(&graph, &of_row);
            assert!((sum - least).abs() < 1e-9, "{case}: {sum} {least}");
            assert_eq!(of_row.iter().collect::<std::collections::BTreeSet<_>>().len(), n);
        }
    }

    #[test]
    fn dense_graphs_are_solved_as_well_as_whole_ones() {
        let mut random = congruences(1);
        for case in 0..200 {
            let mut graph = Graph::default();
            for row in 0..60 {
                // All rows prefer the same columns, so that the cheapest edges alone do not suffice.
                (0..70).for_each(|column| graph.push(column, random() + 0.03 * f64::from(column)));
                // A row may stay unmatched; in half of the cases some prefer to.
                graph.push(70 + row, if case % 2 == 0 { 5.0 } else { 0.4 });
                graph.end_row();
            }
            // Reference: successive shortest paths with all edges active.
            let mut whole = MinCostMatching::new(&graph, 130);
            (0..60).for_each(|row| whole.search(&graph, row));
            let least: f64 = whole.edge_of_row.iter().map(|e| graph.costs[*e as usize]).sum();
            let alone: Vec<u32> = (70..130).collect();
            let of_row = cheapest_cover(graph.clone(), 130, &alone);
            let sum = sum(&graph, &of_row);
            assert!((sum - least).abs() < 1e-9, "{sum} {least}");
            let used: std::collections::BTreeSet<u32> = of_row.iter().copied().collect();
            assert_eq!(used.len(), 60);
        }
    }
}
