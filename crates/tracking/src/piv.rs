//! PIV: displacement fields by cross-correlation of interrogation windows.
//!
//! Windows of 64, 32 and 16 px with 50 % overlap. Before each pass both images are deformed by half of the
//! predicted displacement, one backward and one forward, so that residual displacements are small and the
//! result is central in time (Scarano 2002, Meas. Sci. Technol. 13, R1; `deform`). Correlation by FFT,
//! three-point Gaussian peak fit, normalized median test for outliers (Westerweel & Scarano 2005, Exp. Fluids
//! 39, 1096).

use std::borrow::Cow;

use microsig_core::cancel::checkpoint;
use numeric::fourier::{Complex32, Direction, ImageFft};
use rayon::prelude::*;

use super::Method;
use super::deform::{Deformable, Degree};
use super::gray_image::{GrayImage, three_points};
use super::job::Job;
use super::output::{DisplacementVector, Output};
use super::spots::LogDetector;
use storage::error::Result;

pub(super) const METHOD: Method = Method {
    name: "piv",
    about: "Displacement field by cross-correlation of interrogation windows",
    run: |job| {
        warn_of_few_particles(job)?;
        if job.options.ensemble { ensemble(job) } else { job.fields(displacements) }
    },
};

/// Particle images per window, over all pairs whose correlations are averaged, below which many vectors are
/// spurious (Keane & Adrian 1992, Appl. Sci. Res. 49, 191: five common to both windows give 95 % valid vectors).
const LEAST_PARTICLES: f64 = 5.0;

/// Warns if the middle image has too few particle images for the windows of the last pass.
fn warn_of_few_particles(job: &Job) -> Result<()> {
    let pairs = job.recording.image_pairs();
    let Some(&(_, first)) = pairs.get(pairs.len() / 2) else { return Ok(()) };
    let image = job.recording.frame(first)?;
    let pairs = if job.options.ensemble { pairs.len() } else { 1 };
    if let Some((window, _)) = passes((image.width, image.height)).last() {
        let found = LogDetector::new(job.options.diameter_px).find(&image).len();
        let pixels = (image.width * image.height) as f64 * job.recording.image_share();
        few_particles((found * window * window) as f64 / pixels, window, pairs)
            .into_iter()
            .for_each(|text| job.warn(text));
    }
    Ok(())
}

/// A warning if interrogation windows contain too few particle images; correlations of `pairs` image pairs are averaged.
fn few_particles(per_window: f64, window: usize, pairs: usize) -> Option<String> {
    (per_window * (pairs as f64) < LEAST_PARTICLES).then(|| {
        let all = if pairs > 1 { format!(", {:.1} in all {pairs} pairs", per_window * pairs as f64) } else { String::new() };
        format!(
            "interrogation windows of {window} px contain {per_window:.1} particle images on average{all}; reliable correlation \
             peaks need about {LEAST_PARTICLES:.0}, so expect spurious vectors. A higher seeding density or, in steady flow, an \
             ensemble over more pairs would help"
        )
    })
}

/// Window size of each pass, px. The last size is repeated, since its first pass starts from a coarser
/// predictor.
const PASSES: [usize; 5] = [64, 32, 16, 16, 16];

/// Threshold of the normalized median test.
const OUTLIER: f32 = 2.0;

/// Noise level (epsilon) of the normalized median test, px.
const ACCEPTED_NOISE_PX: f32 = 0.1;

#[derive(Debug, Clone)]
struct VectorGrid {
    columns: usize,
    rows: usize,
    window: usize,
    vectors: Vec<DisplacementVector>,
}

/// Zero displacements on the grid of [`displacements`].
pub(super) fn zeros(a: &GrayImage, _: &GrayImage) -> Vec<DisplacementVector> {
    let window = PASSES.into_iter().rfind(|w| *w <= a.width.min(a.height));
    window.map_or_else(Vec::new, |window| VectorGrid::new((a.width, a.height), window).vectors)
}

/// Displacements from `a` to `b`, images of equal size; empty if they are smaller than a window.
pub(super) fn displacements(a: &GrayImage, b: &GrayImage) -> Vec<DisplacementVector> {
    let (mut found, pair) = (None, Deformable::new(a, b));
    for way in passes((a.width, a.height)) {
        let mut pass = Pass::new((a.width, a.height), way, found.as_ref());
        pass.add(&pair);
        found = Some(pass.finished());
    }
    found.map_or_else(Vec::new, |grid| grid.vectors)
}

/// Ensemble correlation: one displacement field for all image pairs of a steady flow, from the peak of the
/// averaged correlation planes (Meinhart, Wereley & Santiago 2000, J. Fluids Eng. 122, 285), for recordings
/// with few particles per window, as in micro-PIV. Only one pair is in memory at a time.
fn ensemble(job: &Job) -> Result<Output> {
    let pairs = job.recording.image_pairs();
    let Some(&(_, first)) = pairs.first() else { return Ok(Output::MeanField(Vec::new())) };
    let image = job.recording.frame(first)?;
    let size = (image.width, image.height);
    let work: Vec<((usize, Degree), usize)> =
        passes(size).flat_map(|way| pairs.iter().map(move |&(_, first)| (way, first))).collect();
    let mut found: Option<VectorGrid> = None;
    let mut pass: Option<Pass> = None;
    job.sequentially(&work, |k, (way, first)| {
        if k % pairs.len() == 0 {
            found = pass.take().map(Pass::finished);
            pass = Some(Pass::new(size, way, found.as_ref()));
        }
        let (a, b) = (job.recording.frame(first)?, job.recording.frame(first + 1)?);
        if let Some(pass) = &mut pass {
            pass.add(&Deformable::new(&a, &b));
        }
        Ok(())
    })?;
    Ok(Output::MeanField(pass.map_or_else(Vec::new, |pass| pass.finished().vectors)))
}

/// Window size and interpolation of all passes for an image of this size. The result of an earlier pass only
/// serves as a predictor for the next one, so the costly interpolation is reserved for the last.
fn passes((width, height): (usize, usize)) -> impl Iterator<Item = (usize, Degree)> {
    let fitting = move |window: &usize| *window <= width.min(height);
    let last = PASSES.len() - 1;
    let degree = move |pass: usize| if pass == last { Degree::Septic } else { Degree::Cubic };
    PASSES.into_iter().enumerate().filter(move |(_, w)| fitting(w)).map(move |(pass, w)| (w, degree(pass)))
}

/// A pass over one image pair, or over several whose correlation planes are summed.
struct Pass {
    grid: VectorGrid,
    /// Result of the previous pass, smoothed for stability: deformation amplifies wavelengths that the
    /// windows do not resolve.
    predictor: Option<VectorGrid>,
    /// Degree of the image interpolation.
    degree: Degree,
    correlation: Correlation,
    /// The correlation plane of every vector, row by row.
    planes: Vec<f32>,
}

impl Pass {
    fn new(size: (usize, usize), (window, degree): (usize, Degree), found: Option<&VectorGrid>) -> Self {
        let grid = VectorGrid::new(size, window);
        let planes = vec![0.0; grid.vectors.len() * window * window];
        let predictor = found.map(VectorGrid::smoothed);
        Pass { grid, predictor, degree, correlation: Correlation::new(window), planes }
    }

    /// Adds the correlation planes of an image pair.
    fn add(&mut self, pair: &Deformable) {
        let window = self.correlation.side;
        let [a, b] = match &self.predictor {
            None => pair.images.map(Cow::Borrowed),
            Some(predictor) => {
                let x0 = predictor.vectors[0].at[0];
                let places: Vec<_> = (0..pair.images[0].width)
                    .map(|x| predictor.place(x as f32 - x0, predictor.columns))
                    .collect();
                let displaced = pair.deformed(self.degree, |y, row| {
                    let across = predictor.row(y);
                    row.iter_mut().zip(&places).for_each(|(d, place)| *d = between(&across, *place));
                });
                displaced.map(Cow::Owned)
            }
        };
        let (correlation, half) = (&self.correlation, 0.5 * (window as f32 - 1.0));
        self.planes.par_chunks_mut(window * window).zip(&self.grid.vectors).for_each_init(
            || correlation.scratch(),
            |scratch, (plane, vector)| {
                checkpoint();
                let corner = vector.at.map(|c| (c - half) as usize);
                correlation.add(&a, &b, corner, scratch, plane);
            },
        );
    }

    /// Displacements at the correlation peaks, validated.
    fn finished(mut self) -> VectorGrid {
        let window = self.correlation.side;
        let columns = self.grid.columns;
        let planes = self.planes.par_chunks(columns * window * window);
        self.grid.vectors.par_chunks_mut(columns).zip(planes).for_each(|(row, planes)| {
            let predicted = self.predictor.as_ref().map(|predictor| (predictor, predictor.row(row[0].at[1])));
            for (vector, plane) in row.iter_mut().zip(planes.chunks(window * window)) {
                let [dx, dy] = predicted.as_ref().map_or([0.0; 2], |(p, row)| {
                    between(row, p.place(vector.at[0] - p.vectors[0].at[0], p.columns))
                });
                let [rx, ry] = peak(window, plane);
                vector.d = [dx + rx, dy + ry];
            }
        });
        self.grid.validate();
        self.grid
    }
}

impl VectorGrid {
    fn new((width, height): (usize, usize), window: usize) -> Self {
        let step = window / 2;
        let (columns, rows) = ((width - window) / step + 1, (height - window) / step + 1);
        let middle = |k: usize| (k * step) as f32 + 0.5 * (window as f32 - 1.0);
        let vectors = (0..columns * rows)
            .map(|i| DisplacementVector {
                at: [middle(i % columns), middle(i / columns)],
                d: [0.0; 2],
                replaced: false,
            })
            .collect();
        VectorGrid { columns, rows, window, vectors }
    }

    /// The preceding and the next of `n` vectors at a distance (px) from the first, and the fraction of the way.
    fn place(&self, offset: f32, n: usize) -> (usize, usize, f32) {
        let t = (offset / (self.window / 2) as f32).clamp(0.0, (n - 1) as f32);
        let k = (t as usize).min(n.saturating_sub(2));
        (k, (k + 1).min(n - 1), t - k as f32)
    }

    /// Displacements at the columns of vectors at this `y`, interpolated linearly between rows, constant outside.
    fn row(&self, y: f32) -> Vec<[f32; 2]> {
        let (up, down, t) = self.place(y - self.vectors[0].at[1], self.rows);
        let [up, down] = [up, down].map(|row| &self.vectors[row * self.columns..][..self.columns]);
        let mean = |(a, b): (&DisplacementVector, &DisplacementVector)| {
            std::array::from_fn(|axis| a.d[axis] * (1.0 - t) + b.d[axis] * t)
        };
        up.iter().zip(down).map(mean).collect()
    }

    /// Indices of the (up to eight) neighbors of a vector.
    fn neighbors(&self, i: usize) -> impl Iterator<Item = usize> + '_ {
        let (x, y) = (i % self.columns, i / self.columns);
        let columns = x.saturating_sub(1)..(x + 2).min(self.columns);
        let rows = y.saturating_sub(1)..(y + 2).min(self.rows);
        rows.flat_map(move |row| columns.clone().map(move |column| row * self.columns + column))
            .filter(move |&j| j != i)
    }

    /// The field filtered by a 3 x 3 binomial kernel (weights 1, 2, 4).
    fn smoothed(&self) -> VectorGrid {
        let vectors = self.vectors.iter().enumerate().map(|(i, vector)| {
            let (mut sum, mut total) = (vector.d.map(|d| 4.0 * d), 4.0);
            for j in self.neighbors(i) {
                let direct = j % self.columns == i % self.columns || j / self.columns == i / self.columns;
                let weight = if direct { 2.0 } else { 1.0 };
                total += weight;
                (0..2).for_each(|axis| sum[axis] += weight * self.vectors[j].d[axis]);
            }
            DisplacementVector { d: sum.map(|s| s / total), ..*vector }
        });
        VectorGrid { vectors: vectors.collect(), ..*self }
    }

    /// Replaces outliers by the median of their valid neighbors.
    fn validate(&mut self) {
        let unlike: Vec<bool> = (0..self.vectors.len()).map(|i| self.is_unlike_its_neighbors(i)).collect();
        let medians: Vec<Option<[f32; 2]>> = (0..self.vectors.len())
            .map(|i| {
                let good: Vec<usize> = self.neighbors(i).filter(|&j| !unlike[j]).collect();
                (unlike[i] && !good.is_empty()).then(|| {
                    std::array::from_fn(|axis| median(good.iter().map(|&j| self.vectors[j].d[axis])))
                })
            })
            .collect();
        for (vector, replacement) in self.vectors.iter_mut().zip(medians) {
            if let Some(d) = replacement {
                *vector = DisplacementVector { d, replaced: true, ..*vector };
            }
        }
    }

    fn is_unlike_its_neighbors(&self, i: usize) -> bool {
        if self.neighbors(i).count() < 3 {
            return false;
        }
        let residual = |axis: usize| {
            let around = |j: usize| self.vectors[j].d[axis];
            let middle = median(self.neighbors(i).map(around));
            let spread = median(self.neighbors(i).map(|j| (around(j) - middle).abs()));
            (self.vectors[i].d[axis] - middle) / (spread + ACCEPTED_NOISE_PX)
        };
        residual(0).hypot(residual(1)) > OUTLIER
    }
}

/// The displacement between two vectors of a row, at a fraction of the way.
fn between(row: &[[f32; 2]], (left, right, t): (usize, usize, f32)) -> [f32; 2] {
    std::array::from_fn(|axis| row[left][axis] * (1.0 - t) + row[right][axis] * t)
}

fn median(values: impl Iterator<Item = f32>) -> f32 {
    let mut values: Vec<f32> = values.collect();
    let n = values.len();
    values.sort_unstable_by(f32::total_cmp);
    0.5 * (values[(n - 1) / 2] + values[n / 2])
}

/// Cross-correlation of square windows.
struct Correlation {
    side: usize,
    fourier: ImageFft,
}

/// Buffers of one correlation.
struct Scratch {
    /// Window of `a` as real part, window of `b` as imaginary part, so that one transform serves both.
    both: Vec<Complex32>,
    fourier: Vec<Complex32>,
}

impl Correlation {
    fn new(side: usize) -> Self {
        Correlation { side, fourier: ImageFft::new((side, side)) }
    }

    fn scratch(&self) -> Scratch {
        Scratch { both: vec![Complex32::default(); self.side * self.side], fourier: self.fourier.scratch() }
    }

    /// Adds the cross-correlation of the windows with this corner to a plane.
    fn add(
        &self,
        a: &GrayImage,
        b: &GrayImage,
        [x0, y0]: [usize; 2],
        scratch: &mut Scratch,
        plane: &mut [f32],
    ) {
        let n = self.side;
        let mean = |image: &GrayImage| {
            // Columns modulo 8, added independently.
            let mut sums = [0.0f32; 8];
            for y in y0..y0 + n {
                for part in image.counts[y * image.width + x0..][..n].chunks(8) {
                    sums.iter_mut().zip(part).for_each(|(sum, value)| *sum += value);
                }
            }
            sums.iter().sum::<f32>() / (n * n) as f32
        };
        let (mean_a, mean_b) = (mean(a), mean(b));
        for y in 0..n {
            let [row_a, row_b] = [a, b].map(|image| &image.counts[(y0 + y) * a.width + x0..][..n]);
            let counts = scratch.both[y * n..][..n].iter_mut().zip(row_a).zip(row_b);
            counts.for_each(|((both, a), b)| *both = Complex32::new(a - mean_a, b - mean_b));
        }
        self.fourier.transform(&mut scratch.both, Direction::Forward, &mut scratch.fourier);
        self.fourier.combine(&mut scratch.both, |_, [a, b]| a.conj() * b);
        self.fourier.transform(&mut scratch.both, Direction::Backward, &mut scratch.fourier);
        plane.iter_mut().zip(&scratch.both).for_each(|(sum, both)| *sum += both.re);
    }
}

/// Displacement at the correlation peak of a plane of side `n`, px, to a fraction of a pixel. Shifts beyond a third of the
/// window are excluded: too few particles would be in both windows.
fn peak(n: usize, plane: &[f32]) -> [f32; 2] {
    let reach = (n / 3) as isize;
    // Correct for the overlap of the windows, which decreases with the shift (Westerweel 1997).
    let shared: Vec<f32> = (0..=reach).map(|d| 1.0 - d as f32 / n as f32).collect();
    let value = |dx: isize, dy: isize| {
        let wrapped = |d: isize| if d < 0 { n.wrapping_add_signed(d) } else { d as usize };
        plane[wrapped(dy) * n + wrapped(dx)] / (shared[dx.unsigned_abs()] * shared[dy.unsigned_abs()])
    };
    let mut best = (f32::NEG_INFINITY, 0, 0);
    let mut least = f32::INFINITY;
    for dy in -reach..=reach {
        for dx in -reach..=reach {
            let here = value(dx, dy);
            least = least.min(here);
            if here > best.0 {
                best = (here, dx, dy);
            }
        }
    }
    let (_, dx, dy) = best;
    // The Gaussian fit needs positive values; a peak at the limit of the search is not refined.
    let level = |x: isize, y: isize| (value(x, y) - least).max(f32::MIN_POSITIVE);
    let inside = dx.abs() < reach && dy.abs() < reach;
    if !inside {
        return [dx as f32, dy as f32];
    }
    let middle = level(dx, dy);
    [
        dx as f32 + three_points(level(dx - 1, dy), middle, level(dx + 1, dy)),
        dy as f32 + three_points(level(dx, dy - 1), middle, level(dx, dy + 1)),
    ]
}

#[cfg(test)]
mod tests {
    use super::*;
    use microsig_core::stream::{Purpose, Streams};

    /// Randomly placed particle images of 3 px, displaced by -d(x, y) / 2 in the first and by +d(x, y) / 2
    /// in the second image.
    fn pair(size: (usize, usize), d: impl Fn(f32, f32) -> [f32; 2]) -> (GrayImage, GrayImage) {
        seeded_pair(size, 1, 30, d)
    }

    /// The same with one particle per `area` px^2, placed according to the seed.
    fn seeded_pair(
        size: (usize, usize),
        seed: u64,
        area: usize,
        d: impl Fn(f32, f32) -> [f32; 2],
    ) -> (GrayImage, GrayImage) {
        let mut stream = Streams::new(seed).stream(Purpose::Seeding, 0, 0);
        let mut part = || stream.uniform() as f32;
        let spots: Vec<[f32; 2]> =
            (0..(size.0 * size.1) / area).map(|_| [part() * size.0 as f32, part() * size.1 as f32]).collect();
        // The mean of a Gaussian over a pixel, by Simpson's rule.
        let share = |pixel: usize, at: f32| {
            let light = |part: f32| (-(pixel as f32 + part - at).powi(2) / 1.125).exp();
            (light(-0.5) + 4.0 * light(-0.25) + 2.0 * light(0.0) + 4.0 * light(0.25) + light(0.5)) / 12.0
        };
        let image = |part: f32| {
            let mut image = GrayImage::from_fn(size, |_, _| 100.0);
            for &[x, y] in &spots {
                let [dx, dy] = d(x, y);
                let (x, y) = (x + part * dx, y + part * dy);
                for row in (y as usize).saturating_sub(4)..(y as usize + 6).min(size.1) {
                    let across = 1000.0 * share(row, y);
                    for column in (x as usize).saturating_sub(4)..(x as usize + 6).min(size.0) {
                        image.counts[row * size.0 + column] += across * share(column, x);
                    }
                }
            }
            image
        };
        (image(-0.5), image(0.5))
    }

    #[test]
    fn uniform_displacements_come_back() {
        for d in [[0.0, 0.0], [3.3, -1.7], [9.6, 4.25]] {
            let (a, b) = pair((256, 192), |_, _| d);
            let found = displacements(&a, &b);
            let inner =
                found.iter().filter(|v| (20.0..236.0).contains(&v.at[0]) && (20.0..172.0).contains(&v.at[1]));
            let errors: Vec<f32> = inner.map(|v| (v.d[0] - d[0]).hypot(v.d[1] - d[1])).collect();
            let rms = (errors.iter().map(|e| e * e).sum::<f32>() / errors.len() as f32).sqrt();
            assert!(rms < 0.05, "{d:?}: rms {rms} px");
        }
    }

    /// Between integer pixels, the mean error comes from the interpolation: up to 0.0113 px for cubic
    /// splines, with a period of 2 px, up to 0.0015 px for septic ones; the mean of 700 vectors varies by
    /// 0.0001 px.
    #[test]
    fn displacements_are_biased_neither_toward_nor_away_from_whole_pixels() {
        for d in [0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 1.0, 1.5, 3.5, -2.5] {
            let (a, b) = seeded_pair((256, 256), 1, 20, |_, _| [d, 0.5]);
            let found = displacements(&a, &b);
            let inner = found.iter().filter(|v| v.at.iter().all(|c| (20.0..236.0).contains(c)));
            let (mut sums, mut n) = ([0.0f64; 2], 0.0);
            for v in inner {
                sums = [sums[0] + f64::from(v.d[0] - d), sums[1] + f64::from(v.d[1] - 0.5)];
                n += 1.0;
            }
            assert!(sums.iter().all(|sum| (sum / n).abs() < 0.0015), "{d}: {:?} px", sums.map(|sum| sum / n));
        }
    }

    #[test]
    fn a_shear_is_followed_better_than_by_rigid_windows() {
        let shear = |_: f32, y: f32| [0.08 * (y - 96.0), 0.0];
        let (a, b) = pair((256, 192), shear);
        let found = displacements(&a, &b);
        let inner: Vec<_> = found
            .iter()
            .filter(|v| (20.0..236.0).contains(&v.at[0]) && (20.0..172.0).contains(&v.at[1]))
            .collect();
        let rms = (inner.iter().map(|v| (v.d[0] - shear(0.0, v.at[1])[0]).powi(2)).sum::<f32>()
            / inner.len() as f32)
            .sqrt();
        assert!(rms < 0.1, "rms {rms} px");
    }

    /// With one particle per 600 px^2, most windows of 16 px are empty; 20 such pairs together have enough
    /// particles.
    #[test]
    fn correlations_of_many_sparse_pairs_are_averaged() {
        let (size, d) = ((160, 160), [2.4, -1.3]);
        let pairs: Vec<_> = (0..20).map(|seed| seeded_pair(size, seed, 600, |_, _| d)).collect();
        let mut found: Option<VectorGrid> = None;
        for way in passes(size) {
            let mut pass = Pass::new(size, way, found.as_ref());
            pairs.iter().for_each(|(a, b)| pass.add(&Deformable::new(a, b)));
            found = Some(pass.finished());
        }
        let share_off = |vectors: &[DisplacementVector]| {
            let inner = |v: &&DisplacementVector| v.at.iter().all(|c| (16.0..144.0).contains(c));
            let inner: Vec<&DisplacementVector> = vectors.iter().filter(inner).collect();
            let off = inner.iter().filter(|v| (v.d[0] - d[0]).hypot(v.d[1] - d[1]) > 0.3).count();
            off as f32 / inner.len() as f32
        };
        let alone = share_off(&displacements(&pairs[0].0, &pairs[0].1));
        let together = share_off(&found.unwrap().vectors);
        assert!(together < 0.02 && alone > 0.1, "{alone} of vectors off in a pair, {together} in all");
    }

    #[test]
    fn small_images_have_no_vectors() {
        let image = GrayImage::from_fn((10, 10), |_, _| 0.0);
        assert!(displacements(&image, &image).is_empty());
    }
}
