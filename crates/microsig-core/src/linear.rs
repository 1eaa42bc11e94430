//! Symmetric positive definite systems with up to a few hundred unknowns: Cholesky factorization, solution,
//! inverse. The factorization reads the lower triangle only.

/// A symmetric matrix, stored row by row.
#[derive(Debug, Clone, PartialEq)]
pub struct Symmetric {
    n: usize,
    values: Vec<f64>,
}

impl Symmetric {
    /// All elements are 0.
    pub fn zeros(n: usize) -> Self {
        Symmetric { n, values: vec![0.0; n * n] }
    }

    /// The matrix with these elements, row by row.
    pub fn of(n: usize, values: Vec<f64>) -> Self {
        debug_assert_eq!(values.len(), n * n);
        Symmetric { n, values }
    }

    /// Number of rows.
    pub fn n(&self) -> usize {
        self.n
    }

    /// An element.
    pub fn at(&self, i: usize, j: usize) -> f64 {
        self.values[i * self.n + j]
    }

    /// Adds to an element, not to its mirror image.
    pub fn add(&mut self, i: usize, j: usize, value: f64) {
        self.values[i * self.n + j] += value;
    }

    /// The lower triangular Cholesky factor L, with A = L L^T; `None` if the matrix is not positive definite:
    /// if the square of an element of the diagonal of L is not above `least` of the element of A.
    fn factor(&self, least: f64) -> Option<Vec<f64>> {
        let n = self.n;
        let mut l = self.values.clone();
        for j in 0..n {
            for i in j..n {
                let dot: f64 = (0..j).map(|k| l[i * n + k] * l[j * n + k]).sum();
                let rest = self.at(i, j) - dot;
                if i == j {
                    if !(rest > least * self.at(i, i).abs() && rest.is_finite()) {
                        return None;
                    }
                    l[j * n + j] = libm::sqrt(rest);
                } else {
                    l[i * n + j] = rest / l[j * n + j];
                }
            }
        }
        Some(l)
    }

    /// The solution x of A x = b; `None` if the matrix is not positive definite.
    pub fn solve(&self, b: &[f64]) -> Option<Vec<f64>> {
        Some(substitute(&self.factor(0.0)?, b))
    }

    /// The inverse; `None` if the matrix is not positive definite.
    pub fn inverse(&self) -> Option<Symmetric> {
        let n = self.n;
        let l = self.factor(0.0)?;
        let mut inverse = Symmetric::zeros(n);
        let mut unit = vec![0.0; n];
        for j in 0..n {
            unit[j] = 1.0;
            for (i, value) in substitute(&l, &unit).into_iter().enumerate() {
                inverse.values[i * n + j] = value;
            }
            unit[j] = 0.0;
        }
        Some(inverse)
    }

    /// The diagonal of the inverse: sums of squares of the columns of the inverse of L. `None` if the matrix is
    /// singular: if a row depends on those above it to within `least`.
    pub fn inverse_diagonal(&self, least: f64) -> Option<Vec<f64>> {
        let (n, l) = (self.n, self.factor(least)?);
        let mut x = vec![0.0; n];
        let squared = (0..n).map(|column| {
            for i in column..n {
                let dot: f64 = (column..i).map(|k| l[i * n + k] * x[k]).sum();
                x[i] = (f64::from(u8::from(i == column)) - dot) / l[i * n + i];
            }
            x[column..].iter().map(|v| v * v).sum()
        });
        Some(squared.collect())
    }

    /// The product A x.
    pub fn times(&self, x: &[f64]) -> Vec<f64> {
        self.values.chunks(self.n).map(|row| row.iter().zip(x).map(|(a, b)| a * b).sum()).collect()
    }
}

/// Solves L L^T x = b by forward and backward substitution.
fn substitute(l: &[f64], b: &[f64]) -> Vec<f64> {
    let n = b.len();
    let mut x = b.to_vec();
    for i in 0..n {
        let dot: f64 = (0..i).map(|k| l[i * n + k] * x[k]).sum();
        x[i] = (x[i] - dot) / l[i * n + i];
    }
    for i in (0..n).rev() {
        let dot: f64 = (i + 1..n).map(|k| l[k * n + i] * x[k]).sum();
        x[i] = (x[i] - dot) / l[i * n + i];
    }
    x
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn solution_and_inverse_agree() {
        let mut a = Symmetric::zeros(5);
        for i in 0..5 {
            for j in 0..5 {
                a.add(i, j, 1.0 / (1.0 + (i + j) as f64) + if i == j { 0.1 } else { 0.0 });
            }
        }
        let b = [1.0, -2.0, 3.0, 0.5, 0.0];
        let x = a.solve(&b).unwrap();
        for (left, right) in a.times(&x).iter().zip(b) {
            assert!((left - right).abs() < 1e-10, "{left} {right}");
        }
        for (left, right) in a.inverse().unwrap().times(&b).iter().zip(&x) {
            assert!((left - right).abs() < 1e-9, "{left} {right}");
        }
        a.add(0, 0, -5.0);
        assert!(a.solve(&b).is_none());
    }
}
