//! Memory layout of the coefficients of a plane over a quadrant.
//!
//! Along a row of an image, pixels are an integer number of nodes apart, so that all have the same phase
//! relative to the nodes. A row of nodes is therefore stored phase by phase, each phase as a run that
//! adjacent pixels read contiguously.

use crate::bspline;
use crate::render::depth_table::InterpolatedPlane;
use crate::render::image_sum::LANES;

/// One group of values; the length of a run is a multiple of its length.
pub(super) type Group = [f32; LANES];

/// A quadrant of nodes, the axes included.
#[derive(Debug, Clone, PartialEq)]
pub struct QuadrantLayout {
    /// Nodes per px, which is the number of phases of a row.
    pub(super) per_px: usize,
    pub(super) rows: usize,
    /// Number of nodes of one phase in a row.
    pub(super) run: usize,
}

impl QuadrantLayout {
    /// The layout of a quadrant with these numbers of columns and rows; the image is zero beyond them.
    pub(super) fn new(per_px: usize, columns: usize, rows: usize) -> QuadrantLayout {
        QuadrantLayout { per_px, rows, run: columns.div_ceil(per_px).next_multiple_of(LANES) }
    }

    /// Number of values per row.
    pub(super) fn row(&self) -> usize {
        self.per_px * self.run
    }

    /// Number of values per plane.
    pub(super) fn length(&self) -> usize {
        self.rows * self.row()
    }

    /// Position of a node in its row; `None` if it is beyond the nodes.
    pub(super) fn place(&self, column: usize) -> Option<usize> {
        let (phase, i) = (column % self.per_px, column / self.per_px);
        (i < self.run).then_some(phase * self.run + i)
    }

    /// Writes coefficients, given row by row, in this layout.
    pub(super) fn store<T: Copy>(
        &self,
        coefficients: &[f64],
        columns: usize,
        out: &mut [T],
        to: fn(f64) -> T,
    ) {
        for (line, out) in coefficients.chunks(columns).zip(out.chunks_mut(self.row())) {
            for (column, &value) in line.iter().enumerate() {
                if let Some(place) = self.place(column) {
                    out[place] = to(value);
                }
            }
        }
    }

    /// The image and its derivatives: see [`crate::render::depth_table::PlaneLayout`].
    pub(super) fn at(&self, plane: &InterpolatedPlane, dx: f64, dy: f64) -> [f64; 4] {
        let scale = self.per_px as f64;
        let (first_x, weights_x, slopes_x) = around(dx.abs() * scale);
        let (first_y, weights_y, slopes_y) = around(dy.abs() * scale);
        let mut sum = [0.0; 4];
        for j in 0..4 {
            let row = (first_y + j as isize).unsigned_abs();
            if row >= self.rows {
                continue;
            }
            let (mut value, mut slope, mut by_z) = (0.0, 0.0, 0.0);
            for i in 0..4 {
                let Some(at) = self.place((first_x + i as isize).unsigned_abs()) else { continue };
                let at = row * self.row() + at;
                value += weights_x[i] * plane.value[at];
                slope += slopes_x[i] * plane.value[at];
                by_z += weights_x[i] * plane.by_z[at];
            }
            sum[0] += weights_y[j] * value;
            sum[1] += weights_y[j] * slope * scale;
            sum[2] += slopes_y[j] * value * scale;
            sum[3] += weights_y[j] * by_z;
        }
        [sum[0], sum[1] * dx.signum(), sum[2] * dy.signum(), sum[3]]
    }
}

/// The index of the first of the four coefficients around a position (in nodes), their weights and the
/// derivatives of these.
fn around(nodes: f64) -> (isize, [f64; 4], [f64; 4]) {
    let cell = libm::floor(nodes);
    let (weights, slopes) = bspline::cubic(nodes - cell);
    (cell as isize - 1, weights, slopes)
}
