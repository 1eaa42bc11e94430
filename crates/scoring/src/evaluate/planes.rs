//! Errors of depth where all particles of a frame are in a plane of known height, as in recordings of a
//! calibration target: positions in the image need not be known.

use std::collections::BTreeMap;

use serde::Serialize;

use super::EvaluateOptions;
use super::statistics::{Errors, quantile, ratio};
use crate::results::Points;
use dataset::manifest::ScoringGates;
use dataset::{PlaneRow, RecordingFacts};

/// Bins over the distance from the middle of the image.
const RADIUS_BINS: usize = 8;

/// Number of heights up to which each is a bin of its own, and number of bins if there are more.
const MOST_HEIGHTS: usize = 200;
const HEIGHT_BINS: usize = 40;

scores! {
    /// Errors of z against the heights of planes. Bias, random and RMS error are those of the points within the
    /// gate in depth, as for matched particles; quantiles are those of all points.
    pub struct PlaneScore {
        /// Number of frames whose plane is known.
        pub frames: usize,
        /// Number of result points in these frames.
        pub n: usize,
        /// Gate in depth.
        not_negative gate_z_um: f64,
        /// Number of points within the gate.
        pub n_within: usize,
        /// n_within / n.
        fraction share_within: Option<f64>,
        /// Root mean square error of z: rmse^2 = bias^2 + random^2.
        not_negative rmse_z_um: Option<f64>,
        /// Mean error of z, result - height of the plane.
        pub bias_z_um: Option<f64>,
        /// Standard deviation of the error about its mean.
        not_negative random_z_um: Option<f64>,
        /// Median distance from the plane, of all points.
        not_negative p50_z_um: Option<f64>,
        /// 68 % quantile of the distance from the plane, of all points.
        not_negative p68_z_um: Option<f64>,
        /// 95 % quantile of the distance from the plane, of all points.
        not_negative p95_z_um: Option<f64>,
        /// The same over the height of the plane, um.
        pub over_height: Vec<PlaneBin>,
        /// The same over the distance from the middle of the image, px; empty if the size of the images is
        /// unknown.
        pub over_radius: Vec<PlaneBin>,
    }

    /// A bin of these errors.
    pub struct PlaneBin {
        /// Lower end of the bin.
        pub from: f64,
        /// Upper end of the bin.
        pub to: f64,
        /// Number of points.
        pub n: usize,
        /// Share of the points within the gate.
        fraction share_within: Option<f64>,
        /// Mean error of z.
        pub bias_z_um: Option<f64>,
        /// Standard deviation of the error of z.
        not_negative random_z_um: Option<f64>,
        /// RMS error of z.
        not_negative rms_z_um: Option<f64>,
    }
}

/// A result point in a frame whose plane is known.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct PlanePoint {
    /// Number of the frame.
    pub frame: u32,
    /// Column.
    pub x_px: f64,
    /// Row.
    pub y_px: f64,
    /// Height of the plane.
    pub height_um: f64,
    /// Depth in the result - height of the plane.
    pub error_um: f64,
    /// Distance from the middle of the image; NaN if its size is unknown.
    #[serde(skip)]
    radius_px: f64,
}

impl PlaneScore {
    /// Scores the points in frames whose plane is known; also returns them.
    pub fn of(
        planes: &[PlaneRow],
        points: &Points,
        facts: &RecordingFacts,
        options: &EvaluateOptions,
    ) -> (Self, Vec<PlanePoint>) {
        let heights: BTreeMap<u32, f64> = planes.iter().map(|row| (row.frame, row.z_um)).collect();
        let default = facts.depth_h_um().map_or(f64::INFINITY, |h| ScoringGates::over(h).z_um);
        let gate_z_um = options.gate_z_um.unwrap_or(default);
        let middle = facts.sensor_px.map(|(w, h)| [0.5 * (w + 1.0), 0.5 * (h + 1.0)]);
        let is_clear = |x: f64, y: f64| {
            let within =
                |v: f64, size: f64| v >= 0.5 + options.border_px && v < size + 0.5 - options.border_px;
            options.border_px <= 0.0 || facts.sensor_px.is_none_or(|(w, h)| within(x, w) && within(y, h))
        };
        let point = |row: &crate::results::TrackRow| {
            let height_um = *heights.get(&row.frame)?;
            let radius_px = middle.map_or(f64::NAN, |[x, y]| (row.at.x_px - x).hypot(row.at.y_px - y));
            let (frame, x_px, y_px) = (row.frame, row.at.x_px, row.at.y_px);
            let point =
                PlanePoint { frame, x_px, y_px, height_um, error_um: row.at.z_um - height_um, radius_px };
            is_clear(row.at.x_px, row.at.y_px).then_some(point)
        };
        let all: Vec<PlanePoint> = points.rows.iter().filter_map(point).collect();
        let whole = bin(&all, gate_z_um, (0.0, 0.0));
        let mut away: Vec<f64> = all.iter().map(|point| point.error_um.abs()).collect();
        away.sort_unstable_by(f64::total_cmp);
        let score = PlaneScore {
            frames: heights.len(),
            n: all.len(),
            gate_z_um,
            n_within: all.iter().filter(|point| point.error_um.abs() < gate_z_um).count(),
            share_within: whole.share_within,
            rmse_z_um: whole.rms_z_um,
            bias_z_um: whole.bias_z_um,
            random_z_um: whole.random_z_um,
            p50_z_um: quantile(&away, 0.5),
            p68_z_um: quantile(&away, 0.68),
            p95_z_um: quantile(&away, 0.95),
            over_height: over_height(&all, gate_z_um, heights.into_values().collect()),
            over_radius: facts.sensor_px.map_or_else(Vec::new, |(w, h)| {
                let width = 0.5 * w.hypot(h) / RADIUS_BINS as f64;
                let edges = (0..RADIUS_BINS).map(|k| (width * k as f64, width * (k + 1) as f64));
                binned(&all, gate_z_um, edges, |point| point.radius_px)
            }),
        };
        (score, all)
    }
}

fn over_height(all: &[PlanePoint], gate_z_um: f64, mut heights: Vec<f64>) -> Vec<PlaneBin> {
    heights.sort_by(f64::total_cmp);
    heights.dedup();
    let height = |point: &PlanePoint| point.height_um;
    if heights.len() <= MOST_HEIGHTS {
        let one = |z: &f64| {
            let inside: Vec<PlanePoint> = all.iter().filter(|point| point.height_um == *z).copied().collect();
            bin(&inside, gate_z_um, (*z, *z))
        };
        return heights.iter().map(one).collect();
    }
    let (low, high) = (heights[0], heights[heights.len() - 1]);
    // Slightly wider, so that the last bin contains the greatest height.
    let width = (high - low) * (1.0 + 1e-9) / HEIGHT_BINS as f64;
    let edges = (0..HEIGHT_BINS).map(|k| (low + width * k as f64, low + width * (k + 1) as f64));
    binned(all, gate_z_um, edges, height)
}

fn binned(
    all: &[PlanePoint],
    gate_z_um: f64,
    edges: impl Iterator<Item = (f64, f64)>,
    of: impl Fn(&PlanePoint) -> f64,
) -> Vec<PlaneBin> {
    let one = |(from, to): (f64, f64)| {
        let inside: Vec<PlanePoint> =
            all.iter().filter(|point| (from..to).contains(&of(point))).copied().collect();
        bin(&inside, gate_z_um, (from, to))
    };
    edges.map(one).collect()
}

fn bin(points: &[PlanePoint], gate_z_um: f64, (from, to): (f64, f64)) -> PlaneBin {
    let within: Vec<f64> =
        points.iter().map(|point| point.error_um).filter(|e| e.abs() < gate_z_um).collect();
    let errors = Errors::of(within.iter().copied());
    PlaneBin {
        from,
        to,
        n: points.len(),
        share_within: ratio(within.len() as f64, points.len() as f64),
        bias_z_um: errors.bias,
        random_z_um: errors.random,
        rms_z_um: errors.rms,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::results::{Position, TrackRow};

    #[test]
    fn depths_are_compared_with_their_plane() {
        let at = |frame: u32, x_px: f64, z_um: f64| TrackRow {
            frame,
            track: -1,
            at: Position { x_px, y_px: 50.5, z_um },
        };
        let rows =
            vec![at(0, 50.5, 11.0), at(0, 60.5, 9.0), at(1, 50.5, -18.0), at(1, 90.5, 30.0), at(2, 1.0, 0.0)];
        let points = Points { rows, has_z: true, ..Points::default() };
        let planes = [PlaneRow { frame: 0, z_um: 10.0 }, PlaneRow { frame: 1, z_um: -20.0 }];
        let facts = RecordingFacts {
            sensor_px: Some((100.0, 100.0)),
            depth_um: Some((-40.0, 40.0)),
            ..RecordingFacts::default()
        };
        let (score, _) = PlaneScore::of(&planes, &points, &facts, &EvaluateOptions::default());
        assert_eq!((score.frames, score.n, score.n_within, score.gate_z_um), (2, 4, 3, 8.0));
        assert_eq!((score.bias_z_um, score.rmse_z_um), (Some(2.0 / 3.0), Some(2f64.sqrt())));
        assert_eq!(
            score.over_height.iter().map(|b| (b.from, b.n, b.bias_z_um)).collect::<Vec<_>>(),
            [(-20.0, 2, Some(2.0)), (10.0, 2, Some(0.0))]
        );
        assert_eq!(score.over_radius.iter().map(|b| b.n).sum::<usize>(), 4);
        assert_eq!(score.p50_z_um, Some(1.5));
        let narrow = EvaluateOptions { border_px: 15.0, ..EvaluateOptions::default() };
        assert_eq!(PlaneScore::of(&planes, &points, &facts, &narrow).0.n, 3);
    }
}
