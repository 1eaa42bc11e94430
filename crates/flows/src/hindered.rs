//! A sphere near a plane wall: resistance to motion along and across the wall, and slip in a shear flow.
//!
//! Resistances are friction coefficients relative to that far from walls, 6 pi mu a, of a sphere that rotates
//! freely; mobility and diffusion are their inverses. The slip is the velocity along the wall of a sphere
//! without force and torque, relative to the velocity of the undisturbed shear flow at its center. All depend
//! on the gap between sphere and wall over the radius a, or on A = a/h, where h is the distance of the
//! center.
//!
//! Far from the wall they follow Faxen's series, 1 / (1 - 9/16 A + 1/8 A^3 - 45/256 A^4 - 1/16 A^5) along the
//! wall, Lorentz's 1 + 9/8 A + ... across it, and 1 - 5/16 A^3 for the slip. Near the wall lubrication holds,
//! with l = -ln gap: (l^2 + 3.188 l + 1.591) / (2 l + 1.908) along (Goldman, Cox and Brenner, Chem. Eng. Sci.
//! 22 (1967) 637; some papers print 4.325 instead of 3.188), 1/gap + l/5 + 0.971 across (Cox and Brenner,
//! ibid. 1753), and the slip tends to 0 as 0.743 / (0.638 + 0.2 l) (Goldman, Cox and Brenner, ibid. 653).
//! Between them, exact solutions: Brenner's series across the wall (Chem. Eng. Sci. 16 (1961) 242, Eq. 2.19),
//! and along it a numerical one (results/walls/exact.py), which agrees with the tables of Goldman, Cox and
//! Brenner, computed in bipolar coordinates, to four digits.
//!
//! Here each is one formula for all gaps: the part that is singular at contact, with the constants of Chaoui
//! and Feuillebois (Q. J. Mech. Appl. Math. 56 (2003) 381), plus a polynomial in A whose first three
//! coefficients are exact in the far field; the others are fitted to the exact solutions
//! (results/walls/fit.py). They differ from these by at most 1e-5 (along and across) and 2e-5 (slip). The fit
//! of Bevan and Prieve (J. Chem. Phys. 113 (2000) 1228) to Brenner's series is within 0.7 %, and Faxen's
//! series within 1.3 % at gaps above half a radius.
//!
//! Gaps below 1e-6 count as 1e-6, where the roughness of real surfaces and forces between them matter more.

/// Smallest gap in radii.
const MIN_GAP: f64 = 1e-6;

/// Resistance to motion along a wall at a gap in radii, relative to that far from it: >= 1.
pub fn resistance_along(gap: f64) -> f64 {
    resistances(gap).0
}

/// Resistance to motion toward a wall or away from it at a gap in radii, relative to that far from it: >= 1.
pub fn resistance_across(gap: f64) -> f64 {
    resistances(gap).1
}

/// Resistances along and across a wall.
pub(crate) fn resistances(gap: f64) -> (f64, f64) {
    const ALONG: [f64; 6] = [1.293421, -0.340547, 0.292757, -0.236444, 0.12774, -0.023022];
    const ACROSS: [f64; 7] = [1.0, -0.075, 0.165625, -0.141801, -0.046259, 0.159998, -0.089362];
    let (a, log) = near(gap);
    let singular = 0.5 * log - 0.10883 / (0.4 * log + 0.3709) + 0.086605 * (1.0 - a) * log;
    (singular + polynomial(&ALONG, a), 1.0 / gap.max(MIN_GAP) + 0.2 * log + polynomial(&ACROSS, a))
}

/// Velocity of a sphere in a shear flow along a wall at a gap in radii, relative to the undisturbed
/// flow at its center: 0 to 1.
pub fn slip_in_shear(gap: f64) -> f64 {
    const POLYNOMIAL: [f64; 7] = [1.067152, -0.537278, 0.044499, 0.168719, -0.078128, -0.04911, 0.048655];
    let (a, log) = near(gap);
    let singular = 0.26913 * log - 0.0342 / (0.74313 * log + 0.50929);
    1.0 / (singular + 0.170163 * (1.0 - a) * log + polynomial(&POLYNOMIAL, a))
}

/// A = radius / distance of the center, and -ln(1 - A), which is -ln gap near contact and A far from it.
fn near(gap: f64) -> (f64, f64) {
    let gap = gap.max(MIN_GAP);
    (1.0 / (1.0 + gap), libm::log1p(1.0 / gap))
}

fn polynomial(coefficients: &[f64], a: f64) -> f64 {
    coefficients.iter().rev().fold(0.0, |sum, c| sum * a + c)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Brenner's series for the resistance across a wall, with terms divided by exp((2 n + 1) alpha).
    fn brenner(gap: f64) -> f64 {
        let alpha = libm::acosh(1.0 + gap);
        let sinh = libm::sinh(alpha);
        let term = |n: f64| {
            let e = libm::exp(-(2.0 * n + 1.0) * alpha);
            let numerator = 1.0 - e * e + (2.0 * n + 1.0) * libm::sinh(2.0 * alpha) * e;
            let denominator = (1.0 - e) * (1.0 - e) - (2.0 * n + 1.0) * (2.0 * n + 1.0) * sinh * sinh * e;
            n * (n + 1.0) / ((2.0 * n - 1.0) * (2.0 * n + 3.0)) * (numerator / denominator - 1.0)
        };
        let terms = (60.0 / alpha) as u32 + 10;
        4.0 / 3.0 * sinh * (1..terms).map(|n| term(f64::from(n))).sum::<f64>()
    }

    fn faxen(a: f64) -> f64 {
        1.0 - 9.0 / 16.0 * a + a * a * a / 8.0 - 45.0 / 256.0 * a * a * a * a - a * a * a * a * a / 16.0
    }

    #[test]
    fn brenners_table_is_reproduced_to_its_digits() {
        // Brenner 1961, resistance against alpha = acosh(h/a).
        for (alpha, table) in
            [(0.5, 9.2518), (1.0, 3.0361), (1.5, 1.8375), (2.0, 1.4129), (2.5, 1.2220), (3.0, 1.1252)]
        {
            let gap = libm::cosh(alpha) - 1.0;
            let (fit, series) = (resistance_across(gap), brenner(gap));
            assert!((series - table).abs() < 0.6e-4, "{alpha}: {series} {table}");
            assert!((fit - table).abs() < 1.5e-4, "{alpha}: {fit} {table}");
        }
        for k in 0..200 {
            let gap = libm::pow(10.0, f64::from(k) * 0.03 - 3.5);
            assert!((resistance_across(gap) / brenner(gap) - 1.0).abs() < 1.1e-5, "{gap}");
            let bevan = (6.0 * gap * gap + 9.0 * gap + 2.0) / (6.0 * gap * gap + 2.0 * gap);
            assert!((bevan / brenner(gap) - 1.0).abs() < 7.1e-3, "{gap}");
        }
    }

    /// Distance of the center in radii; force of a translating, force of a rotating and torque of a rotating
    /// sphere, and slip in shear, in the units of Goldman, Cox and Brenner (1967); results/walls/exact.csv.
    const EXACT: [(f64, f64, f64, f64, f64); 7] = [
        (10.0677, 1.05906, -1.16992e-5, 1.000306, 0.9996959),
        (3.7622, 1.17381, -5.621325e-4, 1.005925, 0.9943563),
        (2.3524, 1.307855, -3.523154e-3, 1.024992, 0.9776998),
        (1.5431, 1.567447, -1.953142e-2, 1.099799, 0.921874),
        (1.1276, 2.151578, -9.830667e-2, 1.38771, 0.7668291),
        (1.0453, 2.647967, -0.1941163, 1.699926, 0.6536183),
        (1.005004, 3.786308, -0.4558255, 2.505632, 0.4785991),
    ];

    #[test]
    fn exact_solutions_are_reproduced() {
        for (h, force, coupling, torque, slip) in EXACT {
            let gap = h - 1.0;
            // Without torque the sphere rotates, and the force is smaller.
            let free = force - 0.75 * coupling * coupling / torque;
            assert!((resistance_along(gap) / free - 1.0).abs() < 1.5e-5, "{h}: {}", resistance_along(gap));
            assert!((slip_in_shear(gap) / slip - 1.0).abs() < 2.5e-5, "{h}: {}", slip_in_shear(gap));
        }
    }

    #[test]
    fn laws_have_the_known_limits() {
        for a in [0.01, 0.05, 0.1, 0.2] {
            let gap = 1.0 / a - 1.0;
            // The next terms of the series are of order A^6 along and A^5 for the slip; fits are within 2e-5.
            let next = 0.2 * a * a * a * a * a;
            assert!((resistance_along(gap) * faxen(a) - 1.0).abs() < 1e-5 + next, "{a}");
            assert!((slip_in_shear(gap) - 1.0 + 5.0 / 16.0 * a * a * a).abs() < 2e-5 + 2.0 * next, "{a}");
            assert!(
                (1.0 / resistance_across(gap) - 1.0 + 9.0 / 8.0 * a - 0.5 * a * a * a).abs()
                    < 1e-5 + a * a * a * a
            );
        }
        // Faxen's series errs by 1.2 % at half a radius, and stays finite at contact.
        assert!((resistance_along(0.5) * faxen(1.0 / 1.5) - 1.0).abs() < 0.015);
        for gap in [1e-6, 1e-5, 1e-4, 1e-3] {
            let l = -libm::log(gap);
            // Goldman, Cox and Brenner give constants that hold to 1 %.
            let along = (l * l + 3.188 * l + 1.591) / (2.0 * l + 1.908);
            assert!((resistance_along(gap) / along - 1.0).abs() < 3e-3, "{gap}");
            let slip = (0.7431 * l + 0.5299) / (0.2 * l * l + 0.6376 * l + 0.3181);
            assert!((slip_in_shear(gap) / slip - 1.0).abs() < 4e-3, "{gap}: {} {slip}", slip_in_shear(gap));
            assert!(
                (resistance_across(gap) * gap - 1.0 - gap * (0.2 * l + 0.9713)).abs() < 1e-5 + gap * gap * l
            );
        }
    }

    #[test]
    fn laws_are_monotonic_between_one_and_their_limit_at_contact() {
        let laws: [fn(f64) -> f64; 3] = [resistance_along, resistance_across, |gap| 1.0 / slip_in_shear(gap)];
        for law in laws {
            let mut before = f64::INFINITY;
            for k in 0..1200 {
                let now = law(libm::pow(10.0, f64::from(k) * 0.01 - 6.0));
                // Coefficients are rounded to 1e-6.
                assert!(now < before + 1e-6 && now > 1.0 - 1e-6, "{k}: {now} {before}");
                before = now;
            }
            assert!((before - 1.0).abs() < 1e-5);
            assert_eq!(law(0.0), law(-1.0));
            assert!(law(0.0).is_finite());
        }
    }
}
