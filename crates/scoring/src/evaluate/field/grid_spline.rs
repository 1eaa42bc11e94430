//! Cubic-spline interpolation on a rectangular grid, some of whose nodes have no value.
//!
//! In each cell the interpolant is the bicubic Hermite polynomial of values, slopes and cross derivatives at
//! its corners. Slopes come from cubic splines along each unbroken run of nodes of a row or column, whose
//! end slopes come from the polynomial through the last five nodes; a run of fewer than four nodes has the
//! polynomial through them. Without gaps, this is the tensor-product cubic spline: errors are of fourth order
//! in the spacing (de Boor, A Practical Guide to Splines, chapters IV and XVII).

/// Values of `N` components on a grid, with their splines.
#[derive(Debug)]
pub(super) struct GridSpline<const N: usize> {
    x_px: Vec<f64>,
    y_px: Vec<f64>,
    /// Value, derivatives along x and along y, and cross derivative at each node, row by row; NaN without value.
    nodes: Vec<[[f64; N]; 4]>,
}

impl<const N: usize> GridSpline<N> {
    /// The splines of `values`, row by row; a node whose first component is NaN has no value.
    pub(super) fn new(x_px: &[f64], y_px: &[f64], values: &[[f64; N]]) -> Self {
        let mut nodes: Vec<[[f64; N]; 4]> = values.iter().map(|value| [*value; 4]).collect();
        let columns = x_px.len();
        for row in 0..y_px.len() {
            set_slopes(&mut nodes, x_px, |i| row * columns + i, (0, 1));
        }
        for column in 0..columns {
            set_slopes(&mut nodes, y_px, |j| j * columns + column, (0, 2));
            set_slopes(&mut nodes, y_px, |j| j * columns + column, (1, 3));
        }
        GridSpline { x_px: x_px.to_vec(), y_px: y_px.to_vec(), nodes }
    }

    /// The interpolated value; `None` outside the grid and in a cell with a corner that counts and has no
    /// value.
    pub(super) fn at(&self, x_px: f64, y_px: f64) -> Option<[f64; N]> {
        let (i, width, s) = cell(&self.x_px, x_px)?;
        let (j, height, t) = cell(&self.y_px, y_px)?;
        let ([x_values, x_slopes], [y_values, y_slopes]) = (hermite(s, width), hermite(t, height));
        let mut sum = [0.0; N];
        for (row, column) in [(0, 0), (0, 1), (1, 0), (1, 1)] {
            // On a node or a line between two of them, the others do not count: 0 * NaN would be NaN.
            if (column == 1 && s == 0.0) || (row == 1 && t == 0.0) {
                continue;
            }
            let node = &self.nodes[(j + row) * self.x_px.len() + i + column];
            let weights = [
                x_values[column] * y_values[row],
                x_slopes[column] * y_values[row],
                x_values[column] * y_slopes[row],
                x_slopes[column] * y_slopes[row],
            ];
            for (derivative, weight) in node.iter().zip(weights) {
                if weight != 0.0 {
                    sum.iter_mut().zip(derivative).for_each(|(sum, value)| *sum += weight * value);
                }
            }
        }
        sum[0].is_finite().then_some(sum)
    }
}

/// The node at or before `at`, the distance to the next one, and the fraction of it up to `at`; `None` beyond
/// the ends of the axis.
fn cell(axis: &[f64], at: f64) -> Option<(usize, f64, f64)> {
    let last = axis.len().checked_sub(1)?;
    if !(axis[0]..=axis[last]).contains(&at) {
        return None;
    }
    let i = axis.partition_point(|node| *node <= at) - 1;
    let width = if i < last { axis[i + 1] - axis[i] } else { 1.0 };
    Some((i, width, (at - axis[i]) / width))
}

/// Weights of the two values and of the two slopes of a cubic Hermite polynomial.
fn hermite(s: f64, width: f64) -> [[f64; 2]; 2] {
    let r = 1.0 - s;
    [[r * r * (1.0 + 2.0 * s), s * s * (1.0 + 2.0 * r)], [width * s * r * r, -width * s * s * r]]
}

/// Writes derivative `to` of the nodes along a line, the slope of derivative `from`.
fn set_slopes<const N: usize>(
    nodes: &mut [[[f64; N]; 4]],
    axis: &[f64],
    node: impl Fn(usize) -> usize,
    (from, to): (usize, usize),
) {
    let has_value = |k: usize, nodes: &[[[f64; N]; 4]]| !nodes[node(k)][0][0].is_nan();
    let mut start = 0;
    while start < axis.len() {
        let mut end = start;
        while end < axis.len() && has_value(end, nodes) {
            end += 1;
        }
        if end > start {
            let values: Vec<[f64; N]> = (start..end).map(|k| nodes[node(k)][from]).collect();
            for (k, slope) in (start..end).zip(slopes(&axis[start..end], &values)) {
                nodes[node(k)][to] = slope;
            }
        }
        start = end.max(start + 1);
    }
}

/// The slopes of the cubic spline through all nodes of a run.
fn slopes<const N: usize>(x: &[f64], values: &[[f64; N]]) -> Vec<[f64; N]> {
    let n = x.len();
    if n < 4 {
        return (0..n).map(|k| polynomial_slope(x, values, k)).collect();
    }
    let width = |k: usize| x[k + 1] - x[k];
    let secant = |k: usize, c: usize| (values[k + 1][c] - values[k][c]) / width(k);
    let mut slopes = vec![[0.0; N]; n];
    // More nodes would be more precise where they resolve the field, and worse where values have noise.
    let end = n.min(5);
    slopes[0] = polynomial_slope(&x[..end], &values[..end], 0);
    slopes[n - 1] = polynomial_slope(&x[n - end..], &values[n - end..], end - 1);
    // Thomas's algorithm for continuous second derivatives; `upper` is the reduced upper diagonal.
    let mut upper = vec![0.0; n];
    for k in 1..n - 1 {
        let (before, after) = (width(k - 1), width(k));
        let pivot = 2.0 * (before + after) - after * upper[k - 1];
        upper[k] = before / pivot;
        let previous = slopes[k - 1];
        slopes[k] = std::array::from_fn(|c| {
            let right = 3.0 * (after * secant(k - 1, c) + before * secant(k, c));
            (right - after * previous[c]) / pivot
        });
    }
    for k in (1..n - 1).rev() {
        let next = slopes[k + 1];
        slopes[k].iter_mut().zip(next).for_each(|(slope, next)| *slope -= upper[k] * next);
    }
    slopes
}

/// The slope at node `k` of the polynomial through all nodes.
fn polynomial_slope<const N: usize>(x: &[f64], values: &[[f64; N]], k: usize) -> [f64; N] {
    let mut slope = [0.0; N];
    for (j, value) in values.iter().enumerate().filter(|(j, _)| *j != k) {
        let others = || (0..x.len()).filter(|m| *m != j && *m != k);
        let weight = others().map(|m| (x[k] - x[m]) / (x[j] - x[m])).product::<f64>() / (x[j] - x[k]);
        (0..N).for_each(|c| slope[c] += weight * (value[c] - values[k][c]));
    }
    slope
}

#[cfg(test)]
mod tests {
    use super::*;

    fn spline(x: &[f64], y: &[f64], f: impl Fn(f64, f64) -> f64) -> GridSpline<1> {
        let values: Vec<[f64; 1]> =
            y.iter().flat_map(|&y| x.iter().map(move |&x| (x, y))).map(|(x, y)| [f(x, y)]).collect();
        GridSpline::new(x, y, &values)
    }

    #[test]
    fn bicubic_polynomials_are_exact_on_uneven_grids_and_beside_gaps() {
        let (x, y) = ([0.0, 1.0, 2.5, 3.0, 5.0, 6.0, 7.5, 8.0], [-1.0, 0.0, 1.5, 2.0, 4.0]);
        let cubic =
            |x: f64, y: f64| (1.0 + x - 0.3 * x * x + 0.02 * x * x * x) * (2.0 - y * y + 0.4 * y * y * y);
        let whole = spline(&x, &y, cubic);
        for (at_x, at_y) in [(0.3, -0.4), (4.1, 1.7), (7.9, 3.0), (8.0, 4.0), (0.0, -1.0), (2.5, 0.7)] {
            let found = whole.at(at_x, at_y).unwrap()[0];
            // Rounding errors of values up to 100.
            assert!((found - cubic(at_x, at_y)).abs() < 1e-11, "{at_x} {at_y}: {found}");
        }
        assert_eq!((whole.at(-0.1, 0.0), whole.at(8.1, 0.0), whole.at(1.0, f64::NAN)), (None, None, None));
        let gap = spline(&x, &y, |x, y| if x == 3.0 { f64::NAN } else { (1.0 + x) * (2.0 - y * y) });
        assert_eq!((gap.at(2.6, 0.5), gap.at(3.0, 0.5), gap.at(4.0, 0.0)), (None, None, None));
        for (at_x, at_y) in [(2.5, 0.5), (1.2, 3.0), (5.0, -1.0), (5.5, -0.5)] {
            assert!((gap.at(at_x, at_y).unwrap()[0] - (1.0 + at_x) * (2.0 - at_y * at_y)).abs() < 1e-12);
        }
    }

    #[test]
    fn errors_are_of_fourth_order_up_to_the_border() {
        let wave = |x: f64, y: f64| (0.1 * x).sin() * (0.08 * y + 0.5).cos();
        let rms = |step: f64| {
            let axis: Vec<f64> = (0..=(96.0 / step) as u32).map(|k| step * f64::from(k)).collect();
            let spline = spline(&axis, &axis, wave);
            let places = || (0..200_u32).map(|k| 96.0 * f64::from(k) / 200.0);
            let squares: f64 = places()
                .flat_map(|y| places().map(move |x| (x, y)))
                .map(|(x, y)| (spline.at(x, y).unwrap()[0] - wave(x, y)).powi(2))
                .sum();
            (squares / 40_000.0).sqrt()
        };
        let (coarse, fine) = (rms(4.0), rms(2.0));
        // Errors at the border are of fifth order.
        assert!(coarse < 1e-4 && (14.0..32.0).contains(&(coarse / fine)), "{coarse:e} {fine:e}");
    }

    #[test]
    fn a_single_node_and_a_single_line_have_their_values() {
        assert_eq!(spline(&[2.0], &[3.0], |_, _| 7.0).at(2.0, 3.0), Some([7.0]));
        let line = spline(&[0.0, 2.0, 4.0], &[1.0], |x, _| x * x);
        assert!((line.at(1.0, 1.0).unwrap()[0] - 1.0).abs() < 1e-14);
    }
}
