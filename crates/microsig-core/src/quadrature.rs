//! Gauss-Legendre quadrature: nodes and weights by Newton's method on the Legendre polynomials.

/// Positive nodes and their weights of the 8-point rule on [-1, 1] (Abramowitz & Stegun, table 25.4).
pub const GAUSS_LEGENDRE_8: [(f64, f64); 4] = [
    (0.183_434_642_495_649_8, 0.362_683_783_378_362),
    (0.525_532_409_916_329, 0.313_706_645_877_887_3),
    (0.796_666_477_413_626_7, 0.222_381_034_453_374_47),
    (0.960_289_856_497_536_2, 0.101_228_536_290_376_26),
];

/// The `n`-point rule on [-1, 1]: nodes in increasing order, and weights, which sum to 2.
pub fn gauss_legendre(n: usize) -> (Vec<f64>, Vec<f64>) {
    let (mut nodes, mut weights) = (vec![0.0; n], vec![0.0; n]);
    for i in 0..n.div_ceil(2) {
        let mut x = libm::cos(std::f64::consts::PI * (i as f64 + 0.75) / (n as f64 + 0.5));
        let mut slope = 0.0;
        for _ in 0..100 {
            let (value, before) = polynomial(n, x);
            slope = n as f64 * (x * value - before) / (x * x - 1.0);
            let step = value / slope;
            x -= step;
            if step.abs() < 1e-15 {
                break;
            }
        }
        let weight = 2.0 / ((1.0 - x * x) * slope * slope);
        (nodes[i], nodes[n - 1 - i]) = (-x, x);
        (weights[i], weights[n - 1 - i]) = (weight, weight);
    }
    if n % 2 == 1 {
        nodes[n / 2] = 0.0;
    }
    (nodes, weights)
}

/// The Legendre polynomials of degrees n and n - 1, n >= 1.
fn polynomial(n: usize, x: f64) -> (f64, f64) {
    let (mut before, mut value) = (1.0, x);
    for k in 2..=n {
        let k = k as f64;
        (before, value) = (value, ((2.0 * k - 1.0) * x * value - (k - 1.0) * before) / k);
    }
    (value, before)
}

/// The `n`-point rule on the interval from `low` to `high`.
pub fn gauss_legendre_on(low: f64, high: f64, n: usize) -> (Vec<f64>, Vec<f64>) {
    let (nodes, weights) = gauss_legendre(n);
    let (middle, half) = (0.5 * (low + high), 0.5 * (high - low));
    (nodes.iter().map(|x| middle + half * x).collect(), weights.iter().map(|w| half * w).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_table_is_the_rule_and_polynomials_are_integrated_exactly() {
        let (nodes, weights) = gauss_legendre(8);
        for (i, (node, weight)) in GAUSS_LEGENDRE_8.into_iter().enumerate() {
            assert!((nodes[4 + i] - node).abs() < 1e-15 && (nodes[3 - i] + node).abs() < 1e-15, "{node}");
            assert!((weights[4 + i] - weight).abs() < 1e-15, "{weight}");
        }
        let (nodes, weights) = gauss_legendre_on(1.0, 3.0, 5);
        let cube = |x: f64| x * x * x;
        let integral: f64 = nodes.iter().zip(weights).map(|(x, w)| w * cube(cube(*x))).sum();
        assert!((integral - 5904.8).abs() < 1e-10 * integral);
    }
}
