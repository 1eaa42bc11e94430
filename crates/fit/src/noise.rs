//! The noise of a scan, from the residuals of a fit.
//!
//! The variance of a count is the variance of the background plus a multiple of the light. Errors of the model look
//! like noise that grows with light, too, but they are shared by neighboring pixels, whereas noise is not: in
//! the mean of r^2 minus the product of the residuals r of neighbors, only noise remains.

use rayon::prelude::*;

use super::images::Problem;
use super::state::{Count, HUBER, Noise, State};
use storage::error::Result;

/// Variance of rounding to whole counts.
pub(super) const ROUNDING: f64 = 1.0 / 12.0;

/// Maximum number of iterations of the weighted regression, and the relative change at which it ends.
const ITERATIONS: usize = 30;
const CONVERGED: f64 = 1e-4;

/// Estimates of the variance of counts.
#[derive(Debug, Clone, Copy)]
pub(super) struct Noises {
    /// Noise alone.
    pub(super) pure: Noise,
    /// Including the errors of the model, for weights.
    pub(super) with_model: Noise,
}

/// A lit pixel: light, squared residual, and the mean product with the residuals of its neighbors, counts^2.
#[derive(Clone, Copy)]
pub(super) struct Pixel {
    pub(super) light: f64,
    pub(super) square: f64,
    pub(super) shared: f64,
}

impl Problem<'_> {
    pub(super) fn noises(&self, state: &State) -> Result<Noises> {
        let imager = self.renderer(state)?;
        let windows: Vec<(usize, usize)> = self.used().collect();
        let pixels: Vec<Vec<Pixel>> = windows
            .into_par_iter()
            .map(|(k, i)| {
                let values = self.values(&imager, state, &state.microscope, k, i);
                let window = &self.windows.particles[k];
                let residual: Vec<(f64, f64)> = window
                    .pixels
                    .iter()
                    .zip(values)
                    .map(|(&(at, _), value)| {
                        let Count { mean, reduction, .. } = self.count(state, k, i, value);
                        // As it would be without clipping.
                        let residual = (f64::from(self.scan.planes[i][at]) - mean) * libm::sqrt(reduction);
                        (state.flux[i] * state.beads[k].light * value, residual)
                    })
                    .collect();
                let mut products = vec![(0.0, 0.0); residual.len()];
                for &(a, b) in &window.neighbors {
                    let product = residual[a].1 * residual[b].1;
                    for pixel in [a, b] {
                        products[pixel].0 += product;
                        products[pixel].1 += 1.0;
                    }
                }
                let pixel = |(&(light, r), &(sum, n)): (&(f64, f64), &(f64, f64))| Pixel {
                    light: light.max(0.0),
                    square: r * r,
                    shared: sum / f64::max(n, 1.0),
                };
                residual.iter().zip(&products).map(pixel).collect()
            })
            .collect();
        let histogram2 = self.background.noise * self.background.noise + ROUNDING;
        Ok(estimate(&pixels.concat(), Noise { background2: histogram2, ..state.noise }))
    }
}

/// Weighted regression of squared residuals on light; `start` has the upper limit of the variance of the
/// background.
pub(super) fn estimate(pixels: &[Pixel], start: Noise) -> Noises {
    let most = start.background2;
    // Sums over pixels of weights times powers of light, 0 to 4, and times powers of light and the value.
    let sums = |noise: Noise, value: &dyn Fn(&Pixel) -> f64| {
        let (mut powers, mut values) = ([0.0; 5], [0.0; 3]);
        for pixel in pixels {
            let variance = noise.variance(pixel.light);
            // Limits the effect of outliers, which are not noise.
            let value = value(pixel).clamp(-HUBER * HUBER * variance, HUBER * HUBER * variance);
            let mut weight = 1.0 / (variance * variance);
            for (power, sum) in powers.iter_mut().enumerate() {
                *sum += weight;
                values.get_mut(power).into_iter().for_each(|sum| *sum += weight * value);
                weight *= pixel.light;
            }
        }
        (powers, values)
    };
    let positive = |above: f64, below: f64| if below > 0.0 { (above / below).max(0.0) } else { 0.0 };
    let alone = iterate(Noise { per_count2: 0.0, ..start }, |noise| {
        let ([w, x, xx, ..], [y, xy, _]) = sums(noise, &|pixel| pixel.square - pixel.shared);
        let determinant = w * xx - x * x;
        if determinant <= 0.0 {
            return noise;
        }
        let background2 = ((xx * y - x * xy) / determinant).clamp(ROUNDING, most);
        Noise { background2, per_count: positive(xy - background2 * x, xx), ..noise }
    });
    let all = iterate(alone, |noise| {
        let ([_, x, xx, ..], [_, xy, _]) = sums(noise, &|pixel| pixel.square);
        Noise { per_count: positive(xy - noise.background2 * x, xx), ..noise }
    });
    // Where neighbors have anticorrelated noise, as when a ray falls on one pixel or the next, the products
    // are negative; the noise never exceeds all residuals.
    let pure = Noise { per_count: alone.per_count.min(all.per_count), ..alone };
    let with_model = iterate(pure, |noise| {
        let ([_, _, xx, xxx, xxxx], [_, _, xxy]) = sums(noise, &|pixel| pixel.square);
        let above = xxy - noise.background2 * xx - noise.per_count * xxx;
        Noise { per_count2: positive(above, xxxx), ..noise }
    });
    Noises { pure, with_model }
}

fn iterate(start: Noise, step: impl Fn(Noise) -> Noise) -> Noise {
    let mut noise = start;
    for _ in 0..ITERATIONS {
        let next = step(noise);
        let close = |a: f64, b: f64| (a - b).abs() <= CONVERGED * (b + 1e-3);
        let done = close(next.background2, noise.background2) && close(next.per_count, noise.per_count);
        noise = next;
        if done {
            break;
        }
    }
    noise
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Noise of a known variance, with an error of the model that neighbors share.
    #[test]
    fn errors_of_the_model_are_not_noise() {
        let (background2, per_count) = (9.0, 1.5);
        let pixels: Vec<Pixel> = (0..20_000)
            .map(|i| {
                let light = f64::from(i % 200);
                let model = 0.2 * light;
                let noise2 = background2 + per_count * light;
                Pixel { light, square: noise2 + model * model, shared: model * model }
            })
            .collect();
        let start = Noise { background2: 12.0, per_count: 1.0, per_count2: 0.0 };
        let Noises { pure, with_model, .. } = estimate(&pixels, start);
        assert!((pure.background2 - background2).abs() < 0.01, "{pure:?}");
        assert!((pure.per_count - per_count).abs() < 0.01, "{pure:?}");
        assert!((with_model.per_count2 - 0.04).abs() < 1e-3, "{with_model:?}");
    }
}
