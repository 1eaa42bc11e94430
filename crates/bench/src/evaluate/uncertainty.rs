//! Whether claimed uncertainties are true: coverage, ratio, and errors over ten classes of the claim (Sciacchitano, Meas.
//! Sci. Technol. 30, 092001, 2019).

use serde::Serialize;

use super::statistics::ratio;

/// Of one component; null without claims.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
#[allow(missing_docs)]
pub struct Uncertainty {
    /// Errors with a claim.
    pub n: usize,
    /// Shares of |e| <= U and <= 2 U: 68.3 % and 95.4 % of normal errors.
    pub coverage_1s: Option<f64>,
    pub coverage_2s: Option<f64>,
    /// rms(e) / rms(U): 1 if calibrated, more if claims are too bold.
    pub ratio: Option<f64>,
    /// Tenths of the errors, from the least claim to the greatest.
    pub bins: Vec<Claimed>,
}

/// Errors of similar claims.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
#[allow(missing_docs)]
pub struct Claimed {
    pub n: usize,
    pub claimed_rms: f64,
    pub error_rms: f64,
}

/// Classes of the claim.
const BINS: usize = 10;

impl Uncertainty {
    /// Of errors and their claimed standard uncertainties, in the same unit; NaN claims are left out. `None` without any.
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
                Claimed { n, claimed_rms: root(u, n), error_rms: root(e, n) }
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
    fn honest_claims_cover_and_bold_ones_do_not() {
        // Errors spread evenly over [-u sqrt 3, u sqrt 3] have the standard deviation u: 1 / sqrt 3 of them within u.
        let errors = |boldness: f64| {
            (0..10_000).map(move |i| {
                let u = 0.1 + 0.1 * f64::from(i % 10);
                let share = f64::from(i / 10) / 999.0 * 2.0 - 1.0;
                (u * 3f64.sqrt() * share, u / boldness)
            })
        };
        let honest = Uncertainty::of(errors(1.0)).unwrap();
        // 1000 steps per class.
        assert!((honest.coverage_1s.unwrap() - 1.0 / 3f64.sqrt()).abs() < 2e-3);
        assert_eq!(honest.coverage_2s, Some(1.0));
        assert!((honest.ratio.unwrap() - 1.0).abs() < 2e-3);
        assert_eq!(honest.bins.len(), 10);
        for bin in &honest.bins {
            assert!((bin.error_rms / bin.claimed_rms - 1.0).abs() < 2e-3, "{bin:?}");
        }
        assert!((Uncertainty::of(errors(2.0)).unwrap().ratio.unwrap() - 2.0).abs() < 4e-3);
        assert_eq!(Uncertainty::of([(1.0, f64::NAN)].into_iter()), None);
    }
}
