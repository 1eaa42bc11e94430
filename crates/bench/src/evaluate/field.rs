//! Scores of displacement fields (PIV): every vector against the truth at its place.
//!
//! The truth is bilinear between the nodes of `truth/field.csv`; of several planes the one nearest z = 0 is taken. Errors
//! are result - truth over valid vectors (flag 0); interpolated ones (flag 2) are counted apart. Definitions:
//! docs/scoring.md.

use std::collections::BTreeMap;
use std::path::Path;

use serde::Serialize;

use super::statistics::{Errors, bootstrap, quantile, ratio};
use crate::error::{Error, Result};
use crate::results::sheet::{Separator, Sheet};
use crate::results::{Conventions, Field, Vector, read_field};

/// Vectors off by less are inliers, px.
const INLIER_PX: f64 = 1.0;
/// Errors are relative to at least this displacement, px.
const FLOOR_PX: f64 = 0.1;

/// Scores against every truth that there is.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
#[allow(missing_docs)]
pub struct FieldScore {
    /// Vectors in the result, and how many of them are valid, invalid, interpolated, and outside of the truth's grid.
    pub n_total: usize,
    pub n_reported: usize,
    pub n_interpolated: usize,
    pub n_outside: usize,
    pub data_yield: Option<f64>,
    /// The truth that the other keys of this object's first level refer to.
    pub against: String,
    #[serde(flatten)]
    pub main: Against,
    /// The same for each truth: forward, central, depth-weighted, as far as the dataset has them.
    pub truths: BTreeMap<String, Against>,
}

/// Errors of one component.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
#[allow(missing_docs)]
pub struct Component {
    pub bias_px: Option<f64>,
    pub random_px: Option<f64>,
    pub rms_px: Option<f64>,
    pub mae_px: Option<f64>,
    pub median_abs_px: Option<f64>,
    pub p95_abs_px: Option<f64>,
}

impl Component {
    fn of(errors: &[f64]) -> Self {
        let e = Errors::of(errors.iter().copied());
        let mut sizes: Vec<f64> = errors.iter().map(|e| e.abs()).collect();
        sizes.sort_unstable_by(f64::total_cmp);
        Component {
            bias_px: e.bias,
            random_px: e.random,
            rms_px: e.rms,
            mae_px: ratio(sizes.iter().sum(), sizes.len() as f64),
            median_abs_px: quantile(&sizes, 0.5),
            p95_abs_px: quantile(&sizes, 0.95),
        }
    }
}

/// Scores against one truth.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
#[allow(missing_docs)]
pub struct Against {
    pub u: Component,
    pub v: Component,
    pub u_inliers: Component,
    pub v_inliers: Component,
    /// RMS error of dz, um, if the result has it.
    pub w_rms_um: Option<f64>,
    pub aee_px: Option<f64>,
    pub aee_per_100px: Option<f64>,
    pub epe_rms_px: Option<f64>,
    pub nepe: Option<f64>,
    pub angular_error_deg: Option<f64>,
    pub outlier_threshold_px: f64,
    pub outlier_fraction: Option<f64>,
    /// Valid and within 1 px (0.5 px), of all vectors of the result.
    pub valid_vector_probability: Option<f64>,
    pub valid_vector_probability_strict: Option<f64>,
    /// Slope of the measured displacement's variation over the true one's.
    pub modulation_u: Option<f64>,
    pub modulation_v: Option<f64>,
    /// Shares of |e| <= U and <= 2 U for claimed uncertainties U, and rms(e) / rms(U).
    pub coverage_1s_u: Option<f64>,
    pub coverage_2s_u: Option<f64>,
    pub coverage_1s_u_inliers: Option<f64>,
    pub uncertainty_ratio_u: Option<f64>,
    pub peak_locking: PeakLocking,
    /// 95 % interval of aee_px under resampling of vectors.
    pub interval_aee_px: Option<[f64; 2]>,
}

/// Whether displacements prefer whole pixels.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
#[allow(missing_docs)]
pub struct PeakLocking {
    /// Numbers of vectors with the fraction of u in tenths.
    pub histogram_u: Vec<usize>,
    /// 1 - least / greatest number; null for fewer than 50 vectors per tenth on average.
    pub degree: Option<f64>,
    /// Bias of u over the fraction of the true u, in twentieths, and half its range.
    pub bias_curve_px: Vec<Option<f64>>,
    pub amplitude_px: Option<f64>,
}

/// A vector beside its truth.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Compared {
    /// What was measured.
    pub found: Vector,
    /// What is true: dx, dy (px), dz (um).
    pub exact: [f64; 3],
}

impl Compared {
    fn error(&self) -> [f64; 2] {
        [self.found.moved[0] - self.exact[0], self.found.moved[1] - self.exact[1]]
    }

    /// Length of the error in the image plane, px.
    pub fn endpoint(&self) -> f64 {
        let [u, v] = self.error();
        (u * u + v * v).sqrt()
    }
}

/// Scores a field against a dataset, or a bare table of a field.
///
/// # Errors
/// A truth that is missing or cannot be read.
pub fn evaluate(dataset: &Path, field: &Field, seed: u64) -> Result<(FieldScore, Vec<Compared>)> {
    let truths =
        if dataset.is_dir() { of_dataset(&dataset.join("truth/field.csv"))? } else { bare(dataset)? };
    let count = |flag: u8| field.vectors.iter().filter(|v| v.flag == flag).count();
    let n_total = field.vectors.len();
    let mut score = FieldScore {
        n_total,
        n_reported: count(0),
        n_interpolated: count(2),
        data_yield: ratio(count(0) as f64, n_total as f64),
        ..FieldScore::default()
    };
    let mut first = Vec::new();
    for (i, (name, grid)) in truths.iter().enumerate() {
        let compared: Vec<Compared> = field
            .vectors
            .iter()
            .filter(|v| v.flag == 0)
            .filter_map(|v| Some(Compared { found: *v, exact: grid.at(v)? }))
            .collect();
        let against = Against::of(&compared, n_total, seed);
        if i == 0 {
            score.n_outside = score.n_reported - compared.len();
            (score.against, score.main, first) = (name.clone(), against.clone(), compared);
        }
        score.truths.insert(name.clone(), against);
    }
    Ok((score, first))
}

impl Against {
    fn of(all: &[Compared], n_total: usize, seed: u64) -> Self {
        let inliers: Vec<Compared> = all.iter().copied().filter(|c| c.endpoint() < INLIER_PX).collect();
        let component =
            |of: &[Compared], k: usize| Component::of(&of.iter().map(|c| c.error()[k]).collect::<Vec<_>>());
        let n = all.len() as f64;
        let mean = |f: &dyn Fn(&Compared) -> f64| ratio(all.iter().map(f).sum(), n);
        let share = |of: &[Compared], k: f64| {
            let claimed: Vec<&Compared> = of.iter().filter(|c| c.found.sigma[0].is_finite()).collect();
            let covered = claimed.iter().filter(|c| c.error()[0].abs() <= k * c.found.sigma[0]).count();
            ratio(covered as f64, claimed.len() as f64)
        };
        let claimed = all.iter().filter(|c| c.found.sigma[0].is_finite());
        let (squares, sigmas) =
            claimed.fold((0.0, 0.0), |(e, s), c| (e + c.error()[0].powi(2), s + c.found.sigma[0].powi(2)));
        let depth: Vec<f64> =
            all.iter().map(|c| c.found.moved[2] - c.exact[2]).filter(|w| w.is_finite()).collect();
        let within = |most: f64| all.iter().filter(|c| c.endpoint() < most).count() as f64;
        let aee_px = mean(&Compared::endpoint);
        // Single vectors are the units; a million resamples of a million vectors would take minutes.
        let stride = all.len().div_ceil(20_000).max(1);
        let units: Vec<[f64; 2]> = all.iter().step_by(stride).map(|c| [c.endpoint(), 1.0]).collect();
        let [interval_aee_px] = bootstrap(&units, seed, |&[sum, n]| [ratio(sum, n)]);
        Against {
            u: component(all, 0),
            v: component(all, 1),
            u_inliers: component(&inliers, 0),
            v_inliers: component(&inliers, 1),
            w_rms_um: Errors::of(depth.iter().copied()).rms,
            aee_px,
            aee_per_100px: aee_px.map(|a| 100.0 * a),
            epe_rms_px: mean(&|c| c.endpoint().powi(2)).map(f64::sqrt),
            nepe: mean(&|c| c.endpoint() / c.exact[0].hypot(c.exact[1]).max(FLOOR_PX)),
            angular_error_deg: mean(&|c| angle(c).to_degrees()),
            outlier_threshold_px: INLIER_PX,
            outlier_fraction: ratio(n - within(INLIER_PX), n),
            valid_vector_probability: ratio(within(INLIER_PX), n_total as f64),
            valid_vector_probability_strict: ratio(within(0.5), n_total as f64),
            modulation_u: modulation(&inliers, 0),
            modulation_v: modulation(&inliers, 1),
            coverage_1s_u: share(all, 1.0),
            coverage_2s_u: share(all, 2.0),
            coverage_1s_u_inliers: share(&inliers, 1.0),
            uncertainty_ratio_u: ratio(squares, sigmas).map(f64::sqrt),
            peak_locking: PeakLocking::of(all),
            interval_aee_px,
        }
    }
}

/// The angle between (u, v, 1) as measured and as it is (Barron et al., IJCV 12, 1994).
fn angle(c: &Compared) -> f64 {
    let ([u, v, _], [a, b, _]) = (c.found.moved, c.exact);
    let cosine = (1.0 + u * a + v * b) / ((1.0 + u * u + v * v) * (1.0 + a * a + b * b)).sqrt();
    cosine.clamp(-1.0, 1.0).acos()
}

fn modulation(inliers: &[Compared], k: usize) -> Option<f64> {
    let n = inliers.len() as f64;
    let mean_exact = ratio(inliers.iter().map(|c| c.exact[k]).sum(), n)?;
    let (mut both, mut exact) = (0.0, 0.0);
    for c in inliers {
        both += c.found.moved[k] * (c.exact[k] - mean_exact);
        exact += (c.exact[k] - mean_exact).powi(2);
    }
    // A uniform flow has nothing to resolve.
    ratio(both, exact).filter(|_| exact > 1e-12 * n)
}

impl PeakLocking {
    fn of(all: &[Compared]) -> Self {
        let cell = |u: f64, n: usize| ((u.rem_euclid(1.0) * n as f64) as usize).min(n - 1);
        let mut histogram_u = vec![0; 10];
        let mut errors = vec![Vec::new(); 20];
        for c in all {
            histogram_u[cell(c.found.moved[0], 10)] += 1;
            errors[cell(c.exact[0], 20)].push(c.error()[0]);
        }
        let (least, most) = histogram_u.iter().fold((usize::MAX, 0), |(l, m), &n| (l.min(n), m.max(n)));
        let bias_curve_px: Vec<Option<f64>> =
            errors.iter().map(|e| Errors::of(e.iter().copied()).bias).collect();
        let known = || bias_curve_px.iter().flatten().copied();
        let range = known().reduce(f64::max).zip(known().reduce(f64::min));
        PeakLocking {
            degree: (all.len() >= 500).then(|| 1.0 - least as f64 / most as f64),
            amplitude_px: range.map(|(high, low)| (high - low) / 2.0),
            histogram_u,
            bias_curve_px,
        }
    }
}

/// True displacements on a grid, of every pair or of all.
#[derive(Debug, Default)]
struct Grid {
    x_px: Vec<f64>,
    y_px: Vec<f64>,
    pairs: BTreeMap<Option<u32>, Vec<[f64; 3]>>,
}

impl Grid {
    fn new(nodes: &[Vector]) -> Self {
        let axis = |value: fn(&Vector) -> f64| {
            let mut values: Vec<f64> = nodes.iter().map(value).collect();
            values.sort_unstable_by(f64::total_cmp);
            values.dedup();
            values
        };
        let mut grid = Grid { x_px: axis(|v| v.at.x_px), y_px: axis(|v| v.at.y_px), pairs: BTreeMap::new() };
        let size = grid.x_px.len() * grid.y_px.len();
        // Scattered nodes make no grid; they are found exactly where they are and nowhere else.
        if size <= 100 * nodes.len() + 1000 {
            for node in nodes {
                let (i, j) = (index(&grid.x_px, node.at.x_px), index(&grid.y_px, node.at.y_px));
                let values = grid.pairs.entry(node.pair).or_insert_with(|| vec![[f64::NAN; 3]; size]);
                values[j * grid.x_px.len() + i] = node.moved;
            }
        }
        grid
    }

    /// The truth at the place of a vector; `None` outside of the grid, or where the truth is masked.
    fn at(&self, vector: &Vector) -> Option<[f64; 3]> {
        let single = (self.pairs.len() == 1).then(|| self.pairs.values().next()).flatten();
        let values = self
            .pairs
            .get(&vector.pair)
            .or(self.pairs.get(&None))
            .or(single.filter(|_| vector.pair.is_none()))?;
        let place = |axis: &[f64], v: f64| {
            let (first, last) = (*axis.first()?, *axis.last()?);
            if v < first || v > last {
                return None;
            }
            let i = (index(axis, v).max(1) - 1).min(axis.len().saturating_sub(2));
            let next = (i + 1).min(axis.len() - 1);
            let share = if next > i { (v - axis[i]) / (axis[next] - axis[i]) } else { 0.0 };
            Some((i, next, share))
        };
        let (i, i1, s) = place(&self.x_px, vector.at.x_px)?;
        let (j, j1, t) = place(&self.y_px, vector.at.y_px)?;
        let mut sum = [0.0; 3];
        for (row, column, weight) in
            [(j, i, (1.0 - s) * (1.0 - t)), (j, i1, s * (1.0 - t)), (j1, i, (1.0 - s) * t), (j1, i1, s * t)]
        {
            // A masked neighbour without weight does no harm.
            if weight != 0.0 {
                let value = values[row * self.x_px.len() + column];
                sum.iter_mut().zip(value).for_each(|(s, v)| *s += weight * v);
            }
        }
        (sum[0].is_finite() && sum[1].is_finite()).then_some(sum)
    }
}

fn index(axis: &[f64], v: f64) -> usize {
    axis.partition_point(|a| *a < v)
}

fn bare(path: &Path) -> Result<Vec<(String, Grid)>> {
    let field = read_field(path, &Conventions::default())?;
    Ok(vec![("truth".to_owned(), Grid::new(&field.vectors))])
}

/// The truths of a dataset, the first being the main one.
fn of_dataset(path: &Path) -> Result<Vec<(String, Grid)>> {
    if !path.exists() {
        return Err(Error::input(format!(
            "{}: missing; this dataset has no truth of fields (score particles, or give a table of the true field)",
            path.display()
        )));
    }
    let mut truths = Vec::new();
    for kind in ["central", "forward", "weighted"] {
        let sheet = Sheet::open(path, Separator::Comma, 1)?;
        let (Some(dx), Some(dy)) =
            (sheet.column(&format!("{kind}_dx_px")), sheet.column(&format!("{kind}_dy_px")))
        else {
            continue;
        };
        let dz = sheet.column(&format!("{kind}_dz_um"));
        let (x, y) = (sheet.need("x_px")?, sheet.need("y_px")?);
        let (z, pair, mask) = (sheet.column("z_um"), sheet.column("pair"), sheet.column("mask"));
        let mut nodes: Vec<Vector> = Vec::new();
        let mut nearest = f64::INFINITY;
        sheet.rows(|cells| {
            let pair = cells.track(pair)?;
            let z_um = z.map_or(Ok(0.0), |z| cells.number(z))?;
            let masked = cells.number_or_nan(mask)? == 1.0;
            let moved = match masked {
                true => [f64::NAN; 3],
                false => [cells.number(dx)?, cells.number(dy)?, cells.number_or_nan(dz)?],
            };
            nearest = nearest.min(z_um.abs());
            let at = crate::results::Position { x_px: cells.number(x)?, y_px: cells.number(y)?, z_um };
            let pair = u32::try_from(pair).ok();
            nodes.push(Vector { pair, at, moved, flag: u8::from(masked), sigma: [f64::NAN; 2] });
            Ok(())
        })?;
        nodes.retain(|n| n.at.z_um.abs() <= nearest);
        truths.push((kind.to_owned(), Grid::new(&nodes)));
    }
    if truths.is_empty() {
        return Err(Error::input(format!(
            "{}: no column central_dx_px, forward_dx_px or weighted_dx_px",
            path.display()
        )));
    }
    Ok(truths)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::results::Position;

    #[test]
    fn the_truth_is_bilinear_between_nodes_and_absent_outside() {
        let node = |x: f64, y: f64| Vector {
            at: Position { x_px: x, y_px: y, z_um: 0.0 },
            moved: [1.0 + x + 2.0 * y + 0.5 * x * y, -x, 0.0],
            ..Vector::default()
        };
        let nodes: Vec<Vector> =
            [1.0, 5.0, 9.0].iter().flat_map(|&x| [2.0, 4.0].map(|y| node(x, y))).collect();
        let grid = Grid::new(&nodes);
        for (x, y) in [(1.0, 2.0), (9.0, 4.0), (3.0, 2.5), (6.0, 4.0)] {
            let found = grid.at(&node(x, y)).unwrap();
            // Rounding of a few operations on numbers of about 30.
            assert!((found[0] - node(x, y).moved[0]).abs() < 1e-12, "{x} {y}");
        }
        assert_eq!(grid.at(&node(0.9, 3.0)), None);
    }
}
