//! Errors of a displacement field against one true field.

use std::collections::{BTreeMap, BTreeSet};

use super::gradients::Gradients;
use super::nodes::{FEW_SQUARES, block};
use super::peak_locking::PeakLocking;
use super::spectrum::{self, Spectrum};
use super::vectors::{ComparedVector, INLIER_PX, VectorGrid};
use crate::evaluate::statistics::{Errors, Interval, add, quantile, ratio, sorted};
use crate::evaluate::uncertainty::Uncertainty;
use crate::results::FlowVector;

/// Smallest displacement used as a denominator of relative errors, px.
const FLOOR_PX: f64 = 0.1;

scores! {
    /// Errors of one component.
    pub struct ComponentErrors {
        /// Mean error.
        pub bias_px: Option<f64>,
        /// Standard deviation of the error about its mean.
        not_negative random_px: Option<f64>,
        /// RMS error: rms^2 = bias^2 + random^2.
        not_negative rms_px: Option<f64>,
        /// Mean absolute error, |e|.
        not_negative mae_px: Option<f64>,
        /// Median absolute error.
        not_negative median_abs_px: Option<f64>,
        /// 95 % quantile of the absolute error.
        not_negative p95_abs_px: Option<f64>,
    }
}

impl ComponentErrors {
    fn of(errors: &[f64]) -> Self {
        let e = Errors::of(errors.iter().copied());
        let sizes = sorted(errors.iter().map(|e| e.abs()));
        ComponentErrors {
            bias_px: e.bias,
            random_px: e.random,
            rms_px: e.rms,
            mae_px: ratio(sizes.iter().sum(), sizes.len() as f64),
            median_abs_px: quantile(&sizes, 0.5),
            p95_abs_px: quantile(&sizes, 0.95),
        }
    }
}

scores! {
    /// Errors against one true field, over valid vectors; inliers have an end-point error below
    /// outlier_threshold_px.
    pub struct FieldErrors {
        /// Errors of u.
        pub u: ComponentErrors,
        /// Errors of v.
        pub v: ComponentErrors,
        /// Errors of u over inliers.
        pub u_inliers: ComponentErrors,
        /// Errors of v over inliers.
        pub v_inliers: ComponentErrors,
        /// RMS error of dz; null if the result has no dz.
        not_negative w_rms_um: Option<f64>,
        /// Average end-point error (AEE): mean of |u_result - u_true|.
        not_negative aee_px: Option<f64>,
        /// 100 AEE, in px per 100 px, as listed in the deep-learning PIV literature.
        not_negative aee_per_100px: Option<f64>,
        /// RMS end-point error.
        not_negative epe_rms_px: Option<f64>,
        /// Normalized end-point error: mean of end-point error / max(|u_true|, 0.1 px).
        not_negative nepe: Option<f64>,
        /// Mean angle between (u, v, 1) of result and truth (Barron et al., IJCV 12, 1994).
        not_negative angular_error_deg: Option<f64>,
        /// Threshold: a vector whose end-point error is at least this large is an outlier.
        not_negative outlier_threshold_px: f64,
        /// Fraction of outliers among valid vectors.
        fraction outlier_fraction: Option<f64>,
        /// Fraction of all vectors with a truth that are valid and have an end-point error below 1 px.
        fraction valid_vector_probability: Option<f64>,
        /// The same with a threshold of 0.5 px.
        fraction valid_vector_probability_strict: Option<f64>,
        /// Amplitude response: slope of a linear regression of the measured u on the true u, over inliers.
        pub modulation_u: Option<f64>,
        /// Amplitude response of v, defined as modulation_u.
        pub modulation_v: Option<f64>,
        /// Fraction of vectors whose error |e_u| is at most the claimed uncertainty U.
        fraction coverage_1s_u: Option<f64>,
        /// Fraction of vectors with |e_u| <= 2 U.
        fraction coverage_2s_u: Option<f64>,
        /// coverage_1s_u over inliers.
        fraction coverage_1s_u_inliers: Option<f64>,
        /// Ratio of the RMS error of u to the RMS claimed uncertainty, rms(e_u) / rms(U).
        not_negative uncertainty_ratio_u: Option<f64>,
        /// Calibration of claimed uncertainties.
        pub uncertainty: VectorUncertainty,
        /// Peak locking of u.
        pub peak_locking: PeakLocking,
        /// Errors of gradients.
        pub gradients: Option<Gradients>,
        /// Spectra along complete rows and columns.
        pub spectra: Vec<Spectrum>,
        /// Errors over repeated image pairs.
        pub repeated: Option<EnsembleErrors>,
        /// 95 % bootstrap interval of AEE, resampling squares of 32 px as for reference nodes.
        not_negative interval_aee_px: Interval,
        /// 95 % bootstrap interval of valid_vector_probability.
        fraction interval_valid_vector_probability: Interval,
        /// 95 % bootstrap interval of u_inliers.rms_px.
        not_negative interval_rms_u_inliers_px: Interval,
        /// 95 % bootstrap interval of v_inliers.rms_px.
        not_negative interval_rms_v_inliers_px: Interval,
    }

    /// Calibration of claimed uncertainties of vectors.
    pub struct VectorUncertainty {
        /// Calibration for u.
        pub u: Option<Uncertainty>,
        /// Calibration for v.
        pub v: Option<Uncertainty>,
        /// Calibration for u of inliers.
        pub u_inliers: Option<Uncertainty>,
        /// Calibration for v of inliers.
        pub v_inliers: Option<Uncertainty>,
    }
}

impl FieldErrors {
    /// Errors of `compared`, the valid and interpolated vectors with a truth; `vectors` are all vectors with
    /// a truth, invalid ones included.
    pub(super) fn of(compared: &[ComparedVector], vectors: &[FlowVector], seed: u64) -> Self {
        let all: Vec<ComparedVector> = compared.iter().copied().filter(|c| c.measured.flag == 0).collect();
        let all = all.as_slice();
        let inliers: Vec<ComparedVector> = all.iter().copied().filter(|c| c.endpoint() < INLIER_PX).collect();
        let component = |of: &[ComparedVector], k: usize| {
            ComponentErrors::of(&of.iter().map(|c| c.error()[k]).collect::<Vec<_>>())
        };
        let n = all.len() as f64;
        let n_total = vectors.len();
        let mean = |f: &dyn Fn(&ComparedVector) -> f64| ratio(all.iter().map(f).sum(), n);
        let claims = |of: &[ComparedVector], k: usize| {
            Uncertainty::of(of.iter().map(|c| (c.error()[k], c.measured.sigma[k])))
        };
        let uncertainty = VectorUncertainty {
            u: claims(all, 0),
            v: claims(all, 1),
            u_inliers: claims(&inliers, 0),
            v_inliers: claims(&inliers, 1),
        };
        let of_u = |f: &dyn Fn(&Uncertainty) -> Option<f64>| uncertainty.u.as_ref().and_then(f);
        let depth: Vec<f64> =
            all.iter().map(|c| c.measured.moved[2] - c.truth[2]).filter(|w| w.is_finite()).collect();
        let within = |most: f64| all.iter().filter(|c| c.endpoint() < most).count() as f64;
        let aee_px = mean(&ComparedVector::endpoint);
        let [aee, valid, rms_u, rms_v] = intervals(all, vectors, seed);
        let grid = VectorGrid::new(compared);
        FieldErrors {
            u: component(all, 0),
            v: component(all, 1),
            u_inliers: component(&inliers, 0),
            v_inliers: component(&inliers, 1),
            w_rms_um: Errors::of(depth.iter().copied()).rms,
            aee_px,
            aee_per_100px: aee_px.map(|a| 100.0 * a),
            epe_rms_px: mean(&|c| c.endpoint().powi(2)).map(f64::sqrt),
            nepe: mean(&|c| c.endpoint() / c.truth[0].hypot(c.truth[1]).max(FLOOR_PX)),
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
            gradients: grid.as_ref().and_then(|l| Gradients::of(l, compared)),
            spectra: grid.as_ref().map(|l| spectrum::spectra(l, compared)).unwrap_or_default(),
            repeated: EnsembleErrors::of(all),
            interval_aee_px: aee,
            interval_valid_vector_probability: valid,
            interval_rms_u_inliers_px: rms_u,
            interval_rms_v_inliers_px: rms_v,
        }
    }
}

/// Intervals of AEE, valid-vector probability, and RMS errors of u and v over inliers.
fn intervals(valid: &[ComparedVector], vectors: &[FlowVector], seed: u64) -> [Interval; 4] {
    let of_vector = |c: &ComparedVector| {
        let [u, v] = c.error();
        let inlier = f64::from(u8::from(c.endpoint() < INLIER_PX));
        [0.0, 1.0, c.endpoint(), inlier, inlier * u * u, inlier * v * v]
    };
    let total = [1.0, 0.0, 0.0, 0.0, 0.0, 0.0];
    // As for reference nodes: errors of vectors with common pixels are correlated, and repeat in a steady flow.
    let square = |v: &FlowVector| [block(v.at.x_px), block(v.at.y_px)];
    let squares: BTreeSet<[u32; 2]> = vectors.iter().map(square).collect();
    let mut units: BTreeMap<(u32, [u32; 2]), [f64; 6]> = BTreeMap::new();
    let found = valid.iter().map(|c| (&c.measured, of_vector(c)));
    for (v, sums) in found.chain(vectors.iter().map(|v| (v, total))) {
        let pair = if squares.len() < FEW_SQUARES { v.pair.unwrap_or(0) } else { 0 };
        add(units.entry((pair, square(v))).or_default(), &sums);
    }
    let units: Vec<[f64; 6]> = units.into_values().collect();
    super::super::statistics::intervals(&units, seed, |&[n_total, n, sum, inliers, u, v]| {
        let root = |squares: f64| ratio(squares, inliers).map(f64::sqrt);
        [ratio(sum, n), ratio(inliers, n_total), root(u), root(v)]
    })
}

/// Angle between the measured and the true (u, v, 1), rad (Barron et al., IJCV 12, 1994).
fn angle(c: &ComparedVector) -> f64 {
    let ([u, v, _], [a, b, _]) = (c.measured.moved, c.truth);
    let cosine = (1.0 + u * a + v * b) / ((1.0 + u * u + v * v) * (1.0 + a * a + b * b)).sqrt();
    cosine.clamp(-1.0, 1.0).acos()
}

fn modulation(inliers: &[ComparedVector], k: usize) -> Option<f64> {
    let n = inliers.len() as f64;
    let mean_exact = ratio(inliers.iter().map(|c| c.truth[k]).sum(), n)?;
    let (mut both, mut exact) = (0.0, 0.0);
    for c in inliers {
        both += c.measured.moved[k] * (c.truth[k] - mean_exact);
        exact += (c.truth[k] - mean_exact).powi(2);
    }
    // Undefined for a uniform flow.
    ratio(both, exact).filter(|_| exact > 1e-12 * n)
}

scores! {
    /// Bias and random error at each position over repeated image pairs, averaged over positions.
    pub struct EnsembleErrors {
        /// Number of positions that have valid vectors in at least two image pairs.
        pub n_places: usize,
        /// Mean number of vectors at a position.
        not_negative mean_repeats: f64,
        /// Mean over positions x of |b(x)|, where b(x) is the mean error of u at x.
        not_negative mean_abs_bias_u_px: f64,
        /// Mean over positions x of s(x), the standard deviation of the error of u at x.
        not_negative mean_random_u_px: f64,
        /// Mean of |b(x)| for v.
        not_negative mean_abs_bias_v_px: f64,
        /// Mean of s(x) for v.
        not_negative mean_random_v_px: f64,
    }
}

impl EnsembleErrors {
    /// Errors over valid vectors; `None` if no position has at least two.
    pub fn of(all: &[ComparedVector]) -> Option<Self> {
        let mut places: BTreeMap<(u64, u64), Vec<[f64; 2]>> = BTreeMap::new();
        for c in all {
            let key = (c.measured.at.x_px.to_bits(), c.measured.at.y_px.to_bits());
            places.entry(key).or_default().push(c.error());
        }
        places.retain(|_, errors| errors.len() > 1);
        let n = places.len() as f64;
        let mut sums = [0.0; 5];
        for errors in places.values() {
            let [u, v] = [0, 1].map(|k| Errors::of(errors.iter().map(move |e| e[k])));
            let of_place = [
                errors.len() as f64,
                u.bias.unwrap_or(0.0).abs(),
                u.random.unwrap_or(0.0),
                v.bias.unwrap_or(0.0).abs(),
                v.random.unwrap_or(0.0),
            ];
            sums.iter_mut().zip(of_place).for_each(|(s, v)| *s += v);
        }
        let [mean_repeats, mean_abs_bias_u_px, mean_random_u_px, mean_abs_bias_v_px, mean_random_v_px] =
            sums.map(|s| s / n);
        (!places.is_empty()).then_some(EnsembleErrors {
            n_places: places.len(),
            mean_repeats,
            mean_abs_bias_u_px,
            mean_random_u_px,
            mean_abs_bias_v_px,
            mean_random_v_px,
        })
    }
}
