//! Sines and cosines of several angles at once by + - * only, so that compilers can vectorize them and every
//! machine gives the same bits.
//!
//! The angle is reduced by multiples of pi/2 in three parts (Cody & Waite, Software Manual for the Elementary
//! Functions, 1980), the first two of 33 bits, whose products with integers up to 2^20 are exact; the
//! polynomials that follow have the coefficients of fdlibm's kernels (Sun Microsystems 1993; libm has the
//! same).

/// Largest angle (rad) that is reduced here; above it libm is used.
const LIMIT: f64 = 1e6;

/// Adding this rounds a number to an integer, which is then in the lowest bits of the sum.
const ROUND: f64 = 6_755_399_441_055_744.0;
const TWO_OVER_PI: f64 = std::f64::consts::FRAC_2_PI;
/// pi/2 in parts: 33 bits, the next 33 bits, the rest (fdlibm's pio2_1, pio2_2, pio2_2t).
const HALF_PI: [f64; 3] = [1.570_796_326_734_125_6, 6.077_100_506_303_966e-11, 2.022_266_248_795_950_6e-21];
const SIN: [f64; 6] = [
    -1.666_666_666_666_663_2e-1,
    8.333_333_333_322_49e-3,
    -1.984_126_982_985_795e-4,
    2.755_731_370_707_006_8e-6,
    -2.505_076_025_340_686_3e-8,
    1.589_690_995_211_55e-10,
];
const COS: [f64; 6] = [
    4.166_666_666_666_66e-2,
    -1.388_888_888_887_411e-3,
    2.480_158_728_947_673e-5,
    -2.755_731_435_139_066_3e-7,
    2.087_572_321_298_175e-9,
    -1.135_964_755_778_819_5e-11,
];

/// Sines and cosines of N angles (rad), with absolute errors below 2.3e-16 for angles up to 1e6 rad; NaN for
/// NaN.
#[inline(always)]
pub fn sines_and_cosines<const N: usize>(angles: &[f64; N]) -> ([f64; N], [f64; N]) {
    let (mut sines, mut cosines) = ([0.0; N], [0.0; N]);
    let mut greatest = 0.0_f64;
    for angle in angles {
        greatest = if angle.abs() > greatest { angle.abs() } else { greatest };
    }
    if greatest > LIMIT {
        for i in 0..N {
            (sines[i], cosines[i]) = libm::sincos(angles[i]);
        }
        return (sines, cosines);
    }
    for i in 0..N {
        let shifted = angles[i] * TWO_OVER_PI + ROUND;
        let quarter = shifted.to_bits();
        let turns = shifted - ROUND;
        let r = angles[i] - turns * HALF_PI[0] - turns * HALF_PI[1] - turns * HALF_PI[2];
        let z = r * r;
        let sin =
            r + r * z * (SIN[0] + z * (SIN[1] + z * (SIN[2] + z * (SIN[3] + z * (SIN[4] + z * SIN[5])))));
        let cos = 1.0 - 0.5 * z
            + z * z * (COS[0] + z * (COS[1] + z * (COS[2] + z * (COS[3] + z * (COS[4] + z * COS[5])))));
        // In odd quadrants sine and cosine are exchanged; the sine is negative in quadrants 2 and 3, the
        // cosine in 1 and 2 (from 0).
        let exchange = (quarter & 1).wrapping_neg();
        let (s, c) = (sin.to_bits(), cos.to_bits());
        let sine = (s & !exchange) | (c & exchange);
        let cosine = (c & !exchange) | (s & exchange);
        sines[i] = f64::from_bits(sine ^ ((quarter & 2) << 62));
        cosines[i] = f64::from_bits(cosine ^ ((quarter.wrapping_add(1) & 2) << 62));
    }
    (sines, cosines)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn they_agree_with_libm_everywhere() {
        for i in 0..200_000 {
            let i = f64::from(i);
            // Small and large angles, both signs.
            let sign = if i % 2.0 == 0.0 { 1.0 } else { -1.0 };
            let angles = [sign * i * 1.234_567e-5, sign * i * 4.987_654_321, -i * 0.0123, i * 7.0];
            let (sines, cosines) = sines_and_cosines(&angles);
            for (j, angle) in angles.into_iter().enumerate() {
                let (sin, cos) = libm::sincos(angle);
                assert!((sines[j] - sin).abs() < 2.3e-16 && (cosines[j] - cos).abs() < 2.3e-16, "{angle}");
            }
        }
    }

    #[test]
    fn multiples_of_a_quarter_turn_and_huge_angles() {
        let half_pi = std::f64::consts::FRAC_PI_2;
        let (sines, cosines) = sines_and_cosines(&[0.0, half_pi, -half_pi, 2.0 * half_pi, 3.0 * half_pi]);
        for (found, expected) in sines.into_iter().zip([0.0, 1.0, -1.0, 0.0, -1.0]) {
            assert!((found - expected).abs() < 4e-16);
        }
        for (found, expected) in cosines.into_iter().zip([1.0, 0.0, 0.0, -1.0, 0.0]) {
            assert!((found - expected).abs() < 4e-16);
        }
        let (sines, _) = sines_and_cosines(&[1e9, f64::NAN]);
        assert_eq!(sines[0], libm::sin(1e9));
        assert!(sines[1].is_nan() && sines_and_cosines(&[f64::NAN]).0[0].is_nan());
    }
}
