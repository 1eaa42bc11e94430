//! Zernike polynomials in Noll's order, orthonormal over the unit disc (Noll 1976).

/// Radial degree and azimuthal order for Noll's index j >= 1; the order is negative for terms with a sine.
fn indices(j: u32) -> (u32, i64) {
    let mut n = 0;
    // There are n (n + 1) / 2 terms of degrees below n.
    while (n + 1) * (n + 2) / 2 < j {
        n += 1;
    }
    let place = j - n * (n + 1) / 2;
    // Orders of one degree increase in pairs: 0, 2, 2, 4, 4 ... or 1, 1, 3, 3 ...
    let m = if n % 2 == 0 { 2 * (place / 2) } else { 2 * ((place - 1) / 2) + 1 };
    // Even indices have the cosine.
    (n, if j.is_multiple_of(2) { i64::from(m) } else { -i64::from(m) })
}

/// One term, prepared for evaluation.
#[derive(Debug, Clone)]
struct Term {
    /// Coefficients of rho^m, rho^(m + 2), ...
    radial: Vec<f64>,
    order: u32,
    sine: bool,
    factor: f64,
}

/// A sum of Zernike terms.
#[derive(Debug, Clone, Default)]
pub(super) struct Aberration {
    terms: Vec<Term>,
}

impl Aberration {
    /// The sum of terms given by Noll's indices and coefficients.
    pub(super) fn new(coefficients: &[(u32, f64)]) -> Aberration {
        let factorial = |k: u32| (1..=k).map(f64::from).product::<f64>();
        let terms = coefficients.iter().filter(|(_, c)| *c != 0.0).map(|&(j, c)| {
            let (n, signed) = indices(j);
            let m = signed.unsigned_abs() as u32;
            // In the order of decreasing powers, from rho^n.
            let mut radial: Vec<f64> = (0..=(n - m) / 2)
                .map(|k| {
                    let sign = if k % 2 == 0 { 1.0 } else { -1.0 };
                    sign * factorial(n - k)
                        / (factorial(k) * factorial((n + m) / 2 - k) * factorial((n - m) / 2 - k))
                })
                .collect();
            radial.reverse();
            let norm = if m == 0 { f64::from(n + 1) } else { 2.0 * f64::from(n + 1) };
            Term { radial, order: m, sine: signed < 0, factor: c * libm::sqrt(norm) }
        });
        Aberration { terms: terms.collect() }
    }

    pub(super) fn is_none(&self) -> bool {
        self.terms.is_empty()
    }

    /// The sum at a point of the unit disc.
    pub(super) fn at(&self, x: f64, y: f64) -> f64 {
        let rho2 = x * x + y * y;
        let mut sum = 0.0;
        for term in &self.terms {
            let radial = term.radial.iter().rev().fold(0.0, |sum, c| sum * rho2 + c);
            // rho^m cos m psi and rho^m sin m psi: a power of x + i y.
            let (mut re, mut im) = (1.0, 0.0);
            for _ in 0..term.order {
                (re, im) = (re * x - im * y, re * y + im * x);
            }
            sum += term.factor * radial * if term.sine { im } else { re };
        }
        sum
    }

    /// The steepest slopes over the disc along x and y, per unit of its radius.
    pub(super) fn steepest(&self) -> [f64; 2] {
        const SIDE: i32 = 24;
        const STEP: f64 = 1e-4;
        let mut steepest = [0.0f64; 2];
        for i in -SIDE..=SIDE {
            for j in -SIDE..=SIDE {
                let [x, y] = [i, j].map(|i| f64::from(i) / f64::from(SIDE));
                if self.is_none() || x * x + y * y > 1.0 {
                    continue;
                }
                let slopes = [
                    self.at(x + STEP, y) - self.at(x - STEP, y),
                    self.at(x, y + STEP) - self.at(x, y - STEP),
                ];
                (0..2).for_each(|axis| {
                    steepest[axis] = steepest[axis].max(slopes[axis].abs() / (2.0 * STEP));
                });
            }
        }
        steepest
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::quadrature::gauss_legendre_on;

    #[test]
    fn indices_are_nolls() {
        let expected = [
            (1, (0, 0)),
            (2, (1, 1)),
            (3, (1, -1)),
            (4, (2, 0)),
            (5, (2, -2)),
            (6, (2, 2)),
            (7, (3, -1)),
            (8, (3, 1)),
            (9, (3, -3)),
            (10, (3, 3)),
            (11, (4, 0)),
            (12, (4, 2)),
            (13, (4, -2)),
            (22, (6, 0)),
            (37, (8, 0)),
            (66, (10, 10)),
        ];
        for (j, found) in expected {
            assert_eq!(indices(j), found, "j = {j}");
        }
    }

    #[test]
    fn terms_are_orthonormal() {
        let (radii, weights) = gauss_legendre_on(0.0, 1.0, 16);
        let azimuths = 48;
        let product = |i: u32, j: u32| -> f64 {
            let (a, b) = (Aberration::new(&[(i, 1.0)]), Aberration::new(&[(j, 1.0)]));
            let mut sum = 0.0;
            for (rho, weight) in radii.iter().zip(&weights) {
                for azimuth in 0..azimuths {
                    let angle = 2.0 * std::f64::consts::PI * f64::from(azimuth) / f64::from(azimuths);
                    let (sine, cosine) = libm::sincos(angle);
                    let (x, y) = (rho * cosine, rho * sine);
                    sum += 2.0 * rho * weight * a.at(x, y) * b.at(x, y) / f64::from(azimuths);
                }
            }
            sum
        };
        for i in 1..=22 {
            for j in 1..=22 {
                let expected = if i == j { 1.0 } else { 0.0 };
                assert!((product(i, j) - expected).abs() < 1e-12, "{i} {j}");
            }
        }
    }
}
