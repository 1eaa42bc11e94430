//! Errors of displacement gradients: central differences of both fields over the same neighbors.

use super::vectors::{ComparedVector, VectorGrid};
use crate::evaluate::statistics::ratio;

scores! {
    /// RMS errors of displacement gradients, by central differences of both fields; px per px.
    pub struct Gradients {
        /// Number of vectors with four valid neighbors.
        pub n: usize,
        /// RMS error of dv/dx - du/dy.
        not_negative vorticity_rms: Option<f64>,
        /// RMS of the true vorticity.
        not_negative true_vorticity_rms: Option<f64>,
        /// RMS error of du/dx + dv/dy.
        not_negative divergence_rms: Option<f64>,
        /// RMS of the true divergence.
        not_negative true_divergence_rms: Option<f64>,
        /// RMS of the norm of the error of the strain tensor, sqrt(e11^2 + e22^2 + 2 e12^2).
        not_negative strain_rms: Option<f64>,
        /// RMS of the norm of the true strain tensor.
        not_negative true_strain_rms: Option<f64>,
    }
}

/// du/dx, du/dy, dv/dx, dv/dy.
type Tensor = [f64; 4];

impl Gradients {
    /// Errors over valid vectors on a regular grid; `None` if none has four valid neighbors.
    pub fn of(grid: &VectorGrid, all: &[ComparedVector]) -> Option<Self> {
        let (mut n, mut errors, mut truths) = (0, [0.0; 3], [0.0; 3]);
        for cells in grid.pairs.values() {
            let valid = |i: usize, j: usize| cells[grid.cell(i, j)].filter(|&k| all[k].measured.flag == 0);
            for j in 1..grid.y_px.len().saturating_sub(1) {
                for i in 1..grid.x_px.len().saturating_sub(1) {
                    let neighbors = [valid(i - 1, j), valid(i + 1, j), valid(i, j - 1), valid(i, j + 1)];
                    let [Some(left), Some(right), Some(above), Some(below)] = neighbors else { continue };
                    let (width, height) =
                        (grid.x_px[i + 1] - grid.x_px[i - 1], grid.y_px[j + 1] - grid.y_px[j - 1]);
                    let tensor = |value: &dyn Fn(&ComparedVector) -> [f64; 2]| -> Tensor {
                        let [l, r, a, b] = [left, right, above, below].map(|k| value(&all[k]));
                        [
                            (r[0] - l[0]) / width,
                            (b[0] - a[0]) / height,
                            (r[1] - l[1]) / width,
                            (b[1] - a[1]) / height,
                        ]
                    };
                    let exact = tensor(&|c| [c.truth[0], c.truth[1]]);
                    let error = tensor(&|c| c.error());
                    add(&mut truths, &exact);
                    add(&mut errors, &error);
                    n += 1;
                }
            }
        }
        let root = |sum: f64| ratio(sum, n as f64).map(f64::sqrt);
        (n > 0).then(|| Gradients {
            n,
            vorticity_rms: root(errors[0]),
            true_vorticity_rms: root(truths[0]),
            divergence_rms: root(errors[1]),
            true_divergence_rms: root(truths[1]),
            strain_rms: root(errors[2]),
            true_strain_rms: root(truths[2]),
        })
    }
}

/// Adds the squares of vorticity, divergence and strain norm.
fn add(sums: &mut [f64; 3], &[ux, uy, vx, vy]: &Tensor) {
    let shear = 0.5 * (uy + vx);
    sums[0] += (vx - uy).powi(2);
    sums[1] += (ux + vy).powi(2);
    sums[2] += ux * ux + vy * vy + 2.0 * shear * shear;
}
