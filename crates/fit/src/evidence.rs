//! Material for the report of a fit: images and curves over depth, of the data and of the model.

use super::curves::quantiles;
use super::images::Problem;
use super::state::{Count, State};
use storage::error::Result;

/// Number of brightest pixels of the model whose mean is the peak.
const PEAK_PIXELS: usize = 9;

/// Images and curves of a fit.
#[derive(Debug, Clone, PartialEq)]
pub struct Evidence {
    /// Edge of a window, px.
    pub edge_px: usize,
    /// Whether widths are along and across the axis of a cylindrical lens; radii otherwise.
    pub astigmatic: bool,
    /// One entry for each particle and plane, particle by particle.
    pub samples: Vec<Sample>,
}

/// A particle in a plane.
#[derive(Debug, Clone, PartialEq)]
pub struct Sample {
    /// Index of the particle, from 0.
    pub particle: usize,
    /// Index of the plane, from 0.
    pub plane: usize,
    /// Depth of the particle, um of the model.
    pub z_um: f64,
    /// Whether the window is rejected.
    pub rejected: bool,
    /// Sum of squared residuals over variance, per pixel.
    pub chi2: f64,
    /// The data.
    pub data: MeasuredImage,
    /// The model.
    pub model: MeasuredImage,
    /// Residuals in standard deviations, row by row; NaN where a pixel belongs to another particle.
    pub residual: Vec<f32>,
}

/// An image of a particle and the quantities measured in it.
#[derive(Debug, Clone, PartialEq)]
pub struct MeasuredImage {
    /// Counts above the background, row by row; NaN where a pixel belongs to another particle.
    pub counts: Vec<f32>,
    /// Distances from the particle within which half of the light lies, px: along the axis of the cylindrical
    /// lens and across it; without one, both are the radius.
    pub half_light_px: [f64; 2],
    /// Mean over the brightest pixels of the model, counts.
    pub peak: f64,
    /// Light in the window, counts.
    pub light: f64,
}

impl Evidence {
    pub(super) fn of(problem: &Problem, state: &State, astigmatic: bool) -> Result<Evidence> {
        let renderer = problem.renderer(state)?;
        let edge_px = problem.edge_px();
        let mut samples = Vec::new();
        for (k, window) in problem.windows.particles.iter().enumerate() {
            for (i, plane) in problem.scan.planes.iter().enumerate() {
                let values = problem.values(&renderer, state, &state.microscope, k, i);
                let background = state.beads[k].background;
                let mut residual = vec![f32::NAN; edge_px * edge_px];
                let mut chi2 = 0.0;
                let (mut data, mut model) = (Vec::new(), Vec::new());
                for (&(at, [dx, dy]), &value) in window.pixels.iter().zip(&values) {
                    let Count { mean, variance, .. } = problem.count(state, k, i, value);
                    let r = (f64::from(plane[at]) - mean) / libm::sqrt(variance);
                    let middle = problem.windows.half as f64;
                    let place = (dy + middle) as usize * edge_px + (dx + middle) as usize;
                    residual[place] = r as f32;
                    chi2 += r * r;
                    data.push((place, f64::from(plane[at]) - background));
                    model.push((place, mean - background));
                }
                let view = View { problem, state, k, i, astigmatic, brightest: brightest(&model) };
                samples.push(Sample {
                    particle: k,
                    plane: i,
                    z_um: problem.depth(state, &state.microscope, k, i),
                    rejected: problem.rejected[k][i],
                    chi2: chi2 / (values.len().max(1) as f64),
                    data: view.seen(&data),
                    model: view.seen(&model),
                    residual,
                });
            }
        }
        Ok(Evidence { edge_px, astigmatic, samples })
    }
}

/// A window in which an image is measured.
struct View<'a> {
    problem: &'a Problem<'a>,
    state: &'a State,
    k: usize,
    i: usize,
    astigmatic: bool,
    /// Indices of the model's brightest pixels in the window's list.
    brightest: Vec<usize>,
}

/// Indices of the brightest pixels.
fn brightest(model: &[(usize, f64)]) -> Vec<usize> {
    let mut order: Vec<usize> = (0..model.len()).collect();
    order.sort_by(|&a, &b| model[b].1.total_cmp(&model[a].1));
    order.truncate(PEAK_PIXELS);
    order
}

impl View<'_> {
    fn seen(&self, pixels: &[(usize, f64)]) -> MeasuredImage {
        let edge = self.problem.edge_px();
        let mut counts = vec![f32::NAN; edge * edge];
        pixels.iter().for_each(|&(place, value)| counts[place] = value as f32);
        let [x, y] = self.problem.position(self.state, self.k, self.i);
        let angle = self.state.microscope.angle;
        let (c, s) = (libm::cos(angle), libm::sin(angle));
        let within = |distance: &dyn Fn(f64, f64) -> f64| {
            let window = &self.problem.windows.particles[self.k].pixels;
            let mut lit: Vec<(f64, f64)> = window
                .iter()
                .zip(pixels)
                .map(|(&(_, [px, py]), &(_, value))| (px - x, py - y, value))
                .filter(|(dx, dy, _)| libm::hypot(*dx, *dy) <= self.problem.windows.half as f64)
                .map(|(dx, dy, value)| (distance(dx, dy), value))
                .collect();
            quantiles(&mut lit)[1]
        };
        let half_light_px = if self.astigmatic {
            [within(&|dx, dy| (c * dx + s * dy).abs()), within(&|dx, dy| (c * dy - s * dx).abs())]
        } else {
            [within(&|dx, dy| libm::hypot(dx, dy)); 2]
        };
        MeasuredImage {
            counts,
            half_light_px,
            peak: self.brightest.iter().map(|&i| pixels[i].1).sum::<f64>()
                / (self.brightest.len().max(1) as f64),
            light: pixels.iter().map(|(_, value)| value).sum(),
        }
    }
}
