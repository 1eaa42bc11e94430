//! Detection and localisation: which particles were found, and how well (docs/scoring.md).

use serde::Serialize;

use super::cloud::Cloud;
use super::matching::Matching;
use super::statistics::{Bootstrap, Errors, Interval, quantile, ratio};

/// Counts and errors over all frames.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
#[allow(missing_docs)]
pub struct Detection {
    pub tp: usize,
    #[serde(rename = "fn")]
    pub missed: usize,
    pub fp: usize,
    pub precision: Option<f64>,
    pub recall: Option<f64>,
    pub f1: Option<f64>,
    pub jaccard: Option<f64>,
    pub rmse_xy_px: Option<f64>,
    pub rmse_x_px: Option<f64>,
    pub rmse_y_px: Option<f64>,
    pub rmse_z_um: Option<f64>,
    pub bias_x_px: Option<f64>,
    pub bias_y_px: Option<f64>,
    pub bias_z_um: Option<f64>,
    pub random_x_px: Option<f64>,
    pub random_y_px: Option<f64>,
    pub random_z_um: Option<f64>,
    pub p50_xy_px: Option<f64>,
    pub p95_xy_px: Option<f64>,
    /// 95 % intervals of the bootstrap over frames, or over pairs of frames in pair recordings.
    pub interval: Intervals,
}

/// 95 % intervals.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
#[allow(missing_docs)]
pub struct Intervals {
    pub precision: Interval,
    pub recall: Interval,
    pub f1: Interval,
    pub jaccard: Interval,
    pub rmse_xy_px: Interval,
    pub rmse_z_um: Interval,
    pub bias_x_px: Interval,
    pub bias_y_px: Interval,
}

/// Precision, recall, F1 and Jaccard index of counts, as docs/scoring.md defines them in degenerate cases.
pub fn rates(tp: f64, missed: f64, fp: f64) -> [Option<f64>; 4] {
    [
        ratio(tp, tp + fp),
        ratio(tp, tp + missed),
        ratio(2.0 * tp, 2.0 * tp + fp + missed),
        ratio(tp, tp + fp + missed),
    ]
}

/// Error of a matched pair: result - truth along x, y (px) and z (um).
pub fn error(truth: &Cloud, result: &Cloud, pair: (usize, usize)) -> [f64; 3] {
    let (t, r) = (&truth.points[pair.0].at, &result.points[pair.1].at);
    [r.x_px - t.x_px, r.y_px - t.y_px, r.z_um - t.z_um]
}

/// Counts of one frame.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct FrameCounts {
    /// Frame.
    pub frame: u32,
    /// Found, missed and ghost particles.
    pub counts: [usize; 3],
    /// Sums of dx^2, dy^2 and dz^2 over found particles.
    pub axes: [f64; 3],
    /// Sums of dx and dy.
    pub sums: [f64; 2],
}

/// Counts per frame.
pub fn per_frame(truth: &Cloud, result: &Cloud, matching: &Matching) -> Vec<FrameCounts> {
    super::cloud::side_by_side(truth, result)
        .into_iter()
        .map(|(frame, t, r)| {
            let mut row = FrameCounts { frame, ..FrameCounts::default() };
            let (n, m) = (t.len(), r.len());
            for i in t.filter(|&i| matching.of_truth[i] != super::matching::NONE) {
                let [dx, dy, dz] = error(truth, result, (i, matching.of_truth[i] as usize));
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

impl Detection {
    /// Of a matching; `depth` tells whether z is scored.
    pub fn of(
        truth: &Cloud,
        result: &Cloud,
        matching: &Matching,
        depth: bool,
        bootstrap: &Bootstrap,
    ) -> Self {
        let pairs: Vec<(usize, usize)> = matching.pairs().collect();
        let (tp, missed, fp) = (pairs.len(), truth.len() - pairs.len(), result.len() - pairs.len());
        let [precision, recall, f1, jaccard] = rates(tp as f64, missed as f64, fp as f64);
        let errors: Vec<[f64; 3]> = pairs.iter().map(|&p| error(truth, result, p)).collect();
        let axis = |k: usize| Errors::of(errors.iter().map(move |e| e[k]));
        let (x, y, z) = (axis(0), axis(1), if depth { axis(2) } else { Errors::default() });
        let mut distances: Vec<f64> = errors.iter().map(|e| (e[0] * e[0] + e[1] * e[1]).sqrt()).collect();
        distances.sort_unstable_by(f64::total_cmp);

        let units = bootstrap.by_frame(per_frame(truth, result, matching).iter().map(|f| {
            let [tp, missed, fp] = f.counts.map(|n| n as f64);
            (f.frame, [tp, missed, fp, f.axes[0] + f.axes[1], f.axes[2], f.sums[0], f.sums[1]])
        }));
        let root = |s: f64, n: f64| ratio(s, n).map(f64::sqrt);
        let [i_precision, i_recall, i_f1, i_jaccard, i_xy, i_z, i_bias_x, i_bias_y] =
            bootstrap.intervals(&units, |&[tp, missed, fp, xy, z, dx, dy]| {
                let [precision, recall, f1, jaccard] = rates(tp, missed, fp);
                let z = root(z, tp).filter(|_| depth);
                [precision, recall, f1, jaccard, root(xy, tp), z, ratio(dx, tp), ratio(dy, tp)]
            });
        Detection {
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
            interval: Intervals {
                precision: i_precision,
                recall: i_recall,
                f1: i_f1,
                jaccard: i_jaccard,
                rmse_xy_px: i_xy,
                rmse_z_um: i_z,
                bias_x_px: i_bias_x,
                bias_y_px: i_bias_y,
            },
        }
    }
}
