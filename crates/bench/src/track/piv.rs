//! PIV: displacement of groups of particles by correlation of windows.
//!
//! Windows of 64, 32 and 16 px overlap by half. Before each pass both images are deformed by half the displacement found
//! so far, one backward and one forward, so that what is left to find is small and belongs to the middle of the interval
//! (Scarano 2002, Meas. Sci. Technol. 13, R1). The correlation comes from Fourier transforms, its peak from a Gaussian
//! through three points; the normalised median test (Westerweel & Scarano 2005, Exp. Fluids 39, 1096) finds outliers.

use rayon::prelude::*;
use rustfft::num_complex::Complex32;

use super::fourier::{Plane, Way};
use super::picture::{Picture, Spline, three_points};

/// Side of the windows of each pass, px. The last size is repeated: its first pass still starts from coarser windows.
const PASSES: [usize; 5] = [64, 32, 16, 16, 16];

/// Threshold of the normalised median test.
const OUTLIER: f32 = 2.0;

/// Noise that the normalised median test takes for granted, px.
const ACCEPTED_NOISE_PX: f32 = 0.1;

/// A displacement.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Vector {
    /// Middle of its window, px from the middle of the first pixel.
    pub(super) at: [f32; 2],
    /// Displacement, px.
    pub(super) d: [f32; 2],
    /// Whether it had to be replaced by the median of its neighbours.
    pub(super) replaced: bool,
}

/// Vectors on a lattice of windows.
#[derive(Debug, Clone)]
struct Lattice {
    columns: usize,
    rows: usize,
    window: usize,
    vectors: Vec<Vector>,
}

/// A field of zeros, where [`displacements`] would have its vectors.
pub(super) fn zeros(a: &Picture, _: &Picture) -> Vec<Vector> {
    let window = PASSES.into_iter().rfind(|w| *w <= a.width.min(a.height));
    window.map_or_else(Vec::new, |window| Lattice::new((a.width, a.height), window).vectors)
}

/// The displacements from `a` to `b`, images of equal size; empty if they are smaller than a window.
pub(super) fn displacements(a: &Picture, b: &Picture) -> Vec<Vector> {
    let (spline_a, spline_b) = (Spline::new(a), Spline::new(b));
    let mut found: Option<Lattice> = None;
    for window in PASSES.into_iter().filter(|w| *w <= a.width.min(a.height)) {
        let mut next = Lattice::new((a.width, a.height), window);
        // Smoothed, because deformation amplifies what windows of this size cannot see.
        let predictor = found.map(|lattice| lattice.smoothed());
        let shift = |x: f32, y: f32| predictor.as_ref().map_or([0.0; 2], |p| p.at(x, y));
        let deformed = |spline: &Spline, part: f32| {
            let counts = (0..a.width * a.height)
                .into_par_iter()
                .map(|i| {
                    let (x, y) = ((i % a.width) as f32, (i / a.width) as f32);
                    let [dx, dy] = shift(x, y);
                    spline.at(x + part * dx, y + part * dy)
                })
                .collect();
            Picture { counts, width: a.width, height: a.height }
        };
        let (image_a, image_b) = match &predictor {
            None => (a.clone(), b.clone()),
            Some(_) => (deformed(&spline_a, -0.5), deformed(&spline_b, 0.5)),
        };
        let correlation = Correlation::new(window);
        next.vectors.par_iter_mut().for_each_init(
            || correlation.scratch(),
            |scratch, vector| {
                let half = 0.5 * (window as f32 - 1.0);
                let corner = vector.at.map(|c| (c - half) as usize);
                let [dx, dy] = shift(vector.at[0], vector.at[1]);
                let [rx, ry] = correlation.peak(&image_a, &image_b, corner, scratch);
                vector.d = [dx + rx, dy + ry];
            },
        );
        next.validate();
        found = Some(next);
    }
    found.map_or_else(Vec::new, |lattice| lattice.vectors)
}

impl Lattice {
    fn new((width, height): (usize, usize), window: usize) -> Self {
        let step = window / 2;
        let (columns, rows) = ((width - window) / step + 1, (height - window) / step + 1);
        let middle = |k: usize| (k * step) as f32 + 0.5 * (window as f32 - 1.0);
        let vectors = (0..columns * rows)
            .map(|i| Vector { at: [middle(i % columns), middle(i / columns)], d: [0.0; 2], replaced: false })
            .collect();
        Lattice { columns, rows, window, vectors }
    }

    /// Displacement at a place, linear between vectors, constant beyond them.
    fn at(&self, x: f32, y: f32) -> [f32; 2] {
        let [x0, y0] = self.vectors[0].at;
        let step = (self.window / 2) as f32;
        let place = |offset: f32, n: usize| {
            let t = (offset / step).clamp(0.0, (n - 1) as f32);
            let k = (t as usize).min(n.saturating_sub(2));
            (k, (k + 1).min(n - 1), t - k as f32)
        };
        let ((left, right, s), (up, down, t)) = (place(x - x0, self.columns), place(y - y0, self.rows));
        let d = |column: usize, row: usize, axis: usize| self.vectors[row * self.columns + column].d[axis];
        std::array::from_fn(|axis| {
            let upper = d(left, up, axis) * (1.0 - s) + d(right, up, axis) * s;
            let lower = d(left, down, axis) * (1.0 - s) + d(right, down, axis) * s;
            upper * (1.0 - t) + lower * t
        })
    }

    /// Indices of the neighbours of a vector, itself left out.
    fn neighbours(&self, i: usize) -> impl Iterator<Item = usize> + '_ {
        let (x, y) = (i % self.columns, i / self.columns);
        let columns = x.saturating_sub(1)..(x + 2).min(self.columns);
        let rows = y.saturating_sub(1)..(y + 2).min(self.rows);
        rows.flat_map(move |row| columns.clone().map(move |column| row * self.columns + column))
            .filter(move |&j| j != i)
    }

    /// With every vector the mean of itself and its neighbours, the direct ones counted twice and itself four times.
    fn smoothed(&self) -> Lattice {
        let vectors = self.vectors.iter().enumerate().map(|(i, vector)| {
            let (mut sum, mut total) = (vector.d.map(|d| 4.0 * d), 4.0);
            for j in self.neighbours(i) {
                let direct = j % self.columns == i % self.columns || j / self.columns == i / self.columns;
                let weight = if direct { 2.0 } else { 1.0 };
                total += weight;
                (0..2).for_each(|axis| sum[axis] += weight * self.vectors[j].d[axis]);
            }
            Vector { d: sum.map(|s| s / total), ..*vector }
        });
        Lattice { vectors: vectors.collect(), ..*self }
    }

    /// Replaces vectors unlike their neighbours by the median of those that are not.
    fn validate(&mut self) {
        let unlike: Vec<bool> = (0..self.vectors.len()).map(|i| self.is_unlike_its_neighbours(i)).collect();
        let medians: Vec<Option<[f32; 2]>> = (0..self.vectors.len())
            .map(|i| {
                let good: Vec<usize> = self.neighbours(i).filter(|&j| !unlike[j]).collect();
                (unlike[i] && !good.is_empty()).then(|| {
                    std::array::from_fn(|axis| median(good.iter().map(|&j| self.vectors[j].d[axis])))
                })
            })
            .collect();
        for (vector, replacement) in self.vectors.iter_mut().zip(medians) {
            if let Some(d) = replacement {
                *vector = Vector { d, replaced: true, ..*vector };
            }
        }
    }

    fn is_unlike_its_neighbours(&self, i: usize) -> bool {
        if self.neighbours(i).count() < 3 {
            return false;
        }
        let residual = |axis: usize| {
            let around = |j: usize| self.vectors[j].d[axis];
            let middle = median(self.neighbours(i).map(around));
            let spread = median(self.neighbours(i).map(|j| (around(j) - middle).abs()));
            (self.vectors[i].d[axis] - middle) / (spread + ACCEPTED_NOISE_PX)
        };
        residual(0).hypot(residual(1)) > OUTLIER
    }
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
    fourier: Plane,
}

/// Memory of one correlation.
struct Scratch {
    /// Window of `a` as real part, window of `b` as imaginary part: one transform serves both.
    both: Vec<Complex32>,
    product: Vec<Complex32>,
    fourier: Vec<Complex32>,
}

impl Correlation {
    fn new(side: usize) -> Self {
        Correlation { side, fourier: Plane::new((side, side)) }
    }

    fn scratch(&self) -> Scratch {
        let zeros = vec![Complex32::default(); self.side * self.side];
        Scratch { both: zeros.clone(), product: zeros, fourier: self.fourier.scratch() }
    }

    /// The displacement of the highest correlation between the windows with a given corner, px.
    fn peak(&self, a: &Picture, b: &Picture, [x0, y0]: [usize; 2], scratch: &mut Scratch) -> [f32; 2] {
        let n = self.side;
        let mean = |picture: &Picture| {
            let rows = (0..n).map(|y| &picture.counts[(y0 + y) * picture.width + x0..][..n]);
            rows.map(|row| row.iter().sum::<f32>()).sum::<f32>() / (n * n) as f32
        };
        let (mean_a, mean_b) = (mean(a), mean(b));
        for y in 0..n {
            let start = (y0 + y) * a.width + x0;
            for x in 0..n {
                scratch.both[y * n + x] =
                    Complex32::new(a.counts[start + x] - mean_a, b.counts[start + x] - mean_b);
            }
        }
        self.fourier.transform(&mut scratch.both, Way::Forward, &mut scratch.fourier);
        // Real windows have symmetric transforms: F = (H(k) + H*(-k)) / 2, G = (H(k) - H*(-k)) / 2i.
        for v in 0..n {
            for u in 0..n {
                let here = scratch.both[v * n + u];
                let there = scratch.both[(n - v) % n * n + (n - u) % n].conj();
                let (f, g) = (here + there, (here - there) * Complex32::new(0.0, -1.0));
                scratch.product[v * n + u] = f.conj() * g;
            }
        }
        self.fourier.transform(&mut scratch.product, Way::Backward, &mut scratch.fourier);
        highest(n, |dx, dy| {
            let wrap = |d: isize| d.rem_euclid(n as isize) as usize;
            // A window and its shifted copy share fewer pixels the farther the shift (Westerweel 1997).
            let shared = |d: isize| 1.0 - d.unsigned_abs() as f32 / n as f32;
            scratch.product[wrap(dy) * n + wrap(dx)].re / (shared(dx) * shared(dy))
        })
    }
}

/// Place of the highest value of a correlation plane of side `n`, to a fraction of a pixel. Shifts beyond a third of the
/// window are not looked at: too few particles would be in both windows.
fn highest(n: usize, value: impl Fn(isize, isize) -> f32) -> [f32; 2] {
    let reach = (n / 3) as isize;
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
    // The Gaussian needs positive values; a peak at the rim of the plane is taken as it is.
    let level = |x: isize, y: isize| (value(x, y) - least).max(f32::MIN_POSITIVE);
    let inside = dx.abs() < reach && dy.abs() < reach;
    let fine = |low: f32, high: f32| if inside { three_points(low, level(dx, dy), high) } else { 0.0 };
    [
        dx as f32 + fine(level(dx - 1, dy), level(dx + 1, dy)),
        dy as f32 + fine(level(dx, dy - 1), level(dx, dy + 1)),
    ]
}

#[cfg(test)]
mod tests {
    use super::*;
    use microsig_core::stream::{Purpose, Streams};

    /// Spots of 2.5 px at scattered places, moved by half of `d(x, y)` backward in the one and forward in the other image.
    fn pair(size: (usize, usize), d: impl Fn(f32, f32) -> [f32; 2]) -> (Picture, Picture) {
        let mut stream = Streams::new(1).stream(Purpose::Seeding, 0, 0);
        let mut part = || stream.uniform() as f32;
        let spots: Vec<[f32; 2]> =
            (0..(size.0 * size.1) / 30).map(|_| [part() * size.0 as f32, part() * size.1 as f32]).collect();
        let image = |part: f32| {
            let mut picture = Picture::from_fn(size, |_, _| 100.0);
            for &[x, y] in &spots {
                let [dx, dy] = d(x, y);
                let (x, y) = (x + part * dx, y + part * dy);
                for row in (y as usize).saturating_sub(4)..(y as usize + 6).min(size.1) {
                    for column in (x as usize).saturating_sub(4)..(x as usize + 6).min(size.0) {
                        let r2 = (column as f32 - x).powi(2) + (row as f32 - y).powi(2);
                        picture.counts[row * size.0 + column] += 1000.0 * (-r2 / 0.78).exp();
                    }
                }
            }
            picture
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

    #[test]
    fn small_images_have_no_vectors() {
        let picture = Picture::from_fn((10, 10), |_, _| 0.0);
        assert!(displacements(&picture, &picture).is_empty());
    }
}
