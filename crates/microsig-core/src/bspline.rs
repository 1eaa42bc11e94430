//! Weights of coefficients in B-splines on equidistant nodes.
//!
//! The value of a spline is the sum of its coefficients around a position times these weights, its derivative
//! (per node spacing) the same sum with the derivatives of the weights (de Boor, A Practical Guide to Splines,
//! chapter IX). Weights are positive and sum to 1.

/// Quadratic: weights of a node and its two neighbors at a position `t` in [-0.5, 0.5] relative to the node,
/// and their derivatives.
#[inline]
pub fn quadratic(t: f64) -> ([f64; 3], [f64; 3]) {
    let (low, high) = (0.5 - t, 0.5 + t);
    ([0.5 * low * low, 0.75 - t * t, 0.5 * high * high], [-low, -2.0 * t, high])
}

/// Cubic: weights of the four coefficients around a position `t` in [0, 1] after the second of them, and
/// their derivatives.
#[inline]
pub fn cubic(t: f64) -> ([f64; 4], [f64; 4]) {
    let s = 1.0 - t;
    (
        [
            s * s * s / 6.0,
            (4.0 - 3.0 * t * t * (1.0 + s)) / 6.0,
            (4.0 - 3.0 * s * s * (1.0 + t)) / 6.0,
            t * t * t / 6.0,
        ],
        [-0.5 * s * s, 0.5 * t * (3.0 * t - 4.0), 0.5 * s * (4.0 - 3.0 * s), 0.5 * t * t],
    )
}

/// Number of coefficients around a position in [`quintic`].
pub const QUINTIC_TAPS: usize = 6;

/// Quintic: weights of the six coefficients around a position `t` in [0, 1] after the third of them, and
/// their derivatives.
#[inline]
pub fn quintic(t: f64) -> ([f64; QUINTIC_TAPS], [f64; QUINTIC_TAPS]) {
    let linear: [f64; 2] = [1.0 - t, t];
    let quadratic: [f64; 3] = raise(linear, t);
    let cubic: [f64; 4] = raise(quadratic, t);
    let q: [f64; 5] = raise(cubic, t);
    // Derivatives are differences of the weights of one degree lower.
    (raise(q, t), [-q[0], q[0] - q[1], q[1] - q[2], q[2] - q[3], q[3] - q[4], q[4]])
}

/// Weights of a B-spline from one degree lower (Cox and de Boor).
#[inline]
fn raise<const N: usize, const M: usize>(lower: [f64; N], t: f64) -> [f64; M] {
    let degree = N as f64;
    std::array::from_fn(|i| {
        let before = if i > 0 { lower[i - 1] * (t + degree - i as f64) } else { 0.0 };
        let own = if i < N { lower[i] * (i as f64 + 1.0 - t) } else { 0.0 };
        (before + own) / degree
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sum_to_one_with_their_derivatives<const N: usize>(
        spline: fn(f64) -> ([f64; N], [f64; N]),
        positions: [f64; 3],
    ) {
        for t in positions {
            let (weights, slopes) = spline(t);
            let sums = [weights.iter().sum::<f64>() - 1.0, slopes.iter().sum::<f64>()];
            assert!(sums.iter().all(|sum| sum.abs() < 1e-15), "{t}: {sums:?}");
            // The second derivative is at most 2, so a difference over 1e-6 errs by up to 1e-6.
            let (ahead, _) = spline(t + 1e-6);
            for i in 0..N {
                assert!(((ahead[i] - weights[i]) / 1e-6 - slopes[i]).abs() < 2e-6, "{t} {i}");
            }
        }
    }

    #[test]
    fn weights_sum_to_one_and_slopes_are_their_derivatives() {
        sum_to_one_with_their_derivatives(quadratic, [-0.5, 0.0, 0.3]);
        sum_to_one_with_their_derivatives(cubic, [0.0, 0.3, 0.99]);
        sum_to_one_with_their_derivatives(quintic, [0.0, 0.3, 0.99]);
    }

    #[test]
    fn weights_at_a_node_are_those_of_textbooks() {
        let near = |ours: &[f64], known: &[f64]| ours.iter().zip(known).all(|(a, b)| (a - b).abs() < 1e-15);
        assert!(near(&quadratic(0.0).0, &[1.0, 6.0, 1.0].map(|w| w / 8.0)));
        assert!(near(&cubic(0.0).0, &[1.0, 4.0, 1.0, 0.0].map(|w| w / 6.0)));
        assert!(near(&quintic(0.0).0, &[1.0, 26.0, 66.0, 26.0, 1.0, 0.0].map(|w| w / 120.0)));
    }

    #[test]
    fn raising_the_degree_gives_the_cubic_weights() {
        for t in [0.0, 0.3, 0.99] {
            let quadratic: [f64; 3] = raise([1.0 - t, t], t);
            let raised: [f64; 4] = raise(quadratic, t);
            assert!(raised.iter().zip(cubic(t).0).all(|(a, b)| (a - b).abs() < 1e-15), "{t}: {raised:?}");
        }
    }
}
