//! Decides which axes are logarithmic, and where they have ticks.

/// Maximum number of labels of a horizontal axis.
pub(super) const ACROSS: usize = 7;

/// Minimum ratio of the largest to the smallest value of a logarithmic axis.
const LOGARITHMIC: f64 = 10.0;

/// Whether rising values have roughly equal ratios, over a decade or more.
pub(crate) fn is_logarithmic(values: &[f64]) -> bool {
    let [low, _, .., high] = values else { return false };
    let steps = || values.windows(2).map(|pair| (pair[1] / pair[0]).ln());
    let (least, most) = steps().fold((f64::INFINITY, 0.0f64), |(a, b), step| (a.min(step), b.max(step)));
    // 2, 4, 10, 50 has steps of 2 to 5.
    *low > 0.0 && high / low >= LOGARITHMIC && most <= 2.5 * least
}

/// Multiples of powers of ten at which ticks may be, from few to many.
const MULTIPLES: [&[f64]; 4] = [
    &[1.0],
    &[1.0, 2.0, 5.0],
    &[1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 9.0],
    &[1.0, 1.5, 2.0, 2.5, 3.0, 3.5, 4.0, 4.5, 5.0, 5.5, 6.0, 6.5, 7.0, 7.5, 8.0, 8.5, 9.0, 9.5],
];

/// Ticks of a logarithmic axis: as many as fit, or some of the powers of ten.
pub(super) fn log_ticks(low: f64, high: f64) -> Vec<f64> {
    let decades = low.log10().floor() as i32..=high.log10().ceil() as i32;
    let every = decades.clone().count().div_ceil(ACROSS);
    let ticks = |multiples: &[f64], every: usize| -> Vec<f64> {
        // Parsed from decimal text, because products are not exact.
        let tick = |multiple: &f64, decade: i32| format!("{multiple}e{decade}").parse().unwrap_or(f64::NAN);
        let of_decade = |decade: i32| multiples.iter().map(move |multiple| tick(multiple, decade));
        decades
            .clone()
            .step_by(every)
            .flat_map(of_decade)
            .filter(|tick| (low..=high).contains(tick))
            .collect()
    };
    let all = MULTIPLES.iter().rev().map(|multiples| ticks(multiples, 1));
    all.into_iter().find(|ticks| ticks.len() <= ACROSS).unwrap_or_else(|| ticks(MULTIPLES[0], every))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_logarithmic_axis_has_ticks_at_1_2_and_5() {
        assert_eq!(log_ticks(0.13, 1.4), [0.2, 0.5, 1.0]);
        assert_eq!(log_ticks(1.5, 65.0), [2.0, 5.0, 10.0, 20.0, 50.0]);
        assert_eq!(log_ticks(0.5, 2e3), [1.0, 10.0, 100.0, 1000.0]);
        assert_eq!(log_ticks(1e-12, 1.0).len(), 7);
        // Values that vary little.
        assert_eq!(log_ticks(0.231, 0.455), [0.25, 0.3, 0.35, 0.4, 0.45]);
        assert_eq!(log_ticks(2.7, 3.8), [3.0, 3.5]);
        // The largest set that fits.
        assert!(log_ticks(1.0, 999.0).len() <= ACROSS);
    }

    #[test]
    fn an_axis_of_equal_ratios_is_logarithmic() {
        for (values, expected) in [
            (&[4.0, 16.0, 64.0, 256.0][..], true),
            (&[1.0, 2.0, 5.0, 10.0, 20.0, 50.0], true),
            (&[2.0, 4.0, 10.0, 50.0], true),
            (&[1.0, 2.0, 4.0], false),
            (&[0.0, 20.0, 100.0, 400.0], false),
            (&[-1.0, 10.0, 100.0], false),
            (&[1.0, 20.0, 40.0, 60.0], false),
            (&[1.0, 100.0], false),
            (&[], false),
        ] {
            assert_eq!(is_logarithmic(values), expected, "{values:?}");
        }
    }
}
