//! Products of dense matrices in f64 or f32, stored row by row.
//!
//! Every element is summed over the inner index in increasing order, with separate multiplications and
//! additions, so it has the same bits for all instruction sets and tile sizes.

use std::ops::{AddAssign, Mul};

use crate::render::instructions::InstructionSet;

/// The right-hand matrix and the product have a multiple of this number of columns.
pub(super) const LANES: usize = 16;

/// Rows of a tile.
const ROWS: usize = 6;

/// An element of a matrix.
pub(super) trait Element: Copy + Default + AddAssign + Mul<Output = Self> {}

impl Element for f32 {}
impl Element for f64 {}

/// `product` = `left` (rows x `inner`) times `right` (`inner` x `columns`); `columns` is a multiple of
/// [`LANES`].
pub(super) fn multiply<T: Element>(
    instructions: InstructionSet,
    left: &[T],
    right: &[T],
    inner: usize,
    columns: usize,
    product: &mut [T],
) {
    instructions.dispatch(Product { left, right, inner, columns, product });
}

struct Product<'a, T> {
    left: &'a [T],
    right: &'a [T],
    inner: usize,
    columns: usize,
    product: &'a mut [T],
}

impl<T: Element> pulp::WithSimd for Product<'_, T> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: pulp::Simd>(self, _: S) {
        let Product { left, right, inner, columns, product } = self;
        if inner == 0 || columns == 0 {
            product.fill(T::default());
            return;
        }
        // Tiles of f64 are half as wide, so that their sums fit into registers.
        match size_of::<T>() {
            4 => tiles::<T, LANES>(left, right, inner, columns, product),
            _ => tiles::<T, { LANES / 2 }>(left, right, inner, columns, product),
        }
    }
}

/// Computes the product by tiles of `L` columns; within a tile, the columns of `right` stay in the cache.
#[inline(always)]
fn tiles<T: Element, const L: usize>(
    left: &[T],
    right: &[T],
    inner: usize,
    columns: usize,
    product: &mut [T],
) {
    for column in (0..columns).step_by(L) {
        let lefts = left.chunks_exact(ROWS * inner);
        let rest = lefts.remainder();
        let mut products = product.chunks_exact_mut(ROWS * columns);
        for (left, product) in lefts.zip(&mut products) {
            tile::<T, L, ROWS>(left, right, inner, columns, column, product);
        }
        let product = products.into_remainder();
        match rest.len() / inner {
            5 => tile::<T, L, 5>(rest, right, inner, columns, column, product),
            4 => tile::<T, L, 4>(rest, right, inner, columns, column, product),
            3 => tile::<T, L, 3>(rest, right, inner, columns, column, product),
            2 => tile::<T, L, 2>(rest, right, inner, columns, column, product),
            1 => tile::<T, L, 1>(rest, right, inner, columns, column, product),
            _ => {}
        }
    }
}

/// Computes `L` columns of `R` rows of the product.
#[inline(always)]
fn tile<T: Element, const L: usize, const R: usize>(
    left: &[T],
    right: &[T],
    inner: usize,
    columns: usize,
    column: usize,
    product: &mut [T],
) {
    let left: [&[T]; R] = std::array::from_fn(|row| &left[row * inner..][..inner]);
    let mut sums = [[T::default(); L]; R];
    for (i, right) in right.chunks_exact(columns).take(inner).enumerate() {
        let Some(right) = right[column..].first_chunk::<L>() else { break };
        for row in 0..R {
            let factor = left[row][i];
            for lane in 0..L {
                sums[row][lane] += factor * right[lane];
            }
        }
    }
    for (row, sums) in sums.iter().enumerate() {
        product[row * columns + column..][..L].copy_from_slice(sums);
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
            for set in InstructionSet::available() {
                let mut product = vec![0.0; rows * columns];
                multiply(set, &left, &right, inner, columns, &mut product);
                let mut single = vec![0.0; rows * columns];
                multiply(set, &left_single, &right_single, inner, columns, &mut single);
                for i in 0..rows * columns {
                    let (row, column) = (i / columns, i % columns);
                    let (mut sum, mut of_single) = (0.0, 0.0);
                    for k in 0..inner {
                        let (a, b) = (row * inner + k, k * columns + column);
                        sum += left[a] * right[b];
                        of_single += left_single[a] * right_single[b];
                    }
                    assert_eq!(product[i].to_bits(), f64::to_bits(sum), "{set}, {rows} rows, element {i}");
                    assert_eq!(single[i].to_bits(), f32::to_bits(of_single), "{set}, {rows} rows, {i}");
                }
            }
        }
    }
}
