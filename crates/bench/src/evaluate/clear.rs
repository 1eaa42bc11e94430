//! CLEAR MOT: MOTA and MOTP (Bernardin and Stiefelhagen, EURASIP JIVP 2008), as motmetrics 1.4 computes them.
//!
//! A true track keeps the result track it had, as long as both are within the gate; the rest is assigned with as many pairs
//! as possible and the least sum of distances. A pair with another result track than before is a switch.
//! MOTA = 1 - (misses + ghosts + switches) / true points; MOTP = mean distance of pairs, in units of length.

use serde::Serialize;

use super::assignment::{Pair, most_then_cheapest};
use super::cloud::Cloud;
use super::matching::NONE;
use super::statistics::{Bootstrap, Interval, ratio};
use super::wide::Wide;

/// The scores.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
#[allow(missing_docs)]
pub struct Clear {
    pub mota: Option<f64>,
    /// Mean distance of pairs, px (in depth: in units of the gate times its width).
    pub motp: Option<f64>,
    pub id_switches: usize,
    pub matches: usize,
    pub misses: usize,
    pub false_positives: usize,
    pub fragmentations: usize,
    /// True tracks matched in at least 80 %, 20 to 80 %, less than 20 % of their points.
    pub mostly_tracked: usize,
    pub partially_tracked: usize,
    pub mostly_lost: usize,
    /// 95 % intervals under resampling of frames.
    pub interval_mota: Interval,
    pub interval_motp: Interval,
}

impl Clear {
    /// Of the pairs within the gate; `xy_px` is the gate's width.
    pub fn of(truth: &Cloud, result: &Cloud, wide: &Wide, xy_px: f64, bootstrap: &Bootstrap) -> Self {
        let mut score = Clear::default();
        let mut last = vec![NONE; truth.n_tracks()];
        let mut hit = vec![false; truth.len()];
        let mut frames = Vec::with_capacity(wide.frames.len());
        for (frame, t, r, pairs) in &wide.frames {
            let near: Vec<_> = wide.pairs[pairs.clone()].iter().filter(|p| wide.admits(p)).collect();
            let mut taken = vec![false; r.len()];
            let mut rest = Vec::new();
            let (mut found, mut switches, mut distance) = (0, 0, 0.0);
            for p in &near {
                let (track, partner) = wide.tracks(truth, result, p);
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
            for p in most_then_cheapest(t.len(), r.len(), rest) {
                let (i, j) = (t.start + p.row as usize, r.start + p.column as usize);
                let (track, partner) = (truth.points[i].track as usize, result.points[j].track);
                let switch = last[track] != NONE && last[track] != partner;
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
