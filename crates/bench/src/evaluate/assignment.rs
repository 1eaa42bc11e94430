//! One-to-one assignment of points or tracks, on sparse graphs (primitive A1 of docs/scoring.md).
//!
//! A graph of admissible pairs falls into components. In each, a maximum matching (Hopcroft and Karp, 1973) splits the
//! vertices by Dulmage and Mendelsohn into a part with rows to spare, a part with columns to spare and a part without:
//! no maximum matching has an edge between them, and in each part one side is matched whole. The cheapest matching that
//! covers this side grows by shortest augmenting paths with potentials (Jonker and Volgenant, 1987; Dijkstra on a heap), on
//! the edges that matter.
//! Own code, since crates solve dense matrices only: 50,000 points of a frame would need 20 GB.

use std::cmp::{Ordering, Reverse};
use std::collections::{BinaryHeap, VecDeque};

/// An admissible pair.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pair {
    /// Row.
    pub row: u32,
    /// Column.
    pub column: u32,
    /// Cost or weight, finite.
    pub value: f64,
}

const NONE: u32 = u32::MAX;

/// The matching with as many pairs as possible and, among those, the least sum of costs. Pairs must be sorted by row,
/// then column, without repetition; the result is sorted by row.
pub fn most_then_cheapest(rows: usize, columns: usize, pairs: &[Pair]) -> Vec<Pair> {
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

/// The matching of the greatest sum of weights; pairs without positive weight are never chosen. Pairs must be sorted by
/// row, then column, without repetition; the result is sorted by row.
pub fn heaviest(rows: usize, columns: usize, pairs: &[Pair]) -> Vec<Pair> {
    let useful: Vec<Pair> = pairs.iter().copied().filter(|p| p.value > 0.0).collect();
    let mut chosen = Vec::with_capacity(rows.min(columns));
    for component in components(rows, columns, &useful) {
        if let [only] = component.as_slice() {
            chosen.push(*only);
            continue;
        }
        let local = Local::new(&component, false);
        // With equal weights only the number of pairs matters, and searches by weight would wander among ties.
        if component.iter().all(|p| p.value == component[0].value) {
            let (of_row, _) = maximum_matching(&local, &component);
            chosen.extend(local.pairs(&of_row).map(|e| component[e]));
            continue;
        }
        // A column of its own, at no cost, lets every row stay without a partner.
        let mut graph = Graph::default();
        for row in 0..local.rows() {
            for edge in local.range(row) {
                graph.push(local.columns_of[edge], -component[edge].value);
            }
            graph.push((local.n_columns + row) as u32, 0.0);
            graph.end_row();
        }
        let alone: Vec<u32> = graph.ends.iter().map(|end| end - 1).collect();
        let of_row = cheapest_cover(&graph, local.n_columns + local.rows(), &alone);
        chosen.extend(local.pairs(&of_row).map(|e| component[e]));
    }
    chosen.sort_unstable_by_key(|p| p.row);
    chosen
}

/// Groups of pairs that share rows or columns, each sorted by row, then column.
fn components(rows: usize, columns: usize, pairs: &[Pair]) -> Vec<Vec<Pair>> {
    let mut parent: Vec<u32> = (0..(rows + columns) as u32).collect();
    fn root(parent: &mut [u32], mut v: u32) -> u32 {
        while parent[v as usize] != v {
            parent[v as usize] = parent[parent[v as usize] as usize];
            v = parent[v as usize];
        }
        v
    }
    for p in pairs {
        let (a, b) = (root(&mut parent, p.row), root(&mut parent, rows as u32 + p.column));
        parent[a.max(b) as usize] = a.min(b);
    }
    let mut group_of = vec![NONE; rows + columns];
    let mut groups: Vec<Vec<Pair>> = Vec::new();
    for p in pairs {
        let root = root(&mut parent, p.row) as usize;
        if group_of[root] == NONE {
            group_of[root] = groups.len() as u32;
            groups.push(Vec::new());
        }
        groups[group_of[root] as usize].push(*p);
    }
    groups
}

/// A component with its rows (or columns) numbered from 0.
struct Local {
    starts: Vec<u32>,
    columns_of: Vec<u32>,
    edges: Vec<u32>,
    n_columns: usize,
}

impl Local {
    /// Of a component, by rows or, transposed, by columns.
    fn new(component: &[Pair], transposed: bool) -> Self {
        let ends = |p: &Pair| if transposed { (p.column, p.row) } else { (p.row, p.column) };
        let mut edges: Vec<u32> = (0..component.len() as u32).collect();
        edges.sort_unstable_by_key(|&e| ends(&component[e as usize]));
        let mut names: Vec<u32> = component.iter().map(|p| ends(p).1).collect();
        names.sort_unstable();
        names.dedup();
        let mut starts = vec![];
        let mut before = None;
        for (i, &e) in edges.iter().enumerate() {
            let row = ends(&component[e as usize]).0;
            if before != Some(row) {
                starts.push(i as u32);
                before = Some(row);
            }
        }
        starts.push(edges.len() as u32);
        let columns_of = edges
            .iter()
            .map(|&e| names.partition_point(|&n| n < ends(&component[e as usize]).1) as u32)
            .collect();
        Local { starts, columns_of, edges, n_columns: names.len() }
    }

    fn rows(&self) -> usize {
        self.starts.len() - 1
    }

    fn range(&self, row: usize) -> std::ops::Range<usize> {
        self.starts[row] as usize..self.starts[row + 1] as usize
    }

    /// The edges (of a component by rows) that join rows to these columns; rows without one of theirs are left out.
    fn pairs<'a>(&'a self, of_row: &'a [u32]) -> impl Iterator<Item = usize> + 'a {
        of_row
            .iter()
            .enumerate()
            .filter_map(|(row, column)| self.range(row).find(|&e| self.columns_of[e] == *column))
    }
}

/// Rows and their edges.
#[derive(Default)]
struct Graph {
    ends: Vec<u32>,
    columns: Vec<u32>,
    costs: Vec<f64>,
}

impl Graph {
    fn push(&mut self, column: u32, cost: f64) {
        self.columns.push(column);
        self.costs.push(cost);
    }

    fn end_row(&mut self) {
        self.ends.push(self.columns.len() as u32);
    }

    fn range(&self, row: usize) -> std::ops::Range<usize> {
        (if row == 0 { 0 } else { self.ends[row - 1] as usize })..self.ends[row] as usize
    }
}

fn solve_cardinality(component: &[Pair], chosen: &mut Vec<Pair>) {
    let forward = Local::new(component, false);
    let backward = Local::new(component, true);
    let (row_mate, column_mate) = maximum_matching(&forward, component);
    // What an alternating path from a free row reaches has rows to spare; likewise from a free column.
    let spare_rows = reached(&forward, &row_mate, &column_mate);
    let spare_columns = reached(&backward, &column_mate, &row_mate);
    // (rows of the part that is covered whole, whether they are columns of the component)
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
                if local.columns_of[e] == mate[row] {
                    cover.push(graph.costs.len() as u32);
                }
                graph.push(local.columns_of[e], component[local.edges[e] as usize].value);
            }
            graph.end_row();
            rows.push(row);
        }
        let of_row = cheapest_cover(&graph, local.n_columns, &cover);
        for (&row, &column) in rows.iter().zip(&of_row) {
            let edge = local.range(row).find(|&e| local.columns_of[e] == column);
            chosen.extend(edge.map(|e| component[local.edges[e] as usize]));
        }
    }
}

/// Rows and columns on alternating paths from free rows.
fn reached(local: &Local, row_mate: &[u32], column_mate: &[u32]) -> (Vec<bool>, Vec<bool>) {
    let (mut rows, mut columns) = (vec![false; local.rows()], vec![false; local.n_columns]);
    let mut queue: Vec<usize> = (0..local.rows()).filter(|&r| row_mate[r] == NONE).collect();
    queue.iter().for_each(|&r| rows[r] = true);
    while let Some(row) = queue.pop() {
        for e in local.range(row) {
            let column = local.columns_of[e] as usize;
            if !columns[column] {
                columns[column] = true;
                // In a maximum matching no free column is reached.
                let mate = column_mate[column];
                if mate != NONE && !rows[mate as usize] {
                    rows[mate as usize] = true;
                    queue.push(mate as usize);
                }
            }
        }
    }
    (rows, columns)
}

/// A matching with as many pairs as possible: the mate of every row and of every column. Rows take their cheapest free
/// column first, so that little is left to do.
fn maximum_matching(local: &Local, component: &[Pair]) -> (Vec<u32>, Vec<u32>) {
    let (mut row_mate, mut column_mate) = (vec![NONE; local.rows()], vec![NONE; local.n_columns]);
    for (row, mate) in row_mate.iter_mut().enumerate() {
        let free = local.range(row).filter(|&e| column_mate[local.columns_of[e] as usize] == NONE);
        let value = |e: usize| component[local.edges[e] as usize].value;
        if let Some(e) = free.min_by(|&a, &b| value(a).total_cmp(&value(b))) {
            *mate = local.columns_of[e];
            column_mate[local.columns_of[e] as usize] = row as u32;
        }
    }
    loop {
        // Breadth first: the length of the shortest alternating path to every row.
        let mut depth = vec![NONE; local.rows()];
        let mut queue: VecDeque<u32> =
            (0..local.rows() as u32).filter(|&r| row_mate[r as usize] == NONE).collect();
        queue.iter().for_each(|&r| depth[r as usize] = 0);
        let mut augmentable = false;
        while let Some(row) = queue.pop_front() {
            for e in local.range(row as usize) {
                let mate = column_mate[local.columns_of[e] as usize];
                if mate == NONE {
                    augmentable = true;
                } else if depth[mate as usize] == NONE {
                    depth[mate as usize] = depth[row as usize] + 1;
                    queue.push_back(mate);
                }
            }
        }
        if !augmentable {
            return (row_mate, column_mate);
        }
        // Depth first along these layers, with a stack of its own: paths can be as long as the component.
        let mut next: Vec<u32> = (0..local.rows()).map(|r| local.range(r).start as u32).collect();
        for start in 0..local.rows() {
            if row_mate[start] != NONE {
                continue;
            }
            let mut path = vec![start];
            while let Some(&row) = path.last() {
                if next[row] as usize == local.range(row).end {
                    path.pop();
                    continue;
                }
                let column = local.columns_of[next[row] as usize] as usize;
                next[row] += 1;
                let mate = column_mate[column];
                if mate == NONE {
                    // Each row of the path takes the column that it was left by.
                    for &row in &path {
                        let column = local.columns_of[next[row] as usize - 1];
                        row_mate[row] = column;
                        column_mate[column as usize] = row as u32;
                    }
                    break;
                }
                if depth[mate as usize] == depth[row] + 1 {
                    path.push(mate as usize);
                }
            }
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

/// Jonker and Volgenant's augmenting row reduction: a row takes its cheapest column, bidding the difference to its second
/// cheapest, from whoever had it. It leaves few rows to the searches for shortest paths.
fn reduce_rows(graph: &Graph, potential: &mut [f64], of_column: &mut [u32], of_row: &mut [u32]) {
    let rows = graph.ends.len();
    let mut free: Vec<u32> = (0..rows as u32).rev().collect();
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
            let (mut first, mut second) = ((f64::INFINITY, usize::MAX), (f64::INFINITY, usize::MAX));
            for e in graph.range(row as usize) {
                let cost = graph.costs[e] - potential[graph.columns[e] as usize];
                if cost < first.0 {
                    (second, first) = (first, (cost, e));
                } else if cost < second.0 {
                    second = (cost, e);
                }
            }
            let mut edge = first.1;
            let owner = of_column[graph.columns[edge] as usize];
            let better = first.0 < second.0;
            if second.1 == usize::MAX {
                // Without an alternative there is no bid to make.
                if owner != NONE {
                    waiting.push(row);
                    continue;
                }
            } else if better {
                potential[graph.columns[edge] as usize] -= second.0 - first.0;
            } else if owner != NONE {
                edge = second.1;
            }
            let column = graph.columns[edge] as usize;
            let owner = std::mem::replace(&mut of_column[column], row);
            of_row[row as usize] = edge as u32;
            if owner != NONE {
                of_row[owner as usize] = NONE;
                if better { free.push(owner) } else { waiting.push(owner) }
            }
        }
        waiting.reverse();
        free = waiting;
    }
}

/// Edges of each row that a dense graph is solved with first.
const CORE: usize = 12;

/// The column of every row in the cheapest matching that covers all rows, of which one, `cover`, is known by its edges.
///
/// Of a dense graph hardly any edges matter: it is solved with the cheapest of each row, and again with those added that
/// the potentials show to be cheaper, until there are none. The result is the cheapest of the whole graph then.
fn cheapest_cover(graph: &Graph, columns: usize, cover: &[u32]) -> Vec<u32> {
    let rows = graph.ends.len();
    if graph.costs.len() <= 2 * CORE * rows {
        return solved(graph, columns).0.into_iter().map(|e| graph.columns[e as usize]).collect();
    }
    let mut in_core = vec![false; graph.costs.len()];
    cover.iter().for_each(|&e| in_core[e as usize] = true);
    let mut order: Vec<usize> = Vec::new();
    for row in 0..rows {
        order.clear();
        order.extend(graph.range(row));
        let cheaper = |a: &usize, b: &usize| graph.costs[*a].total_cmp(&graph.costs[*b]).then(a.cmp(b));
        if order.len() > CORE {
            order.select_nth_unstable_by(CORE, cheaper);
            order.truncate(CORE);
        }
        order.iter().for_each(|&e| in_core[e] = true);
    }
    // Sums of a path's costs round by less than this.
    let rounding = 1e-12 * graph.costs.iter().fold(0.0f64, |most, c| most.max(c.abs()));
    loop {
        let mut core = Graph::default();
        for row in 0..rows {
            for e in graph.range(row).filter(|&e| in_core[e]) {
                core.push(graph.columns[e], graph.costs[e]);
            }
            core.end_row();
        }
        let (of_row, potential) = solved(&core, columns);
        let mut complete = true;
        for (row, &e) in of_row.iter().enumerate() {
            let paid = core.costs[e as usize] - potential[core.columns[e as usize] as usize];
            for e in graph.range(row) {
                let offered = graph.costs[e] - potential[graph.columns[e] as usize];
                if offered < paid - rounding && !in_core[e] {
                    in_core[e] = true;
                    complete = false;
                }
            }
        }
        if complete {
            return of_row.into_iter().map(|e| core.columns[e as usize]).collect();
        }
    }
}

/// The edge of every row in the cheapest matching that covers all rows, which must exist, and the columns' potentials.
fn solved(graph: &Graph, columns: usize) -> (Vec<u32>, Vec<f64>) {
    let rows = graph.ends.len();
    let mut potential = vec![0.0f64; columns];
    let mut of_column = vec![NONE; columns];
    // The edge of each row that is matched.
    let mut of_row = vec![NONE; rows];
    reduce_rows(graph, &mut potential, &mut of_column, &mut of_row);
    let mut distance = vec![f64::INFINITY; columns];
    let mut came_by = vec![(NONE, NONE); columns];
    let mut done = vec![false; columns];
    for start in 0..rows {
        if of_row[start] != NONE {
            continue;
        }
        let (mut heap, mut touched, mut scanned) = (BinaryHeap::new(), Vec::new(), Vec::new());
        let (mut row, mut base) = (start, 0.0);
        let free = loop {
            for e in graph.range(row) {
                let column = graph.columns[e] as usize;
                let d = base + graph.costs[e] - potential[column];
                if !done[column] && d < distance[column] {
                    if distance[column].is_infinite() {
                        touched.push(column);
                    }
                    distance[column] = d;
                    came_by[column] = (row as u32, e as u32);
                    heap.push(Reverse(Distance(d, of_column[column] != NONE, column as u32)));
                }
            }
            let nearest = loop {
                match heap.pop() {
                    Some(Reverse(Distance(d, _, column)))
                        if !done[column as usize] && d == distance[column as usize] =>
                    {
                        break Some(column as usize);
                    }
                    Some(_) => {}
                    None => break None,
                }
            };
            let Some(column) = nearest else { break None };
            if of_column[column] == NONE {
                break Some(column);
            }
            done[column] = true;
            scanned.push(column);
            row = of_column[column] as usize;
            let e = of_row[row] as usize;
            base = distance[column] - (graph.costs[e] - potential[column]);
        };
        if let Some(mut column) = free {
            let length = distance[column];
            for &c in &scanned {
                potential[c] += distance[c] - length;
            }
            loop {
                let (row, e) = came_by[column];
                let left = of_row[row as usize];
                of_row[row as usize] = e;
                of_column[column] = row;
                if row as usize == start {
                    break;
                }
                column = graph.columns[left as usize] as usize;
            }
        }
        for c in touched {
            distance[c] = f64::INFINITY;
            done[c] = false;
        }
    }
    (of_row, potential)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// All matchings by brute force: (most pairs, their least cost) and the greatest weight.
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
            let chosen = most_then_cheapest(rows, columns, &pairs);
            let sum = |chosen: &[Pair]| chosen.iter().map(|p| p.value).sum::<f64>();
            prop_assert_eq!(chosen.len(), most);
            // Sums of six numbers below 1.
            prop_assert!((sum(&chosen) - least).abs() < 1e-12);
            let heavy = heaviest(rows, columns, &pairs);
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
    fn dense_graphs_are_solved_as_well_as_sparse_ones() {
        // 60 x 70 edges are more than the core's; without it the whole graph is solved at once.
        let mut state = 1u64;
        let mut random = || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (state >> 11) as f64 / (1u64 << 53) as f64
        };
        for _ in 0..50 {
            let mut graph = Graph::default();
            for row in 0..60 {
                // Columns that all rows want, so that cheap edges are not enough.
                (0..70).for_each(|column| graph.push(column, random() + 0.03 * f64::from(column)));
                graph.push(70 + row, 5.0);
                graph.end_row();
            }
            let alone: Vec<u32> = graph.ends.iter().map(|end| end - 1).collect();
            let cost = |row: usize, column: u32| {
                graph.range(row).find(|&e| graph.columns[e] == column).map(|e| graph.costs[e]).unwrap()
            };
            let sum: f64 =
                cheapest_cover(&graph, 130, &alone).iter().enumerate().map(|(r, c)| cost(r, *c)).sum();
            let whole: f64 = solved(&graph, 130).0.iter().map(|e| graph.costs[*e as usize]).sum();
            assert!((sum - whole).abs() < 1e-9, "{sum} {whole}");
        }
    }

    #[test]
    fn two_mediocre_pairs_beat_one_good_one() {
        let pair = |row, column, value| Pair { row, column, value };
        let pairs = [pair(0, 0, 0.5), pair(1, 0, 0.1), pair(1, 1, 0.6)];
        assert_eq!(most_then_cheapest(2, 2, &pairs), [pairs[0], pairs[2]]);
    }
}
