//! HOTA: detection and association in a single score (Luiten et al., IJCV 129, 2021), as TrackEval 1.3
//! computes it.
//!
//! Similarity S = max(0, 1 - d / D0) with D0 = 2 gates, so that S = 0.5 at the gate. In every frame the
//! matching maximizes sum A S, where A is the agreement of two tracks over all frames; at each threshold a =
//! 0.05, 0.10, ..., 0.95 the pairs with S >= a count as matches. HOTA = mean over a of sqrt(DetA AssA).

use super::candidates::{CandidatePair, Candidates};
use super::statistics::{Interval, ratio};
use super::track_set::TrackSet;
use super::units::Units;
use numeric::assignment::{Pair, max_weight_matching};

scores! {
    /// Higher order tracking accuracy (Luiten et al., IJCV 129, 2021), as TrackEval 1.3 computes it; values are
    /// means over 19 thresholds.
    pub struct Hota {
        /// Mean over thresholds of sqrt(DetA AssA).
        fraction hota: Option<f64>,
        /// Detection accuracy, TP / (TP + FN + FP).
        fraction deta: Option<f64>,
        /// Association accuracy, mean over TP of TPA / (TPA + FNA + FPA).
        fraction assa: Option<f64>,
        /// Detection recall.
        fraction detre: Option<f64>,
        /// Detection precision.
        fraction detpr: Option<f64>,
        /// Association recall.
        fraction assre: Option<f64>,
        /// Association precision.
        fraction asspr: Option<f64>,
        /// Localization accuracy: mean similarity of TP, 1 - d / (2 gates), where d is the distance of the pair.
        fraction loca: Option<f64>,
        /// HOTA at the lowest threshold, 0.05.
        fraction hota_0: Option<f64>,
        /// LocA at the lowest threshold.
        fraction loca_0: Option<f64>,
        /// HOTA at the thresholds 0.05, 0.10, ..., 0.95.
        fraction curve: Vec<f64>,
        /// 95 % bootstrap interval of HOTA, resampling true tracks.
        fraction interval_hota: Interval,
        /// 95 % bootstrap interval of DetA.
        fraction interval_deta: Interval,
        /// 95 % bootstrap interval of AssA.
        fraction interval_assa: Interval,
    }
}

const THRESHOLDS: usize = 19;

/// Sums of a resampling unit: points of truth and result; for each threshold, matches and their summed
/// association score.
pub(crate) const SUMS: usize = 1 + 2 * THRESHOLDS;

/// HOTA, DetA and AssA from the sums of a resample.
pub(crate) fn means(sums: &[f64; SUMS]) -> [Option<f64>; 3] {
    let (mut hota, mut deta, mut assa) = (0.0, 0.0, 0.0);
    for k in 0..THRESHOLDS {
        let (tp, of_pairs) = (sums[1 + 2 * k], sums[2 + 2 * k]);
        let (d, a) = (tp / (sums[0] - tp).max(1.0), if tp > 0.0 { of_pairs / tp } else { 0.0 });
        hota += (d * a).sqrt();
        deta += d;
        assa += a;
    }
    [hota, deta, assa].map(|sum| Some(sum / THRESHOLDS as f64))
}

/// Similarity of a pair from its D^2: 1 at zero distance, 0.5 at the gate.
fn similarity(squared: f64) -> f64 {
    1.0 - squared.sqrt() / 2.0
}

/// True and result track of a pair, packed into one integer.
fn key(truth: &TrackSet, result: &TrackSet, candidates: &Candidates, pair: &CandidatePair) -> u64 {
    let (t, r) = candidates.tracks(truth, result, pair);
    u64::from(t) << 32 | u64::from(r)
}

/// Numbers of points of the two tracks of a [`key`].
fn lengths(truth: &TrackSet, result: &TrackSet, key: u64) -> (f64, f64) {
    let length = |set: &TrackSet, track: u64| set.track(track as usize).len() as f64;
    (length(truth, key >> 32), length(result, key & 0xffff_ffff))
}

/// Agreement of pairs of tracks over all frames (TrackEval's global alignment score), sorted by [`key`].
fn agreement(truth: &TrackSet, result: &TrackSet, candidates: &Candidates) -> Vec<(u64, f64)> {
    // In each frame a pair's similarity is normalized by the similarities of all competing pairs.
    let mut shares: Vec<(u64, f64)> = Vec::with_capacity(candidates.pairs.len());
    let key = |p: &CandidatePair| key(truth, result, candidates, p);
    for (_, t, r, pairs) in &candidates.frames {
        let (mut true_sums, mut result_sums) = (vec![0.0; t.len()], vec![0.0; r.len()]);
        for p in &candidates.pairs[pairs.clone()] {
            true_sums[p.truth as usize - t.start] += similarity(p.squared);
            result_sums[p.result as usize - r.start] += similarity(p.squared);
        }
        for p in &candidates.pairs[pairs.clone()] {
            let s = similarity(p.squared);
            let all = true_sums[p.truth as usize - t.start] + result_sums[p.result as usize - r.start] - s;
            shares.push((key(p), if all > f64::EPSILON { s / all } else { 0.0 }));
        }
    }
    // The stable sort keeps the order of frames, so sums do not depend on the order of rows.
    shares.sort_by_key(|s| s.0);
    shares
        .chunk_by(|a, b| a.0 == b.0)
        .map(|same| {
            let sum: f64 = same.iter().map(|s| s.1).sum();
            let (n, m) = lengths(truth, result, same[0].0);
            (same[0].0, sum / (n + m - sum))
        })
        .collect()
}

/// The matches of all frames, which maximize the sum of agreement times similarity: [`key`], similarity and
/// index of the result point.
fn matched(truth: &TrackSet, result: &TrackSet, candidates: &Candidates) -> Vec<(u64, f64, u32)> {
    let agreement = agreement(truth, result, candidates);
    let key = |p: &CandidatePair| key(truth, result, candidates, p);
    let weight = |p: &CandidatePair| {
        let at = agreement.partition_point(|a| a.0 < key(p));
        agreement[at].1 * similarity(p.squared)
    };
    let weights: Vec<f64> = candidates.pairs.iter().map(weight).collect();
    drop(agreement);

    let mut matched: Vec<(u64, f64, u32)> = Vec::new();
    for (_, t, r, pairs) in &candidates.frames {
        let near = &candidates.pairs[pairs.clone()];
        let candidates = near.iter().zip(&weights[pairs.clone()]).map(|(p, value)| Pair {
            row: p.truth - t.start as u32,
            column: p.result - r.start as u32,
            value: *value,
        });
        for chosen in max_weight_matching(t.len(), r.len(), candidates.collect()) {
            let (i, j) = (t.start as u32 + chosen.row, r.start as u32 + chosen.column);
            let p = &near[near.partition_point(|p| (p.truth, p.result) < (i, j))];
            matched.push((key(p), similarity(p.squared), j));
        }
    }
    matched
}

impl Hota {
    /// Scores the candidate pairs within twice the gate. Also gives the sums over units: points of truth and result, then
    /// matches and association at each threshold.
    pub fn of(
        truth: &TrackSet,
        result: &TrackSet,
        candidates: &Candidates,
        units: &Units,
    ) -> (Self, Vec<[f64; SUMS]>) {
        let lengths = |key: u64| lengths(truth, result, key);
        let mut matched = matched(truth, result, candidates);
        matched.sort_by_key(|m| m.0);
        let same_pairs = || matched.chunk_by(|a, b| a.0 == b.0);
        let unit_of = |key: u64| units.track_unit((key >> 32) as usize);

        let mut result_units: Vec<u32> = (0..result.len()).map(|j| units.result_unit(j)).collect();
        matched.iter().for_each(|m| result_units[m.2 as usize] = unit_of(m.0));
        let points = (0..truth.len()).map(|i| units.truth_unit(i)).chain(result_units);
        let mut of_units = units.sums(points.map(|unit| {
            let mut sums = [0.0; SUMS];
            sums[0] = 1.0;
            (unit, sums)
        }));
        if truth.is_empty() && result.is_empty() {
            return (Hota::default(), of_units);
        }
        let (n, m) = (truth.len() as f64, result.len() as f64);
        let mut sums = [0.0; 7];
        let (mut curve, mut loca_0) = (Vec::with_capacity(THRESHOLDS), None);
        let mut any = false;
        for k in 0..THRESHOLDS {
            let threshold = 0.05 + k as f64 * 0.05 - f64::EPSILON;
            let (mut tp, mut total, mut assa, mut assre, mut asspr) = (0.0, 0.0, 0.0, 0.0, 0.0);
            for same in same_pairs() {
                let good = same.iter().filter(|s| s.1 >= threshold);
                let (c, s) = good.fold((0.0, 0.0), |(c, s), m| (c + 1.0, s + m.1));
                let (n, m) = lengths(same[0].0);
                tp += c;
                total += s;
                let of_pairs = c * c / (n + m - c);
                let unit = &mut of_units[unit_of(same[0].0) as usize];
                unit[1 + 2 * k] += c;
                unit[2 + 2 * k] += of_pairs;
                assa += of_pairs;
                assre += c * c / n;
                asspr += c * c / m;
            }
            any |= tp > 0.0;
            let per_tp = |sum: f64| if tp > 0.0 { sum / tp } else { 0.0 };
            let deta = tp / (n + m - tp).max(1.0);
            // TrackEval defines LocA without matches as 1.
            let loca = if tp > 0.0 { total / tp } else { 1.0 };
            let hota = (deta * per_tp(assa)).sqrt();
            if k == 0 {
                loca_0 = (tp > 0.0).then_some(loca);
            }
            curve.push(hota);
            let detre = ratio(tp, n).unwrap_or(0.0);
            let detpr = ratio(tp, m).unwrap_or(0.0);
            let values = [deta, per_tp(assa), detre, detpr, per_tp(assre), per_tp(asspr), loca];
            sums.iter_mut().zip(values).for_each(|(s, v)| *s += v);
        }
        let [interval_hota, interval_deta, interval_assa] = units.intervals(&of_units, means);
        let mean = |k: usize| Some(sums[k] / THRESHOLDS as f64);
        let score = Hota {
            hota: Some(curve.iter().sum::<f64>() / THRESHOLDS as f64),
            deta: mean(0),
            assa: mean(1),
            detre: mean(2),
            detpr: mean(3),
            assre: mean(4),
            asspr: mean(5),
            loca: mean(6).filter(|_| any),
            hota_0: Some(curve[0]),
            loca_0,
            curve,
            interval_hota,
            interval_deta,
            interval_assa,
        };
        (score, of_units)
    }
}
