//! Errors of depth where all particles of a frame are in a plane of known height, as in recordings of a
//! calibration target: positions in the image need not be known.

use std::collections::BTreeMap;

use serde::Serialize;

use super::EvaluateOptions;
use super::statistics::{Errors, distinct, median, quantile, ratio, sorted};
use crate::results::Points;
use storage::dataset::manifest::ScoringGates;
use storage::dataset::{PlaneRow, RecordingFacts};

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
        /// Share of the points on the other side of the focus than their plane, of planes farther from it than the gate;
        /// null without such planes.
        fraction wrong_side: Option<f64>,
        /// The same against planes that are fitted to the points: a tilt and a shift of each height are no errors.
        pub fitted: Option<FittedPlanes>,
        /// The same over the height of the plane, um.
        pub over_height: Vec<PlaneBin>,
        /// The same over the distance from the middle of the image, px; empty if the size of the images is
        /// unknown.
        pub over_radius: Vec<PlaneBin>,
    }

    /// Errors of z against a plane fitted to the points of each height: by least squares in x and y, first to the points within
    /// the gate of the given height, then, until they no longer change, to those within three robust standard deviations of
    /// the fitted plane. The height alone is fitted to fewer than 12 points. Null if no height has three points.
    pub struct FittedPlanes {
        /// Number of planes.
        pub n: usize,
        /// Share of all points within the gate of their fitted plane.
        fraction share_within: Option<f64>,
        /// Root mean square distance of these along z.
        not_negative rms_z_um: Option<f64>,
        /// Median distance, of all points.
        not_negative p50_z_um: Option<f64>,
        /// 68 % quantile of the distance, of all points.
        not_negative p68_z_um: Option<f64>,
        /// Root mean square over the planes of the height of the fitted plane at the mean position of its points less the given
        /// height.
        not_negative rms_shift_um: Option<f64>,
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
        let away = sorted(all.iter().map(|point| point.error_um.abs()));
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
            wrong_side: facts.focus_um.and_then(|focus_um| wrong_side(&all, gate_z_um, focus_um)),
            fitted: FittedPlanes::of(&all, gate_z_um),
            over_height: over_height(&all, gate_z_um, heights.into_values()),
            over_radius: facts.sensor_px.map_or_else(Vec::new, |(w, h)| {
                let width = 0.5 * w.hypot(h) / RADIUS_BINS as f64;
                let edges = (0..RADIUS_BINS).map(|k| (width * k as f64, width * (k + 1) as f64));
                binned(&all, gate_z_um, edges, |point| point.radius_px)
            }),
        };
        (score, all)
    }
}

fn wrong_side(all: &[PlanePoint], gate_z_um: f64, focus_um: f64) -> Option<f64> {
    let far = all.iter().filter(|point| (point.height_um - focus_um).abs() > gate_z_um);
    let is_wrong = |point: &&PlanePoint| {
        let (plane, found) = (point.height_um - focus_um, point.height_um + point.error_um - focus_um);
        plane * found < 0.0
    };
    ratio(far.clone().filter(is_wrong).count() as f64, far.count() as f64)
}

/// Fewest points to which a height, and a tilt, are fitted.
const FEWEST: [usize; 2] = [3, 12];

/// Rounds of selection and fit.
const ROUNDS: usize = 20;

impl FittedPlanes {
    fn of(all: &[PlanePoint], gate_z_um: f64) -> Option<Self> {
        let planes = Plane::fit(all, gate_z_um);
        let sizes = sorted(all.iter().filter_map(|point| {
            let plane = planes.iter().find(|plane| plane.height_um == point.height_um)?;
            Some((point.error_um - plane.error_um(point.x_px, point.y_px)).abs())
        }));
        let within = sizes.partition_point(|size| *size < gate_z_um);
        (!planes.is_empty()).then(|| FittedPlanes {
            n: planes.len(),
            share_within: ratio(within as f64, sizes.len() as f64),
            rms_z_um: Errors::of(sizes[..within].iter().copied()).rms,
            p50_z_um: quantile(&sizes, 0.5),
            p68_z_um: quantile(&sizes, 0.68),
            rms_shift_um: Errors::of(planes.iter().map(|plane| plane.shift_um)).rms,
        })
    }
}

/// A plane fitted to the errors of the points of a height (see [`FittedPlanes`]).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Plane {
    /// The given height.
    pub height_um: f64,
    /// Mean position of its points, px.
    middle_px: [f64; 2],
    /// Error there, and its slope along x and y, um/px.
    shift_um: f64,
    slope: [f64; 2],
}

impl Plane {
    /// The planes of all heights with enough points, the lowest first.
    pub fn fit(all: &[PlanePoint], gate_z_um: f64) -> Vec<Self> {
        let mut sorted = all.to_vec();
        sorted.sort_by(|a, b| a.height_um.total_cmp(&b.height_um));
        sorted
            .chunk_by(|a, b| a.height_um == b.height_um)
            .filter_map(|of| Self::fit_height(of, gate_z_um))
            .collect()
    }

    /// Height of the plane at a position above the given one, um.
    pub fn error_um(&self, x_px: f64, y_px: f64) -> f64 {
        let [x, y] = [x_px - self.middle_px[0], y_px - self.middle_px[1]];
        self.shift_um + self.slope[0] * x + self.slope[1] * y
    }

    fn fit_height(points: &[PlanePoint], gate_z_um: f64) -> Option<Self> {
        let mut kept: Vec<&PlanePoint> =
            points.iter().filter(|point| point.error_um.abs() < gate_z_um).collect();
        let mut plane = None;
        for _ in 0..ROUNDS {
            let n = kept.len() as f64;
            let mean = |of: fn(&PlanePoint) -> f64| kept.iter().map(|point| of(point)).sum::<f64>() / n;
            let middle_px = [mean(|point| point.x_px), mean(|point| point.y_px)];
            let shift_um = mean(|point| point.error_um);
            let slope = match kept.len() {
                n if n < FEWEST[0] => return plane,
                n if n < FEWEST[1] => [0.0; 2],
                _ => tilt(&kept, middle_px, shift_um),
            };
            let fitted = Plane { height_um: points[0].height_um, middle_px, shift_um, slope };
            let away = |point: &PlanePoint| (point.error_um - fitted.error_um(point.x_px, point.y_px)).abs();
            let deviation = median(kept.iter().map(|point| away(point)))?;
            // 1.4826 median absolute deviations are a standard deviation.
            let most = (3.0 * 1.4826 * deviation).clamp(f64::MIN_POSITIVE, gate_z_um);
            let near: Vec<&PlanePoint> = points.iter().filter(|point| away(point) <= most).collect();
            plane = Some(fitted);
            if near == kept {
                break;
            }
            kept = near;
        }
        plane
    }
}

/// The slope along x and y, um/px; 0 if the points do not determine it.
fn tilt(points: &[&PlanePoint], middle: [f64; 2], shift: f64) -> [f64; 2] {
    let (mut xx, mut xy, mut yy, mut xz, mut yz) = (0.0, 0.0, 0.0, 0.0, 0.0);
    for point in points {
        let [x, y, z] = [point.x_px - middle[0], point.y_px - middle[1], point.error_um - shift];
        (xx, xy, yy, xz, yz) = (xx + x * x, xy + x * y, yy + y * y, xz + x * z, yz + y * z);
    }
    let determinant = xx * yy - xy * xy;
    if determinant <= 1e-6 * xx * yy {
        return [0.0; 2];
    }
    [(yy * xz - xy * yz) / determinant, (xx * yz - xy * xz) / determinant]
}

fn over_height(all: &[PlanePoint], gate_z_um: f64, heights: impl Iterator<Item = f64>) -> Vec<PlaneBin> {
    let heights = distinct(heights);
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
        // All planes are within the gate of the focus, and have too few points.
        assert_eq!((score.wrong_side, score.fitted), (None, None));
        let narrow = EvaluateOptions { border_px: 15.0, ..EvaluateOptions::default() };
        assert_eq!(PlaneScore::of(&planes, &points, &facts, &narrow).0.n, 3);
    }

    /// A slide that is tilted by 2 um over the image and 1 um too high, with one depth in ten on the wrong side: of these, none is an
    /// error of the rest.
    #[test]
    fn a_tilted_slide_is_no_error_against_fitted_planes() {
        let point = |k: u32| {
            let (x_px, y_px) = (f64::from(k * 37 % 100) + 1.0, f64::from(k * 61 % 100) + 1.0);
            let true_um = 31.0 + 0.02 * (x_px - 50.0) + 0.1 * if k.is_multiple_of(2) { 1.0 } else { -1.0 };
            let z_um = if k % 10 == 3 { -true_um } else { true_um };
            TrackRow { frame: k % 2, track: -1, at: Position { x_px, y_px, z_um } }
        };
        let points = Points { rows: (0..100).map(point).collect(), has_z: true, ..Points::default() };
        let planes = [PlaneRow { frame: 0, z_um: 30.0 }, PlaneRow { frame: 1, z_um: 30.0 }];
        let facts = RecordingFacts {
            sensor_px: Some((100.0, 100.0)),
            depth_um: Some((-40.0, 40.0)),
            focus_um: Some(0.0),
            ..RecordingFacts::default()
        };
        let (score, _) = PlaneScore::of(&planes, &points, &facts, &EvaluateOptions::default());
        let fitted = score.fitted.unwrap();
        assert!(score.rmse_z_um.unwrap() > 1.1, "{:?}", score.rmse_z_um);
        assert_eq!((score.wrong_side, fitted.n, fitted.share_within), (Some(0.1), 1, Some(0.9)));
        assert!((fitted.rms_z_um.unwrap() - 0.1).abs() < 1e-2, "{fitted:?}");
        assert!((fitted.rms_shift_um.unwrap() - 1.0).abs() < 0.1, "{fitted:?}");
    }
}
