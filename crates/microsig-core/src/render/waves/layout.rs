//! Memory layout of the coefficients of a plane, which are those of a quintic spline through the light on
//! pixels.
//!
//! In a row of an image, pixels are a whole number of nodes apart, so all have the same phase relative to the
//! nodes. A row of nodes is therefore stored phase by phase; the nodes of one phase form a contiguous run,
//! which neighboring pixels read at consecutive addresses.

use crate::bspline::{self, QUINTIC_TAPS as TAPS};
use crate::render::depth_table::{DepthTable, InterpolatedPlane, PlaneLayout};
use crate::render::image_sum::LANES;
use crate::render::store::{Reader, Writer};

/// A table of images by wave optics.
pub(super) type Table = DepthTable<Layout>;

/// Larger than the number of nodes along any axis.
const MAX: usize = 1 << 20;

/// Nodes of a plane: one quadrant, including the axes, or all.
#[derive(Debug, Clone, PartialEq)]
pub struct Layout {
    /// Nodes per px, which is the number of phases in a row.
    pub(super) per_px: usize,
    pub(super) columns: usize,
    pub(super) rows: usize,
    /// Whether only one quadrant is stored and the others are its mirror images.
    pub(super) mirrored: bool,
    /// Column and row of the node at the particle's center; a whole number of px.
    pub(super) origin: [usize; 2],
    /// Half width and half height of the computed area, px.
    pub(super) edge_px: [usize; 2],
    /// Number of stored nodes of one phase in a row.
    pub(super) run: usize,
}

impl Layout {
    /// The layout of planes up to `edge_px` from the particle, with `side` columns and rows from the
    /// particle's own node outward; `side` is 1 plus a whole number of px.
    pub(super) fn new(per_px: usize, side: [usize; 2], mirrored: bool, edge_px: [usize; 2]) -> Layout {
        let nodes = if mirrored { side } else { side.map(|side| 2 * side - 1) };
        let origin = if mirrored { [0; 2] } else { side.map(|side| side - 1) };
        Layout::of_nodes(per_px, nodes, mirrored, origin, edge_px)
    }

    fn of_nodes(
        per_px: usize,
        [columns, rows]: [usize; 2],
        mirrored: bool,
        origin: [usize; 2],
        edge_px: [usize; 2],
    ) -> Layout {
        let run = columns.div_ceil(per_px).next_multiple_of(LANES);
        Layout { per_px, columns, rows, mirrored, origin, edge_px, run }
    }

    /// Length of a row, numbers.
    pub(super) fn row(&self) -> usize {
        self.per_px * self.run
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
    pub(super) fn store(&self, coefficients: &[f64], out: &mut [f32]) {
        for (line, out) in coefficients.chunks_exact(self.columns).zip(out.chunks_exact_mut(self.row())) {
            for (column, &value) in line.iter().enumerate() {
                out[self.place(column)] = value as f32;
            }
        }
    }
}

impl PlaneLayout for Layout {
    fn length(&self) -> usize {
        self.rows * self.row()
    }

    fn at(&self, plane: &InterpolatedPlane, dx: f64, dy: f64) -> [f64; 4] {
        let scale = self.per_px as f64;
        let axis = |at: f64| {
            let cell = libm::floor(at * scale);
            let (weights, slopes) = bspline::quintic(at * scale - cell);
            (cell as isize - 2, weights, slopes)
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

    fn write(table: &Table) -> Vec<u8> {
        let Layout { per_px, columns, rows, mirrored, origin, edge_px, .. } = table.layout;
        let mut out = Writer::default();
        [table.start_um, table.step_um, table.error].into_iter().for_each(|value| out.number(value));
        let nodes = [table.planes, per_px, columns, rows, usize::from(mirrored)];
        nodes.into_iter().chain(origin).chain(edge_px).for_each(|value| out.whole(value));
        out.numbers(&table.radii);
        out.numbers(table.reach_px.as_flattened());
        out.singles(&table.coefficients);
        out.0
    }

    fn read(bytes: &[u8]) -> Option<Table> {
        let mut from = Reader(bytes);
        let [start_um, step_um, error] = [from.number()?, from.number()?, from.number()?];
        let [planes, per_px, columns, rows, mirrored] =
            [from.whole()?, from.whole()?, from.whole()?, from.whole()?, from.whole()?];
        let [origin, edge_px] = [[from.whole()?, from.whole()?], [from.whole()?, from.whole()?]];
        if per_px == 0 || per_px.max(columns).max(rows) > MAX {
            return None;
        }
        let layout = Layout::of_nodes(per_px, [columns, rows], mirrored == 1, origin, edge_px);
        let (radii, reach) = (from.numbers()?, from.numbers()?);
        let reach_px = reach.as_chunks::<2>().0.to_vec();
        let (length, coefficients) = (layout.length(), from.singles()?);
        let table = Table { start_um, step_um, planes, radii, layout, reach_px, coefficients, error };
        (table.holds(Some(length)) && from.is_done()).then_some(table)
    }
}
