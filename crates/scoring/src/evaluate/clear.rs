//! CLEAR MOT: MOTA and MOTP (Bernardin and Stiefelhagen, EURASIP JIVP 2008), as motmetrics 1.4 computes them.
//!
//! A true track keeps its result track as long as their points are within the gate; the other points are
//! assigned with the most pairs and, among those, the least sum of distances. A match with a different result
//! track than the last one is an identity switch. MOTA = 1 - (misses + ghosts + switches) / true points; MOTP
//! = mean distance of matched pairs, a length.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::assignment::{Pair, max_cardinality_min_cost};
use super::candidates::Candidates;
use super::matching::NONE;
use super::statistics::{Bootstrap, Interval, ratio};
use super::track_set::TrackSet;

/// CLEAR MOT (Bernardin and Stiefelhagen, EURASIP J. Image Video Process., 2008), as motmetrics 1.4 computes
/// it.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default)]
pub struct Clear {
    /// 1 - (misses + false positives + switches) / true points; at most 1, may be negative.
    pub mota: Option<f64>,
    /// Mean distance of matched pairs, px; with depth, the gate distance D times gate_xy.
    #[schemars(range(min = 0.0))]
    pub motp: Option<f64>,
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
    /// 95 % bootstrap interval of MOTA, resampling frames.
    pub interval_mota: Interval,
    /// 95 % bootstrap interval of MOTP, resampling frames.
    #[schemars(inner(range(min = 0.0)))]
    pub interval_motp: Interval,
}

impl Clear {
    /// Scores the pairs within the gate; `xy_px` is the gate's radius in the image plane, px.
    pub fn of(
        truth: &TrackSet,
        result: &TrackSet,
        candidates: &Candidates,
        xy_px: f64,
        bootstrap: &Bootstrap,
    ) -> Self {
        let Followed { frames, hit, mut score, .. } = follow(truth, result, candidates, xy_px);
        for track in 0..truth.n_tracks() {
            let hits: Vec<bool> = truth.track(track).iter().map(|&i| hit[i as usize]).collect();
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
        let units = bootstrap.by_frame(frames.into_iter());
        let mut sums = [0.0; 4];
        units.iter().for_each(|u| sums.iter_mut().zip(u).for_each(|(s, u)| *s += u));
        [score.mota, score.motp] = scores(&sums);
        [score.interval_mota, score.interval_motp] = bootstrap.intervals(&units, scores);
        score
    }
}

/// Result points that are matched to a true track which another result track had before: the identity
/// switches.
pub fn switches(truth: &TrackSet, result: &TrackSet, candidates: &Candidates) -> Vec<u32> {
    follow(truth, result, candidates, 1.0).switches
}

/// True tracks followed through the frames.
struct Followed {
    /// Counts of matches, misses, false positives and switches.
    score: Clear,
    /// Which true points are matched.
    hit: Vec<bool>,
    /// Result points at which a track is switched.
    switches: Vec<u32>,
    /// Of each frame: errors, true points, matches and the sum of their distances, px.
    frames: Vec<(u32, [f64; 4])>,
}

fn follow(truth: &TrackSet, result: &TrackSet, candidates: &Candidates, xy_px: f64) -> Followed {
    let mut score = Clear::default();
    let mut last = vec![NONE; truth.n_tracks()];
    let mut hit = vec![false; truth.len()];
    let (mut frames, mut switched) = (Vec::with_capacity(candidates.frames.len()), Vec::new());
    for (frame, t, r, pairs) in &candidates.frames {
        let near: Vec<_> = candidates.pairs[pairs.clone()].iter().filter(|p| candidates.admits(p)).collect();
        let mut taken = vec![false; r.len()];
        let mut rest = Vec::new();
        let (mut found, mut switches, mut distance) = (0, 0, 0.0);
        for p in &near {
            let (track, partner) = candidates.tracks(truth, result, p);
            if last[track as usize] == partner && !taken[p.result as usize - r.start] {
                taken[p.result as usize - r.start] = true;
                hit[p.truth as usize] = true;
                distance += p.squared.sqrt();
                score.matches += 1;
                found += 1;
            }
        }
        for p in near.iter().filter(|p| !hit[p.truth as usize] && !taken[p.result as usize - r.start]) {
            let (row, column) = (p.truth - t.start as u32, p.result - r.start as u32);
            rest.push(Pair { row, column, value: p.squared.sqrt() });
        }
        for p in max_cardinality_min_cost(t.len(), r.len(), rest) {
            let (i, j) = (t.start + p.row as usize, r.start + p.column as usize);
            let (track, partner) = (truth.points[i].track as usize, result.points[j].track);
            let switch = last[track] != NONE && last[track] != partner;
            if switch {
                switched.push(j as u32);
            }
            switches += usize::from(switch);
            score.matches += usize::from(!switch);
            last[track] = partner;
            hit[i] = true;
            distance += p.value;
            found += 1;
        }
        let (misses, ghosts) = (t.len() - found, r.len() - found);
        score.id_switches += switches;
        score.misses += misses;
        score.false_positives += ghosts;
        let sums = [misses + ghosts + switches, t.len(), found].map(|n| n as f64);
        frames.push((*frame, [sums[0], sums[1], sums[2], distance * xy_px]));
    }
    Followed { score, hit, switches: switched, frames }
}
