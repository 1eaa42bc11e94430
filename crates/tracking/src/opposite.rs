//! Depths on the other side of the focus, whose images look alike.

use super::gray_image::GrayImage;

/// Averaged images at depths on both sides of the focus are alike from this correlation on, if it falls by this much
/// between them.
const ALIKE: f64 = 0.75;
const FALL: f64 = 0.01;

/// For each depth, that on the other side of the focus with the most similar averaged image.
pub(super) struct Opposite {
    depths_um: Vec<f64>,
    other_um: Vec<Option<f64>>,
    /// Midpoint and half the separation of the closest such pair, um. Nearer to focus, averaged images hardly change with
    /// depth, and the other side is taken to be the reflection about the midpoint.
    middle: Option<(f64, f64)>,
}

impl Opposite {
    pub(super) fn new(depths_um: Vec<f64>, averaged: &[GrayImage]) -> Self {
        let n = averaged.len();
        let product = |j: usize, k: usize| -> f64 {
            let pixels = averaged[j].counts.iter().zip(&averaged[k].counts);
            pixels.map(|(a, b)| f64::from(a * b)).sum()
        };
        let own: Vec<f64> = (0..n).map(|k| product(k, k)).collect();
        let other = |k: usize| {
            let alike: Vec<f64> = (0..n).map(|j| product(j, k) / (own[j] * own[k]).sqrt()).collect();
            let lowest = |j: usize| alike[j.min(k)..=j.max(k)].iter().copied().fold(1.0, f64::min);
            let others = (0..n).filter(|&j| alike[j] > ALIKE && lowest(j) < alike[j] - FALL);
            others.max_by(|&a, &b| alike[a].total_cmp(&alike[b])).map(|j| depths_um[j])
        };
        let other_um: Vec<Option<f64>> = (0..n).map(other).collect();
        let pairs = depths_um.iter().zip(&other_um).filter_map(|(z, other)| other.map(|other| [*z, other]));
        let closest = pairs.min_by(|a, b| (a[1] - a[0]).abs().total_cmp(&(b[1] - b[0]).abs()));
        let middle = closest.map(|[z, other]| (0.5 * (z + other), 0.5 * (z - other).abs()));
        Opposite { depths_um, other_um, middle }
    }

    pub(super) fn of(&self, z_um: f64) -> Option<f64> {
        if let Some((middle, _)) = self.middle.filter(|(middle, half)| (z_um - middle).abs() < *half) {
            return Some(2.0 * middle - z_um);
        }
        let away = |k: &usize| (self.depths_um[*k] - z_um).abs();
        let nearest = (0..self.depths_um.len()).min_by(|a, b| away(a).total_cmp(&away(b)))?;
        self.other_um[nearest]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Images that are symmetric about focus at 1 um: the depth with the same image on the other side is found to within
    /// the spacing of the templates, near focus as well.
    #[test]
    fn both_sides_of_focus_are_known() {
        let depths_um: Vec<f64> = (0..45).map(|k| -10.0 + 0.5 * f64::from(k)).collect();
        let side = 41;
        let image = |z_um: &f64| {
            let sigma = 2.0 + 0.05 * (z_um - 1.0).powi(2);
            let r2 = |i: usize| (i % side).abs_diff(20).pow(2) + (i / side).abs_diff(20).pow(2);
            let counts =
                (0..side * side).map(|i| (-0.5 * r2(i) as f64 / (sigma * sigma)).exp() as f32 / sigma as f32);
            GrayImage { width: side, height: side, counts: counts.collect() }
        };
        let images: Vec<GrayImage> = depths_um.iter().map(image).collect();
        let opposite = Opposite::new(depths_um, &images);
        for z_um in [1.1, 1.4, 0.3, 5.0, -7.0, 9.5] {
            let other = opposite.of(z_um).unwrap();
            assert!((other - (2.0 - z_um)).abs() < 0.6, "{z_um}: {other}");
        }
    }
}
