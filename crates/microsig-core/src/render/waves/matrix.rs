//! Products of dense matrices in f64 or f32.
//!
//! Every element is summed over the inner index in increasing order, with separate multiplications and
//! additions, so it has the same bits for all instruction sets and tile sizes.

use std::ops::{AddAssign, Mul};

use crate::render::instructions::InstructionSet;

/// Columns of a panel; the right-hand matrix and the product have a multiple of this number of columns.
pub(super) const LANES: usize = 16;

/// Rows of a tile.
const ROWS: usize = 6;

/// An element of a matrix.
pub(super) trait Element: Copy + Default + AddAssign + Mul<Output = Self> {}

impl Element for f32 {}
impl Element for f64 {}

/// A right-hand matrix: panels of [`LANES`] columns, each stored row by row, so that products read it in the
/// order of memory. Row by row, each row of a wide matrix would wait for the cache.
#[derive(Debug, Clone)]
pub(super) struct Panels<T> {
    rows: usize,
    columns: usize,
    values: Vec<T>,
}

impl<T: Element> Panels<T> {
    /// `columns` is a multiple of [`LANES`].
    pub(super) fn zeros(rows: usize, columns: usize) -> Panels<T> {
        Panels { rows, columns, values: vec![T::default(); rows * columns] }
    }

    /// From values stored row by row.
    pub(super) fn from_rows(values: &[T], columns: usize) -> Panels<T> {
        let mut panels = Panels::zeros(values.len() / columns, columns);
        for (row, values) in values.chunks_exact(columns).enumerate() {
            for (panel, values) in values.chunks_exact(LANES).enumerate() {
                let at = (panel * panels.rows + row) * LANES;
                panels.values[at..][..LANES].copy_from_slice(values);
            }
        }
        panels
    }

    #[inline(always)]
    pub(super) fn set(&mut self, row: usize, column: usize, value: T) {
        self.values[(column / LANES * self.rows + row) * LANES + column % LANES] = value;
    }
}

/// `product` = `left` times `right`; `left` and `product` are stored row by row.
pub(super) fn multiply<T: Element>(
    instructions: InstructionSet,
    left: &[T],
    right: &Panels<T>,
    product: &mut [T],
) {
    let places = Places { row: right.columns, panel: LANES };
    instructions.dispatch(Product { left, right, product, places });
}

/// [`multiply`] for a product that is the right-hand matrix of the next one.
pub(super) fn multiply_to_panels<T: Element>(
    instructions: InstructionSet,
    left: &[T],
    right: &Panels<T>,
    product: &mut Panels<T>,
) {
    let places = Places { row: LANES, panel: product.rows * LANES };
    instructions.dispatch(Product { left, right, product: &mut product.values, places });
}

/// [`multiply`] with the rows of the product side by side in one row of `to`.
pub(super) fn multiply_to_row<T: Element>(
    instructions: InstructionSet,
    left: &[T],
    right: &Panels<T>,
    to: &mut Panels<T>,
    row: usize,
) {
    let panel = to.rows * LANES;
    let places = Places { row: right.columns / LANES * panel, panel };
    instructions.dispatch(Product { left, right, product: &mut to.values[row * LANES..], places });
}

/// Distances in memory between rows and between panels of a product.
#[derive(Clone, Copy)]
struct Places {
    row: usize,
    panel: usize,
}

struct Product<'a, T> {
    left: &'a [T],
    right: &'a Panels<T>,
    product: &'a mut [T],
    places: Places,
}

impl<T: Element> pulp::WithSimd for Product<'_, T> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: pulp::Simd>(self, _: S) {
        // Tiles of f64 are half as wide, so that their sums fit into registers.
        match size_of::<T>() {
            4 => self.tiles::<LANES>(),
            _ => self.tiles::<{ LANES / 2 }>(),
        }
    }
}

impl<T: Element> Product<'_, T> {
    /// Computes the product by tiles of `L` columns.
    #[inline(always)]
    fn tiles<const L: usize>(self) {
        let Product { left, right, product, places } = self;
        let inner = right.rows;
        if inner == 0 {
            product.fill(T::default());
            return;
        }
        for (i, panel) in right.values.chunks_exact(inner * LANES).enumerate() {
            for first in (0..LANES).step_by(L) {
                let mut at = i * places.panel + first;
                let lefts = left.chunks_exact(ROWS * inner);
                let rest = lefts.remainder();
                for left in lefts {
                    tile::<T, L, ROWS>(left, &panel[first..], &mut product[at..], places.row);
                    at += ROWS * places.row;
                }
                match rest.len() / inner {
                    5 => tile::<T, L, 5>(rest, &panel[first..], &mut product[at..], places.row),
                    4 => tile::<T, L, 4>(rest, &panel[first..], &mut product[at..], places.row),
                    3 => tile::<T, L, 3>(rest, &panel[first..], &mut product[at..], places.row),
                    2 => tile::<T, L, 2>(rest, &panel[first..], &mut product[at..], places.row),
                    1 => tile::<T, L, 1>(rest, &panel[first..], &mut product[at..], places.row),
                    _ => {}
                }
            }
        }
    }
}

/// Computes `L` columns of `R` rows of the product; `panel` begins at the first of the columns.
#[inline(always)]
fn tile<T: Element, const L: usize, const R: usize>(
    left: &[T],
    panel: &[T],
    product: &mut [T],
    row_distance: usize,
) {
    let inner = left.len() / R;
    let left: [&[T]; R] = std::array::from_fn(|row| &left[row * inner..][..inner]);
    let mut sums = [[T::default(); L]; R];
    for (i, right) in panel.chunks(LANES).take(inner).enumerate() {
        let Some(right) = right.first_chunk::<L>() else { break };
        for row in 0..R {
            let factor = left[row][i];
            for lane in 0..L {
                sums[row][lane] += factor * right[lane];
            }
        }
    }
    for (row, sums) in sums.iter().enumerate() {
        product[row * row_distance..][..L].copy_from_slice(sums);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn products_are_the_sums_in_order() {
        let (inner, columns) = (13, 48);
        for rows in [1, 5, 6, 14] {
            let number = |i: usize| ((i * 7919) % 1009) as f64 / 1009.0 - 0.4;
            let left: Vec<f64> = (0..rows * inner).map(number).collect();
            let right: Vec<f64> = (0..inner * columns).map(|i| number(3 * i + 1)).collect();
            let [left_single, right_single] =
                [&left, &right].map(|of| of.iter().map(|v| *v as f32).collect::<Vec<f32>>());
            let right_panels = Panels::from_rows(&right, columns);
            let single_panels = Panels::from_rows(&right_single, columns);
            for set in InstructionSet::available() {
                let mut product = vec![0.0; rows * columns];
                multiply(set, &left, &right_panels, &mut product);
                let mut single = vec![0.0; rows * columns];
                multiply(set, &left_single, &single_panels, &mut single);
                let mut panels = Panels::zeros(rows, columns);
                multiply_to_panels(set, &left, &right_panels, &mut panels);
                assert_eq!(panels.values, Panels::from_rows(&product, columns).values, "{set}, {rows} rows");
                let mut side_by_side = Panels::zeros(3, rows * columns);
                multiply_to_row(set, &left, &right_panels, &mut side_by_side, 1);
                let zeros = vec![0.0; rows * columns];
                let expected = [&zeros[..], &product, &zeros].concat();
                assert_eq!(side_by_side.values, Panels::from_rows(&expected, rows * columns).values);
                for i in 0..rows * columns {
                    let (row, column) = (i / columns, i % columns);
                    let (mut sum, mut single_sum) = (0.0, 0.0);
                    for k in 0..inner {
                        let (a, b) = (row * inner + k, k * columns + column);
                        sum += left[a] * right[b];
                        single_sum += left_single[a] * right_single[b];
                    }
                    assert_eq!(product[i].to_bits(), f64::to_bits(sum), "{set}, {rows} rows, element {i}");
                    assert_eq!(single[i].to_bits(), f32::to_bits(single_sum), "{set}, {rows} rows, {i}");
                }
            }
        }
    }
}
