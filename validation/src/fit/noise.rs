//! Goodness of a fit if errors of the model count as noise: the variance of the background and that per count
//! of light are those of the largest likelihood of the residuals.

use fit::Scan;

/// Variance of rounding to whole counts.
const ROUNDING: f64 = 1.0 / 12.0;
/// Refinements of the grid of variances, and its points on either side.
const REFINEMENTS: i32 = 6;
const POINTS: i32 = 6;

/// chi2 per pixel, and the share of the light that the model explains.
pub(super) fn goodness(scan: &Scan, model: &Scan, background: f64) -> [f64; 2] {
    let pixels: Vec<[f64; 2]> = scan
        .planes
        .iter()
        .flatten()
        .zip(model.planes.iter().flatten())
        .map(|(&count, &mean)| {
            let r = f64::from(count) - f64::from(mean);
            [(f64::from(mean) - background).max(0.0), r * r]
        })
        .collect();
    let sum =
        |f: &dyn Fn(f64, f64) -> f64| pixels.iter().map(|&[light, square]| f(light, square)).sum::<f64>();
    let mean = sum(&|_, square| square) / pixels.len() as f64;
    // In units of the mean squared residual; the grid becomes finer about the best point.
    let (mut best, mut factor) = ([mean, mean], 4.0f64);
    for _ in 0..REFINEMENTS {
        let [a, b] = best;
        let grid = (-POINTS..=POINTS).flat_map(|i| (-POINTS..=POINTS).map(move |j| (i, j)));
        let points = grid.map(|(i, j)| [(a * factor.powi(i)).max(ROUNDING), b * factor.powi(j)]);
        let cost = |[a, b]: [f64; 2]| sum(&|light, square| square / (a + b * light) + (a + b * light).ln());
        let found = points.map(|at| (cost(at), at)).min_by(|x, y| x.0.total_cmp(&y.0));
        best = found.map_or(best, |(_, at)| at);
        factor = factor.sqrt();
    }
    let [a, b] = best;
    let chi2 = sum(&|light, square| square / (a + b * light)) / pixels.len() as f64;
    let unexplained = sum(&|light, square| square - (a + b * light));
    [chi2, 1.0 - unexplained / sum(&|light, _| light * light)]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn noise_of_known_variance_has_a_chi2_of_one() {
        // Residuals of +-1 on darkness and +-3 on 32 counts: variances 1 and 9, that is 1 + light / 4.
        let plane = |values: [u16; 2]| (0..400).map(|i| values[i / 2 % 2]).collect::<Vec<u16>>();
        let scan = |planes: Vec<Vec<u16>>| Scan {
            width: 20,
            height: 20,
            planes,
            stage_um: Vec::new(),
            full_scale: 255,
            warnings: Vec::new(),
        };
        let model = scan(vec![plane([10, 42])]);
        let mut data = model.clone();
        for (i, count) in data.planes[0].iter_mut().enumerate() {
            let r = if i / 2 % 2 == 0 { 1 } else { 3 };
            *count = if i % 2 == 0 { *count + r } else { *count - r };
        }
        let [chi2, r2] = goodness(&data, &model, 10.0);
        assert!((chi2 - 1.0).abs() < 0.02 && (r2 - 1.0).abs() < 0.01, "{chi2} {r2}");
    }
}
