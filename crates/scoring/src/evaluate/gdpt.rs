//! Scores of defocus particle tracking (Barnkob and Rossi, Exp. Fluids 61:110, 2020; DefocusTracker's
//! `compare_true`).
//!
//! Points within a closed box are matched greedily by their distance in the image plane (A2). sigma is the
//! RMS error about zero, so it includes bias. phi = matched / true particles. Local curves: equally spaced
//! nodes of Z = (z - z_0) / h, with windows of one step to either side; ghosts are counted at their measured
//! depth.

use super::detection::error;
use super::gate::{Edge, Gate, Shape};
use super::matching::{NONE, greedy};
use super::statistics::{Errors, Interval, ratio};
use super::track_set::TrackSet;
use super::units::{Matched, Units};
use storage::error::Result;

/// Number of nodes of the local curves.
pub const NODES: usize = 21;

scores! {
    /// General defocusing particle tracking (Barnkob and Rossi, Exp. Fluids 61, 110, 2020); assignment A2, closed
    /// box gate.
    pub struct Gdpt {
        /// Half width of the box in x and y.
        not_negative gate_xy_px: f64,
        /// Half height of the box in z.
        not_negative gate_z_um: f64,
        /// Number of matched pairs.
        pub tp: usize,
        /// Number of true particles without a match.
        #[serde(rename = "fn")]
        pub missed: usize,
        /// Number of result points without a match.
        pub fp: usize,
        /// Relative number of measured particles: matched / true particles.
        fraction phi: Option<f64>,
        /// TP / (TP + FP).
        fraction precision: Option<f64>,
        /// Root mean square error of x about zero; includes bias.
        not_negative sigma_x_px: Option<f64>,
        /// Root mean square error of y about zero.
        not_negative sigma_y_px: Option<f64>,
        /// Root mean square error of z about zero.
        not_negative sigma_z_um: Option<f64>,
        /// sigma_z_um over the depth range h.
        not_negative sigma_z_over_h: Option<f64>,
        /// Mean error of x.
        pub bias_x_px: Option<f64>,
        /// Mean error of y.
        pub bias_y_px: Option<f64>,
        /// Mean error of z.
        pub bias_z_um: Option<f64>,
        /// Fraction of particles with |dz| > h / 10 among those matched in the image plane only.
        fraction rate_outlier: Option<f64>,
        /// 95 % bootstrap interval of phi, resampling true tracks.
        fraction interval_phi: Interval,
        /// 95 % bootstrap interval of precision.
        fraction interval_precision: Interval,
        /// 95 % bootstrap interval of sigma_x_px.
        not_negative interval_sigma_x_px: Interval,
        /// 95 % bootstrap interval of sigma_y_px.
        not_negative interval_sigma_y_px: Interval,
        /// 95 % bootstrap interval of sigma_z_um.
        not_negative interval_sigma_z_um: Interval,
        /// 95 % bootstrap interval of sigma_z_over_h.
        not_negative interval_sigma_z_over_h: Interval,
        /// Local scores at 21 depths Z = (z - z_0) / h, in windows of +- 1/20.
        pub curve: Vec<DepthNode>,
    }

    /// Local scores at one depth.
    pub struct DepthNode {
        /// Depth of the node, Z = (z - z_0) / h.
        fraction z_over_h: f64,
        /// Number of true particles in the window.
        pub n_true: usize,
        /// Number of matched true particles in the window.
        pub tp: usize,
        /// tp / n_true.
        fraction recall: Option<f64>,
        /// tp / (tp + ghosts measured in the window).
        fraction precision: Option<f64>,
        /// RMS error of x.
        not_negative sigma_x_px: Option<f64>,
        /// RMS error of y.
        not_negative sigma_y_px: Option<f64>,
        /// RMS error of z.
        not_negative sigma_z_um: Option<f64>,
    }
}

impl Gdpt {
    /// Scores a result with depth. Arguments: half width (px) and half height (um) of the box, and the depth
    /// range (um).
    pub fn of(
        truth: &TrackSet,
        result: &TrackSet,
        (xy_px, z_um): (f64, f64),
        range: (f64, f64),
        units: &Units,
    ) -> Result<Self> {
        let gate = Gate { shape: Shape::Box, xy_px, z_um, edge: Edge::Closed };
        let matching = greedy(truth, result, &gate)?;
        let (low, h) = (range.0, range.1 - range.0);
        let errors: Vec<(f64, [f64; 3])> = matching
            .pairs()
            .map(|p| ((truth.points[p.0].at.z_um - low) / h, error(truth, result, p)))
            .collect();
        let axis = |k: usize| Errors::of(errors.iter().map(move |e| e.1[k]));
        let (x, y, z) = (axis(0), axis(1), axis(2));
        let tp = errors.len();

        let sums = units.sums(units.matched(&matching).map(|(unit, point)| {
            let sums = match point {
                Matched::Pair(i, j) => {
                    let [x, y, z] = error(truth, result, (i, j)).map(|e| e * e);
                    [1.0, 1.0, 1.0, x, y, z]
                }
                Matched::Missed(_) => [0.0, 1.0, 0.0, 0.0, 0.0, 0.0],
                Matched::Ghost => [0.0, 0.0, 1.0, 0.0, 0.0, 0.0],
            };
            (unit, sums)
        }));

        let flat = greedy(truth, result, &Gate { z_um: f64::INFINITY, ..gate })?;
        let wrong = flat.pairs().filter(|&p| error(truth, result, p)[2].abs() > h / 10.0).count();

        let share = |cloud: &TrackSet, i: usize| (cloud.points[i].at.z_um - low) / h;
        let step = 1.0 / (NODES - 1) as f64;
        let curve = (0..NODES)
            .map(|k| {
                let node = k as f64 * step;
                // Windows include their edges; the tolerance absorbs rounding errors.
                let inside = |z: f64| (z - node).abs() <= step + 1e-12;
                let n_true = (0..truth.len()).filter(|&i| inside(share(truth, i))).count();
                let fp = (0..result.len())
                    .filter(|&i| matching.truth_for[i] == NONE && inside(share(result, i)))
                    .count();
                let local: Vec<[f64; 3]> = errors.iter().filter(|e| inside(e.0)).map(|e| e.1).collect();
                let axis = |k: usize| Errors::of(local.iter().map(move |e| e[k])).rms;
                let tp = local.len();
                DepthNode {
                    z_over_h: node,
                    n_true,
                    tp,
                    recall: ratio(tp as f64, n_true as f64),
                    precision: ratio(tp as f64, (tp + fp) as f64),
                    sigma_x_px: axis(0),
                    sigma_y_px: axis(1),
                    sigma_z_um: axis(2),
                }
            })
            .collect();
        let mut score = Gdpt {
            gate_xy_px: xy_px,
            gate_z_um: z_um,
            tp,
            missed: truth.len() - tp,
            fp: result.len() - tp,
            phi: ratio(tp as f64, truth.len() as f64),
            precision: ratio(tp as f64, result.len() as f64),
            sigma_x_px: x.rms,
            sigma_y_px: y.rms,
            sigma_z_um: z.rms,
            sigma_z_over_h: z.rms.map(|s| s / h),
            bias_x_px: x.bias,
            bias_y_px: y.bias,
            bias_z_um: z.bias,
            rate_outlier: ratio(wrong as f64, flat.pairs().count() as f64),
            curve,
            ..Gdpt::default()
        };
        [
            score.interval_phi,
            score.interval_precision,
            score.interval_sigma_x_px,
            score.interval_sigma_y_px,
            score.interval_sigma_z_um,
            score.interval_sigma_z_over_h,
        ] = units.intervals(&sums, |&[tp, n, m, x, y, z]| {
            let [x, y, z] = [x, y, z].map(|s| ratio(s, tp).map(f64::sqrt));
            [ratio(tp, n), ratio(tp, m), x, y, z, z.map(|z| z / h)]
        });
        Ok(score)
    }
}
