//! GDPT: depth by correlation with the calibration stack.
//!
//! Images of the stack are templates (Barnkob, Kaehler & Rossi 2015, Lab Chip 15, 3556). Maps of their
//! cross-correlation with a frame, each pixel weighted by one over the variance of its noise, show where particles may be.
//! The likeliest comes first: its place, depth and brightness are fitted, and if it is bright enough and like its template
//! it is taken out of the frame, so that rings do not answer twice and overlapped particles show. In the end every particle
//! is fitted again with all others taken out.

use super::Found;
use super::fit::{Fit, Scene};
use super::maps::Maps;
use super::picture::Picture;
use super::recording::Step;
use super::templates::Templates;

/// Templates whose whole maps are computed.
const COARSE: usize = 13;

/// A particle is so many standard deviations of the noise bright, all its pixels together.
const LEAST_SIGNIFICANCE: f64 = 8.0;

/// Least correlation of a particle.
const LEAST_CM: f64 = 0.5;

/// Brightness of particles in units of the calibration's. Bright pieces of large images look like faint small ones.
const BRIGHTNESS: std::ops::RangeInclusive<f64> = 0.25..=4.0;

/// How well templates describe particles while some are still mixed up: light is uncertain by this part.
const ROUGH: f32 = 0.1;

/// The same when all are known.
const FINE: f32 = 0.03;

/// Steps of the stack up and down from where a fit is tried again.
const OTHER_DEPTHS: [f64; 6] = [-12.0, -8.0, -4.0, 4.0, 8.0, 12.0];

/// Two particles nearer than this may be one that was taken for two, px.
const SAME_PLACE_PX: f64 = 3.0;

/// One particle is as good as two if it accounts for this part of the light.
const AS_GOOD: f64 = 0.97;

/// Fits are tried from the so many likeliest depths.
const STARTS: usize = 3;

/// Finds particles like those of a calibration stack.
#[derive(Debug)]
pub(super) struct Stack {
    templates: Templates,
}

/// Where a particle may be.
#[derive(Debug, Clone, Copy)]
struct Candidate {
    step: usize,
    x: isize,
    y: isize,
    /// By how much it would lower the weighted sum of squares.
    gained: f32,
}

impl Stack {
    pub(super) fn new(steps: &[Step]) -> Self {
        Stack { templates: Templates::new(steps) }
    }

    /// The particles of an image.
    pub(super) fn find(&self, picture: &Picture) -> Vec<Found> {
        let (level, noise) = picture.background();
        let mut frame = picture.clone();
        frame.counts.iter_mut().for_each(|c| *c -= level);
        // Without noise, rounding is left.
        let dark = noise.powi(2).max(1.0 / 12.0);
        let rough = weights(&frame, dark, self.templates.gain, ROUGH);
        let fine = weights(&frame, dark, self.templates.gain, FINE);
        let scene = Scene { left: frame, weight: rough };
        let mut search = Search { templates: &self.templates, scene, found: Vec::new() };
        for candidate in self.candidates(&search.scene) {
            search.take(candidate);
        }
        search.again();
        search.scene.weight = fine;
        search.again();
        let place = |fit: &Fit| Found {
            x_px: fit.at[0] + 1.0,
            y_px: fit.at[1] + 1.0,
            z_um: Some(self.templates.depth_um(fit.step)),
        };
        // Particles beyond the edge may light the image; they are not in it.
        let on_sensor = |fit: &&Fit| {
            let size = [picture.width, picture.height].map(|n| n as f64);
            fit.at.iter().zip(size).all(|(c, n)| (-0.5..n - 0.5).contains(c))
        };
        search.found.iter().filter(on_sensor).map(place).collect()
    }

    /// Local maxima of the correlation maps of the coarse templates, the likeliest first.
    fn candidates(&self, scene: &Scene) -> Vec<Candidate> {
        let stride = self.templates.len().div_ceil(COARSE).max(1);
        let coarse: Vec<usize> = (stride / 2..self.templates.len()).step_by(stride).collect();
        let margin = coarse.iter().map(|&k| self.templates.get(k).radius).max().unwrap_or(0);
        let maps = Maps::new(scene, margin);
        let (w, h) = (scene.left.width + 2 * margin, scene.left.height + 2 * margin);
        let mut candidates = Vec::new();
        for step in coarse {
            let map = maps.gained(&self.templates, step);
            let least = (LEAST_SIGNIFICANCE * LEAST_SIGNIFICANCE) as f32;
            for y in 0..h {
                for x in 0..w {
                    let gained = map[y * w + x];
                    let mut around = (y.saturating_sub(1)..(y + 2).min(h))
                        .flat_map(|v| &map[v * w + x.saturating_sub(1)..v * w + (x + 2).min(w)]);
                    if gained > least && around.all(|other| *other <= gained) {
                        let [x, y] = [x, y].map(|c| c as isize - margin as isize);
                        candidates.push(Candidate { step, x, y, gained });
                    }
                }
            }
        }
        let place = |c: &Candidate| (c.y, c.x, c.step);
        candidates.sort_by(|a, b| b.gained.total_cmp(&a.gained).then(place(a).cmp(&place(b))));
        candidates
    }
}

/// One over the variance of each pixel: the background's, that of the light itself, and what templates cannot tell of it.
fn weights(frame: &Picture, dark: f32, gain: f32, error: f32) -> Vec<f32> {
    let variance = |(here, around): (&f32, &f32)| {
        let light = here.max(*around).max(0.0);
        dark + gain * light + (error * light).powi(2)
    };
    frame.counts.iter().zip(&frame.smoothed(1.0).counts).map(|both| 1.0 / variance(both)).collect()
}

/// The search through a frame.
struct Search<'a> {
    templates: &'a Templates,
    scene: Scene,
    found: Vec<Fit>,
}

impl Search<'_> {
    /// Takes a particle out of the frame if there is one.
    fn take(&mut self, candidate: Candidate) {
        let Candidate { x, y, .. } = candidate;
        let now = |step: usize| self.gained(step, x, y);
        // What was accepted since has explained this one.
        if now(candidate.step) < 0.5 * f64::from(candidate.gained).min(4.0 * LEAST_SIGNIFICANCE.powi(2)) {
            return;
        }
        let over_depth: Vec<f64> = (0..self.templates.len()).map(now).collect();
        let at = |k: usize, d: isize| over_depth.get(k.wrapping_add_signed(d)).copied().unwrap_or(0.0);
        let mut starts: Vec<usize> = (0..over_depth.len())
            .filter(|&k| at(k, 0) > 0.0 && at(k, 0) >= at(k, -1) && at(k, 0) > at(k, 1))
            .collect();
        starts.sort_by(|a, b| over_depth[*b].total_cmp(&over_depth[*a]));
        starts.truncate(STARTS);
        let fits = starts
            .into_iter()
            .filter_map(|k| Fit::near(&self.scene, self.templates, [x as f64, y as f64], k as f64));
        let best = fits.max_by(|a, b| a.gained.total_cmp(&b.gained));
        if let Some(fit) = best.filter(|fit| self.is_particle(fit)) {
            let fit = self.at_other_depths(fit);
            self.scene.add(self.templates, &fit, -1.0);
            self.found.push(fit);
            self.unite();
        }
    }

    /// The best of a fit and of fits that begin at depths around it: near the focus there are several that look alike.
    fn at_other_depths(&self, fit: Fit) -> Fit {
        let depths = OTHER_DEPTHS.map(|d| fit.step + d).into_iter();
        let others = depths.filter(|d| (0.0..self.templates.len() as f64).contains(d));
        let fits = others.filter_map(|step| Fit::near(&self.scene, self.templates, fit.at, step));
        fits.fold(fit, |best, other| if other.gained > best.gained { other } else { best })
    }

    /// If one particle explains the last one and another at the same place as well as both do, it takes their place.
    fn unite(&mut self) {
        let Some(last) = self.found.pop() else { return };
        let apart = |f: &Fit| (f.at[0] - last.at[0]).hypot(f.at[1] - last.at[1]);
        let Some(k) = self.found.iter().position(|f| apart(f) < SAME_PLACE_PX) else {
            self.found.push(last);
            return;
        };
        let first = self.found[k];
        self.scene.add(self.templates, &last, 1.0);
        self.scene.add(self.templates, &first, 1.0);
        let one = self.at_other_depths(first);
        if one.gained > AS_GOOD * (first.gained + last.gained) {
            self.scene.add(self.templates, &one, -1.0);
            self.found[k] = one;
        } else {
            self.scene.add(self.templates, &first, -1.0);
            self.scene.add(self.templates, &last, -1.0);
            self.found.push(last);
        }
    }

    fn is_particle(&self, fit: &Fit) -> bool {
        fit.gained > LEAST_SIGNIFICANCE.powi(2) && fit.cm > LEAST_CM && BRIGHTNESS.contains(&fit.amplitude)
    }

    /// Fits every particle with all others taken out; one that is no longer a particle is dropped for good.
    fn again(&mut self) {
        for fit in std::mem::take(&mut self.found) {
            self.scene.add(self.templates, &fit, 1.0);
            let better = Fit::near(&self.scene, self.templates, fit.at, fit.step);
            if let Some(better) = better.filter(|b| self.is_particle(b)) {
                self.scene.add(self.templates, &better, -1.0);
                self.found.push(better);
            }
        }
    }

    /// By how much a template at a pixel lowers the weighted sum of squares of what is left.
    fn gained(&self, step: usize, x: isize, y: isize) -> f64 {
        let template = self.templates.get(step);
        let r = template.radius as isize;
        let (w, h) = (self.scene.left.width as isize, self.scene.left.height as isize);
        let (mut own, mut both) = (0.0f32, 0.0f32);
        for v in (y - r).max(0)..(y + r + 1).min(h) {
            for u in (x - r).max(0)..(x + r + 1).min(w) {
                let i = (v * w + u) as usize;
                let light = template.at(u - x, v - y);
                let weighted = self.scene.weight[i] * light;
                own += weighted * light;
                both += weighted * self.scene.left.counts[i];
            }
        }
        if own > 0.0 && both > 0.0 { f64::from(both * both / own) } else { 0.0 }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A ring whose radius tells the depth.
    fn ring(picture: &mut Picture, [cx, cy]: [f64; 2], z_um: f64, brightness: f32) {
        let radius = 3.0 + 0.1 * z_um;
        for y in 0..picture.height {
            for x in 0..picture.width {
                let r = (x as f64 - cx).hypot(y as f64 - cy);
                picture.counts[y * picture.width + x] +=
                    brightness * (-0.5 * ((r - radius) / 1.5).powi(2)).exp() as f32;
            }
        }
    }

    fn noise(size: usize) -> Picture {
        Picture::from_fn((size, size), |x, y| 300.0 + ((x * 7 + y * 13 + x * y) % 9) as f32)
    }

    fn stack() -> Stack {
        let step = |k: i32| {
            let mut picture = noise(61);
            ring(&mut picture, [30.0, 30.0], 3.0 * f64::from(k), 200.0);
            Step { z_um: 3.0 * f64::from(k), at: [30.0, 30.0], picture }
        };
        Stack::new(&(0..40).map(step).collect::<Vec<_>>())
    }

    #[test]
    fn rings_are_found_once_and_at_their_depth() {
        let truth = [([40.3, 50.6], 22.0, 150.0), ([110.8, 42.1], 80.5, 260.0), ([75.0, 110.4], 51.3, 200.0)];
        let mut picture = noise(150);
        for (at, z, brightness) in truth {
            ring(&mut picture, at, z, brightness);
        }
        let found = stack().find(&picture);
        assert_eq!(found.len(), 3, "{found:?}");
        for ([x, y], z, _) in truth {
            let off = |f: &&Found| (f.x_px - 1.0 - x).hypot(f.y_px - 1.0 - y);
            let nearest = found.iter().min_by(|a, b| off(a).total_cmp(&off(b))).unwrap();
            assert!(off(&nearest) < 0.1, "{nearest:?}");
            assert!((nearest.z_um.unwrap() - z).abs() < 0.5, "{nearest:?} for {z}");
        }
    }

    #[test]
    fn rings_that_overlap_are_found_apart() {
        let mut picture = noise(120);
        ring(&mut picture, [50.0, 60.0], 60.0, 200.0);
        ring(&mut picture, [62.0, 60.0], 30.0, 250.0);
        assert_eq!(stack().find(&picture).len(), 2);
    }

    #[test]
    fn noise_holds_no_particles() {
        assert_eq!(stack().find(&noise(100)), []);
    }
}
