//! Measured vectors paired with the true displacement, and the vectors of each image pair on a grid.

use std::collections::BTreeMap;

use super::true_field::index;
use crate::evaluate::statistics::distinct;
use crate::results::FlowVector;

/// End-point error from which a vector is an outlier, px.
pub(super) const INLIER_PX: f64 = 1.0;

/// A measured vector and the true displacement at its position.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ComparedVector {
    /// The measured vector.
    pub measured: FlowVector,
    /// The true displacement: dx, dy (px), dz (um).
    pub truth: [f64; 3],
}

impl ComparedVector {
    /// Result - truth along x and y, px.
    pub fn error(&self) -> [f64; 2] {
        [self.measured.moved[0] - self.truth[0], self.measured.moved[1] - self.truth[1]]
    }

    /// End-point error: length of the error in the image plane, px.
    pub fn endpoint(&self) -> f64 {
        let [u, v] = self.error();
        (u * u + v * v).sqrt()
    }
}

/// Vectors on a grid of columns and rows.
#[derive(Debug)]
pub struct VectorGrid {
    /// x of the columns, px, ascending.
    pub x_px: Vec<f64>,
    /// y of the rows, px, ascending.
    pub y_px: Vec<f64>,
    /// For every image pair, the index of the vector in each cell, row by row.
    pub pairs: BTreeMap<Option<u32>, Vec<Option<usize>>>,
}

impl VectorGrid {
    /// Sorts vectors into columns and rows; `None` if they are not on a grid.
    pub fn new(all: &[ComparedVector]) -> Option<Self> {
        let x_px = distinct(all.iter().map(|c| c.measured.at.x_px));
        let y_px = distinct(all.iter().map(|c| c.measured.at.y_px));
        let mut numbers: Vec<Option<u32>> = all.iter().map(|c| c.measured.pair).collect();
        numbers.sort_unstable();
        numbers.dedup();
        let cells = x_px.len() * y_px.len();
        // A grid is mostly full; scattered vectors would each have a column and a row of their own.
        if cells * numbers.len() > 20 * all.len() + 1000 {
            return None;
        }
        let mut grid = VectorGrid { x_px, y_px, pairs: BTreeMap::new() };
        for (k, c) in all.iter().enumerate() {
            let cell =
                grid.cell(index(&grid.x_px, c.measured.at.x_px), index(&grid.y_px, c.measured.at.y_px));
            grid.pairs.entry(c.measured.pair).or_insert_with(|| vec![None; cells])[cell] = Some(k);
        }
        Some(grid)
    }

    /// Index of the cell in a column and a row.
    pub fn cell(&self, column: usize, row: usize) -> usize {
        row * self.x_px.len() + column
    }
}
