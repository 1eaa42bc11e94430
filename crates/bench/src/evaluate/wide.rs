//! All pairs of one frame within twice the gate: what HOTA, CLEAR and IDF1 see of truth and result.

use std::ops::Range;

use super::cloud::{Cloud, side_by_side};
use super::gate::Gate;
use super::matching::too_many;
use super::neighbours::near;
use crate::error::Result;

/// A pair: indices of points, and D^2 in units of the gate, below 4.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct WidePair {
    /// Truth.
    pub truth: u32,
    /// Result.
    pub result: u32,
    /// D^2.
    pub squared: f64,
}

/// A frame: its number, points of truth, points of the result, pairs.
pub type Frame = (u32, Range<usize>, Range<usize>, Range<usize>);

/// The pairs of all frames.
#[derive(Debug, Clone)]
pub struct Wide {
    gate: Gate,
    /// All pairs, by frame, truth, result.
    pub pairs: Vec<WidePair>,
    /// Every frame of either.
    pub frames: Vec<Frame>,
}

impl Wide {
    /// Finds them.
    ///
    /// # Errors
    /// A gate that is too wide.
    pub fn new(truth: &Cloud, result: &Cloud, gate: &Gate) -> Result<Self> {
        let (mut pairs, mut frames) = (Vec::new(), Vec::new());
        for (frame, t, r) in side_by_side(truth, result) {
            let first = pairs.len();
            let found = near(&truth.points[t.clone()], &result.points[r.clone()], gate, 2.0);
            too_many(first + found.len(), frame, gate)?;
            pairs.extend(found.iter().map(|n| WidePair {
                truth: (t.start + n.truth as usize) as u32,
                result: (r.start + n.result as usize) as u32,
                squared: n.squared,
            }));
            frames.push((frame, t, r, first..pairs.len()));
        }
        Ok(Wide { gate: *gate, pairs, frames })
    }

    /// Whether the gate itself admits a pair.
    pub fn admits(&self, pair: &WidePair) -> bool {
        self.gate.admits(pair.squared)
    }

    /// The pairs that the gate admits.
    pub fn admitted(&self) -> impl Iterator<Item = &WidePair> {
        self.pairs.iter().filter(|p| self.admits(p))
    }

    /// The tracks of a pair.
    pub fn tracks(&self, truth: &Cloud, result: &Cloud, pair: &WidePair) -> (u32, u32) {
        (truth.points[pair.truth as usize].track, result.points[pair.result as usize].track)
    }
}
