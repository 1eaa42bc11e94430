//! Position, depth, axis and, if it is not given, aspect ratio of spheroids by maximum likelihood (`mle --shape
//! spheroid`).
//!
//! Templates averaged over all directions of the axis find the particles. Each is then fitted from several axes: those
//! whose images resemble it most, and their mirror images toward and away from the lens, which look alike at some
//! depths. The fit is that of Levenberg and Marquardt, with derivatives that are updated from image to image
//! (Broyden 1965, Math. Comput. 19, 577), and computed once more at the end, for the covariance. By rays, the way there
//! goes by drafts of the images, and only the last fit by exact ones. Overlapping particles are fitted in turn, each
//! with the others subtracted, until they no longer move.

use glam::DVec3;
use microsig_core::cancel::checkpoint;

use super::denoise::PixelNoise;
use super::gray_image::GrayImage;
use super::job::Job;
use super::joint_fit::Equations;
use super::locate::Locator;
use super::mle::{self, Detail, OfSpheroids, ShapeImages};
use super::output::Output;
use super::shape_templates::{angle, averaged, axes, mirrored};
use super::templates::Templates;
use super::{Localization, ParticleShape, ShapeEstimate, ShapeUncertainty};
use storage::error::Result;

/// Axes from which starts are chosen, and how many of them; those of templates, and the depths of these.
const AXES: usize = 24;
const STARTS: usize = 2;
const AXES_OF_TEMPLATES: usize = 12;
const DEPTHS_OF_TEMPLATES: usize = 28;

/// Aspect ratios from which fits start if it is not given.
const ASPECTS: [f64; 2] = [0.5, 2.0];

/// Largest aspect ratio for whose images there is room if it is not given.
const LONGEST: f64 = 3.0;

/// Axes closer than this are the same start, or the same result, rad.
const SAME_AXIS: f64 = 0.35;

/// So are depths closer than this, um.
const SAME_UM: f64 = 3.0;

/// Averaged images at depths on both sides of the focus are alike from this correlation on, if it falls by this much
/// between them.
const ALIKE: f64 = 0.75;
const FALL: f64 = 0.01;

/// Relative error of averaged templates, and of images.
pub(super) const TEMPLATE_ERROR: f32 = 0.3;
const MODEL_ERROR: f64 = 0.01;

/// Iterations of a fit, rounds over overlapping particles, and the reduction of chi^2 at which a fit ends.
const ITERATIONS: usize = 14;
const ROUNDS: usize = 3;
const CONVERGED: f64 = 0.02;

/// Largest change of a parameter in one iteration: brightness (relative), px, px, um, rad, rad, logarithm.
const LARGEST: [f64; 7] = [0.5, 1.0, 1.0, 3.0, 0.35, 0.35, 0.25];

/// A second axis is reported down to this likelihood relative to the first.
const LEAST_LIKELIHOOD: f64 = 1e-3;

/// Least significance, and brightness relative to the calibration particle, of a particle.
pub(super) const LEAST_SIGNIFICANCE: f64 = 8.0;
pub(super) const BRIGHTNESS: std::ops::RangeInclusive<f64> = 0.25..=4.0;

/// A spheroid.
#[derive(Debug, Clone, Copy)]
pub(super) struct Pose {
    /// Relative to the center of the first pixel, px.
    pub(super) at: [f64; 2],
    pub(super) z_um: f64,
    /// Unit vector up to its sign (x right, y down, z away from the lens).
    pub(super) axis: DVec3,
    pub(super) e_p: f64,
    /// Brightness relative to a calibration particle of this shape.
    pub(super) brightness: f64,
}

/// A fitted spheroid.
#[derive(Debug, Clone)]
struct Found {
    pose: Pose,
    chi2_reduction: f64,
    /// Standard deviations of x, y (px), z (um), and of the logarithm of the aspect ratio if it is fitted.
    deviations: [f64; 4],
    /// Variances of turns of the axis toward two directions, and their covariance, rad^2.
    turns: [DVec3; 2],
    covariance: [f64; 3],
    other: Option<(f64, DVec3, f64)>,
}

/// Tracks spheroids; `aspect`: polar over equatorial diameter, fitted if it is not given.
pub(super) fn particles(job: &Job, aspect: Option<f64>) -> Result<Output> {
    let OfSpheroids { images, noise } = mle::shape_images(job, aspect.unwrap_or(LONGEST).max(1.0))?;
    let aspects = aspect.map_or(ASPECTS.to_vec(), |aspect| vec![aspect]);
    let templates = averaged(&images, &aspects, [DEPTHS_OF_TEMPLATES, AXES_OF_TEMPLATES], noise);
    let opposite = Opposite::new(&templates);
    let locator = Locator::new(vec![(templates.clone(), templates)], TEMPLATE_ERROR, noise);
    job.particles(|frame| frame_of(frame, (&images, &opposite), aspect, noise.gain, &locator.find(frame).0))
}

/// For each depth, that on the other side of the focus with the most similar averaged image.
struct Opposite {
    depths_um: Vec<f64>,
    other_um: Vec<Option<f64>>,
    /// Midpoint and half the separation of the closest such pair, um. Nearer to focus, averaged images hardly change with
    /// depth, and the other side is taken to be the reflection about the midpoint.
    middle: Option<(f64, f64)>,
}

impl Opposite {
    fn new(templates: &Templates) -> Self {
        let n = templates.len();
        let product = |j: usize, k: usize| -> f64 {
            let pixels = templates.image(j).counts.iter().zip(&templates.image(k).counts);
            pixels.map(|(a, b)| f64::from(a * b)).sum()
        };
        let own: Vec<f64> = (0..n).map(|k| product(k, k)).collect();
        let other = |k: usize| {
            let alike: Vec<f64> = (0..n).map(|j| product(j, k) / (own[j] * own[k]).sqrt()).collect();
            let lowest = |j: usize| alike[j.min(k)..=j.max(k)].iter().copied().fold(1.0, f64::min);
            let others = (0..n).filter(|&j| alike[j] > ALIKE && lowest(j) < alike[j] - FALL);
            others.max_by(|&a, &b| alike[a].total_cmp(&alike[b])).map(|j| templates.depth_um(j))
        };
        let depths_um: Vec<f64> = (0..n).map(|k| templates.depth_um(k)).collect();
        let other_um: Vec<Option<f64>> = (0..n).map(other).collect();
        let pairs = depths_um.iter().zip(&other_um).filter_map(|(z, other)| other.map(|other| [*z, other]));
        let closest = pairs.min_by(|a, b| (a[1] - a[0]).abs().total_cmp(&(b[1] - b[0]).abs()));
        let middle = closest.map(|[z, other]| (0.5 * (z + other), 0.5 * (z - other).abs()));
        Opposite { depths_um, other_um, middle }
    }

    fn of(&self, z_um: f64) -> Option<f64> {
        if let Some((middle, _)) = self.middle.filter(|(middle, half)| (z_um - middle).abs() < *half) {
            return Some(2.0 * middle - z_um);
        }
        let away = |k: &usize| (self.depths_um[*k] - z_um).abs();
        let nearest = (0..self.depths_um.len()).min_by(|a, b| away(a).total_cmp(&away(b)))?;
        self.other_um[nearest]
    }
}

/// The spheroids of a frame near those of the search.
fn frame_of(
    frame: &GrayImage,
    (images, opposite): (&ShapeImages, &Opposite),
    aspect: Option<f64>,
    gain: f32,
    coarse: &[Localization],
) -> Vec<Localization> {
    let (level, deviation) = frame.background();
    let noise = PixelNoise::new(deviation.powi(2), gain);
    let mut residual: Vec<f64> = frame.counts.iter().map(|c| f64::from(c - level)).collect();
    let size = [frame.width as isize, frame.height as isize];
    let fit = Fit { images, opposite, aspect, noise, size };
    let mut found: Vec<Found> = Vec::new();
    for place in coarse {
        let at = [place.x_px - 1.0, place.y_px - 1.0];
        if let Some(particle) = fit.first(&residual, at, place.z_um.unwrap_or(0.0)) {
            fit.add(&mut residual, &particle.pose, -1.0);
            found.push(particle);
        }
    }
    for _ in 1..ROUNDS {
        let mut moved = false;
        for k in 0..found.len() {
            if !found.iter().enumerate().any(|(j, other)| j != k && fit.overlap(&found[k].pose, &other.pose))
            {
                continue;
            }
            fit.add(&mut residual, &found[k].pose, 1.0);
            if let Some(again) =
                fit.near(&residual, &found[k].pose).and_then(|found| fit.finished(&residual, found))
            {
                moved |= angle(again.pose.axis, found[k].pose.axis) > 0.01
                    || (again.pose.z_um - found[k].pose.z_um).abs() > 0.05;
                found[k] = Found { other: found[k].other, ..again };
            }
            fit.add(&mut residual, &found[k].pose, -1.0);
        }
        if !moved {
            break;
        }
    }
    let inside = |found: &&Found| {
        (0..2).all(|axis| (-0.5..size[axis] as f64 - 0.5).contains(&found.pose.at[axis]))
            && found.chi2_reduction > LEAST_SIGNIFICANCE.powi(2)
            && BRIGHTNESS.contains(&found.pose.brightness)
    };
    found.iter().filter(inside).map(|found| found.localization(aspect.is_none())).collect()
}

impl Found {
    fn localization(&self, with_aspect: bool) -> Localization {
        let [uu, vv, uv] = self.covariance;
        let (mean, half) = (0.5 * (uu + vv), (0.25 * (uu - vv).powi(2) + uv * uv).sqrt());
        let turn = 0.5 * (2.0 * uv).atan2(uu - vv);
        let [u, v] = self.turns;
        let [x, y, z, aspect] = self.deviations;
        let shape = ShapeEstimate {
            axis: self.pose.axis,
            aspect: with_aspect.then_some(self.pose.e_p),
            uncertainty: Some(ShapeUncertainty {
                deviations: [x, y, z],
                axis_deviations: [(mean + half).sqrt(), (mean - half).max(0.0).sqrt()],
                uncertain: turn.cos() * u + turn.sin() * v,
                other: self.other,
                aspect: self.pose.e_p * aspect,
            }),
        };
        let [x_px, y_px] = self.pose.at.map(|at| at + 1.0);
        Localization { x_px, y_px, z_um: Some(self.pose.z_um), shape: Some(shape) }
    }
}

/// What all fits in a frame have in common.
struct Fit<'a> {
    images: &'a ShapeImages,
    opposite: &'a Opposite,
    aspect: Option<f64>,
    noise: PixelNoise,
    size: [isize; 2],
}

/// Pixels around a particle.
struct Region {
    middle: [isize; 2],
    radius: usize,
    data: Vec<f64>,
    /// Inverse variances; 0 outside the frame.
    weight: Vec<f64>,
}

impl Region {
    fn chi2(&self, light: &[f64], brightness: f64) -> f64 {
        let pixels = self.data.iter().zip(&self.weight).zip(light);
        pixels.map(|((data, weight), light)| weight * (data - brightness * light).powi(2)).sum()
    }

    /// Brightness that fits best, and the reduction of chi^2 by an image of it.
    fn matched(&self, light: &[f64]) -> (f64, f64) {
        let (mut own, mut both) = (0.0, 0.0);
        for ((data, weight), light) in self.data.iter().zip(&self.weight).zip(light) {
            own += weight * light * light;
            both += weight * light * data;
        }
        if own > 0.0 && both > 0.0 { (both / own, both * both / own) } else { (0.0, 0.0) }
    }
}

/// A fit on its way: derivatives of the image at brightness 1, and the axis they were computed at.
struct State {
    pose: Pose,
    light: Vec<f64>,
    chi2: f64,
    /// For each pixel, derivatives with respect to x, y, z, turns, logarithm of the aspect ratio.
    slopes: Vec<[f64; 6]>,
    axis: DVec3,
    turns: [DVec3; 2],
    /// Turns since then.
    turned: [f64; 2],
}

impl Fit<'_> {
    fn overlap(&self, a: &Pose, b: &Pose) -> bool {
        let reach = (self.images.radius_at(a.z_um) + self.images.radius_at(b.z_um)) as f64;
        (0..2).all(|axis| (a.at[axis] - b.at[axis]).abs() < reach)
    }

    fn add(&self, residual: &mut [f64], pose: &Pose, sign: f64) {
        let middle = pose.at.map(|at| at.round() as isize);
        let radius = self.images.radius_at(pose.z_um);
        let light = self.images.light(pose, middle, radius, Detail::Full);
        for (light, i) in light.iter().zip(self.pixels(middle, radius)) {
            if let Some(i) = i {
                residual[i] += sign * pose.brightness * light;
            }
        }
    }

    /// Indices of the pixels of a square; `None` outside the frame.
    fn pixels(&self, middle: [isize; 2], radius: usize) -> impl Iterator<Item = Option<usize>> + use<> {
        let (r, [w, h]) = (radius as isize, self.size);
        let inside = move |x: isize, y: isize| {
            ((0..w).contains(&x) && (0..h).contains(&y)).then_some((y * w + x) as usize)
        };
        (-r..=r).flat_map(move |y| (-r..=r).map(move |x| inside(middle[0] + x, middle[1] + y)))
    }

    /// The region of a particle, weighted by the noise of its light.
    fn region(&self, residual: &[f64], pose: &Pose) -> Region {
        let middle = pose.at.map(|at| at.round() as isize);
        let radius = self.images.radius_at(pose.z_um);
        let light = self.images.light(pose, middle, radius, Detail::Draft);
        let (mut data, mut weight) = (Vec::new(), Vec::new());
        for (light, i) in light.iter().zip(self.pixels(middle, radius)) {
            let light = pose.brightness * light;
            let variance = f64::from(self.noise.variance(light as f32)) + (MODEL_ERROR * light).powi(2);
            data.push(i.map_or(0.0, |i| residual[i]));
            weight.push(i.map_or(0.0, |_| 1.0 / variance));
        }
        Region { middle, radius, data, weight }
    }

    /// The best fit near a place, with a second axis if there is one.
    fn first(&self, residual: &[f64], at: [f64; 2], z_um: f64) -> Option<Found> {
        let [low, high] = self.images.depths_um();
        let z_um = z_um.clamp(low, high);
        let aspects = self.aspect.map_or(ASPECTS.to_vec(), |aspect| vec![aspect]);
        let tried = axes(AXES).flat_map(|axis| aspects.iter().map(move |e_p| (axis, *e_p)));
        let mut starts: Vec<(f64, Pose)> = Vec::new();
        let mut region: Option<Region> = None;
        for (axis, e_p) in tried {
            checkpoint();
            let mut pose = Pose { at, z_um, axis, e_p, brightness: 1.0 };
            let region = region.get_or_insert_with(|| self.region(residual, &pose));
            let (brightness, reduction) =
                region.matched(&self.images.light(&pose, region.middle, region.radius, Detail::Draft));
            pose.brightness = brightness;
            starts.push((reduction, pose));
        }
        starts.retain(|(reduction, _)| *reduction > 0.0);
        starts.sort_by(|a, b| b.0.total_cmp(&a.0));
        let mut apart: Vec<Pose> = Vec::new();
        for (_, pose) in starts {
            if apart.len() < STARTS
                && apart.iter().all(|other| angle(pose.axis, other.axis) > 1.2 * SAME_AXIS)
            {
                apart.push(pose);
            }
        }
        let best = *apart.first()?;
        let mirrored = |pose: &Pose| Pose { axis: mirrored(pose.axis), ..*pose };
        // All compared with the same weights.
        let region = self.region(residual, &best);
        let mut fitted: Vec<State> =
            apart.iter().filter_map(|start| self.refined(&region, start, Detail::Draft)).collect();
        fitted.sort_by(|a, b| a.chi2.total_cmp(&b.chi2));
        let mirror = mirrored(&fitted.first()?.pose);
        if fitted.iter().all(|state| angle(state.pose.axis, mirror.axis) > SAME_AXIS) {
            fitted.extend(self.refined(&region, &mirror, Detail::Draft));
            fitted.sort_by(|a, b| a.chi2.total_cmp(&b.chi2));
        }
        let first = fitted[0].pose;
        if let Some(z_um) = self.opposite.of(first.z_um) {
            for start in [first, mirrored(&first)] {
                fitted.extend(self.refined(&region, &Pose { z_um, ..start }, Detail::Draft));
            }
            fitted.sort_by(|a, b| a.chi2.total_cmp(&b.chi2));
        }
        let first = &fitted[0];
        let is_other = |state: &&State| {
            angle(state.pose.axis, first.pose.axis) > SAME_AXIS
                || (state.pose.z_um - first.pose.z_um).abs() > SAME_UM
        };
        let other = fitted[1..].iter().find(is_other);
        let other =
            other.map(|other| (other.pose.z_um, other.pose.axis, (0.5 * (first.chi2 - other.chi2)).exp()));
        let other = other.filter(|(_, _, likelihood)| *likelihood > LEAST_LIKELIHOOD);
        let found = self.near(residual, &first.pose)?;
        Some(Found { other, ..self.finished(residual, found)? })
    }

    /// The best fit from a start, weighted by its own light.
    fn near(&self, residual: &[f64], start: &Pose) -> Option<Pose> {
        self.refined(&self.region(residual, start), start, Detail::Full).map(|state| state.pose)
    }

    fn state(&self, region: &Region, pose: Pose, detail: Detail) -> Option<State> {
        let (pixels, turns) = self.images.gradient(&pose, region.middle, region.radius, detail)?;
        let light: Vec<f64> = pixels.iter().map(|pixel| pixel[0]).collect();
        let slopes = pixels.iter().map(|pixel| std::array::from_fn(|p| pixel[1 + p])).collect();
        let chi2 = region.chi2(&light, pose.brightness);
        Some(State { pose, light, chi2, slopes, axis: pose.axis, turns, turned: [0.0; 2] })
    }

    fn parameters(&self) -> usize {
        if self.aspect.is_some() { 6 } else { 7 }
    }

    /// Normal equations for changes of brightness, x, y, z, turns and the logarithm of the aspect ratio.
    fn equations(&self, region: &Region, state: &State) -> Equations {
        let n = self.parameters();
        let (mut matrix, mut right) = (vec![0.0; n * n], vec![0.0; n]);
        let brightness = state.pose.brightness;
        for (i, slopes) in state.slopes.iter().enumerate().filter(|(i, _)| region.weight[*i] > 0.0) {
            let mut by = [0.0; 7];
            by[0] = state.light[i];
            (0..6).for_each(|p| by[1 + p] = brightness * slopes[p]);
            let (weight, rest) = (region.weight[i], region.data[i] - brightness * state.light[i]);
            for k in 0..n {
                right[k] += weight * by[k] * rest;
                for l in 0..=k {
                    matrix[k * n + l] += weight * by[k] * by[l];
                }
            }
        }
        Equations { matrix, right }
    }

    /// Levenberg-Marquardt from a start.
    fn refined(&self, region: &Region, start: &Pose, detail: Detail) -> Option<State> {
        let mut now = self.state(region, *start, detail)?;
        let mut damping = 1e-2;
        for _ in 0..ITERATIONS {
            checkpoint();
            let Some(change) = self.equations(region, &now).solved(damping) else { break };
            let (pose, turned, change) = self.moved(&now, &change);
            let light = self.images.light(&pose, region.middle, region.radius, detail);
            let chi2 = region.chi2(&light, pose.brightness);
            if chi2 >= now.chi2 {
                damping *= 10.0;
                if chi2 - now.chi2 < CONVERGED || damping > 1e4 {
                    break;
                }
                continue;
            }
            let gained = now.chi2 - chi2;
            damping = (0.2 * damping).max(1e-6);
            now.update(region, &light, &change);
            (now.pose, now.light, now.chi2, now.turned) = (pose, light, chi2, turned);
            if gained < CONVERGED {
                break;
            }
        }
        Some(now)
    }

    /// The pose after a change, the turns from the axis of the derivatives, and the change that was made.
    fn moved(&self, state: &State, change: &[f64]) -> (Pose, [f64; 2], [f64; 7]) {
        let [low, high] = self.images.depths_um();
        let mut made = [0.0; 7];
        made.iter_mut()
            .zip(change)
            .zip(LARGEST)
            .for_each(|((made, change), most)| *made = change.clamp(-most, most));
        let pose = state.pose;
        made[0] = change[0].clamp(-LARGEST[0] * pose.brightness, LARGEST[0] * pose.brightness);
        let z_um = (pose.z_um + made[3]).clamp(low, high);
        made[3] = z_um - pose.z_um;
        let turned = [state.turned[0] + made[4], state.turned[1] + made[5]];
        let axis = (state.axis + turned[0] * state.turns[0] + turned[1] * state.turns[1]).normalize();
        let moved = Pose {
            at: [pose.at[0] + made[1], pose.at[1] + made[2]],
            z_um,
            axis,
            e_p: (pose.e_p * made[6].exp())
                .clamp(*ParticleShape::ASPECTS.start(), *ParticleShape::ASPECTS.end()),
            brightness: pose.brightness + made[0],
        };
        (moved, turned, made)
    }

    /// A fit with its covariance, by derivatives at its end.
    fn finished(&self, residual: &[f64], pose: Pose) -> Option<Found> {
        let region = self.region(residual, &pose);
        let state = self.state(&region, pose, Detail::Full)?;
        let n = self.parameters();
        let Equations { matrix, .. } = self.equations(&region, &state);
        let column = |k: usize| {
            let right = (0..n).map(|i| if i == k { 1.0 } else { 0.0 }).collect();
            Equations { matrix: matrix.clone(), right }.solved(1e-9)
        };
        let columns: Option<Vec<Vec<f64>>> = (0..n).map(column).collect();
        let columns = columns?;
        let deviation = |k: usize| columns[k][k].max(0.0).sqrt();
        let (brightness, chi2_reduction) = region.matched(&state.light);
        Some(Found {
            pose: Pose { brightness, ..pose },
            chi2_reduction,
            deviations: [deviation(1), deviation(2), deviation(3), if n == 7 { deviation(6) } else { 0.0 }],
            turns: state.turns,
            covariance: [columns[4][4], columns[5][5], columns[4][5]],
            other: None,
        })
    }
}

impl State {
    /// Changes the derivatives so that they agree with the image after a step (Broyden), measured in standard
    /// deviations.
    fn update(&mut self, region: &Region, light: &[f64], change: &[f64; 7]) {
        let mut scale = [0.0; 6];
        for (slopes, weight) in self.slopes.iter().zip(&region.weight) {
            (0..6).for_each(|p| scale[p] += weight * slopes[p] * slopes[p]);
        }
        let step: [f64; 6] = std::array::from_fn(|p| change[1 + p]);
        let length: f64 = (0..6).map(|p| scale[p] * step[p] * step[p]).sum();
        if length <= 0.0 {
            return;
        }
        for ((slopes, before), after) in self.slopes.iter_mut().zip(&self.light).zip(light) {
            let predicted: f64 = (0..6).map(|p| slopes[p] * step[p]).sum();
            let rest = (after - before - predicted) / length;
            (0..6).for_each(|p| slopes[p] += rest * scale[p] * step[p]);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Images that are symmetric about focus at 1 um: the depth with the same image on the other side is found to within
    /// the spacing of the templates, near focus as well.
    #[test]
    fn both_sides_of_focus_are_known() {
        let depths_um: Vec<f64> = (0..45).map(|k| -10.0 + 0.5 * f64::from(k)).collect();
        let side = 41;
        let image = |z_um: &f64| {
            let sigma = 2.0 + 0.05 * (z_um - 1.0).powi(2);
            let r2 = |i: usize| (i % side).abs_diff(20).pow(2) + (i / side).abs_diff(20).pow(2);
            let counts =
                (0..side * side).map(|i| (-0.5 * r2(i) as f64 / (sigma * sigma)).exp() as f32 / sigma as f32);
            GrayImage { width: side, height: side, counts: counts.collect() }
        };
        let images = depths_um.iter().map(image).collect();
        let opposite = Opposite::new(&Templates::new(depths_um, images, PixelNoise::new(1.0, 0.0)));
        for z_um in [1.1, 1.4, 0.3, 5.0, -7.0, 9.5] {
            let other = opposite.of(z_um).unwrap();
            assert!((other - (2.0 - z_um)).abs() < 0.6, "{z_um}: {other}");
        }
    }
}
