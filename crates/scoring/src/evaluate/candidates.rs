//! Candidate pairs of HOTA, CLEAR and IDF1: all pairs of a true and a result point within twice the gate.

use std::ops::Range;

use super::gate::Gate;
use super::matching::check_pair_count;
use super::neighbors::neighbor_pairs;
use super::track_set::{TrackSet, side_by_side};
use storage::error::Result;

/// A pair: indices of its points, and its squared distance.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CandidatePair {
    /// Index of the true point.
    pub truth: u32,
    /// Index of the result point.
    pub result: u32,
    /// Squared distance D^2 in units of the gate, below 4.
    pub squared: f64,
}

/// A frame: its number, and the ranges of its true points, result points and pairs.
pub type CandidateFrame = (u32, Range<usize>, Range<usize>, Range<usize>);

/// The candidate pairs of all frames.
#[derive(Debug, Clone)]
pub struct Candidates {
    pub(super) gate: Gate,
    /// All pairs, sorted by frame, true point, result point.
    pub pairs: Vec<CandidatePair>,
    /// Every frame that has a true or a result point.
    pub frames: Vec<CandidateFrame>,
}

impl Candidates {
    /// Finds all pairs within twice the gate.
    pub fn new(truth: &TrackSet, result: &TrackSet, gate: &Gate) -> Result<Self> {
        let (mut pairs, mut frames) = (Vec::new(), Vec::new());
        for (frame, t, r) in side_by_side(truth, result) {
            let first = pairs.len();
            let found = neighbor_pairs(&truth.points[t.clone()], &result.points[r.clone()], gate, 2.0);
            check_pair_count(first + found.len(), frame, gate)?;
            pairs.extend(found.iter().map(|n| CandidatePair {
                truth: (t.start + n.truth as usize) as u32,
                result: (r.start + n.result as usize) as u32,
                squared: n.squared,
            }));
            frames.push((frame, t, r, first..pairs.len()));
        }
        Ok(Candidates { gate: *gate, pairs, frames })
    }

    /// Whether a pair is within the gate itself.
    pub fn admits(&self, pair: &CandidatePair) -> bool {
        self.gate.admits(pair.squared)
    }

    /// The pairs within the gate.
    pub fn admitted(&self) -> impl Iterator<Item = &CandidatePair> {
        self.pairs.iter().filter(|p| self.admits(p))
    }

    /// The true track and the result track of a pair.
    pub fn tracks(&self, truth: &TrackSet, result: &TrackSet, pair: &CandidatePair) -> (u32, u32) {
        (truth.points[pair.truth as usize].track, result.points[pair.result as usize].track)
    }
}
