//! Products of dense matrices in f64, stored row by row.
//!
//! Every element is summed over the inner index in increasing order, with separate multiplications and
//! additions, so it has the same bits for all instruction sets and tile sizes.

use crate::render::instructions::InstructionSet;

/// Columns of a tile; the right-hand matrix and the product have a multiple of this number of columns.
pub(super) const LANES: usize = 8;

/// Rows of a tile.
const ROWS: usize = 6;

/// `product` = `left` (rows x `inner`) times `right` (`inner` x `columns`); `columns` is a multiple of
/// [`LANES`].
pub(super) fn multiply(
    instructions: InstructionSet,
    left: &[f64],
    right: &[f64],
    inner: usize,
    columns: usize,
    product: &mut [f64],
) {
    instructions.dispatch(Product { left, right, inner, columns, product });
}

struct Product<'a> {
    left: &'a [f64],
    right: &'a [f64],
    inner: usize,
    columns: usize,
    product: &'a mut [f64],
}

impl pulp::WithSimd for Product<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: pulp::Simd>(self, _: S) {
        let Product { left, right, inner, columns, product } = self;
        if inner == 0 || columns == 0 {
            product.fill(0.0);
            return;
        }
        let lefts = left.chunks_exact(ROWS * inner);
        let rest = lefts.remainder();
        let mut products = product.chunks_exact_mut(ROWS * columns);
        for (left, product) in lefts.zip(&mut products) {
            band::<ROWS>(left, right, inner, columns, product);
        }
        let product = products.into_remainder();
        match rest.len() / inner {
            5 => band::<5>(rest, right, inner, columns, product),
            4 => band::<4>(rest, right, inner, columns, product),
            3 => band::<3>(rest, right, inner, columns, product),
            2 => band::<2>(rest, right, inner, columns, product),
            1 => band::<1>(rest, right, inner, columns, product),
            _ => {}
        }
    }
}

/// Computes `R` rows of the product.
#[inline(always)]
fn band<const R: usize>(left: &[f64], right: &[f64], inner: usize, columns: usize, product: &mut [f64]) {
    let left: [&[f64]; R] = std::array::from_fn(|row| &left[row * inner..][..inner]);
    for column in (0..columns).step_by(LANES) {
        let mut sums = [[0.0; LANES]; R];
        for (i, right) in right.chunks_exact(columns).take(inner).enumerate() {
            let Some(right) = right[column..].first_chunk::<LANES>() else { break };
            for row in 0..R {
                let factor = left[row][i];
                for lane in 0..LANES {
                    sums[row][lane] += factor * right[lane];
                }
            }
        }
        for (row, sums) in sums.iter().enumerate() {
            product[row * columns + column..][..LANES].copy_from_slice(sums);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn products_are_the_sums_in_order() {
        let (inner, columns) = (13, 24);
        for rows in [1, 5, 6, 14] {
            let number = |i: usize| ((i * 7919) % 1009) as f64 / 1009.0 - 0.4;
            let left: Vec<f64> = (0..rows * inner).map(number).collect();
            let right: Vec<f64> = (0..inner * columns).map(|i| number(3 * i + 1)).collect();
            for set in InstructionSet::available() {
                let mut product = vec![0.0; rows * columns];
                multiply(set, &left, &right, inner, columns, &mut product);
                for (i, value) in product.iter().enumerate() {
                    let (row, column) = (i / columns, i % columns);
                    let mut sum = 0.0;
                    (0..inner).for_each(|k| sum += left[row * inner + k] * right[k * columns + column]);
                    assert_eq!(value.to_bits(), f64::to_bits(sum), "{set}, {rows} rows, element {i}");
                }
            }
        }
    }
}
