//! Ranges of numbers that libraries take as options.

use std::fmt;

/// The allowed values of an option. The command and the Python package check it before they call, each in its own words.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct NumberRange {
    /// Name of the option.
    pub key: &'static str,
    /// Smallest allowed value.
    pub least: f64,
    /// Largest allowed value.
    pub most: f64,
    /// Unit, empty for ratios.
    pub unit: &'static str,
}

impl NumberRange {
    /// Whether a value is allowed; NaN is not.
    pub fn allows(&self, value: f64) -> bool {
        (self.least..=self.most).contains(&value)
    }
}

impl fmt::Display for NumberRange {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} to {}", self.least, self.most)?;
        if self.unit.is_empty() { Ok(()) } else { write!(f, " {}", self.unit) }
    }
}
