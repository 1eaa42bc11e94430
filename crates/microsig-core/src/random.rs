//! Random numbers with other distributions, computed from uniform numbers by libm only, so that they are
//! bit-identical on all machines.

use crate::stream::Stream;
use std::f64::consts::PI;

/// The largest mean for which [`poisson`] is accurate.
pub const MAX_POISSON_MEAN: f64 = 1e7;

/// A Poisson-distributed number with the given mean (0 to [`MAX_POISSON_MEAN`]).
///
/// Below a mean of 10 it counts uniform factors until their product is less than e^-mean; above, the
/// transformed rejection method PTRS of Hormann is used, "The transformed rejection method for generating
/// Poisson random variables", Insurance: Mathematics and Economics 12 (1993) 39. Both are exact up to
/// rounding.
pub fn poisson(stream: &mut Stream, mean: f64) -> u64 {
    if mean < 10.0 {
        let floor = libm::exp(-mean);
        let mut product = stream.uniform();
        let mut count = 0;
        while product > floor {
            product *= stream.uniform();
            count += 1;
        }
        return count;
    }
    let b = 0.931 + 2.53 * libm::sqrt(mean);
    let a = -0.059 + 0.02483 * b;
    let alpha_inverse = 1.1239 + 1.1328 / (b - 3.4);
    let v_inner = 0.9277 - 3.6224 / (b - 2.0);
    loop {
        let u = stream.uniform() - 0.5;
        let v = stream.uniform();
        let edge = 0.5 - u.abs();
        let k = libm::floor((2.0 * a / edge + b) * u + mean + 0.43);
        // Most numbers are in the squeeze region, where no logarithm is needed.
        if edge >= 0.07 && v <= v_inner {
            return k as u64;
        }
        if k < 0.0 || (edge < 0.013 && v > edge) {
            continue;
        }
        let hat = libm::log(v * alpha_inverse / (a / (edge * edge) + b));
        if hat <= k * libm::log(mean) - mean - libm::lgamma(k + 1.0) {
            return k as u64;
        }
    }
}

/// A normally distributed number with mean 0 and standard deviation 1, from two uniform numbers (Box and
/// Muller, Ann. Math. Stat. 29 (1958) 610).
pub fn normal(stream: &mut Stream) -> f64 {
    // 1 - u is never 0.
    let radius = libm::sqrt(-2.0 * libm::log(1.0 - stream.uniform()));
    radius * libm::cos(2.0 * PI * stream.uniform())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::stream::{Purpose, Streams};

    fn stream(row: u32) -> Stream {
        Streams::new(11).stream(Purpose::Seeding, 0, row)
    }

    /// Chi-square of `draws` Poisson numbers against the distribution, over classes of expectation >= 20,
    /// with the number of classes.
    fn chi_square(mean: f64, draws: u32) -> (f64, u32) {
        let mut stream = stream(mean as u32);
        let mut counts = vec![0.0; (mean + 10.0 * libm::sqrt(mean) + 20.0) as usize];
        for _ in 0..draws {
            counts[poisson(&mut stream, mean) as usize] += 1.0;
        }
        let (mut chi, mut classes, mut seen, mut expected, mut rest) = (0.0, 0, 0.0, 0.0, f64::from(draws));
        for (k, count) in counts.iter().enumerate() {
            let k = k as f64;
            let share = libm::exp(k * libm::log(mean) - mean - libm::lgamma(k + 1.0)) * f64::from(draws);
            seen += count;
            expected += share;
            rest -= share;
            // The last class includes the tail.
            if expected >= 20.0 && rest >= 20.0 {
                chi += (seen - expected) * (seen - expected) / expected;
                (classes, seen, expected) = (classes + 1, 0.0, 0.0);
            }
        }
        (chi + (seen - expected) * (seen - expected) / expected, classes + 1)
    }

    #[test]
    fn poisson_numbers_follow_the_distribution() {
        for mean in [0.3, 4.0, 9.99, 10.0, 47.0, 1000.0] {
            let (chi, classes) = chi_square(mean, 100_000);
            let freedom = f64::from(classes - 1);
            // Chi-square with n degrees of freedom has the variance 2n; 4.5 standard deviations, and a margin
            // for the skewness at small n.
            let limit = freedom + 4.5 * libm::sqrt(2.0 * freedom) + 8.0;
            assert!(freedom >= 2.0 && chi < limit, "mean {mean}: {chi} for {freedom}");
        }
    }

    #[test]
    fn large_means_keep_mean_and_variance() {
        let mean = 1e7;
        let mut stream = stream(0);
        let numbers: Vec<f64> = (0..20_000).map(|_| poisson(&mut stream, mean) as f64).collect();
        let average = numbers.iter().sum::<f64>() / 20_000.0;
        let variance = numbers.iter().map(|n| (n - mean) * (n - mean)).sum::<f64>() / 20_000.0;
        // Standard errors: sqrt(mean / n) = 22.4 and mean sqrt(2 / n) = 1 %.
        assert!((average - mean).abs() < 4.0 * 22.4, "{average}");
        assert!((variance / mean - 1.0).abs() < 0.04, "{variance}");
    }

    #[test]
    fn nothing_is_expected_of_nothing() {
        assert!((0..100).all(|row| poisson(&mut stream(row), 0.0) == 0));
    }

    #[test]
    fn normal_numbers_have_the_moments_of_the_normal_distribution() {
        let mut stream = stream(0);
        let numbers: Vec<f64> = (0..100_000).map(|_| normal(&mut stream)).collect();
        let moment = |power: i32| {
            numbers.iter().map(|x| (0..power).fold(1.0, |product, _| product * x)).sum::<f64>() / 1e5
        };
        // Standard errors sqrt((E x^2p - (E x^p)^2) / n) = 0.0032, 0.0045, 0.0122, 0.031; four of each.
        for (power, expected, error) in
            [(1, 0.0, 0.0032), (2, 1.0, 0.0045), (3, 0.0, 0.0122), (4, 3.0, 0.031)]
        {
            assert!((moment(power) - expected).abs() < 4.0 * error, "moment {power}: {}", moment(power));
        }
    }
}
