//! Which axes are logarithmic, and their ticks.

/// Maximum number of labels of a horizontal axis.
pub(super) const ACROSS: usize = 7;

/// The least ratio of the largest to the smallest value of a logarithmic axis.
const LOGARITHMIC: f64 = 10.0;

/// Whether rising values have roughly equal ratios, over a decade or more.
pub(crate) fn is_logarithmic(values: &[f64]) -> bool {
    let [low, _, .., high] = values else { return false };
    let steps = || values.windows(2).map(|pair| (pair[1] / pair[0]).ln());
    let (least, most) = steps().fold((f64::INFINITY, 0.0f64), |(a, b), step| (a.min(step), b.max(step)));
    // 2, 4, 10, 50 has steps of 2 to 5.
    *low > 0.0 && high / low >= LOGARITHMIC && most <= 2.5 * least
}

/// Ticks of a logarithmic axis: 1, 2, 5 of each decade, or powers of ten if there are many.
pub(super) fn log_ticks(low: f64, high: f64) -> Vec<f64> {
    let decades = low.log10().floor() as i32..=high.log10().ceil() as i32;
    let every = decades.clone().count().div_ceil(ACROSS);
    let steps: &[f64] = if high / low < 1e3 { &[1.0, 2.0, 5.0] } else { &[1.0] };
    let of_decade = |decade: i32| steps.iter().map(move |step| step * 10f64.powi(decade));
    decades.step_by(every).flat_map(of_decade).filter(|tick| (low..=high).contains(tick)).collect()
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
