//! The cheapest matching that covers all rows of a graph.
//!
//! It grows by shortest augmenting paths with potentials (Jonker and Volgenant, 1987; Dijkstra on a heap). Of a dense graph
//! hardly any edges matter: it is solved with the cheapest of each row, then goes on from there with those added that the
//! potentials show to be cheaper, until there are none. The result is the cheapest of the whole graph then.

use std::cmp::{Ordering, Reverse};
use std::collections::BinaryHeap;
use std::ops::Range;

use super::NONE;

/// Rows and their edges, of which some take part: those at the front of each row.
#[derive(Clone, Default)]
pub(super) struct Graph {
    ends: Vec<u32>,
    /// Where the edges of each row that take part end.
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

    /// The edges that take part.
    pub(super) fn range(&self, row: usize) -> Range<usize> {
        self.start(row)..self.active[row] as usize
    }

    /// The edges that do not.
    fn idle(&self, row: usize) -> Range<usize> {
        self.active[row] as usize..self.ends[row] as usize
    }

    /// Lets an idle edge take part.
    fn admit(&mut self, row: usize, edge: usize) {
        let at = self.active[row] as usize;
        self.columns.swap(at, edge);
        self.costs.swap(at, edge);
        self.active[row] += 1;
    }

    /// Leaves the cheapest edges of each row, and the one to its column in `cover`.
    fn thin(&mut self, keep: usize, cover: &[u32]) {
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
                self.admit(row, e);
            }
        }
    }
}

/// Edges of each row that a dense graph is solved with first.
const CORE: usize = 12;

/// Rows from which on an auction pays.
const MANY: usize = 100;

/// The column of every row in the cheapest matching that covers all rows, of which one, `cover`, is known.
pub(super) fn cheapest_cover(mut graph: Graph, columns: usize, cover: &[u32]) -> Vec<u32> {
    if graph.costs.len() > CORE * graph.rows() {
        graph.thin(CORE, cover);
    }
    // Sums of a path's costs round by less than this.
    let rounding = 1e-12 * graph.costs.iter().fold(0.0f64, |most, c| most.max(c.abs()));
    let mut cheapest = Cheapest::new(&graph, columns);
    // Where every column must be taken, searches for the last free ones would go far.
    if graph.rows() == columns && columns >= MANY {
        cheapest.auction(&graph);
    }
    cheapest.reduce_rows(&graph);
    loop {
        for row in 0..graph.rows() {
            if cheapest.of_row[row] == NONE {
                cheapest.search(&graph, row);
            }
        }
        cheapest.raise_free_columns(&graph);
        let mut complete = true;
        for row in 0..graph.rows() {
            let limit = cheapest.paid(&graph, row) - rounding;
            let before = graph.range(row).end;
            for e in graph.idle(row) {
                if cheapest.offered(&graph, e) < limit {
                    graph.admit(row, e);
                }
            }
            if graph.range(row).end > before {
                cheapest.release(&graph, row);
                complete = false;
            }
        }
        if complete {
            return cheapest.of_row.iter().map(|&e| graph.columns[e as usize]).collect();
        }
    }
}

/// A distance, whether the column is taken, and the column: of equally near ones a free one ends the search.
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

/// A column in the making of a matching.
#[derive(Clone, Copy)]
pub(super) struct Column {
    /// At most 0.
    pub(super) potential: f64,
    /// How far it is from where a search starts, ...
    distance: f64,
    /// ... and whether that is final.
    done: bool,
    /// The row that has it.
    pub(super) row: u32,
}

/// A matching in the making, with potentials of columns by which every matched row has its cheapest edge.
pub(super) struct Cheapest {
    pub(super) at: Vec<Column>,
    /// The edge of each row that is matched.
    pub(super) of_row: Vec<u32>,
    /// The row and the edge that lead a search to a column.
    came_by: Vec<(u32, u32)>,
}

impl Cheapest {
    fn new(graph: &Graph, columns: usize) -> Self {
        let column = Column { potential: 0.0, distance: f64::INFINITY, done: false, row: NONE };
        Cheapest {
            at: vec![column; columns],
            of_row: vec![NONE; graph.rows()],
            came_by: vec![(NONE, NONE); columns],
        }
    }

    /// What an edge costs, less its column's potential.
    fn offered(&self, graph: &Graph, edge: usize) -> f64 {
        graph.costs[edge] - self.at[graph.columns[edge] as usize].potential
    }

    /// What a matched row's edge costs, less its column's potential.
    pub(super) fn paid(&self, graph: &Graph, row: usize) -> f64 {
        self.offered(graph, self.of_row[row] as usize)
    }

    /// A row's cheapest edges with what they cost, less their columns' potentials; infinity where there is none.
    pub(super) fn two_cheapest(&self, graph: &Graph, row: usize) -> [(f64, usize); 2] {
        let (mut first, mut second) = ((f64::INFINITY, usize::MAX), (f64::INFINITY, usize::MAX));
        for e in graph.range(row) {
            let cost = self.offered(graph, e);
            if cost < first.0 {
                (second, first) = (first, (cost, e));
            } else if cost < second.0 {
                second = (cost, e);
            }
        }
        [first, second]
    }

    /// Takes a row's column away.
    pub(super) fn release(&mut self, graph: &Graph, row: usize) {
        let e = std::mem::replace(&mut self.of_row[row], NONE);
        self.at[graph.columns[e as usize] as usize].row = NONE;
    }

    /// Jonker and Volgenant's augmenting row reduction: a row takes its cheapest column, bidding the difference to its
    /// second cheapest, from whoever had it. It leaves few rows to the searches for shortest paths.
    fn reduce_rows(&mut self, graph: &Graph) {
        let mut free: Vec<u32> =
            (0..graph.rows() as u32).rev().filter(|&row| self.of_row[row as usize] == NONE).collect();
        for _ in 0..3 {
            let mut waiting = Vec::new();
            // Rows can outbid each other by ever less; searches finish what is left.
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
                    // Without an alternative there is no bid to make.
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
                self.of_row[row as usize] = edge as u32;
                if owner != NONE {
                    self.of_row[owner as usize] = NONE;
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
        // The nearest free column so far: what is farther need not be looked at.
        let mut bound = f64::INFINITY;
        let free = loop {
            for e in graph.range(row) {
                let column = graph.columns[e] as usize;
                let d = base + self.offered(graph, e);
                if d < bound && d < self.at[column].distance && !self.at[column].done {
                    if self.at[column].distance.is_infinite() {
                        touched.push(column);
                    }
                    self.at[column].distance = d;
                    self.came_by[column] = (row as u32, e as u32);
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
            base = self.at[column].distance - self.paid(graph, row);
        };
        if let Some(mut column) = free {
            let length = self.at[column].distance;
            for &c in &scanned {
                self.at[c].potential += self.at[c].distance - length;
            }
            loop {
                let (row, e) = self.came_by[column];
                let left = std::mem::replace(&mut self.of_row[row as usize], e);
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

    /// A column that stays free must have potential 0, or taking it would be cheaper. A search against the direction of
    /// alternating paths finds the column that is given up for it, which may be itself.
    fn raise_free_columns(&mut self, graph: &Graph) {
        let low = |c: &usize| self.at[*c].row == NONE && self.at[*c].potential < 0.0;
        // What is given up for one of them has potential 0: it does not join them.
        let low: Vec<usize> = (0..self.at.len()).filter(low).collect();
        if !low.is_empty() {
            let into = Into::new(graph, self.at.len());
            low.into_iter().for_each(|column| self.raise(graph, &into, column));
        }
    }

    fn raise(&mut self, graph: &Graph, into: &Into, start: usize) {
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
            for &(row, e) in into.range(column) {
                let had = graph.columns[self.of_row[row as usize] as usize] as usize;
                let d = d + self.offered(graph, e as usize) - self.paid(graph, row as usize);
                if !self.at[had].done && d < self.at[had].distance && d < best.0 {
                    if self.at[had].distance.is_infinite() {
                        touched.push(had);
                    }
                    self.at[had].distance = d;
                    self.came_by[had] = (row, e);
                    heap.push(Reverse(Distance(d, false, had as u32)));
                }
            }
        }
        for &c in &scanned {
            let more = (best.0 - self.at[c].distance).max(0.0);
            self.at[c].potential = (self.at[c].potential + more).min(0.0);
        }
        // Rows along the path move on towards the column that was free.
        let mut column = best.1;
        self.at[column].potential = 0.0;
        self.at[column].row = NONE;
        while column != start {
            let (row, e) = self.came_by[column];
            self.of_row[row as usize] = e;
            column = graph.columns[e as usize] as usize;
            self.at[column].row = row;
        }
        for c in touched {
            self.at[c].distance = f64::INFINITY;
            self.at[c].done = false;
        }
    }
}

/// The edges that take part, by column: their rows and numbers.
struct Into {
    starts: Vec<u32>,
    edges: Vec<(u32, u32)>,
}

impl Into {
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
        Into { starts, edges: sorted }
    }

    fn range(&self, column: usize) -> &[(u32, u32)] {
        &self.edges[self.starts[column] as usize..self.starts[column + 1] as usize]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Knuth's linear congruences, from 0 to 1.
    fn congruences(mut state: u64) -> impl FnMut() -> f64 {
        move || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (state >> 11) as f64 / (1u64 << 53) as f64
        }
    }

    /// Costs of an assignment, by row.
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
            // Every third time costs that are often equal, which bids decide by epsilon alone.
            let (n, levels) = (MANY + case, if case % 3 == 0 { 4.0 } else { 1e9 });
            let mut graph = Graph::default();
            for row in 0..n {
                // A ring, so that all columns can be taken, and edges to others.
                let mut columns = std::collections::BTreeSet::from([row, (row + 1) % n]);
                (0..case % 7).for_each(|_| _ = columns.insert((random() * n as f64) as usize));
                columns.into_iter().for_each(|c| graph.push(c as u32, (random() * levels).floor() / levels));
                graph.end_row();
            }
            let mut searched = Cheapest::new(&graph, n);
            (0..n).for_each(|row| searched.search(&graph, row));
            let least: f64 = (0..n).map(|row| graph.costs[searched.of_row[row] as usize]).sum();

            let mut auctioned = Cheapest::new(&graph, n);
            auctioned.auction(&graph);
            for row in (0..n).filter(|&row| auctioned.of_row[row] != NONE) {
                assert_eq!(auctioned.paid(&graph, row), auctioned.two_cheapest(&graph, row)[0].0);
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
                // Columns that all rows want, so that cheap edges are not enough.
                (0..70).for_each(|column| graph.push(column, random() + 0.03 * f64::from(column)));
                // Rows may stay alone, which half of the time some of them prefer.
                graph.push(70 + row, if case % 2 == 0 { 5.0 } else { 0.4 });
                graph.end_row();
            }
            // One shortest path after another, on all edges.
            let mut whole = Cheapest::new(&graph, 130);
            (0..60).for_each(|row| whole.search(&graph, row));
            let least: f64 = whole.of_row.iter().map(|e| graph.costs[*e as usize]).sum();
            let alone: Vec<u32> = (70..130).collect();
            let of_row = cheapest_cover(graph.clone(), 130, &alone);
            let sum = sum(&graph, &of_row);
            assert!((sum - least).abs() < 1e-9, "{sum} {least}");
            let used: std::collections::BTreeSet<u32> = of_row.iter().copied().collect();
            assert_eq!(used.len(), 60);
        }
    }
}
