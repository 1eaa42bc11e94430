//! Ranges of numbers that libraries take as options.

use std::fmt;

use crate::advice;
use crate::advice::{Advice, option};

/// The allowed values of an option.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct NumberRange {
    /// Key of the option.
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

    /// What is wrong with a value, if it is not allowed.
    pub fn fault(&self, value: f64) -> Option<Advice> {
        (!self.allows(value))
            .then(|| advice!(option(self.key).of(shown(value)), format!(": expected {self}")))
    }
}

/// Faults of the given values.
pub fn faults(values: &[(Option<f64>, NumberRange)]) -> Vec<Advice> {
    values.iter().filter_map(|(value, range)| range.fault((*value)?)).collect()
}

/// A number as a person writes it: `1e9`, not `1000000000`.
fn shown(value: f64) -> String {
    let is_plain = value == 0.0 || !value.is_finite() || (1e-4..1e6).contains(&value.abs());
    if is_plain { value.to_string() } else { format!("{value:e}") }
}

impl fmt::Display for NumberRange {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} to {}", shown(self.least), shown(self.most))?;
        if self.unit.is_empty() { Ok(()) } else { write!(f, " {}", self.unit) }
    }
}
