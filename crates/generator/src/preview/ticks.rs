//! Tick labels of the plots of previews, fields and reports.

use std::ops::Range;

/// A tick closer to 0 than this fraction of its axis is at 0.
const ROUNDING: f64 = 1e-9;

/// Label of a tick of an axis over `range` (in either direction): no trailing zeros and no rounding errors.
pub fn tick_label(value: f64, range: &Range<f64>) -> String {
    let (low, high) = (range.start.min(range.end), range.start.max(range.end));
    // A tick is a sum of steps, which misses 0 by rounding errors; a logarithmic axis has no 0.
    if low <= 0.0 && high >= 0.0 && value.abs() <= ROUNDING * (high - low) {
        return "0".to_owned();
    }
    if (1e-4..1e6).contains(&value.abs()) {
        return shortened(&format!("{value:.6}")).to_owned();
    }
    let text = format!("{value:.3e}");
    match text.split_once('e') {
        Some((digits, exponent)) => format!("{}e{exponent}", shortened(digits)),
        None => text,
    }
}

/// Decimals without trailing zeros.
fn shortened(decimals: &str) -> &str {
    decimals.trim_end_matches('0').trim_end_matches('.')
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ticks_have_neither_rounding_errors_nor_superfluous_zeros() {
        for (value, range, expected) in [
            (-5.551_115_123_125_783e-17, -0.25..0.25, "0"),
            (-5.551_115_123_125_783e-17, 0.25..-0.25, "0"),
            (-0.0, 0.0..1.0, "0"),
            (10_000.0, 10.0..60_000.0, "10000"),
            (-15.0, -15.0..15.0, "-15"),
            (0.1 + 0.2, 0.0..1.0, "0.3"),
            (1.5e-5, -2e-5..2e-5, "1.5e-5"),
            (6.000_000_000_000_001e-6, 0.0..1e-5, "6e-6"),
            (-2.5e6, -3e6..3e6, "-2.5e6"),
            // A logarithmic axis of many decades.
            (1e-11, 1e-12..1e3, "1e-11"),
        ] {
            assert_eq!(tick_label(value, &range), expected, "{value:e} of {range:?}");
        }
    }
}
