//! Pairs of nearby true and result points of one frame, found with a cell grid.

use super::gate::Gate;
use super::track_set::Point;

/// A pair of nearby points: indices within the frame, and squared distance.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct NeighborPair {
    /// Index of the true point.
    pub truth: u32,
    /// Index of the result point.
    pub result: u32,
    /// Squared distance D^2 in units of the gate.
    pub squared: f64,
}

/// A grid of cells over the bounding box of points; cells are at least as wide as the search radius.
#[derive(Debug)]
pub struct CellGrid<'a> {
    points: &'a [Point],
    x0: f64,
    y0: f64,
    cell: f64,
    columns: usize,
    rows: usize,
    order: Vec<u32>,
    starts: Vec<u32>,
}

impl<'a> CellGrid<'a> {
    /// A grid for searches within a radius of `reach`, px.
    pub fn new(points: &'a [Point], reach: f64) -> Self {
        let bounds = |value: fn(&Point) -> f64| {
            points.iter().map(value).fold((f64::INFINITY, f64::NEG_INFINITY), |b, v| (b.0.min(v), b.1.max(v)))
        };
        let ((x0, x1), (y0, y1)) = (bounds(|p| p.at.x_px), bounds(|p| p.at.y_px));
        let (mut cell, mut columns, mut rows) = (reach, 1, 1);
        if !points.is_empty() {
            // At most about four cells per point, so that a few points far apart do not need much memory.
            let size = |cell: f64| (((x1 - x0) / cell).floor() + 1.0, ((y1 - y0) / cell).floor() + 1.0);
            while size(cell).0 * size(cell).1 > 4.0 * points.len() as f64 + 16.0 {
                cell *= 2.0;
            }
            (columns, rows) = (size(cell).0 as usize, size(cell).1 as usize);
        }
        let mut grid =
            CellGrid { points, x0, y0, cell, columns, rows, order: Vec::new(), starts: Vec::new() };
        grid.starts = vec![0u32; columns * rows + 1];
        let cells: Vec<u32> = points.iter().map(|p| grid.cell_of(p) as u32).collect();
        cells.iter().for_each(|&c| grid.starts[c as usize + 1] += 1);
        for i in 0..columns * rows {
            grid.starts[i + 1] += grid.starts[i];
        }
        grid.order = vec![0; points.len()];
        let mut next = grid.starts.clone();
        for (i, &c) in cells.iter().enumerate() {
            grid.order[next[c as usize] as usize] = i as u32;
            next[c as usize] += 1;
        }
        grid
    }

    fn cell_of(&self, p: &Point) -> usize {
        let side = |v: f64, v0: f64, n: usize| (((v - v0) / self.cell) as usize).min(n - 1);
        side(p.at.y_px, self.y0, self.rows) * self.columns + side(p.at.x_px, self.x0, self.columns)
    }

    /// Calls `found` with the index of every point in the cells around `p`: at least all points within the
    /// reach.
    pub fn around(&self, p: &Point, mut found: impl FnMut(u32)) {
        let side = |v: f64, v0: f64, n: usize| {
            let at = (v - v0) / self.cell;
            // Positions just outside the grid may be within reach of its border cells.
            (at > -1.000_001 && at < n as f64 + 1.000_001).then(|| {
                let at = at.floor();
                ((at - 1.0).max(0.0) as usize, ((at + 1.0).max(0.0) as usize).min(n - 1))
            })
        };
        let (Some((c0, c1)), Some((r0, r1))) =
            (side(p.at.x_px, self.x0, self.columns), side(p.at.y_px, self.y0, self.rows))
        else {
            return;
        };
        for row in r0..=r1 {
            if c0 <= c1 {
                let (from, to) = (row * self.columns + c0, row * self.columns + c1 + 1);
                self.order[self.starts[from] as usize..self.starts[to] as usize]
                    .iter()
                    .for_each(|&i| found(i));
            }
        }
    }

    /// Distance in the image plane to the nearest other point, px; `None` if none is within the reach.
    pub fn nearest_other(&self, index: usize, reach: f64) -> Option<f64> {
        let p = &self.points[index];
        let mut best = reach * reach;
        let mut any = false;
        self.around(p, |i| {
            let q = &self.points[i as usize];
            let squared = (q.at.x_px - p.at.x_px).powi(2) + (q.at.y_px - p.at.y_px).powi(2);
            if i as usize != index && squared <= best {
                (best, any) = (squared, true);
            }
        });
        any.then(|| best.sqrt())
    }
}

/// Maximum number of pairs per frame; a search that exceeds it stops, and the caller must report an error.
pub const MAX_PAIRS: usize = 20_000_000;

/// All pairs with D < `reach` in units of the gate (for 1, those that the gate admits), sorted by true, then
/// result point.
pub fn neighbor_pairs(truth: &[Point], result: &[Point], gate: &Gate, reach: f64) -> Vec<NeighborPair> {
    let mut pairs = Vec::new();
    if truth.is_empty() || result.is_empty() {
        return pairs;
    }
    let grid = CellGrid::new(result, gate.xy_px * reach * (1.0 + 1e-9));
    for (t, p) in truth.iter().enumerate() {
        let first = pairs.len();
        grid.around(p, |r| {
            let squared = gate.squared(&p.at, &result[r as usize].at);
            let inside = if reach == 1.0 { gate.admits(squared) } else { squared < reach * reach };
            if inside {
                pairs.push(NeighborPair { truth: t as u32, result: r, squared });
            }
        });
        pairs[first..].sort_unstable_by_key(|n| n.result);
        if pairs.len() > MAX_PAIRS {
            break;
        }
    }
    pairs
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::evaluate::track_set::Position;
    use proptest::prelude::*;

    fn points(at: &[(f64, f64)]) -> Vec<Point> {
        at.iter()
            .map(|&(x_px, y_px)| Point {
                frame: 0,
                track: 0,
                source: 0,
                at: Position { x_px, y_px, z_um: 0.0 },
            })
            .collect()
    }

    proptest! {
        #[test]
        fn the_grid_finds_what_a_search_of_all_pairs_finds(
            truth in prop::collection::vec((0.0..40.0f64, 0.0..30.0f64), 0..40),
            result in prop::collection::vec((-5.0..45.0f64, -5.0..300.0f64), 0..40),
            reach in prop::sample::select(vec![1.0, 2.0]),
        ) {
            let (truth, result, gate) = (points(&truth), points(&result), Gate::radial(3.0));
            let mut expected = Vec::new();
            for (t, a) in truth.iter().enumerate() {
                for (r, b) in result.iter().enumerate() {
                    let squared = gate.squared(&a.at, &b.at);
                    if squared < reach * reach {
                        expected.push(NeighborPair { truth: t as u32, result: r as u32, squared });
                    }
                }
            }
            prop_assert_eq!(neighbor_pairs(&truth, &result, &gate, reach), expected);
        }
    }
}
