//! One-to-one assignment of points or tracks on sparse bipartite graphs (assignment A1 of docs/scoring.md).
//!
//! The graph of admissible pairs is split into connected components. In each, a maximum matching gives the
//! Dulmage-Mendelsohn decomposition into a part with surplus rows, a part with surplus columns and a square
//! part (`cardinality.rs`). No maximum matching has an edge between parts, and in each part one side is
//! matched completely, at minimum cost (`min_cost.rs`; in the square part after an auction, `auction.rs`).
//! Published crates solve dense matrices only: 50,000 points in a frame would need 20 GB.

mod auction;
mod cardinality;
mod min_cost;

use cardinality::{maximum_matching, reached};
use min_cost::{Graph, cheapest_cover};

/// An admissible pair.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pair {
    /// Row, from 0.
    pub row: u32,
    /// Column, from 0.
    pub column: u32,
    /// Cost or weight, finite.
    pub value: f64,
}

const NONE: u32 = u32::MAX;

/// The matching with the most pairs and, among those, the least total cost. `pairs` must be sorted by row,
/// then column, without duplicates; the result is sorted by row.
pub fn max_cardinality_min_cost(rows: usize, columns: usize, pairs: Vec<Pair>) -> Vec<Pair> {
    let mut chosen = Vec::with_capacity(rows.min(columns));
    for component in components(rows, columns, pairs) {
        match component.as_slice() {
            [only] => chosen.push(*only),
            several => solve_cardinality(several, &mut chosen),
        }
    }
    chosen.sort_unstable_by_key(|p| p.row);
    chosen
}

/// The matching of maximum total weight; pairs without a positive weight are never chosen. `pairs` must be
/// sorted by row, then column, without duplicates; the result is sorted by row.
pub fn max_weight_matching(rows: usize, columns: usize, mut pairs: Vec<Pair>) -> Vec<Pair> {
    pairs.retain(|p| p.value > 0.0);
    let mut chosen = Vec::with_capacity(rows.min(columns));
    for component in components(rows, columns, pairs) {
        if let [only] = component.as_slice() {
            chosen.push(*only);
            continue;
        }
        let local = Local::new(&component);
        // With equal weights only the number of pairs matters, and a search by weight would be slowed down by
        // ties.
        if component.iter().all(|p| p.value == component[0].value) {
            let (of_row, _) = maximum_matching(&local, &component);
            chosen.extend(local.pairs(&of_row).map(|e| component[e]));
            continue;
        }
        // A private column at no cost lets a row stay unmatched.
        let alone: Vec<u32> = (0..local.rows()).map(|row| (local.n_columns + row) as u32).collect();
        let mut graph = Graph::default();
        for (row, &alone) in alone.iter().enumerate() {
            for edge in local.range(row) {
                graph.push(local.columns_of[edge], -component[edge].value);
            }
            graph.push(alone, 0.0);
            graph.end_row();
        }
        let of_row = cheapest_cover(graph, local.n_columns + local.rows(), &alone);
        chosen.extend(local.pairs(&of_row).map(|e| component[e]));
    }
    chosen.sort_unstable_by_key(|p| p.row);
    chosen
}

/// Connected components: groups of pairs that share rows or columns, each sorted by row, then column.
fn components(rows: usize, columns: usize, pairs: Vec<Pair>) -> Vec<Vec<Pair>> {
    let mut parent: Vec<u32> = (0..(rows + columns) as u32).collect();
    fn root(parent: &mut [u32], mut v: u32) -> u32 {
        while parent[v as usize] != v {
            parent[v as usize] = parent[parent[v as usize] as usize];
            v = parent[v as usize];
        }
        v
    }
    for p in &pairs {
        let (a, b) = (root(&mut parent, p.row), root(&mut parent, rows as u32 + p.column));
        parent[a.max(b) as usize] = a.min(b);
    }
    // Dense graphs usually have one component; avoids copying it.
    let first = pairs.first().map(|p| root(&mut parent, p.row));
    if pairs.iter().all(|p| Some(root(&mut parent, p.row)) == first) {
        return if pairs.is_empty() { Vec::new() } else { vec![pairs] };
    }
    let mut group_of = vec![NONE; rows + columns];
    let mut groups: Vec<Vec<Pair>> = Vec::new();
    for p in pairs {
        let root = root(&mut parent, p.row) as usize;
        if group_of[root] == NONE {
            group_of[root] = groups.len() as u32;
            groups.push(Vec::new());
        }
        groups[group_of[root] as usize].push(p);
    }
    groups
}

/// A component with its rows (or columns) numbered from 0.
struct Local {
    starts: Vec<u32>,
    columns_of: Vec<u32>,
    /// Index of each edge's pair in the component.
    edges: Vec<u32>,
    n_columns: usize,
}

impl Local {
    /// A component's adjacency by rows.
    fn new(component: &[Pair]) -> Self {
        let mut names: Vec<u32> = component.iter().map(|p| p.column).collect();
        names.sort_unstable();
        names.dedup();
        // A lookup table if it is not much larger than the component, otherwise binary search.
        let span = names.last().map_or(0, |last| (last - names[0] + 1) as usize);
        let mut table = vec![NONE; if span <= 8 * component.len() { span } else { 0 }];
        if !table.is_empty() {
            names.iter().enumerate().for_each(|(i, name)| table[(name - names[0]) as usize] = i as u32);
        }
        let local = |name: u32| match table.get((name - names[0]) as usize) {
            Some(i) => *i,
            None => names.partition_point(|&n| n < name) as u32,
        };
        let mut starts = Vec::new();
        let mut before = None;
        for (i, p) in component.iter().enumerate() {
            if before != Some(p.row) {
                starts.push(i as u32);
                before = Some(p.row);
            }
        }
        starts.push(component.len() as u32);
        let columns_of = component.iter().map(|p| local(p.column)).collect();
        Local { starts, columns_of, edges: (0..component.len() as u32).collect(), n_columns: names.len() }
    }

    /// The same graph by columns.
    fn transposed(&self) -> Self {
        let mut starts = vec![0u32; self.n_columns + 1];
        self.columns_of.iter().for_each(|&c| starts[c as usize + 1] += 1);
        (0..self.n_columns).for_each(|c| starts[c + 1] += starts[c]);
        let mut next = starts.clone();
        let (mut columns_of, mut edges) = (vec![0; self.edges.len()], vec![0; self.edges.len()]);
        for row in 0..self.rows() {
            for e in self.range(row) {
                let at = &mut next[self.columns_of[e] as usize];
                (columns_of[*at as usize], edges[*at as usize]) = (row as u32, self.edges[e]);
                *at += 1;
            }
        }
        Local { starts, columns_of, edges, n_columns: self.rows() }
    }

    fn rows(&self) -> usize {
        self.starts.len() - 1
    }

    fn range(&self, row: usize) -> std::ops::Range<usize> {
        self.starts[row] as usize..self.starts[row + 1] as usize
    }

    /// The edges that join each row to its column in `of_row`; rows without such an edge are skipped.
    fn pairs<'a>(&'a self, of_row: &'a [u32]) -> impl Iterator<Item = usize> + 'a {
        of_row
            .iter()
            .enumerate()
            .filter_map(|(row, column)| self.range(row).find(|&e| self.columns_of[e] == *column))
    }
}

fn solve_cardinality(component: &[Pair], chosen: &mut Vec<Pair>) {
    let forward = Local::new(component);
    let backward = forward.transposed();
    let (row_mate, column_mate) = maximum_matching(&forward, component);
    // Alternating paths from unmatched rows reach the part with surplus rows, from unmatched columns that
    // with surplus columns.
    let spare_rows = reached(&forward, &row_mate, &column_mate);
    let spare_columns = reached(&backward, &column_mate, &row_mate);
    // (side of the part that is matched completely, whether that side is the component's columns)
    let parts: [(Vec<bool>, bool); 3] = [
        (spare_rows.1.clone(), true),
        (spare_columns.1.clone(), false),
        ((0..forward.rows()).map(|r| !spare_rows.0[r] && !spare_columns.1[r]).collect(), false),
    ];
    let sides = [&spare_rows.0, &spare_columns.0];
    for (part, (covered, transposed)) in parts.iter().enumerate() {
        let local = if *transposed { &backward } else { &forward };
        let inside = |other: usize| match part {
            2 => !sides[1][other] && !spare_rows.1[other],
            part => sides[part][other],
        };
        let mate = if *transposed { &column_mate } else { &row_mate };
        let mut graph = Graph::default();
        let (mut rows, mut cover) = (Vec::new(), Vec::new());
        for row in (0..local.rows()).filter(|&r| covered[r]) {
            for e in local.range(row).filter(|&e| inside(local.columns_of[e] as usize)) {
                graph.push(local.columns_of[e], component[local.edges[e] as usize].value);
            }
            graph.end_row();
            rows.push(row);
            cover.push(mate[row]);
        }
        let of_row = cheapest_cover(graph, local.n_columns, &cover);
        for (&row, &column) in rows.iter().zip(&of_row) {
            let edge = local.range(row).find(|&e| local.columns_of[e] == column);
            chosen.extend(edge.map(|e| component[local.edges[e] as usize]));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Brute force over all matchings: (most pairs, least cost among those) and the greatest weight.
    fn brute(rows: usize, pairs: &[Pair]) -> ((usize, f64), f64) {
        fn go(
            row: u32,
            rows: u32,
            used: u32,
            pairs: &[Pair],
            n: usize,
            sum: f64,
            best: &mut ((usize, f64), f64),
        ) {
            if row == rows {
                let (most, least) = best.0;
                if n > most || (n == most && sum < least) {
                    best.0 = (n, sum);
                }
                best.1 = best.1.max(sum);
                return;
            }
            go(row + 1, rows, used, pairs, n, sum, best);
            for p in pairs.iter().filter(|p| p.row == row && used & (1 << p.column) == 0) {
                go(row + 1, rows, used | (1 << p.column), pairs, n + 1, sum + p.value, best);
            }
        }
        let mut best = ((0, 0.0), 0.0);
        go(0, rows as u32, 0, pairs, 0, 0.0, &mut best);
        best
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(2000))]
        #[test]
        fn both_solvers_find_the_optimum(
            cells in prop::collection::vec(prop::option::weighted(0.4, 0.01..1.0f64), 36),
            rows in 1usize..=6,
        ) {
            let columns = 36 / 6;
            let pairs: Vec<Pair> = (0..rows * columns)
                .filter_map(|i| {
                    let value = cells[i]?;
                    Some(Pair { row: (i / columns) as u32, column: (i % columns) as u32, value })
                })
                .collect();
            let ((most, least), greatest) = brute(rows, &pairs);
            let chosen = max_cardinality_min_cost(rows, columns, pairs.clone());
            let sum = |chosen: &[Pair]| chosen.iter().map(|p| p.value).sum::<f64>();
            prop_assert_eq!(chosen.len(), most);
            // Rounding of sums of six numbers below 1.
            prop_assert!((sum(&chosen) - least).abs() < 1e-12);
            let heavy = max_weight_matching(rows, columns, pairs);
            prop_assert!((sum(&heavy) - greatest).abs() < 1e-12);
            for matching in [&chosen, &heavy] {
                let mut used: Vec<u32> = matching.iter().map(|p| p.column).collect();
                used.sort_unstable();
                used.dedup();
                prop_assert_eq!(used.len(), matching.len());
            }
        }
    }

    #[test]
    fn two_mediocre_pairs_beat_one_good_one() {
        let pair = |row, column, value| Pair { row, column, value };
        let pairs = [pair(0, 0, 0.5), pair(1, 0, 0.1), pair(1, 1, 0.6)];
        assert_eq!(max_cardinality_min_cost(2, 2, pairs.to_vec()), [pairs[0], pairs[2]]);
    }
}
