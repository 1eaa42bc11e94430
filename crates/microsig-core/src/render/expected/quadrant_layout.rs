//! Memory layout of the coefficients of a plane over a quadrant.
//!
//! Along a row of an image, pixels are an integer number of nodes apart, so that all have the same phase
//! relative to the nodes. A row of nodes is therefore stored phase by phase, each phase as a run that
//! adjacent pixels read contiguously.

use crate::render::image_sum::LANES;

/// One group of values; the length of a run is a multiple of its length.
pub(super) type Group = [f32; LANES];

/// A quadrant of nodes, the axes included.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct QuadrantLayout {
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
}
