//! Correlation maps: by how much a template at each pixel lowers the weighted sum of squares of a frame.
//!
//! With weights w, frame f and template t that is (sum w f t)^2 / (sum w t^2): the square of the normalised
//! cross-correlation, times what there is to explain. Both sums are correlations, by Fourier transforms.

use rustfft::num_complex::Complex32;

use super::fit::Scene;
use super::fourier::{Plane, Way};
use super::templates::Templates;

/// What all correlation maps of a frame have in common.
pub(super) struct Maps {
    /// Of the maps: the frame and a margin on each side, where particles beyond the edge are.
    size: (usize, usize),
    /// Of the planes: nothing reaches around.
    padded: (usize, usize),
    fourier: Plane,
    /// Transforms of weighted counts and of weights.
    weighted: Vec<Complex32>,
    weights: Vec<Complex32>,
}

impl Maps {
    pub(super) fn new(scene: &Scene, margin: usize) -> Self {
        let frame = (scene.left.width, scene.left.height);
        let size = (frame.0 + 2 * margin, frame.1 + 2 * margin);
        let padded = (size.0 + margin, size.1 + margin);
        let fourier = Plane::new(padded);
        let mut scratch = fourier.scratch();
        let mut transformed = |value: &dyn Fn(usize) -> f32| {
            let mut plane = vec![Complex32::default(); padded.0 * padded.1];
            for y in 0..frame.1 {
                for x in 0..frame.0 {
                    plane[(y + margin) * padded.0 + x + margin].re = value(y * frame.0 + x);
                }
            }
            fourier.transform(&mut plane, Way::Forward, &mut scratch);
            plane
        };
        let weighted = transformed(&|i| scene.weight[i] * scene.left.counts[i]);
        let weights = transformed(&|i| scene.weight[i]);
        Maps { size, padded, fourier, weighted, weights }
    }

    /// By how much a template lowers the weighted sum of squares, pixel by pixel.
    pub(super) fn gained(&self, templates: &Templates, step: usize) -> Vec<f32> {
        let both = self.correlated(&self.weighted, templates, step, |light| light);
        let own = self.correlated(&self.weights, templates, step, |light| light * light);
        both.iter().zip(own).map(|(b, o)| if *b > 0.0 && o > 0.0 { b * b / o } else { 0.0 }).collect()
    }

    fn correlated(
        &self,
        frame: &[Complex32],
        templates: &Templates,
        step: usize,
        value: impl Fn(f32) -> f32,
    ) -> Vec<f32> {
        let template = templates.get(step);
        let r = template.radius as isize;
        let (w, h) = self.padded;
        let mut plane = vec![Complex32::default(); w * h];
        for dy in -r..=r {
            for dx in -r..=r {
                let (x, y) = (dx.rem_euclid(w as isize) as usize, dy.rem_euclid(h as isize) as usize);
                plane[y * w + x].re = value(template.at(dx, dy));
            }
        }
        let mut scratch = self.fourier.scratch();
        self.fourier.transform(&mut plane, Way::Forward, &mut scratch);
        for (p, f) in plane.iter_mut().zip(frame) {
            *p = p.conj() * f;
        }
        self.fourier.transform(&mut plane, Way::Backward, &mut scratch);
        let scale = 1.0 / (w * h) as f32;
        let rows = plane.chunks(w).take(self.size.1);
        rows.flat_map(|row| row[..self.size.0].iter().map(|p| p.re * scale)).collect()
    }
}
