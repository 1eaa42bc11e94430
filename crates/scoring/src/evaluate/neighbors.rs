//! Pairs of nearby true and result points of one frame, found with a cell grid.

use numeric::cell_grid::CellGrid;

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

/// Maximum number of pairs per frame; a search that exceeds it stops, and the caller must report an error.
pub const MAX_PAIRS: usize = 20_000_000;

/// All pairs with D < `reach` in units of the gate (for 1, those that the gate admits), sorted by true, then
/// result point.
pub fn neighbor_pairs(truth: &[Point], result: &[Point], gate: &Gate, reach: f64) -> Vec<NeighborPair> {
    let mut pairs = Vec::new();
    if truth.is_empty() || result.is_empty() {
        return pairs;
    }
    let places: Vec<[f64; 2]> = result.iter().map(Point::in_plane).collect();
    let grid = CellGrid::new(&places, gate.xy_px * reach * (1.0 + 1e-9));
    for (t, p) in truth.iter().enumerate() {
        let first = pairs.len();
        grid.around(p.in_plane(), |r| {
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
