//! The scores of the ISBI Particle Tracking Challenge (Chenouard et al., Nat. Methods 11, 281, 2014, Suppl.
//! Note 3).
//!
//! A track spans all frames from its first to its last point; gaps in a reference (true) track are filled by
//! interpolation, gaps in a candidate (result) track never match. With gate eps, the distance of two tracks
//! is the sum of min(d, eps) over the frames in which at least one exists (eps where only one does).
//! References are paired with candidates, or with dummy tracks at a cost of eps times their length, such that
//! the total D is least (A3). alpha = 1 - D / D0, where D0 is D with nothing paired; beta = (D0 - D) / (D0 +
//! P), where P is eps times the total length of unpaired candidates. Agrees with the authors' program to 1e-9
//! (tests/suite/scoring.rs), except that its RMSE is 0 without a match and its alpha NaN without truth; here
//! both are null.

use super::gate::Gate;
use super::matching::check_pair_count;
use super::neighbors::neighbor_pairs;
use super::statistics::{Interval, ratio};
use super::track_set::{Position, TrackSet, UnsortedPoint, side_by_side};
use super::units::Units;
use numeric::assignment::{Pair, max_weight_matching};
use storage::error::Result;

scores! {
    /// ISBI Particle Tracking Challenge (Chenouard et al., Nat. Methods 11, 281, 2014, Suppl. Note 3); assignment
    /// A3.
    pub struct Isbi {
        /// Number of dimensions of the distance: 2 (image plane) or 3 (with depth).
        pub dims: u8,
        /// Gate eps.
        not_negative gate_px: f64,
        /// 1 - D / D0: normalized track distance, without a penalty for ghost tracks.
        fraction alpha: Option<f64>,
        /// (D0 - D) / (D0 + P): alpha with a penalty for unpaired result (ghost) tracks.
        fraction beta: Option<f64>,
        /// Jaccard index of the points: tp / (tp + missed + fp).
        fraction jsc: Option<f64>,
        /// Jaccard index of the tracks: tp_tracks / (tp_tracks + fn_tracks + fp_tracks).
        fraction jsc_theta: Option<f64>,
        /// Root mean square distance of matched points, px; with depth, z is scaled by gate_xy / gate_z.
        not_negative rmse: Option<f64>,
        /// Smallest of these distances.
        not_negative min_distance: Option<f64>,
        /// Largest of these distances.
        not_negative max_distance: Option<f64>,
        /// Standard deviation of these distances.
        not_negative std_distance: Option<f64>,
        /// Number of matched points in paired tracks.
        pub tp: usize,
        /// Number of points of true tracks, including filled gaps, without a match.
        #[serde(rename = "fn")]
        pub missed: usize,
        /// Number of result points without a match.
        pub fp: usize,
        /// Number of paired tracks.
        pub tp_tracks: usize,
        /// Number of true tracks without a partner.
        pub fn_tracks: usize,
        /// Number of result tracks without a partner.
        pub fp_tracks: usize,
        /// 95 % bootstrap interval of alpha, resampling true tracks.
        fraction interval_alpha: Interval,
        /// 95 % bootstrap interval of beta.
        fraction interval_beta: Interval,
        /// 95 % bootstrap interval of JSC.
        fraction interval_jsc: Interval,
        /// 95 % bootstrap interval of JSC_theta.
        fraction interval_jsc_theta: Interval,
        /// 95 % bootstrap interval of RMSE.
        not_negative interval_rmse: Interval,
    }
}

impl Isbi {
    /// Scores a result; the gate is radial (2-D) or an ellipsoid (3-D). Also gives the sums over units of gain, length of
    /// true tracks and length of unpaired result tracks, all in frames.
    pub fn of(
        truth: &TrackSet,
        result: &TrackSet,
        gate: &Gate,
        units: &Units,
    ) -> Result<(Self, Vec<[f64; 3]>)> {
        let filled = fill_holes(truth, result);
        let reference = filled.as_ref().unwrap_or(truth);
        let points = within_gate(reference, result, gate)?;
        // Distances are in units of eps from here on.
        let candidates = candidates(reference, result, &points);
        let pairs: Vec<Pair> = candidates.iter().map(|c| c.0).collect();
        let chosen = max_weight_matching(reference.n_tracks(), result.n_tracks(), pairs.clone());

        let (n_true, n_result) = (reference.n_tracks(), result.n_tracks());
        let mut unpaired: f64 = (0..n_result).map(|t| length(result, t)).sum();
        let mut distances = Vec::new();
        // Sums per unit: gain, frames of references, frames of unpaired candidates, TP, union of points, union
        // of tracks, pairs, squared distances.
        let mut items: Vec<(u32, [f64; 8])> = Vec::with_capacity(n_true + result.len());
        for track in 0..n_true {
            let frames = length(reference, track);
            items.push((units.track_unit(track), [0.0, frames, 0.0, 0.0, frames, 1.0, 0.0, 0.0]));
        }
        let mut partner = vec![None; n_result];
        chosen
            .iter()
            .for_each(|pair| partner[pair.column as usize] = Some(units.track_unit(pair.row as usize)));
        for (track, partner) in partner.iter().enumerate() {
            let (points, frames) = (result.track(track), length(result, track));
            let share = 1.0 / points.len() as f64;
            items.extend(points.iter().map(|&j| {
                let unit = partner.unwrap_or(units.result_unit(j as usize));
                (unit, [0.0, 0.0, frames * share, 0.0, 1.0, share, 0.0, 0.0])
            }));
        }
        // As in the authors' program, interpolated points of a paired candidate beyond the ends of its
        // reference count as ghosts.
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
            // Paired points and tracks were counted twice.
            let more = [pair.value, 0.0, -length(result, column), tp, ghosts as f64 - tp, -1.0, 1.0, squares];
            items.push((units.track_unit(pair.row as usize), more));
        }
        let sums = units.sums(items.into_iter());
        let [interval_alpha, interval_beta, interval_jsc, interval_jsc_theta, interval_rmse] = units
            .intervals(&sums, |&[gain, frames, unpaired, tp, all, tracks, paired, squares]| {
                // Sums of shares differ by rounding.
                let share = |part, whole| ratio(part, whole).map(|share| share.min(1.0));
                [
                    share(gain, frames),
                    share(gain, frames + unpaired),
                    share(tp, all),
                    share(paired, tracks),
                    ratio(squares, tp).map(f64::sqrt),
                ]
            });
        let gain: f64 = chosen.iter().map(|p| p.value).sum();
        let all: f64 = (0..n_true).map(|t| length(reference, t)).sum();
        let (tp, paired) = (distances.len(), chosen.len());
        let (missed, fp) = (all as usize - tp, result.len() - tp + virtual_ghosts);
        let n = tp as f64;
        let mean = ratio(distances.iter().sum(), n);
        let spread = |m: f64| (distances.iter().map(|d| (d - m) * (d - m)).sum::<f64>() / n).sqrt();
        let score = Isbi {
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
            interval_alpha,
            interval_beta,
            interval_jsc,
            interval_jsc_theta,
            interval_rmse,
        };
        Ok((score, sums.iter().map(|s| [s[0], s[1], s[2]]).collect()))
    }
}

/// Frames from the first to the last point of a track.
fn length(cloud: &TrackSet, track: usize) -> f64 {
    let (first, last) = cloud.span(track);
    (last - first + 1) as f64
}

/// Pairs of tracks with the gain of pairing them, and the range of their points within the gate.
fn candidates(
    reference: &TrackSet,
    result: &TrackSet,
    points: &[(u32, u32, f64)],
) -> Vec<(Pair, std::ops::Range<usize>)> {
    let mut candidates = Vec::new();
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
    candidates
}

/// Pairs of points within the gate: true track, result track, distance in units of the gate; sorted by
/// tracks.
fn within_gate(reference: &TrackSet, result: &TrackSet, gate: &Gate) -> Result<Vec<(u32, u32, f64)>> {
    let mut points: Vec<(u32, u32, f64)> = Vec::new();
    for (frame, t, r) in side_by_side(reference, result) {
        let found = neighbor_pairs(&reference.points[t.clone()], &result.points[r.clone()], gate, 1.0);
        check_pair_count(points.len() + found.len(), frame, gate)?;
        points.extend(found.iter().map(|n| {
            let track = |cloud: &TrackSet, first: usize, i: u32| cloud.points[first + i as usize].track;
            (track(reference, t.start, n.truth), track(result, r.start, n.result), n.squared.sqrt())
        }));
    }
    points.sort_by_key(|p| (p.0, p.1));
    Ok(points)
}

/// Number of frames in gaps of a track that lie outside a span of frames.
fn holes_outside(cloud: &TrackSet, track: usize, (first, last): (i64, i64)) -> usize {
    let frame = |i: u32| i64::from(cloud.points[i as usize].frame);
    let outside = |(from, to): (i64, i64)| {
        // Frames from..to of a gap, minus those within the span.
        let inside = (to.min(last + 1) - from.max(first)).max(0);
        (to - from - inside).max(0) as usize
    };
    cloud.track(track).windows(2).map(|w| outside((frame(w[0]) + 1, frame(w[1])))).sum()
}

/// The truth with gaps filled by linear interpolation, in those frames that have result points. `None` if no
/// track has a gap.
fn fill_holes(truth: &TrackSet, result: &TrackSet) -> Option<TrackSet> {
    let holes =
        truth.links().any(|(a, b)| truth.points[b as usize].frame - truth.points[a as usize].frame > 1);
    if !holes {
        return None;
    }
    let loose = |p: &super::track_set::Point| UnsortedPoint {
        frame: p.frame,
        track: Some((i64::from(p.track), 0)),
        at: p.at,
        source: p.source,
    };
    let mut points: Vec<UnsortedPoint> = truth.points.iter().map(loose).collect();
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
            points.push(UnsortedPoint { frame: *frame, at, ..loose(a) });
        }
    }
    Some(TrackSet::new(points))
}
