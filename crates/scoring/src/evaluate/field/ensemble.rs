use std::collections::BTreeMap;

use super::compared::ComparedVector;
use crate::evaluate::statistics::Errors;

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
