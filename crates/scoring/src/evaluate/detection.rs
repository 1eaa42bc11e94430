//! Detection and localization scores (docs/scoring.md).

use super::matching::{Matching, NONE};
use super::statistics::{Errors, Interval, quantile, ratio, sorted};
use super::track_set::TrackSet;
use super::units::{Matched, Units};

scores! {
    /// Detection and localization over all frames; matched pairs by assignment A1.
    pub struct Detection {
        /// True positives: number of matched pairs.
        pub tp: usize,
        /// False negatives: number of true particles without a match.
        #[serde(rename = "fn")]
        pub missed: usize,
        /// False positives (ghosts): number of result points without a match.
        pub fp: usize,
        /// TP / (TP + FP); null without result points.
        fraction precision: Option<f64>,
        /// TP / (TP + FN); null without true particles.
        fraction recall: Option<f64>,
        /// Harmonic mean of precision and recall, 2 TP / (2 TP + FP + FN).
        fraction f1: Option<f64>,
        /// Jaccard index, TP / (TP + FP + FN).
        fraction jaccard: Option<f64>,
        /// Root mean square distance of matched pairs in the image plane.
        not_negative rmse_xy_px: Option<f64>,
        /// Root mean square error of x, over matched pairs: rmse^2 = bias^2 + random^2.
        not_negative rmse_x_px: Option<f64>,
        /// Root mean square error of y.
        not_negative rmse_y_px: Option<f64>,
        /// Root mean square error of z; null if depth is not scored.
        not_negative rmse_z_um: Option<f64>,
        /// Mean error of x, result - truth.
        pub bias_x_px: Option<f64>,
        /// Mean error of y, result - truth.
        pub bias_y_px: Option<f64>,
        /// Mean error of z, result - truth.
        pub bias_z_um: Option<f64>,
        /// Standard deviation of the error of x about its mean (over n, not n - 1).
        not_negative random_x_px: Option<f64>,
        /// Standard deviation of the error of y about its mean.
        not_negative random_y_px: Option<f64>,
        /// Standard deviation of the error of z about its mean.
        not_negative random_z_um: Option<f64>,
        /// Median distance of matched pairs in the image plane.
        not_negative p50_xy_px: Option<f64>,
        /// 95 % quantile of the distance of matched pairs in the image plane.
        not_negative p95_xy_px: Option<f64>,
        /// 95 % bootstrap interval of precision, resampling true tracks.
        fraction interval_precision: Interval,
        /// 95 % bootstrap interval of recall.
        fraction interval_recall: Interval,
        /// 95 % bootstrap interval of F1.
        fraction interval_f1: Interval,
        /// 95 % bootstrap interval of the Jaccard index.
        fraction interval_jaccard: Interval,
        /// 95 % bootstrap interval of rmse_xy_px.
        not_negative interval_rmse_xy_px: Interval,
        /// 95 % bootstrap interval of rmse_z_um.
        not_negative interval_rmse_z_um: Interval,
        /// 95 % bootstrap interval of bias_x_px.
        pub interval_bias_x_px: Interval,
        /// 95 % bootstrap interval of bias_y_px.
        pub interval_bias_y_px: Interval,
    }
}

/// Precision, recall, F1 and Jaccard index from counts of TP, FN and FP; `None` where docs/scoring.md leaves
/// them undefined.
pub fn rates(tp: f64, missed: f64, fp: f64) -> [Option<f64>; 4] {
    [
        ratio(tp, tp + fp),
        ratio(tp, tp + missed),
        ratio(2.0 * tp, 2.0 * tp + fp + missed),
        ratio(tp, tp + fp + missed),
    ]
}

/// Error of a matched pair (indices of the true and the result point): result - truth along x, y (px) and z
/// (um).
pub fn error(truth: &TrackSet, result: &TrackSet, pair: (usize, usize)) -> [f64; 3] {
    let (t, r) = (&truth.points[pair.0].at, &result.points[pair.1].at);
    [r.x_px - t.x_px, r.y_px - t.y_px, r.z_um - t.z_um]
}

/// Counts and sums of errors of one frame.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct FrameCounts {
    /// Number of the frame.
    pub frame: u32,
    /// TP, FN and FP.
    pub counts: [usize; 3],
    /// Sums of dx^2, dy^2 (px^2) and dz^2 (um^2) over matched pairs.
    pub axes: [f64; 3],
    /// Sums of dx and dy over matched pairs, px.
    pub sums: [f64; 2],
}

/// Counts and sums of errors of every frame with a true or a result point.
pub fn per_frame(truth: &TrackSet, result: &TrackSet, matching: &Matching) -> Vec<FrameCounts> {
    super::track_set::side_by_side(truth, result)
        .into_iter()
        .map(|(frame, t, r)| {
            let mut row = FrameCounts { frame, ..FrameCounts::default() };
            let (n, m) = (t.len(), r.len());
            for i in t.filter(|&i| matching.result_for[i] != NONE) {
                let [dx, dy, dz] = error(truth, result, (i, matching.result_for[i] as usize));
                row.counts[0] += 1;
                row.axes.iter_mut().zip([dx, dy, dz]).for_each(|(s, d)| *s += d * d);
                row.sums[0] += dx;
                row.sums[1] += dy;
            }
            row.counts[1] = n - row.counts[0];
            row.counts[2] = m - row.counts[0];
            row
        })
        .collect()
}

/// A frame is missing if it has less than this fraction of the matches expected from the recall.
const FEW_MATCHES: f64 = 0.25;

/// Number of frames with true particles in which the result has less than a quarter of the matches expected
/// from the recall of all frames, regardless of ghosts. 0 if the recall explains them: if each particle were
/// found independently with that probability, this number would be no more than three standard deviations
/// above its expectation.
pub fn missing_frames(frames: &[FrameCounts]) -> usize {
    let with_truth = || frames.iter().filter(|f| f.counts[0] + f.counts[1] > 0);
    let (found, all) =
        with_truth().fold((0, 0), |(found, all), f| (found + f.counts[0], all + f.counts[0] + f.counts[1]));
    let recall = ratio(found as f64, all as f64).unwrap_or(0.0);
    let most = |f: &FrameCounts| (FEW_MATCHES * recall * (f.counts[0] + f.counts[1]) as f64).floor();
    // The binomial probability of so few matches in a frame of n particles.
    let chance = |f: &FrameCounts| {
        let n = (f.counts[0] + f.counts[1]) as f64;
        let mut term = (1.0 - recall).powf(n);
        let mut sum = term;
        for k in 0..most(f) as usize {
            let k = k as f64;
            term *= (n - k) / (k + 1.0) * recall / (1.0 - recall).max(f64::MIN_POSITIVE);
            sum += term;
        }
        sum.min(1.0)
    };
    let (expected, variance) =
        with_truth().map(chance).fold((0.0, 0.0), |(mean, variance), p| (mean + p, variance + p * (1.0 - p)));
    let missing = with_truth().filter(|f| f.counts[0] as f64 <= most(f)).count();
    if missing as f64 > expected + 3.0 * variance.sqrt() { missing } else { 0 }
}

impl Detection {
    /// Scores a matching; `depth`: whether z is scored. Also gives the sums over units: TP, FN, FP, squared
    /// errors in the image plane (px^2) and along z (um^2), errors of x and y (px).
    pub fn of(
        truth: &TrackSet,
        result: &TrackSet,
        matching: &Matching,
        depth: bool,
        units: &Units,
    ) -> (Self, Vec<[f64; 7]>) {
        let pairs: Vec<(usize, usize)> = matching.pairs().collect();
        let (tp, missed, fp) = (pairs.len(), truth.len() - pairs.len(), result.len() - pairs.len());
        let [precision, recall, f1, jaccard] = rates(tp as f64, missed as f64, fp as f64);
        let errors: Vec<[f64; 3]> = pairs.iter().map(|&p| error(truth, result, p)).collect();
        let axis = |k: usize| Errors::of(errors.iter().map(move |e| e[k]));
        let (x, y, z) = (axis(0), axis(1), if depth { axis(2) } else { Errors::default() });
        let distances = sorted(errors.iter().map(|e| (e[0] * e[0] + e[1] * e[1]).sqrt()));

        let sums = units.sums(units.matched(matching).map(|(unit, point)| {
            let sums = match point {
                Matched::Pair(i, j) => {
                    let [dx, dy, dz] = error(truth, result, (i, j));
                    [1.0, 0.0, 0.0, dx * dx + dy * dy, dz * dz, dx, dy]
                }
                Matched::Missed(_) => [0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0],
                Matched::Ghost => [0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0],
            };
            (unit, sums)
        }));
        let root = |s: f64, n: f64| ratio(s, n).map(f64::sqrt);
        let mut score = Detection {
            tp,
            missed,
            fp,
            precision,
            recall,
            f1,
            jaccard,
            rmse_xy_px: x.rms.zip(y.rms).map(|(x, y)| (x * x + y * y).sqrt()),
            rmse_x_px: x.rms,
            rmse_y_px: y.rms,
            rmse_z_um: z.rms,
            bias_x_px: x.bias,
            bias_y_px: y.bias,
            bias_z_um: z.bias,
            random_x_px: x.random,
            random_y_px: y.random,
            random_z_um: z.random,
            p50_xy_px: quantile(&distances, 0.5),
            p95_xy_px: quantile(&distances, 0.95),
            ..Detection::default()
        };
        [
            score.interval_precision,
            score.interval_recall,
            score.interval_f1,
            score.interval_jaccard,
            score.interval_rmse_xy_px,
            score.interval_rmse_z_um,
            score.interval_bias_x_px,
            score.interval_bias_y_px,
        ] = units.intervals(&sums, |&[tp, missed, fp, xy, z, dx, dy]| {
            let [precision, recall, f1, jaccard] = rates(tp, missed, fp);
            let z = root(z, tp).filter(|_| depth);
            [precision, recall, f1, jaccard, root(xy, tp), z, ratio(dx, tp), ratio(dy, tp)]
        });
        (score, sums)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn frame(tp: usize, missed: usize) -> FrameCounts {
        FrameCounts { counts: [tp, missed, 0], ..FrameCounts::default() }
    }

    #[test]
    fn frames_are_missing_if_recall_does_not_explain_them() {
        let mut frames = vec![frame(9, 1); 20];
        assert_eq!(missing_frames(&frames), 0);
        frames[7] = frame(0, 10);
        assert_eq!(missing_frames(&frames), 1);
        // A ghost is not a match, and neither a match nor two make a frame of ten particles complete.
        frames[7].counts[2] = 1;
        assert_eq!(missing_frames(&frames), 1);
        frames[3] = frame(2, 8);
        assert_eq!(missing_frames(&frames), 2);
        frames[3] = frame(5, 5);
        assert_eq!(missing_frames(&frames), 1);
        // Of single particles half are found: half of the frames are empty.
        let single: Vec<FrameCounts> = (0..40).map(|k| frame(k % 2, 1 - k % 2)).collect();
        assert_eq!(missing_frames(&single), 0);
        // Of 16 frames with four particles, half of which are found, one is empty by chance, and three are within
        // three standard deviations.
        let chance = [vec![frame(3, 1); 6], vec![frame(2, 2); 7], vec![frame(0, 4); 3]].concat();
        assert_eq!(missing_frames(&chance), 0);
        assert_eq!(missing_frames(&[frame(0, 3), frame(0, 3)]), 0);
    }
}
