//! The fit of one particle's images.
//!
//! The light of each image and its background are linear and eliminated (variable projection: Golub and
//! Pereyra 1973, SIAM J. Numer. Anal. 10, 413, in Kaufman's approximation); Levenberg's and Marquardt's steps
//! do the rest.

use rayon::prelude::*;

use super::evenly;
use super::frames::Frames;
use super::local::{
    ASTIGMATISM, BLUR, COUNT, DIAMETER, FOCUS, Instrument, Local, MERIDIONAL, NA, QUANTITIES, SLOPE,
    SPHERICAL, X, Y, bounded,
};
use crate::noise::Pixel;
use crate::particles::Window;
use crate::state::Noise;
use microsig_core::linear::Symmetric;
use storage::error::Result;

/// Initial apertures. Larger ones than one that is worse than a smaller one by this factor are not tried.
const MUCH_WORSE: f64 = 1.3;
const APERTURES: [f64; 9] = [0.1, 0.15, 0.22, 0.32, 0.45, 0.6, 0.75, 0.87, 0.95];

/// Relative difference from which two apertures are different starts.
const OTHER: f64 = 0.1;

/// Number of planes in which starts are compared, of the best that are improved, of steps to do so, and of those in which two
/// different ones reach their minima.
const FEW_PLANES: usize = 9;
const IMPROVED: usize = 2;
const STEPS_OF_STARTS: usize = 2;
const STEPS_OF_TWO: usize = 12;
/// They show the particle, with at least this part of the brightest peak and this multiple of the faintest, if there are as many.
const VISIBLE: f64 = 0.05;
const ABOVE_FAINTEST: f64 = 2.0;
const FEWEST_PLANES: usize = 5;

/// Errors of images in the first steps and in the last ones, relative to the peak.
pub(super) const COARSE: f64 = 0.03;
pub(super) const FINE: f64 = 0.008;

/// A particle of a scan.
#[derive(Debug)]
pub(super) struct Subject<'a> {
    pub(super) instrument: &'a Instrument,
    pub(super) frames: &'a Frames,
    /// Variance of a count in one frame.
    pub(super) noise: Noise,
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
    /// Sums of squared residuals, of squared deviations from the mean, and of variances of the noise, counts^2.
    pub(super) residual2: f64,
    pub(super) spread2: f64,
    pub(super) noise2: f64,
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

    /// The same of the variance that is not noise.
    pub(super) fn r2_of_signal(&self) -> f64 {
        let sum = |of: fn(&Seen) -> f64| self.seen.iter().map(of).sum::<f64>();
        let noise2 = sum(|seen| seen.noise2);
        1.0 - (sum(|seen| seen.residual2) - noise2) / (sum(|seen| seen.spread2) - noise2).max(1e-9)
    }

    /// Number of pixels that are used.
    pub(super) fn pixels(&self) -> usize {
        self.seen.iter().map(|seen| seen.pixels).sum()
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
            noise: self.noise,
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
        let start = bounded(*start);
        let (images, mut differences) = self.model(&start, free, tolerance)?;
        let mut fit = self.normal(&start, &images, &differences, free);
        let mut damping = 1e-3;
        for step in 1..=steps {
            let Some((next, images, decrease)) = self.step(&fit, &mut damping, tolerance)? else { break };
            let is_last = step == steps || decrease * (fit.pixels() as f64) < CONVERGED;
            let longest = self.longest(&next);
            let is_stale = |&quantity: &usize| {
                (next[quantity] - differences.at[quantity]).abs() > STALE * longest[quantity]
            };
            if !is_last && free.iter().any(is_stale) {
                differences = self.differences(&next, &images, free, tolerance)?;
            }
            fit = self.normal(&next, &images, &differences, free);
            if is_last {
                break;
            }
        }
        Ok(fit)
    }

    /// A start from which a fit converges: the best of several apertures, in focus in the brightest image or, as the widths of
    /// images tell, where these are narrowest. Only some planes are compared.
    pub(super) fn best_start(&self) -> Result<Local> {
        let few = self.of_few_planes();
        let free: Vec<usize> = [FOCUS, X, Y, NA, BLUR, DIAMETER, ASTIGMATISM, ASTIGMATISM + 1, SPHERICAL]
            .into_iter()
            .filter(|quantity| self.instrument.free.contains(quantity))
            .collect();
        let narrowest = start(self);
        let mut tried = vec![few.fit(&narrowest, &[], COARSE, 0)?];
        let mut least = f64::INFINITY;
        for na in APERTURES {
            let mut start = narrowest;
            start[FOCUS] = self.sharpest().0;
            start[NA] = na;
            if free.contains(&DIAMETER) {
                start[DIAMETER] = self.instrument.resolved_um(na);
            }
            let fit = few.fit(&start, &[], COARSE, 0)?;
            let chi2 = fit.chi2();
            tried.push(fit);
            // The images of larger apertures take long.
            if chi2 > MUCH_WORSE * least {
                break;
            }
            least = chi2.min(least);
        }
        let mut improved: Vec<Fit> = best_first(tried)
            .iter()
            .take(IMPROVED)
            .map(|start| few.fit(&start.local, &free, COARSE, STEPS_OF_STARTS))
            .collect::<Result<_>>()?;
        improved = best_first(improved);
        let best = improved.remove(0);
        // Another aperture that is nearly as good may lead to a better minimum.
        let is_rival = |fit: &&Fit| {
            fit.chi2() < MUCH_WORSE * best.chi2() && (fit.local[NA] / best.local[NA] - 1.0).abs() > OTHER
        };
        let Some(rival) = improved.iter().find(is_rival) else { return Ok(best.local) };
        let end = |start: &Fit| few.fit(&start.local, &self.instrument.free, COARSE, STEPS_OF_TWO);
        Ok(best_first(vec![end(&best)?, end(rival)?]).remove(0).local)
    }

    /// The same particle in some planes in which it is visible.
    fn of_few_planes(&self) -> Self {
        let visible = self.visible();
        let some: Vec<usize> = evenly(visible.len(), FEW_PLANES).into_iter().map(|i| visible[i]).collect();
        Subject {
            planes: some.iter().map(|i| self.planes[*i]).collect(),
            masks: some.iter().filter_map(|i| self.masks.get(*i).cloned()).collect(),
            window: self.window.clone(),
            ..*self
        }
    }

    /// The planes whose images are far above the noise, or the brightest.
    fn visible(&self) -> Vec<usize> {
        let peaks: Vec<f64> = self.peaks().iter().map(|(peak, _)| *peak).collect();
        let least = peaks.iter().copied().fold(f64::INFINITY, f64::min);
        let most = peaks.iter().copied().fold(0.0, f64::max);
        let limit = (VISIBLE * most).max(ABOVE_FAINTEST * least);
        let visible: Vec<usize> = (0..peaks.len()).filter(|&i| peaks[i] > limit).collect();
        if visible.len() >= FEWEST_PLANES {
            return visible;
        }
        let mut brightest: Vec<usize> = (0..peaks.len()).collect();
        brightest.sort_by(|&a, &b| peaks[b].total_cmp(&peaks[a]));
        brightest.truncate(FEWEST_PLANES);
        brightest.sort_unstable();
        brightest
    }

    /// Stage position of the plane with the brightest square, um, and its place.
    pub(super) fn sharpest(&self) -> (f64, [f64; 2]) {
        let of_planes = self.planes.iter().zip(self.peaks());
        let brightest = of_planes.max_by(|(_, (a, _)), (_, (b, _))| a.total_cmp(b));
        brightest.map_or((0.0, [0.0; 2]), |(plane, (_, place))| (self.frames.stage_um[*plane], place))
    }

    /// Counts above the background of the brightest square of three pixels near the middle, and its place, by plane.
    fn peaks(&self) -> Vec<(f64, [f64; 2])> {
        let near = |[dx, dy]: [f64; 2]| dx.abs().max(dy.abs()) < 0.5 * self.half as f64;
        let edge = 2 * self.half + 1;
        let peak = |index: usize| {
            let Data { counts, used, .. } = self.data(index);
            let square = |at: usize| -> f64 {
                [at - edge, at, at + edge]
                    .iter()
                    .map(|row| counts[row - 1..=row + 1].iter().sum::<f64>())
                    .sum()
            };
            let middle = (0..counts.len()).filter(|at| used[*at] && near(self.window.pixels[*at].1));
            middle
                .map(|at| (square(at) - 9.0 * self.frames.background, self.window.pixels[at].1))
                .fold((0.0, [0.0; 2]), |most, next| if next.0 > most.0 { next } else { most })
        };
        (0..self.planes.len()).map(peak).collect()
    }

    /// Stage positions of the planes, from and to, um.
    fn range_um(&self) -> [f64; 2] {
        let stage = || self.planes.iter().map(|plane| self.frames.stage_um[*plane]);
        [stage().fold(f64::INFINITY, f64::min), stage().fold(f64::NEG_INFINITY, f64::max)]
    }

    /// Largest changes of the quantities in a step.
    fn longest(&self, local: &Local) -> Local {
        let [low, high] = self.range_um();
        let mut longest = LONGEST;
        longest[FOCUS] = LONGEST[FOCUS].min(0.2 * (high - low));
        longest[DIAMETER] = 0.3 * local[DIAMETER];
        longest
    }

    /// The pixels of a fit, to tell the noise of one frame from errors of the model.
    pub(super) fn residuals(&self, fit: &Fit) -> Vec<Pixel> {
        let of_plane = |(index, seen): (usize, &Seen)| {
            let data = self.data(index);
            let residual =
                |at: usize| (data.used[at] && seen.roots[at] > 0.0).then(|| data.counts[at] - seen.model[at]);
            let mut products = vec![(0.0, 0.0); data.counts.len()];
            for &(a, b) in &self.window.neighbors {
                if let (Some(first), Some(second)) = (residual(a), residual(b)) {
                    for at in [a, b] {
                        products[at].0 += first * second;
                        products[at].1 += 1.0;
                    }
                }
            }
            let pixel = |(at, (sum, n)): (usize, (f64, f64))| {
                let residual = residual(at)?;
                let light = (seen.model[at] - seen.background).max(0.0);
                Some(Pixel { light, square: residual * residual, shared: sum / f64::max(n, 1.0) })
            };
            products.into_iter().enumerate().filter_map(pixel).collect::<Vec<_>>()
        };
        fit.seen.iter().enumerate().flat_map(of_plane).collect()
    }

    /// A step that reduces the misfit, its images, and by which part it does; `None` if there is none. The weights are those before the step:
    /// with weights of its own, a brighter model would seem to fit better.
    fn step(&self, fit: &Fit, damping: &mut f64, tolerance: f64) -> Result<Option<(Local, Vec<Image>, f64)>> {
        let before: f64 = fit.seen.iter().map(|seen| seen.chi2).sum();
        while *damping < 1e4 {
            let mut damped = fit.quadratic.matrix.clone();
            (0..damped.n()).for_each(|i| damped.add(i, i, *damping * damped.at(i, i) + 1e-9));
            if let Some(step) = damped.solve(&fit.quadratic.right) {
                let (mut next, longest) = (fit.local, self.longest(&fit.local));
                for (&quantity, by) in fit.free.iter().zip(&step) {
                    next[quantity] += by.clamp(-longest[quantity], longest[quantity]);
                }
                let next = bounded(next);
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

/// Decrease of the misfit in a step at which a fit ends, if the misfit per pixel is 1. Where quantities nearly compensate each
/// other, as aperture and transmission do, a decrease by one is a step of one standard deviation.
const CONVERGED: f64 = 0.1;

/// Largest change of each quantity in a step; see [`Subject::longest`].
const LONGEST: Local = [6.0, 1.5, 1.5, 0.05, 0.05, 0.06, 0.1, 0.06, 0.06, 0.06, 0.06, 0.06, 0.4, 0.3, 0.4];

fn best_first(mut fits: Vec<Fit>) -> Vec<Fit> {
    fits.sort_by(|a, b| a.chi2().total_cmp(&b.chi2()));
    fits
}

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
    let (mut chi2, mut residual2, mut spread2, mut noise2) = (0.0, 0.0, 0.0, 0.0);
    for ((count, model), root) in data.counts.iter().zip(&model).zip(&roots) {
        if *root == 0.0 {
            continue;
        }
        let residual = count - model;
        chi2 += residual * residual * root * root;
        residual2 += residual * residual;
        spread2 += (count - mean) * (count - mean);
        noise2 += 1.0 / (root * root);
    }
    Seen { light, background, model, chi2, pixels, roots, residual2, spread2, noise2 }
}

/// A start from the images themselves: focus where they are narrowest, the aperture from how fast they grow.
pub(super) fn start(subject: &Subject<'_>) -> Local {
    let Subject { instrument, frames, window, .. } = subject;
    let moments: Vec<(f64, f64)> = subject
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
            (frames.stage_um[plane], square / sum - mean[0] * mean[0] - mean[1] * mean[1])
        })
        .collect();
    // r^2 = r0^2 + (s - focus)^2 tan^2 / 2, by least squares in 1, s and s^2.
    let mut system = Symmetric::zeros(3);
    let mut right = vec![0.0; 3];
    let middle = moments.iter().map(|m| m.0).sum::<f64>() / moments.len() as f64;
    for (stage, r2) in &moments {
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
    let mut local = [0.0; COUNT];
    local[FOCUS] = narrowest;
    [local[X], local[Y]] = subject.sharpest().1;
    local[NA] = (tangent / libm::sqrt(1.0 + tangent * tangent)).clamp(0.05, 0.9);
    local[MERIDIONAL] = 1.0;
    match instrument.diameter_um {
        Some(diameter_um) => {
            local[DIAMETER] = diameter_um;
            local[BLUR] = 0.4 / instrument.px_per_um();
        }
        None => local[DIAMETER] = instrument.resolved_um(local[NA]),
    }
    local
}
