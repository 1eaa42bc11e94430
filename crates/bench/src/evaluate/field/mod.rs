//! Scores of displacement fields (PIV): every vector against the truth at its place.
//!
//! The truth is bilinear between the nodes of `truth/field.csv`; of several planes one is taken (`grid.rs`). Errors are
//! result - truth over valid vectors (flag 0); interpolated ones (flag 2) are counted apart. Definitions: docs/scoring.md.

mod gradients;
pub(crate) mod grid;
mod lattice;
mod locking;
mod repeated;
mod spectrum;

use std::collections::BTreeMap;
use std::path::Path;

use serde::Serialize;

use super::statistics::{Bootstrap, Errors, Interval, quantile, ratio};
use super::truth::Facts;
use super::uncertainty::Uncertainty;
use crate::error::Result;
use crate::results::{Field, Vector};
pub use gradients::Gradients;
use lattice::Lattice;
pub use locking::PeakLocking;
pub use repeated::Repeated;
pub use spectrum::{Spectrum, Wave};

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
    /// Depth of the plane whose truth it is, um; null of a bare table.
    pub plane_um: Option<f64>,
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
    /// Valid and within 1 px (0.5 px), of all vectors of the result that there is a truth of.
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
    pub uncertainty: Claims,
    pub peak_locking: PeakLocking,
    pub gradients: Option<Gradients>,
    pub spectra: Vec<Spectrum>,
    pub repeated: Option<Repeated>,
    /// 95 % intervals under resampling of image pairs if there are ten or more, of vectors if there are fewer.
    pub interval_aee_px: Interval,
    pub interval_valid_vector_probability: Interval,
    pub interval_rms_u_inliers_px: Interval,
    pub interval_rms_v_inliers_px: Interval,
}

/// Claimed uncertainties of both components, of all valid vectors and of inliers.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
#[allow(missing_docs)]
pub struct Claims {
    pub u: Option<Uncertainty>,
    pub v: Option<Uncertainty>,
    pub u_inliers: Option<Uncertainty>,
    pub v_inliers: Option<Uncertainty>,
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
    /// Result - truth along x and y, px.
    pub fn error(&self) -> [f64; 2] {
        [self.found.moved[0] - self.exact[0], self.found.moved[1] - self.exact[1]]
    }

    /// Length of the error in the image plane, px.
    pub fn endpoint(&self) -> f64 {
        let [u, v] = self.error();
        (u * u + v * v).sqrt()
    }
}

/// A scored field.
#[derive(Debug, Clone, Default)]
pub struct Scored {
    /// The scores.
    pub score: FieldScore,
    /// Valid and interpolated vectors beside their main truth.
    pub vectors: Vec<Compared>,
    /// What the truth was taken to be, if that needs words.
    pub notes: Vec<String>,
    /// What looks like a mistake of conventions.
    pub warnings: Vec<String>,
}

/// Scores a field against a dataset, on the plane nearest to a depth, or against a bare table of a field.
///
/// # Errors
/// A truth that is missing or cannot be read.
pub fn evaluate(dataset: &Path, field: &Field, plane_um: Option<f64>, seed: u64) -> Result<Scored> {
    let (truths, plane_um, facts, note) = if dataset.is_dir() {
        let of_plane = grid::of_dataset(dataset, plane_um)?;
        (of_plane.named, Some(of_plane.plane_um), of_plane.facts, of_plane.note)
    } else {
        (grid::bare(dataset)?, None, Facts::default(), None)
    };
    let is_there = |v: &Vector| v.pair.is_none_or(|pair| facts.has_pair(pair));
    let count = |flag: u8| field.vectors.iter().filter(|v| v.flag == flag).count();
    let n_total = field.vectors.len();
    let mut scored = Scored {
        score: FieldScore {
            n_total,
            n_reported: count(0),
            n_interpolated: count(2),
            data_yield: ratio(count(0) as f64, n_total as f64),
            plane_um,
            ..FieldScore::default()
        },
        notes: note.into_iter().collect(),
        ..Scored::default()
    };
    for (i, (name, grid)) in truths.iter().enumerate() {
        // Where there is no truth, as in a body, nothing can be asked for.
        let there = field.vectors.iter().filter(|v| is_there(v));
        let asked: Vec<Compared> =
            there.filter_map(|v| Some(Compared { found: *v, exact: grid.at(v)? })).collect();
        let compared: Vec<Compared> = asked.iter().copied().filter(|c| c.found.flag != 1).collect();
        let asked: Vec<Vector> = asked.into_iter().map(|c| c.found).collect();
        let against = Against::of(&compared, &asked, seed);
        if i == 0 {
            let valid = compared.iter().filter(|c| c.found.flag == 0).count();
            scored.score.n_outside = scored.score.n_reported - valid;
            (scored.score.against, scored.score.main) = (name.clone(), against.clone());
            scored.warnings = warnings(&compared, &scored.score, grid);
            scored.vectors = compared;
        }
        scored.score.truths.insert(name.clone(), against);
    }
    let mut unknown: Vec<u32> =
        field.vectors.iter().filter(|v| !is_there(v)).filter_map(|v| v.pair).collect();
    if !unknown.is_empty() {
        let n = unknown.len();
        unknown.sort_unstable();
        unknown.dedup();
        let first: Vec<String> = unknown.iter().take(5).map(u32::to_string).collect();
        let more = if unknown.len() > 5 { ", ..." } else { "" };
        let pairs = format!("{}{more}", first.join(", "));
        scored
            .warnings
            .push(format!("{n} vectors are of image pairs that the dataset does not have ({pairs})"));
    }
    Ok(scored)
}

/// What looks like a mistake of conventions rather than of a method.
fn warnings(compared: &[Compared], score: &FieldScore, grid: &grid::Grid) -> Vec<String> {
    let mut warnings = Vec::new();
    if 10 * score.n_outside > score.n_reported {
        let pairs = if grid.needs_pairs() { ", or the file does not tell their image pair" } else { "" };
        warnings.push(format!(
            "{} of {} valid vectors have no truth: they lie outside of its grid{pairs}",
            score.n_outside, score.n_reported
        ));
    }
    let squares = |sign: f64| -> f64 {
        compared.iter().map(|c| (sign * c.found.moved[1] - c.exact[1]).powi(2)).sum::<f64>()
    };
    if compared.len() >= 10 && squares(-1.0) < 0.25 * squares(1.0) {
        warnings.push("v has the wrong sign? y may grow upward in the result: --y up".to_owned());
    }
    warnings
}

impl Against {
    /// Of vectors beside their truth, and all vectors of the result that there is a truth of.
    fn of(compared: &[Compared], vectors: &[Vector], seed: u64) -> Self {
        let all: Vec<Compared> = compared.iter().copied().filter(|c| c.found.flag == 0).collect();
        let all = all.as_slice();
        let inliers: Vec<Compared> = all.iter().copied().filter(|c| c.endpoint() < INLIER_PX).collect();
        let component =
            |of: &[Compared], k: usize| Component::of(&of.iter().map(|c| c.error()[k]).collect::<Vec<_>>());
        let n = all.len() as f64;
        let n_total = vectors.len();
        let mean = |f: &dyn Fn(&Compared) -> f64| ratio(all.iter().map(f).sum(), n);
        let claims =
            |of: &[Compared], k: usize| Uncertainty::of(of.iter().map(|c| (c.error()[k], c.found.sigma[k])));
        let uncertainty = Claims {
            u: claims(all, 0),
            v: claims(all, 1),
            u_inliers: claims(&inliers, 0),
            v_inliers: claims(&inliers, 1),
        };
        let of_u = |f: &dyn Fn(&Uncertainty) -> Option<f64>| uncertainty.u.as_ref().and_then(f);
        let depth: Vec<f64> =
            all.iter().map(|c| c.found.moved[2] - c.exact[2]).filter(|w| w.is_finite()).collect();
        let within = |most: f64| all.iter().filter(|c| c.endpoint() < most).count() as f64;
        let aee_px = mean(&Compared::endpoint);
        let [aee, valid, rms_u, rms_v] = intervals(all, vectors, seed);
        let lattice = Lattice::new(compared);
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
            coverage_1s_u: of_u(&|u| u.coverage_1s),
            coverage_2s_u: of_u(&|u| u.coverage_2s),
            coverage_1s_u_inliers: uncertainty.u_inliers.as_ref().and_then(|u| u.coverage_1s),
            uncertainty_ratio_u: of_u(&|u| u.ratio),
            uncertainty,
            peak_locking: PeakLocking::of(all),
            gradients: lattice.as_ref().and_then(|l| Gradients::of(l, compared)),
            spectra: lattice.as_ref().map(|l| spectrum::spectra(l, compared)).unwrap_or_default(),
            repeated: Repeated::of(all),
            interval_aee_px: aee,
            interval_valid_vector_probability: valid,
            interval_rms_u_inliers_px: rms_u,
            interval_rms_v_inliers_px: rms_v,
        }
    }
}

/// Image pairs from which on they are the units of the bootstrap: vectors of a pair share its particles.
const PAIRS: usize = 10;

/// Intervals of AEE, probability of a valid vector, RMS of inliers in u and in v.
fn intervals(valid: &[Compared], vectors: &[Vector], seed: u64) -> [Interval; 4] {
    let of_vector = |c: &Compared| {
        let [u, v] = c.error();
        let inlier = f64::from(u8::from(c.endpoint() < INLIER_PX));
        [0.0, 1.0, c.endpoint(), inlier, inlier * u * u, inlier * v * v]
    };
    let total = [1.0, 0.0, 0.0, 0.0, 0.0, 0.0];
    let bootstrap = Bootstrap { seed, pairs: false };
    let number = |v: &Vector| v.pair.unwrap_or(0);
    let mut pairs: Vec<u32> = vectors.iter().map(number).collect();
    pairs.sort_unstable();
    pairs.dedup();
    let units = if pairs.len() >= PAIRS {
        let found = valid.iter().map(|c| (number(&c.found), of_vector(c)));
        bootstrap.by_frame(found.chain(vectors.iter().map(|v| (number(v), total))))
    } else {
        let mut units: Vec<[f64; 6]> = valid.iter().map(of_vector).collect();
        units.iter_mut().for_each(|unit| unit[0] = 1.0);
        units.resize(vectors.len(), total);
        units
    };
    bootstrap.intervals(&units, |&[n_total, n, sum, inliers, u, v]| {
        let root = |squares: f64| ratio(squares, inliers).map(f64::sqrt);
        [ratio(sum, n), ratio(inliers, n_total), root(u), root(v)]
    })
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
