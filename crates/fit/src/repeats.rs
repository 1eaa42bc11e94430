//! Noise of a camera from repeated frames of the planes of a scan: the variance of each pixel over the
//! repeats against its mean signal. Photons and read noise give a straight line; light that fluctuates from
//! frame to frame adds a square.

use super::scan::Scan;
use microsig_core::linear::Symmetric;

/// Pixels are sorted into classes of signal, this many per decade, up to this many counts.
const PER_DECADE: f64 = 8.0;
const CLASSES: usize = 48;

/// Classes with fewer pixels are not used.
const LEAST_PIXELS: f64 = 50.0;

/// Coefficients of the variance of a count in one frame as a polynomial of its signal above the background,
/// counts^2, counts, 1: one to three, none negative. `None` if the scan has no repeated frames.
pub fn noise_of_repeats(scan: &Scan, background: f64) -> Option<Vec<f64>> {
    let mut classes = vec![[0.0f64; 3]; CLASSES];
    for level in scan.levels().iter().filter(|level| level.planes.len() > 1) {
        let n = level.planes.len() as f64;
        for i in 0..scan.width * scan.height {
            let counts = level.planes.iter().map(|plane| f64::from(scan.planes[*plane][i]));
            let (sum, squares) = counts.fold((0.0, 0.0), |(s, q), c| (s + c, q + c * c));
            let (mean, variance) = (sum / n, (squares - sum * sum / n) / (n - 1.0));
            let class = &mut classes[class(mean - background)];
            for (sum, value) in class.iter_mut().zip([1.0, mean - background, variance]) {
                *sum += value;
            }
        }
    }
    let points: Vec<[f64; 3]> = classes
        .iter()
        .filter(|[n, ..]| *n >= LEAST_PIXELS)
        .map(|[n, signal, variance]| [signal / n, variance / n, *n])
        .collect();
    polynomial(&points)
}

/// The class of a signal: the first one up to a count, then logarithmic.
fn class(signal: f64) -> usize {
    if signal < 1.0 { 0 } else { (1.0 + PER_DECADE * libm::log10(signal)).min(CLASSES as f64 - 1.0) as usize }
}

/// Coefficients of variance over signal, of which none is negative, by weighted least squares: the relative
/// error of each class depends on its number of pixels only. Terms are given up from the last one until all
/// are positive.
fn polynomial(points: &[[f64; 3]]) -> Option<Vec<f64>> {
    for terms in (1..=3usize.min(points.len())).rev() {
        let mut found = vec![0.0; terms];
        let mut weights: Vec<f64> = points.iter().map(|[_, v, n]| n.min(1e4) / (v * v).max(1e-12)).collect();
        for _ in 0..4 {
            found = least_squares(points, &weights, terms)?;
            let fitted = |s: f64| found.iter().rev().fold(0.0, |sum, c| sum * s + c);
            // From the fit, because a class whose variance is low by chance would weigh more.
            weights = points
                .iter()
                .map(|[s, v, n]| n.min(1e4) / fitted(*s).max(0.1 * v).max(1e-6).powi(2))
                .collect();
        }
        if found.iter().all(|c| *c >= 0.0) {
            return Some(found);
        }
    }
    None
}

/// Weighted least squares for a polynomial of up to three terms.
fn least_squares(points: &[[f64; 3]], weights: &[f64], terms: usize) -> Option<Vec<f64>> {
    let scale = points.iter().map(|p| p[0].abs()).fold(1.0, f64::max);
    let (mut normal, mut right) = (Symmetric::zeros(terms), vec![0.0; terms]);
    for ([signal, variance, _], weight) in points.iter().zip(weights) {
        let powers: Vec<f64> = (0..terms).map(|k| libm::pow((signal / scale).max(0.0), k as f64)).collect();
        for i in 0..terms {
            right[i] += weight * powers[i] * variance;
            (0..terms).for_each(|j| normal.add(i, j, weight * powers[i] * powers[j]));
        }
    }
    let found = normal.solve(&right)?;
    Some(found.iter().enumerate().map(|(k, c)| c / libm::pow(scale, k as f64)).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_law_of_the_noise_is_found() {
        let law = [14.8, 0.09, 2.2e-5];
        let at = |s: f64| law[0] + law[1] * s + law[2] * s * s;
        let points: Vec<[f64; 3]> = (0..40)
            .map(|k| {
                let s = libm::pow(10.0, 0.1 * f64::from(k));
                [s, at(s), 1000.0]
            })
            .collect();
        for (found, law) in polynomial(&points).unwrap().iter().zip(law) {
            assert!((found / law - 1.0).abs() < 1e-6, "{found} {law}");
        }
        // A falling variance is none.
        let points = [[0.0, 20.0, 100.0], [100.0, 10.0, 100.0], [200.0, 5.0, 100.0]];
        assert_eq!(polynomial(&points).unwrap().len(), 1);
    }
}
