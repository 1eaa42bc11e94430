//! Ranges of numbers that libraries take as options.

use std::fmt;

use microsig_core::{Interval, short};

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
        self.interval().contains(value)
    }

    fn interval(&self) -> Interval {
        Interval::at_least(self.least).up_to(self.most)
    }

    /// What is wrong with a value, if it is not allowed.
    pub fn fault(&self, value: f64) -> Option<Advice> {
        (!self.allows(value))
            .then(|| advice!(option(self.key).of(short(value)), format!(": expected {self}")))
    }
}

/// Faults of the given values.
pub fn faults(values: &[(Option<f64>, NumberRange)]) -> Vec<Advice> {
    values.iter().filter_map(|(value, range)| range.fault((*value)?)).collect()
}

impl fmt::Display for NumberRange {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.interval().fmt(f)?;
        if self.unit.is_empty() { Ok(()) } else { write!(f, " {}", self.unit) }
    }
}
