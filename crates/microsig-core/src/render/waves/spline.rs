//! The quintic B-spline on equal steps, for images.

/// Number of coefficients around a position.
pub(super) const TAPS: usize = 6;

/// Weights of the six coefficients around a position, which is `t` in [0, 1] beyond the third of them, and
/// their derivatives.
pub(super) fn basis(t: f64) -> ([f64; TAPS], [f64; TAPS]) {
    (quintic(t), {
        // Differences of the quartic spline's weights.
        let q = quartic(t);
        [-q[0], q[0] - q[1], q[1] - q[2], q[2] - q[3], q[3] - q[4], q[4]]
    })
}

/// Weights of a B-spline from those of one degree lower (Cox and de Boor).
fn raise<const N: usize, const M: usize>(lower: [f64; N], t: f64) -> [f64; M] {
    let degree = N as f64;
    std::array::from_fn(|i| {
        let before = if i > 0 { lower[i - 1] * (t + degree - i as f64) } else { 0.0 };
        let own = if i < N { lower[i] * (i as f64 + 1.0 - t) } else { 0.0 };
        (before + own) / degree
    })
}

fn quartic(t: f64) -> [f64; 5] {
    let linear: [f64; 2] = [1.0 - t, t];
    let quadratic: [f64; 3] = raise(linear, t);
    let cubic: [f64; 4] = raise(quadratic, t);
    raise(cubic, t)
}

fn quintic(t: f64) -> [f64; TAPS] {
    raise(quartic(t), t)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn weights_are_those_of_the_quintic_spline() {
        let (at_node, _) = basis(0.0);
        let expected = [1.0, 26.0, 66.0, 26.0, 1.0, 0.0].map(|w| w / 120.0);
        assert!(at_node.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-15), "{at_node:?}");
        for t in [0.0, 0.3, 0.99] {
            let (weights, slopes) = basis(t);
            assert!(
                (weights.iter().sum::<f64>() - 1.0).abs() < 1e-15 && slopes.iter().sum::<f64>().abs() < 1e-15
            );
            let (ahead, _) = basis(t + 1e-6);
            for i in 0..TAPS {
                assert!(((ahead[i] - weights[i]) / 1e-6 - slopes[i]).abs() < 2e-6, "{t} {i}");
            }
        }
    }
}
