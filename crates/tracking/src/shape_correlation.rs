//! Depth and axis of spheroids by correlation with images of the optical model: `ncc --shape spheroid`, and the starts of
//! `mle --shape spheroid`.
//!
//! Templates averaged over all directions of the axis find the particles, as in `ncc`. Each is then correlated with
//! images at all depths, which are polynomials of the axis (`shape_templates`), so that the correlation is known for every
//! axis. The particle is resampled to its sub-pixel position, by parabolas over pixels; another parabola gives the
//! depth. The light of a particle is subtracted before the next, fainter one.

use glam::DVec3;
use microsig_core::cancel::checkpoint;
use microsig_core::visibility::vertex;

use super::AspectRatio;
use super::acceptance::LEAST_CORRELATION;
use super::fit::{Agreement, Residual};
use super::gray_image::{GrayImage, Spline};
use super::job::Job;
use super::output::Output;
use super::shape_fit::{Pose, is_particle};
use super::shape_templates::{FUNCTIONS, ShapeTemplates, axes, functions, mirrored};
use super::spheroids::Spheroids;
use storage::error::Result;

/// Relative error of the images.
pub(super) const IMAGE_ERROR: f32 = 0.02;

/// Axes that are compared before the best is refined, and the angles of the refinement, rad.
const AXES: usize = 240;
const TURNS: [f64; 5] = [0.08, 0.04, 0.02, 0.01, 0.005];

/// Most maxima over depth that are refined; rounds of positions and shapes, and how many depths on either side are
/// compared again.
const STARTS: usize = 3;
const ROUNDS: usize = 3;
const NEAR: usize = 2;

/// Farthest position from the pixel of the search, px; and pixels beyond a square that its resampling needs.
const FARTHEST: f64 = 1.5;
const BORDER: usize = 6;

/// Tracks spheroids by correlation.
pub(super) fn particles(job: &Job, aspect: AspectRatio) -> Result<Output> {
    let spheroids = Spheroids::new(job, aspect)?;
    job.particles(|_, image| spheroids.correlated(image))
}

/// The spheroids near those found by a search: for each, the matches at the maxima over depth, best first.
pub(super) fn in_frame(
    mut residual: Residual,
    templates: &ShapeTemplates,
    places: impl Iterator<Item = [f64; 2]>,
) -> Vec<Vec<Match>> {
    let mut all = Vec::new();
    for place in places {
        let matches = Match::all(&residual, templates, place.map(|at| at.round() as isize));
        if matches.first().is_some_and(Match::is_particle) {
            matches[0].subtract(&mut residual, templates);
            all.push(matches);
        }
    }
    all
}

/// The shape that agrees best with data at a depth, all by their index.
#[derive(Debug, Clone, Copy)]
struct Shape {
    depth: usize,
    aspect: usize,
    axis: DVec3,
    chi2_reduction: f64,
}

/// Sum of products, by several sums side by side.
fn dot(a: &[f32], b: &[f32]) -> f64 {
    const LANES: usize = 16;
    let ((a, a_rest), (b, b_rest)) = (a.as_chunks::<LANES>(), b.as_chunks::<LANES>());
    let mut sums = [0.0f32; LANES];
    for (a, b) in a.iter().zip(b) {
        sums.iter_mut().zip(a.iter().zip(b)).for_each(|(sum, (a, b))| *sum += a * b);
    }
    let rest: f32 = a_rest.iter().zip(b_rest).map(|(a, b)| a * b).sum();
    f64::from(rest + sums.iter().sum::<f32>())
}

/// Correlation of a particle with the images of all axes, at one depth and aspect ratio.
struct OverAxes {
    /// Sums over pixels, weighted by inverse variances: of products of two coefficient images, row by row, and of products
    /// with the data.
    own: Vec<f64>,
    both: [f64; FUNCTIONS],
}

impl OverAxes {
    /// For data on a square with the particle on the central pixel.
    fn new(local: &Residual, templates: &ShapeTemplates, depth: usize, aspect: usize) -> Self {
        let parts = templates.coefficients(depth, aspect);
        let (r, middle) = (templates.radius(depth), local.image.width / 2);
        let rows = middle - r..=middle + r;
        let pixels: Vec<usize> =
            rows.clone().flat_map(|y| rows.clone().map(move |x| y * (2 * middle + 1) + x)).collect();
        let weighted = |part: &Vec<f32>| -> Vec<f32> {
            part.iter().zip(&pixels).map(|(light, i)| light * local.weight[*i]).collect()
        };
        let data: Vec<f32> = pixels.iter().map(|i| local.image.counts[*i]).collect();
        let (mut own, mut both) = (vec![0.0; FUNCTIONS * FUNCTIONS], [0.0; FUNCTIONS]);
        for i in 0..FUNCTIONS {
            let part = weighted(&parts[i]);
            both[i] = dot(&part, &data);
            for j in 0..=i {
                own[i * FUNCTIONS + j] = dot(&part, &parts[j]);
                own[j * FUNCTIONS + i] = own[i * FUNCTIONS + j];
            }
        }
        OverAxes { own, both }
    }

    /// Reduction of chi^2 by the image of this axis; 0 if it does not correlate.
    fn chi2_reduction(&self, axis: DVec3) -> f64 {
        let values = functions(axis);
        let dot = |row: &[f64]| row.iter().zip(values).map(|(a, b)| a * b).sum::<f64>();
        let both = dot(&self.both);
        let own: f64 =
            self.own.chunks_exact(FUNCTIONS).zip(values).map(|(row, value)| value * dot(row)).sum();
        if both > 0.0 && own > 0.0 { both * both / own } else { 0.0 }
    }

    /// The axis that agrees best, near `start` or, without it, of all.
    fn best(&self, start: Option<DVec3>) -> (DVec3, f64) {
        let all = start.map_or(axes(AXES).collect(), |start| vec![start]);
        let scored = all.into_iter().map(|axis| (axis, self.chi2_reduction(axis)));
        let Some(mut best) = scored.max_by(|a, b| a.1.total_cmp(&b.1)) else { return (DVec3::Z, 0.0) };
        for turn in TURNS {
            loop {
                let (u, v) = best.0.any_orthonormal_pair();
                let sides = [u, v, -u, -v].map(|side| (best.0 + turn * side).normalize());
                let scored = sides.map(|axis| (axis, self.chi2_reduction(axis)));
                match scored.into_iter().max_by(|a, b| a.1.total_cmp(&b.1)) {
                    Some(better) if better.1 > best.1 => best = better,
                    _ => break,
                }
            }
        }
        best
    }
}

/// A particle.
pub(super) struct Match {
    shape: Shape,
    /// Pixel from 0, and the distance from its center, px.
    at: [isize; 2],
    beyond: [f64; 2],
    brightness: f64,
    /// Of the image with the data.
    pub(super) correlation: f64,
    /// Fraction of a depth step.
    beyond_depth: f64,
}

/// Agreement of an image with the data at this distance from the central pixel.
fn agreement(local: &Residual, image: &[f32], [dx, dy]: [isize; 2]) -> Agreement {
    let (side, width) = (image.len().isqrt(), local.image.width);
    let first = |by: isize| (width / 2 - side / 2).saturating_add_signed(by);
    let mut agreement = Agreement::default();
    for (i, light) in image.iter().enumerate() {
        let pixel = (first(dy) + i / side) * width + first(dx) + i % side;
        agreement.add(local.weight[pixel], local.image.counts[pixel], *light);
    }
    agreement
}

/// The square of this half width around a place, resampled so that the place is the center of a pixel.
fn around(residual: &Residual, at: [isize; 2], beyond: [f64; 2], radius: usize) -> Residual {
    let (w, h) = (residual.image.width as isize, residual.image.height as isize);
    let pixel = |x: usize, y: usize, border: usize| {
        let [u, v] = [(x, at[0]), (y, at[1])].map(|(i, at)| at + i as isize - (radius + border) as isize);
        ((0..w).contains(&u) && (0..h).contains(&v)).then_some((v * w + u) as usize)
    };
    let side = 2 * radius + 1;
    let wide = side + 2 * BORDER;
    let counts = |x, y| pixel(x, y, BORDER).map_or(0.0, |i| residual.image.counts[i]);
    let spline = Spline::new(&GrayImage::from_fn((wide, wide), counts));
    let [dx, dy] = beyond.map(|beyond| (beyond + BORDER as f64) as f32);
    let image = GrayImage::from_fn((side, side), |x, y| spline.at(x as f32 + dx, y as f32 + dy));
    let weight = (0..side * side).map(|i| pixel(i % side, i / side, 0).map_or(0.0, |i| residual.weight[i]));
    Residual { weight: weight.collect(), image }
}

/// The shapes that agree best with data at these depths, one for each.
fn over_depth(
    local: &Residual,
    templates: &ShapeTemplates,
    depths: impl Iterator<Item = usize>,
    start: Option<&Shape>,
) -> Vec<Shape> {
    let at_depth = |depth: usize| {
        checkpoint();
        let aspects = start.map_or(0..templates.aspects.len(), |start| start.aspect..start.aspect + 1);
        let best_match = |aspect: usize| {
            let (axis, chi2_reduction) =
                OverAxes::new(local, templates, depth, aspect).best(start.map(|start| start.axis));
            Shape { depth, aspect, axis, chi2_reduction }
        };
        aspects.map(best_match).max_by(|a, b| a.chi2_reduction.total_cmp(&b.chi2_reduction))
    };
    depths.filter_map(at_depth).collect()
}

impl Match {
    /// The shapes and places that agree best with the residual near a pixel, at the local maxima over depth, on either
    /// side of the focus; best first.
    fn all(residual: &Residual, templates: &ShapeTemplates, at: [isize; 2]) -> Vec<Self> {
        let depths = templates.depths_um.len();
        let radius = (0..depths).map(|depth| templates.radius(depth)).max().unwrap_or(0) + 1;
        let all = over_depth(&around(residual, at, [0.0; 2], radius), templates, 0..depths, None);
        let value = |k: usize| all.get(k).map_or(0.0, |shape| shape.chi2_reduction);
        let is_maximum = |k: &usize| value(*k) >= value(k.wrapping_sub(1)) && value(*k) > value(k + 1);
        let mut starts: Vec<usize> = (0..all.len()).filter(is_maximum).collect();
        starts.sort_by(|a, b| value(*b).total_cmp(&value(*a)));
        // A tilt resembles a shift, so that toward the lens may be taken for that away from it before both are refined.
        let mirrored = |shape: Shape| Shape { axis: mirrored(shape.axis), ..shape };
        let starts = starts.into_iter().take(STARTS).flat_map(|k| [all[k], mirrored(all[k])]);
        let refined = starts.filter_map(|start| Match::refined(residual, templates, (at, radius), start));
        let mut refined: Vec<Match> = refined.collect();
        refined.sort_by(|a, b| b.shape.chi2_reduction.total_cmp(&a.shape.chi2_reduction));
        refined
    }

    /// The best near a shape, in a square of this half width around a pixel.
    fn refined(
        residual: &Residual,
        templates: &ShapeTemplates,
        (at, radius): ([isize; 2], usize),
        mut shape: Shape,
    ) -> Option<Self> {
        let depths = templates.depths_um.len();
        let (mut beyond, mut beyond_depth) = ([0.0; 2], 0.0);
        // Position and shape depend on each other.
        for _ in 0..ROUNDS {
            let local = around(residual, at, beyond, radius);
            let image = templates.image(shape.depth, shape.aspect, shape.axis);
            let reduction = |by: [isize; 2]| {
                let agreement = agreement(&local, &image, by);
                if agreement.is_positive() { agreement.chi2_reduction() } else { 0.0 }
            };
            let middle = reduction([0, 0]);
            let offset = [
                vertex([reduction([-1, 0]), middle, reduction([1, 0])]).0,
                vertex([reduction([0, -1]), middle, reduction([0, 1])]).0,
            ];
            beyond = [0, 1].map(|axis| (beyond[axis] + offset[axis]).clamp(-FARTHEST, FARTHEST));
            let local = around(residual, at, beyond, radius);
            let near = shape.depth.saturating_sub(NEAR)..(shape.depth + NEAR + 1).min(depths);
            let all = over_depth(&local, templates, near, Some(&shape));
            let k =
                (0..all.len()).max_by(|&a, &b| all[a].chi2_reduction.total_cmp(&all[b].chi2_reduction))?;
            let value = |k: usize| all[k].chi2_reduction;
            shape = all[k];
            if k > 0 && k + 1 < all.len() {
                (beyond_depth, shape.chi2_reduction) = vertex([value(k - 1), value(k), value(k + 1)]);
            } else {
                beyond_depth = 0.0;
            }
        }
        let image = templates.image(shape.depth, shape.aspect, shape.axis);
        let agreement = agreement(&around(residual, at, beyond, radius), &image, [0, 0]);
        let brightness = agreement.is_positive().then(|| agreement.amplitude())?;
        Some(Match { shape, at, beyond, brightness, correlation: agreement.correlation(), beyond_depth })
    }

    fn is_particle(&self) -> bool {
        is_particle(self.shape.chi2_reduction, self.brightness) && self.correlation > LEAST_CORRELATION
    }

    fn subtract(&self, residual: &mut Residual, templates: &ShapeTemplates) {
        let (w, h) = (residual.image.width as isize, residual.image.height as isize);
        let Shape { depth, aspect, axis, .. } = self.shape;
        let r = templates.radius(depth);
        let side = 2 * r + 1;
        let counts = templates.image(depth, aspect, axis);
        let spline = Spline::new(&GrayImage { width: side, height: side, counts });
        let [dx, dy] = self.beyond.map(|beyond| beyond as f32);
        for (x, y) in (0..side).flat_map(|y| (0..side).map(move |x| (x, y))) {
            let [u, v] = [(x, self.at[0]), (y, self.at[1])].map(|(i, at)| at + i as isize - r as isize);
            if (0..w).contains(&u) && (0..h).contains(&v) {
                let light = spline.at(x as f32 - dx, y as f32 - dy);
                residual.image.counts[(v * w + u) as usize] -= self.brightness as f32 * light;
            }
        }
    }

    pub(super) fn pose(&self, templates: &ShapeTemplates) -> Pose {
        let depths = &templates.depths_um;
        let step_um = depths[1] - depths[0];
        let z_um = depths[self.shape.depth] + self.beyond_depth * step_um;
        Pose {
            at: [0, 1].map(|k| self.at[k] as f64 + self.beyond[k]),
            z_um,
            axis: self.shape.axis,
            e_p: templates.aspects[self.shape.aspect],
            brightness: self.brightness,
        }
    }
}
