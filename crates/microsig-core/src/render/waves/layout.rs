//! Memory layout of the coefficients of a plane.
//!
//! In a row of an image, pixels are a whole number of nodes apart, so all have the same phase relative to the
//! nodes. A row of nodes is therefore stored phase by phase; the nodes of one phase form a contiguous run,
//! which neighboring pixels read at consecutive addresses.

use crate::render::image_sum::LANES;

/// Nodes of a plane: one quadrant, including the axes, or all.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Layout {
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

impl Layout {
    /// The layout with `side` columns and rows from the particle's own node outward; `side` is 1 plus a whole
    /// number of px.
    pub(super) fn new(per_px: usize, side: [usize; 2], mirrored: bool) -> Layout {
        let [columns, rows] = if mirrored { side } else { side.map(|side| 2 * side - 1) };
        let origin = if mirrored { [0; 2] } else { side.map(|side| side - 1) };
        let run = columns.div_ceil(per_px).next_multiple_of(LANES);
        Layout { per_px, columns, rows, mirrored, origin, run }
    }

    /// The layout of a stored table; `None` if the numbers are invalid.
    pub(super) fn stored_as(
        per_px: usize,
        [columns, rows]: [usize; 2],
        mirrored: bool,
        origin: [usize; 2],
    ) -> Option<Layout> {
        // Larger than any table.
        const MAX: usize = 1 << 20;
        if per_px == 0 || per_px > MAX || columns > MAX || rows > MAX {
            return None;
        }
        let run = columns.div_ceil(per_px).next_multiple_of(LANES);
        Some(Layout { per_px, columns, rows, mirrored, origin, run })
    }

    /// Length of a row, numbers.
    pub(super) fn row(&self) -> usize {
        self.per_px * self.run
    }

    /// Length of a plane, numbers.
    pub(super) fn length(&self) -> usize {
        self.rows * self.row()
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
