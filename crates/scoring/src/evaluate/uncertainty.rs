//! Calibration of claimed uncertainties: coverage, ratio, and RMS error in ten classes of claimed uncertainty
//! (Sciacchitano, Meas. Sci. Technol. 30, 092001, 2019).

use super::statistics::ratio;

scores! {
    /// Calibration of claimed standard uncertainties U (Sciacchitano, Meas. Sci. Technol. 30, 092001, 2019).
    pub struct Uncertainty {
        /// Number of errors with a claimed uncertainty.
        pub n: usize,
        /// Fraction of errors with |e| <= U; 0.683 for normally distributed errors of standard deviation U.
        fraction coverage_1s: Option<f64>,
        /// Fraction of errors with |e| <= 2 U; 0.954 for normally distributed errors of standard deviation U.
        fraction coverage_2s: Option<f64>,
        /// rms(e) / rms(U): 1 if calibrated, above 1 if the claimed uncertainties are too small.
        not_negative ratio: Option<f64>,
        /// Ten classes with equal numbers of errors, in ascending order of U.
        pub bins: Vec<UncertaintyBin>,
    }

    /// Errors with similar claimed uncertainties.
    pub struct UncertaintyBin {
        /// Number of errors in the class.
        pub n: usize,
        /// RMS of the claimed uncertainties.
        not_negative claimed_rms: f64,
        /// RMS of the error.
        not_negative error_rms: f64,
    }
}

/// Number of classes.
const BINS: usize = 10;

impl Uncertainty {
    /// Calibration of (error, claimed standard uncertainty) pairs in the same unit; NaN values are skipped.
    /// `None` if none remain.
    pub fn of(errors: impl Iterator<Item = (f64, f64)>) -> Option<Self> {
        let mut claims: Vec<(f64, f64)> = errors.filter(|(e, u)| e.is_finite() && u.is_finite()).collect();
        claims.sort_by(|a, b| a.1.total_cmp(&b.1));
        let n = claims.len();
        let share = |k: f64| ratio(claims.iter().filter(|(e, u)| e.abs() <= k * u).count() as f64, n as f64);
        let squares =
            |part: &[(f64, f64)]| part.iter().fold((0.0, 0.0), |(e, u), c| (e + c.0 * c.0, u + c.1 * c.1));
        let root = |sum: f64, n: usize| (sum / n as f64).sqrt();
        let (e, u) = squares(&claims);
        let bins = (0..BINS)
            .map(|k| &claims[k * n / BINS..(k + 1) * n / BINS])
            .filter(|part| !part.is_empty())
            .map(|part| {
                let (e, u) = squares(part);
                let n = part.len();
                UncertaintyBin { n, claimed_rms: root(u, n), error_rms: root(e, n) }
            })
            .collect();
        (n > 0).then(|| Uncertainty {
            n,
            coverage_1s: share(1.0),
            coverage_2s: share(2.0),
            ratio: ratio(e, u).map(f64::sqrt),
            bins,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn correct_claims_cover_and_small_ones_do_not() {
        // Errors uniform on [-u sqrt 3, u sqrt 3] have standard deviation u; a share of 1 / sqrt 3 is within
        // u.
        let errors = |boldness: f64| {
            (0..10_000).map(move |i| {
                let u = 0.1 + 0.1 * f64::from(i % 10);
                let share = f64::from(i / 10) / 999.0 * 2.0 - 1.0;
                (u * 3f64.sqrt() * share, u / boldness)
            })
        };
        let calibrated = Uncertainty::of(errors(1.0)).unwrap();
        // 1000 steps per class.
        assert!((calibrated.coverage_1s.unwrap() - 1.0 / 3f64.sqrt()).abs() < 2e-3);
        assert_eq!(calibrated.coverage_2s, Some(1.0));
        assert!((calibrated.ratio.unwrap() - 1.0).abs() < 2e-3);
        assert_eq!(calibrated.bins.len(), 10);
        for bin in &calibrated.bins {
            assert!((bin.error_rms / bin.claimed_rms - 1.0).abs() < 2e-3, "{bin:?}");
        }
        assert!((Uncertainty::of(errors(2.0)).unwrap().ratio.unwrap() - 2.0).abs() < 4e-3);
        assert_eq!(Uncertainty::of([(1.0, f64::NAN)].into_iter()), None);
    }
}
