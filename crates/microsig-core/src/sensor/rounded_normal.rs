//! Gaussian noise, rounded to integers or not.

#[cfg(target_arch = "x86_64")]
use super::registers;

/// Minimum length of a table, for the lookup in registers.
const REGISTERS: usize = 256;

/// round(N(0, sigma)) by Walker's alias method (Vose 1991): one 32-bit random number per sample.
///
/// The probabilities follow the rounded normal distribution, each accurate to 2^-32.
#[derive(Debug, Clone)]
pub struct RoundedNormal {
    lowest: i32,
    /// Number of leading bits of a random word that select a column.
    bits: u32,
    /// Per column, packed into 32 bits: in the leading bits the alias column, in the others the threshold
    /// from which a random number goes to the alias.
    columns: Vec<u32>,
}

impl RoundedNormal {
    /// The distribution for a standard deviation > 0, counts.
    pub fn new(sigma: f64) -> Self {
        // Values beyond 16 bit are clamped, so the table need not extend further.
        let reach = libm::ceil(8.0 * sigma + 1.0).min(f64::from(1 << 17)) as i32;
        let below = |x: f64| 0.5 * libm::erfc(-x / (sigma * std::f64::consts::SQRT_2));
        // A power of two, so that the bits that select a column are independent of those compared with its
        // threshold.
        let n = ((2 * reach + 1) as usize).next_power_of_two();
        let bits = n.ilog2();
        let mut weights: Vec<f64> = (-reach..=reach)
            .map(|k| {
                // By symmetry from the lower tail, where differences of erfc do not lose digits.
                let k = -f64::from(k.abs());
                below(k + 0.5) - below(k - 0.5)
            })
            .collect();
        weights.resize(n, 0.0);
        let total: f64 = weights.iter().sum();

        let mut scaled: Vec<f64> = weights.iter().map(|w| w / total * n as f64).collect();
        // A full column is its own alias, and so is a column that is full up to less than the resolution of a
        // random number.
        let mut columns: Vec<u32> = (0..n as u32).map(|column| column << (32 - bits)).collect();
        let (mut small, mut large): (Vec<usize>, Vec<usize>) = (0..n).partition(|&i| scaled[i] < 1.0);
        while let (Some(&poor), Some(&rich)) = (small.last(), large.last()) {
            small.pop();
            let least = ((scaled[poor] * 4_294_967_296.0) as u32).div_ceil(1 << bits);
            if least >> (32 - bits) == 0 {
                columns[poor] = (rich as u32) << (32 - bits) | least;
            }
            scaled[rich] -= 1.0 - scaled[poor];
            if scaled[rich] < 1.0 {
                large.pop();
                small.push(rich);
            }
        }
        // Padding of small tables, which no random number selects.
        columns.resize(n.max(REGISTERS), 0);
        RoundedNormal { lowest: -reach, bits, columns }
    }

    /// The value (counts) for a 32-bit random number.
    #[inline]
    pub fn sample(&self, random: u32) -> i32 {
        // In range: there is a column for every index.
        let column = self.columns.get((random >> (32 - self.bits)) as usize).copied().unwrap_or_default();
        let stays = random << self.bits < column << self.bits;
        // The outcome is unpredictable, and a misprediction costs more than computing both.
        let decided = std::hint::select_unpredictable(stays, random, column);
        self.lowest + (decided >> (32 - self.bits)) as i32
    }

    /// The values (counts) for these random numbers.
    pub(super) fn sample_all(&self, random: &[u32], values: &mut [i32]) {
        let done = self.sample_in_registers(random, values);
        for (value, &random) in values[done..].iter_mut().zip(&random[done..]) {
            *value = self.sample(random);
        }
    }

    /// Draws the samples that fill whole vectors and returns their number.
    #[cfg(target_arch = "x86_64")]
    fn sample_in_registers(&self, random: &[u32], values: &mut [i32]) -> usize {
        let (pulp::Arch::V4(simd), Ok(columns)) = (pulp::Arch::new(), self.columns.as_slice().try_into())
        else {
            return 0;
        };
        let ((random, _), (values, _)) = (random.as_chunks(), values.as_chunks_mut());
        let (lowest, bits) = (self.lowest, self.bits);
        simd.vectorize(registers::Samples { simd, lowest, bits, columns, random, values });
        random.as_flattened().len()
    }

    #[cfg(not(target_arch = "x86_64"))]
    fn sample_in_registers(&self, _: &[u32], _: &mut [i32]) -> usize {
        0
    }
}

/// N(0, sigma), not rounded to counts, as an integer number of steps, drawn from a table, plus a uniform position within the step.
///
/// The density is a histogram of the normal density with 4 to 8 steps per standard deviation. Each of the two
/// parts adds step^2 / 12 to the variance; the standard deviation of the table is reduced accordingly, so
/// that mean and variance are exact.
#[derive(Debug, Clone)]
pub(super) struct NormalSteps {
    step: f64,
    steps: RoundedNormal,
}

impl NormalSteps {
    /// The distribution for a standard deviation > 0, counts.
    pub(super) fn new(sigma: f64) -> Self {
        // The largest power of two that is at most sigma / 4: the exponent with a zero mantissa.
        let step = f64::from_bits((0.25 * sigma).to_bits() & 0xFFF0_0000_0000_0000).max(f64::MIN_POSITIVE);
        let steps = sigma / step;
        NormalSteps { step, steps: RoundedNormal::new(libm::sqrt((steps * steps - 1.0 / 6.0).max(1.0))) }
    }

    /// Length of a step, counts.
    pub(super) fn step(&self) -> f64 {
        self.step
    }

    /// The numbers of steps for these random words.
    pub(super) fn sample_steps(&self, random: &[u32], steps: &mut [i32]) {
        self.steps.sample_all(random, steps);
    }

    /// The noise (counts) for two random words.
    pub(super) fn sample(&self, [random, within]: [u32; 2]) -> f64 {
        self.step * place(self.steps.sample(random), within)
    }
}

/// A position in units of steps; `within` divides the step into 2^32 equal parts.
#[inline(always)]
pub(super) fn place(step: i32, within: u32) -> f64 {
    // Signed 32-bit integers are converted to f64 by one instruction on all targets.
    f64::from(step) + (f64::from((within ^ 0x8000_0000) as i32) + 0.5) * (1.0 / 4_294_967_296.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::stream::{Purpose, Streams};

    /// With tables that fit into registers and larger ones, and with numbers of samples that do and do not
    /// fill registers.
    #[test]
    fn many_samples_are_those_taken_one_by_one() {
        for sigma in [0.01, 0.3, 5.0, 10.0, 15.7, 15.8, 40.0] {
            let law = RoundedNormal::new(sigma);
            for n in [0, 1, 15, 16, 17, 752, 4096] {
                let mut random = vec![0; n];
                Streams::new(1).stream(Purpose::BackgroundNoise, 0, n as u32).fill(&mut random);
                let mut values = vec![0; n];
                law.sample_all(&random, &mut values);
                assert!(values.iter().zip(&random).all(|(v, r)| *v == law.sample(*r)), "{sigma}, {n}");
            }
        }
    }
}
