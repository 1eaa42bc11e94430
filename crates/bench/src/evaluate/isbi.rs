//! The scores of the ISBI Particle Tracking Challenge (Chenouard et al., Nat. Methods 11, 281, 2014, Suppl. Note 3).
//!
//! Tracks are runs of frames; holes of a reference are filled by interpolation, holes of a candidate never match. With gate
//! eps the distance of two tracks is the sum, over frames in which at least one exists, of min(d, eps) (eps where only one
//! exists). References are paired with candidates, or with nothing at eps times their length, at the least total D (A3).
//! alpha = 1 - D / D0, D0 = D with nothing paired; beta = (D0 - D) / (D0 + P), P = eps times the length of unpaired
//! candidates. Agrees with the authors' own program to 1e-9 (tests/suite/scoring.rs); there RMSE is 0 and alpha NaN where
//! nothing is matched or true, here both are null.

use serde::Serialize;

use super::assignment::{Pair, heaviest};
use super::cloud::{Cloud, Loose, Position, side_by_side};
use super::gate::Gate;
use super::matching::too_many;
use super::neighbours::near;
use super::statistics::{Bootstrap, Interval, TrackUnits, ratio};
use crate::error::Result;

/// The scores.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
#[allow(missing_docs)]
pub struct Isbi {
    /// 2 or 3: whether depth counts.
    pub dims: u8,
    pub gate_px: f64,
    pub alpha: Option<f64>,
    pub beta: Option<f64>,
    pub jsc: Option<f64>,
    pub jsc_theta: Option<f64>,
    /// Of matched points, px (with depth: depth in units of the gate times its width).
    pub rmse: Option<f64>,
    pub min_distance: Option<f64>,
    pub max_distance: Option<f64>,
    pub std_distance: Option<f64>,
    pub tp: usize,
    #[serde(rename = "fn")]
    pub missed: usize,
    pub fp: usize,
    pub tp_tracks: usize,
    pub fn_tracks: usize,
    pub fp_tracks: usize,
    /// 95 % intervals under resampling of tracks.
    pub interval: Intervals,
}

/// 95 % intervals.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
#[allow(missing_docs)]
pub struct Intervals {
    pub alpha: Interval,
    pub beta: Interval,
    pub jsc: Interval,
    pub jsc_theta: Interval,
    pub rmse: Interval,
}

impl Isbi {
    /// Of truth and result; the gate is radial (2-D) or an ellipsoid (3-D).
    ///
    /// # Errors
    /// A gate that is too wide.
    pub fn of(truth: &Cloud, result: &Cloud, gate: &Gate, bootstrap: &Bootstrap) -> Result<Self> {
        let filled = fill_holes(truth, result);
        let reference = filled.as_ref().unwrap_or(truth);
        // All points of all pairs of tracks that lie within the gate: tracks and distance.
        let mut points: Vec<(u32, u32, f64)> = Vec::new();
        for (frame, t, r) in side_by_side(reference, result) {
            let found = near(&reference.points[t.clone()], &result.points[r.clone()], gate, 1.0);
            too_many(points.len() + found.len(), frame, gate)?;
            points.extend(found.iter().map(|n| {
                let track = |cloud: &Cloud, first: usize, i: u32| cloud.points[first + i as usize].track;
                (track(reference, t.start, n.truth), track(result, r.start, n.result), n.squared.sqrt())
            }));
        }
        points.sort_by_key(|p| (p.0, p.1));
        // In units of eps from here on.
        let length = |cloud: &Cloud, track: usize| {
            let (first, last) = cloud.span(track);
            (last - first + 1) as f64
        };
        let mut candidates: Vec<(Pair, std::ops::Range<usize>)> = Vec::new();
        let mut first = 0;
        for same in points.chunk_by(|a, b| (a.0, a.1) == (b.0, b.1)) {
            let (row, column) = (same[0].0, same[0].1);
            let ((a0, a1), (b0, b1)) = (reference.span(row as usize), result.span(column as usize));
            let overlap = a1.min(b1) - a0.max(b0) + 1;
            let frames = (overlap + (a0 - b0).abs() + (a1 - b1).abs()) as f64;
            let nearness: f64 = same.iter().map(|p| 1.0 - p.2).sum();
            let gain = length(reference, row as usize) - (frames - nearness);
            candidates.push((Pair { row, column, value: gain }, first..first + same.len()));
            first += same.len();
        }
        let pairs: Vec<Pair> = candidates.iter().map(|c| c.0).collect();
        let chosen = heaviest(reference.n_tracks(), result.n_tracks(), pairs.clone());

        let (n_true, n_result) = (reference.n_tracks(), result.n_tracks());
        let mut unpaired: f64 = (0..n_result).map(|t| length(result, t)).sum();
        let mut distances = Vec::new();
        // Sums of tracks: gain, frames of references, frames of unpaired candidates, TP, all points, tracks either way,
        // pairs, squared distances.
        let chosen_pairs = chosen.iter().map(|p| (p.row, p.column, 1));
        let mut units = TrackUnits::<8>::new(n_true, n_result, chosen_pairs);
        for track in 0..n_true {
            let [_, frames, _, _, all, tracks, ..] = units.of_truth(track);
            *frames += length(reference, track);
            *all += length(reference, track);
            *tracks += 1.0;
        }
        for track in 0..n_result {
            let [_, _, unpaired, _, all, tracks, ..] = units.of_result(track);
            *unpaired += length(result, track);
            *all += result.track(track).len() as f64;
            *tracks += 1.0;
        }
        // As in the authors' program: a paired candidate's virtual points beyond the reference's ends count as real ones.
        let mut virtual_ghosts = 0;
        for pair in &chosen {
            let at = pairs.partition_point(|p| (p.row, p.column) < (pair.row, pair.column));
            let same = &points[candidates[at].1.clone()];
            distances.extend(same.iter().map(|p| p.2 * gate.xy_px));
            let column = pair.column as usize;
            unpaired -= length(result, column);
            let ghosts = holes_outside(result, column, reference.span(pair.row as usize));
            virtual_ghosts += ghosts;
            let squares: f64 = same.iter().map(|p| (p.2 * gate.xy_px).powi(2)).sum();
            let tp = same.len() as f64;
            // Points and tracks that are paired were counted on both sides.
            let more = [pair.value, 0.0, -length(result, column), tp, ghosts as f64 - tp, -1.0, 1.0, squares];
            units.of_truth(pair.row as usize).iter_mut().zip(more).for_each(|(s, m)| *s += m);
        }
        let [alpha, beta, jsc, jsc_theta, rmse] = bootstrap.intervals(
            &units.finish(),
            |&[gain, frames, unpaired, tp, all, tracks, paired, squares]| {
                [
                    ratio(gain, frames),
                    ratio(gain, frames + unpaired),
                    ratio(tp, all),
                    ratio(paired, tracks),
                    ratio(squares, tp).map(f64::sqrt),
                ]
            },
        );
        let gain: f64 = chosen.iter().map(|p| p.value).sum();
        let all: f64 = (0..n_true).map(|t| length(reference, t)).sum();
        let (tp, paired) = (distances.len(), chosen.len());
        let (missed, fp) = (all as usize - tp, result.len() - tp + virtual_ghosts);
        let n = tp as f64;
        let mean = ratio(distances.iter().sum(), n);
        let spread = |m: f64| (distances.iter().map(|d| (d - m) * (d - m)).sum::<f64>() / n).sqrt();
        Ok(Isbi {
            dims: if gate.z_um.is_finite() { 3 } else { 2 },
            gate_px: gate.xy_px,
            alpha: ratio(gain, all),
            beta: ratio(gain, all + unpaired),
            jsc: ratio(n, (tp + missed + fp) as f64),
            jsc_theta: ratio(paired as f64, (n_true + n_result - paired) as f64),
            rmse: ratio(distances.iter().map(|d| d * d).sum(), n).map(f64::sqrt),
            min_distance: distances.iter().copied().reduce(f64::min),
            max_distance: distances.iter().copied().reduce(f64::max),
            std_distance: mean.map(spread),
            tp,
            missed,
            fp,
            tp_tracks: paired,
            fn_tracks: n_true - paired,
            fp_tracks: n_result - paired,
            interval: Intervals { alpha, beta, jsc, jsc_theta, rmse },
        })
    }
}

/// Frames in holes of a track that lie outside of a span.
fn holes_outside(cloud: &Cloud, track: usize, (first, last): (i64, i64)) -> usize {
    let frame = |i: u32| i64::from(cloud.points[i as usize].frame);
    let outside = |(from, to): (i64, i64)| {
        // Frames from..to of a hole, less those within the span.
        let inside = (to.min(last + 1) - from.max(first)).max(0);
        (to - from - inside).max(0) as usize
    };
    cloud.track(track).windows(2).map(|w| outside((frame(w[0]) + 1, frame(w[1])))).sum()
}

/// The truth with virtual points, on straight lines, in those frames of holes in which there are results. `None` if no
/// track has a hole.
fn fill_holes(truth: &Cloud, result: &Cloud) -> Option<Cloud> {
    let holes =
        truth.links().any(|(a, b)| truth.points[b as usize].frame - truth.points[a as usize].frame > 1);
    if !holes {
        return None;
    }
    let loose = |p: &super::cloud::Point| Loose {
        frame: p.frame,
        track: Some((i64::from(p.track), 0)),
        at: p.at,
        source: p.source,
    };
    let mut points: Vec<Loose> = truth.points.iter().map(loose).collect();
    for (a, b) in truth.links() {
        let (a, b) = (&truth.points[a as usize], &truth.points[b as usize]);
        let from = result.frames.partition_point(|f| f.0 <= a.frame);
        for (frame, _) in result.frames[from..].iter().take_while(|f| f.0 < b.frame) {
            let share = f64::from(frame - a.frame) / f64::from(b.frame - a.frame);
            let between = |p: f64, q: f64| p + (q - p) * share;
            let at = Position {
                x_px: between(a.at.x_px, b.at.x_px),
                y_px: between(a.at.y_px, b.at.y_px),
                z_um: between(a.at.z_um, b.at.z_um),
            };
            points.push(Loose { frame: *frame, at, ..loose(a) });
        }
    }
    Some(Cloud::new(points))
}
