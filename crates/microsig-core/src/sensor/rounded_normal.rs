//! Whole-number Gaussian noise.

/// round(N(0, sigma)) by Walker's alias method (Vose 1991): one random number of 32 bits a sample.
///
/// The probabilities are those of the rounded normal, each to 2^-32.
#[derive(Debug, Clone)]
pub struct RoundedNormal {
    lowest: i32,
    /// The first so many bits of a random number choose a column.
    bits: u32,
    /// Per column: the share of 2^32 that stays in the column, and the value of the rest.
    columns: Vec<(u32, i32)>,
}

impl RoundedNormal {
    /// The distribution for a standard deviation > 0, counts.
    pub fn new(sigma: f64) -> Self {
        // Beyond 16 bit every value clamps to the same count, so the table never grows past that.
        let reach = libm::ceil(8.0 * sigma + 1.0).min(f64::from(1 << 17)) as i32;
        let below = |x: f64| 0.5 * libm::erfc(-x / (sigma * std::f64::consts::SQRT_2));
        // A power of two, so that the bits that choose a column and those that decide within it are independent.
        let n = ((2 * reach + 1) as usize).next_power_of_two();
        let mut weights: Vec<f64> = (-reach..=reach)
            .map(|k| {
                // By symmetry from the lower tail, where differences of erfc keep their digits.
                let k = -f64::from(k.abs());
                below(k + 0.5) - below(k - 0.5)
            })
            .collect();
        weights.resize(n, 0.0);
        let total: f64 = weights.iter().sum();

        let mut scaled: Vec<f64> = weights.iter().map(|w| w / total * n as f64).collect();
        let mut columns = vec![(u32::MAX, 0); n];
        let (mut small, mut large): (Vec<usize>, Vec<usize>) = (0..n).partition(|&i| scaled[i] < 1.0);
        while let (Some(&poor), Some(&rich)) = (small.last(), large.last()) {
            small.pop();
            columns[poor] = ((scaled[poor] * 4_294_967_296.0) as u32, rich as i32 - reach);
            scaled[rich] -= 1.0 - scaled[poor];
            if scaled[rich] < 1.0 {
                large.pop();
                small.push(rich);
            }
        }
        for full in small.into_iter().chain(large) {
            columns[full] = (u32::MAX, full as i32 - reach);
        }
        RoundedNormal { lowest: -reach, bits: n.ilog2(), columns }
    }

    /// The value, counts, that a random number of 32 bits stands for.
    #[inline(always)]
    pub fn sample(&self, random: u32) -> i32 {
        let column = random >> (32 - self.bits);
        // There is a column for every number; without a check that could fail, many are looked up at a time.
        let (share, rest) = self.columns.get(column as usize).copied().unwrap_or_default();
        if random << self.bits < share { self.lowest + column as i32 } else { rest }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::stream::{Purpose, Streams};

    /// Chi-square of a million samples against the probabilities of the rounded normal.
    #[test]
    fn noise_has_the_law_of_a_rounded_normal() {
        for sigma in [0.3, 5.0, 10.0] {
            let noise = RoundedNormal::new(sigma);
            let n = 1_000_000;
            let reach = (4.0 * sigma) as i32 + 1;
            let mut histogram = vec![0.0; (2 * reach + 1) as usize];
            let mut stream = Streams::new(3).stream(Purpose::BackgroundNoise, 0, 0);
            for _ in 0..n {
                let k = noise.sample(stream.next_u32()).clamp(-reach, reach);
                histogram[(k + reach) as usize] += 1.0;
            }
            let below = |x: f64| 0.5 * libm::erfc(-x / (sigma * std::f64::consts::SQRT_2));
            let (mut chi2, mut bins) = (0.0, 0);
            for (i, &count) in histogram.iter().enumerate() {
                let k = f64::from(i as i32 - reach);
                let low = if i == 0 { 0.0 } else { below(k - 0.5) };
                let high = if i + 1 == histogram.len() { 1.0 } else { below(k + 0.5) };
                let expected = (high - low) * f64::from(n);
                if expected > 5.0 {
                    chi2 += (count - expected) * (count - expected) / expected;
                    bins += 1;
                }
            }
            // Mean bins - 1, standard deviation sqrt(2 bins): 4 of them is one false alarm in 10,000 seeds.
            let limit = f64::from(bins) + 4.0 * (2.0 * f64::from(bins)).sqrt();
            assert!(chi2 < limit, "sigma {sigma}: chi2 {chi2}, {bins} bins");
        }
    }
}
