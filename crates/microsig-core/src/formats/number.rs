//! Formatting of numbers as text.

use std::fmt::Write;

/// Appends a number in the fewest digits that read back to the same value, without an exponent.
///
/// The result equals [`std::fmt::Display`]'s, several times faster for numbers of common magnitude, except
/// when a value is exactly halfway between two candidates of the same length (15 digits or more): then the
/// last digit is even, as in JSON.
pub fn push(text: &mut String, value: f64) {
    let whole = value as i32;
    if f64::from(whole).to_bits() == value.to_bits() {
        text.push_str(itoa::Buffer::new().format(whole));
    } else if (1e-5..1e16).contains(&value.abs()) {
        let mut buffer = zmij::Buffer::new();
        let digits = buffer.format_finite(value);
        text.push_str(digits.strip_suffix(".0").unwrap_or(digits));
    } else {
        // Writing to a string cannot fail.
        let _ = write!(text, "{value}");
    }
}

/// Appends an integer.
pub fn push_whole(text: &mut String, value: u64) {
    text.push_str(itoa::Buffer::new().format(value));
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn pushed(value: f64) -> String {
        let mut text = String::new();
        push(&mut text, value);
        text
    }

    #[test]
    fn special_numbers_are_written_as_ever() {
        let (huge, tiny) =
            ([1e15, 1e16, 1e17, 1.5e300, f64::MAX], [1e-4, 1e-5, 1e-6, 5e-324, f64::MIN_POSITIVE]);
        let others = [0.0, -0.0, 1.0, -3.0, 0.1, 0.3, 123.25, f64::NAN, f64::INFINITY, f64::NEG_INFINITY];
        for value in huge.into_iter().chain(tiny).chain(others) {
            assert_eq!(pushed(value), value.to_string());
        }
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(20_000))]

        #[test]
        fn numbers_of_common_size_are_written_as_ever(near in -1e4..1e4f64, whole in -1_000_000..1_000_000i32) {
            for value in [near, f64::from(whole), f64::from(whole) / 1024.0] {
                prop_assert_eq!(pushed(value), value.to_string());
            }
        }

        #[test]
        fn any_number_reads_back_and_is_as_short_as_can_be(bits: u64) {
            let value = f64::from_bits(bits);
            let text = pushed(value);
            prop_assert_eq!(text.len(), value.to_string().len());
            if !value.is_nan() {
                prop_assert_eq!(text.parse(), Ok(value));
            }
        }
    }
}
