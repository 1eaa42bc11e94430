//! Background of a scan: mean and standard deviation, from the dark side of the histogram.
//!
//! Particles only add light, so counts up to slightly above the mode belong to the background. They are
//! modeled by a normal distribution, rounded to whole counts and clipped at 0, as cameras and image
//! generators do; the likelihood is conditional on counts being at most `limit`. For a background of 25 +- 15
//! counts clipped at 0, the estimate is 25 +- 15, while the sample mean and standard deviation are 25.3 and
//! 14.4.

use libm::{erfc, exp, log, sqrt};

/// Mean and standard deviation of the background before rounding and clipping, counts.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Background {
    pub(super) mean: f64,
    pub(super) noise: f64,
}

/// Counts up to this far above the mode are background, standard deviations.
const BEYOND: f64 = 0.7;

impl Background {
    pub(super) fn of(planes: &[Vec<u16>]) -> Background {
        let mut histogram = vec![0u64; 1 << 16];
        planes.iter().flatten().for_each(|&count| histogram[usize::from(count)] += 1);
        let spread = spread(&histogram);
        let mode = mode(&histogram, (0.3 * spread) as usize);
        let start = Background { mean: mode as f64, noise: spread.max(0.3) };
        let mut best = start;
        // The limit depends on the noise; three iterations converge.
        for _ in 0..3 {
            let limit = (mode as f64 + (BEYOND * best.noise).max(1.0)) as usize;
            best = maximize_likelihood(&histogram[..=limit.min(histogram.len() - 1)], best);
        }
        best
    }
}

/// Standard deviation estimated from the median of the counts below the mode.
fn spread(histogram: &[u64]) -> f64 {
    let mode = mode(histogram, 1);
    let below: u64 = histogram[..=mode].iter().sum();
    let mut sum = 0;
    for (count, n) in histogram[..=mode].iter().enumerate() {
        sum += n;
        // Half of the values below the mean of a normal distribution are more than 0.6745 standard deviations
        // below it.
        if 2 * sum >= below {
            return ((mode - count) as f64 / 0.6745).max(0.3);
        }
    }
    0.3
}

/// The most frequent count above 0 of a histogram smoothed over `half` counts on both sides.
fn mode(histogram: &[u64], half: usize) -> usize {
    let smooth = |i: usize| -> u64 {
        histogram[i.saturating_sub(half)..(i + half + 1).min(histogram.len())].iter().sum()
    };
    // Clipped counts accumulate at 0, which is not taken as the mode.
    (1..histogram.len()).max_by_key(|&i| (smooth(i), std::cmp::Reverse(i))).unwrap_or(0)
}

/// The cumulative standard normal distribution.
fn phi(x: f64) -> f64 {
    0.5 * erfc(-x / std::f64::consts::SQRT_2)
}

/// Negative log-likelihood of the counts, conditional on being within the histogram.
fn cost(histogram: &[u64], Background { mean, noise }: Background) -> f64 {
    let below = |count: f64| phi((count - mean) / noise);
    let total: u64 = histogram.iter().sum();
    let all = below(histogram.len() as f64 - 0.5).max(1e-300);
    let mut sum = total as f64 * log(all);
    let mut before = 0.0;
    for (count, &n) in histogram.iter().enumerate() {
        let up_to = below(count as f64 + 0.5);
        if n > 0 {
            sum -= n as f64 * log((up_to - before).max(1e-300));
        }
        before = up_to;
    }
    sum
}

/// Minimizes the cost by Newton's method in mean and ln(noise), with derivatives by finite differences.
fn maximize_likelihood(histogram: &[u64], start: Background) -> Background {
    let at = |p: [f64; 2]| cost(histogram, Background { mean: p[0], noise: exp(p[1]) });
    let mut p = [start.mean, log(start.noise)];
    for _ in 0..50 {
        let steps = [1e-3 * exp(p[1]), 1e-3];
        let moved = |a: f64, b: f64| at([p[0] + a * steps[0], p[1] + b * steps[1]]);
        let here = moved(0.0, 0.0);
        let (x, xx) = (moved(1.0, 0.0), moved(-1.0, 0.0));
        let (y, yy) = (moved(0.0, 1.0), moved(0.0, -1.0));
        let gradient = [(x - xx) / 2.0, (y - yy) / 2.0];
        let (hxx, hyy) = ((x - 2.0 * here + xx).max(1e-12), (y - 2.0 * here + yy).max(1e-12));
        let hxy = (moved(1.0, 1.0) - moved(1.0, -1.0) - moved(-1.0, 1.0) + moved(-1.0, -1.0)) / 4.0;
        let hxy = hxy.clamp(-0.95 * sqrt(hxx * hyy), 0.95 * sqrt(hxx * hyy));
        let determinant = hxx * hyy - hxy * hxy;
        let mut step = [
            -(hyy * gradient[0] - hxy * gradient[1]) / determinant,
            -(hxx * gradient[1] - hxy * gradient[0]) / determinant,
        ];
        // At most one standard deviation, and a factor of two.
        let longest = (step[0].abs() / 1000.0).max(step[1].abs() / 700.0).max(1.0);
        step = step.map(|s| s / longest);
        let mut share = 1.0;
        while share > 1e-3 && moved(share * step[0], share * step[1]) > here {
            share *= 0.5;
        }
        p = [p[0] + share * step[0] * steps[0], p[1] + share * step[1] * steps[1]];
        if step[0].abs().max(step[1].abs()) < 0.1 {
            break;
        }
    }
    Background { mean: p[0], noise: exp(p[1]) }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Normally distributed counts: the quantiles at evenly spaced probabilities.
    fn counts(mean: f64, noise: f64, n: usize) -> Vec<u16> {
        (0..n)
            .map(|i| {
                let share = (i as f64 + 0.5) / n as f64;
                let (mut low, mut high) = (-9.0, 9.0);
                for _ in 0..60 {
                    let middle = 0.5 * (low + high);
                    if phi(middle) < share { low = middle } else { high = middle }
                }
                (mean + noise * low).round().max(0.0) as u16
            })
            .collect()
    }

    #[test]
    fn clipped_backgrounds_are_found() {
        for (mean, noise) in [(25.0, 15.0), (350.0, 10.0), (10.0, 2.0), (100.0, 0.8)] {
            let mut plane = counts(mean, noise, 200_000);
            // A tenth of the number of background pixels is lit.
            plane.extend((0..20_000).map(|i| (mean + noise * 0.01 * f64::from(i)) as u16));
            let found = Background::of(&[plane]);
            assert!((found.mean - mean).abs() < 0.03 * noise + 0.02, "{mean} {noise}: {found:?}");
            assert!((found.noise / noise - 1.0).abs() < 0.03, "{mean} {noise}: {found:?}");
        }
    }
}
