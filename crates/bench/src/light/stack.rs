//! Noise-free images of one particle over depth.
//!
//! Of Gaussian spots the image itself; of rays the mean of images of a sphere that is centred on a pixel. Such an image is
//! symmetric (left and right, top and bottom; without a cylindrical lens also about its diagonals), so the mean is taken
//! over its mirror images too: of 32 images it then has the noise of 128 or 256.

use microsig_core::render::Renderer;
use microsig_core::render::rays::Scratch;
use microsig_core::stream::{Purpose, Streams};
use microsig_core::{Particle, Settings};
use rayon::prelude::*;

use crate::error::Result;

/// Depths of a stack: as many equispaced ones as the definition of A_pi asks for.
const DEPTHS: usize = 51;

/// A pixel belongs to a particle's image if its light is above this share of the image's peak.
pub(super) const AREA_SHARE: f64 = 0.1;

/// Images are cut where they fall below this share of their peak for good.
const CUT_SHARE: f64 = 0.005;

/// Half the longest side of an image, px. What lands farther away is far below a tenth of the peak.
const LONGEST_HALF_PX: usize = 400;

/// Ray images per mean.
const IMAGES: u32 = 32;

/// Noise-free images of one particle, centred on a pixel, at equispaced depths from one end of a range to the other.
#[derive(Debug, Clone, PartialEq)]
pub struct Stack {
    /// Physical depths, um.
    pub depths_um: Vec<f64>,
    /// The image at each depth.
    pub spots: Vec<Spot>,
}

/// A noise-free image of a particle of brightness 1.
#[derive(Debug, Clone, PartialEq)]
pub struct Spot {
    /// Greatest light of a pixel, as in [`microsig_core::sensor::Light`].
    pub peak: f64,
    /// Pixels above a tenth of the peak.
    pub area_px: f64,
    /// Sum over pixels of the squared slope, light^2/px^2: the curvature of the autocorrelation's peak.
    pub curvature: f64,
    /// Pixels on each side of the middle one.
    pub half_px: usize,
    /// Light of `2 half_px + 1` rows of as many pixels.
    pub light: Vec<f64>,
}

impl Stack {
    /// The stack of a sphere of a diameter (um) through a range of physical depths (um); `draw` gives the renderer for a
    /// sensor.
    ///
    /// # Errors
    /// Settings that cannot be drawn.
    pub fn measure(
        draw: impl Fn(&Settings) -> Result<Renderer>,
        settings: &Settings,
        d_um: f64,
        range_um: (f64, f64),
        depth_factor: f64,
    ) -> Result<Self> {
        let last = (DEPTHS - 1) as f64;
        let depths_um: Vec<f64> =
            (0..DEPTHS).map(|k| range_um.0 + (range_um.1 - range_um.0) * k as f64 / last).collect();
        let whole = draw(settings)?;
        let reach = depths_um
            .iter()
            .map(|z| whole.image_extent(&Particle::sphere(1.0, 1.0, z / depth_factor, d_um)))
            .fold(0.0f64, |most, (x, y)| most.max(x).max(y));
        let half_px = (reach.ceil() as usize).min(LONGEST_HALF_PX);
        let side = 2 * half_px as u32 + 1;
        let settings = Settings { pixel_dim_x: side, pixel_dim_y: side, ..settings.clone() };
        let renderer = draw(&settings)?;
        let middle = (half_px + 1) as f64;
        let spots = depths_um
            .par_iter()
            .map(|z| {
                let particle = Particle::sphere(middle, middle, z / depth_factor, d_um);
                Spot::new(half_px, mean(&renderer, &particle, half_px))
            })
            .collect();
        Ok(Stack { depths_um, spots })
    }

    /// A_pi: the area of a particle image, averaged over the depths, px.
    pub fn area_px(&self) -> f64 {
        self.spots.iter().map(|spot| spot.area_px).sum::<f64>() / self.spots.len() as f64
    }

    /// The depth whose image has the highest peak, um; `None` if all are as high, where all depths are in focus.
    pub fn focus_um(&self) -> Option<f64> {
        let peaks = || self.spots.iter().map(|spot| spot.peak);
        if peaks().all(|peak| peak == self.spots[0].peak) {
            return None;
        }
        let best = peaks().zip(&self.depths_um).max_by(|a, b| a.0.total_cmp(&b.0));
        best.map(|(_, z)| *z)
    }

    /// The image nearest to a physical depth (um), and the peak there, linear between the depths; beyond the ends as at
    /// the ends.
    pub fn at(&self, z_um: f64) -> (&Spot, f64) {
        let last = self.spots.len() - 1;
        let (first, end) = (self.depths_um[0], self.depths_um[last]);
        let place = ((z_um - first) / (end - first) * last as f64).clamp(0.0, last as f64);
        let below = (place as usize).min(last - 1);
        let share = place - below as f64;
        let peak = (1.0 - share) * self.spots[below].peak + share * self.spots[below + 1].peak;
        (&self.spots[below + usize::from(share >= 0.5)], peak)
    }
}

/// The mean image of a particle in the middle of a square sensor.
fn mean(renderer: &Renderer, particle: &Particle, half_px: usize) -> Vec<f64> {
    let streams = Streams::new(0);
    let Renderer::Rays(renderer) = renderer else {
        return renderer.light(std::slice::from_ref(particle), &streams, Purpose::CalibrationRays, 0).values;
    };
    let mut scratch = Scratch::default();
    let side = 2 * half_px + 1;
    let mut sum = vec![0u32; side * side];
    for image in 0..IMAGES {
        let patch = renderer.patch(particle, &streams, Purpose::CalibrationRays, image, 0, &mut scratch);
        let Some(patch) = patch else { continue };
        let window = patch.window;
        for (row, counts) in patch.counts.chunks(window.width).enumerate() {
            let first = (window.y0 as usize - 1 + row) * side + window.x0 as usize - 1;
            sum[first..][..counts.len()].iter_mut().zip(counts).for_each(|(s, c)| *s += c);
        }
    }
    let at = |x: usize, y: usize| sum[y * side + x];
    let astigmatic = renderer.settings().cyl_focal_length != 0.0;
    (0..side * side)
        .map(|i| {
            let ([x, y], last) = ([i % side, i / side], side - 1);
            let mirrored = |x: usize, y: usize| {
                u64::from(at(x, y))
                    + u64::from(at(last - x, y))
                    + u64::from(at(x, last - y))
                    + u64::from(at(last - x, last - y))
            };
            // Whole numbers: the order of the sum does not matter.
            let (total, copies) =
                if astigmatic { (mirrored(x, y), 4) } else { (mirrored(x, y) + mirrored(y, x), 8) };
            total as f64 / f64::from(copies * IMAGES)
        })
        .collect()
}

impl Spot {
    /// Measures a square image of `2 half_px + 1` rows, and cuts off its dark margin.
    pub fn new(half_px: usize, light: Vec<f64>) -> Self {
        let side = 2 * half_px + 1;
        let peak = light.iter().copied().fold(0.0, f64::max);
        let area = light.iter().filter(|v| **v > AREA_SHARE * peak).count();
        let square = |a: f64, b: f64| (b - a) * (b - a);
        let rows = light.chunks(side);
        let along: f64 =
            rows.clone().flat_map(|row| row.windows(2)).map(|pair| square(pair[0], pair[1])).sum();
        let across: f64 =
            light.iter().zip(&light[side.min(light.len())..]).map(|(a, b)| square(*a, *b)).sum();
        let cut = rows
            .enumerate()
            .flat_map(|(y, row)| {
                row.iter().enumerate().map(move |(x, v)| (x.abs_diff(half_px).max(y.abs_diff(half_px)), *v))
            })
            .filter(|(_, v)| *v > CUT_SHARE * peak)
            .fold(0, |cut, (distance, _)| cut.max(distance));
        let kept = light.chunks(side).skip(half_px - cut).take(2 * cut + 1);
        let cropped = kept.flat_map(|row| row[half_px - cut..=half_px + cut].iter().copied()).collect();
        Spot { peak, area_px: area as f64, curvature: along + across, half_px: cut, light: cropped }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use microsig_core::emission::SpheroidLaw;
    use microsig_core::render::RayRenderer;

    #[test]
    fn a_spot_is_measured_by_hand() {
        let spot = Spot::new(1, vec![0.0, 1.0, 0.0, 2.0, 20.0, 3.0, 0.0, 2.0, 0.0]);
        assert_eq!((spot.peak, spot.area_px, spot.half_px), (20.0, 2.0, 1));
        // Rows: 1 + 1, 18^2 + 17^2, 4 + 4; columns: 4 + 4, 19^2 + 18^2, 9 + 9.
        assert_eq!(spot.curvature, 2.0 + 613.0 + 8.0 + 8.0 + 685.0 + 18.0);
        let dark_margin = Spot::new(1, vec![0.0, 0.01, 0.0, 0.0, 20.0, 0.0, 0.0, 0.0, 0.0]);
        assert_eq!((dark_margin.half_px, dark_margin.light), (0, vec![20.0]));
    }

    /// Areas and peaks of the original's images (means of 50, `set1` of the reference data): setting 1, 2 um. Its peaks are the
    /// greatest of many noisy pixels, up to 6 % too high where light is faint.
    #[test]
    fn images_over_depth_are_those_of_the_original() {
        let draw =
            |settings: &Settings| Ok(Renderer::Rays(RayRenderer::new(settings, SpheroidLaw::Original)?));
        let stack = Stack::measure(draw, &Settings::setting1(), 2.0, (-80.0, 20.0), 1.0).unwrap();
        for (z, area_px, peak) in [
            (-80.0, 2335.0, 49.5),
            (-70.0, 1575.0, 58.9),
            (-60.0, 998.0, 72.5),
            (-40.0, 333.0, 130.2),
            (-20.0, 69.0, 794.0),
            (-10.0, 25.0, 1052.1),
            (0.0, 66.0, 584.2),
            (20.0, 899.0, 83.7),
        ] {
            let (spot, at) = stack.at(z);
            assert!((spot.area_px / area_px - 1.0).abs() < 0.06, "{z}: {}", spot.area_px);
            assert!((at / peak - 0.975).abs() < 0.045, "{z}: {at}");
        }
        assert_eq!(stack.focus_um(), Some(-12.0));
        // Linear in between.
        let (half, a, b) = (stack.at(-11.0).1, stack.at(-12.0).1, stack.at(-10.0).1);
        assert!((half - 0.5 * (a + b)).abs() < 1e-9 && stack.at(99.0).1 == stack.at(20.0).1);
    }
}
