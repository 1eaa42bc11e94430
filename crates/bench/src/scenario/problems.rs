//! All that is wrong with a scenario, gathered before anything is said.

use crate::error::{Error, Result};

/// The problems found so far; a value is checked and passed on.
pub(super) struct Problems(pub(super) Vec<String>);

impl Problems {
    pub(super) fn any(&self) -> bool {
        !self.0.is_empty()
    }

    pub(super) fn new() -> Self {
        Problems(Vec::new())
    }

    /// All of them as an error, if there are any.
    pub(super) fn finish(self) -> Result<()> {
        if self.0.is_empty() { Ok(()) } else { Err(Error::Input(self.0)) }
    }

    pub(super) fn add(&mut self, path: &str, value: impl std::fmt::Display, allowed: &str) {
        self.0.push(format!("{path} = {value}: expected {allowed}"));
    }

    pub(super) fn range(&mut self, path: &str, value: f64, low: f64, high: f64, allowed: &str) -> f64 {
        if !(value.is_finite() && value >= low && value <= high) {
            self.add(path, value, allowed);
        }
        value
    }

    /// The value, or `None` with its problem noted.
    pub(super) fn of<T>(
        &mut self,
        path: &str,
        result: std::result::Result<T, impl std::fmt::Display>,
    ) -> Option<T> {
        result.map_err(|e| self.0.extend(e.to_string().lines().map(|line| format!("{path}: {line}")))).ok()
    }
}
