//! Correlation maps: the reduction of chi^2 of a frame by a template centered at each pixel.
//!
//! With weights w, frame f and template t it is (sum w f t)^2 / (sum w t^2): the squared normalized
//! cross-correlation times sum w f^2. Both sums are cross-correlations, computed by FFT.

use fourier::{Complex32, Direction, ImageFft};

use super::fit::Residual;
use super::templates::Templates;

/// Transforms shared by all correlation maps of a frame.
pub(super) struct CorrelationMaps {
    /// Size of the maps: the frame with a margin on each side for particles beyond the edge.
    size: (usize, usize),
    /// Size of the FFT planes, padded against circular wrap-around.
    padded: (usize, usize),
    fourier: ImageFft,
    /// Transforms of the weighted counts and of the weights.
    weighted: Vec<Complex32>,
    weights: Vec<Complex32>,
}

impl CorrelationMaps {
    pub(super) fn new(residual: &Residual, margin: usize) -> Self {
        let frame = (residual.image.width, residual.image.height);
        let size = (frame.0 + 2 * margin, frame.1 + 2 * margin);
        let padded = (size.0 + margin, size.1 + margin);
        let fourier = ImageFft::new(padded);
        let mut scratch = fourier.scratch();
        let mut transformed = |value: &dyn Fn(usize) -> f32| {
            let mut plane = vec![Complex32::default(); padded.0 * padded.1];
            for y in 0..frame.1 {
                for x in 0..frame.0 {
                    plane[(y + margin) * padded.0 + x + margin].re = value(y * frame.0 + x);
                }
            }
            fourier.transform(&mut plane, Direction::Forward, &mut scratch);
            plane
        };
        let weighted = transformed(&|i| residual.weight[i] * residual.image.counts[i]);
        let weights = transformed(&|i| residual.weight[i]);
        CorrelationMaps { size, padded, fourier, weighted, weights }
    }

    /// The reduction of chi^2 by a template at every pixel of the map.
    pub(super) fn chi2_reduction(&self, templates: &Templates, step: usize) -> Vec<f32> {
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
        self.fourier.transform(&mut plane, Direction::Forward, &mut scratch);
        for (p, f) in plane.iter_mut().zip(frame) {
            *p = p.conj() * f;
        }
        self.fourier.transform(&mut plane, Direction::Backward, &mut scratch);
        let scale = 1.0 / (w * h) as f32;
        let rows = plane.chunks(w).take(self.size.1);
        rows.flat_map(|row| row[..self.size.0].iter().map(|p| p.re * scale)).collect()
    }
}
