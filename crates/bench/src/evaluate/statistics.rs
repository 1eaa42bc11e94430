//! Ratios, errors and their bootstrap intervals.

use rand::rngs::Xoshiro256PlusPlus;
use rand::{Rng, SeedableRng};
use serde::Serialize;

/// `a / b`, or `None` for nothing by nothing.
pub fn ratio(a: f64, b: f64) -> Option<f64> {
    (b > 0.0).then(|| a / b)
}

/// Bias, random and total error: rms^2 = bias^2 + random^2.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize)]
pub struct Errors {
    /// Mean.
    pub bias: Option<f64>,
    /// Standard deviation about the mean (over n, not n - 1).
    pub random: Option<f64>,
    /// Root of the mean square.
    pub rms: Option<f64>,
}

impl Errors {
    /// Of these errors.
    pub fn of(errors: impl Iterator<Item = f64> + Clone) -> Self {
        let (n, sum, squares) =
            errors.clone().fold((0.0, 0.0, 0.0), |(n, s, q), e| (n + 1.0, s + e, q + e * e));
        let bias = ratio(sum, n);
        let random = bias.map(|b| (errors.map(|e| (e - b) * (e - b)).sum::<f64>() / n).sqrt());
        Errors { bias, random, rms: ratio(squares, n).map(f64::sqrt) }
    }
}

/// The quantile of sorted values, linear between them.
pub fn quantile(sorted: &[f64], share: f64) -> Option<f64> {
    let last = sorted.len().checked_sub(1)?;
    let at = share * last as f64;
    let (low, high) = (sorted[at.floor() as usize], sorted[at.ceil() as usize]);
    Some(low + (high - low) * at.fract())
}

/// Resamples of a bootstrap.
pub const RESAMPLES: usize = 1000;

/// Percentile intervals (95 %) of statistics under resampling of units (frames), which hold `N` sums each. `None` for
/// fewer than two units, or where a statistic is undefined in a resample.
pub fn bootstrap<const N: usize, const M: usize>(
    units: &[[f64; N]],
    seed: u64,
    statistics: impl Fn(&[f64; N]) -> [Option<f64>; M],
) -> [Option<[f64; 2]>; M] {
    if units.len() < 2 {
        return [None; M];
    }
    let mut rng = Xoshiro256PlusPlus::seed_from_u64(seed);
    let mut samples: Vec<Vec<f64>> = vec![Vec::with_capacity(RESAMPLES); M];
    for _ in 0..RESAMPLES {
        let mut sums = [0.0; N];
        for _ in 0..units.len() {
            let unit = ((u128::from(rng.next_u64()) * units.len() as u128) >> 64) as usize;
            sums.iter_mut().zip(&units[unit]).for_each(|(s, u)| *s += u);
        }
        for (sample, value) in samples.iter_mut().zip(statistics(&sums)) {
            sample.extend(value);
        }
    }
    let mut intervals = [None; M];
    for (interval, mut sample) in intervals.iter_mut().zip(samples) {
        if sample.len() == RESAMPLES {
            sample.sort_unstable_by(f64::total_cmp);
            *interval = quantile(&sample, 0.025).zip(quantile(&sample, 0.975)).map(|(a, b)| [a, b]);
        }
    }
    intervals
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn errors_add_in_squares() {
        let e = Errors::of([1.0, 3.0].into_iter());
        assert_eq!((e.bias, e.random, e.rms), (Some(2.0), Some(1.0), Some(5f64.sqrt())));
        assert_eq!(Errors::of(std::iter::empty()), Errors::default());
    }

    #[test]
    fn quantiles_lie_between_values() {
        assert_eq!(quantile(&[1.0, 2.0, 4.0], 0.75), Some(3.0));
        assert_eq!(quantile(&[], 0.5), None);
    }

    #[test]
    fn an_interval_of_a_mean_is_that_of_the_normal() {
        // 400 units, half 0, half 1: mean 0.5, standard error 0.025.
        let units: Vec<[f64; 1]> = (0..400).map(|i| [f64::from(i % 2)]).collect();
        let [interval] = bootstrap(&units, 1, |s| [Some(s[0] / 400.0)]);
        let [low, high] = interval.unwrap();
        // 1000 resamples know a 2.5 % quantile to about 0.1 standard errors.
        assert!((low - 0.451).abs() < 0.006 && (high - 0.549).abs() < 0.006, "{low} {high}");
        assert_eq!(bootstrap(&units[..1], 1, |s| [Some(s[0])]), [None]);
    }
}
