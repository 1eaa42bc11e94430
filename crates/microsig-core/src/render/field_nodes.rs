//! Interpolation over the field of view: places at which images are computed, and their weights.
//!
//! The places are the Padua points of a rectangle, which determine a polynomial of total degree n in two
//! variables (Bos, Caliari, De Marchi, Vianello and Xu 2006, J. Approx. Theory 143, 15).

/// The largest degree.
pub(super) const MOST: usize = 7;

/// Places in the field, and the polynomial through values at them.
#[derive(Debug, Clone, PartialEq, serde::Serialize, serde::Deserialize)]
pub(super) struct FieldNodes {
    degree: usize,
    /// Center of the rectangle and half its width and height, px.
    center_px: [f64; 2],
    half_px: [f64; 2],
    /// Inverse of the matrix of the basis at the places: [place x basis], transposed.
    inverse: Vec<f64>,
}

impl FieldNodes {
    /// For images that are the same everywhere: one node.
    pub(super) fn one() -> FieldNodes {
        FieldNodes { degree: 0, center_px: [0.0; 2], half_px: [1.0; 2], inverse: vec![1.0] }
    }

    /// For a sensor of this size (px) and polynomials of this degree.
    pub(super) fn new(degree: usize, size_px: [f64; 2]) -> FieldNodes {
        let nodes = FieldNodes {
            degree,
            center_px: size_px.map(|size| 0.5 * (size + 1.0)),
            half_px: size_px.map(|size| 0.5 * size),
            inverse: Vec::new(),
        };
        let rows: Vec<f64> = padua(degree).into_iter().flat_map(|at| nodes.basis(at)).collect();
        FieldNodes { inverse: inverted(rows, nodes.count()), ..nodes }
    }

    /// Number of places.
    pub(super) fn count(&self) -> usize {
        (self.degree + 1) * (self.degree + 2) / 2
    }

    pub(super) fn places_px(&self) -> Vec<[f64; 2]> {
        padua(self.degree).into_iter().map(|at| self.in_px(at)).collect()
    }

    /// A position in units of half the rectangle from its center, in px.
    pub(super) fn in_px(&self, at: [f64; 2]) -> [f64; 2] {
        std::array::from_fn(|axis| self.center_px[axis] + self.half_px[axis] * at[axis])
    }

    /// The weight of each place for a position, px.
    pub(super) fn weights(&self, at_px: [f64; 2]) -> Vec<f64> {
        if self.degree == 0 {
            return vec![1.0];
        }
        // Polynomials grow fast outside.
        let at = std::array::from_fn(|axis| {
            ((at_px[axis] - self.center_px[axis]) / self.half_px[axis]).clamp(-OUTSIDE, OUTSIDE)
        });
        let basis = self.basis(at);
        let count = self.count();
        let place_weight =
            |place: usize| (0..count).map(|i| basis[i] * self.inverse[i * count + place]).sum();
        (0..count).map(place_weight).collect()
    }

    /// Products of Chebyshev polynomials, of at most the total degree of the nodes.
    fn basis(&self, [x, y]: [f64; 2]) -> Vec<f64> {
        let chebyshev = |x: f64| {
            let mut values = [1.0; MOST + 1];
            values[1] = x;
            (2..=MOST).for_each(|i| values[i] = 2.0 * x * values[i - 1] - values[i - 2]);
            values
        };
        let (in_x, in_y) = (chebyshev(x), chebyshev(y));
        let mut basis = Vec::with_capacity(self.count());
        for (i, in_x) in in_x.iter().enumerate().take(self.degree + 1) {
            basis.extend(in_y[..=self.degree - i].iter().map(|in_y| in_x * in_y));
        }
        basis
    }
}

/// Positions are moved to this distance from the center, in units of half the rectangle.
const OUTSIDE: f64 = 1.1;

/// The Padua points of a degree >= 1 on a square from -1 to 1; for 0, its middle.
fn padua(degree: usize) -> Vec<[f64; 2]> {
    if degree == 0 {
        return vec![[0.0, 0.0]];
    }
    let at = |i: usize, n: usize| libm::cos(std::f64::consts::PI * i as f64 / n as f64);
    let mut points = Vec::new();
    for i in 0..=degree {
        for j in (0..=degree + 1).filter(|j| (i + j).is_multiple_of(2)) {
            points.push([at(i, degree), at(j, degree + 1)]);
        }
    }
    points
}

/// The inverse of a matrix by Gauss-Jordan elimination with pivots.
fn inverted(mut matrix: Vec<f64>, n: usize) -> Vec<f64> {
    let mut inverse = vec![0.0; n * n];
    (0..n).for_each(|i| inverse[i * n + i] = 1.0);
    for column in 0..n {
        let size = |row: &usize| matrix[row * n + column].abs();
        let pivot = (column..n).max_by(|a, b| size(a).total_cmp(&size(b))).unwrap_or(column);
        for k in 0..n {
            matrix.swap(column * n + k, pivot * n + k);
            inverse.swap(column * n + k, pivot * n + k);
        }
        let own = 1.0 / matrix[column * n + column];
        for k in 0..n {
            matrix[column * n + k] *= own;
            inverse[column * n + k] *= own;
        }
        for row in (0..n).filter(|row| *row != column) {
            let factor = matrix[row * n + column];
            for k in 0..n {
                matrix[row * n + k] -= factor * matrix[column * n + k];
                inverse[row * n + k] -= factor * inverse[column * n + k];
            }
        }
    }
    inverse
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Weights of each degree give a polynomial of that degree exactly.
    #[test]
    fn polynomials_are_interpolated_exactly() {
        for degree in 1..=MOST {
            let nodes = FieldNodes::new(degree, [512.0, 300.0]);
            let power = |v: f64, n: usize| (0..n).fold(1.0, |product, _| product * v);
            let value = |[x, y]: [f64; 2]| {
                let (x, y) = ((x - 200.0) / 256.0, (y - 170.0) / 150.0);
                power(x, degree) - 2.0 * power(x, degree - 1) * y + power(y, degree) + 3.0
            };
            let places = nodes.places_px();
            assert_eq!(places.len(), nodes.count());
            for at in [[256.5, 150.5], [3.0, 290.0], [511.0, 7.0], [100.0, 100.0]] {
                let weights = nodes.weights(at);
                let sum: f64 = weights.iter().zip(&places).map(|(w, place)| w * value(*place)).sum();
                assert!((sum - value(at)).abs() < 1e-10, "{degree} {at:?}: {sum}, not {}", value(at));
            }
        }
        assert_eq!(FieldNodes::one().weights([3.0, 4.0]), [1.0]);
    }
}
