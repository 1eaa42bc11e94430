//! Memory layout of the coefficients of a plane whose nodes are a grid.
//!
//! In a row of an image, pixels are a whole number of nodes apart, so all have the same phase relative to the
//! nodes. A row of nodes is therefore stored phase by phase; the nodes of one phase form a contiguous run,
//! which neighboring pixels read at consecutive addresses.

use super::depth_table::InterpolatedPlane;
use super::image_sum::LANES;

/// Nodes of a plane: one quadrant, including the axes, or all.
#[derive(Debug, Clone, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct NodeLayout {
    /// Nodes per px, which is the number of phases in a row.
    pub(super) per_px: usize,
    pub(super) columns: usize,
    pub(super) rows: usize,
    /// Whether only one quadrant is stored and the others are its mirror images.
    pub(super) mirrored: bool,
    /// Column and row of the node at the particle's center; a whole number of px.
    pub(super) origin: [usize; 2],
    /// Number of stored nodes of one phase in a row.
    pub(super) run: usize,
}

impl NodeLayout {
    /// The layout with these numbers of columns and rows; without mirror images, both are odd, and the node
    /// in the middle is the particle's.
    pub(super) fn new(per_px: usize, nodes: [usize; 2], mirrored: bool) -> NodeLayout {
        let [columns, rows] = nodes;
        let origin = if mirrored { [0; 2] } else { nodes.map(|nodes| nodes / 2) };
        let run = columns.div_ceil(per_px).next_multiple_of(LANES);
        NodeLayout { per_px, columns, rows, mirrored, origin, run }
    }

    /// Length of a row, numbers.
    pub(super) fn row(&self) -> usize {
        self.per_px * self.run
    }

    /// Length of a plane, numbers.
    pub(super) fn length(&self) -> usize {
        self.sizes().iter().product()
    }

    pub(super) fn sizes(&self) -> [usize; 3] {
        [self.per_px, self.run, self.rows]
    }

    fn stored(&self, node: isize, origin: usize, nodes: usize) -> Option<usize> {
        let at =
            if self.mirrored { node.unsigned_abs() } else { usize::try_from(node + origin as isize).ok()? };
        (at < nodes).then_some(at)
    }

    /// The stored column of a node, counted from the particle; `None` outside the plane, where there is no
    /// light.
    pub(super) fn column_of(&self, node: isize) -> Option<usize> {
        self.stored(node, self.origin[0], self.columns)
    }

    /// The stored row of a node, counted from the particle; `None` outside the plane.
    pub(super) fn row_of(&self, node: isize) -> Option<usize> {
        self.stored(node, self.origin[1], self.rows)
    }

    /// Index of a column in its row in memory.
    pub(super) fn place(&self, column: usize) -> usize {
        column % self.per_px * self.run + column / self.per_px
    }

    /// Writes coefficients, given row by row, in this layout.
    pub(super) fn store<T>(&self, coefficients: &[f64], out: &mut [T], to: fn(f64) -> T) {
        for (line, out) in coefficients.chunks_exact(self.columns).zip(out.chunks_exact_mut(self.row())) {
            for (column, &value) in line.iter().enumerate() {
                out[self.place(column)] = to(value);
            }
        }
    }

    /// The spline's value and derivatives, as [`super::depth_table::PlaneLayout::at`]; `spline` gives the
    /// weights of `TAPS` nodes around a position and the derivatives of the weights.
    pub(super) fn at<const TAPS: usize>(
        &self,
        plane: &InterpolatedPlane,
        [dx, dy]: [f64; 2],
        spline: fn(f64) -> ([f64; TAPS], [f64; TAPS]),
    ) -> [f64; 4] {
        let scale = self.per_px as f64;
        let axis = |at: f64| {
            let cell = libm::floor(at * scale);
            let (weights, slopes) = spline(at * scale - cell);
            (cell as isize + 1 - TAPS as isize / 2, weights, slopes)
        };
        let ((first_x, weights_x, slopes_x), (first_y, weights_y, slopes_y)) = (axis(dx), axis(dy));
        let mut sum = [0.0; 4];
        for j in 0..TAPS {
            let Some(row) = self.row_of(first_y + j as isize) else { continue };
            let (mut value, mut slope, mut by_z) = (0.0, 0.0, 0.0);
            for i in 0..TAPS {
                let Some(column) = self.column_of(first_x + i as isize) else { continue };
                let at = row * self.row() + self.place(column);
                value += weights_x[i] * plane.value[at];
                slope += slopes_x[i] * plane.value[at];
                by_z += weights_x[i] * plane.by_z[at];
            }
            sum[0] += weights_y[j] * value;
            sum[1] += weights_y[j] * slope * scale;
            sum[2] += slopes_y[j] * value * scale;
            sum[3] += weights_y[j] * by_z;
        }
        sum
    }
}

/// Position of pixels relative to the nodes along an axis: consecutive pixels are `per_px` nodes apart and have
/// the same weights.
pub(super) struct Axis<const TAPS: usize> {
    /// The first of the nodes around the first pixel, counted from the particle.
    pub(super) first: isize,
    pub(super) weights: [f32; TAPS],
}

impl<const TAPS: usize> Axis<TAPS> {
    pub(super) fn new(
        first_px: i64,
        particle_px: f64,
        per_px: usize,
        spline: fn(f64) -> ([f64; TAPS], [f64; TAPS]),
    ) -> Self {
        let place = (first_px as f64 - particle_px) * per_px as f64;
        let cell = libm::floor(place);
        let first = cell as isize + 1 - TAPS as isize / 2;
        Axis { first, weights: spline(place - cell).0.map(|w| w as f32) }
    }

    /// The stored nodes along x (`axis` 0) or y that contribute to `pixels` pixels.
    pub(super) fn nodes(&self, pixels: usize, layout: &NodeLayout, axis: usize) -> std::ops::Range<usize> {
        let last = self.first + (TAPS - 1 + (pixels - 1) * layout.per_px) as isize;
        let (origin, end) = (layout.origin[axis] as isize, [layout.row(), layout.rows][axis]);
        if !layout.mirrored {
            let within = |node: isize| (node + origin).clamp(0, end as isize) as usize;
            return within(self.first)..within(last + 1);
        }
        let crosses = self.first <= 0 && 0 <= last;
        let nearest = if crosses { 0 } else { self.first.unsigned_abs().min(last.unsigned_abs()) };
        let end = (self.first.unsigned_abs().max(last.unsigned_abs()) + 1).min(end);
        nearest.min(end)..end
    }
}
