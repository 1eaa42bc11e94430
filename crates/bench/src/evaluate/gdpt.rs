//! Scores of defocus particle tracking (Barnkob and Rossi, Exp. Fluids 61:110, 2020; DefocusTracker's `compare_true`).
//!
//! Points are matched greedily by distance in the image plane among those in a closed box (A2). sigma is the root of the
//! mean square error, about zero: bias is part of it. phi = matched / true particles. Local curves: nodes at equal steps
//! of Z = (z - z_0) / h, windows of one step to either side; ghosts lie where they were measured.

use serde::Serialize;

use super::cloud::Cloud;
use super::detection::{error, per_frame};
use super::gate::{Edge, Gate, Shape};
use super::matching::{NONE, greedy};
use super::statistics::{Bootstrap, Errors, Interval, ratio};
use crate::error::Result;

/// Nodes of the local curves.
pub const NODES: usize = 21;

/// The scores.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
#[allow(missing_docs)]
pub struct Gdpt {
    pub gate_xy_px: f64,
    pub gate_z_um: f64,
    pub tp: usize,
    #[serde(rename = "fn")]
    pub missed: usize,
    pub fp: usize,
    pub phi: Option<f64>,
    pub precision: Option<f64>,
    pub sigma_x_px: Option<f64>,
    pub sigma_y_px: Option<f64>,
    pub sigma_z_um: Option<f64>,
    pub sigma_z_over_h: Option<f64>,
    pub bias_x_px: Option<f64>,
    pub bias_y_px: Option<f64>,
    pub bias_z_um: Option<f64>,
    /// Share of particles, matched in the image plane alone, that are more than h/10 off in depth.
    pub rate_outlier: Option<f64>,
    /// 95 % intervals under resampling of frames.
    pub interval: Intervals,
    /// Local curves.
    pub curve: Vec<Node>,
}

/// 95 % intervals.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
#[allow(missing_docs)]
pub struct Intervals {
    pub phi: Interval,
    pub precision: Interval,
    pub sigma_x_px: Interval,
    pub sigma_y_px: Interval,
    pub sigma_z_um: Interval,
    pub sigma_z_over_h: Interval,
}

/// A node of the local curves.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
#[allow(missing_docs)]
pub struct Node {
    pub z_over_h: f64,
    pub n_true: usize,
    pub tp: usize,
    pub recall: Option<f64>,
    pub precision: Option<f64>,
    pub sigma_x_px: Option<f64>,
    pub sigma_y_px: Option<f64>,
    pub sigma_z_um: Option<f64>,
}

impl Gdpt {
    /// Of truth and result with depth; `range` is the least and greatest depth.
    ///
    /// # Errors
    /// A gate that is too wide.
    pub fn of(
        truth: &Cloud,
        result: &Cloud,
        (xy_px, z_um): (f64, f64),
        range: (f64, f64),
        bootstrap: &Bootstrap,
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

        let units = bootstrap.by_frame(per_frame(truth, result, &matching).iter().map(|f| {
            let [tp, missed, fp] = f.counts.map(|n| n as f64);
            let [x, y, z] = f.axes;
            (f.frame, [tp, tp + missed, tp + fp, x, y, z])
        }));
        let [phi, precision, sigma_x_px, sigma_y_px, sigma_z_um, sigma_z_over_h] =
            bootstrap.intervals(&units, |&[tp, n, m, x, y, z]| {
                let [x, y, z] = [x, y, z].map(|s| ratio(s, tp).map(f64::sqrt));
                [ratio(tp, n), ratio(tp, m), x, y, z, z.map(|z| z / h)]
            });

        let flat = greedy(truth, result, &Gate { z_um: f64::INFINITY, ..gate })?;
        let wrong = flat.pairs().filter(|&p| error(truth, result, p)[2].abs() > h / 10.0).count();

        let share = |cloud: &Cloud, i: usize| (cloud.points[i].at.z_um - low) / h;
        let step = 1.0 / (NODES - 1) as f64;
        let curve = (0..NODES)
            .map(|k| {
                let node = k as f64 * step;
                // Depths on the edge of a window belong to it, whatever rounding says.
                let inside = |z: f64| (z - node).abs() <= step + 1e-12;
                let n_true = (0..truth.len()).filter(|&i| inside(share(truth, i))).count();
                let fp = (0..result.len())
                    .filter(|&i| matching.of_result[i] == NONE && inside(share(result, i)))
                    .count();
                let local: Vec<[f64; 3]> = errors.iter().filter(|e| inside(e.0)).map(|e| e.1).collect();
                let axis = |k: usize| Errors::of(local.iter().map(move |e| e[k])).rms;
                let tp = local.len();
                Node {
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
        Ok(Gdpt {
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
            interval: Intervals { phi, precision, sigma_x_px, sigma_y_px, sigma_z_um, sigma_z_over_h },
            curve,
        })
    }
}
