//! How the coefficients of a plane lie in memory.
//!
//! Along a row of an image, pixels are a whole number of nodes apart: all of them see the same phase of the nodes. So a
//! row of nodes is stored phase by phase, and each phase as a run that neighbouring pixels read side by side.

/// Numbers that are worked on at a time; runs are whole multiples of it.
pub(super) const LANES: usize = 8;

/// So many numbers.
pub(super) type Group = [f32; LANES];

/// A quadrant of nodes, the axes included.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Layout {
    /// Nodes per px: phases of a row.
    pub(super) per_px: usize,
    pub(super) rows: usize,
    /// Nodes of one phase in a row.
    pub(super) run: usize,
}

impl Layout {
    /// The layout of a quadrant of so many columns and rows before the dark begins.
    pub(super) fn new(per_px: usize, columns: usize, rows: usize) -> Layout {
        Layout { per_px, rows, run: columns.div_ceil(per_px).next_multiple_of(LANES) }
    }

    /// Numbers of a row.
    pub(super) fn row(&self) -> usize {
        self.per_px * self.run
    }

    /// Numbers of a plane.
    pub(super) fn length(&self) -> usize {
        self.rows * self.row()
    }

    /// Place of a node in its row. None: it lies in the dark.
    pub(super) fn place(&self, column: usize) -> Option<usize> {
        let (phase, i) = (column % self.per_px, column / self.per_px);
        (i < self.run).then_some(phase * self.run + i)
    }
}
