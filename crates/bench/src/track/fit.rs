//! A particle's place, depth and brightness by least squares, each pixel weighted by what is known of its noise.

use glam::{DMat4, DVec4};

use super::picture::Picture;
use super::templates::{Patch, Templates};

/// Steps of the fit at most.
const LONGEST: usize = 12;

/// The fit has arrived when its next step is shorter, px or steps of the stack.
const SHORT: f64 = 0.005;

/// A frame while particles are looked for.
#[derive(Debug)]
pub(super) struct Scene {
    /// Counts above the background that no particle accounts for yet.
    pub(super) left: Picture,
    /// One over the variance of each of them.
    pub(super) weight: Vec<f32>,
}

/// A particle with its brightness in units of the template's.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Fit {
    /// From the middle of the first pixel, px.
    pub(super) at: [f64; 2],
    /// Place between the steps of the stack.
    pub(super) step: f64,
    pub(super) amplitude: f64,
    /// By how much the particle lowers the weighted sum of squares of what is left.
    pub(super) gained: f64,
    /// Correlation of what is left with the particle, weighted.
    pub(super) cm: f64,
}

impl Scene {
    /// Calls `visit` with the pixels under a patch and the patch's values.
    pub(super) fn under<'a>(
        &'a self,
        patch: &'a Patch,
        [cx, cy]: [isize; 2],
    ) -> impl Iterator<Item = (usize, [f32; 4])> + 'a {
        let (r, side) = (patch.radius as isize, 2 * patch.radius + 1);
        let (w, h) = (self.left.width as isize, self.left.height as isize);
        let (from, to) = ((cx - r).max(0), (cx + r + 1).min(w));
        ((cy - r).max(0)..(cy + r + 1).min(h)).flat_map(move |y| {
            let row = (y - cy + r) as usize * side;
            (from..to).map(move |x| ((y * w + x) as usize, patch.light[row + (x - cx + r) as usize]))
        })
    }

    /// Adds `sign` times the particle to what is left.
    pub(super) fn add(&mut self, templates: &Templates, fit: &Fit, sign: f64) {
        let (patch, middle) = fit.patch(templates, templates.radius_around(fit.step, 1));
        let amplitude = (sign * fit.amplitude) as f32;
        let pixels: Vec<(usize, [f32; 4])> = self.under(&patch, middle).collect();
        for (i, light) in pixels {
            self.left.counts[i] += amplitude * light[0];
        }
    }
}

impl Fit {
    fn patch(&self, templates: &Templates, radius: usize) -> (Patch, [isize; 2]) {
        let middle = self.at.map(f64::round);
        let offset = [self.at[0] - middle[0], self.at[1] - middle[1]];
        (templates.patch(self.step, offset, radius), middle.map(|c| c as isize))
    }

    /// The best fit near a place and depth.
    pub(super) fn near(scene: &Scene, templates: &Templates, at: [f64; 2], step: f64) -> Option<Fit> {
        let radius = templates.radius_around(step, 3);
        let mut best = Fit { at, step, amplitude: 0.0, gained: 0.0, cm: 0.0 };
        let (mut next, mut damping) = (best, 1e-3f64);
        let mut normal = (DMat4::ZERO, DVec4::ZERO);
        for k in 0..LONGEST {
            let (patch, middle) = next.patch(templates, radius);
            let (mut own, mut both, mut seen) = (0.0, 0.0, 0.0);
            for (i, light) in scene.under(&patch, middle) {
                let (w, f, t) = (scene.weight[i], scene.left.counts[i], light[0]);
                own += f64::from(w * t * t);
                both += f64::from(w * f * t);
                seen += f64::from(w * f * f);
            }
            if own <= 0.0 || both <= 0.0 {
                return (k > 0).then_some(best);
            }
            let gained = both * both / own;
            if gained > best.gained {
                let amplitude = both / own;
                next = Fit { amplitude, gained, cm: both / (own * seen).sqrt(), ..next };
                best = next;
                damping = (0.3 * damping).max(1e-4);
                normal = equations(scene, &patch, middle, amplitude);
            } else {
                damping *= 10.0;
            }
            let (matrix, right) = normal;
            let diagonal = DMat4::from_diagonal(matrix.diagonal() * damping);
            let way = (matrix + diagonal).inverse() * right;
            if !way.is_finite() {
                return Some(best);
            }
            let last = (templates.len() - 1) as f64;
            next.at = [best.at[0] + way.y.clamp(-1.0, 1.0), best.at[1] + way.z.clamp(-1.0, 1.0)];
            next.step = (best.step + way.w.clamp(-1.5, 1.5)).clamp(0.0, last);
            let gone = [next.at[0] - best.at[0], next.at[1] - best.at[1], next.step - best.step];
            if gone.iter().all(|g| g.abs() < SHORT) {
                return Some(best);
            }
        }
        Some(best)
    }
}

/// Normal equations for changes of brightness, x, y and depth.
fn equations(scene: &Scene, patch: &Patch, middle: [isize; 2], amplitude: f64) -> (DMat4, DVec4) {
    let (mut matrix, mut right) = (DMat4::ZERO, DVec4::ZERO);
    for (i, [t, x, y, z]) in scene.under(patch, middle) {
        let w = f64::from(scene.weight[i]);
        let slope = DVec4::new(
            f64::from(t),
            amplitude * f64::from(x),
            amplitude * f64::from(y),
            amplitude * f64::from(z),
        );
        let off = f64::from(scene.left.counts[i]) - amplitude * f64::from(t);
        let weighted = slope * w;
        right += weighted * off;
        matrix +=
            DMat4::from_cols(weighted * slope.x, weighted * slope.y, weighted * slope.z, weighted * slope.w);
    }
    (matrix, right)
}
