//! The calibration stack as templates: images of one particle over depth, smooth in place and depth.
//!
//! Noise is learnt from the stack too. An image and its mirror image show the same particle (the lens is symmetric, the
//! particle is in the middle), so that their difference is noise: that of the background and a part that grows with light.
//! The mean of the four mirror images has half of it.

use super::picture::{Picture, Spline, weights, weights_slope};
use super::recording::Step;

/// A template reaches as far as pixels are brighter than this part of its peak.
const FAINTEST: f32 = 0.05;

/// So many standard deviations of the noise bright, both smoothed.
const ABOVE_NOISE: f32 = 3.0;

/// Smoothing for that, px.
const SMOOTH_PX: f32 = 1.5;

/// A particle image at one depth.
#[derive(Debug)]
pub(super) struct Template {
    pub(super) z_um: f64,
    /// Counts above the background, the particle in the middle.
    picture: Picture,
    spline: Spline,
    /// The image reaches so far from its middle, px.
    pub(super) radius: usize,
}

/// The templates, by depth, and the noise that frames taken like them have.
#[derive(Debug)]
pub(super) struct Templates {
    all: Vec<Template>,
    /// Variance of the noise for each count of light.
    pub(super) gain: f32,
}

/// A template between pixels and depths, over a square around a pixel, with its slopes; row by row.
#[derive(Debug)]
pub(super) struct Patch {
    pub(super) radius: usize,
    /// Light, and its derivatives by the particle's x and y (px) and depth (steps).
    pub(super) light: Vec<[f32; 4]>,
}

impl Templates {
    pub(super) fn new(steps: &[Step]) -> Self {
        // Images far out of focus fill their picture; the darkest shows the background.
        let level = steps.iter().map(|s| s.picture.median()).fold(f32::INFINITY, f32::min);
        let (mut noise, mut light) = (0.0, 0.0);
        let all: Vec<Template> = steps
            .iter()
            .map(|step| {
                let whole = centred(step, level);
                let (sum, squares) = mirrored_noise(&whole);
                light += sum;
                noise += squares;
                Template::new(step.z_um, mirrored_mean(&whole))
            })
            .collect();
        Templates { all, gain: if light > 0.0 { (noise / light).max(0.0) as f32 } else { 0.0 } }
    }

    pub(super) fn len(&self) -> usize {
        self.all.len()
    }

    pub(super) fn get(&self, step: usize) -> &Template {
        &self.all[step]
    }

    /// The physical depth of a place between the steps.
    pub(super) fn depth_um(&self, step: f64) -> f64 {
        let low = (step.floor().max(0.0) as usize).min(self.len().saturating_sub(2));
        let high = (low + 1).min(self.len() - 1);
        let t = step - low as f64;
        self.all[low].z_um + t * (self.all[high].z_um - self.all[low].z_um)
    }

    /// The radius that holds all templates near a step.
    pub(super) fn radius_around(&self, step: f64, reach: usize) -> usize {
        let middle = step.round().max(0.0) as usize;
        let near = middle.saturating_sub(reach)..(middle + reach + 1).min(self.len());
        self.all[near].iter().map(|t| t.radius).max().unwrap_or(0)
    }

    /// The particle `offset` px beside the middle of a square, at a depth between the steps (cubic through four of them,
    /// Catmull & Rom 1974).
    pub(super) fn patch(&self, step: f64, offset: [f64; 2], radius: usize) -> Patch {
        let low = (step.floor().max(0.0) as usize).min(self.len().saturating_sub(2));
        let t = (step - low as f64) as f32;
        let (t2, t3) = (t * t, t * t * t);
        let value = [
            -0.5 * t3 + t2 - 0.5 * t,
            1.5 * t3 - 2.5 * t2 + 1.0,
            -1.5 * t3 + 2.0 * t2 + 0.5 * t,
            0.5 * (t3 - t2),
        ];
        let slope = [-1.5 * t2 + 2.0 * t - 0.5, 4.5 * t2 - 5.0 * t, -4.5 * t2 + 4.0 * t + 0.5, 1.5 * t2 - t];
        let last = self.len() as isize - 1;
        let knots: [&Picture; 4] = std::array::from_fn(|i| {
            let k = (low as isize + i as isize - 1).clamp(0, last);
            self.all[k as usize].spline.coefficients()
        });
        let (width, middle) = (knots[0].width, (knots[0].width / 2) as isize);
        // All pixels of the square lie equally between those of the template.
        let base = offset.map(|o| (-o).floor());
        let part: [f32; 2] = std::array::from_fn(|i| (-offset[i] - base[i]) as f32);
        let (wx, wy) = (weights(part[0]), weights(part[1]));
        let (sx, sy) = (weights_slope(part[0]), weights_slope(part[1]));
        let (side, r) = (2 * radius + 1, radius as isize);
        let inside = |i: isize| i.clamp(0, width as isize - 1) as usize;
        // Along x first, for the rows that the square needs.
        let mut rows = vec![[0.0f32; 3]; side * (side + 3)];
        for (j, row) in rows.chunks_mut(side).enumerate() {
            let v = inside(middle + base[1] as isize - r + j as isize - 1) * width;
            let along: Vec<[f32; 2]> = (0..side + 3)
                .map(|i| {
                    let at = v + inside(middle + base[0] as isize - r + i as isize - 1);
                    let mut both = [0.0; 2];
                    for k in 0..4 {
                        both[0] += value[k] * knots[k].counts[at];
                        both[1] += slope[k] * knots[k].counts[at];
                    }
                    both
                })
                .collect();
            for (i, cell) in row.iter_mut().enumerate() {
                for k in 0..4 {
                    let [c, d] = along[i + k];
                    cell[0] += wx[k] * c;
                    cell[1] -= sx[k] * c;
                    cell[2] += wx[k] * d;
                }
            }
        }
        let light = (0..side * side)
            .map(|at| {
                let mut cell = [0.0; 4];
                for k in 0..4 {
                    let [c, x, z] = rows[at + k * side];
                    cell[0] += wy[k] * c;
                    cell[1] += wy[k] * x;
                    cell[2] -= sy[k] * c;
                    cell[3] += wy[k] * z;
                }
                cell
            })
            .collect();
        Patch { radius, light }
    }
}

impl Template {
    fn new(z_um: f64, picture: Picture) -> Self {
        let smooth = picture.smoothed(SMOOTH_PX);
        let peak = smooth.counts.iter().copied().fold(0.0, f32::max);
        let middle = picture.width / 2;
        let threshold = (FAINTEST * peak).max(ABOVE_NOISE * smooth.background().1);
        // Of the pixels that stand out, the farthest but a few, which may be noise.
        let mut reach: Vec<usize> = (0..picture.counts.len())
            .filter(|&i| smooth.counts[i] > threshold)
            .map(|i| (i % picture.width).abs_diff(middle).max((i / picture.width).abs_diff(middle)))
            .collect();
        reach.sort_unstable();
        let farthest = reach.get(reach.len() * 99 / 100).copied().unwrap_or(0);
        Template { z_um, radius: (farthest + 2).min(middle), spline: Spline::new(&picture), picture }
    }

    /// The template's pixel beside its middle.
    pub(super) fn at(&self, dx: isize, dy: isize) -> f32 {
        let middle = (self.picture.width / 2) as isize;
        self.picture.counts[((middle + dy) * (2 * middle + 1) + middle + dx) as usize]
    }
}

/// The largest square of a step around the particle, above the background.
fn centred(step: &Step, level: f32) -> Picture {
    let [cx, cy] = step.at.map(|c| c.round() as usize);
    let room = |c: usize, size: usize| c.min((size - 1).saturating_sub(c));
    let room = room(cx, step.picture.width).min(room(cy, step.picture.height));
    let (left, top) = (cx - room, cy - room);
    Picture::from_fn((2 * room + 1, 2 * room + 1), |x, y| {
        step.picture.counts[(top + y) * step.picture.width + left + x] - level
    })
}

/// The mean of an image and its mirror images.
fn mirrored_mean(picture: &Picture) -> Picture {
    let last = picture.width - 1;
    let at = |x: usize, y: usize| picture.counts[y * picture.width + x];
    Picture::from_fn((picture.width, picture.height), |x, y| {
        0.25 * (at(x, y) + at(last - x, y) + at(x, last - y) + at(last - x, last - y))
    })
}

/// Sum of light, and sum of the variance that comes with it.
fn mirrored_noise(picture: &Picture) -> (f64, f64) {
    let last = picture.width - 1;
    let background = picture.noise().powi(2);
    let at = |x: usize, y: usize| picture.counts[y * picture.width + x];
    let (mut light, mut noise) = (0.0, 0.0);
    for y in 0..picture.height {
        for x in 0..picture.width / 2 {
            let (here, there) = (at(x, y), at(last - x, y));
            light += f64::from(0.5 * (here + there));
            noise += f64::from(0.5 * (here - there).powi(2) - background);
        }
    }
    (light, noise)
}
