//! Spots of about one size in the image plane.
//!
//! The Laplacian of a Gaussian of standard deviation r / sqrt(2) answers most to discs of radius r (Lindeberg 1998, Int. J.
//! Comput. Vis. 30, 79). Its local maxima above the noise are particles, refined by a Gaussian through three points in x
//! and in y. Images far out of focus fall apart into pieces of their rings: the method is for images in focus.

use super::Found;
use super::picture::{Picture, three_points};

/// Maxima must be this many standard deviations of the answer's noise high.
const ABOVE_NOISE: f32 = 6.0;

/// Finds spots of a given size.
#[derive(Debug)]
pub(super) struct Finder {
    sigma_px: f32,
}

impl Finder {
    pub(super) fn new(diameter_px: f64) -> Self {
        Finder { sigma_px: (0.5 * diameter_px / 2.0f64.sqrt()).max(0.5) as f32 }
    }

    pub(super) fn find(&self, picture: &Picture) -> Vec<Found> {
        let (w, h) = (picture.width, picture.height);
        if w < 3 || h < 3 {
            return Vec::new();
        }
        let smooth = picture.smoothed(self.sigma_px);
        let value = |x: usize, y: usize| smooth.counts[y * w + x];
        let answer = Picture::from_fn((w, h), |x, y| {
            let (left, right) = (value(x.saturating_sub(1), y), value((x + 1).min(w - 1), y));
            let (up, down) = (value(x, y.saturating_sub(1)), value(x, (y + 1).min(h - 1)));
            4.0 * value(x, y) - left - right - up - down
        });
        // Without noise everything is above it; what rounding leaves is not a particle.
        let threshold = (ABOVE_NOISE * answer.noise()).max(1e-3);
        let level = picture.median();
        let mut found = Vec::new();
        for y in 1..h - 1 {
            for x in 1..w - 1 {
                let here = answer.counts[y * w + x];
                if here <= threshold || !is_maximum(&answer, x, y) {
                    continue;
                }
                let peak = |x: usize, y: usize| value(x, y) - level;
                let dx = three_points(peak(x - 1, y), peak(x, y), peak(x + 1, y));
                let dy = three_points(peak(x, y - 1), peak(x, y), peak(x, y + 1));
                found.push(Found {
                    x_px: x as f64 + 1.0 + f64::from(dx),
                    y_px: y as f64 + 1.0 + f64::from(dy),
                    z_um: None,
                });
            }
        }
        found
    }
}

/// Whether no pixel around is higher; of equal ones the first counts.
fn is_maximum(picture: &Picture, x: usize, y: usize) -> bool {
    let w = picture.width;
    let here = picture.counts[y * w + x];
    (y - 1..=y + 1).all(|v| {
        (x - 1..=x + 1).all(|u| {
            let other = picture.counts[v * w + u];
            if (v, u) < (y, x) { other < here } else { other <= here }
        })
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn spots_are_found_to_a_few_hundredths_of_a_pixel() {
        let spots = [(12.3, 20.7), (40.0, 11.5), (31.8, 33.1)];
        let picture = Picture::from_fn((60, 50), |x, y| {
            let light = |(cx, cy): (f32, f32)| {
                let r2 = (x as f32 + 1.0 - cx).powi(2) + (y as f32 + 1.0 - cy).powi(2);
                800.0 * (-r2 / (2.0 * 0.8f32.powi(2))).exp()
            };
            // A fixed pattern of a few counts stands for noise.
            100.0 + ((x * 7 + y * 13) % 5) as f32 + spots.map(light).iter().sum::<f32>()
        });
        let mut found = Finder::new(3.0).find(&picture);
        found.sort_by(|a, b| a.x_px.total_cmp(&b.x_px));
        assert_eq!(found.len(), 3, "{found:?}");
        for (found, spot) in found.iter().zip([spots[0], spots[2], spots[1]]) {
            let error = (found.x_px - f64::from(spot.0)).hypot(found.y_px - f64::from(spot.1));
            assert!(error < 0.05, "{found:?} for {spot:?}");
        }
    }
}
