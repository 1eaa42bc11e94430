//! Interpolation of particle images between the pixels and depths of a stack by tensor products of cubic
//! B-splines.

use std::ops::Range;

use super::denoise::PixelNoise;
use super::gray_image::{CUBIC, GrayImage, Spline, prefilter, weights};
use super::images::{ImagePatch, ParticleImages};

/// The search template extends to pixels brighter than this fraction of its peak, ...
const FAINTEST: f32 = 0.05;

/// ... and than this many standard deviations of the residual noise.
const ABOVE_NOISE: f32 = 3.0;

/// Standard deviation of the Gaussian filter used for this, px.
const SMOOTH_PX: f32 = 1.5;

/// A fit uses the square that contains this fraction of the Fisher information on brightness.
const INFORMATION: f64 = 0.995;

/// Number of planes added beyond each end of the stack.
const PADDING: usize = 4;

/// A particle image at one depth.
#[derive(Debug, Clone)]
pub(super) struct Template {
    /// Counts above the background, with the particle on the central pixel of a square.
    image: GrayImage,
    /// Half width for the search, px.
    pub(super) radius: usize,
    /// Half width for fits, px.
    fit_radius: usize,
}

/// The templates, sorted by depth.
#[derive(Debug, Clone)]
pub(super) struct Templates {
    depths_um: Vec<f64>,
    all: Vec<Template>,
    /// Spline coefficients of the images, with [`PADDING`] planes before the first and after the last.
    coefficients: Vec<GrayImage>,
}

impl Templates {
    /// Templates from squares of odd side with the particle at the center, for frames with this noise.
    pub(super) fn new(depths_um: Vec<f64>, images: Vec<GrayImage>, noise: PixelNoise) -> Self {
        let coefficients = coefficients(&images);
        let all = images.into_iter().map(|image| Template::new(image, noise)).collect();
        Templates { depths_um, all, coefficients }
    }

    /// The templates binned by an odd `factor`.
    pub(super) fn binned(&self, factor: usize, noise: PixelNoise) -> Self {
        let half = factor / 2;
        let images = self.all.iter().map(|template| {
            let width = template.image.width;
            let room = (width / 2).saturating_sub(half) / factor;
            let first = width / 2 - room * factor - half;
            template.image.binned_from(first, 2 * room + 1, factor)
        });
        Templates::new(self.depths_um.clone(), images.collect(), noise.binned(factor))
    }

    pub(super) fn len(&self) -> usize {
        self.all.len()
    }

    pub(super) fn get(&self, index: usize) -> &Template {
        &self.all[index]
    }

    /// The whole image of a template.
    pub(super) fn image(&self, index: usize) -> &GrayImage {
        &self.all[index].image
    }

    /// Depth of a template, um.
    pub(super) fn depth_um(&self, index: usize) -> f64 {
        self.depths_um[index]
    }

    /// Mean distance between depths, um.
    pub(super) fn step_um(&self) -> f64 {
        (self.depths_um[self.len() - 1] - self.depths_um[0]) / (self.len() - 1) as f64
    }

    /// Fractional index of a depth among the templates, and index per um there.
    fn place(&self, z_um: f64) -> (f64, f64) {
        let low = self.depths_um.partition_point(|d| *d <= z_um).clamp(1, self.len() - 1) - 1;
        let per_um = 1.0 / (self.depths_um[low + 1] - self.depths_um[low]);
        (low as f64 + (z_um - self.depths_um[low]) * per_um, per_um)
    }
}

impl ParticleImages for Templates {
    fn depths_um(&self) -> [f64; 2] {
        [self.depths_um[0], self.depths_um[self.len() - 1]]
    }

    fn radius_px(&self, z_um: f64, reach_um: f64) -> usize {
        let [low, high] = [z_um - reach_um, z_um + reach_um].map(|z| self.place(z).0);
        let last = (self.len() - 1) as f64;
        let near = low.floor().clamp(0.0, last) as usize..=high.ceil().clamp(0.0, last) as usize;
        self.all[near].iter().map(|t| t.fit_radius).max().unwrap_or(0)
    }

    fn patch(&self, at: [f64; 2], z_um: f64, radius: usize) -> ImagePatch {
        let middle = at.map(f64::round);
        let offset = [at[0] - middle[0], at[1] - middle[1]];
        let (place, per_um) = self.place(z_um);
        let place = place.clamp(0.0, (self.len() - 1) as f64);
        let low = (place as usize).min(self.len() - 2);
        let t = (place - low as f64) as f32;
        let (value, slope) = weights(t);
        let slope = slope.map(|s| s * per_um as f32);
        let knots: [&GrayImage; 4] = std::array::from_fn(|i| &self.coefficients[low + PADDING + i - 1]);
        let (width, center) = (knots[0].width, (knots[0].width / 2) as isize);
        // All pixels of the square have the same sub-pixel offset from the template's.
        let base = offset.map(|o| (-o).floor());
        let part: [f32; 2] = std::array::from_fn(|i| (-offset[i] - base[i]) as f32);
        let ((wx, sx), (wy, sy)) = (weights(part[0]), weights(part[1]));
        let (side, r) = (2 * radius + 1, radius as isize);
        let inside = |i: isize| (0..width as isize).contains(&i).then_some(i as usize);
        // Interpolate along x (and z) first, for all required rows.
        let mut rows = vec![[0.0f32; 3]; side * (side + 3)];
        let mut along = vec![[0.0f32; 2]; side + 3];
        for (j, row) in rows.chunks_mut(side).enumerate() {
            let Some(v) = inside(center + base[1] as isize - r + j as isize - 1) else { continue };
            along.fill([0.0; 2]);
            for (i, both) in along.iter_mut().enumerate() {
                let Some(u) = inside(center + base[0] as isize - r + i as isize - 1) else { continue };
                for k in 0..4 {
                    let c = knots[k].counts[v * width + u];
                    both[0] += value[k] * c;
                    both[1] += slope[k] * c;
                }
            }
            for (i, cell) in row.iter_mut().enumerate() {
                for k in 0..4 {
                    let [c, d] = along[i + k];
                    cell[0] += wx[k] * c;
                    cell[1] -= sx[k] * c;
                    cell[2] += wx[k] * d;
                }
            }
        }
        let light = (0..side * side)
            .map(|at| {
                let mut cell = [0.0; 4];
                for k in 0..4 {
                    let [c, x, z] = rows[at + k * side];
                    cell[0] += wy[k] * c;
                    cell[1] += wy[k] * x;
                    cell[2] -= sy[k] * c;
                    cell[3] += wy[k] * z;
                }
                cell
            })
            .collect();
        ImagePatch { middle: middle.map(|c| c as isize), radius, light }
    }
}

/// Spline coefficients along x, y and z. The stack is extrapolated beyond its ends by point reflection.
fn coefficients(images: &[GrayImage]) -> Vec<GrayImage> {
    let mut planes: Vec<GrayImage> =
        images.iter().map(|image| Spline::new(image).into_coefficients()).collect();
    let n = planes.len();
    let beyond = |end: &GrayImage, inner: &GrayImage| GrayImage {
        counts: end.counts.iter().zip(&inner.counts).map(|(e, i)| 2.0 * e - i).collect(),
        ..*end
    };
    let before: Vec<GrayImage> =
        (1..=PADDING).rev().map(|k| beyond(&planes[0], &planes[k.min(n - 1)])).collect();
    let after: Vec<GrayImage> =
        (1..=PADDING).map(|k| beyond(&planes[n - 1], &planes[(n - 1).saturating_sub(k)])).collect();
    planes = before.into_iter().chain(planes).chain(after).collect();
    let mut line = vec![0.0; planes.len()];
    for i in 0..planes[0].counts.len() {
        line.iter_mut().zip(&planes).for_each(|(value, plane)| *value = plane.counts[i]);
        prefilter(&mut line, &CUBIC);
        line.iter().zip(&mut planes).for_each(|(value, plane)| plane.counts[i] = *value);
    }
    planes
}

impl Template {
    fn new(image: GrayImage, noise: PixelNoise) -> Self {
        let smooth = image.smoothed(SMOOTH_PX);
        let peak = smooth.counts.iter().copied().fold(0.0, f32::max);
        let middle = image.width / 2;
        let from_middle =
            |i: usize| (i % image.width).abs_diff(middle).max((i / image.width).abs_diff(middle));
        let threshold = (FAINTEST * peak).max(ABOVE_NOISE * smooth.noise().min(noise.dark.sqrt()));
        // 99 % quantile of the distances of pixels above the threshold, to exclude noise.
        let mut reach: Vec<usize> =
            (0..image.counts.len()).filter(|&i| smooth.counts[i] > threshold).map(from_middle).collect();
        reach.sort_unstable();
        let farthest = reach.get(reach.len() * 99 / 100).copied().unwrap_or(0);
        // Otherwise pixels that do not exceed the noise of the template would add the more information, the
        // larger the calibration image is.
        let visible = ABOVE_NOISE * smooth.noise();
        let mut information = vec![0.0f64; middle + 1];
        for (i, count) in image.counts.iter().enumerate().filter(|(i, _)| smooth.counts[*i] > visible) {
            information[from_middle(i)] += f64::from(count * count / noise.variance(*count));
        }
        let total: f64 = information.iter().sum();
        let mut sum = 0.0;
        let needed = information.iter().position(|ring| {
            sum += ring;
            sum >= INFORMATION * total
        });
        let radius = (farthest + 2).min(middle);
        Template { radius, fit_radius: (needed.unwrap_or(middle) + 2).clamp(radius, middle), image }
    }

    /// The pixels at these offsets from the center along x, of the row at `dy`.
    pub(super) fn row(&self, dy: isize, dx: Range<isize>) -> &[f32] {
        let middle = (self.image.width / 2) as isize;
        let first = (middle + dy) * (2 * middle + 1) + middle;
        &self.image.counts[(first + dx.start) as usize..(first + dx.end) as usize]
    }
}
