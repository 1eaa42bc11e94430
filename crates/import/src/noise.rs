//! Noise of a camera from repeated frames of the planes of a scan: the variance of each pixel over the
//! repeats against its mean signal. Photons and read noise give a straight line; light that fluctuates from
//! frame to frame adds a square.

use dataset::manifest::NoiseFacts;
use fit::Scan;

use super::stacks::levels;

/// Pixels are sorted into classes of signal, this many per decade, up to this many counts.
const PER_DECADE: f64 = 8.0;
const CLASSES: usize = 48;

/// Classes with fewer pixels are not used.
const LEAST_PIXELS: f64 = 50.0;

/// The noise of a frame of the scan, whose background has this mean and standard deviation.
pub(crate) fn of_scan(scan: &Scan, background: [f64; 2]) -> NoiseFacts {
    let levels = levels(scan);
    let repeats = levels.iter().map(|level| level.planes.len()).min().unwrap_or(1) as u32;
    let mut classes = vec![[0.0f64; 3]; CLASSES];
    for level in levels.iter().filter(|level| level.planes.len() > 1) {
        let n = level.planes.len() as f64;
        for i in 0..scan.width * scan.height {
            let counts = level.planes.iter().map(|plane| f64::from(scan.planes[*plane][i]));
            let (sum, squares) = counts.fold((0.0, 0.0), |(s, q), c| (s + c, q + c * c));
            let (mean, variance) = (sum / n, (squares - sum * sum / n) / (n - 1.0));
            let class = &mut classes[class(mean - background[0])];
            for (sum, value) in class.iter_mut().zip([1.0, mean - background[0], variance]) {
                *sum += value;
            }
        }
    }
    let points: Vec<[f64; 3]> = classes
        .iter()
        .filter(|[n, ..]| *n >= LEAST_PIXELS)
        .map(|[n, signal, variance]| [signal / n, variance / n, *n])
        .collect();
    match polynomial(&points) {
        Some(variance) => NoiseFacts {
            background_counts: background[0],
            variance,
            repeats: levels.iter().map(|level| level.planes.len()).max().unwrap_or(1) as u32,
            definition: "variance of each pixel over repeated frames of a plane against its mean signal above the background, \
                         fitted over classes of signal"
                .to_owned(),
        },
        None => NoiseFacts {
            background_counts: background[0],
            variance: vec![background[1] * background[1]],
            repeats,
            definition: "variance of the background over pixels; the scan has no repeated frames, which would show how noise \
                         grows with the signal"
                .to_owned(),
        },
    }
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

/// Weighted least squares for a polynomial of up to three terms, by elimination.
fn least_squares(points: &[[f64; 3]], weights: &[f64], terms: usize) -> Option<Vec<f64>> {
    let scale = points.iter().map(|p| p[0].abs()).fold(1.0, f64::max);
    let mut rows = vec![vec![0.0; terms + 1]; terms];
    for ([signal, variance, _], weight) in points.iter().zip(weights) {
        let powers: Vec<f64> = (0..terms).map(|k| libm::pow((signal / scale).max(0.0), k as f64)).collect();
        for (i, row) in rows.iter_mut().enumerate() {
            for (cell, power) in row.iter_mut().zip(powers.iter().chain([variance])) {
                *cell += weight * powers[i] * power;
            }
        }
    }
    for i in 0..terms {
        let pivot = rows[i][i];
        if pivot.is_nan() || pivot <= 0.0 {
            return None;
        }
        rows[i].iter_mut().for_each(|cell| *cell /= pivot);
        let own = rows[i].clone();
        for (_, row) in rows.iter_mut().enumerate().filter(|(j, _)| *j != i) {
            let factor = row[i];
            row.iter_mut().zip(&own).for_each(|(cell, own)| *cell -= factor * own);
        }
    }
    Some((0..terms).map(|k| rows[k][terms] / libm::pow(scale, k as f64)).collect())
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
