//! Rejection of windows that the model does not describe, for example because another particle passes.

use super::state::Misfit;

/// A window is rejected if its chi2 per pixel exceeds the median over all windows, or 1 if that is greater,
/// by this factor.
const FACTOR: f64 = 1.5;

/// If the fraction of windows that are described worse than that exceeds this limit, the model is to blame,
/// not the windows, and no window is rejected: without them the fit would drift away from the data.
const MAX_FRACTION: f64 = 0.2;

/// Whether the number of bad windows shows that the model is to blame.
pub(super) fn are_too_many(bad: usize, windows: usize) -> bool {
    bad as f64 > MAX_FRACTION * windows as f64
}

/// Particle and plane of the windows that the model does not describe.
pub(super) fn outliers(misfits: &[(usize, usize, Misfit)]) -> Vec<(usize, usize)> {
    let per_pixel = |m: &Misfit| m.chi2 / (m.pixels.max(1) as f64);
    let mut all: Vec<f64> = misfits.iter().map(|(_, _, m)| per_pixel(m)).collect();
    all.sort_by(f64::total_cmp);
    let Some(&median) = all.get(all.len() / 2) else { return Vec::new() };
    // Where rounding hides the noise of dark windows, the median is far below 1, although windows that show
    // the particle are no worse than the noise allows.
    let is_bad = |m: &Misfit| per_pixel(m) > FACTOR * median.max(1.0);
    misfits.iter().filter(|(.., m)| is_bad(m)).map(|(k, i, _)| (*k, *i)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_window_with_a_neighbor_is_rejected() {
        let misfit = |chi2: f64| Misfit { pixels: 100, chi2: 100.0 * chi2, ..Misfit::default() };
        let mut all: Vec<(usize, usize, Misfit)> =
            (0..20).map(|i| (0, i, misfit(1.0 + 0.01 * i as f64))).collect();
        all[7].2 = misfit(1.9);
        assert_eq!(outliers(&all), [(0, 7)]);
        // Dark windows whose noise is lost by rounding are no reference for windows with a particle.
        all.iter_mut().skip(8).for_each(|window| window.2.chi2 *= 0.2);
        assert_eq!(outliers(&all), [(0, 7)]);
    }

    #[test]
    fn a_fifth_of_the_windows_may_be_bad() {
        assert!(!are_too_many(0, 20));
        assert!(!are_too_many(4, 20));
        assert!(are_too_many(5, 20));
        // With few windows, none may be rejected.
        assert!(are_too_many(1, 4));
    }
}
