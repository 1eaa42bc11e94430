//! CLEAR MOT: MOTA and MOTP (Bernardin and Stiefelhagen, EURASIP JIVP 2008), as motmetrics 1.4 computes them.
//!
//! A true track keeps its result track as long as their points are within the gate; the other points are
//! assigned with the most pairs and, among those, the least sum of distances. A match with a different result
//! track than the last one is an identity switch. MOTA = 1 - (misses + ghosts + switches) / true points; MOTP
//! = mean distance of matched pairs, a length.

use super::candidates::{CandidatePair, Candidates};
use super::matching::NONE;
use super::statistics::{Interval, ratio};
use super::track_set::TrackSet;
use super::units::Units;
use numeric::assignment::{Pair, max_cardinality_min_cost};

scores! {
    /// CLEAR MOT (Bernardin and Stiefelhagen, EURASIP J. Image Video Process., 2008), as motmetrics 1.4 computes
    /// it.
    pub struct Clear {
        /// 1 - (misses + false positives + switches) / true points; at most 1, may be negative.
        pub mota: Option<f64>,
        /// Mean distance of matched pairs, px; with depth, the gate distance D times gate_xy.
        not_negative motp: Option<f64>,
        /// Identity switches: matches of a true track with a result track other than its last one.
        pub id_switches: usize,
        /// Number of matches that are not identity switches.
        pub matches: usize,
        /// Number of true points without a match.
        pub misses: usize,
        /// Number of result points without a match.
        pub false_positives: usize,
        /// Number of times that a true track becomes unmatched and is matched again later.
        pub fragmentations: usize,
        /// Number of true tracks matched in at least 80 % of their points.
        pub mostly_tracked: usize,
        /// Number of true tracks matched in 20 to 80 % of their points.
        pub partially_tracked: usize,
        /// Number of true tracks matched in less than 20 % of their points.
        pub mostly_lost: usize,
        /// 95 % bootstrap interval of MOTA, resampling true tracks.
        pub interval_mota: Interval,
        /// 95 % bootstrap interval of MOTP, resampling true tracks.
        not_negative interval_motp: Interval,
    }
}

impl Clear {
    /// Scores the pairs within the gate; `xy_px` is the gate's radius in the image plane, px.
    pub fn of(
        truth: &TrackSet,
        result: &TrackSet,
        candidates: &Candidates,
        xy_px: f64,
        units: &Units,
    ) -> Self {
        let Followed { hits, mut score, .. } = follow(truth, result, candidates);
        for track in 0..truth.n_tracks() {
            let hits: Vec<bool> = truth.track(track).iter().map(|&i| hits[i as usize].is_some()).collect();
            let n = hits.iter().filter(|h| **h).count();
            match n as f64 / hits.len() as f64 {
                share if share >= 0.8 => score.mostly_tracked += 1,
                share if share < 0.2 => score.mostly_lost += 1,
                _ => score.partially_tracked += 1,
            }
            let end = hits.iter().rposition(|h| *h).unwrap_or(0);
            score.fragmentations += hits[..=end].windows(2).filter(|w| w[0] && !w[1]).count();
        }
        let scores = |&[errors, n, found, distance]: &[f64; 4]| {
            [ratio(errors, n).map(|share| 1.0 - share), ratio(distance, found)]
        };
        // Errors, true points, matches and the sum of their distances, px.
        let mut is_ghost = vec![true; result.len()];
        hits.iter().flatten().for_each(|hit| is_ghost[hit.result as usize] = false);
        let true_points = hits.iter().enumerate().map(|(i, hit)| {
            let sums = hit.as_ref().map_or([1.0, 1.0, 0.0, 0.0], |hit| {
                [f64::from(u8::from(hit.is_switch)), 1.0, 1.0, hit.distance * xy_px]
            });
            (units.truth_unit(i), sums)
        });
        let ghosts = (0..result.len()).filter(|&j| is_ghost[j]);
        let sums =
            units.sums(true_points.chain(ghosts.map(|j| (units.result_unit(j), [1.0, 0.0, 0.0, 0.0]))));
        let total = sums.iter().fold([0.0; 4], |t: [f64; 4], u| std::array::from_fn(|k| t[k] + u[k]));
        [score.mota, score.motp] = scores(&total);
        [score.interval_mota, score.interval_motp] = units.intervals(&sums, scores);
        score
    }
}

/// Result points that are matched to a true track which another result track had before: the identity
/// switches.
pub fn switches(truth: &TrackSet, result: &TrackSet, candidates: &Candidates) -> Vec<u32> {
    let hits = follow(truth, result, candidates).hits;
    hits.into_iter().flatten().filter(|hit| hit.is_switch).map(|hit| hit.result).collect()
}

/// True tracks followed through the frames.
struct Followed {
    /// Counts of matches, misses, false positives and switches.
    score: Clear,
    /// The match of every true point.
    hits: Vec<Option<Hit>>,
}

/// A match of a true point.
#[derive(Clone)]
struct Hit {
    /// Index of the result point.
    result: u32,
    /// Distance in units of the gate.
    distance: f64,
    is_switch: bool,
}

fn follow(truth: &TrackSet, result: &TrackSet, candidates: &Candidates) -> Followed {
    let mut score = Clear::default();
    let mut last = vec![NONE; truth.n_tracks()];
    let mut hits = vec![None; truth.len()];
    for (_, t, r, pairs) in &candidates.frames {
        let near: Vec<_> = candidates.pairs[pairs.clone()].iter().filter(|p| candidates.admits(p)).collect();
        let mut taken = vec![false; r.len()];
        let mut rest = Vec::new();
        let mut found = 0;
        for p in &near {
            let (track, partner) = candidates.tracks(truth, result, p);
            if last[track as usize] == partner && !taken[p.result as usize - r.start] {
                taken[p.result as usize - r.start] = true;
                hits[p.truth as usize] =
                    Some(Hit { result: p.result, distance: p.squared.sqrt(), is_switch: false });
                score.matches += 1;
                found += 1;
            }
        }
        let is_free =
            |p: &&&CandidatePair| hits[p.truth as usize].is_none() && !taken[p.result as usize - r.start];
        for p in near.iter().filter(is_free) {
            let (row, column) = (p.truth - t.start as u32, p.result - r.start as u32);
            rest.push(Pair { row, column, value: p.squared.sqrt() });
        }
        for p in max_cardinality_min_cost(t.len(), r.len(), rest) {
            let (i, j) = (t.start + p.row as usize, r.start + p.column as usize);
            let (track, partner) = (truth.points[i].track as usize, result.points[j].track);
            let is_switch = last[track] != NONE && last[track] != partner;
            score.id_switches += usize::from(is_switch);
            score.matches += usize::from(!is_switch);
            last[track] = partner;
            hits[i] = Some(Hit { result: j as u32, distance: p.value, is_switch });
            found += 1;
        }
        score.misses += t.len() - found;
        score.false_positives += r.len() - found;
    }
    Followed { score, hits }
}
