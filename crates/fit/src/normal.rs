use rayon::prelude::*;

use super::derivatives::Derivatives;
use super::imager::Imager;
use super::images::Problem;
use super::state::{Count, HUBER, State, huber};
use microsig_core::linear::Symmetric;
use storage::error::Result;

/// The normal equations at a state.
pub(super) struct Normal {
    pub(super) matrix: Symmetric,
    pub(super) right: Vec<f64>,
    pub(super) windows: Vec<WindowNormal>,
    /// Entries of the matrix that constrain the mean brightness of planes to 1.
    pub(super) gauge: Vec<(usize, usize, f64)>,
    /// Variances of pixels by window, counts^2.
    pub(super) variances: Vec<Vec<f32>>,
    pub(super) loss: f64,
}

/// Contribution of one window to the normal equations.
pub(super) struct WindowNormal {
    pub(super) bead: usize,
    pub(super) plane: usize,
    /// Parameters that the window depends on.
    pub(super) entries: Vec<usize>,
    matrix: Vec<f64>,
    /// Negative gradient of half the loss.
    pub(super) right: Vec<f64>,
    /// Variance of each pixel, counts^2.
    variances: Vec<f32>,
    loss: f64,
}

impl WindowNormal {
    /// Adds the window `times` times.
    pub(super) fn add_to(&self, matrix: &mut Symmetric, right: &mut [f64], times: f64) {
        for (a, &i) in self.entries.iter().enumerate() {
            for (b, &j) in self.entries.iter().enumerate() {
                matrix.add(i, j, times * self.matrix[a * self.entries.len() + b]);
            }
            right[i] += times * self.right[a];
        }
    }
}

impl Problem<'_> {
    /// The normal equations at a state, with the state's own weights.
    pub(super) fn normal(&self, state: &State, derivatives: &Derivatives) -> Result<Normal> {
        let own = self.renderer(state)?;
        let windows: Vec<(usize, usize)> = self.used().collect();
        let mut windows: Vec<WindowNormal> = windows
            .into_par_iter()
            .map(|(k, i)| self.window_normal(state, &own, derivatives, k, i))
            .collect();
        let n = self.n_parameters();
        let (mut matrix, mut right) = (Symmetric::zeros(n), vec![0.0; n]);
        // Added in the order of windows, so that sums do not depend on the number of threads.
        windows.iter().for_each(|window| window.add_to(&mut matrix, &mut right, 1.0));
        let loss = windows.iter().map(|window| window.loss).sum();
        let mut gauge = Vec::new();
        if self.free_flux {
            // Constrains the mean brightness of planes to 1, as a common factor of planes and particles is
            // undetermined. Planes without a window keep their brightness.
            let planes: Vec<usize> =
                (0..self.scan.planes.len()).filter(|&i| windows.iter().any(|w| w.plane == i)).collect();
            let diagonal = |i: usize| matrix.at(self.flux_parameter(i), self.flux_parameter(i));
            let scale = planes.first().map_or(1.0, |&i| diagonal(i)).max(1.0);
            let off = planes.iter().map(|&i| state.flux[i]).sum::<f64>() - planes.len() as f64;
            for &i in &planes {
                let entry = |&j: &usize| (self.flux_parameter(i), self.flux_parameter(j), scale);
                gauge.extend(planes.iter().map(entry));
                right[self.flux_parameter(i)] -= scale * off;
            }
            gauge.iter().for_each(|&(i, j, value)| matrix.add(i, j, value));
        }
        // Parameters on which no window depends do not change.
        for i in 0..n {
            if matrix.at(i, i) == 0.0 {
                matrix.add(i, i, 1.0);
            }
        }
        let variances = windows.iter_mut().map(|window| std::mem::take(&mut window.variances)).collect();
        Ok(Normal { matrix, right, windows, gauge, variances, loss })
    }

    fn window_normal(
        &self,
        state: &State,
        own: &Imager,
        derivatives: &Derivatives,
        k: usize,
        i: usize,
    ) -> WindowNormal {
        let values = self.values(own, state, &state.microscope, k, i);
        let from_mean = self.scan.stage_um[i] - self.scan.mean_stage_um();
        let n_shared = self.shared.len();
        let bead = self.bead_parameter(k);
        let mut entries: Vec<usize> = (0..n_shared + 2).chain(bead..bead + 5).collect();
        if self.free_flux {
            entries.push(self.flux_parameter(i));
        }
        let n = entries.len();
        let (matrix, right) = (vec![0.0; n * n], vec![0.0; n]);
        let variances = Vec::with_capacity(values.len());
        let mut part = WindowNormal { bead: k, plane: i, entries, matrix, right, variances, loss: 0.0 };
        let mut row = vec![0.0; n];
        let derivatives = derivatives.window(k, i).chunks(n_shared + 3);
        let pixels = self.windows.particles[k].pixels.iter();
        for ((&(at, _), &value), derivatives) in pixels.zip(&values).zip(derivatives) {
            let Count { mean, slope, variance, .. } = self.count(state, k, i, value);
            let factor = slope * state.flux[i] * state.beads[k].light;
            let by = |entry: usize| factor * f64::from(derivatives[entry]);
            row.iter_mut().take(n_shared).enumerate().for_each(|(entry, slot)| *slot = by(entry));
            row[n_shared] = by(n_shared) * from_mean;
            row[n_shared + 1] = by(n_shared + 1) * from_mean;
            (0..3).for_each(|axis| row[n_shared + 2 + axis] = by(n_shared + axis));
            row[n_shared + 5] = slope * state.flux[i] * value;
            row[n_shared + 6] = slope;
            if self.free_flux {
                row[n_shared + 7] = slope * state.beads[k].light * value;
            }
            part.variances.push(variance as f32);
            let variance = f64::from(variance as f32);
            let r = f64::from(self.scan.planes[i][at]) - mean;
            let size = r.abs() / libm::sqrt(variance);
            let weight = if size > HUBER { HUBER / size } else { 1.0 } / variance;
            part.loss += huber(size);
            for a in 0..n {
                let weighed = weight * row[a];
                part.right[a] += weighed * r;
                for (slot, other) in part.matrix[a * n..].iter_mut().zip(&row[..=a]) {
                    *slot += weighed * other;
                }
            }
        }
        for a in 0..n {
            for b in 0..a {
                part.matrix[b * n + a] = part.matrix[a * n + b];
            }
        }
        part
    }
}
