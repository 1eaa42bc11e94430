//! Visibility of each particle of a frame: peak, signal-to-noise ratio, overlap, saturation.
//!
//! Computed from noise-free light. The overlap of a particle is sum min(own, others) / sum own over the
//! pixels of its image, where others is the summed light of all other particles: the intersection of two
//! light distributions (Swain & Ballard, Int. J. Comput. Vis. 7 (1991) 11). It is 0 for an isolated particle
//! and 1 if the others are brighter in every pixel; if a bright particle overlaps a faint one, the overlap is
//! small for the bright and large for the faint particle.

use std::ops::Range;

use crate::Particle;
use crate::sensor::Sensor;
use rayon::prelude::*;

use super::depth_scan::AREA_SHARE;
use super::noise_free::{NoiseFree, Patch};
use super::outline::Outline;

/// Visibility of a particle.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Visibility {
    /// Maximum of its own noise-free image above the background, counts; 0 if no light reaches the sensor.
    pub peak_counts: f64,
    /// `peak_counts` over the standard deviation of the background at that pixel; infinite without noise.
    pub snr: f64,
    /// Fraction of its light that is overlapped by other particles, 0 to 1.
    pub overlap: f64,
    /// Whether a pixel of its image (above 10 % of its peak) is saturated, including the light of other
    /// particles.
    pub saturated: bool,
}

/// Visibility and outline of a tracer's image in a frame.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct TracerImage {
    /// Its visibility.
    pub visibility: Visibility,
    /// Its outline, if requested and if it has one.
    pub outline: Option<Outline>,
}

/// Pixels of patches that are in memory at a time.
const PIXELS: usize = 8_000_000;

/// The visibility of every tracer of a frame. A tracer is a range of `particles`: empty if it is not
/// rendered, several for a streak. If `share` is given, outlines are found; it is the fraction of the peak at
/// which they end. `total` is a scratch buffer.
pub fn visibility(
    noise_free: &NoiseFree,
    sensor: &Sensor,
    (width, height): (u32, u32),
    particles: &[Particle],
    tracers: &[Range<usize>],
    share: Option<f64>,
    total: &mut Vec<f64>,
) -> Vec<TracerImage> {
    let (width, height) = (width as usize, height as usize);
    noise_free.prepare(&[particles]);
    let draw = |tracers: &[Range<usize>]| -> Vec<Patch> {
        let tracers = tracers.par_iter().with_min_len(TRACERS_PER_TASK);
        tracers.map(|rows| noise_free.draw_all(&particles[rows.clone()])).collect()
    };
    let batches = batches(noise_free, particles, tracers);
    let mut kept = None;
    total.clear();
    total.resize(width * height, 0.0);
    for batch in &batches {
        let patches = draw(&tracers[batch.clone()]);
        patches.iter().for_each(|patch| patch.add_to(total, width));
        // If there are several batches, patches are drawn again: they are too large to be stored.
        kept = (batches.len() == 1).then_some(patches);
    }
    let total = total.as_slice();
    let see = |patches: Vec<Patch>| -> Vec<TracerImage> {
        let patches = patches.par_iter().with_min_len(TRACERS_PER_TASK);
        let seen = patches.map(|patch| TracerImage {
            visibility: Visibility::of(patch, total, width, sensor),
            outline: share.and_then(|share| Outline::of(patch, share, total, (width, height), sensor)),
        });
        seen.collect()
    };
    match kept {
        Some(patches) => see(patches),
        None => batches.iter().flat_map(|batch| see(draw(&tracers[batch.clone()]))).collect(),
    }
}

/// Consecutive tracers whose patches have up to [`PIXELS`] pixels, or a single tracer.
fn batches(noise_free: &NoiseFree, particles: &[Particle], tracers: &[Range<usize>]) -> Vec<Range<usize>> {
    let (mut batches, mut pixels): (Vec<Range<usize>>, usize) = (Vec::new(), 0);
    for (k, rows) in tracers.iter().enumerate() {
        let own: usize = particles[rows.clone()].iter().map(|particle| noise_free.pixels(particle)).sum();
        match batches.last_mut().filter(|_| pixels + own <= PIXELS) {
            Some(batch) => (batch.end, pixels) = (k + 1, pixels + own),
            None => {
                batches.push(k..k + 1);
                pixels = own;
            }
        }
    }
    batches
}

/// Minimum number of tracers per parallel task.
const TRACERS_PER_TASK: usize = 16;

impl Patch {
    /// For each row: index of its first pixel in an image of this width, and its light.
    fn rows(&self, width: usize) -> impl Iterator<Item = (usize, &[f64])> {
        let first = self.corner.1 * width + self.corner.0;
        self.values
            .chunks(self.width.max(1))
            .enumerate()
            .map(move |(row, light)| (first + row * width, light))
    }

    fn add_to(&self, image: &mut [f64], width: usize) {
        for (first, light) in self.rows(width) {
            image[first..][..light.len()].iter_mut().zip(light).for_each(|(sum, l)| *sum += l);
        }
    }
}

impl Visibility {
    fn of(patch: &Patch, total: &[f64], width: usize, sensor: &Sensor) -> Self {
        let mut sums = Sums::default();
        for (first, light) in patch.rows(width) {
            sums.add_row(light, &total[first..][..light.len()]);
        }
        let [peak, brightest] = [sums.peak, sums.brightest].map(|of| of.into_iter().fold(0.0, f64::max));
        let [own, shared] = [sums.own, sums.shared].map(|of| of.iter().sum::<f64>());
        if own == 0.0 {
            return Visibility::default();
        }
        let at =
            patch.rows(width).find_map(|(first, light)| Some(first + light.iter().position(|l| *l == peak)?));
        let saturated = sensor.may_reach(sensor.saturation_counts(), brightest)
            && patch.rows(width).any(|(first, light)| {
                light.iter().enumerate().any(|(i, l)| {
                    let response = sensor.response(first + i);
                    let counts = response.background + response.slope * total[first + i];
                    *l > AREA_SHARE * peak && counts >= response.saturation_counts
                })
            });
        let response = sensor.response(at.unwrap_or_default());
        let peak_counts = response.slope * peak;
        Visibility {
            peak_counts,
            snr: peak_counts / response.background_noise,
            overlap: shared / own,
            saturated,
        }
    }
}

/// Sums over the pixels of a patch, in `LANES` partial sums for vectorization.
#[derive(Default)]
struct Sums {
    /// The patch's own light, and the part overlapped by others.
    own: [f64; LANES],
    shared: [f64; LANES],
    /// Maximum own light, and maximum total light.
    peak: [f64; LANES],
    brightest: [f64; LANES],
}

const LANES: usize = 8;

impl Sums {
    /// Adds a row of the patch; `total` is the total light on the same pixels.
    fn add_row(&mut self, light: &[f64], total: &[f64]) {
        let ((light, light_end), (total, total_end)) = (light.as_chunks(), total.as_chunks());
        light.iter().zip(total).for_each(|(light, total)| self.add(*light, *total));
        let filled = |end: &[f64]| {
            let mut lanes = [0.0; LANES];
            lanes[..end.len()].copy_from_slice(end);
            lanes
        };
        self.add(filled(light_end), filled(total_end));
    }

    fn add(&mut self, light: [f64; LANES], total: [f64; LANES]) {
        for (i, (l, t)) in light.into_iter().zip(total).enumerate() {
            let less = |a: f64, b: f64| if a < b { a } else { b };
            let more = |a: f64, b: f64| if a > b { a } else { b };
            self.own[i] += l;
            // Rounding can make the difference negative if there are no others.
            self.shared[i] += less(l, more(t - l, 0.0));
            self.peak[i] = more(l, self.peak[i]);
            self.brightest[i] = more(t, self.brightest[i]);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Settings;

    const WIDTH: usize = 8;

    fn patch(corner: (usize, usize), values: &[f64]) -> Patch {
        Patch { corner, width: 2, values: values.to_vec() }
    }

    fn seen(patches: &[Patch]) -> Vec<Visibility> {
        let sensor = Sensor::new(&Settings { gain: 100.0, background_noise: 4.0, ..Settings::setting1() });
        let mut total = vec![0.0; WIDTH * WIDTH];
        patches.iter().for_each(|p| p.add_to(&mut total, WIDTH));
        patches.iter().map(|p| Visibility::of(p, &total, WIDTH, &sensor)).collect()
    }

    #[test]
    fn overlap_is_the_share_that_others_match() {
        let alone = patch((1, 1), &[1.0, 3.0, 2.0, 2.0]);
        assert_eq!(
            seen(std::slice::from_ref(&alone)),
            [Visibility { peak_counts: 300.0, snr: 75.0, overlap: 0.0, saturated: false }]
        );
        let overlaps = |patches: &[Patch]| -> Vec<f64> { seen(patches).iter().map(|s| s.overlap).collect() };
        assert_eq!(overlaps(&[alone.clone(), alone.clone()]), [1.0, 1.0]);
        // The second particle has a quarter of the light of the first: overlap 1 for the faint, 0.25 for the
        // bright one.
        let faint = patch((1, 1), &[0.25, 0.75, 0.5, 0.5]);
        assert_eq!(overlaps(&[alone.clone(), faint]), [0.25, 1.0]);
        // One common pixel, (2, 2), with light 2 and 1.
        assert_eq!(overlaps(&[alone.clone(), patch((2, 2), &[1.0, 0.0, 0.0, 0.0])]), [1.0 / 8.0, 1.0]);
        assert_eq!(overlaps(&[alone, Patch::default()]), [0.0, 0.0]);
    }

    #[test]
    fn saturation_counts_the_light_of_all() {
        let bright = patch((1, 1), &[300.0, 500.0, 1.0, 1.0]);
        assert!(!seen(std::slice::from_ref(&bright))[0].saturated);
        // 300 + 400 rays of 100 counts exceed 65,535 at the peak of the second particle.
        let both = seen(&[bright.clone(), patch((1, 1), &[400.0, 0.0, 0.0, 0.0])]);
        assert!(both[0].saturated && both[1].saturated);
        // Not saturated where the first particle has almost no light.
        let beside = seen(&[bright, patch((1, 2), &[700.0, 0.0, 0.0, 0.0])]);
        assert!(!beside[0].saturated && beside[1].saturated);
    }

    #[test]
    fn rows_of_a_streak_are_one_image() {
        let (a, b) = (patch((1, 1), &[1.0, 2.0, 3.0, 4.0]), patch((2, 0), &[5.0, 6.0, 7.0, 8.0]));
        let both = Patch::default().joined(a.clone()).joined(b);
        assert_eq!((both.corner, both.width), ((1, 0), 3));
        assert_eq!(both.values, [0.0, 5.0, 6.0, 1.0, 9.0, 8.0, 3.0, 4.0, 0.0]);
        assert_eq!(a.joined(Patch::default()).values, [1.0, 2.0, 3.0, 4.0]);
    }
}
