//! Link scores: whether consecutive points of a result track belong to the same particle.
//!
//! A result link (two consecutive points of a result track) is correct if and only if both ends are matched
//! and the matched true points are consecutive in one true track.

use super::detection::rates;
use super::matching::{Matching, NONE};
use super::statistics::Interval;
use super::track_set::TrackSet;
use super::units::Units;

scores! {
    /// Scores of links, i.e. pairs of consecutive points of a track.
    pub struct Links {
        /// Number of correct result links: both ends are matched to consecutive points of one true track.
        pub tp: usize,
        /// Number of result links that are not correct.
        pub fp: usize,
        /// Number of true links that no result link reproduces.
        #[serde(rename = "fn")]
        pub missed: usize,
        /// TP / (TP + FP).
        fraction precision: Option<f64>,
        /// TP / (TP + FN).
        fraction recall: Option<f64>,
        /// 2 TP / (2 TP + FP + FN).
        fraction f1: Option<f64>,
        /// 95 % bootstrap interval of precision, resampling true tracks.
        fraction interval_precision: Interval,
        /// 95 % bootstrap interval of recall.
        fraction interval_recall: Interval,
        /// 95 % bootstrap interval of F1.
        fraction interval_f1: Interval,
    }
}

/// Index of the next point of the same track for every point, or [`NONE`].
pub fn successors(truth: &TrackSet) -> Vec<u32> {
    let mut next = vec![NONE; truth.len()];
    truth.links().for_each(|(a, b)| next[a as usize] = b);
    next
}

/// The correct links of the result: (indices of true points, indices of result points).
pub fn correct_links<'a>(
    result: &'a TrackSet,
    matching: &'a Matching,
    next: &'a [u32],
) -> impl Iterator<Item = ((usize, usize), (usize, usize))> + 'a {
    result.links().filter_map(|(a, b)| {
        let (ta, tb) = (matching.truth_for[a as usize], matching.truth_for[b as usize]);
        let joined = ta != NONE && tb != NONE && next[ta as usize] == tb;
        joined.then_some(((ta as usize, tb as usize), (a as usize, b as usize)))
    })
}

impl Links {
    /// Scores the links of a matching. Also gives the sums over units of correct links, true links and links of
    /// the result; a link belongs to the unit of its first point.
    pub fn of(
        truth: &TrackSet,
        result: &TrackSet,
        matching: &Matching,
        units: &Units,
    ) -> (Self, Vec<[f64; 3]>) {
        let next = successors(truth);
        let tp = correct_links(result, matching, &next).count();
        let (n, m) = (truth.links().count(), result.links().count());
        let (missed, fp) = (n - tp, m - tp);
        let [precision, recall, f1, _] = rates(tp as f64, missed as f64, fp as f64);
        let true_ones = truth.links().map(|(a, _)| (units.truth_unit(a as usize), [0.0, 1.0, 0.0]));
        let found = result.links().map(|(a, _)| (units.result_unit(a as usize), [0.0, 0.0, 1.0]));
        let good =
            correct_links(result, matching, &next).map(|((a, _), _)| (units.truth_unit(a), [1.0, 0.0, 0.0]));
        let sums = units.sums(true_ones.chain(found).chain(good));
        let [interval_precision, interval_recall, interval_f1] = units.intervals(&sums, |&[tp, n, m]| {
            let [precision, recall, f1, _] = rates(tp, n - tp, m - tp);
            [precision, recall, f1]
        });
        let score =
            Links { tp, fp, missed, precision, recall, f1, interval_precision, interval_recall, interval_f1 };
        (score, sums)
    }
}
