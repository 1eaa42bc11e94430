//! The state of an image fit (microscope and particles), and its misfit.

use super::optics::Microscope;

/// The loss is linear for residuals beyond this many standard deviations.
pub(super) const HUBER: f64 = 5.0;

/// One particle of a fit.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Bead {
    /// Position at the mean stage position, relative to the middle of its window, px.
    pub(super) x: f64,
    pub(super) y: f64,
    /// Depth at stage position 0, um of the model.
    pub(super) z_um: f64,
    /// Light emitted toward the lens, counts.
    pub(super) light: f64,
    /// Background, counts.
    pub(super) background: f64,
}

/// Variance of a count: of the background, rounding included (counts^2), per count of light
/// (counts), and per squared count of light, by which errors of the model grow.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Noise {
    pub(super) background2: f64,
    pub(super) per_count: f64,
    pub(super) per_count2: f64,
}

impl Noise {
    pub(super) fn variance(self, light: f64) -> f64 {
        let light = light.max(0.0);
        self.background2 + (self.per_count + self.per_count2 * light) * light
    }
}

/// The distribution of a count, clipped at 0 as cameras and image generators do: mean and variance are those
/// of max(0, n) for a normal n. A fit of dark pixels to the mean of n would find too bright a background.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Count {
    pub(super) mean: f64,
    /// Derivative of the mean with respect to the mean of n.
    pub(super) slope: f64,
    pub(super) variance: f64,
    /// The variance of n over the variance of the count.
    pub(super) reduction: f64,
}

/// Clipping counts below this many standard deviations.
const CLIPPED: f64 = 5.0;

impl Count {
    /// For a normal n with this mean and variance.
    pub(super) fn of(mean: f64, variance: f64) -> Count {
        let sd = libm::sqrt(variance);
        let t = mean / sd;
        if t > CLIPPED {
            return Count { mean, slope: 1.0, variance, reduction: 1.0 };
        }
        let above = 0.5 * libm::erfc(-t / std::f64::consts::SQRT_2);
        let density = libm::exp(-0.5 * t * t) / libm::sqrt(2.0 * std::f64::consts::PI);
        let clipped = mean * above + sd * density;
        let square = (mean * mean + variance) * above + mean * sd * density;
        // At least a hundredth, which limits the weights of pixels that are nearly always dark.
        let left = (square - clipped * clipped).max(0.01 * variance);
        Count { mean: clipped, slope: above, variance: left, reduction: variance / left }
    }
}

/// All quantities that the fit changes.
#[derive(Debug, Clone)]
pub(super) struct State {
    pub(super) microscope: Microscope,
    pub(super) direction: f64,
    /// Lateral drift, px per um of stage position.
    pub(super) drift: [f64; 2],
    pub(super) beads: Vec<Bead>,
    /// Brightness of each plane, mean 1.
    pub(super) flux: Vec<f64>,
    /// Variance of counts.
    pub(super) noise: Noise,
}

impl State {
    /// Mean background of the particles' windows, counts.
    pub(super) fn background(&self) -> f64 {
        self.beads.iter().map(|bead| bead.background).sum::<f64>() / self.beads.len() as f64
    }
}

/// Misfit of one window.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(super) struct Misfit {
    pub(super) pixels: usize,
    /// Huber loss with fixed weights, which a step decreases.
    pub(super) loss: f64,
    /// Sum of squared residuals over variance.
    pub(super) chi2: f64,
    /// Sum of the Huber loss of r/sd plus ln(variance).
    pub(super) minus_two_log_likelihood: f64,
    /// Sums over pairs of neighboring pixels of products of residuals, and of data minus background,
    /// counts^2: without noise, which neighbors do not share.
    pub(super) unexplained: f64,
    pub(super) signal: f64,
}

/// Sum of squared residuals over variance, per pixel.
pub(super) fn chi2(misfits: &[(usize, usize, Misfit)]) -> f64 {
    let (chi2, n) = misfits.iter().fold((0.0, 0), |(c, n), (_, _, m)| (c + m.chi2, n + m.pixels));
    chi2 / (n.max(1) as f64)
}

/// Fraction of the squared signal above the noise that the model explains.
pub(super) fn r2(misfits: &[(usize, usize, Misfit)]) -> f64 {
    let sum = |value: &dyn Fn(&Misfit) -> f64| misfits.iter().map(|(_, _, m)| value(m)).sum::<f64>();
    let signal = sum(&|m| m.signal);
    if signal > 0.0 { 1.0 - sum(&|m| m.unexplained) / signal } else { 0.0 }
}

/// Huber loss of a residual in standard deviations: quadratic, and linear beyond [`HUBER`].
pub(super) fn huber(r: f64) -> f64 {
    let size = r.abs();
    if size > HUBER { HUBER * (2.0 * size - HUBER) } else { size * size }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Moments of clipped normal numbers at evenly spaced probabilities.
    #[test]
    fn moments_are_those_of_clipped_numbers() {
        let n = 200_000;
        for (mean, sd) in [(25.0, 15.0), (3.0, 5.0), (-2.0, 4.0), (0.0, 1.0)] {
            let (mut sum, mut square, mut weight) = (0.0, 0.0, 0.0);
            for i in 0..n {
                let t = 16.0 * (f64::from(i) + 0.5) / f64::from(n) - 8.0;
                let (w, value) = (libm::exp(-0.5 * t * t), f64::max(mean + sd * t, 0.0));
                weight += w;
                sum += w * value;
                square += w * value * value;
            }
            let (first, second) = (sum / weight, square / weight);
            let count = Count::of(mean, sd * sd);
            assert!((count.mean - first).abs() < 1e-5 * sd, "{mean} {sd}: {count:?} {first}");
            let variance = second - first * first;
            assert!((count.variance / variance - 1.0).abs() < 1e-4, "{mean} {sd}: {count:?} {variance}");
            let slope = (Count::of(mean + 1e-4, sd * sd).mean - Count::of(mean - 1e-4, sd * sd).mean) / 2e-4;
            assert!((count.slope - slope).abs() < 1e-6, "{mean} {sd}: {count:?} {slope}");
        }
    }
}
