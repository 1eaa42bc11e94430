//! The fit of one particle's images.
//!
//! The light of each image and its background are linear and eliminated (variable projection: Golub and
//! Pereyra 1973, SIAM J. Numer. Anal. 10, 413, in Kaufman's approximation); Levenberg's and Marquardt's steps
//! do the rest.

use rayon::prelude::*;

use super::frames::Frames;
use super::local::{BLUR, COUNT, FOCUS, Instrument, Local, QUANTITIES, SLOPE, X, Y, bounded};
use crate::particles::Window;
use crate::state::Noise;
use microsig_core::linear::Symmetric;
use storage::error::Result;

/// Errors of images in the first steps and in the last ones, relative to the peak.
pub(super) const COARSE: f64 = 0.03;
pub(super) const FINE: f64 = 0.008;

/// A particle of a scan.
#[derive(Debug)]
pub(super) struct Subject<'a> {
    pub(super) instrument: &'a Instrument,
    pub(super) frames: &'a Frames,
    pub(super) window: Window,
    pub(super) half: usize,
    /// The planes that are used.
    pub(super) planes: Vec<usize>,
    /// Place of the middle of the window in the field, mm from its center, and the unit vector toward it.
    pub(super) place_mm: [f64; 2],
    pub(super) toward: [f64; 2],
    /// For each plane that is used, the pixels that are; empty: all.
    pub(super) masks: Vec<Vec<bool>>,
}

/// The images of a plane and how well the model agrees.
#[derive(Debug, Clone, Default)]
pub(super) struct Seen {
    /// Light and background, counts.
    pub(super) light: f64,
    pub(super) background: f64,
    /// The model on the pixels of the window, counts.
    pub(super) model: Vec<f64>,
    /// Sum of squared residuals over their variances, and the number of pixels in it.
    pub(super) chi2: f64,
    pub(super) pixels: usize,
    /// Square root of the weight of each pixel, 1/counts; 0 for those that are not used.
    pub(super) roots: Vec<f64>,
    /// Sums of squared residuals and of squared deviations from the mean, counts^2.
    pub(super) residual2: f64,
    pub(super) spread2: f64,
}

/// Normal equations at a state.
#[derive(Debug, Clone)]
pub(super) struct Quadratic {
    pub(super) matrix: Symmetric,
    pub(super) right: Vec<f64>,
}

/// A state with its misfit.
#[derive(Debug, Clone)]
pub(super) struct Fit {
    pub(super) local: Local,
    pub(super) seen: Vec<Seen>,
    pub(super) quadratic: Quadratic,
    pub(super) free: Vec<usize>,
}

impl Fit {
    /// Per pixel, of means of repeated frames.
    pub(super) fn chi2(&self) -> f64 {
        let (chi2, pixels) =
            self.seen.iter().fold((0.0, 0), |(chi2, n), seen| (chi2 + seen.chi2, n + seen.pixels));
        chi2 / pixels.max(1) as f64
    }

    /// The part of the images' variance that the model explains.
    pub(super) fn r2(&self) -> f64 {
        let sum = |of: fn(&Seen) -> f64| self.seen.iter().map(of).sum::<f64>();
        1.0 - sum(|seen| seen.residual2) / sum(|seen| seen.spread2)
    }

    /// Mean light and background of the images, counts.
    pub(super) fn light(&self) -> f64 {
        self.seen.iter().map(|seen| seen.light).sum::<f64>() / self.seen.len().max(1) as f64
    }

    pub(super) fn background(&self) -> f64 {
        self.seen.iter().map(|seen| seen.background).sum::<f64>() / self.seen.len().max(1) as f64
    }
}

/// Distance from the focus (um), and light with its derivatives along x and y, per light, on the pixels of a
/// window.
pub(super) type Image = (f64, Vec<[f64; 3]>);

/// Derivatives of images at a state, by quantity and plane; empty for those that follow from the images themselves. They
/// take most of the time of a fit, and steps need them only approximately.
pub(super) struct Differences {
    at: Local,
    slopes: Vec<Vec<Vec<f64>>>,
}

/// Derivatives are computed again when a quantity has changed by more than this part of its longest step.
const STALE: f64 = 0.2;

/// One plane's data.
struct Data {
    counts: Vec<f64>,
    used: Vec<bool>,
    /// Variance of a count in one frame, and the number of frames whose mean the counts are.
    noise: Noise,
    repeats: f64,
}

/// Number of regressions for light and background, each with the weights of the one before.
const REWEIGHTED: usize = 4;

/// The smallest part of its pixels that neighbors may leave to a particle, and to each of its images.
const LEAST: f64 = 0.5;
const LEAST_OF_IMAGE: f64 = 0.2;

impl Subject<'_> {
    /// Place of the fitted particle in the field, mm from its center.
    pub(super) fn place_of(&self, local: &Local) -> [f64; 2] {
        let mm_per_px = 1e-3 / self.instrument.px_per_um();
        [0, 1].map(|axis| self.place_mm[axis] + local[X + axis] * mm_per_px)
    }

    /// Whether neighbors leave enough of the images.
    pub(super) fn is_clear(&self) -> bool {
        let share = |mask: &Vec<bool>| mask.iter().filter(|used| **used).count() as f64 / mask.len() as f64;
        let shares: Vec<f64> = self.masks.iter().map(share).collect();
        let mean = shares.iter().sum::<f64>() / shares.len().max(1) as f64;
        mean >= LEAST && shares.iter().all(|share| *share >= LEAST_OF_IMAGE)
    }

    /// The data of the plane with this index among those used.
    fn data(&self, index: usize) -> Data {
        let (pixels, plane) = (&self.window.pixels, self.planes[index]);
        Data {
            counts: pixels.iter().map(|(at, _)| self.frames.planes[plane][*at]).collect(),
            used: self.masks.get(index).cloned().unwrap_or_else(|| vec![true; pixels.len()]),
            noise: self.frames.noise,
            repeats: self.frames.repeats[plane] as f64,
        }
    }

    /// Positions of pixels relative to the image of the particle, px.
    fn places(&self, local: &Local, depth_um: f64) -> Vec<[f64; 2]> {
        let px_per_um = self.instrument.px_per_um();
        let at = [0, 1].map(|axis| local[X + axis] + local[SLOPE + axis] * depth_um * px_per_um);
        self.window.pixels.iter().map(|(_, [dx, dy])| [dx - at[0], dy - at[1]]).collect()
    }

    /// Images per light, with derivatives along x and y, of all planes.
    fn images(&self, local: &Local, tolerance: f64) -> Result<Vec<Image>> {
        let stage = |plane: &usize| self.frames.stage_um[*plane];
        let depths: Vec<f64> =
            self.planes.iter().map(|plane| self.instrument.depth_um(local, stage(plane))).collect();
        let range = [
            depths.iter().copied().fold(f64::INFINITY, f64::min),
            depths.iter().copied().fold(f64::NEG_INFINITY, f64::max),
        ];
        let images = self.instrument.images(local, self.toward, range, self.half, tolerance)?;
        let image =
            |depth_um: &f64| (*depth_um, images.share_slopes(*depth_um, &self.places(local, *depth_um)));
        Ok(depths.par_iter().map(image).collect())
    }

    /// Misfit of images, with the weights of a fit: sum of squared residuals over variances.
    fn misfit(&self, images: &[Image], fit: &Fit) -> f64 {
        let of_plane = |(index, ((_, image), seen)): (usize, (&Image, &Seen))| {
            let shape: Vec<f64> = image.iter().map(|value| value[0]).collect();
            let counts = self.data(index).counts;
            let (light, background) = linear(&counts, &shape, &seen.roots);
            let pixels = counts.iter().zip(&shape).zip(&seen.roots);
            let residual =
                |((count, shape), root): ((&f64, &f64), &f64)| (count - light * shape - background) * root;
            pixels.map(|pixel| residual(pixel).powi(2)).sum::<f64>()
        };
        images.iter().zip(&fit.seen).enumerate().map(of_plane).sum()
    }

    /// Derivatives of images with respect to the quantities `free`, by differences.
    fn differences(
        &self,
        local: &Local,
        images: &[Image],
        free: &[usize],
        tolerance: f64,
    ) -> Result<Differences> {
        let of_quantity = |&quantity: &usize| -> Result<Vec<Vec<f64>>> {
            let step = QUANTITIES[quantity].1;
            if step == 0.0 {
                return Ok(Vec::new());
            }
            let mut other = *local;
            other[quantity] += step;
            let moved = self.images(&other, tolerance)?;
            let slope = |(a, b): (&[f64; 3], &[f64; 3])| (a[0] - b[0]) / step;
            let of_plane =
                |((_, moved), (_, image)): (&Image, &Image)| moved.iter().zip(image).map(slope).collect();
            Ok(moved.iter().zip(images).map(of_plane).collect())
        };
        Ok(Differences { at: *local, slopes: free.iter().map(of_quantity).collect::<Result<_>>()? })
    }

    /// Misfit and normal equations for the quantities `free` at a state.
    pub(super) fn fit_at(&self, local: &Local, free: &[usize], tolerance: f64) -> Result<Fit> {
        let (images, differences) = self.model(local, free, tolerance)?;
        Ok(self.normal(local, &images, &differences, free))
    }

    /// Images at a state with their derivatives.
    pub(super) fn model(
        &self,
        local: &Local,
        free: &[usize],
        tolerance: f64,
    ) -> Result<(Vec<Image>, Differences)> {
        let images = self.images(local, tolerance)?;
        let differences = self.differences(local, &images, free, tolerance)?;
        Ok((images, differences))
    }

    pub(super) fn normal(
        &self,
        local: &Local,
        images: &[Image],
        differences: &Differences,
        free: &[usize],
    ) -> Fit {
        let px_per_um = self.instrument.px_per_um();
        let n = free.len();
        let of_plane = |i: usize| {
            let data = self.data(i);
            let (depth_um, image) = &images[i];
            let shape: Vec<f64> = image.iter().map(|value| value[0]).collect();
            let seen = see(&data, &shape);
            let columns: Vec<Vec<f64>> = free
                .iter()
                .zip(&differences.slopes)
                .map(|(&quantity, slopes)| match slopes.get(i) {
                    Some(slopes) => slopes.clone(),
                    // Moving the particle moves pixels the other way.
                    None => {
                        let axis = if quantity < SLOPE { quantity - X } else { quantity - SLOPE };
                        let lever = if quantity < SLOPE { 1.0 } else { depth_um * px_per_um };
                        image.iter().map(|value| -lever * value[1 + axis]).collect()
                    }
                })
                .collect();
            let residual: Vec<f64> = data
                .counts
                .iter()
                .zip(&seen.model)
                .zip(&seen.roots)
                .map(|((count, model), root)| (count - model) * root)
                .collect();
            // What light and background cannot do.
            let scaled: Vec<Vec<f64>> = columns
                .iter()
                .map(|column| column.iter().map(|by| by * seen.light).collect::<Vec<f64>>())
                .map(|column| {
                    let (light, background) = linear(&column, &shape, &seen.roots);
                    let rest = column.iter().zip(&shape).zip(&seen.roots);
                    rest.map(|((by, shape), root)| (by - light * shape - background) * root).collect()
                })
                .collect();
            let mut matrix = vec![0.0; n * n];
            let mut right = vec![0.0; n];
            for a in 0..n {
                right[a] = dot(&scaled[a], &residual);
                for b in 0..=a {
                    matrix[a * n + b] = dot(&scaled[a], &scaled[b]);
                }
            }
            (seen, matrix, right)
        };
        let parts: Vec<(Seen, Vec<f64>, Vec<f64>)> =
            (0..self.planes.len()).into_par_iter().map(of_plane).collect();
        let (mut matrix, mut right, mut seen) = (Symmetric::zeros(n), vec![0.0; n], Vec::new());
        for (of_plane, part, of_right) in parts {
            seen.push(of_plane);
            for a in 0..n {
                right[a] += of_right[a];
                for b in 0..=a {
                    matrix.add(a, b, part[a * n + b]);
                    if a != b {
                        matrix.add(b, a, part[a * n + b]);
                    }
                }
            }
        }
        Fit { local: *local, seen, quadratic: Quadratic { matrix, right }, free: free.to_vec() }
    }

    /// The best values of the quantities `free`, from a start.
    pub(super) fn fit(&self, start: &Local, free: &[usize], tolerance: f64, steps: usize) -> Result<Fit> {
        let start = bounded(*start, self.largest_na());
        let (images, mut differences) = self.model(&start, free, tolerance)?;
        let mut fit = self.normal(&start, &images, &differences, free);
        let mut damping = 1e-3;
        for _ in 0..steps {
            let Some((next, images, decrease)) = self.step(&fit, &mut damping, tolerance)? else { break };
            let is_stale = |&quantity: &usize| {
                (next[quantity] - differences.at[quantity]).abs() > STALE * LONGEST[quantity]
            };
            if free.iter().any(is_stale) {
                differences = self.differences(&next, &images, free, tolerance)?;
            }
            fit = self.normal(&next, &images, &differences, free);
            if decrease < CONVERGED {
                break;
            }
        }
        Ok(fit)
    }

    /// The aperture of images that are wider than the window through half of the depth range. No aperture is as
    /// large, and the images of larger ones take long.
    pub(super) fn largest_na(&self) -> f64 {
        let stage = || self.planes.iter().map(|plane| self.frames.stage_um[*plane]);
        let (low, high) = (stage().fold(f64::INFINITY, f64::min), stage().fold(f64::NEG_INFINITY, f64::max));
        let reach_um = 1.5 * self.half as f64 / self.instrument.px_per_um();
        let tangent = reach_um / (0.5 * (high - low)).max(1e-3);
        (tangent / libm::sqrt(1.0 + tangent * tangent)).clamp(0.1, 0.95)
    }

    /// A step that reduces the misfit, its images, and by which part it does; `None` if there is none. The weights are those before the step:
    /// with weights of its own, a brighter model would seem to fit better.
    fn step(&self, fit: &Fit, damping: &mut f64, tolerance: f64) -> Result<Option<(Local, Vec<Image>, f64)>> {
        let before: f64 = fit.seen.iter().map(|seen| seen.chi2).sum();
        while *damping < 1e4 {
            let mut damped = fit.quadratic.matrix.clone();
            (0..damped.n()).for_each(|i| damped.add(i, i, *damping * damped.at(i, i) + 1e-9));
            if let Some(step) = damped.solve(&fit.quadratic.right) {
                let mut next = fit.local;
                for (&quantity, by) in fit.free.iter().zip(&step) {
                    next[quantity] += by.clamp(-LONGEST[quantity], LONGEST[quantity]);
                }
                let next = bounded(next, self.largest_na());
                let images = self.images(&next, tolerance)?;
                let after = self.misfit(&images, fit);
                if after < before {
                    *damping = (0.1 * *damping).max(1e-7);
                    return Ok(Some((next, images, 1.0 - after / before)));
                }
            }
            *damping *= 10.0;
        }
        Ok(None)
    }
}

/// Relative decrease of the misfit in a step at which a fit ends.
const CONVERGED: f64 = 2e-3;

/// Largest change of each quantity in a step.
const LONGEST: Local = [6.0, 1.5, 1.5, 0.05, 0.05, 0.06, 0.1, 0.06, 0.06, 0.06, 0.06, 0.06, 0.4, 0.3];

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

/// Light and background of the weighted sum of a shape and a constant that is nearest to counts.
fn linear(counts: &[f64], shape: &[f64], roots: &[f64]) -> (f64, f64) {
    let (mut ss, mut s1, mut w, mut cs, mut c1) = (0.0, 0.0, 0.0, 0.0, 0.0);
    for ((count, shape), root) in counts.iter().zip(shape).zip(roots) {
        let weight = root * root;
        ss += weight * shape * shape;
        s1 += weight * shape;
        w += weight;
        cs += weight * count * shape;
        c1 += weight * count;
    }
    let determinant = ss * w - s1 * s1;
    if determinant <= 1e-12 * ss * w {
        return (0.0, if w > 0.0 { c1 / w } else { 0.0 });
    }
    ((cs * w - c1 * s1) / determinant, (c1 * ss - cs * s1) / determinant)
}

/// Light and background of a plane. The variance of a pixel follows from the count of the model: from the observed count
/// (Neyman's chi-squared), pixels that are dark by chance weigh more, and light is lost at the rims of images.
fn see(data: &Data, shape: &[f64]) -> Seen {
    let weigh = |light: f64| -> Vec<f64> {
        let root = |shape: &f64| libm::sqrt(data.repeats / data.noise.variance(light * shape));
        let roots = shape.iter().map(root).zip(&data.used);
        roots.map(|(root, used)| if *used { root } else { 0.0 }).collect()
    };
    let mut roots = weigh(0.0);
    let (mut light, mut background) = linear(&data.counts, shape, &roots);
    for _ in 1..REWEIGHTED {
        roots = weigh(light);
        (light, background) = linear(&data.counts, shape, &roots);
    }
    let model: Vec<f64> = shape.iter().map(|shape| light * shape + background).collect();
    let used = || data.counts.iter().zip(&data.used).filter(|(_, used)| **used);
    let pixels = used().count();
    let mean = used().map(|(count, _)| count).sum::<f64>() / pixels.max(1) as f64;
    let (mut chi2, mut residual2, mut spread2) = (0.0, 0.0, 0.0);
    for ((count, model), root) in data.counts.iter().zip(&model).zip(&roots) {
        if *root == 0.0 {
            continue;
        }
        let residual = count - model;
        chi2 += residual * residual * root * root;
        residual2 += residual * residual;
        spread2 += (count - mean) * (count - mean);
    }
    Seen { light, background, model, chi2, pixels, roots, residual2, spread2 }
}

/// A start from the images themselves: focus where they are narrowest, the aperture from how fast they grow.
pub(super) fn start(subject: &Subject<'_>) -> Local {
    let Subject { instrument, frames, window, .. } = subject;
    let moments: Vec<(f64, f64, [f64; 2])> = subject
        .planes
        .iter()
        .enumerate()
        .map(|(index, &plane)| {
            let data = subject.data(index);
            let counts = data
                .counts
                .iter()
                .zip(&data.used)
                .map(|(count, used)| if *used { count - frames.background } else { 0.0 });
            let noise = 3.0 * libm::sqrt(frames.noise.variance(0.0) / frames.repeats[plane] as f64);
            let (mut sum, mut mean, mut square) = (0.0, [0.0; 2], 0.0);
            for (light, (_, [dx, dy])) in counts.zip(&window.pixels).filter(|(light, _)| *light > noise) {
                sum += light;
                mean[0] += light * dx;
                mean[1] += light * dy;
                square += light * (dx * dx + dy * dy);
            }
            let sum = f64::max(sum, 1e-9);
            let mean = mean.map(|m| m / sum);
            (frames.stage_um[plane], square / sum - mean[0] * mean[0] - mean[1] * mean[1], mean)
        })
        .collect();
    // r^2 = r0^2 + (s - focus)^2 tan^2 / 2, by least squares in 1, s and s^2.
    let mut system = Symmetric::zeros(3);
    let mut right = vec![0.0; 3];
    let middle = moments.iter().map(|m| m.0).sum::<f64>() / moments.len() as f64;
    for (stage, r2, _) in &moments {
        let powers = [1.0, stage - middle, (stage - middle) * (stage - middle)];
        for i in 0..3 {
            right[i] += r2 * powers[i];
            (0..3).for_each(|j| system.add(i, j, powers[i] * powers[j]));
        }
    }
    let [_, b, c] = system.solve(&right).and_then(|v| v.try_into().ok()).unwrap_or([1.0, 0.0, 0.01]);
    let c = f64::max(c, 1e-4);
    let tangent = libm::sqrt(2.0 * c) / instrument.px_per_um();
    let (least, most) = (moments[0].0, moments[moments.len() - 1].0);
    let narrowest = (middle - 0.5 * b / c).clamp(least.min(most), least.max(most));
    let nearest = moments
        .iter()
        .min_by(|a, b| (a.0 - narrowest).abs().total_cmp(&(b.0 - narrowest).abs()))
        .map_or([0.0; 2], |m| m.2);
    let mut local = [0.0; COUNT];
    local[FOCUS] = narrowest;
    local[X] = nearest[0];
    local[Y] = nearest[1];
    local[super::local::NA] = (tangent / libm::sqrt(1.0 + tangent * tangent)).clamp(0.05, 0.9);
    local[super::local::MERIDIONAL] = 1.0;
    local[BLUR] = 0.4 / instrument.px_per_um();
    local
}
