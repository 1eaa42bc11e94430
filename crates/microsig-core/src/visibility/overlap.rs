//! Visibility of each particle of a frame: peak, signal-to-noise ratio, overlap, saturation.
//!
//! Computed from noise-free light. The overlap of a particle is sum min(own, others) / sum own over the
//! pixels of its image, where others is the summed light of all other particles: the intersection of two
//! light distributions (Swain & Ballard, Int. J. Comput. Vis. 7 (1991) 11). It is 0 for an isolated particle
//! and 1 if the others are brighter in every pixel; if a bright particle overlaps a faint one, the overlap is
//! small for the bright and large for the faint particle.

use std::ops::Range;

use crate::Particle;
use crate::render::Window;
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

/// Pixels of patches that are in memory at a time, and pixels of a band.
const PIXELS: usize = 1 << 23;

/// The visibility of every tracer of a frame. A tracer is a range of `particles`: empty if it is not
/// rendered, several for a streak. If `share` is given, outlines are found; it is the fraction of the peak at
/// which they end. `buffer` is a scratch buffer.
///
/// A large frame is processed in bands of rows, each with the tracers whose images begin in it.
pub fn visibility(
    noise_free: &NoiseFree,
    sensor: &Sensor,
    (width, height): (u32, u32),
    particles: &[Particle],
    tracers: &[Range<usize>],
    share: Option<f64>,
    buffer: &mut Vec<f64>,
) -> Vec<TracerImage> {
    noise_free.prepare(&[particles]);
    let windows = tracers.par_iter().with_min_len(TRACERS_PER_TASK);
    let windows = windows.map(|rows| noise_free.window(&particles[rows.clone()])).collect();
    let size = (width as usize, height as usize);
    let tracers = Tracers { noise_free, particles, tracers, windows };
    // The whole frame at once if, exceptionally, an image of rays is larger than expected.
    let rows = [(PIXELS / size.0).clamp(1, size.1), size.1];
    rows.into_iter().find_map(|rows| tracers.seen(rows, size, sensor, share, buffer)).unwrap_or_default()
}

/// The tracers of a frame.
struct Tracers<'a> {
    noise_free: &'a NoiseFree,
    particles: &'a [Particle],
    /// The particles of each tracer, and the pixels on which they are drawn.
    tracers: &'a [Range<usize>],
    windows: Vec<Window>,
}

impl Tracers<'_> {
    fn draw(&self, tracers: &[usize]) -> Vec<Patch> {
        let tracers = tracers.par_iter().with_min_len(TRACERS_PER_TASK);
        tracers.map(|&k| self.noise_free.draw_all(&self.particles[self.tracers[k].clone()])).collect()
    }

    /// Their visibility, in bands of this many rows; `None` if a patch extends beyond its window and there
    /// are several bands.
    fn seen(
        &self,
        rows: usize,
        size: (usize, usize),
        sensor: &Sensor,
        share: Option<f64>,
        buffer: &mut Vec<f64>,
    ) -> Option<Vec<TracerImage>> {
        let windows = &self.windows;
        let lit: Vec<usize> = (0..windows.len()).filter(|&k| windows[k].area() > 0).collect();
        let mut seen = vec![TracerImage::default(); windows.len()];
        for top in (0..size.1).step_by(rows) {
            let is_own = |k: &usize| (top..top + rows).contains(&windows[*k].rows().start);
            let own: Vec<usize> = lit.iter().copied().filter(is_own).collect();
            let Some(end) = own.iter().map(|&k| windows[k].rows().end).max() else { continue };
            let reaches = |k: &usize| windows[*k].rows().start < end && windows[*k].rows().end > top;
            let all: Vec<usize> = lit.iter().copied().filter(reaches).collect();
            let (mut total, mut kept) = (TotalLight::dark(size.0, top..end, buffer), None);
            let batches_of_all = batches(&all, windows);
            for batch in &batches_of_all {
                let patches = self.draw(batch);
                let fits = |(patch, &k): (&Patch, &usize)| patch.is_within(&windows[k]);
                if rows < size.1 && !patches.iter().zip(*batch).all(fits) {
                    return None;
                }
                total.add(&patches);
                // If there are several batches, patches are drawn again: they are too large to be stored.
                kept = (batches_of_all.len() == 1).then_some((*batch, patches));
            }
            let mut see = |(batch, patches): (&[usize], Vec<Patch>)| {
                let patches = batch.par_iter().zip(&patches).with_min_len(TRACERS_PER_TASK);
                let seen_of_batch = patches.filter(|(k, _)| is_own(k)).map(|(&k, patch)| {
                    let visibility = Visibility::of(patch, &total, sensor);
                    let outline = share.and_then(|share| Outline::of(patch, share, &total, size, sensor));
                    (k, TracerImage { visibility, outline })
                });
                let seen_of_batch: Vec<_> = seen_of_batch.collect();
                seen_of_batch.into_iter().for_each(|(k, image)| seen[k] = image);
            };
            match kept {
                Some(kept) => see(kept),
                None => batches(&own, windows).into_iter().for_each(|batch| see((batch, self.draw(batch)))),
            }
        }
        Some(seen)
    }
}

/// The tracers in groups whose patches have up to [`PIXELS`] pixels, or of a single tracer.
fn batches<'a>(tracers: &'a [usize], windows: &[Window]) -> Vec<&'a [usize]> {
    let mut pixels = tracers.first().map_or(0, |&k| windows[k].area());
    let joins = |_: &usize, &next: &usize| {
        pixels += windows[next].area();
        let joins = pixels <= PIXELS;
        if !joins {
            pixels = windows[next].area();
        }
        joins
    };
    tracers.chunk_by(joins).collect()
}

/// The light of all particles on consecutive rows of a sensor.
pub(super) struct TotalLight<'a> {
    /// Width of the sensor, px.
    width: usize,
    /// The first pixel of the rows.
    first: usize,
    values: &'a mut Vec<f64>,
}

impl<'a> TotalLight<'a> {
    pub(super) fn dark(width: usize, rows: Range<usize>, values: &'a mut Vec<f64>) -> Self {
        values.clear();
        values.resize(width * rows.len(), 0.0);
        TotalLight { width, first: width * rows.start, values }
    }

    /// Adds patches, in this order in every pixel.
    pub(super) fn add(&mut self, patches: &[Patch]) {
        let (width, first) = (self.width, self.first);
        let pixels = (self.values.len() / width).div_ceil(rayon::current_num_threads()).max(ROWS) * width;
        self.values.par_chunks_mut(pixels).enumerate().for_each(|(i, values)| {
            patches.iter().for_each(|patch| patch.add_to(values, first + i * pixels, width));
        });
    }

    /// The light on pixels from this one on.
    pub(super) fn from(&self, pixel: usize) -> &[f64] {
        &self.values[pixel - self.first..]
    }
}

/// Minimum number of rows to which a thread adds patches.
const ROWS: usize = 64;

/// Minimum number of tracers per parallel task.
const TRACERS_PER_TASK: usize = 16;

impl Patch {
    /// For each row: index of its first pixel in an image of this width, and its light.
    #[inline(always)]
    fn rows(&self, width: usize) -> impl Iterator<Item = (usize, &[f64])> {
        let first = self.corner.1 * width + self.corner.0;
        self.values
            .chunks(self.width.max(1))
            .enumerate()
            .map(move |(row, light)| (first + row * width, light))
    }

    /// Adds the rows that are among those of `pixels`, of which `first` is the first.
    fn add_to(&self, pixels: &mut [f64], first: usize, width: usize) {
        for (start, light) in self.rows(width) {
            let at = start.checked_sub(first);
            if let Some(sums) = at.and_then(|at| pixels.get_mut(at..at + light.len())) {
                sums.iter_mut().zip(light).for_each(|(sum, l)| *sum += l);
            }
        }
    }

    /// Whether its rows are those of a window.
    fn is_within(&self, window: &Window) -> bool {
        let rows = window.rows();
        let end = self.corner.1 + self.values.len() / self.width.max(1);
        self.values.is_empty() || rows.start <= self.corner.1 && end <= rows.end
    }
}

impl Visibility {
    fn of(patch: &Patch, total: &TotalLight, sensor: &Sensor) -> Self {
        let width = total.width;
        let sums = pulp::Arch::new().dispatch(PatchSums { patch, total });
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
                    let counts = response.background + response.slope * total.from(first + i)[0];
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

/// The sums over a patch, compiled for every instruction set.
struct PatchSums<'a> {
    patch: &'a Patch,
    total: &'a TotalLight<'a>,
}

impl pulp::WithSimd for PatchSums<'_> {
    type Output = Sums;

    #[inline(always)]
    fn with_simd<S: pulp::Simd>(self, _: S) -> Sums {
        let mut sums = Sums::default();
        for (first, light) in self.patch.rows(self.total.width) {
            sums.add_row(light, &self.total.from(first)[..light.len()]);
        }
        sums
    }
}

impl Sums {
    /// Adds a row of the patch; `total` is the total light on the same pixels.
    #[inline(always)]
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

    #[inline(always)]
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
    use crate::render::{Context, GaussianSpot, RenderMethod, RendererSpec};

    const WIDTH: usize = 8;

    fn patch(corner: (usize, usize), values: &[f64]) -> Patch {
        Patch { corner, width: 2, values: values.to_vec() }
    }

    fn seen(patches: &[Patch]) -> Vec<Visibility> {
        let sensor = Sensor::new(&Settings { gain: 100.0, background_noise: 4.0, ..Settings::setting1() });
        let mut buffer = Vec::new();
        let mut total = TotalLight::dark(WIDTH, 0..WIDTH, &mut buffer);
        total.add(patches);
        patches.iter().map(|p| Visibility::of(p, &total, &sensor)).collect()
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
    fn bands_of_rows_do_not_change_what_is_seen() {
        let settings = Settings { pixel_dim_x: 90, pixel_dim_y: 120, ..Settings::setting1() };
        let (size, sensor) = ((90, 120), Sensor::new(&settings));
        let renderer = RendererSpec::from(RenderMethod::Gaussian(GaussianSpot {
            diameter_px: 9.0,
            reference_um: None,
            peak_counts: 800.0,
        }));
        let noise_free = NoiseFree::new(renderer.build(&settings, &Context::default()).unwrap(), None);
        let places = (0..160u32).map(|k| (f64::from(k * 37 % 95) - 2.3, f64::from(k * 53 % 131) - 5.1));
        let particles: Vec<Particle> = places
            .map(|(x, y)| Particle { c_int: 0.3 + 0.01 * x, ..Particle::sphere(x, y, 0.0, 2.0) })
            .collect();
        let tracers: Vec<Range<usize>> = (0..50).map(|k| 3 * k..3 * k + 3 * (k % 2) + k % 3).collect();
        let windows = tracers.iter().map(|rows| noise_free.window(&particles[rows.clone()])).collect();
        let all = Tracers { noise_free: &noise_free, particles: &particles, tracers: &tracers, windows };
        let seen = |rows| all.seen(rows, size, &sensor, Some(0.1), &mut Vec::new()).unwrap();
        let whole = seen(120);
        assert!(whole.iter().any(|image| image.visibility.overlap > 0.0 && image.outline.is_some()));
        assert!([1, 7, 64].into_iter().all(|rows| seen(rows) == whole));
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
