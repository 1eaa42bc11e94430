//! Preparation of templates from a calibration stack: centering, averaging over symmetries, denoising.
//!
//! The image of a sphere on the optical axis is invariant under rotation by 180 degrees. With a spherical
//! lens, or a cylindrical lens aligned with the pixel axes, it is also mirror symmetric, and with a spherical
//! lens also symmetric about the diagonals. The symmetry is determined from the stack itself. Differences
//! between equivalent pixels are noise: background noise, and a part that grows with the light. Off the axis of a
//! real objective, coma, vignetting and the chief ray make images that have none of these symmetries.

use rayon::prelude::*;

use super::calibration::CalibrationImage;
use super::denoise::{PixelNoise, denoised};
use super::gray_image::{GrayImage, Spline};

/// A symmetry is accepted if its squared differences exceed the ones for a rotation by 180 degrees by at most
/// this fraction of the latter, ...
const AS_SYMMETRIC: f64 = 0.25;

/// ... and by at most this fraction of the squared light, beyond this many standard deviations of the noise:
/// most pixels of a large image are dark, and their noise can hide an asymmetry of the light.
const OF_LIGHT: f64 = 0.1;
const BEYOND_NOISE: f64 = 3.0;

/// The prepared stack.
#[derive(Debug)]
pub(super) struct Stack {
    /// Increasing depths, um.
    pub(super) depths_um: Vec<f64>,
    /// Light above the background, on squares of odd side with the particle on the central pixel.
    pub(super) images: Vec<GrayImage>,
    /// Noise of a single image.
    pub(super) noise: PixelNoise,
}

/// Symmetry of the particle image.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Symmetry {
    /// None.
    None,
    /// A rotation by 180 degrees.
    Rotation,
    /// Also reflections about both axes.
    Mirrors,
    /// Also reflections about the diagonals.
    Octants,
}

impl Stack {
    /// The stack of a sphere on the optical axis.
    pub(super) fn new(steps: &[CalibrationImage]) -> Self {
        Stack::prepared(steps, false, None)
    }

    /// The stack of a sphere at any place of the field of view, with the noise of its images if it is known.
    pub(super) fn off_axis(steps: &[CalibrationImage], known: Option<PixelNoise>) -> Self {
        Stack::prepared(steps, true, known)
    }

    fn prepared(steps: &[CalibrationImage], off_axis: bool, known: Option<PixelNoise>) -> Self {
        let level = background(steps);
        let room = common_room(steps);
        let centered: Vec<GrayImage> = steps.iter().map(|step| centered(step, room, level)).collect();
        let is_lopsided = off_axis && is_lopsided(&centered);
        let noise = match known {
            Some(known) => known,
            None if is_lopsided => noise(&over_depth(&centered)),
            None => noise(&rotated(&centered)),
        };
        let symmetry = if is_lopsided { Symmetry::None } else { Symmetry::of(&centered) };
        let averaged: Vec<GrayImage> = centered.iter().map(|image| symmetry.averaged(image)).collect();
        // One part of a symmetric image suffices; some pixels beyond the axes are kept for blocks that cross
        // them.
        let side = 2 * room + 1;
        let part = (
            room + 1 + BEYOND_AXIS.min(room),
            if symmetry == Symmetry::Rotation { side } else { room + 1 + BEYOND_AXIS.min(room) },
        );
        let part = if symmetry == Symmetry::None { (side, side) } else { part };
        let cut = |image: &GrayImage| GrayImage::from_fn(part, |x, y| image.counts[y * side + x]);
        let parts: Vec<GrayImage> = averaged.iter().map(cut).collect();
        let images = denoised(&parts, noise, symmetry.order())
            .iter()
            .map(|part| {
                let whole = GrayImage::from_fn((side, side), |x, y| {
                    let (x, y) = symmetry.representative(x, y, side - 1);
                    part.counts[y * part.width + x]
                });
                symmetry.averaged(&whole)
            })
            .collect();
        Stack { depths_um: steps.iter().map(|s| s.z_um).collect(), images, noise }
    }
}

/// The stack with the highest peak, whose light determines the noise best; there is at least one.
pub(super) fn brightest(stacks: &[Stack]) -> &Stack {
    let peak =
        |stack: &Stack| stack.images.iter().flat_map(|image| &image.counts).fold(0.0f32, |a, b| a.max(*b));
    let (mut best, mut highest) = (&stacks[0], peak(&stacks[0]));
    for stack in &stacks[1..] {
        if peak(stack) > highest {
            (best, highest) = (stack, peak(stack));
        }
    }
    best
}

/// Number of pixels beyond an axis of symmetry that are included in denoising.
const BEYOND_AXIS: usize = 8;

impl Symmetry {
    fn of(stack: &[GrayImage]) -> Self {
        let difference = |map: fn(usize, usize, usize) -> (usize, usize)| -> f64 {
            stack
                .iter()
                .map(|image| {
                    let (w, last) = (image.width, image.width - 1);
                    let square = |i: usize| {
                        let (u, v) = map(i % w, i / w, last);
                        f64::from(image.counts[i] - image.counts[v * w + u]).powi(2)
                    };
                    (0..image.counts.len()).map(square).sum::<f64>()
                })
                .sum()
        };
        let pixels: f64 = stack.iter().map(|image| image.counts.len() as f64).sum();
        let rotated =
            difference(|x, y, last| (last - x, last - y)) + 2.0 * f64::from(PixelNoise::ROUNDING) * pixels;
        let squares: f64 = stack.iter().flat_map(|image| &image.counts).map(|c| f64::from(*c).powi(2)).sum();
        // Squared differences of equivalent pixels are twice the variance of their noise, and each pair is
        // counted twice.
        let light = (squares - 0.5 * rotated).max(0.0);
        let chance = 2.0 * (2.0 / pixels).sqrt() * rotated;
        let limit = rotated + (AS_SYMMETRIC * rotated).min(OF_LIGHT * light + BEYOND_NOISE * chance);
        if difference(|x, y, last| (last - x, y)) > limit {
            Symmetry::Rotation
        } else if difference(|x, y, _| (y, x)) > limit {
            Symmetry::Mirrors
        } else {
            Symmetry::Octants
        }
    }

    /// Number of equivalent pixels.
    fn order(self) -> f32 {
        match self {
            Symmetry::None => 1.0,
            Symmetry::Rotation => 2.0,
            Symmetry::Mirrors => 4.0,
            Symmetry::Octants => 8.0,
        }
    }

    /// The representative of equivalent pixels, in the half or quadrant with small x and y.
    fn representative(self, x: usize, y: usize, last: usize) -> (usize, usize) {
        let half = last / 2;
        match self {
            Symmetry::None => (x, y),
            Symmetry::Rotation if x > half => (last - x, last - y),
            Symmetry::Rotation => (x, y),
            Symmetry::Mirrors | Symmetry::Octants => (x.min(last - x), y.min(last - y)),
        }
    }

    /// The mean over all symmetry operations.
    fn averaged(self, image: &GrayImage) -> GrayImage {
        let (w, last) = (image.width, image.width - 1);
        let at = |x: usize, y: usize| image.counts[y * w + x];
        let pair = |x: usize, y: usize| 0.5 * (at(x, y) + at(last - x, last - y));
        let four = |x: usize, y: usize| 0.5 * (pair(x, y) + pair(last - x, y));
        GrayImage::from_fn((w, w), |x, y| match self {
            Symmetry::None => at(x, y),
            Symmetry::Rotation => pair(x, y),
            Symmetry::Mirrors => four(x, y),
            Symmetry::Octants => 0.5 * (four(x, y) + four(y, x)),
        })
    }
}

/// Background level: the mean near the edges of those images whose particle does not reach them. Strongly
/// defocused images fill their frame and are brighter at the edges.
fn background(steps: &[CalibrationImage]) -> f32 {
    /// The edge is this fraction of the width: 1 / `EDGE`.
    const EDGE: usize = 8;
    /// Tolerance above the darkest image, in standard errors of the mean.
    const SAME: f64 = 3.0;
    let edges: Vec<[f64; 2]> = steps.iter().map(|step| edge(&step.image, EDGE)).collect();
    let darkest = edges.iter().fold([f64::INFINITY, 0.0], |a, b| if b[0] < a[0] { *b } else { a });
    let dark: Vec<f64> =
        edges.iter().map(|e| e[0]).filter(|mean| *mean <= darkest[0] + SAME * darkest[1]).collect();
    (dark.iter().sum::<f64>() / dark.len() as f64) as f32
}

/// Mean count near the edges of an image, and its standard error.
fn edge(image: &GrayImage, part: usize) -> [f64; 2] {
    let (w, h) = (image.width, image.height);
    let (dx, dy) = (w.div_ceil(part), h.div_ceil(part));
    let is_edge = |i: usize| {
        let (x, y) = (i % w, i / w);
        x < dx || y < dy || x + dx >= w || y + dy >= h
    };
    let (mut n, mut sum, mut squares) = (0.0, 0.0, 0.0);
    for i in (0..w * h).filter(|&i| is_edge(i)) {
        let count = f64::from(image.counts[i]);
        (n, sum, squares) = (n + 1.0, sum + count, squares + count * count);
    }
    let mean = sum / n;
    [mean, ((squares / n - mean * mean).max(0.0) / n).sqrt()]
}

/// Half width of the largest square around the particle that lies inside all images, px.
fn common_room(steps: &[CalibrationImage]) -> usize {
    let room = |center: f64, size: usize| (center.round() as usize).min(size - 1 - center.round() as usize);
    let rooms = steps.iter().map(|s| room(s.at[0], s.image.width).min(room(s.at[1], s.image.height)));
    rooms.min().unwrap_or(0)
}

/// The background-subtracted square of this half width around the particle, shifted by interpolation so that
/// the particle is centered on a pixel.
fn centered(step: &CalibrationImage, room: usize, level: f32) -> GrayImage {
    let [cx, cy] = step.at.map(|c| c.round() as usize);
    let (left, top) = (cx - room, cy - room);
    let offset = [step.at[0] - cx as f64, step.at[1] - cy as f64].map(|o| o as f32);
    let size = (2 * room + 1, 2 * room + 1);
    if offset == [0.0; 2] {
        return GrayImage::from_fn(size, |x, y| {
            step.image.counts[(top + y) * step.image.width + left + x] - level
        });
    }
    let spline = Spline::new(&step.image);
    GrayImage::from_fn(size, |x, y| {
        spline.at((left + x) as f32 + offset[0], (top + y) as f32 + offset[1]) - level
    })
}

/// Light of a pixel, and the square of a difference whose mean is the variance of the noise there.
type Differences = Vec<Vec<[f64; 2]>>;

/// Differences between each image and the image rotated by 180 degrees.
fn rotated(stack: &[GrayImage]) -> Differences {
    // Of a pair of pixels, the sum and the difference are independent.
    let pairs = |image: &GrayImage| -> Vec<[f64; 2]> {
        let smooth = image.smoothed(1.0).counts;
        let n = image.counts.len();
        let pair = |i: usize| {
            let j = n - 1 - i;
            let light = 0.5 * (smooth[i] + smooth[j]);
            [f64::from(light), f64::from(0.5 * (image.counts[i] - image.counts[j]).powi(2))]
        };
        (0..n / 2).map(pair).collect()
    };
    stack.par_iter().map(pairs).collect()
}

/// Differences between each image and the mean of those at the depths before and after; where images change
/// fast, at the focus, they are more than noise.
fn over_depth(stack: &[GrayImage]) -> Differences {
    let pixels = |three: &[GrayImage]| -> Vec<[f64; 2]> {
        let [before, image, after] = three else { return Vec::new() };
        let smooth = image.smoothed(1.0).counts;
        let pixel = |i: usize| {
            let difference = image.counts[i] - 0.5 * (before.counts[i] + after.counts[i]);
            [f64::from(smooth[i]), f64::from(difference.powi(2)) / 1.5]
        };
        (0..image.counts.len()).map(pixel).collect()
    };
    stack.par_windows(3).map(pixels).collect()
}

/// Whether images are not the same after a rotation by 180 degrees: at most depths, their squared differences
/// exceed those over depth, which are noise and more, by a share of the squared light.
fn is_lopsided(stack: &[GrayImage]) -> bool {
    /// By this factor, and by this share.
    const MORE: f64 = 1.5;
    const OF_LIGHT: f64 = 2e-3;
    let sums = |of: Differences| -> Vec<f64> {
        of.iter().map(|image| image.iter().map(|pixel| pixel[1]).sum::<f64>() / image.len() as f64).collect()
    };
    if stack.len() < 3 {
        return false;
    }
    let (turned, noise) = (sums(rotated(stack)), sums(over_depth(stack)));
    let inner = &stack[1..stack.len() - 1];
    let light = inner.iter().map(|image| {
        image.counts.iter().map(|c| f64::from(*c).powi(2)).sum::<f64>() / image.counts.len() as f64
    });
    let lopsided =
        turned[1..].iter().zip(&noise).zip(light).filter(|((turned, noise), light)| {
            **turned > MORE * **noise && *turned - *noise > OF_LIGHT * light
        });
    2 * lopsided.count() > inner.len()
}

/// Noise estimate: a straight-line fit of squared differences against the light, weighted by the variance of
/// these squares from the previous estimate.
fn noise(pairs: &Differences) -> PixelNoise {
    /// Number of estimates; the first assumes equal variances.
    const ESTIMATES: usize = 4;
    let mut noise = PixelNoise { dark: 1.0, gain: 0.0 };
    for _ in 0..ESTIMATES {
        // Sums of weights, of light, squared light, squares, and light times squares.
        let mut sums = [0.0; 5];
        for [light, square] in pairs.iter().flatten() {
            let weight = f64::from(noise.variance(*light as f32)).powi(-2);
            let terms = [1.0, *light, light * light, *square, light * square];
            sums.iter_mut().zip(terms).for_each(|(sum, term)| *sum += weight * term);
        }
        let [n, x, xx, y, xy] = sums;
        let spread = n * xx - x * x;
        let gain = if spread > 1e-9 * n * xx { ((n * xy - x * y) / spread).max(0.0) } else { 0.0 };
        noise = PixelNoise::new(((y - gain * x) / n) as f32, gain as f32);
    }
    noise
}

#[cfg(test)]
mod tests {
    use super::super::gray_image::normal;
    use super::*;

    /// Most of these pixels are noise, which has every symmetry.
    #[test]
    fn noise_does_not_hide_that_images_are_not_round() {
        let side = 301;
        let spot = |[wide, high]: [f32; 2], seed: usize| {
            GrayImage::from_fn((side, side), |x, y| {
                let [dx, dy] = [x, y].map(|c| c as f32 - (side / 2) as f32);
                let noise = 29.0 * normal((seed * side + y) * side + x);
                300.0 * (-0.5 * ((dx / wide).powi(2) + (dy / high).powi(2))).exp() + noise
            })
        };
        let stack = |widths: [f32; 2]| (0..20).map(|k| spot(widths, k)).collect::<Vec<_>>();
        assert_eq!(Symmetry::of(&stack([12.0, 3.0])), Symmetry::Mirrors);
        assert_eq!(Symmetry::of(&stack([6.0, 6.0])), Symmetry::Octants);
    }

    /// Faint images on many pixels whose noise is only known to integer counts.
    #[test]
    fn noise_that_grows_with_light_is_told_from_that_of_the_background() {
        let side = 301;
        let truth = PixelNoise { dark: 33.4 * 33.4, gain: 2.1 };
        let mut stack: Vec<GrayImage> = Vec::new();
        for k in 0..10 {
            stack.push(GrayImage::from_fn((side, side), |x, y| {
                let r = (x as f32 - 150.0).hypot(y as f32 - 150.0);
                let light = 300.0 * (-0.5 * (r / 9.0).powi(2)).exp();
                (light + truth.variance(light).sqrt() * normal((k * side + y) * side + x)).round()
            }));
        }
        let found = noise(&rotated(&stack));
        assert!((found.dark / truth.dark - 1.0).abs() < 0.01, "{found:?}");
        assert!((found.gain / truth.gain - 1.0).abs() < 0.3, "{found:?}");
    }
}
