//! Links: does the result follow the same particle from one of its points to the next?
//!
//! A result link (two consecutive points of a result track) is right iff both ends are matched and the matched truth
//! points are consecutive in one truth track.

use serde::Serialize;

use super::cloud::Cloud;
use super::detection::rates;
use super::matching::{Matching, NONE};
use super::statistics::bootstrap;

/// Counts and rates over all links.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
#[allow(missing_docs)]
pub struct Links {
    pub tp: usize,
    pub fp: usize,
    #[serde(rename = "fn")]
    pub missed: usize,
    pub precision: Option<f64>,
    pub recall: Option<f64>,
    pub f1: Option<f64>,
    /// 95 % interval of F1 under resampling of frames.
    pub interval_f1: Option<[f64; 2]>,
}

/// The truth's successor of every point, or [`NONE`].
pub fn successors(truth: &Cloud) -> Vec<u32> {
    let mut next = vec![NONE; truth.len()];
    truth.links().for_each(|(a, b)| next[a as usize] = b);
    next
}

/// The links of the result that are right: truth's points and result's points.
pub fn right<'a>(
    result: &'a Cloud,
    matching: &'a Matching,
    next: &'a [u32],
) -> impl Iterator<Item = ((usize, usize), (usize, usize))> + 'a {
    result.links().filter_map(|(a, b)| {
        let (ta, tb) = (matching.of_result[a as usize], matching.of_result[b as usize]);
        let joined = ta != NONE && tb != NONE && next[ta as usize] == tb;
        joined.then_some(((ta as usize, tb as usize), (a as usize, b as usize)))
    })
}

impl Links {
    /// Of a matching.
    pub fn of(truth: &Cloud, result: &Cloud, matching: &Matching, seed: u64) -> Self {
        let next = successors(truth);
        let tp = right(result, matching, &next).count();
        let (n, m) = (truth.links().count(), result.links().count());
        let (missed, fp) = (n - tp, m - tp);
        let [precision, recall, f1, _] = rates(tp as f64, missed as f64, fp as f64);
        // Links belong to the frame they begin in.
        let frames = super::cloud::side_by_side(truth, result);
        let index = |frame: u32| frames.partition_point(|f| f.0 < frame);
        let mut units = vec![[0.0; 3]; frames.len()];
        truth.links().for_each(|(a, _)| units[index(truth.points[a as usize].frame)][1] += 1.0);
        result.links().for_each(|(a, _)| units[index(result.points[a as usize].frame)][2] += 1.0);
        right(result, matching, &next).for_each(|(_, (a, _))| units[index(result.points[a].frame)][0] += 1.0);
        let [interval_f1] = bootstrap(&units, seed, |&[tp, n, m]| [rates(tp, n - tp, m - tp)[2]]);
        Links { tp, fp, missed, precision, recall, f1, interval_f1 }
    }
}
