//! Gaussian noise that is not rounded to integer counts.

use super::rounded_normal::RoundedNormal;

/// N(0, sigma) as an integer number of steps, drawn from a table, plus a uniform position within the step.
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
