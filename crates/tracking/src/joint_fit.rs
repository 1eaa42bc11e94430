//! The final fit of a frame: maximum likelihood for all particles, jointly for overlapping ones.
//!
//! Counts are modeled as normally distributed around background plus light, with the noise variance at the
//! modeled light, so that maximum likelihood is minimum chi^2. Particles with overlapping images are fitted
//! as a group (Levenberg-Marquardt), one group after the other with all other particles subtracted. Variances
//! and background are updated in every round.

use microsig_core::cancel::checkpoint;
use microsig_core::linear::Symmetric;

use super::OtherSide;
use super::acceptance::{Verdict, verdict};
use super::denoise::PixelNoise;
use super::fit::{Agreement, ParticleFit};
use super::gray_image::GrayImage;
use super::images::{ImagePatch, ParticleImages};
use super::search::are_apart;

/// Number of rounds over all groups.
const ROUNDS: usize = 3;

/// Particles are fitted together if their weighted images correlate by more than this.
const OVERLAP: f64 = 0.1;

/// Maximum number of particles in a group.
const MOST_TOGETHER: usize = 8;

/// Maximum number of iterations of a fit.
const MAX_ITERATIONS: usize = 12;

/// Convergence: reduction of chi^2 in one iteration.
const CONVERGED: f64 = 1e-3;

/// By how much, in -2 ln of the likelihood, one point may decide on which side of the focus its track is.
pub(super) const MOST_BY_A_POINT: f64 = 30.0;

/// Fits are not determined if a parameter depends on the others to within this.
const SINGULAR: f64 = 1e-10;

/// Model of the particle images and of the noise of a frame.
pub(super) struct Model<'a> {
    /// Images of particles of each size, then at each diameter of the ladder.
    pub(super) images: Vec<&'a dyn ParticleImages>,
    /// Diameters between which diameters are fitted, um, ascending; empty if they are not.
    pub(super) ladder: &'a [f64],
    pub(super) noise: PixelNoise,
    /// Relative error of the images.
    pub(super) error: f32,
    /// Scale of depth changes, um.
    pub(super) step_um: f64,
}

/// A frame during the fit.
struct Frame<'a> {
    model: &'a Model<'a>,
    size: (usize, usize),
    /// Counts minus background and light of all particles.
    residual: Vec<f32>,
    weight: Vec<f32>,
}

/// Fits all particles of a frame, starting from the result of the search and an estimate of the background
/// level.
pub(super) fn fit_all(
    image: &GrayImage,
    mut level: f32,
    model: &Model,
    mut particles: Vec<ParticleFit>,
) -> Vec<ParticleFit> {
    for round in 1..=ROUNDS {
        let mut frame = Frame::new(image, level, model, &particles);
        level += frame.adjust_background();
        for group in frame.groups(&particles) {
            frame.fit(&mut particles, &group);
        }
        if round == ROUNDS - 1 {
            particles.iter_mut().for_each(|particle| frame.compare_sides(particle));
        }
        particles.retain(|particle| verdict(particle) == Verdict::Particle);
    }
    if !model.ladder.is_empty() {
        let mut frame = Frame::new(image, level, model, &particles);
        particles.iter_mut().for_each(|particle| frame.fit_diameter(particle));
    }
    particles
}

impl<'a> Frame<'a> {
    fn new(image: &GrayImage, level: f32, model: &'a Model<'a>, particles: &[ParticleFit]) -> Self {
        let size = (image.width, image.height);
        let mut light = vec![0.0f32; image.counts.len()];
        for particle in particles {
            let amplitude = particle.amplitude as f32;
            for (i, [t, ..]) in model.patch(particle).pixels(size) {
                light[i] += amplitude * t;
            }
        }
        let weight =
            light.iter().map(|l| 1.0 / (model.noise.variance(*l) + (model.error * l).powi(2))).collect();
        let residual = image.counts.iter().zip(&light).map(|(c, l)| c - level - l).collect();
        Frame { model, size, residual, weight }
    }

    /// Fits the background level; returns its change.
    fn adjust_background(&mut self) -> f32 {
        let (mut sum, mut weights) = (0.0, 0.0);
        for (r, w) in self.residual.iter().zip(&self.weight) {
            sum += f64::from(w * r);
            weights += f64::from(*w);
        }
        let change = (sum / weights) as f32;
        self.residual.iter_mut().for_each(|r| *r -= change);
        change
    }

    /// Groups of overlapping particles, as indices.
    fn groups(&self, particles: &[ParticleFit]) -> Vec<Vec<usize>> {
        let patches: Vec<ImagePatch> = particles.iter().map(|p| self.model.patch(p)).collect();
        let product = |a: &ImagePatch, b: &ImagePatch| {
            let pixels = common(a, b, self.size);
            pixels.map(|(i, l, k)| f64::from(self.weight[i] * l[0] * k[0])).sum::<f64>()
        };
        let own: Vec<f64> = patches.iter().map(|p| product(p, p)).collect();
        let mut edges = Vec::new();
        for i in 0..patches.len() {
            checkpoint();
            for j in i + 1..patches.len() {
                let correlation = product(&patches[i], &patches[j]) / (own[i] * own[j]).sqrt();
                if correlation > OVERLAP {
                    edges.push((correlation, i, j));
                }
            }
        }
        edges.sort_by(|a, b| b.0.total_cmp(&a.0).then((a.1, a.2).cmp(&(b.1, b.2))));
        let mut group_of: Vec<usize> = (0..particles.len()).collect();
        let mut groups: Vec<Vec<usize>> = (0..particles.len()).map(|i| vec![i]).collect();
        for (_, i, j) in edges {
            let (a, b) = (group_of[i].min(group_of[j]), group_of[i].max(group_of[j]));
            if a != b && groups[a].len() + groups[b].len() <= MOST_TOGETHER {
                let moved = std::mem::take(&mut groups[b]);
                moved.iter().for_each(|&k| group_of[k] = a);
                groups[a].extend(moved);
            }
        }
        groups.retain(|group| !group.is_empty());
        groups
    }

    fn fit(&mut self, particles: &mut [ParticleFit], group: &[usize]) {
        let start: Vec<ParticleFit> = group.iter().map(|&k| particles[k]).collect();
        let before: Vec<ImagePatch> = start.iter().map(|p| self.model.patch(p)).collect();
        for (patch, particle) in before.iter().zip(&start) {
            self.add(patch, particle.amplitude);
        }
        let fitted = Region::new(self, self.model, &start).fitted(start);
        for (k, particle) in group.iter().zip(fitted) {
            self.add(&self.model.patch(&particle), -particle.amplitude);
            particles[*k] = particle;
        }
    }

    /// Fits a particle on both sides of the focus and keeps the better fit, with the other one.
    fn compare_sides(&mut self, particle: &mut ParticleFit) {
        let Some(z_um) = particle.other_z_um.take() else { return };
        self.add(&self.model.patch(particle), particle.amplitude);
        let fitted = |start: ParticleFit| Region::new(self, self.model, &[start]).fitted(vec![start])[0];
        let mut sides = [*particle, ParticleFit { z_um, ..*particle }].map(fitted);
        sides.sort_by(|a, b| b.chi2_reduction.total_cmp(&a.chi2_reduction));
        let [best, worse] = sides;
        let ParticleFit { at, z_um, deviations, .. } = worse;
        let is_apart = are_apart(&best, &worse, self.model.step_um);
        // Errors of the images leave more than noise, and may favor the wrong side by far.
        let cost = (best.chi2_reduction - worse.chi2_reduction) / best.misfit.max(1.0);
        let cost = cost.min(MOST_BY_A_POINT);
        let other = OtherSide { at, z_um, deviations, cost };
        let other = Some(other).filter(|_| is_apart && verdict(&worse) == Verdict::Particle);
        *particle = ParticleFit { other, ..best };
        self.add(&self.model.patch(particle), -particle.amplitude);
    }

    /// Fits the diameter. Images of spheres change with the square of the diameter as long as they are smaller than the blur,
    /// so images between the steps of the ladder are interpolated, and a parabola gives the minimum of chi^2, over this square.
    fn fit_diameter(&mut self, particle: &mut ParticleFit) {
        let (model, ladder) = (self.model, self.model.ladder);
        let (all, sizes) = (&model.images, model.images.len() - ladder.len()..model.images.len());
        self.add(&model.patch(particle), particle.amplitude);
        let mut fits = vec![None; ladder.len()];
        let mut at = |k: usize| {
            let start = ParticleFit { size: sizes.start + k, ..*particle };
            *fits[k].get_or_insert_with(|| Region::new(self, model, &[start]).fitted(vec![start])[0])
        };
        // Downhill, one diameter after the other.
        let mut best = ladder.len() / 2;
        let near = loop {
            let low = best.saturating_sub(1).min(ladder.len() - 3);
            let near = [low, low + 1, low + 2];
            let next =
                near.into_iter().max_by(|a, b| at(*a).chi2_reduction.total_cmp(&at(*b).chi2_reduction));
            match next {
                Some(next) if next != best => best = next,
                _ => break near,
            }
        };
        let nodes = near.map(|k| ladder[k] * ladder[k]);
        let start = at(best);
        let minimum = parabola(nodes, near.map(|k| -at(k).chi2_reduction));
        *particle = ParticleFit { d_um: Some(ladder[best]), ..start };
        if let Some((square, curvature)) = minimum.filter(|(square, _)| (nodes[0]..nodes[2]).contains(square))
        {
            // Again nearby, where chi^2 is a parabola.
            let step = STEP / curvature.sqrt();
            let squares = [-1.0, 0.0, 1.0].map(|k| square + k * step.min(0.2 * (nodes[2] - nodes[0])));
            let images = near.map(|k| all[sizes.start + k]);
            let between = squares.map(|square| Between { images, weights: lagrange(nodes, square) });
            let images = between.iter().map(|images| images as &dyn ParticleImages).collect();
            let model = Model { images, ..*model };
            let fits = [0, 1, 2].map(|size| {
                let start = ParticleFit { size, ..start };
                Region::new(self, &model, &[start]).fitted(vec![start])[0]
            });
            if let Some((square, curvature)) = parabola(squares, fits.map(|fit| -fit.chi2_reduction))
                && (nodes[0]..nodes[2]).contains(&square)
            {
                let slopes = [0, 1, 2].map(|axis| {
                    let of = |fit: &ParticleFit| [fit.at[0], fit.at[1], fit.z_um][axis];
                    (of(&fits[2]) - of(&fits[0])) / (squares[2] - squares[0])
                });
                let off = square - squares[1];
                let own = fits[1];
                // What is uncertain about the diameter adds to the deviations at a given one.
                let total = |sd: [f64; 3]| {
                    std::array::from_fn(|k| (sd[k] * sd[k] + slopes[k] * slopes[k] / curvature).sqrt())
                };
                *particle = ParticleFit {
                    size: start.size,
                    at: [own.at[0] + off * slopes[0], own.at[1] + off * slopes[1]],
                    z_um: own.z_um + off * slopes[2],
                    deviations: own.deviations.map(total),
                    d_um: Some(square.sqrt()),
                    ..own
                };
            }
        }
        self.add(&self.model.patch(&start), -start.amplitude);
    }

    fn add(&mut self, patch: &ImagePatch, amplitude: f64) {
        for (i, [t, ..]) in patch.pixels(self.size) {
            self.residual[i] += amplitude as f32 * t;
        }
    }
}

/// Distance of squares of diameters at which chi^2 is compared, in standard deviations.
const STEP: f64 = 2.0;

/// Images at a diameter between three others.
struct Between<'a> {
    images: [&'a dyn ParticleImages; 3],
    weights: [f64; 3],
}

impl ParticleImages for Between<'_> {
    fn depths_um(&self) -> [f64; 2] {
        self.images[1].depths_um()
    }

    fn radius_px(&self, z_um: f64, reach_um: f64) -> usize {
        self.images[2].radius_px(z_um, reach_um)
    }

    fn patch(&self, at: [f64; 2], z_um: f64, radius: usize) -> ImagePatch {
        let [a, b, c] = self.images.map(|images| images.patch(at, z_um, radius));
        let [weight_a, weight_b, weight_c] = self.weights.map(|weight| weight as f32);
        let sum = |((a, b), c): ((&[f32; 4], &[f32; 4]), &[f32; 4])| {
            std::array::from_fn(|k| weight_a * a[k] + weight_b * b[k] + weight_c * c[k])
        };
        ImagePatch { light: a.light.iter().zip(&b.light).zip(&c.light).map(sum).collect(), ..a }
    }
}

/// Weights of the values at three points in that at `x` of the parabola through them.
fn lagrange([a, b, c]: [f64; 3], x: f64) -> [f64; 3] {
    [
        (x - b) * (x - c) / ((a - b) * (a - c)),
        (x - a) * (x - c) / ((b - a) * (b - c)),
        (x - a) * (x - b) / ((c - a) * (c - b)),
    ]
}

/// Minimum of the parabola through three points, and the coefficient of its square; `None` if it has none.
fn parabola([a, b, c]: [f64; 3], values: [f64; 3]) -> Option<(f64, f64)> {
    let first = (values[1] - values[0]) / (b - a);
    let second = ((values[2] - values[1]) / (c - b) - first) / (c - a);
    (second > 0.0).then(|| (0.5 * (a + b - first / second), second))
}

/// A rectangle of the frame around a group, with all other particles subtracted.
struct Region<'a> {
    model: &'a Model<'a>,
    corner: [isize; 2],
    size: (usize, usize),
    data: Vec<f32>,
    weight: Vec<f32>,
    /// Half widths of the particle images, px.
    radii: Vec<usize>,
}

/// A state of the fit: particles, their images, and the residual.
struct State {
    particles: Vec<ParticleFit>,
    patches: Vec<ImagePatch>,
    residual: Vec<f32>,
    chi2: f64,
}

impl<'a> Region<'a> {
    fn new(frame: &Frame<'_>, model: &'a Model<'a>, particles: &[ParticleFit]) -> Self {
        let radii: Vec<usize> =
            particles.iter().map(|p| model.images[p.size].radius_px(p.z_um, model.step_um)).collect();
        let limits = [frame.size.0, frame.size.1].map(|n| n as isize);
        let side = |axis: usize| {
            let ends = particles.iter().zip(&radii).map(|(p, &r)| {
                let middle = p.at[axis].round() as isize;
                (middle - r as isize, middle + r as isize + 1)
            });
            let (low, high) = ends.fold((isize::MAX, isize::MIN), |a, b| (a.0.min(b.0), a.1.max(b.1)));
            let low = low.clamp(0, limits[axis]);
            (low, (high.clamp(low, limits[axis]) - low) as usize)
        };
        let ((x0, width), (y0, height)) = (side(0), side(1));
        let cut = |values: &[f32]| -> Vec<f32> {
            let row = |y: usize| &values[(y0 as usize + y) * frame.size.0 + x0 as usize..][..width];
            (0..height).flat_map(|y| row(y).iter().copied()).collect()
        };
        let (data, weight) = (cut(&frame.residual), cut(&frame.weight));
        Region { model, corner: [x0, y0], size: (width, height), data, weight, radii }
    }

    /// The particles at the minimum of chi^2.
    fn fitted(&self, start: Vec<ParticleFit>) -> Vec<ParticleFit> {
        let mut now = self.state(start);
        let mut damping = 1e-3;
        let mut equations = self.equations(&now);
        for _ in 0..MAX_ITERATIONS {
            let Some(change) = equations.solved(damping) else { break };
            let moved = now.particles.iter().zip(change.chunks(4)).map(|(p, c)| self.model.moved(p, c));
            let next = self.state(moved.collect());
            if next.chi2 < now.chi2 {
                let chi2_reduction = now.chi2 - next.chi2;
                now = next;
                if chi2_reduction < CONVERGED {
                    break;
                }
                damping = (0.1 * damping).max(1e-8);
                equations = self.equations(&now);
            } else if now.chi2 - next.chi2 > -CONVERGED || damping > 1e3 {
                break;
            } else {
                damping *= 10.0;
            }
        }
        // The inverse of the Fisher information, at a state within the tolerance of convergence.
        let n = equations.right.len();
        let variances = Symmetric::of(n, equations.matrix).inverse_diagonal(SINGULAR);
        self.judged(&now, variances)
    }

    fn state(&self, particles: Vec<ParticleFit>) -> State {
        checkpoint();
        let patches: Vec<ImagePatch> = particles
            .iter()
            .zip(&self.radii)
            .map(|(p, &radius)| {
                let mut patch = self.model.images[p.size].patch(p.at, p.z_um, radius);
                patch.middle = std::array::from_fn(|axis| patch.middle[axis] - self.corner[axis]);
                patch
            })
            .collect();
        let mut residual = self.data.clone();
        for (patch, particle) in patches.iter().zip(&particles) {
            let amplitude = particle.amplitude as f32;
            patch.pixels(self.size).for_each(|(i, [t, ..])| residual[i] -= amplitude * t);
        }
        let chi2 = residual.iter().zip(&self.weight).map(|(r, w)| f64::from(w * r * r)).sum();
        State { particles, patches, residual, chi2 }
    }

    /// Normal equations for changes in brightness, x, y and depth of every particle.
    fn equations(&self, state: &State) -> Equations {
        let n = 4 * state.particles.len();
        let (mut matrix, mut right) = (vec![0.0; n * n], vec![0.0; n]);
        let slopes = |[t, x, y, z]: [f32; 4], a: f64| {
            [f64::from(t), a * f64::from(x), a * f64::from(y), a * f64::from(z)]
        };
        for (i, (patch, particle)) in state.patches.iter().zip(&state.particles).enumerate() {
            for (pixel, light) in patch.pixels(self.size) {
                let (w, r) = (f64::from(self.weight[pixel]), f64::from(state.residual[pixel]));
                let slopes = slopes(light, particle.amplitude);
                for (k, slope) in slopes.into_iter().enumerate() {
                    right[4 * i + k] += w * slope * r;
                    for (l, other) in slopes.into_iter().enumerate().take(k + 1) {
                        matrix[(4 * i + k) * n + 4 * i + l] += w * slope * other;
                    }
                }
            }
            for (j, (other, neighbor)) in state.patches.iter().zip(&state.particles).enumerate().take(i) {
                for (pixel, a, b) in common(patch, other, self.size) {
                    let w = f64::from(self.weight[pixel]);
                    let (a, b) = (slopes(a, particle.amplitude), slopes(b, neighbor.amplitude));
                    for (k, slope) in a.into_iter().enumerate() {
                        for (l, other) in b.into_iter().enumerate() {
                            matrix[(4 * i + k) * n + 4 * j + l] += w * slope * other;
                        }
                    }
                }
            }
        }
        Equations { matrix, right }
    }

    /// The particles with their reduction of chi^2, their correlation with the data, and the standard deviations
    /// that follow from the variances of brightness, x, y and depth of each.
    fn judged(&self, state: &State, variances: Option<Vec<f64>>) -> Vec<ParticleFit> {
        let judge = |(i, (patch, particle)): (usize, (&ImagePatch, &ParticleFit))| {
            let mut agreement = Agreement::default();
            for (i, [t, ..]) in patch.pixels(self.size) {
                agreement.add(self.weight[i], state.residual[i] + particle.amplitude as f32 * t, t);
            }
            let (chi2_reduction, correlation, misfit) = if agreement.is_positive() {
                (agreement.chi2_reduction(), agreement.correlation(), agreement.misfit())
            } else {
                (0.0, 0.0, 1.0)
            };
            let deviations = variances.as_ref().map(|all| [1, 2, 3].map(|k| all[4 * i + k].sqrt()));
            ParticleFit { chi2_reduction, correlation, misfit, deviations, ..*particle }
        };
        state.patches.iter().zip(&state.particles).enumerate().map(judge).collect()
    }
}

impl Model<'_> {
    fn patch(&self, particle: &ParticleFit) -> ImagePatch {
        checkpoint();
        let images = self.images[particle.size];
        images.patch(particle.at, particle.z_um, images.radius_px(particle.z_um, self.step_um))
    }

    /// A particle after a change in brightness, x, y and depth, with limited step sizes.
    fn moved(&self, particle: &ParticleFit, change: &[f64]) -> ParticleFit {
        let [low, high] = self.images[particle.size].depths_um();
        ParticleFit {
            z_um: (particle.z_um + change[3].clamp(-1.5 * self.step_um, 1.5 * self.step_um)).clamp(low, high),
            amplitude: (particle.amplitude + change[0]).max(0.1 * particle.amplitude),
            ..particle.shifted([change[1], change[2]])
        }
    }
}

/// The pixels common to two patches and the image: index, light of both with derivatives.
fn common<'p>(
    a: &'p ImagePatch,
    b: &'p ImagePatch,
    (width, height): (usize, usize),
) -> impl Iterator<Item = (usize, [f32; 4], [f32; 4])> + 'p {
    let limits = [width, height].map(|n| n as isize);
    let range = |axis: usize| {
        let ends = [a, b].map(|p| {
            let r = p.radius as isize;
            (p.middle[axis] - r, p.middle[axis] + r + 1)
        });
        ends[0].0.max(ends[1].0).max(0)..ends[0].1.min(ends[1].1).min(limits[axis])
    };
    let of = |p: &ImagePatch, x: isize, y: isize| {
        let r = p.radius as isize;
        p.light[((y - p.middle[1] + r) * (2 * r + 1) + x - p.middle[0] + r) as usize]
    };
    let (columns, rows) = (range(0), range(1));
    rows.flat_map(move |y| {
        let columns = columns.clone();
        columns.map(move |x| ((y * width as isize + x) as usize, of(a, x, y), of(b, x, y)))
    })
}

/// Normal equations; only the lower triangle of the symmetric matrix is filled.
pub(super) struct Equations {
    pub(super) matrix: Vec<f64>,
    pub(super) right: Vec<f64>,
}

impl Equations {
    /// The solution with the diagonal multiplied by 1 + `damping` (Cholesky); `None` if the matrix is
    /// singular.
    pub(super) fn solved(&self, damping: f64) -> Option<Vec<f64>> {
        let n = self.right.len();
        let mut matrix = self.matrix.clone();
        matrix.iter_mut().step_by(n + 1).for_each(|diagonal| *diagonal *= 1.0 + damping);
        let x = Symmetric::of(n, matrix).solve(&self.right)?;
        x.iter().all(|v| v.is_finite()).then_some(x)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn normal_equations_are_solved() {
        // A = [[4, 2, 0], [2, 5, 3], [0, 3, 6]], x = (1, -2, 3).
        let matrix = vec![4.0, 0.0, 0.0, 2.0, 5.0, 0.0, 0.0, 3.0, 6.0];
        let x = Equations { matrix, right: vec![0.0, 1.0, 12.0] }.solved(0.0).unwrap();
        assert!(x.iter().zip([1.0, -2.0, 3.0]).all(|(a, b)| (a - b).abs() < 1e-12), "{x:?}");
        assert!(Equations { matrix: vec![0.0], right: vec![1.0] }.solved(0.0).is_none());
    }
}
