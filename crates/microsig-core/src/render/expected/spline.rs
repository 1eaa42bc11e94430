//! Cubic B-splines on equal steps, and the weights of cubic interpolation.

/// Coefficients of the cubic spline through `values` at the nodes 0, 1, 2, ..., even about node 0 and zero from the node
/// behind the last one on: (c[k-1] + 4 c[k] + c[k+1]) / 6 = values[k].
pub(super) fn even_spline(values: &mut [f64]) {
    let n = values.len();
    if n == 0 {
        return;
    }
    // Thomas algorithm; the first row is 4 c0 + 2 c1 because c[-1] = c[1].
    let mut ratio = vec![0.0; n];
    ratio[0] = 0.5;
    values[0] *= 1.5;
    for k in 1..n {
        let pivot = 1.0 / (4.0 - ratio[k - 1]);
        ratio[k] = pivot;
        values[k] = (6.0 * values[k] - values[k - 1]) * pivot;
    }
    for k in (0..n - 1).rev() {
        values[k] -= ratio[k] * values[k + 1];
    }
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

/// The spline's value at a place, in steps from node 0.
pub(super) fn evaluate(coefficients: &[f64], place: f64) -> f64 {
    let cell = libm::floor(place);
    let (weights, _) = basis(place - cell);
    let first = cell as isize - 1;
    let c = |i: usize| coefficients.get((first + i as isize).unsigned_abs()).copied().unwrap_or(0.0);
    (0..4).map(|i| weights[i] * c(i)).sum()
}

/// Weights of the four coefficients around a place `t` in [0, 1] behind the second of them, and their derivatives.
pub(super) fn basis(t: f64) -> ([f64; 4], [f64; 4]) {
    let s = 1.0 - t;
    let (t2, s2) = (t * t, s * s);
    (
        [
            s2 * s / 6.0,
            (4.0 - 6.0 * t2 + 3.0 * t2 * t) / 6.0,
            (4.0 - 6.0 * s2 + 3.0 * s2 * s) / 6.0,
            t2 * t / 6.0,
        ],
        [-s2 / 2.0, (3.0 * t2 - 4.0 * t) / 2.0, (4.0 * s - 3.0 * s2) / 2.0, t2 / 2.0],
    )
}

/// Weights of the values at these nodes in the polynomial through all of them (Lagrange), and their derivatives.
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

    #[test]
    fn the_spline_meets_its_values_and_is_of_fourth_order() {
        let bell = |x: f64| libm::exp(-x * x / 2.0);
        let mut worst = [0.0f64; 2];
        for (step, worst) in [0.5, 0.25].into_iter().zip(&mut worst) {
            let mut c: Vec<f64> = (0..(8.0 / step) as usize).map(|k| bell(k as f64 * step)).collect();
            even_spline(&mut c);
            for (k, value) in half_nodes(&c).into_iter().enumerate() {
                let error = (value - bell(k as f64 * step / 2.0)).abs();
                assert!(k % 2 == 1 || error < 1e-14, "node {k}: {error}");
                *worst = worst.max(error);
            }
        }
        // Halving the step divides the error by 16, or nearly so.
        assert!(worst[0] < 1e-3 && worst[1] < worst[0] / 12.0, "{worst:?}");
    }

    #[test]
    fn weights_sum_to_one_and_derivatives_to_zero() {
        for t in [0.0, 0.3, 0.99] {
            let (w, d) = basis(t);
            assert!((w.iter().sum::<f64>() - 1.0).abs() < 1e-15 && d.iter().sum::<f64>().abs() < 1e-15);
            let (ahead, _) = basis(t + 1e-6);
            for i in 0..4 {
                assert!(((ahead[i] - w[i]) / 1e-6 - d[i]).abs() < 2e-6);
            }
        }
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
