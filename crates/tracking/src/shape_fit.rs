//! Maximum-likelihood fit of a spheroid: brightness, position, depth, axis and, if it is not known, aspect ratio.
//!
//! A fit starts from several poses, among them mirror images toward and away from the lens and depths on the other side of
//! focus, which look alike at some depths. The method is Levenberg and Marquardt's, with derivatives that are updated from
//! image to image (Broyden 1965, Math. Comput. 19, 577). By rays, the way there goes by drafts of the images, and only
//! the last fit by exact ones; its first derivatives also give the covariance.

use glam::DVec3;
use microsig_core::cancel::checkpoint;

use super::ParticleShape;
use super::acceptance::{BRIGHTNESS, LEAST_SIGNIFICANCE};
use super::denoise::PixelNoise;
use super::joint_fit::Equations;
use super::mle::{Detail, ShapeImages};
use super::opposite::Opposite;
use super::shape_templates::{angle, mirrored};

/// Axes closer than this are the same start, or the same result, rad.
const SAME_AXIS: f64 = 0.35;

/// So are depths closer than this, um.
const SAME_UM: f64 = 3.0;

/// Number of starts, before those mirrored and on the other side of focus.
const STARTS: usize = 2;

const MODEL_ERROR: f64 = 0.01;

/// Iterations of a fit; the reductions of chi^2 at which it ends, and by which a step is so small that no image is computed
/// to confirm it.
const ITERATIONS: usize = 14;
const CONVERGED: f64 = 0.02;
const SMALL: f64 = 0.3;

/// Derivatives are computed anew if a fit has gone farther than this from where they were computed, standard deviations: by
/// differences of images, and from tables, which leave less to exact images; and how often.
const FAR: f64 = 3.0;
const FAR_WITH_TABLE: f64 = 10.0;
const RENEWALS: usize = 3;

/// Largest change of a parameter in one iteration: brightness (relative), px, px, um, rad, rad, logarithm.
const LARGEST: [f64; 7] = [0.5, 1.0, 1.0, 3.0, 0.35, 0.35, 0.25];

/// A second axis is reported down to this likelihood relative to the first.
pub(super) const LEAST_LIKELIHOOD: f64 = 1e-3;

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

#[derive(Debug, Clone)]
pub(super) struct Fitted {
    state: State,
    /// The square of the fit.
    middle: [isize; 2],
    radius: usize,
    /// The pose at which derivatives were computed, and the information (inverse covariance) there of all parameters, the
    /// last of which, the aspect ratio, is fitted only if it is not known.
    from: Pose,
    information: [[f64; 7]; 7],
    parameters: usize,
    pub(super) chi2_reduction: f64,
    /// chi^2 per pixel.
    pub(super) misfit: f64,
    /// Depth (um) and axis of another fit, and its likelihood relative to the first.
    pub(super) other: Option<(f64, DVec3, f64)>,
}

/// Standard deviations and covariances of a fit.
pub(super) struct Uncertainty {
    /// Of x, y (px), z (um), and of the logarithm of the aspect ratio.
    pub(super) deviations: [f64; 4],
    /// Directions of turns of the axis; their variances and their covariance, rad^2.
    pub(super) turns: [DVec3; 2],
    pub(super) covariance: [f64; 3],
}

/// What all fits in a frame have in common.
#[derive(Clone, Copy)]
pub(super) struct Fit<'a> {
    pub(super) images: &'a ShapeImages,
    pub(super) opposite: &'a Opposite,
    /// Aspect ratio, fitted if it is not known.
    pub(super) aspect: Option<f64>,
    pub(super) noise: PixelNoise,
    /// Width and height of the frame, px.
    pub(super) size: [isize; 2],
}

/// Pixels around a particle.
pub(super) struct Region {
    middle: [isize; 2],
    radius: usize,
    data: Vec<f64>,
    /// Inverse variances; 0 outside the frame.
    weight: Vec<f64>,
}

impl Region {
    /// Number of pixels in the frame.
    pub(super) fn pixels(&self) -> usize {
        self.weight.iter().filter(|weight| **weight > 0.0).count()
    }

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

/// Whether a fit is a particle.
pub(super) fn is_particle(chi2_reduction: f64, brightness: f64) -> bool {
    chi2_reduction > LEAST_SIGNIFICANCE.powi(2) && BRIGHTNESS.contains(&brightness)
}

/// Whether two poses are the same result.
fn is_same(a: &Pose, b: &Pose) -> bool {
    angle(a.axis, b.axis) < SAME_AXIS && (a.z_um - b.z_um).abs() < SAME_UM
}

/// A fit on its way: derivatives of the image at brightness 1, and the axis they were computed at.
#[derive(Debug, Clone)]
struct State {
    pose: Pose,
    light: Vec<f64>,
    chi2: f64,
    /// What exact images differ from drafts from a table; empty without one.
    correction: Vec<f64>,
    /// For each pixel, derivatives with respect to x, y, z, turns, logarithm of the aspect ratio.
    slopes: Vec<[f64; 6]>,
    axis: DVec3,
    turns: [DVec3; 2],
    /// Turns since then.
    turned: [f64; 2],
}

impl Fit<'_> {
    pub(super) fn overlap(&self, a: &Pose, b: &Pose) -> bool {
        let reach = (self.images.radius_at(a.z_um) + self.images.radius_at(b.z_um)) as f64;
        (0..2).all(|axis| (a.at[axis] - b.at[axis]).abs() < reach)
    }

    /// Central pixel and half width of the square of an image.
    fn square(&self, pose: &Pose) -> ([isize; 2], usize) {
        (pose.at.map(|at| at.round() as isize), self.images.radius_at(pose.z_um))
    }

    /// Adds the light of a particle, by a draft.
    pub(super) fn add(&self, residual: &mut [f32], pose: &Pose, sign: f64) {
        let (middle, radius) = self.square(pose);
        let light = self.images.light(pose, middle, radius, Detail::Draft);
        self.add_light(residual, (middle, radius), &light, sign * pose.brightness);
    }

    /// Adds the light of a fit.
    pub(super) fn add_fitted(&self, residual: &mut [f32], fitted: &Fitted, sign: f64) {
        let Fitted { middle, radius, state, .. } = fitted;
        self.add_light(residual, (*middle, *radius), &state.light, sign * state.pose.brightness);
    }

    fn add_light(
        &self,
        residual: &mut [f32],
        (middle, radius): ([isize; 2], usize),
        light: &[f64],
        brightness: f64,
    ) {
        for (light, i) in light.iter().zip(self.pixels(middle, radius)) {
            if let Some(i) = i {
                residual[i] += (brightness * light) as f32;
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
    pub(super) fn region(&self, residual: &[f32], pose: &Pose) -> Region {
        let (middle, radius) = self.square(pose);
        let light = self.images.light(pose, middle, radius, Detail::Draft);
        self.weighted(residual, (middle, radius), &light, pose.brightness)
    }

    /// A square, weighted by the noise of this light.
    fn weighted(
        &self,
        residual: &[f32],
        (middle, radius): ([isize; 2], usize),
        light: &[f64],
        brightness: f64,
    ) -> Region {
        let (mut data, mut weight) = (Vec::new(), Vec::new());
        for (light, i) in light.iter().zip(self.pixels(middle, radius)) {
            let light = brightness * light;
            let variance = f64::from(self.noise.variance(light as f32)) + (MODEL_ERROR * light).powi(2);
            data.push(i.map_or(0.0, |i| f64::from(residual[i])));
            weight.push(i.map_or(0.0, |_| 1.0 / variance));
        }
        Region { middle, radius, data, weight }
    }

    /// The fit from a start by drafts of the images, and its chi^2.
    pub(super) fn drafted(&self, region: &Region, start: &Pose) -> Option<(Pose, f64)> {
        self.refined(region, start, Detail::Draft).map(|state| (state.pose, state.chi2))
    }

    /// The best fit from any of these starts, best first, by drafts of the images.
    pub(super) fn draft(&self, residual: &[f32], starts: &[Pose]) -> Option<Pose> {
        Some(self.drafts(residual, starts)?[0].pose)
    }

    /// Whether a draft is a particle.
    pub(super) fn is_particle(&self, residual: &[f32], pose: &Pose) -> bool {
        let (middle, radius) = self.square(pose);
        let light = self.images.light(pose, middle, radius, Detail::Draft);
        let region = self.weighted(residual, (middle, radius), &light, pose.brightness);
        let (brightness, chi2_reduction) = region.matched(&light);
        is_particle(chi2_reduction, brightness)
    }

    /// The same by exact images, with a second one if there is one.
    pub(super) fn best(&self, residual: &[f32], starts: &[Pose]) -> Option<Fitted> {
        let fitted = self.drafts(residual, starts)?;
        let first = &fitted[0];
        let other = fitted[1..].iter().find(|state| !is_same(&state.pose, &first.pose));
        let other =
            other.map(|other| (other.pose.z_um, other.pose.axis, (0.5 * (first.chi2 - other.chi2)).exp()));
        let other = other.filter(|(_, _, likelihood)| *likelihood > LEAST_LIKELIHOOD);
        Some(Fitted { other, ..self.exact(residual, first.pose)? })
    }

    /// Fits from these starts, with the other tilt and on the other side of focus; best first, at least one.
    fn drafts(&self, residual: &[f32], starts: &[Pose]) -> Option<Vec<State>> {
        let mut apart: Vec<Pose> = Vec::new();
        for start in starts {
            if apart.len() < STARTS && !apart.iter().any(|other| is_same(start, other)) {
                apart.push(*start);
            }
        }
        // All compared with the same weights.
        let region = self.region(residual, apart.first()?);
        let drafted = |start: &Pose| self.refined(&region, start, Detail::Draft);
        let by_chi2 = |a: &State, b: &State| a.chi2.total_cmp(&b.chi2);
        let mut fitted: Vec<State> = apart.iter().filter_map(drafted).collect();
        fitted.sort_by(by_chi2);
        let mirror = |pose: &Pose| Pose { axis: mirrored(pose.axis), ..*pose };
        let other_tilt = mirror(&fitted.first()?.pose);
        if fitted.iter().all(|state| !is_same(&state.pose, &other_tilt)) {
            fitted.extend(drafted(&other_tilt));
            fitted.sort_by(by_chi2);
        }
        let first = fitted[0].pose;
        if let Some(z_um) = self.opposite.of(first.z_um) {
            for start in [first, mirror(&first)].map(|pose| Pose { z_um, ..pose }) {
                fitted.extend(drafted(&start));
            }
            fitted.sort_by(by_chi2);
        }
        Some(fitted)
    }

    /// The best fit from a start, by exact images and weighted by its own light.
    fn exact(&self, residual: &[f32], mut pose: Pose) -> Option<Fitted> {
        let mut fitted = None;
        for _ in 0..RENEWALS {
            let region = self.region(residual, &pose);
            let state = self.state(&region, pose, Detail::Full)?;
            let (information, _) = information(&region, &state);
            let now = self.descended(&region, state, Detail::Full);
            let now = fitted.insert(Fitted::new(&region, now, pose, information, self.parameters()));
            if !self.is_far(now) {
                break;
            }
            pose = now.state.pose;
        }
        fitted
    }

    /// A fit after a step of all parameters, the aspect ratio too, by exact images.
    pub(super) fn with_aspect(&self, residual: &[f32], fitted: Fitted) -> Option<Fitted> {
        let Fitted { mut state, middle, radius, .. } = fitted;
        let region = self.weighted(residual, (middle, radius), &state.light, state.pose.brightness);
        let by_aspect = self.images.by_aspect(&state.pose, middle, radius, Detail::Full);
        state.slopes.iter_mut().zip(by_aspect).for_each(|(slopes, by)| slopes[5] = by);
        let (information, right) = information(&region, &state);
        let from = state.pose;
        state.pose.e_p *= equations(&information, &right).solved(0.0)?[6].exp();
        Some(Fitted::new(&region, state, from, information, 7))
    }

    /// The same after its surroundings have changed.
    pub(super) fn again(&self, residual: &[f32], fitted: &Fitted) -> Option<Fitted> {
        let Fitted { state, middle, radius, from, information, parameters, other, .. } = fitted;
        let region = self.weighted(residual, (*middle, *radius), &state.light, state.pose.brightness);
        let chi2 = region.chi2(&state.light, state.pose.brightness);
        let state = self.descended(&region, State { chi2, ..state.clone() }, Detail::Full);
        let mut now = Fitted::new(&region, state, *from, *information, *parameters);
        if self.is_far(&now) {
            now = self.exact(residual, now.state.pose)?;
        }
        Some(Fitted { other: *other, ..now })
    }

    /// Whether the derivatives of a fit belong to another place.
    fn is_far(&self, fitted: &Fitted) -> bool {
        fitted.distance() > if self.images.has_table() { FAR_WITH_TABLE } else { FAR }
    }

    fn state(&self, region: &Region, pose: Pose, detail: Detail) -> Option<State> {
        let (pixels, turns) = self.images.gradient(&pose, region.middle, region.radius, detail)?;
        let light: Vec<f64> = pixels.iter().map(|pixel| pixel[0]).collect();
        let slopes = pixels.iter().map(|pixel| std::array::from_fn(|p| pixel[1 + p])).collect();
        let chi2 = region.chi2(&light, pose.brightness);
        let mut correction = Vec::new();
        if detail == Detail::Full && self.images.has_table() {
            let draft = self.images.light(&pose, region.middle, region.radius, Detail::Draft);
            correction.extend(light.iter().zip(draft).map(|(light, draft)| light - draft));
        }
        Some(State { pose, light, chi2, correction, slopes, axis: pose.axis, turns, turned: [0.0; 2] })
    }

    fn parameters(&self) -> usize {
        if self.aspect.is_some() { 6 } else { 7 }
    }

    /// Normal equations for changes of brightness, x, y, z, turns and the logarithm of the aspect ratio.
    fn equations(&self, region: &Region, state: &State) -> Equations {
        let (matrix, right) = information(region, state);
        equations(&matrix, &right[..self.parameters()])
    }

    /// Levenberg-Marquardt from a start.
    fn refined(&self, region: &Region, start: &Pose, detail: Detail) -> Option<State> {
        Some(self.descended(region, self.state(region, *start, detail)?, detail))
    }

    fn descended(&self, region: &Region, mut now: State, detail: Detail) -> State {
        let mut damping = 1e-2;
        for _ in 0..ITERATIONS {
            checkpoint();
            let equations = self.equations(region, &now);
            let Some(change) = equations.solved(damping) else { break };
            let gain: f64 = change.iter().zip(&equations.right).map(|(change, right)| change * right).sum();
            if gain < SMALL && damping < 0.1 {
                return self.step(now, &change, gain);
            }
            let (pose, turned, change) = self.moved(&now, &change);
            let light = self.light(region, &now.correction, &pose, detail);
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
        now
    }

    /// The image of a pose near one with this correction.
    fn light(&self, region: &Region, correction: &[f64], pose: &Pose, detail: Detail) -> Vec<f64> {
        let detail = if correction.is_empty() { detail } else { Detail::Draft };
        let mut light = self.images.light(pose, region.middle, region.radius, detail);
        light.iter_mut().zip(correction).for_each(|(light, correction)| *light += correction);
        light
    }

    /// A state after a change so small that the image is linear in it.
    fn step(&self, mut now: State, change: &[f64], gain: f64) -> State {
        let (pose, turned, change) = self.moved(&now, change);
        for (light, slopes) in now.light.iter_mut().zip(&now.slopes) {
            *light += (0..6).map(|p| slopes[p] * change[1 + p]).sum::<f64>();
        }
        (now.pose, now.turned) = (pose, turned);
        now.chi2 -= gain;
        now
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
            e_p: (pose.e_p * made[6].exp()).clamp(ParticleShape::ASPECTS.least, ParticleShape::ASPECTS.most),
            brightness: pose.brightness + made[0],
        };
        (moved, turned, made)
    }
}

/// Information on changes of brightness, x, y, z, turns and the logarithm of the aspect ratio, and what these would gain.
fn information(region: &Region, state: &State) -> ([[f64; 7]; 7], [f64; 7]) {
    let (mut matrix, mut right) = ([[0.0; 7]; 7], [0.0; 7]);
    let brightness = state.pose.brightness;
    for (i, slopes) in state.slopes.iter().enumerate().filter(|(i, _)| region.weight[*i] > 0.0) {
        let mut by = [0.0; 7];
        by[0] = state.light[i];
        (0..6).for_each(|p| by[1 + p] = brightness * slopes[p]);
        let (weight, rest) = (region.weight[i], region.data[i] - brightness * state.light[i]);
        for k in 0..7 {
            right[k] += weight * by[k] * rest;
            for l in 0..7 {
                matrix[k][l] += weight * by[k] * by[l];
            }
        }
    }
    (matrix, right)
}

/// Normal equations of the first parameters.
fn equations(information: &[[f64; 7]; 7], right: &[f64]) -> Equations {
    let n = right.len();
    let matrix = information[..n].iter().flat_map(|row| &row[..n]).copied().collect();
    Equations { matrix, right: right.to_vec() }
}

impl Fitted {
    fn new(
        region: &Region,
        mut state: State,
        from: Pose,
        information: [[f64; 7]; 7],
        parameters: usize,
    ) -> Self {
        let (brightness, chi2_reduction) = region.matched(&state.light);
        state.pose.brightness = brightness;
        let misfit = region.chi2(&state.light, brightness) / region.pixels().max(1) as f64;
        let Region { middle, radius, .. } = *region;
        Fitted { state, middle, radius, from, information, parameters, chi2_reduction, misfit, other: None }
    }

    pub(super) fn pose(&self) -> &Pose {
        &self.state.pose
    }

    /// How far a fit is from where its derivatives were computed, standard deviations.
    fn distance(&self) -> f64 {
        let (now, from) = (self.state.pose, self.from);
        let change = [
            now.brightness - from.brightness,
            now.at[0] - from.at[0],
            now.at[1] - from.at[1],
            now.z_um - from.z_um,
            self.state.turned[0],
            self.state.turned[1],
            (now.e_p / from.e_p).ln(),
        ];
        let product = |k: usize, l: usize| self.information[k][l] * change[k] * change[l];
        let chi2: f64 = (0..7).flat_map(|k| (0..7).map(move |l| product(k, l))).sum();
        chi2.max(0.0).sqrt()
    }

    /// `known` is the standard deviation of the logarithm of an aspect ratio that is not fitted; its error moves all
    /// parameters, and is independent of the noise of this image. `None` if the image does not determine the parameters.
    pub(super) fn uncertainty(&self, known: f64) -> Option<Uncertainty> {
        let n = self.parameters;
        let unit = |k: usize| (0..n).map(|i| if i == k { 1.0 } else { 0.0 }).collect::<Vec<f64>>();
        let column = |k: usize| equations(&self.information, &unit(k)).solved(1e-9);
        let columns: Vec<Vec<f64>> = (0..n).map(column).collect::<Option<_>>()?;
        // Change of each parameter with the aspect ratio for which the gradient of chi^2 stays zero.
        let shift = |k: usize| -> f64 {
            if n == 7 { 0.0 } else { -(0..n).map(|l| columns[k][l] * self.information[6][l]).sum::<f64>() }
        };
        let covariance = |k: usize, l: usize| columns[k][l] + shift(k) * shift(l) * known * known;
        let deviation = |k: usize| covariance(k, k).max(0.0).sqrt();
        let aspect_deviation = if n == 7 { deviation(6) } else { known };
        Some(Uncertainty {
            deviations: [deviation(1), deviation(2), deviation(3), aspect_deviation],
            turns: self.state.turns,
            covariance: [covariance(4, 4), covariance(5, 5), covariance(4, 5)],
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

    /// The aspect ratio that one image gives is as uncertain a basis for a second fit of it as the joint fit says.
    #[test]
    fn the_error_of_a_measured_aspect_ratio_is_part_of_all_others() {
        // A change of the aspect ratio looks like a shift in x.
        let vector = |k: usize| -> [f64; 7] {
            let by: [f64; 7] = std::array::from_fn(|p| (1.0 + (k * k + 3 * k * p) as f64).sin());
            std::array::from_fn(|p| if p == 6 { by[6] + 4.0 * by[1] } else { by[p] })
        };
        let mut information = [[0.0; 7]; 7];
        for by in (0..20).map(vector) {
            (0..7).for_each(|k| (0..7).for_each(|l| information[k][l] += by[k] * by[l]));
        }
        let pose = Pose { at: [0.0; 2], z_um: 0.0, axis: DVec3::X, e_p: 2.0, brightness: 1.0 };
        let turns = [DVec3::Y, DVec3::Z];
        let state = State {
            pose,
            light: Vec::new(),
            chi2: 0.0,
            correction: Vec::new(),
            slopes: Vec::new(),
            axis: DVec3::X,
            turns,
            turned: [0.0; 2],
        };
        let region = Region { middle: [0; 2], radius: 0, data: Vec::new(), weight: Vec::new() };
        let of = |parameters: usize, known: f64| {
            let Uncertainty { deviations, covariance, .. } =
                Fitted::new(&region, state.clone(), pose, information, parameters)
                    .uncertainty(known)
                    .unwrap();
            deviations.into_iter().chain(covariance).collect::<Vec<f64>>()
        };
        let joint = of(7, 0.0);
        let apart = of(6, joint[3]);
        assert!(
            joint.iter().zip(&apart).all(|(a, b)| (a - b).abs() < 1e-6 * a.abs().max(1e-3)),
            "{joint:?} {apart:?}"
        );
        assert!(of(6, 0.0)[0] < 0.5 * joint[0]);
    }
}
