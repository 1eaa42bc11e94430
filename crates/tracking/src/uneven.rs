//! The background of recorded images: illumination and stray light make it uneven.

use microsig_core::linear::Symmetric;

use super::gray_image::GrayImage;

/// Most squares along an image, fewest, and the least side of a square, px.
const SQUARES: [usize; 2] = [16, 4];
const LEAST_PX: usize = 16;

/// Rounds in which squares with much light are left out.
const ROUNDS: usize = 5;

/// Terms of a polynomial of second degree.
const TERMS: usize = 6;

impl GrayImage {
    /// The image without the unevenness of its background.
    pub(crate) fn evened(&self) -> Self {
        let mut even = self.clone();
        even.counts.iter_mut().zip(self.unevenness()).for_each(|(count, uneven)| *count -= uneven);
        even
    }

    /// The background less its mean, row by row: a polynomial of second degree through the darker halves of squares. 0
    /// in small images.
    pub fn unevenness(&self) -> Vec<f32> {
        let (width, height) = (self.width, self.height);
        let [columns, rows] = [width, height].map(|size| (size / LEAST_PX).min(SQUARES[0]));
        let terms = |x: f64, y: f64| -> [f64; TERMS] {
            let (x, y) = (2.0 * x / width as f64 - 1.0, 2.0 * y / height as f64 - 1.0);
            [1.0, x, y, x * x, x * y, y * y]
        };
        let square = |k: usize| {
            let (i, j) = (k % columns, k / columns);
            let [x0, x1] = [i, i + 1].map(|i| i * width / columns);
            let [y0, y1] = [j, j + 1].map(|j| j * height / rows);
            let mut counts: Vec<f32> =
                (y0..y1).flat_map(|y| &self.counts[y * width..][x0..x1]).copied().collect();
            counts.sort_unstable_by(f32::total_cmp);
            let dark = &counts[..counts.len().div_ceil(2)];
            let level = dark.iter().map(|count| f64::from(*count)).sum::<f64>() / dark.len() as f64;
            (terms(0.5 * (x0 + x1) as f64, 0.5 * (y0 + y1) as f64), level)
        };
        let squares = if columns.min(rows) < SQUARES[1] { 0 } else { columns * rows };
        let solution = robust(&(0..squares).map(square).collect::<Vec<_>>());
        let at = |i: usize| dot(&solution, &terms((i % width) as f64 + 0.5, (i / width) as f64 + 0.5)) as f32;
        let mut uneven: Vec<f32> = (0..width * height).map(at).collect();
        let mean = uneven.iter().map(|v| f64::from(*v)).sum::<f64>() / uneven.len().max(1) as f64;
        uneven.iter_mut().for_each(|v| *v -= mean as f32);
        uneven
    }
}

/// The coefficients that fit most levels; 0 if these do not determine them.
fn robust(levels: &[([f64; TERMS], f64)]) -> [f64; TERMS] {
    let mut solution = [0.0; TERMS];
    let mut kept = levels.to_vec();
    for _ in 0..ROUNDS {
        let (mut matrix, mut right) = (Symmetric::zeros(TERMS), [0.0; TERMS]);
        for (terms, level) in &kept {
            for i in 0..TERMS {
                right[i] += terms[i] * level;
                (0..TERMS).for_each(|j| matrix.add(i, j, terms[i] * terms[j]));
            }
        }
        let Some(found) = matrix.solve(&right) else { break };
        solution.copy_from_slice(&found);
        let away = |(terms, level): &([f64; TERMS], f64)| (level - dot(&solution, terms)).abs();
        let mut sizes: Vec<f64> = levels.iter().map(away).collect();
        sizes.sort_by(f64::total_cmp);
        // Two standard deviations.
        let most = 2.0 * 1.4826 * sizes[sizes.len() / 2];
        kept = levels.iter().filter(|of| away(of) <= most).copied().collect();
    }
    solution
}

fn dot(a: &[f64; TERMS], b: &[f64; TERMS]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A background of 98 to 102 counts with noise and a bright particle in every ninth square.
    #[test]
    fn a_smooth_background_is_found_below_particles() {
        let (width, height) = (200, 160);
        let smooth = |x: usize, y: usize| 0.01 * (x as f32 - 99.5) + 1e-4 * (y as f32 - 79.5).powi(2);
        let image = GrayImage::from_fn((width, height), |x, y| {
            let noise = ((x * 7919 + y * 104_729) % 101) as f32 / 25.0 - 2.0;
            let is_bright = (x / 16 + y / 16 * 12) % 9 == 0 && x % 16 > 5 && y % 16 > 5;
            100.0 + smooth(x, y) + noise + if is_bright { 300.0 } else { 0.0 }
        });
        let uneven = image.unevenness();
        let truth: Vec<f32> = (0..width * height).map(|i| smooth(i % width, i / width)).collect();
        let mean = truth.iter().sum::<f32>() / truth.len() as f32;
        let off = uneven.iter().zip(&truth).map(|(a, b)| (a - (b - mean)).abs()).fold(0.0, f32::max);
        assert!(off < 0.15, "{off}");
        let small = GrayImage::from_fn((60, 160), |x, _| x as f32);
        assert!(small.unevenness().iter().all(|v| *v == 0.0));
    }
}
