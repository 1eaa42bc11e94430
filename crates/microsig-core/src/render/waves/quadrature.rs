//! Running integrals by Gauss-Legendre quadrature, and Gauss-Hermite quadrature.

use crate::quadrature::gauss_legendre;

/// Legendre polynomials of degrees 0 to n - 1.
fn polynomials(n: usize, x: f64) -> Vec<f64> {
    let mut values = Vec::with_capacity(n);
    for k in 0..n {
        let d = k as f64;
        values.push(match k {
            0 => 1.0,
            1 => x,
            _ => ((2.0 * d - 1.0) * x * values[k - 1] - (d - 1.0) * values[k - 2]) / d,
        });
    }
    values
}

/// Weights of values at the `n` Gauss-Legendre nodes of [0, end] that give the integral of the interpolating
/// polynomial from 0 to each target; one row for each target.
pub(super) fn running_integral(end: f64, n: usize, targets: &[f64]) -> Vec<f64> {
    let (nodes, weights) = gauss_legendre(n);
    let node_polynomials: Vec<Vec<f64>> = nodes.iter().map(|&x| polynomials(n, x)).collect();
    targets
        .iter()
        .flat_map(|&target| {
            let x = 2.0 * target / end - 1.0;
            let p = polynomials(n + 1, x);
            // (2 k + 1) times the integral of P_k from -1 to x is P_(k+1) - P_(k-1).
            let primitive: Vec<f64> =
                (0..n).map(|k| if k == 0 { x + 1.0 } else { p[k + 1] - p[k - 1] }).collect();
            let row: Vec<f64> = node_polynomials
                .iter()
                .zip(&weights)
                .map(|(polynomials, weight)| {
                    let sum: f64 = polynomials.iter().zip(&primitive).map(|(p, q)| p * q).sum();
                    0.25 * end * weight * sum
                })
                .collect();
            row
        })
        .collect()
}

/// Gauss-Hermite quadrature: nodes in units of the standard deviation of a normal distribution, and weights,
/// which sum to 1.
pub(super) fn hermite(n: usize) -> (Vec<f64>, Vec<f64>) {
    let (mut nodes, mut weights) = (vec![0.0; n], vec![0.0; n]);
    // Normalized polynomials of degrees n and n - 1.
    let polynomial = |x: f64| {
        let (mut before, mut value) = (0.0, 1.0);
        for k in 1..=n {
            let k = k as f64;
            (before, value) = (value, (x * value - libm::sqrt(k - 1.0) * before) / libm::sqrt(k));
        }
        (value, before)
    };
    // The roots are farther apart than the steps; sign changes are refined by bisection.
    let reach = 2.0 * libm::sqrt(n as f64) + 1.0;
    let steps = 64 * n;
    let mut found = 0;
    for i in 0..steps {
        let at = |i: usize| -reach + 2.0 * reach * i as f64 / steps as f64;
        let (mut low, mut high) = (at(i), at(i + 1));
        let (low_value, high_value) = (polynomial(low).0, polynomial(high).0);
        if found == n || (low_value > 0.0) == (high_value > 0.0) {
            continue;
        }
        for _ in 0..60 {
            let middle = 0.5 * (low + high);
            if (polynomial(middle).0 > 0.0) == (low_value > 0.0) { low = middle } else { high = middle }
        }
        let x = 0.5 * (low + high);
        let (_, before) = polynomial(x);
        (nodes[found], weights[found]) = (x, 1.0 / (n as f64 * before * before));
        found += 1;
    }
    if n % 2 == 1 {
        nodes[n / 2] = 0.0;
    }
    (nodes, weights)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::quadrature::gauss_legendre_on;

    #[test]
    fn rules_are_exact_for_their_degree() {
        for n in [1, 2, 5, 40, 333] {
            let (nodes, weights) = gauss_legendre_on(0.0, 2.0, n);
            let cube: f64 = nodes.iter().zip(&weights).map(|(x, w)| w * x).sum();
            assert!((cube - 2.0).abs() < 1e-13, "{n}: {cube}");
            assert!(nodes.windows(2).all(|pair| pair[0] < pair[1]));
        }
        let (nodes, weights) = gauss_legendre(4);
        let sixth: f64 = nodes.iter().zip(&weights).map(|(x, w)| w * x * x * x * x * x * x).sum();
        assert!((sixth - 2.0 / 7.0).abs() < 1e-15);
        for n in [3, 4, 15, 40] {
            let (nodes, weights) = hermite(n);
            let moment =
                |f: fn(f64) -> f64| -> f64 { nodes.iter().zip(&weights).map(|(&x, w)| w * f(x)).sum() };
            assert!((moment(|_| 1.0) - 1.0).abs() < 1e-12, "{n}");
            assert!((moment(|x| x * x) - 1.0).abs() < 1e-12);
            assert!((moment(|x| x * x * x * x) - 3.0).abs() < 1e-11);
        }
    }

    #[test]
    fn running_integrals_of_a_polynomial() {
        let (nodes, _) = gauss_legendre_on(0.0, 3.0, 12);
        let rows = running_integral(3.0, 12, &[0.0, 0.7, 3.0]);
        for (row, target) in rows.chunks(12).zip([0.0f64, 0.7, 3.0]) {
            let sum: f64 = row.iter().zip(&nodes).map(|(w, x)| w * x * x * x).sum();
            assert!((sum - target * target * target * target / 4.0).abs() < 1e-12, "{target}: {sum}");
        }
    }
}
