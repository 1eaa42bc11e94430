//! Collects the problems of a text, so that all are reported at once.

use std::fmt;

use storage::error::{Error, MOST_COLLECTED, Result};
use storage::problem::Problem;

/// The problems found so far, and a test for the keys of the language.
#[derive(Debug, Default)]
pub(crate) struct Problems(pub Vec<Problem>, Option<fn(&str) -> bool>);

impl Problems {
    /// No problems yet; `is_key` returns whether a path is a key of the language.
    pub(crate) fn among(is_key: fn(&str) -> bool) -> Self {
        Problems(Vec::new(), Some(is_key))
    }

    pub(crate) fn any(&self) -> bool {
        !self.0.is_empty()
    }

    /// All problems as an error, if there are any.
    pub(crate) fn finish(self) -> Result<()> {
        if self.0.is_empty() { Ok(()) } else { Err(Error::Problems(self.sorted())) }
    }

    /// The problems of assignments, which may be the cause of others, then the problems of the file in its order.
    pub(crate) fn sorted(mut self) -> Vec<Problem> {
        let order = |p: &Problem| p.place.as_ref().map_or((true, 0), |p| (p.source.is_file, p.span.start));
        self.0.sort_by_key(order);
        self.0.dedup();
        self.0
    }

    /// Adds a problem; those beyond [`MOST_COLLECTED`] are dropped, which bounds the cost of a text with many
    /// problems.
    pub(crate) fn push(&mut self, problem: Problem) {
        if !self.is_full() {
            self.0.push(problem);
        }
    }

    /// Whether further problems are dropped.
    pub(crate) fn is_full(&self) -> bool {
        self.0.len() >= MOST_COLLECTED
    }

    /// Adds a value of the wrong type or out of range.
    pub(crate) fn value(&mut self, path: &str, found: impl fmt::Display, allowed: &str) {
        self.push(Problem::value(path, found, allowed));
    }

    pub(crate) fn other(&mut self, path: &str, message: impl Into<String>) {
        self.push(Problem::other(path, message));
    }

    /// The value of a result; an error is added as a problem at `path`, or at the key of the parameter that
    /// the error names if there is such a key below `path`.
    pub(crate) fn of<T, E: Into<Error>>(
        &mut self,
        path: &str,
        result: std::result::Result<T, E>,
    ) -> Option<T> {
        match result.map_err(Into::into) {
            Ok(value) => return Some(value),
            Err(Error::Flow(flows::Error::Parameter { parameter, value, allowed, .. }))
                if self.1.is_some_and(|is_key| is_key(&format!("{path}.{parameter}"))) =>
            {
                self.value(&format!("{path}.{parameter}"), value, &allowed);
            }
            Err(Error::Problems(problems)) => self.0.extend(problems),
            Err(error) => {
                self.0.extend(error.problems().into_iter().map(|problem| Problem::other(path, problem)));
            }
        }
        None
    }
}
