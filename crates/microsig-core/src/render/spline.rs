//! Interpolating and least-squares splines on equidistant nodes, and weights of Lagrange interpolation.

use crate::bspline;

/// Degree of a spline; the discriminant is the weight of a node's own coefficient relative to its
/// two neighbors.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum SplineDegree {
    Two = 6,
    Three = 4,
}

/// Coefficients of the spline through `values` at the nodes 0, 1, 2, ..., even about node 0 and zero from the
/// node after the last one on: (c[k-1] + d c[k] + c[k+1]) / (d + 2) = values[k].
pub(super) fn even_spline(values: &mut [f64], degree: SplineDegree) {
    let own = f64::from(degree as u8);
    let n = values.len();
    if n == 0 {
        return;
    }
    // Thomas algorithm; the first row is d c0 + 2 c1 because c[-1] = c[1].
    let mut ratio = vec![0.0; n];
    ratio[0] = 2.0 / own;
    values[0] *= (own + 2.0) / own;
    for k in 1..n {
        let pivot = 1.0 / (own - ratio[k - 1]);
        ratio[k] = pivot;
        values[k] = ((own + 2.0) * values[k] - values[k - 1]) * pivot;
    }
    for k in (0..n - 1).rev() {
        values[k] -= ratio[k] * values[k + 1];
    }
}

/// The value of the even cubic spline at a position in steps from node 0.
pub(super) fn evaluate(coefficients: &[f64], place: f64) -> f64 {
    let cell = libm::floor(place);
    let (weights, _) = bspline::cubic(place - cell);
    let first = cell as isize - 1;
    let c = |i: usize| coefficients.get((first + i as isize).unsigned_abs()).copied().unwrap_or(0.0);
    (0..4).map(|i| weights[i] * c(i)).sum()
}

/// The spline's values at the nodes 0, 1/2, 1, 3/2, ...: twice as many as coefficients.
pub(super) fn half_nodes(coefficients: &[f64]) -> Vec<f64> {
    let n = coefficients.len() as isize;
    let c = |k: isize| if k.abs() < n { coefficients[k.unsigned_abs()] } else { 0.0 };
    (0..n)
        .flat_map(|k| {
            let on = (c(k - 1) + 4.0 * c(k) + c(k + 1)) / 6.0;
            let between = (c(k - 1) + 23.0 * c(k) + 23.0 * c(k + 1) + c(k + 2)) / 48.0;
            [on, between]
        })
        .collect()
}

/// Least-squares fit of the cubic spline, even about node 0, to values at the nodes 0, 1/2, 1, 3/2, ...: half
/// as many coefficients as values. Near kinks its error is about half that of the spline through every second
/// value.
#[derive(Debug)]
pub(super) struct LeastSquaresSpline {
    /// Cholesky factor of the normal equations, by row: the inverse of the diagonal element and the three
    /// elements before it.
    factor: Vec<[f64; 4]>,
}

impl LeastSquaresSpline {
    pub(super) fn new(n: usize) -> LeastSquaresSpline {
        let mut rows = vec![[0.0; 4]; n];
        for j in 0..2 * n {
            let (terms, count) = terms(j, n);
            for &(a, weight_a) in &terms[..count] {
                for &(b, weight_b) in &terms[..count] {
                    if b <= a {
                        rows[a][3 - (a - b)] += weight(j) * weight_a * weight_b;
                    }
                }
            }
        }
        for i in 0..n {
            for k in i.saturating_sub(3)..=i {
                let mut sum = rows[i][3 + k - i];
                for m in i.saturating_sub(3)..k {
                    if k - m <= 3 {
                        sum -= rows[i][3 + m - i] * rows[k][3 + m - k];
                    }
                }
                // The inverse of the diagonal is stored.
                rows[i][3 + k - i] = if k == i { 1.0 / libm::sqrt(sum) } else { sum * rows[k][3] };
            }
        }
        LeastSquaresSpline { factor: rows }
    }

    fn solve(&self, values: &[f64]) -> Vec<f64> {
        let n = self.factor.len();
        let mut c = vec![0.0; n];
        for (j, value) in values.iter().enumerate() {
            let (terms, count) = terms(j, n);
            terms[..count].iter().for_each(|&(a, weight_a)| c[a] += weight(j) * weight_a * value);
        }
        for i in 0..n {
            let first = i.saturating_sub(3);
            let before = c[first..i].iter().zip(&self.factor[i][3 + first - i..]);
            c[i] = (c[i] - before.map(|(c, f)| c * f).sum::<f64>()) * self.factor[i][3];
        }
        for i in (0..n).rev() {
            let behind = (i + 1..n).take(3).map(|m| self.factor[m][3 + i - m] * c[m]);
            c[i] = (c[i] - behind.sum::<f64>()) * self.factor[i][3];
        }
        c
    }
}

/// Weight of value `j`: by symmetry all values but the first count twice.
fn weight(j: usize) -> f64 {
    if j == 0 { 0.5 } else { 1.0 }
}

/// The coefficients that contribute to the spline at j/2 with their weights, mirrored ones merged, and their
/// number.
fn terms(j: usize, n: usize) -> ([(usize, f64); 4], usize) {
    let k = (j / 2) as isize;
    let on = [(k - 1, 1.0 / 6.0), (k, 4.0 / 6.0), (k + 1, 1.0 / 6.0), (k + 2, 0.0)];
    let between = [(k - 1, 1.0 / 48.0), (k, 23.0 / 48.0), (k + 1, 23.0 / 48.0), (k + 2, 1.0 / 48.0)];
    let (mut terms, mut count) = ([(0, 0.0); 4], 0);
    for (node, share) in if j.is_multiple_of(2) { on } else { between } {
        let node = node.unsigned_abs();
        if node >= n || share == 0.0 {
            continue;
        }
        match terms[..count].iter_mut().find(|(known, _)| *known == node) {
            Some((_, sum)) => *sum += share,
            None => {
                terms[count] = (node, share);
                count += 1;
            }
        }
    }
    (terms, count)
}

/// The least-squares fit in two dimensions, with `columns` columns: half as many columns and rows as
/// `values`.
pub(super) fn fit_plane(values: &[f64], columns: usize) -> Vec<f64> {
    let across = LeastSquaresSpline::new(columns);
    let lines: Vec<Vec<f64>> = values.chunks(2 * columns).map(|line| across.solve(line)).collect();
    let rows = lines.len() / 2;
    let down = LeastSquaresSpline::new(rows);
    let mut plane = vec![0.0; rows * columns];
    for i in 0..columns {
        let column: Vec<f64> = lines.iter().map(|line| line[i]).collect();
        for (row, value) in down.solve(&column).into_iter().enumerate() {
            plane[row * columns + i] = value;
        }
    }
    plane
}

/// The values of that spline at the nodes and midway between them: twice as many columns and rows.
pub(super) fn plane_at_half_nodes(coefficients: &[f64], columns: usize) -> Vec<f64> {
    let lines: Vec<Vec<f64>> = coefficients.chunks(columns).map(half_nodes).collect();
    let (wide, rows) = (2 * columns, lines.len());
    let mut values = vec![0.0; 2 * rows * wide];
    for i in 0..wide {
        let column: Vec<f64> = lines.iter().map(|line| line[i]).collect();
        for (row, value) in half_nodes(&column).into_iter().enumerate() {
            values[row * wide + i] = value;
        }
    }
    values
}

/// Weights of the values at these nodes in Lagrange interpolation at `at`, and their derivatives.
pub(super) fn lagrange(nodes: &[f64], at: f64) -> Vec<(f64, f64)> {
    let product = |i: usize, leave: Option<usize>| {
        let factor = |j: usize| if Some(j) == leave { 1.0 } else { at - nodes[j] };
        (0..nodes.len()).filter(|&j| j != i).map(factor).product::<f64>()
    };
    (0..nodes.len())
        .map(|i| {
            let others = || (0..nodes.len()).filter(move |&j| j != i);
            let scale = 1.0 / others().map(|j| nodes[i] - nodes[j]).product::<f64>();
            (product(i, None) * scale, others().map(|j| product(i, Some(j))).sum::<f64>() * scale)
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The fit reproduces splines exactly; for a smooth function the error is of fourth order.
    #[test]
    fn the_fit_is_exact_for_splines_and_of_fourth_order() {
        let spline = [3.0, -1.0, 0.5, 2.0, 0.0, 0.0];
        let again = LeastSquaresSpline::new(6).solve(&half_nodes(&spline));
        assert!(again.iter().zip(spline).all(|(a, b)| (a - b).abs() < 1e-12), "{again:?}");

        let bell = |x: f64| libm::exp(-x * x / 2.0);
        let mut worst = [0.0f64; 2];
        for (step, worst) in [0.5, 0.25].into_iter().zip(&mut worst) {
            let n = (8.0 / step) as usize;
            let values: Vec<f64> = (0..2 * n).map(|j| bell(j as f64 * step / 2.0)).collect();
            let fitted = half_nodes(&LeastSquaresSpline::new(n).solve(&values));
            *worst = fitted.iter().zip(&values).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
        }
        // Halving the step divides the error by about 16.
        assert!(worst[0] < 1e-3 && worst[1] < worst[0] / 12.0, "{worst:?}");
    }

    #[test]
    fn lagrange_is_exact_for_its_degree() {
        let nodes = [-1.0, 0.0, 1.0, 2.0];
        let cubic = |x: f64| 1.0 - 2.0 * x + 3.0 * x * x * x;
        let weights = lagrange(&nodes, 0.3);
        let value: f64 = nodes.iter().zip(&weights).map(|(&n, w)| w.0 * cubic(n)).sum();
        let slope: f64 = nodes.iter().zip(&weights).map(|(&n, w)| w.1 * cubic(n)).sum();
        assert!((value - cubic(0.3)).abs() < 1e-14 && (slope - (-2.0 + 9.0 * 0.09)).abs() < 1e-13);
    }
}
