//! Ratios, error statistics and bootstrap intervals.

use rand::rngs::Xoshiro256PlusPlus;
use rand::{Rng, SeedableRng};
use serde::{Deserialize, Deserializer};

/// `a / b`, or `None` unless `b` is positive.
pub fn ratio(a: f64, b: f64) -> Option<f64> {
    // + 0.0 turns -0 (the sum of an empty iterator) into 0.
    (b > 0.0).then(|| a / b + 0.0)
}

/// Bias, random error and RMS error: rms^2 = bias^2 + random^2.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Errors {
    /// Mean of the errors.
    pub bias: Option<f64>,
    /// Standard deviation about the mean (divisor n, not n - 1).
    pub random: Option<f64>,
    /// Root mean square.
    pub rms: Option<f64>,
}

impl Errors {
    /// Statistics of these errors; all `None` if there are none.
    pub fn of(errors: impl Iterator<Item = f64> + Clone) -> Self {
        let (n, sum, squares) =
            errors.clone().fold((0.0, 0.0, 0.0), |(n, s, q), e| (n + 1.0, s + e, q + e * e));
        let bias = ratio(sum, n);
        let random = bias.map(|b| (errors.map(|e| (e - b) * (e - b)).sum::<f64>() / n).sqrt());
        Errors { bias, random, rms: ratio(squares, n).map(f64::sqrt) }
    }
}

/// Quantile `share` (0 to 1) of sorted values, with linear interpolation; `None` without values.
pub fn quantile(sorted: &[f64], share: f64) -> Option<f64> {
    let last = sorted.len().checked_sub(1)?;
    let at = share * last as f64;
    let (low, high) = (sorted[at.floor() as usize], sorted[at.ceil() as usize]);
    Some(low + (high - low) * at.fract())
}

/// The values, ascending.
pub fn sorted(values: impl Iterator<Item = f64>) -> Vec<f64> {
    let mut values: Vec<f64> = values.collect();
    values.sort_unstable_by(f64::total_cmp);
    values
}

/// The different values, ascending.
pub fn distinct(values: impl Iterator<Item = f64>) -> Vec<f64> {
    let mut values = sorted(values);
    values.dedup();
    values
}

/// The median; `None` without values.
pub fn median(values: impl Iterator<Item = f64>) -> Option<f64> {
    quantile(&sorted(values), 0.5)
}

/// Reads null as infinity, which JSON cannot represent.
pub(super) fn or_infinite<'de, D: Deserializer<'de>>(source: D) -> Result<f64, D::Error> {
    Ok(Option::<f64>::deserialize(source)?.unwrap_or(f64::INFINITY))
}

/// A 95 % interval [low, high]; null if undefined.
pub type Interval = Option<[f64; 2]>;

/// Smallest number of resampling units for an interval.
pub(crate) const FEWEST: usize = 5;

/// Number of bootstrap resamples.
pub const RESAMPLES: usize = 1000;

/// More units than this are merged into blocks, which leaves the variance of sums unchanged.
pub(super) const BLOCKS: usize = 2000;

/// Share of the resamples below the interval of a score with one-sided error `share` (0.025 for 95 %), from `units`
/// units. The percentiles of few units are too close: they spread as a variance with divisor n instead
/// of n - 1, and normal where Student's t applies; so the share is lowered (expanded percentile interval; Hesterberg,
/// Am. Stat. 69, 371, 2015). Of 5 units 0.001 instead of 0.025, of 30 units 0.019.
pub(crate) fn tail(units: usize, share: f64) -> f64 {
    let below = |z: f64| 0.5 * libm::erfc(z / std::f64::consts::SQRT_2);
    // The normal quantile, by bisection.
    let (mut low, mut high) = (0.0, 10.0);
    for _ in 0..60 {
        let z = 0.5 * (low + high);
        if below(z) > share { low = z } else { high = z }
    }
    let (z, n, nu) = (low, units as f64, (units - 1) as f64);
    let s = z * z;
    // Student's t by its series in 1 / nu (Abramowitz and Stegun 26.7.5), within 1 % from 4 on.
    let t = z
        * (1.0
            + (s + 1.0) / (4.0 * nu)
            + ((5.0 * s + 16.0) * s + 3.0) / (96.0 * nu * nu)
            + (((3.0 * s + 19.0) * s + 17.0) * s - 15.0) / (384.0 * nu.powi(3)));
    below(t * (n / nu).sqrt())
}

/// 95 % intervals of `M` statistics of the `N` sums of resampled units. `None` for fewer than five units, or
/// if a statistic is undefined in any resample.
pub fn intervals<const N: usize, const M: usize>(
    units: &[[f64; N]],
    seed: u64,
    statistics: impl Fn(&[f64; N]) -> [Option<f64>; M],
) -> [Interval; M] {
    if units.len() < FEWEST {
        return [None; M];
    }
    let mut blocks = vec![[0.0; N]; units.len().min(BLOCKS)];
    units.iter().enumerate().for_each(|(i, unit)| add(&mut blocks[i % BLOCKS], unit));
    let mut rng = Xoshiro256PlusPlus::seed_from_u64(seed);
    let mut samples: Vec<Vec<f64>> = vec![Vec::with_capacity(RESAMPLES); M];
    for _ in 0..RESAMPLES {
        let mut sums = [0.0; N];
        for _ in 0..blocks.len() {
            let drawn = ((u128::from(rng.next_u64()) * blocks.len() as u128) >> 64) as usize;
            add(&mut sums, &blocks[drawn]);
        }
        for (sample, value) in samples.iter_mut().zip(statistics(&sums)) {
            sample.extend(value);
        }
    }
    let tail = tail(blocks.len(), 0.025);
    let mut intervals = [None; M];
    for (interval, mut sample) in intervals.iter_mut().zip(samples) {
        if sample.len() == RESAMPLES {
            sample.sort_unstable_by(f64::total_cmp);
            *interval = quantile(&sample, tail).zip(quantile(&sample, 1.0 - tail)).map(|(a, b)| [a, b]);
        }
    }
    intervals
}

/// How often each of `units` units is drawn in each of [`RESAMPLES`] resamples.
pub(crate) fn draws(units: usize, seed: u64) -> Vec<Vec<u16>> {
    let mut rng = Xoshiro256PlusPlus::seed_from_u64(seed);
    let draw = |rng: &mut Xoshiro256PlusPlus| ((u128::from(rng.next_u64()) * units as u128) >> 64) as usize;
    (0..RESAMPLES)
        .map(|_| {
            let mut counts = vec![0; units];
            (0..units).for_each(|_| counts[draw(&mut rng)] += 1);
            counts
        })
        .collect()
}

pub(crate) fn add<const N: usize>(sums: &mut [f64; N], more: &[f64; N]) {
    sums.iter_mut().zip(more).for_each(|(s, m)| *s += m);
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
    fn few_units_have_wider_intervals() {
        // Student's t for 0.025 and 4, 29 and infinitely many degrees of freedom: 2.776, 2.045, 1.960; normal tails of
        // 2.776 sqrt(5 / 4) = 3.104 and 2.045 sqrt(30 / 29) = 2.080.
        // The series is 0.3 % below the true 2.776, which is 3 % of the tail.
        for (units, expected) in [(5, 0.000_955), (30, 0.018_76), (1_000_000, 0.025)] {
            assert!((tail(units, 0.025) / expected - 1.0).abs() < 0.04, "{units}: {}", tail(units, 0.025));
        }
    }

    #[test]
    fn an_interval_of_a_mean_is_that_of_the_normal() {
        // 400 units, half 0, half 1: mean 0.5, standard error 0.025.
        let units: Vec<[f64; 1]> = (0..400).map(|i| [f64::from(i % 2)]).collect();
        let [interval] = intervals(&units, 1, |s| [Some(s[0] / 400.0)]);
        let [low, high] = interval.unwrap();
        // With 1000 resamples the 2.5 % quantile is uncertain by about 0.1 standard errors.
        assert!((low - 0.451).abs() < 0.006 && (high - 0.549).abs() < 0.006, "{low} {high}");
        // Four units are too few for a 95 % interval: 1 in 256 resamples draws the same unit four times.
        assert_eq!(intervals(&units[..4], 1, |s| [Some(s[0])]), [None]);
        assert!(intervals(&units[..5], 1, |s| [Some(s[0])])[0].is_some());
        assert_eq!(ratio(-0.0, 1.0).map(f64::to_bits), Some(0));
        // 20,000 units in 2000 blocks: the standard error of their mean is still 0.5 / sqrt(20000) = 0.0035.
        let coin =
            |i: u32| f64::from(i.wrapping_mul(2_654_435_761).rotate_left(11).wrapping_mul(0x9e37_79b1) >> 31);
        let many: Vec<[f64; 1]> = (0..20_000).map(|i| [coin(i)]).collect();
        let [interval] = intervals(&many, 1, |s| [Some(s[0] / 20_000.0)]);
        let [low, high] = interval.unwrap();
        // 2000 blocks give the standard deviation to 2 %, 1000 resamples its quantiles to 5 %.
        assert!(((high - low) / (2.0 * 1.96 * 0.003_54) - 1.0).abs() < 0.15, "{low} {high}");
    }
}
