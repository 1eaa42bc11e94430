//! Maximum-cardinality matchings (Hopcroft and Karp, 1973), and the vertices reachable from unmatched ones.

use std::collections::VecDeque;

use super::{Local, NONE, Pair};

/// Flags the rows and columns that lie on alternating paths from unmatched rows.
pub(super) fn reached(local: &Local, row_mate: &[u32], column_mate: &[u32]) -> (Vec<bool>, Vec<bool>) {
    let (mut rows, mut columns) = (vec![false; local.rows()], vec![false; local.n_columns]);
    let mut queue: Vec<usize> = (0..local.rows()).filter(|&r| row_mate[r] == NONE).collect();
    queue.iter().for_each(|&r| rows[r] = true);
    while let Some(row) = queue.pop() {
        for e in local.range(row) {
            let column = local.columns_of[e] as usize;
            if !columns[column] {
                columns[column] = true;
                // A maximum matching has no alternating path to an unmatched column.
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

/// A maximum-cardinality matching: the mate of every row and of every column, or `NONE`. A greedy matching by
/// cost comes first, so that few augmenting paths remain.
pub(super) fn maximum_matching(local: &Local, component: &[Pair]) -> (Vec<u32>, Vec<u32>) {
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
        // Breadth-first search: length of the shortest alternating path to every row.
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
        // Depth-first search along these layers, with an explicit stack: paths can be as long as the
        // component.
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
                    // Each row of the path takes the column through which the path left it.
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
