//! Alignment of the particles of a scan with sub-pixel accuracy, and how much they are alike.
//!
//! A particle is compared with a reference stack at all depths at once: position, focus, brightness and
//! background are fitted by least squares, so that defocused images, in which a centroid is noisy, count too. The
//! position of a particle is the same at all depths: what its images do there is part of the calibration.

use microsig_core::linear::Symmetric;
use tracking::{GrayImage, Spline};

use super::particles::{MARGIN, ScanParticle};

/// Half width of the square in which the first centroid is taken, px.
const CENTROID_PX: usize = 4;

/// Steps of the fit, and the difference of positions for derivatives, px.
const STEPS: usize = 4;
const DIFFERENCE_PX: f32 = 0.05;

/// Largest difference of focus, in steps of the scan.
const MOST_STEPS: f32 = 1.0;

/// Largest shift from the middle pixel, px.
const MOST_PX: f32 = MARGIN as f32 - 1.0;

/// The images of a particle, ready for interpolation.
pub(crate) struct Aligned {
    splines: Vec<Spline>,
    own: Vec<Vec<bool>>,
    /// Column and row of the middle pixel, px from 0.
    pub(crate) middle: [usize; 2],
    /// Position relative to that pixel, px.
    pub(crate) shift: [f32; 2],
    /// Brightness relative to the reference, and counts by which the background is higher.
    pub(crate) brightness: f32,
    pub(crate) offset: f32,
    /// Depth by which its focus is lower than the reference's, in steps of the scan.
    pub(crate) focus: f32,
    /// Share of the light that the reference does not explain, over the depths in focus.
    pub(crate) unexplained: f64,
    half: usize,
}

impl Aligned {
    /// A particle at the centroid of its sharpest images.
    pub(crate) fn new(particle: ScanParticle, half: usize) -> Self {
        let sharpest = sharpest(&particle.images);
        Aligned {
            shift: centroid(&particle.images[sharpest]),
            splines: particle.images.iter().map(Spline::new).collect(),
            own: particle.own,
            middle: particle.middle,
            brightness: 1.0,
            offset: 0.0,
            focus: 0.0,
            unexplained: 0.0,
            half,
        }
    }

    /// Column and row of the particle, px from 0.
    pub(crate) fn at(&self) -> [f64; 2] {
        [0, 1].map(|axis| self.middle[axis] as f64 + f64::from(self.shift[axis]))
    }

    pub(crate) fn depths(&self) -> usize {
        self.splines.len()
    }

    /// The image at a depth with the particle shifted to the middle pixel, at brightness 1; `None` where a
    /// pixel belongs to a neighbor.
    pub(crate) fn image(&self, depth: usize) -> Vec<Option<f32>> {
        let value = |v: f32| (v - self.offset) / self.brightness;
        self.samples(depth, self.shift).into_iter().map(|sample| sample.map(value)).collect()
    }

    fn samples(&self, depth: usize, shift: [f32; 2]) -> Vec<Option<f32>> {
        let (side, wide) = (2 * self.half + 1, 2 * (self.half + MARGIN) + 1);
        let sample = |i: usize| {
            let (x, y) = (i % side + MARGIN, i / side + MARGIN);
            // The pixels that count most for the interpolated value.
            let nearest =
                (y as f32 + shift[1]).round() as usize * wide + (x as f32 + shift[0]).round() as usize;
            self.own[depth][nearest].then(|| self.splines[depth].at(x as f32 + shift[0], y as f32 + shift[1]))
        };
        (0..side * side).map(sample).collect()
    }

    /// Fits position, brightness and background to a reference, whose depths in focus are listed; `noise`:
    /// variance of the background of an image, counts^2.
    pub(crate) fn fit(&mut self, reference: &[GrayImage], in_focus: &[usize], noise: f64) {
        for _ in 0..STEPS {
            // Unknowns: brightness, background, brightness times the focus, and the steps of the position.
            let (mut normal, mut right) = (Symmetric::zeros(5), [0.0; 5]);
            for (depth, image) in reference.iter().enumerate() {
                let [mut above, mut below] = [self.shift; 2].map(|shift| [shift; 2]);
                for axis in 0..2 {
                    above[axis][axis] += DIFFERENCE_PX;
                    below[axis][axis] -= DIFFERENCE_PX;
                }
                let here = self.samples(depth, self.shift);
                let around =
                    [0, 1].map(|axis| (self.samples(depth, above[axis]), self.samples(depth, below[axis])));
                for (i, value) in here.iter().enumerate() {
                    let Some(value) = value else { continue };
                    let slope = around.each_ref().map(|(right, left)| {
                        right[i]
                            .zip(left[i])
                            .map_or(0.0, |(right, left)| (right - left) / (2.0 * DIFFERENCE_PX))
                    });
                    let terms = [image.counts[i], 1.0, over_depth(reference, depth, i), slope[0], slope[1]];
                    let terms = terms.map(f64::from);
                    for (i, term) in terms.iter().enumerate() {
                        right[i] += term * f64::from(*value);
                        terms.iter().enumerate().for_each(|(j, other)| normal.add(i, j, term * other));
                    }
                }
            }
            let solution: Option<[f64; 5]> = normal.solve(&right).and_then(|all| all.try_into().ok());
            let Some([brightness, offset, focus, x, y]) = solution else { break };
            (self.brightness, self.offset) = ((brightness as f32).max(1e-6), offset as f32);
            self.focus = (focus as f32 / self.brightness).clamp(-MOST_STEPS, MOST_STEPS);
            for (shift, by) in self.shift.iter_mut().zip([x, y]) {
                *shift = (*shift - by as f32).clamp(-MOST_PX, MOST_PX);
            }
            if x.abs().max(y.abs()) < 1e-3 {
                break;
            }
        }
        self.unexplained = self.misfit(reference, in_focus, noise);
    }

    /// Share of the squared light, beyond the noise of the background, that the reference does not explain at
    /// these depths.
    fn misfit(&self, reference: &[GrayImage], depths: &[usize], noise: f64) -> f64 {
        let noise = noise / f64::from(self.brightness).powi(2);
        let (mut left, mut light) = (0.0, 0.0);
        for &depth in depths {
            for (i, (value, model)) in self.image(depth).into_iter().zip(&reference[depth].counts).enumerate()
            {
                let Some(value) = value else { continue };
                let model = model + self.focus * over_depth(reference, depth, i);
                left += f64::from(value - model).powi(2) - noise;
                light += f64::from(model).powi(2);
            }
        }
        left.max(0.0) / light.max(f64::MIN_POSITIVE)
    }
}

/// Change of a pixel of a stack from one depth to the next.
fn over_depth(stack: &[GrayImage], depth: usize, pixel: usize) -> f32 {
    let (low, high) = (depth.saturating_sub(1), (depth + 1).min(stack.len() - 1));
    (stack[high].counts[pixel] - stack[low].counts[pixel]) / (high - low) as f32
}

/// The depth with the highest peak.
pub(crate) fn sharpest(images: &[GrayImage]) -> usize {
    let peaks: Vec<f32> = images.iter().map(peak).collect();
    peaks.iter().enumerate().max_by(|a, b| a.1.total_cmp(b.1)).map_or(0, |(depth, _)| depth)
}

/// The largest mean of 3 x 3 px around the middle of an image.
pub(crate) fn peak(image: &GrayImage) -> f32 {
    let middle = image.width / 2;
    let room = CENTROID_PX.min(middle.saturating_sub(1));
    let mean = |x: usize, y: usize| {
        (y - 1..=y + 1)
            .flat_map(|v| (x - 1..=x + 1).map(move |u| (u, v)))
            .map(|(u, v)| image.counts[v * image.width + u])
            .sum::<f32>()
            / 9.0
    };
    let around = middle - room..=middle + room;
    around
        .clone()
        .flat_map(|y| around.clone().map(move |x| (x, y)))
        .map(|(x, y)| mean(x, y))
        .fold(f32::MIN, f32::max)
}

/// Centroid of the light around the middle above a fifth of its peak, px from the middle pixel.
fn centroid(image: &GrayImage) -> [f32; 2] {
    let middle = image.width / 2;
    let square = |m: usize| m - CENTROID_PX..=m + CENTROID_PX;
    let pixels = || square(middle).flat_map(|y| square(middle).map(move |x| (x, y)));
    let light = |(x, y): (usize, usize)| image.counts[y * image.width + x];
    let most = pixels().map(light).fold(0.0, f32::max);
    let (mut sum, mut sums) = (0.0f32, [0.0f32; 2]);
    for (x, y) in pixels() {
        let weight = (light((x, y)) - 0.2 * most).max(0.0);
        sum += weight;
        sums[0] += weight * (x as f32 - middle as f32);
        sums[1] += weight * (y as f32 - middle as f32);
    }
    if sum > 0.0 { sums.map(|s| (s / sum).clamp(-MOST_PX, MOST_PX)) } else { [0.0; 2] }
}
