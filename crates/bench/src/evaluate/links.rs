//! Links: does the result follow the same particle from one of its points to the next?
//!
//! A result link (two consecutive points of a result track) is right iff both ends are matched and the matched truth
//! points are consecutive in one truth track.

use serde::Serialize;

use super::cloud::Cloud;
use super::detection::rates;
use super::matching::{Matching, NONE};
use super::statistics::{Bootstrap, Interval};

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
    /// 95 % intervals under resampling of frames.
    pub interval_precision: Interval,
    pub interval_recall: Interval,
    pub interval_f1: Interval,
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
    pub fn of(truth: &Cloud, result: &Cloud, matching: &Matching, bootstrap: &Bootstrap) -> Self {
        let next = successors(truth);
        let tp = right(result, matching, &next).count();
        let (n, m) = (truth.links().count(), result.links().count());
        let (missed, fp) = (n - tp, m - tp);
        let [precision, recall, f1, _] = rates(tp as f64, missed as f64, fp as f64);
        // Links belong to the frame they begin in.
        let frame = |cloud: &Cloud, i: usize| cloud.points[i].frame;
        let true_ones = truth.links().map(|(a, _)| (frame(truth, a as usize), [0.0, 1.0, 0.0]));
        let found = result.links().map(|(a, _)| (frame(result, a as usize), [0.0, 0.0, 1.0]));
        let good = right(result, matching, &next).map(|(_, (a, _))| (frame(result, a), [1.0, 0.0, 0.0]));
        let units = bootstrap.by_frame(true_ones.chain(found).chain(good));
        let [interval_precision, interval_recall, interval_f1] =
            bootstrap.intervals(&units, |&[tp, n, m]| {
                let [precision, recall, f1, _] = rates(tp, n - tp, m - tp);
                [precision, recall, f1]
            });
        Links { tp, fp, missed, precision, recall, f1, interval_precision, interval_recall, interval_f1 }
    }
}
