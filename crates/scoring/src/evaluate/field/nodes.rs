//! Scores at reference nodes, which do not depend on the positions of the vectors in a result.
//!
//! Scores over the vectors of a result favor a result that reports only its best vectors. The reference nodes
//! are therefore the nodes of the truth at least 32 px from the border of the image (a quarter of its width
//! or height, if that is less), in every image pair, so that windows of up to 64 px reach them all. The
//! displacement there is interpolated between the valid vectors (flag 0) of the result:
//!
//! - on a grid, if the surrounding vectors are at most 33 px apart and the valid ones have at least half of
//!   the weight, bilinearly with the curvature on which the vectors on both sides agree, so that an outlier
//!   matters only beside it; a vector at the edge of the grid also covers half a spacing beyond it;
//! - otherwise by the nearest vector within 8 px.
//!
//! A result without image pairs counts for all of them.

use std::collections::{BTreeMap, BTreeSet};

use super::true_field::{TrueField, index};
use super::vectors::INLIER_PX;
use crate::evaluate::statistics::{Interval, distinct, intervals, ratio};
use crate::results::FlowVector;
use storage::dataset::RecordingFacts;

/// Distance of reference nodes from the border of the image, px: half of a window of 64 px.
const MARGIN_PX: f64 = 32.0;
/// Largest distance of vectors between which the field is interpolated, px: 32 and rounding.
const WIDEST_PX: f64 = 33.0;
/// Largest distance of a node from a vector that is not on a grid, px.
const NEAR_PX: f64 = 8.0;
/// Side of the squares of nodes that the bootstrap resamples, px: errors within a window are correlated.
const BLOCK_PX: f64 = 32.0;
/// Fewer squares than this are units of each image pair by itself.
pub(super) const FEW_SQUARES: usize = 30;
/// Largest error of a valid node in units of the RMS of the true displacement about its mean: a constant
/// field must not be valid.
const GATE_OF_SPREAD: f64 = 0.5;
/// Minimum gate of valid nodes, px: an error that PIV achieves in a nearly uniform flow.
const LEAST_GATE_PX: f64 = 0.2;

scores! {
    /// Scores at the reference nodes: the nodes of the truth at least 32 px from the border of the image, in
    /// every image pair, whether or not the result has vectors there.
    pub struct NodeErrors {
        /// Number of reference nodes of all image pairs.
        pub n: usize,
        /// Fraction of reference nodes for which valid vectors give a displacement.
        fraction covered: Option<f64>,
        /// RMS of the true displacement about its mean over the reference nodes: the error of the best constant
        /// field.
        not_negative spread_px: Option<f64>,
        /// End-point error below which a node is valid: half of spread_px, at least 0.2 and at most 1 px.
        not_negative gate_px: f64,
        /// Fraction of reference nodes at which the end-point error is below gate_px.
        fraction valid: Option<f64>,
        /// RMS end-point error over all reference nodes; a missing displacement and an error above 1 px count as
        /// 1 px.
        fraction rms_px: Option<f64>,
        /// Amplitude response over all reference nodes: Σ d · d_true / Σ d_true², with d = 0 for a missing
        /// displacement.
        pub response: Option<f64>,
        /// 95 % bootstrap interval of valid, resampling squares of 32 px (of all image pairs together, unless these are fewer
        /// than 30).
        fraction interval_valid: Interval,
        /// 95 % bootstrap interval of rms_px.
        fraction interval_rms_px: Interval,
        /// 95 % bootstrap interval of response.
        pub interval_response: Interval,
    }
}

/// Sums over nodes: number, covered, valid, squared errors, d · d_true, d_true².
type Sums = [f64; 6];

impl NodeErrors {
    /// Scores the vectors of a result at the reference nodes of the truth.
    ///
    /// Also gives the sums over squares of nodes, for paired comparisons, and the number of squares in which a node
    /// is covered in any pair.
    pub(super) fn of(
        truth: &TrueField,
        vectors: &[FlowVector],
        facts: &RecordingFacts,
        seed: u64,
    ) -> (Self, Vec<Sums>, usize) {
        let pairs = pairs(truth, vectors, facts);
        let (columns, rows) = truth.nodes();
        let (columns, rows) =
            (inner(columns, facts.sensor_px.map(|s| s.0)), inner(rows, facts.sensor_px.map(|s| s.1)));
        let spread_px = spread_px(truth, &pairs, columns, rows);
        let gate_px =
            spread_px.map_or(INLIER_PX, |spread| (GATE_OF_SPREAD * spread).clamp(LEAST_GATE_PX, INLIER_PX));
        // The errors of a steady flow repeat from pair to pair, so that squares of all pairs are the units.
        let blocks = |axis: &[f64]| axis.chunk_by(|a, b| block(*a) == block(*b)).count();
        let is_by_pair = blocks(columns) * blocks(rows) < FEW_SQUARES;
        let mut squares: BTreeMap<[u32; 3], Sums> = BTreeMap::new();
        let mut covered: BTreeSet<[u32; 2]> = BTreeSet::new();
        // One field for all pairs is interpolated once.
        let common = vectors.iter().all(|v| v.pair.is_none()).then(|| Interpolated::new(vectors.iter()));
        for (k, &pair) in pairs.iter().enumerate() {
            let own;
            let found = match &common {
                Some(common) => common,
                None => {
                    own =
                        Interpolated::new(vectors.iter().filter(|v| v.pair.is_none_or(|p| Some(p) == pair)));
                    &own
                }
            };
            for &y_px in rows {
                for &x_px in columns {
                    let Some([u, v, _]) = truth.for_pair(pair, x_px, y_px) else { continue };
                    let displacement = found.at(x_px, y_px);
                    covered.extend(displacement.map(|_| [block(x_px), block(y_px)]));
                    let of_node = sums([u, v], displacement, gate_px);
                    let square = [if is_by_pair { k as u32 } else { 0 }, block(x_px), block(y_px)];
                    squares.entry(square).or_default().iter_mut().zip(of_node).for_each(|(s, new)| *s += new);
                }
            }
        }
        let units: Vec<Sums> = squares.into_values().collect();
        let mut total = [0.0; 6];
        units.iter().for_each(|unit| total.iter_mut().zip(unit).for_each(|(s, new)| *s += new));
        let scores = |&[n, _, valid, squares, product, truth]: &Sums| {
            [ratio(valid, n), ratio(squares, n).map(f64::sqrt), ratio(product, truth)]
        };
        let [valid, rms_px, response] = scores(&total);
        let [interval_valid, interval_rms_px, interval_response] = intervals(&units, seed, scores);
        let score = NodeErrors {
            n: total[0] as usize,
            spread_px,
            gate_px,
            covered: ratio(total[1], total[0]),
            valid,
            rms_px,
            response,
            interval_valid,
            interval_rms_px,
            interval_response,
        };
        (score, units, covered.len())
    }
}

/// The square of a position along an axis.
pub(super) fn block(at_px: f64) -> u32 {
    (at_px / BLOCK_PX) as u32
}

/// Number of squares with reference nodes, from the first image pair: the most that a result can cover.
pub fn squares(truth: &TrueField, facts: &RecordingFacts) -> usize {
    let (columns, rows) = truth.nodes();
    let (columns, rows) =
        (inner(columns, facts.sensor_px.map(|s| s.0)), inner(rows, facts.sensor_px.map(|s| s.1)));
    let pair = truth.pairs().next().flatten();
    let nodes = rows.iter().flat_map(|y| columns.iter().map(move |x| (*x, *y)));
    let known = nodes.filter(|(x, y)| truth.for_pair(pair, *x, *y).is_some());
    known.map(|(x, y)| [block(x), block(y)]).collect::<BTreeSet<_>>().len()
}

/// RMS of the true displacement about its mean over all reference nodes: the error of the best constant.
fn spread_px(truth: &TrueField, pairs: &[Option<u32>], columns: &[f64], rows: &[f64]) -> Option<f64> {
    let pairs = if truth.needs_pairs() { pairs } else { &pairs[..pairs.len().min(1)] };
    let nodes = || {
        pairs.iter().flat_map(move |pair| {
            rows.iter().flat_map(move |y| columns.iter().filter_map(move |x| truth.for_pair(*pair, *x, *y)))
        })
    };
    let (n, u, v) = nodes().fold((0.0, 0.0, 0.0), |(n, u, v), d| (n + 1.0, u + d[0], v + d[1]));
    let (mean_u, mean_v) = (ratio(u, n)?, ratio(v, n)?);
    let squares: f64 = nodes().map(|d| (d[0] - mean_u).powi(2) + (d[1] - mean_v).powi(2)).sum();
    ratio(squares, n).map(f64::sqrt)
}

fn sums([u, v]: [f64; 2], found: Option<[f64; 2]>, gate_px: f64) -> Sums {
    let size = u * u + v * v;
    let Some([a, b]) = found else { return [1.0, 0.0, 0.0, INLIER_PX * INLIER_PX, 0.0, size] };
    let error = (a - u).hypot(b - v);
    let valid = f64::from(u8::from(error < gate_px));
    [1.0, 1.0, valid, error.min(INLIER_PX).powi(2), a * u + b * v, size]
}

/// The image pairs that have a truth; `None` is the only one of a result and a table that do not name any.
fn pairs(truth: &TrueField, vectors: &[FlowVector], facts: &RecordingFacts) -> Vec<Option<u32>> {
    let mut pairs: Vec<Option<u32>> = match facts.frames {
        Some(frames) => (0..frames).filter(|pair| facts.has_pair(*pair)).map(Some).collect(),
        None if truth.needs_pairs() => truth.pairs().collect(),
        None => vectors.iter().map(|v| v.pair).collect(),
    };
    pairs.retain(|pair| pair.is_none_or(|pair| truth.has_pair(pair)));
    pairs.sort_unstable();
    pairs.dedup();
    if pairs.is_empty() {
        pairs.push(None);
    }
    pairs
}

/// The part of an axis of nodes that is far enough from the border of the image, `size_px` long.
fn inner(axis: &[f64], size_px: Option<f64>) -> &[f64] {
    let (Some(first), Some(last)) = (axis.first(), axis.last()) else { return axis };
    let half = axis.get(1).map_or(0.5, |second| 0.5 * (second - first));
    let (low, high) = size_px.map_or((first - half, last + half), |size| (0.5, size + 0.5));
    let margin = MARGIN_PX.min(0.25 * (high - low));
    let from = axis.partition_point(|at| *at < low + margin);
    let to = axis.partition_point(|at| *at <= high - margin);
    &axis[from..to.max(from)]
}

/// The valid vectors of an image pair, with interpolation.
enum Interpolated {
    /// On a grid: x of columns, y of rows, displacements row by row, NaN without a valid vector.
    Grid(Vec<f64>, Vec<f64>, Vec<[f64; 2]>),
    /// Scattered: position and displacement by squares of 8 px.
    Scattered(BTreeMap<(i64, i64), Vec<[f64; 4]>>),
}

impl Interpolated {
    fn new<'a>(vectors: impl Iterator<Item = &'a FlowVector> + Clone) -> Self {
        let x_px = distinct(vectors.clone().map(|v| v.at.x_px).filter(|x| x.is_finite()));
        let y_px = distinct(vectors.clone().map(|v| v.at.y_px).filter(|y| y.is_finite()));
        let valid = vectors.clone().filter(|v| v.flag == 0 && v.moved[..2].iter().all(|d| d.is_finite()));
        let cells = x_px.len() * y_px.len();
        // A grid is mostly full; scattered vectors would each have a column and a row of their own.
        if cells <= 4 * vectors.clone().count() {
            let mut moved = vec![[f64::NAN; 2]; cells];
            for v in valid {
                let (i, j) = (index(&x_px, v.at.x_px), index(&y_px, v.at.y_px));
                moved[j * x_px.len() + i] = [v.moved[0], v.moved[1]];
            }
            return Interpolated::Grid(x_px, y_px, moved);
        }
        let mut squares: BTreeMap<(i64, i64), Vec<[f64; 4]>> = BTreeMap::new();
        for v in valid {
            let found = [v.at.x_px, v.at.y_px, v.moved[0], v.moved[1]];
            squares.entry((square(v.at.x_px), square(v.at.y_px))).or_default().push(found);
        }
        Interpolated::Scattered(squares)
    }

    /// The displacement at a position; `None` where there are too few valid vectors.
    fn at(&self, x_px: f64, y_px: f64) -> Option<[f64; 2]> {
        match self {
            Interpolated::Grid(columns, rows, moved) => {
                let ((i, s), (j, t)) = (between(columns, x_px)?, between(rows, y_px)?);
                let (mut sum, mut weights) = ([0.0; 2], 0.0);
                for (row, v) in [(j, 1.0 - t), (j + 1, t)] {
                    for (column, h) in [(i, 1.0 - s), (i + 1, s)] {
                        let weight = h * v;
                        if weight == 0.0 {
                            continue;
                        }
                        let d = moved[row * columns.len() + column];
                        if d[0].is_nan() {
                            continue;
                        }
                        weights += weight;
                        sum.iter_mut().zip(d).for_each(|(s, d)| *s += weight * d);
                    }
                }
                let curved = |c: usize| {
                    let at = |column: usize, row: usize| moved[row * columns.len() + column][c];
                    (1.0 - t) * bulge(columns, i, s, |k| at(k, j))
                        + t * bulge(columns, i, s, |k| at(k, j + 1))
                        + (1.0 - s) * bulge(rows, j, t, |k| at(i, k))
                        + s * bulge(rows, j, t, |k| at(i + 1, k))
                };
                (weights >= 0.5).then(|| [0, 1].map(|c| sum[c] / weights + curved(c)))
            }
            Interpolated::Scattered(squares) => {
                let around = |k: i64| k - 1..=k + 1;
                let found = around(square(y_px))
                    .flat_map(|j| around(square(x_px)).filter_map(move |i| squares.get(&(i, j))))
                    .flatten();
                let far = |v: &[f64; 4]| (v[0] - x_px).hypot(v[1] - y_px);
                let nearest = found.min_by(|a, b| far(a).total_cmp(&far(b)))?;
                (far(nearest) <= NEAR_PX).then_some([nearest[2], nearest[3]])
            }
        }
    }
}

/// Difference from the straight line at the fraction `s` of the way from node `i` to the next one: a parabola
/// with the mean of the second derivatives at both nodes, at most twice the smaller one (van Leer, J. Comput.
/// Phys. 23 (1977) 276); 0 if they have different signs or one is unknown.
fn bulge(axis: &[f64], i: usize, s: f64, value: impl Fn(usize) -> f64) -> f64 {
    let slope = |k: usize| (value(k + 1) - value(k)) / (axis[k + 1] - axis[k]);
    let curvature = |k: usize| match k > 0 && k + 1 < axis.len() {
        true => 2.0 * (slope(k) - slope(k - 1)) / (axis[k + 1] - axis[k - 1]),
        false => 0.0,
    };
    let (before, after) = (curvature(i), curvature(i + 1));
    if before * after > 0.0 {
        let limit = 2.0 * before.abs().min(after.abs());
        let width = axis[i + 1] - axis[i];
        -0.5 * s * (1.0 - s) * width * width * (0.5 * (before + after)).clamp(-limit, limit)
    } else {
        0.0
    }
}

fn square(at_px: f64) -> i64 {
    (at_px / NEAR_PX).floor() as i64
}

/// The position before `at` on an axis, and the fraction of the way to the next one; `None` if these are too
/// far apart or `at` is beyond the ends by more than half their distance.
fn between(axis: &[f64], at: f64) -> Option<(usize, f64)> {
    let last = axis.len().checked_sub(2)?;
    let i = index(axis, at).saturating_sub(1).min(last);
    let apart = axis[i + 1] - axis[i];
    let share = (at - axis[i]) / apart;
    (apart <= WIDEST_PX && (-0.5..=1.5).contains(&share)).then_some((i, share.clamp(0.0, 1.0)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::results::Position;

    const SIZE: u32 = 256;

    fn vector(pair: u32, x_px: f64, y_px: f64, [u, v]: [f64; 2]) -> FlowVector {
        let at = Position { x_px, y_px, ..Position::default() };
        FlowVector { pair: Some(pair), at, moved: [u, v, f64::NAN], ..FlowVector::default() }
    }

    /// Vectors on a grid of `step` px, for each of two pairs.
    fn grid(step: f64, moved: impl Fn(f64, f64) -> [f64; 2]) -> Vec<FlowVector> {
        let places: Vec<f64> =
            (0..).map(|k| step * (f64::from(k) + 0.5) + 0.5).take_while(|at| *at < 256.0).collect();
        let all = [0, 1].into_iter().flat_map(|pair| {
            places.iter().flat_map(|&y| places.iter().map(move |&x| (x, y))).map(move |at| (pair, at))
        });
        all.map(|(pair, (x, y))| vector(pair, x, y, moved(x, y))).collect()
    }

    fn wave(y: f64, wavelength: f64) -> [f64; 2] {
        [2.0 * (std::f64::consts::TAU * y / wavelength).sin(), 0.0]
    }

    fn scored(truth: impl Fn(f64, f64) -> [f64; 2], vectors: &[FlowVector]) -> NodeErrors {
        let mut nodes = grid(2.0, truth);
        nodes.retain(|v| v.pair == Some(0));
        nodes.iter_mut().for_each(|v| v.pair = None);
        let size = f64::from(SIZE);
        let facts = RecordingFacts {
            frames: Some(4),
            pairs: true,
            sensor_px: Some((size, size)),
            ..Default::default()
        };
        NodeErrors::of(&TrueField::new(&nodes), vectors, &facts, 1).0
    }

    #[test]
    fn every_node_of_a_complete_field_is_valid() {
        for step in [4.0, 8.0, 12.0, 32.0] {
            let all = scored(|_, _| [4.5, 0.0], &grid(step, |_, _| [4.5, 0.0]));
            assert_eq!((all.covered, all.valid), (Some(1.0), Some(1.0)), "{step}");
            // Rounding of the weights.
            assert!(all.rms_px < Some(1e-12), "{step}: {all:?}");
            assert_eq!(all.n, 2 * 96 * 96);
        }
        // Linear fields are interpolated exactly, and a common field counts for all pairs.
        let shear = |_: f64, y: f64| [0.1 * y, 0.0];
        let mut common = grid(16.0, shear);
        common.retain(|v| v.pair == Some(1));
        common.iter_mut().for_each(|v| v.pair = None);
        let all = scored(shear, &common);
        assert_eq!(all.valid, Some(1.0));
        assert!(all.rms_px.unwrap() < 1e-9 && (all.response.unwrap() - 1.0).abs() < 1e-9, "{all:?}");
    }

    #[test]
    fn few_vectors_and_wide_grids_are_worse_than_a_complete_field() {
        let truth = |_: f64, _: f64| [4.5, 0.0];
        let whole =
            scored(truth, &grid(8.0, |x, _| [if (x / 8.0) as u32 % 20 == 3 { 9.0 } else { 4.6 }, 0.0]));
        let mut one = grid(8.0, truth);
        one.retain(|v| (v.at.x_px, v.at.y_px) == (132.5, 132.5));
        assert_eq!(one.len(), 2);
        let one = scored(truth, &one);
        // On a grid, four vectors would cover the whole area between them.
        let corners = grid(128.0, truth);
        let corners = scored(truth, &corners);
        let nothing = scored(truth, &[]);
        for few in [&one, &corners, &nothing] {
            assert!(few.valid < Some(0.01) && few.rms_px > Some(0.99), "{few:?}");
            assert!(whole.valid > few.valid && whole.rms_px < few.rms_px);
        }
        let rejected: Vec<FlowVector> = (grid(8.0, truth).into_iter())
            .map(|v| FlowVector { flag: u8::from(v.at.x_px > 128.0), ..v })
            .collect();
        assert!((scored(truth, &rejected).valid.unwrap() - 0.5).abs() < 0.05);
    }

    #[test]
    fn a_field_of_zeros_is_bad_at_every_wavelength() {
        for wavelength in [20.0, 40.0, 80.0, 160.0] {
            let truth = |_: f64, y: f64| wave(y, wavelength);
            let zeros = scored(truth, &grid(8.0, |_, _| [0.0, 0.0]));
            let half = scored(truth, &grid(8.0, |_, y| wave(y, wavelength).map(|d| 0.5 * d)));
            assert!(zeros.rms_px > Some(0.8) && zeros.response == Some(0.0), "{zeros:?}");
            assert!(half.rms_px < zeros.rms_px && half.valid > zeros.valid, "{wavelength}: {half:?}");
        }
    }

    /// The vectors are not spread evenly: some nodes have none within 8 px.
    #[test]
    fn scattered_vectors_stand_for_their_neighborhood() {
        let truth = |_: f64, y: f64| [0.02 * y, 0.0];
        let scattered: Vec<FlowVector> = (0..4000_u32)
            .map(|k| {
                let at = |salt: u32| f64::from(k.wrapping_mul(salt) >> 8) / f64::from(1 << 24) * 256.0;
                let (x, y) = (at(2_654_435_761), at(2_246_822_519));
                vector(k % 2, x, y, [0.02 * y, 0.0])
            })
            .collect();
        let found = scored(truth, &scattered);
        assert!(found.valid > Some(0.7) && found.rms_px < Some(0.55), "{found:?}");
    }
}
