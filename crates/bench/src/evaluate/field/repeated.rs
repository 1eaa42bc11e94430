//! Bias and random error place by place, over repeated images of a flow.

use std::collections::BTreeMap;

use serde::Serialize;

use super::Compared;
use crate::evaluate::statistics::Errors;

/// Means over all places that have vectors of two image pairs or more.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
#[allow(missing_docs)]
pub struct Repeated {
    pub n_places: usize,
    /// Mean number of vectors at a place.
    pub mean_repeats: f64,
    /// Means of |b(x)| and s(x), where b and s are mean and standard deviation of the error at x.
    pub mean_abs_bias_u_px: f64,
    pub mean_random_u_px: f64,
    pub mean_abs_bias_v_px: f64,
    pub mean_random_v_px: f64,
}

impl Repeated {
    /// Of valid vectors; `None` if no place has two.
    pub fn of(all: &[Compared]) -> Option<Self> {
        let mut places: BTreeMap<(u64, u64), Vec<[f64; 2]>> = BTreeMap::new();
        for c in all {
            let key = (c.found.at.x_px.to_bits(), c.found.at.y_px.to_bits());
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
        (!places.is_empty()).then_some(Repeated {
            n_places: places.len(),
            mean_repeats,
            mean_abs_bias_u_px,
            mean_random_u_px,
            mean_abs_bias_v_px,
            mean_random_v_px,
        })
    }
}
