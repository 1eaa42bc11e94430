//! Where a result's vectors stand to each other: a lattice of columns and rows, pair by pair.

use std::collections::BTreeMap;

use super::Compared;
use super::grid::index;

/// Vectors on a lattice.
#[derive(Debug)]
pub struct Lattice {
    /// Places of columns, px.
    pub x_px: Vec<f64>,
    /// Places of rows, px.
    pub y_px: Vec<f64>,
    /// Of every pair, the vector in each cell, row by row.
    pub pairs: BTreeMap<Option<u32>, Vec<Option<usize>>>,
}

impl Lattice {
    /// Of vectors; `None` if they are scattered.
    pub fn new(all: &[Compared]) -> Option<Self> {
        let axis = |value: fn(&Compared) -> f64| {
            let mut values: Vec<f64> = all.iter().map(value).collect();
            values.sort_unstable_by(f64::total_cmp);
            values.dedup();
            values
        };
        let (x_px, y_px) = (axis(|c| c.found.at.x_px), axis(|c| c.found.at.y_px));
        let mut numbers: Vec<Option<u32>> = all.iter().map(|c| c.found.pair).collect();
        numbers.sort_unstable();
        numbers.dedup();
        let cells = x_px.len() * y_px.len();
        // A lattice is mostly full; scattered vectors have a column and a row each.
        if cells * numbers.len() > 20 * all.len() + 1000 {
            return None;
        }
        let mut lattice = Lattice { x_px, y_px, pairs: BTreeMap::new() };
        for (k, c) in all.iter().enumerate() {
            let cell =
                lattice.cell(index(&lattice.x_px, c.found.at.x_px), index(&lattice.y_px, c.found.at.y_px));
            lattice.pairs.entry(c.found.pair).or_insert_with(|| vec![None; cells])[cell] = Some(k);
        }
        Some(lattice)
    }

    /// Number of the cell in a column and a row.
    pub fn cell(&self, column: usize, row: usize) -> usize {
        row * self.x_px.len() + column
    }
}
