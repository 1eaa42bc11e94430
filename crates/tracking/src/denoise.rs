//! Denoising of a calibration stack by a sliding discrete cosine transform with hard thresholding.
//!
//! Blocks of 8 x 8 px and 4 depths are transformed, coefficients below a threshold are set to zero, and the
//! overlapping estimates of each pixel are averaged (Yaroslavsky 1996; Guleryuz 2007, IEEE Trans. Image
//! Process. 16, 3020). The particle image is sparse in this basis, the noise is not. Counts are first
//! transformed to unit variance (generalized Anscombe transform; Starck, Murtagh & Bijaoui 1998).

use microsig_core::cancel::checkpoint;
use rayon::prelude::*;
use storage::dataset::DatasetPlace;

use super::gray_image::GrayImage;
use storage::dataset::manifest::RECORDING;
use storage::error::Result;

/// Side of a block, px, and its number of depths.
const SIDE: usize = 8;
const DEPTHS: usize = 4;

/// Threshold of the coefficients, in standard deviations of the noise.
const THRESHOLD: f32 = 2.8;

/// Number of voxels above which a larger block stride is used.
const MANY_VOXELS: usize = 4_000_000;

/// Number of slabs of depths held in memory.
const SLABS: usize = 8;

/// Variance of a pixel of the stack: `dark + gain * light`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct PixelNoise {
    /// Variance of the background, counts^2.
    pub(super) dark: f32,
    /// Variance per count of light.
    pub(super) gain: f32,
}

impl PixelNoise {
    /// Variance of rounding to integer counts.
    pub(super) const ROUNDING: f32 = 1.0 / 12.0;

    /// Number of rays or electrons above which counts are approximately normally distributed.
    const NORMAL_FROM: f32 = 4.0;

    /// Noise with lower limits on its variances, which apply where the background has no noise: the variance
    /// of rounding, and of light in steps of `gain` counts (rays, electrons) where few steps are
    /// expected, as if there were [`Self::NORMAL_FROM`]. Fewer steps are not distributed normally, and their
    /// expected number is uncertain: with its small variance, a single ray beside a particle would outweigh
    /// the particle image.
    pub(super) fn new(dark: f32, gain: f32) -> Self {
        PixelNoise { dark: dark.max(Self::ROUNDING).max(Self::NORMAL_FROM * gain * gain), gain }
    }

    pub(super) fn variance(&self, light: f32) -> f32 {
        self.dark + self.gain * light.max(0.0)
    }

    /// The noise of means over squares of `factor` x `factor` pixels.
    pub(super) fn binned(self, factor: usize) -> Self {
        let area = (factor * factor) as f32;
        PixelNoise { dark: self.dark / area, gain: self.gain / area }
    }

    /// Transforms light to a scale with unit noise variance.
    fn stabilized(&self, light: f32) -> f32 {
        if self.gain * 1e4 < self.dark.sqrt() {
            return light / self.dark.sqrt();
        }
        let t = self.dark + self.gain * light;
        // Linear extension to negative values, which are due to noise.
        let root = self.dark.sqrt();
        if light >= 0.0 { 2.0 / self.gain * (t.max(0.0).sqrt() - root) } else { light / root }
    }

    fn restored(&self, value: f32) -> f32 {
        let root = self.dark.sqrt();
        if self.gain * 1e4 < root || value < 0.0 {
            return value * root;
        }
        ((0.5 * self.gain * value + root).powi(2) - self.dark) / self.gain
    }
}

/// The denoised stack. `averaged` is the number of equivalent images averaged into each one.
pub(super) fn denoised(stack: &[GrayImage], noise: PixelNoise, averaged: f32) -> Vec<GrayImage> {
    let Some(first) = stack.first() else { return Vec::new() };
    let (width, height) = (first.width, first.height);
    if width < SIDE || height < SIDE || stack.len() < DEPTHS || noise.dark <= 0.0 {
        return stack.to_vec();
    }
    let stable: Vec<Vec<f32>> =
        stack.par_iter().map(|i| i.counts.iter().map(|c| noise.stabilized(*c)).collect()).collect();
    let stride = if stack.len() * width * height > MANY_VOXELS { 4 } else { 2 };
    let (columns, rows) = (starts(width, stride), starts(height, stride));
    let dct = (basis::<SIDE>(), basis::<DEPTHS>());
    let threshold = THRESHOLD / averaged.sqrt();
    // Each slab of depths has its own sums, which are added in order, so results do not depend on the number
    // of threads.
    let mut totals = vec![[0.0f32; 2]; stack.len() * width * height];
    let slab = |z: usize| {
        let mut sums = vec![[0.0f32; 2]; DEPTHS * width * height];
        for &y in &rows {
            checkpoint();
            for &x in &columns {
                let mut block = [0.0f32; SIDE * SIDE * DEPTHS];
                for (k, plane) in block.chunks_mut(SIDE * SIDE).enumerate() {
                    for (j, row) in plane.chunks_mut(SIDE).enumerate() {
                        row.copy_from_slice(&stable[z + k][(y + j) * width + x..][..SIDE]);
                    }
                }
                let weight = threshold_block(&mut block, &dct, threshold);
                for (i, value) in block.into_iter().enumerate() {
                    let (k, j, i) = (i / (SIDE * SIDE), i / SIDE % SIDE, i % SIDE);
                    let sum = &mut sums[(k * height + y + j) * width + x + i];
                    sum[0] += weight * value;
                    sum[1] += weight;
                }
            }
        }
        sums
    };
    let firsts: Vec<usize> = (0..=stack.len() - DEPTHS).collect();
    for some in firsts.chunks(SLABS) {
        let sums: Vec<_> = some.par_iter().map(|&z| slab(z)).collect();
        for (z, sums) in some.iter().zip(sums) {
            for (total, sum) in totals[z * width * height..].iter_mut().zip(sums) {
                total[0] += sum[0];
                total[1] += sum[1];
            }
        }
    }
    let image = |totals: &[[f32; 2]]| {
        let counts = totals.iter().map(|[sum, weight]| noise.restored(sum / weight)).collect();
        GrayImage { width, height, counts }
    };
    totals.chunks(width * height).map(image).collect()
}

/// First pixels of the blocks along an axis: the last block ends at the edge.
fn starts(length: usize, stride: usize) -> Vec<usize> {
    let last = length - SIDE;
    (0..last).step_by(stride).chain([last]).collect()
}

/// Sets small coefficients of a block to zero; returns the weight of the estimate, the inverse of the number
/// of remaining coefficients.
fn threshold_block(
    block: &mut [f32; SIDE * SIDE * DEPTHS],
    (side, depths): &([[f32; SIDE]; SIDE], [[f32; DEPTHS]; DEPTHS]),
    threshold: f32,
) -> f32 {
    let strides = [(1, SIDE), (SIDE, SIDE)];
    for (stride, _) in strides {
        along::<SIDE>(block, side, stride, false);
    }
    along::<DEPTHS>(block, depths, SIDE * SIDE, false);
    let mut left = 1;
    for value in block.iter_mut().skip(1) {
        if value.abs() < threshold {
            *value = 0.0;
        } else {
            left += 1;
        }
    }
    along::<DEPTHS>(block, depths, SIDE * SIDE, true);
    for (stride, _) in strides {
        along::<SIDE>(block, side, stride, true);
    }
    1.0 / left as f32
}

/// Transforms all lines of N values spaced by `stride`, forward or backward.
fn along<const N: usize>(block: &mut [f32], basis: &[[f32; N]; N], stride: usize, back: bool) {
    for start in (0..block.len()).filter(|i| (i / stride).is_multiple_of(N)) {
        let line: [f32; N] = std::array::from_fn(|i| block[start + i * stride]);
        for k in 0..N {
            block[start + k * stride] =
                (0..N).map(|i| line[i] * if back { basis[i][k] } else { basis[k][i] }).sum();
        }
    }
}

/// The orthonormal basis of the type-II cosine transform: row k is the k-th basis vector.
fn basis<const N: usize>() -> [[f32; N]; N] {
    let n = N as f64;
    std::array::from_fn(|k| {
        let scale = (if k == 0 { 1.0 / n } else { 2.0 / n }).sqrt();
        std::array::from_fn(|i| {
            (scale * (std::f64::consts::PI * (i as f64 + 0.5) * k as f64 / n).cos()) as f32
        })
    })
}

/// Noise of the frames of a recording, from its manifest: the stacks of a recording are averages, whose noise
/// tells nothing about a frame's.
#[derive(Debug, Clone, Copy)]
pub(super) struct RecordedNoise {
    /// Noise of a frame; `None` for the light if the scan did not show it.
    frame: [Option<f64>; 2],
    /// Number of images of which a calibration image is the average, at least.
    averaged: f64,
}

impl RecordedNoise {
    /// The noise of a recording; `None` of a generated dataset.
    pub(super) fn read(dataset: &DatasetPlace) -> Result<Option<Self>> {
        let manifest = dataset.manifest()?;
        let facts = &manifest.microsig;
        let Some(noise) = facts.noise.as_ref().filter(|_| facts.kind.as_deref() == Some(RECORDING)) else {
            return Ok(None);
        };
        let particles =
            facts.calibration_places.iter().filter_map(|place| place.particles).min().unwrap_or(1);
        let term = |k: usize| noise.variance.get(k).copied().filter(|v| v.is_finite() && *v >= 0.0);
        let averaged = f64::from(particles.max(1)) * f64::from(noise.repeats.max(1));
        Ok(Some(RecordedNoise { frame: [term(0), term(1)], averaged }))
    }

    /// Noise of a frame; `stack`: noise of the calibration images.
    pub(super) fn frame_noise(self, stack: PixelNoise) -> PixelNoise {
        let of =
            |term: Option<f64>, stack: f32| term.map_or(stack * self.averaged as f32, |term| term as f32);
        PixelNoise::new(of(self.frame[0], stack.dark), of(self.frame[1], stack.gain))
    }

    /// Noise of a calibration image, if a frame's is known.
    pub(super) fn stack_noise(self) -> Option<PixelNoise> {
        let [dark, gain] = self.frame;
        let averaged = |term: f64| (term / self.averaged) as f32;
        dark.zip(gain).map(|(dark, gain)| PixelNoise::new(averaged(dark), averaged(gain)))
    }
}

#[cfg(test)]
mod tests {
    use super::super::gray_image::normal;
    use super::*;

    /// A growing ring in known noise: the noise is reduced, the ring is preserved.
    #[test]
    fn most_noise_goes_and_the_ring_stays() {
        let clean = |z: usize| {
            GrayImage::from_fn((48, 48), |x, y| {
                let r = (x as f32 - 20.0).hypot(y as f32 - 25.0);
                400.0 * (-0.5 * ((r - 5.0 - 0.8 * z as f32) / 1.5).powi(2)).exp()
            })
        };
        let noise = PixelNoise { dark: 100.0, gain: 2.0 };
        let error = |images: &[GrayImage]| -> f32 {
            let squares = images.iter().enumerate().flat_map(|(z, image)| {
                let truth = clean(z);
                image.counts.iter().zip(truth.counts).map(|(a, b)| (a - b).powi(2)).collect::<Vec<_>>()
            });
            let all: Vec<f32> = squares.collect();
            all.iter().sum::<f32>() / all.len() as f32
        };
        let noisy: Vec<GrayImage> = (0..12)
            .map(|z| {
                let mut image = clean(z);
                for (i, count) in image.counts.iter_mut().enumerate() {
                    *count += noise.variance(*count).sqrt() * normal(z * 48 * 48 + i);
                }
                image
            })
            .collect();
        let (before, after) = (error(&noisy), error(&denoised(&noisy, noise, 1.0)));
        assert!(after < before / 5.0, "mean squared error {before} before, {after} after");
    }

    #[test]
    fn without_noise_the_stack_is_unchanged() {
        let stack: Vec<GrayImage> =
            (0..5).map(|z| GrayImage::from_fn((16, 16), |x, y| (x * y + z) as f32)).collect();
        assert_eq!(denoised(&stack, PixelNoise { dark: 0.0, gain: 0.0 }, 1.0), stack);
    }
}
