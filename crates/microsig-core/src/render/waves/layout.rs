//! How the coefficients of a plane lie in memory.
//!
//! Along a row of an image pixels are a whole number of nodes apart: all of them see the same phase of the
//! nodes. So a row of nodes is stored phase by phase, and each phase as a run that neighboring pixels read
//! side by side.

/// Numbers that are worked on at a time; runs are whole multiples of it.
pub(super) const LANES: usize = 8;

/// Nodes of a plane: a quadrant, the axes included, or all.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Layout {
    /// Nodes per px: phases of a row.
    pub(super) per_px: usize,
    pub(super) columns: usize,
    pub(super) rows: usize,
    /// Whether nodes on the other side of an axis are the mirror images of these.
    pub(super) mirrored: bool,
    /// Column and row of the particle itself; a whole number of px.
    pub(super) origin: [usize; 2],
    /// Nodes of one phase in a row.
    pub(super) run: usize,
}

impl Layout {
    /// The layout of so many columns and rows from the particle's own node on, 1 more than a whole number of
    /// px.
    pub(super) fn new(per_px: usize, side: [usize; 2], mirrored: bool) -> Layout {
        let [columns, rows] = if mirrored { side } else { side.map(|side| 2 * side - 1) };
        let origin = if mirrored { [0; 2] } else { side.map(|side| side - 1) };
        let run = columns.div_ceil(per_px).next_multiple_of(LANES);
        Layout { per_px, columns, rows, mirrored, origin, run }
    }

    /// The layout with these columns and rows; `None` if there is none.
    pub(super) fn stored_as(
        per_px: usize,
        [columns, rows]: [usize; 2],
        mirrored: bool,
        origin: [usize; 2],
    ) -> Option<Layout> {
        // No table is so large.
        const MOST: usize = 1 << 20;
        if per_px == 0 || per_px > MOST || columns > MOST || rows > MOST {
            return None;
        }
        let run = columns.div_ceil(per_px).next_multiple_of(LANES);
        Some(Layout { per_px, columns, rows, mirrored, origin, run })
    }

    /// Numbers of a row.
    pub(super) fn row(&self) -> usize {
        self.per_px * self.run
    }

    /// Numbers of a plane.
    pub(super) fn length(&self) -> usize {
        self.rows * self.row()
    }

    fn stored(&self, node: isize, origin: usize, nodes: usize) -> Option<usize> {
        let at =
            if self.mirrored { node.unsigned_abs() } else { usize::try_from(node + origin as isize).ok()? };
        (at < nodes).then_some(at)
    }

    /// The column of a node, counted from the particle. `None`: it lies in the dark.
    pub(super) fn column_of(&self, node: isize) -> Option<usize> {
        self.stored(node, self.origin[0], self.columns)
    }

    /// The row of a node, likewise.
    pub(super) fn row_of(&self, node: isize) -> Option<usize> {
        self.stored(node, self.origin[1], self.rows)
    }

    /// Place of a column in its row.
    pub(super) fn place(&self, column: usize) -> usize {
        column % self.per_px * self.run + column / self.per_px
    }

    /// Writes coefficients, row by row, in their places.
    pub(super) fn store(&self, coefficients: &[f64], out: &mut [f32]) {
        for (line, out) in coefficients.chunks_exact(self.columns).zip(out.chunks_exact_mut(self.row())) {
            for (column, &value) in line.iter().enumerate() {
                out[self.place(column)] = value as f32;
            }
        }
    }
}
