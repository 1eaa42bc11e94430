//! Diameters of tracer particles.

use crate::error::{ParameterCheck, Result};
use microsig_core::random::normal;
use microsig_core::stream::Stream;
use std::f64::consts::{PI, SQRT_2};

const CHECK: ParameterCheck = ParameterCheck("diameters");

/// Smallest fraction of a distribution that may lie within its limits; below it redrawing takes too long.
const MIN_SHARE: f64 = 1e-3;

/// Maximum length of a list of which each diameter is representative.
const MOST_LISTED: usize = 8;

/// Quantiles that represent a continuous distribution.
const REPRESENTATIVE: [f64; 3] = [0.1, 0.5, 0.9];

/// If the outer of these quantiles differ by less than this factor, the mean diameter represents all.
const ALIKE: f64 = 1.1;

/// A distribution of diameters, um.
#[derive(Debug, Clone, PartialEq)]
pub struct Diameters(Distribution);

#[derive(Debug, Clone, PartialEq)]
enum Distribution {
    Equal(f64),
    Uniform {
        min: f64,
        max: f64,
    },
    /// Truncated; lognormal if `log`: `mean` and `sd` refer to ln d.
    Normal {
        log: bool,
        mean: f64,
        sd: f64,
        min: f64,
        max: f64,
    },
    /// Diameters with their cumulative weights; the last is 1.
    List(Vec<(f64, f64)>),
}

impl Diameters {
    /// All diameters equal, um, > 0.
    pub fn equal(diameter: f64) -> Result<Self> {
        Ok(Diameters(Distribution::Equal(CHECK.positive("diameter_um", diameter)?)))
    }

    /// Uniform between `min` and `max`, um, 0 < min <= max.
    pub fn uniform(min: f64, max: f64) -> Result<Self> {
        check_limits(min, max)?;
        Ok(Diameters(Distribution::Uniform { min, max }))
    }

    /// Normal distribution (um) truncated to `min`..`max` by redrawing (not by clipping, which would
    /// accumulate particles at the limits); at least 0.1 % of the distribution must lie within the limits.
    pub fn normal(mean: f64, sd: f64, min: f64, max: f64) -> Result<Self> {
        CHECK.positive("mean_um", mean)?;
        CHECK.positive("sd_um", sd)?;
        Self::truncated(false, mean, sd, (min, max))
    }

    /// Lognormal distribution (um), truncated like [`Diameters::normal`], with `mean` and `sd` of the
    /// diameter, not of its logarithm, before truncation.
    pub fn lognormal(mean: f64, sd: f64, min: f64, max: f64) -> Result<Self> {
        CHECK.positive("mean_um", mean)?;
        CHECK.positive("sd_um", sd)?;
        let variance = libm::log1p(sd * sd / (mean * mean));
        Self::truncated(true, libm::log(mean) - 0.5 * variance, libm::sqrt(variance), (min, max))
    }

    fn truncated(log: bool, mean: f64, sd: f64, (min, max): (f64, f64)) -> Result<Self> {
        check_limits(min, max)?;
        let at = |d: f64| cumulative((if log { libm::log(d) } else { d } - mean) / sd);
        let share = at(max) - at(min);
        if share.is_nan() || share < MIN_SHARE {
            let allowed = "limits that contain at least 0.1 % of the distribution";
            return Err(CHECK.fault("min_um..max_um", format!("{min}..{max}"), allowed));
        }
        Ok(Diameters(Distribution::Normal { log, mean, sd, min, max }))
    }

    /// A discrete distribution: pairs of a diameter (um, > 0) and its weight (> 0); probabilities are
    /// proportional to the weights.
    pub fn list(weighted: &[(f64, f64)]) -> Result<Self> {
        let mut total = 0.0;
        for (diameter, weight) in weighted {
            CHECK.positive("diameter_um", *diameter)?;
            total += CHECK.positive("weight", *weight)?;
        }
        if weighted.is_empty() {
            return Err(CHECK.fault("list", "empty", "one diameter or more"));
        }
        CHECK.positive("sum of weights", total)?;
        let mut sum = 0.0;
        let list = weighted.iter().map(|(diameter, weight)| {
            sum += weight / total;
            (*diameter, sum)
        });
        Ok(Diameters(Distribution::List(list.collect())))
    }

    /// A random diameter, um.
    pub fn draw(&self, stream: &mut Stream) -> f64 {
        match self.0 {
            Distribution::List(ref list) => {
                let u = stream.uniform();
                // Rounding may make the last cumulative weight less than u.
                let at = list.partition_point(|(_, sum)| *sum <= u).min(list.len() - 1);
                list[at].0
            }
            Distribution::Equal(diameter) => diameter,
            Distribution::Uniform { min, max } => min + (max - min) * stream.uniform(),
            Distribution::Normal { log, mean, sd, min, max } => loop {
                let drawn = mean + sd * normal(stream);
                let diameter = if log { libm::exp(drawn) } else { drawn };
                if (min..=max).contains(&diameter) {
                    break diameter;
                }
            },
        }
    }

    /// The mean of the truncated distribution, um.
    pub fn mean(&self) -> f64 {
        match self.0 {
            Distribution::Equal(diameter) => diameter,
            Distribution::Uniform { min, max } => 0.5 * (min + max),
            Distribution::Normal { log, mean, sd, min, max } => {
                let [low, high] = [min, max].map(|d| (if log { libm::log(d) } else { d } - mean) / sd);
                let share = cumulative(high) - cumulative(low);
                if log {
                    libm::exp(mean + 0.5 * sd * sd) * (cumulative(high - sd) - cumulative(low - sd)) / share
                } else {
                    mean + sd * (density(low) - density(high)) / share
                }
            }
            Distribution::List(ref list) => {
                let mut before = 0.0;
                let terms = list.iter().map(|(diameter, sum)| {
                    let weight = sum - before;
                    before = *sum;
                    diameter * weight
                });
                terms.sum()
            }
        }
    }

    /// Diameters that represent the distribution, um, increasing: all diameters of a list of up to eight; for
    /// other distributions the 10, 50 and 90 % quantiles, or only the mean if these differ by less than 10 %.
    pub fn representative(&self) -> Vec<f64> {
        if let Distribution::List(list) = &self.0 {
            let mut all: Vec<f64> = list.iter().map(|(diameter, _)| *diameter).collect();
            all.sort_by(f64::total_cmp);
            all.dedup();
            if all.len() <= MOST_LISTED {
                return all;
            }
        }
        let quantiles = REPRESENTATIVE.map(|share| self.quantile(share));
        let [low, _, high] = quantiles;
        if high < ALIKE * low {
            return vec![self.mean()];
        }
        let mut distinct = quantiles.to_vec();
        distinct.dedup();
        distinct
    }

    /// The quantile for a cumulative probability `share`, um, rounded to four digits if the distribution is
    /// continuous.
    fn quantile(&self, share: f64) -> f64 {
        let inverse = |mean: f64, sd: f64, low: f64, high: f64| {
            let at = |x: f64| cumulative((x - mean) / sd);
            let wanted = at(low) + share * (at(high) - at(low));
            // 60 halvings of the interval reach the resolution of f64.
            let halved = (0..60).fold((low, high), |(low, high), _| {
                let middle = 0.5 * (low + high);
                if at(middle) < wanted { (middle, high) } else { (low, middle) }
            });
            halved.0
        };
        let exact = match self.0 {
            Distribution::Equal(diameter) => return diameter,
            Distribution::List(ref list) => {
                let mut sorted = list.clone();
                let mut before = 0.0;
                for entry in &mut sorted {
                    (entry.1, before) = (entry.1 - before, entry.1);
                }
                sorted.sort_by(|a, b| a.0.total_cmp(&b.0));
                let mut sum = 0.0;
                let found = sorted.iter().find(|(_, weight)| {
                    sum += weight;
                    sum >= share
                });
                return found.or(sorted.last()).map_or(0.0, |(diameter, _)| *diameter);
            }
            Distribution::Uniform { min, max } => min + share * (max - min),
            Distribution::Normal { log: false, mean, sd, min, max } => inverse(mean, sd, min, max),
            Distribution::Normal { mean, sd, min, max, .. } => {
                libm::exp(inverse(mean, sd, libm::log(min), libm::log(max)))
            }
        };
        let digit = libm::pow(10.0, libm::floor(libm::log10(exact)) - 3.0);
        // Dividing by a power of ten rounds to the nearest decimal, multiplying by its inverse does not.
        if digit < 1.0 {
            libm::rint(exact / digit) / libm::rint(1.0 / digit)
        } else {
            libm::rint(exact / digit) * digit
        }
    }

    /// The largest diameter that can be drawn, um.
    pub fn max(&self) -> f64 {
        self.limits().1
    }

    /// The smallest diameter that can be drawn, um.
    pub fn min(&self) -> f64 {
        self.limits().0
    }

    fn limits(&self) -> (f64, f64) {
        match &self.0 {
            Distribution::Equal(diameter) => (*diameter, *diameter),
            Distribution::Uniform { min, max } | Distribution::Normal { min, max, .. } => (*min, *max),
            Distribution::List(list) => list
                .iter()
                .fold((f64::INFINITY, 0.0), |(min, max): (f64, f64), (d, _)| (min.min(*d), max.max(*d))),
        }
    }
}

fn check_limits(min: f64, max: f64) -> Result<()> {
    CHECK.positive("min_um", min)?;
    CHECK.positive("max_um", max)?;
    if min > max {
        return Err(CHECK.fault("max_um", max, &format!("a number >= min_um = {min}")));
    }
    Ok(())
}

/// Density of the standard normal distribution.
fn density(x: f64) -> f64 {
    libm::exp(-0.5 * x * x) / libm::sqrt(2.0 * PI)
}

/// Cumulative standard normal distribution.
fn cumulative(x: f64) -> f64 {
    0.5 * libm::erfc(-x / SQRT_2)
}

#[cfg(test)]
mod tests {
    use super::*;
    use microsig_core::stream::{Purpose, Streams};

    #[test]
    fn draws_have_the_mean_and_the_limits_they_claim() {
        let kinds = [
            Diameters::equal(2.0).unwrap(),
            Diameters::uniform(1.0, 3.0).unwrap(),
            Diameters::normal(2.0, 0.5, 1.8, 3.5).unwrap(),
            Diameters::lognormal(2.0, 0.5, 1.6, 3.0).unwrap(),
            Diameters::list(&[(1.0, 3.0), (2.0, 1.0)]).unwrap(),
        ];
        for kind in kinds {
            let mut stream = Streams::new(3).stream(Purpose::Seeding, 0, 0);
            let draws: Vec<f64> = (0..40_000).map(|_| kind.draw(&mut stream)).collect();
            let mean = draws.iter().sum::<f64>() / 40_000.0;
            // Standard error: at most 0.58 / 200 = 0.0029.
            assert!((mean - kind.mean()).abs() < 4.0 * 0.0029, "{kind:?}: {mean}");
            assert!(draws.iter().all(|d| *d > 0.0 && *d <= kind.max()));
            // Clipping would put the 34 % of the normal distribution below 1.8 at the limit.
            let least = draws.iter().copied().fold(f64::INFINITY, f64::min);
            let at_least = draws.iter().filter(|d| **d == least).count();
            assert!(at_least == 1 || matches!(kind.0, Distribution::Equal(_) | Distribution::List(_)));
            assert!(least >= kind.min());
        }
    }

    /// Largest difference of the cumulative distributions of two samples of the same size (Kolmogorov and Smirnov).
    fn distance(mut a: Vec<f64>, mut b: Vec<f64>) -> f64 {
        a.sort_by(f64::total_cmp);
        b.sort_by(f64::total_cmp);
        let below = |sample: &[f64], at: f64| sample.partition_point(|v| *v <= at) as f64;
        let apart = |at: &f64| (below(&a, *at) - below(&b, *at)).abs() / a.len() as f64;
        a.iter().chain(&b).map(apart).fold(0.0, f64::max)
    }

    /// Two samples from the same stream of uniform numbers: by our functions and by the package `rand_distr`.
    #[test]
    fn numbers_are_distributed_as_those_of_an_independent_program() {
        use microsig_core::random::poisson;
        use rand_distr::{Distribution, LogNormal, Normal, Poisson};
        let n = 40_000;
        // Exceeded by one of 6,000 pairs of samples of the same distribution.
        let most = 2.1 * f64::sqrt(2.0 / f64::from(n));
        let stream = |row| Streams::new(7).stream(Purpose::Seeding, 0, row);
        let sample = |row, draw: &dyn Fn(&mut Stream) -> f64| -> Vec<f64> {
            let mut stream = stream(row);
            (0..n).map(|_| draw(&mut stream)).collect()
        };
        let within = |row, draw: &dyn Fn(&mut Stream) -> f64, min: f64, max: f64| {
            sample(row, &|stream| loop {
                let value = draw(stream);
                if (min..=max).contains(&value) {
                    break value;
                }
            })
        };
        let standard = Normal::new(0.0, 1.0).unwrap();
        assert!(distance(sample(0, &normal), sample(1, &|s| standard.sample(s))) < most);
        for mean in [0.3, 9.9, 10.0, 250.0] {
            let theirs = Poisson::new(mean).unwrap();
            let found = distance(sample(2, &|s| poisson(s, mean) as f64), sample(3, &|s| theirs.sample(s)));
            assert!(found < most, "Poisson numbers of mean {mean}: {found}");
        }
        let ours = Diameters::normal(2.0, 0.5, 1.8, 3.5).unwrap();
        let theirs = Normal::new(2.0, 0.5).unwrap();
        assert!(distance(sample(4, &|s| ours.draw(s)), within(5, &|s| theirs.sample(s), 1.8, 3.5)) < most);
        let ours = Diameters::lognormal(2.0, 0.5, 1.6, 3.0).unwrap();
        let theirs = LogNormal::from_mean_cv(2.0, 0.25).unwrap();
        assert!(distance(sample(6, &|s| ours.draw(s)), within(7, &|s| theirs.sample(s), 1.6, 3.0)) < most);
    }

    #[test]
    fn some_diameters_stand_for_all() {
        let of = |kind: Result<Diameters>| kind.unwrap().representative();
        assert_eq!(of(Diameters::equal(2.1)), [2.1]);
        assert_eq!(of(Diameters::list(&[(5.0, 1.0), (2.0, 3.0), (5.0, 1.0)])), [2.0, 5.0]);
        assert_eq!(of(Diameters::uniform(1.0, 3.0)), [1.2, 2.0, 2.8]);
        assert_eq!(of(Diameters::uniform(0.95, 1.05)), [1.0]);
        // -1.2816, 0 and 1.2816 standard deviations.
        assert_eq!(of(Diameters::normal(2.0, 0.5, 0.01, 9.0)), [1.359, 2.0, 2.641]);
        // The median of a lognormal distribution: mean / sqrt(1 + (sd / mean)^2).
        assert_eq!(of(Diameters::lognormal(2.0, 1.0, 1e-3, 1e3))[1], 1.789);
        let many: Vec<(f64, f64)> = (1..=21).map(|k| (f64::from(k), 1.0)).collect();
        assert_eq!(of(Diameters::list(&many)), [3.0, 11.0, 19.0]);
        // Limits far from the mean do not count.
        let cut = of(Diameters::normal(1.0, 1.0, 2.0, 1e6));
        assert!(cut[0] > 2.0 && cut[2] < 4.0, "{cut:?}");
    }

    #[test]
    fn impossible_diameters_are_refused() {
        assert!(Diameters::list(&[]).is_err() && Diameters::list(&[(1.0, 0.0)]).is_err());
        assert!(Diameters::lognormal(2.0, 0.1, 5.0, 6.0).is_err());
        assert!(Diameters::equal(0.0).is_err());
        assert!(Diameters::uniform(3.0, 1.0).is_err());
        assert!(Diameters::normal(2.0, 0.1, 5.0, 6.0).unwrap_err().to_string().contains("5..6"));
        assert!(Diameters::normal(2.0, f64::NAN, 1.0, 6.0).is_err());
    }
}
