//! Which result point is which particle: frame by frame, optimal (A1) or greedy (A2).

use rayon::prelude::*;

use super::assignment::{Pair, most_then_cheapest};
use super::cloud::{Cloud, side_by_side};
use super::gate::Gate;
use super::neighbours::{MAX_PAIRS, near};
use crate::error::{Error, Result};

/// No partner.
pub const NONE: u32 = u32::MAX;

/// A one-to-one matching of two clouds.
#[derive(Debug, Clone, PartialEq)]
pub struct Matching {
    /// The result point of every truth point, or [`NONE`].
    pub of_truth: Vec<u32>,
    /// The truth point of every result point, or [`NONE`].
    pub of_result: Vec<u32>,
}

impl Matching {
    fn empty(truth: &Cloud, result: &Cloud) -> Self {
        Matching { of_truth: vec![NONE; truth.len()], of_result: vec![NONE; result.len()] }
    }

    fn join(&mut self, truth: usize, result: usize) {
        self.of_truth[truth] = result as u32;
        self.of_result[result] = truth as u32;
    }

    /// The pairs: indices of truth and result, in order of truth.
    pub fn pairs(&self) -> impl Iterator<Item = (usize, usize)> + '_ {
        self.of_truth.iter().enumerate().filter(|(_, r)| **r != NONE).map(|(t, r)| (t, *r as usize))
    }
}

/// What an assignment minimises among those with the most pairs.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Cost {
    /// The sum of squared distances: our rule, `lap-maxcard-d2`.
    Squares,
    /// The sum of distances, as motmetrics has it.
    Distances,
}

/// A1: per frame as many admissible pairs as possible, then the least cost.
///
/// # Errors
/// A gate so wide that a frame has more pairs than memory should hold.
pub fn optimal(truth: &Cloud, result: &Cloud, gate: &Gate, cost: Cost) -> Result<Matching> {
    let frames: Vec<_> =
        side_by_side(truth, result).into_iter().filter(|(_, t, r)| !t.is_empty() && !r.is_empty()).collect();
    let chosen: Vec<Vec<Pair>> = frames
        .par_iter()
        .map(|(frame, t, r)| {
            let near = near(&truth.points[t.clone()], &result.points[r.clone()], gate, 1.0);
            too_many(near.len(), *frame, gate)?;
            let pairs: Vec<Pair> = near
                .iter()
                .map(|n| {
                    let value = if cost == Cost::Squares { n.squared } else { n.squared.sqrt() };
                    Pair { row: n.truth, column: n.result, value }
                })
                .collect();
            Ok(most_then_cheapest(t.len(), r.len(), pairs))
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

/// A2: per frame, again and again the pair that is nearest in the image plane, among those that the gate admits.
/// DefocusTracker's `compare_true` does this with a closed box as gate.
///
/// # Errors
/// As [`optimal`].
pub fn greedy(truth: &Cloud, result: &Cloud, gate: &Gate) -> Result<Matching> {
    let mut matching = Matching::empty(truth, result);
    for (frame, t, r) in side_by_side(truth, result) {
        let (a, b) = (&truth.points[t.clone()], &result.points[r.clone()]);
        let near = near(a, b, gate, 1.0);
        too_many(near.len(), frame, gate)?;
        let mut order: Vec<(f64, u32, u32)> = near
            .iter()
            .map(|n| {
                let (p, q) = (&a[n.truth as usize].at, &b[n.result as usize].at);
                ((p.x_px - q.x_px).powi(2) + (p.y_px - q.y_px).powi(2), n.truth, n.result)
            })
            .collect();
        order.sort_by(|a, b| a.0.total_cmp(&b.0).then((a.1, a.2).cmp(&(b.1, b.2))));
        for (_, i, j) in order {
            let (i, j) = (t.start + i as usize, r.start + j as usize);
            if matching.of_truth[i] == NONE && matching.of_result[j] == NONE {
                matching.join(i, j);
            }
        }
    }
    Ok(matching)
}

/// An error if a frame has too many pairs.
pub(super) fn too_many(pairs: usize, frame: u32, gate: &Gate) -> Result<()> {
    if pairs <= MAX_PAIRS {
        return Ok(());
    }
    Err(Error::input(format!(
        "frame {frame}: a gate of {} px admits more than {MAX_PAIRS} pairs; make it smaller",
        gate.xy_px
    )))
}
