//! Matching of result points to particles in every frame: optimal (A1) or greedy (A2).

use rayon::prelude::*;

use super::gate::Gate;
use super::neighbors::{MAX_PAIRS, neighbor_pairs};
use super::track_set::{TrackSet, side_by_side};
use numeric::assignment::{Pair, max_cardinality_min_cost};
use storage::error::{Error, Result};

/// Marks a point without a match.
pub const NONE: u32 = u32::MAX;

/// A one-to-one matching of true and result points.
#[derive(Debug, Clone, PartialEq)]
pub struct Matching {
    /// Index of the result point matched to every true point, or [`NONE`].
    pub result_for: Vec<u32>,
    /// Index of the true point matched to every result point, or [`NONE`].
    pub truth_for: Vec<u32>,
}

impl Matching {
    fn empty(truth: &TrackSet, result: &TrackSet) -> Self {
        Matching { result_for: vec![NONE; truth.len()], truth_for: vec![NONE; result.len()] }
    }

    fn join(&mut self, truth: usize, result: usize) {
        self.result_for[truth] = result as u32;
        self.truth_for[result] = truth as u32;
    }

    /// The matched pairs: indices of the true and the result point, in the order of true points.
    pub fn pairs(&self) -> impl Iterator<Item = (usize, usize)> + '_ {
        self.result_for.iter().enumerate().filter(|(_, r)| **r != NONE).map(|(t, r)| (t, *r as usize))
    }
}

/// The cost that is minimized among the assignments with the most pairs.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Cost {
    /// The sum of squared distances, `lap-maxcard-d2`: microsig's own rule.
    Squares,
    /// The sum of distances, as in motmetrics.
    Distances,
}

/// A1: in each frame the most admissible pairs and, among such assignments, the least cost.
/// Errors: a gate so wide that a frame has more than [`MAX_PAIRS`] pairs.
pub fn optimal(truth: &TrackSet, result: &TrackSet, gate: &Gate, cost: Cost) -> Result<Matching> {
    let frames: Vec<_> =
        side_by_side(truth, result).into_iter().filter(|(_, t, r)| !t.is_empty() && !r.is_empty()).collect();
    let chosen: Vec<Vec<Pair>> = frames
        .par_iter()
        .map(|(frame, t, r)| {
            let neighbors = neighbor_pairs(&truth.points[t.clone()], &result.points[r.clone()], gate, 1.0);
            check_pair_count(neighbors.len(), *frame, gate)?;
            let pairs: Vec<Pair> = neighbors
                .iter()
                .map(|n| {
                    let value = if cost == Cost::Squares { n.squared } else { n.squared.sqrt() };
                    Pair { row: n.truth, column: n.result, value }
                })
                .collect();
            Ok(max_cardinality_min_cost(t.len(), r.len(), pairs))
        })
        .collect::<Result<_>>()?;
    let mut matching = Matching::empty(truth, result);
    for ((_, t, r), pairs) in frames.iter().zip(&chosen) {
        for pair in pairs {
            matching.join(t.start + pair.row as usize, r.start + pair.column as usize);
        }
    }
    Ok(matching)
}

/// A2: in each frame, repeatedly takes the pair nearest in the image plane among those that the gate admits.
/// DefocusTracker's `compare_true` does this with a closed box as gate.
pub fn greedy(truth: &TrackSet, result: &TrackSet, gate: &Gate) -> Result<Matching> {
    let mut matching = Matching::empty(truth, result);
    for (frame, t, r) in side_by_side(truth, result) {
        let (a, b) = (&truth.points[t.clone()], &result.points[r.clone()]);
        let neighbors = neighbor_pairs(a, b, gate, 1.0);
        check_pair_count(neighbors.len(), frame, gate)?;
        let mut order: Vec<(f64, u32, u32)> = neighbors
            .iter()
            .map(|n| {
                let (p, q) = (&a[n.truth as usize].at, &b[n.result as usize].at);
                ((p.x_px - q.x_px).powi(2) + (p.y_px - q.y_px).powi(2), n.truth, n.result)
            })
            .collect();
        order.sort_by(|a, b| a.0.total_cmp(&b.0).then((a.1, a.2).cmp(&(b.1, b.2))));
        for (_, i, j) in order {
            let (i, j) = (t.start + i as usize, r.start + j as usize);
            if matching.result_for[i] == NONE && matching.truth_for[j] == NONE {
                matching.join(i, j);
            }
        }
    }
    Ok(matching)
}

/// Refuses a gate for which a frame has too many pairs.
pub(super) fn check_pair_count(pairs: usize, frame: u32, gate: &Gate) -> Result<()> {
    if pairs <= MAX_PAIRS {
        return Ok(());
    }
    Err(Error::input(format!(
        "frame {frame}: a gate of {} px admits more than {MAX_PAIRS} pairs; make it smaller",
        gate.xy_px
    )))
}
