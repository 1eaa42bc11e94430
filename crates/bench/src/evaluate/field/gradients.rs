//! Errors of the gradients of displacement: central differences of both fields over the same neighbours.

use serde::Serialize;

use super::Compared;
use super::lattice::Lattice;
use crate::evaluate::statistics::ratio;

/// RMS errors, and RMS of the truth beside them; px per px.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
#[allow(missing_docs)]
pub struct Gradients {
    /// Vectors with four valid neighbours.
    pub n: usize,
    /// dv/dx - du/dy
    pub vorticity_rms: Option<f64>,
    pub true_vorticity_rms: Option<f64>,
    /// du/dx + dv/dy
    pub divergence_rms: Option<f64>,
    pub true_divergence_rms: Option<f64>,
    /// The strain tensor's norm, sqrt(e11^2 + e22^2 + 2 e12^2)
    pub strain_rms: Option<f64>,
    pub true_strain_rms: Option<f64>,
}

/// du/dx, du/dy, dv/dx, dv/dy.
type Tensor = [f64; 4];

impl Gradients {
    /// Of valid vectors that form a lattice; `None` if none has four neighbours.
    pub fn of(lattice: &Lattice, all: &[Compared]) -> Option<Self> {
        let (mut n, mut errors, mut truths) = (0, [0.0; 3], [0.0; 3]);
        for cells in lattice.pairs.values() {
            let valid = |i: usize, j: usize| cells[lattice.cell(i, j)].filter(|&k| all[k].found.flag == 0);
            for j in 1..lattice.y_px.len().saturating_sub(1) {
                for i in 1..lattice.x_px.len().saturating_sub(1) {
                    let neighbours = [valid(i - 1, j), valid(i + 1, j), valid(i, j - 1), valid(i, j + 1)];
                    let [Some(left), Some(right), Some(above), Some(below)] = neighbours else { continue };
                    let (width, height) = (
                        lattice.x_px[i + 1] - lattice.x_px[i - 1],
                        lattice.y_px[j + 1] - lattice.y_px[j - 1],
                    );
                    let tensor = |value: &dyn Fn(&Compared) -> [f64; 2]| -> Tensor {
                        let [l, r, a, b] = [left, right, above, below].map(|k| value(&all[k]));
                        [
                            (r[0] - l[0]) / width,
                            (b[0] - a[0]) / height,
                            (r[1] - l[1]) / width,
                            (b[1] - a[1]) / height,
                        ]
                    };
                    let exact = tensor(&|c| [c.exact[0], c.exact[1]]);
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

/// Adds squares of vorticity, divergence and strain.
fn add(sums: &mut [f64; 3], &[ux, uy, vx, vy]: &Tensor) {
    let shear = 0.5 * (uy + vx);
    sums[0] += (vx - uy).powi(2);
    sums[1] += (ux + vy).powi(2);
    sums[2] += ux * ux + vy * vy + 2.0 * shear * shear;
}
