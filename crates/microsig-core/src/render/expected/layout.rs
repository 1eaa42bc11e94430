//! How the coefficients of a plane lie in memory.
//!
//! Along a row of an image, pixels are a whole number of nodes apart: all of them see the same phase of the nodes. So a
//! row of nodes is stored phase by phase, and each phase as a run that neighbouring pixels read side by side.

/// Numbers that are worked on at a time; runs are whole multiples of it.
pub(super) const LANES: usize = 8;

/// A quadrant of nodes, the axes included.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Layout {
    /// Nodes per px: phases of a row.
    pub(super) per_px: usize,
    pub(super) rows: usize,
    /// Nodes of one phase in a row.
    pub(super) run: usize,
    /// Of each row, and some dark ones behind: how much of a run is read, a multiple of [`LANES`].
    lit: Vec<usize>,
}

/// Rows of the dark behind the last that a spline may ask for.
pub(super) const MARGIN: usize = 3;

impl Layout {
    /// The layout of a quadrant whose rows have so many columns before the dark begins.
    pub(super) fn new(per_px: usize, columns: usize, lit_columns: &[usize]) -> Layout {
        let runs: Vec<usize> =
            lit_columns.iter().map(|n| n.div_ceil(per_px).next_multiple_of(LANES)).collect();
        // Four neighbouring rows are read together, as far as the longest of them is lit.
        let lit = (0..runs.len() + MARGIN)
            .map(|row| {
                runs[row.saturating_sub(MARGIN).min(runs.len())..(row + MARGIN + 1).min(runs.len())]
                    .iter()
                    .copied()
            })
            .map(|near| near.max().unwrap_or(0))
            .collect();
        let run = columns.div_ceil(per_px).next_multiple_of(LANES);
        Layout { per_px, rows: runs.len(), run, lit }
    }

    /// How much of a run of this row is read.
    #[inline(always)]
    pub(super) fn lit(&self, row: usize) -> usize {
        self.lit.get(row).copied().unwrap_or(0)
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
