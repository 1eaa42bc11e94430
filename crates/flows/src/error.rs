//! The errors of this crate, and checks of parameters.

use glam::DVec3;
use microsig_core::Interval;
use microsig_core::problem::Problem;
use std::fmt;
use std::ops::Bound;

/// An error of a flow, its seeding or its trajectories.
///
/// A field without closed-form trajectories is not an error: its flow map is `None`, and trajectories are
/// integrated.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum Error {
    /// A parameter outside its range, within the field or the part of the scene that it belongs to.
    #[error("{0}")]
    Parameter(Problem),
    /// Malformed input data.
    #[error("{format}{}: {problem}", .line.map(|line| format!(", line {line}")).unwrap_or_default())]
    Data {
        /// The format that was read.
        format: &'static str,
        /// Line number from 1, if the format has lines.
        line: Option<usize>,
        /// What was found and expected.
        problem: Box<Problem>,
    },
    /// Parts that are valid by themselves but cannot be combined.
    #[error("{0}")]
    Misuse(String),
    /// A listed particle at a position where no particle can be.
    #[error("particle {} of the list at ({}, {}, {}) um: expected {allowed}", .index + 1, .at_um.x, .at_um.y, .at_um.z)]
    Place {
        /// Its position in the list, from 0.
        index: usize,
        /// The position, um.
        at_um: DVec3,
        /// The allowed positions.
        allowed: &'static str,
    },
    /// A trajectory that cannot be integrated to its end: the velocity is not finite, or the steps become too
    /// small or too many.
    #[error("trajectory at ({}, {}, {}) um, t = {t_s} s: {reason}", .at_um.x, .at_um.y, .at_um.z)]
    Trajectory {
        /// Where it stopped, um.
        at_um: DVec3,
        /// When it stopped, s.
        t_s: f64,
        /// The reason.
        reason: &'static str,
    },
}

/// Result with the error of this crate.
pub type Result<T> = std::result::Result<T, Error>;

/// Checks of the parameters of one field or one part of the scene, which it names in its errors.
#[derive(Debug, Clone, Copy)]
pub(crate) struct ParameterCheck(pub(crate) &'static str);

impl ParameterCheck {
    /// The error for a parameter, for rules that the other checks do not cover.
    pub(crate) fn fault(&self, parameter: &str, value: impl fmt::Display, allowed: &str) -> Error {
        Error::Parameter(Problem::value(parameter, value, allowed).within(self.0))
    }

    pub(crate) fn number(&self, parameter: &'static str, value: f64, range: Interval) -> Result<f64> {
        if range.contains(value) {
            return Ok(value);
        }
        let allowed = match (range.low, range.high) {
            (Bound::Unbounded, Bound::Unbounded) => "a finite number".to_owned(),
            (_, Bound::Unbounded) => format!("a finite number {range}"),
            _ => format!("a number from {range}"),
        };
        Err(self.fault(parameter, value, &allowed))
    }

    pub(crate) fn finite(&self, parameter: &'static str, value: f64) -> Result<f64> {
        self.number(parameter, value, Interval::FINITE)
    }

    pub(crate) fn positive(&self, parameter: &'static str, value: f64) -> Result<f64> {
        self.number(parameter, value, Interval::above(0.0))
    }

    pub(crate) fn not_negative(&self, parameter: &'static str, value: f64) -> Result<f64> {
        self.number(parameter, value, Interval::at_least(0.0))
    }

    /// Passes two finite numbers in increasing order.
    pub(crate) fn increasing(&self, parameter: &'static str, values: [f64; 2]) -> Result<[f64; 2]> {
        let fits = values.iter().all(|value| value.is_finite()) && values[0] < values[1];
        if fits {
            Ok(values)
        } else {
            Err(self.fault(parameter, format!("{values:?}"), "two finite numbers, the lower first"))
        }
    }

    /// The unit vector along a vector of finite numbers other than zero.
    pub(crate) fn direction(&self, parameter: &'static str, value: DVec3) -> Result<DVec3> {
        let unit = self.finite_vector(parameter, value)?.try_normalize();
        unit.ok_or_else(|| self.fault(parameter, value, "a vector other than zero"))
    }

    pub(crate) fn finite_vector(&self, parameter: &'static str, value: DVec3) -> Result<DVec3> {
        if value.is_finite() { Ok(value) } else { Err(self.fault(parameter, value, "three finite numbers")) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_fault_names_owner_parameter_value_and_range() {
        let fault = ParameterCheck("lamb_oseen").positive("core_radius_um", -3.5).unwrap_err();
        let huge = ParameterCheck("f").positive("p", -1e308).unwrap_err().to_string();
        assert_eq!(huge, "f: p = -1e308: expected a finite number > 0");
        assert_eq!(fault.to_string(), "lamb_oseen: core_radius_um = -3.5: expected a finite number > 0");
        for value in [0.0, f64::NAN, f64::INFINITY] {
            assert!(ParameterCheck("f").positive("p", value).is_err());
        }
        assert!(ParameterCheck("f").not_negative("p", 0.0).is_ok());
        assert!(ParameterCheck("f").not_negative("p", -1e-300).is_err());
        assert!(ParameterCheck("f").finite("p", f64::NEG_INFINITY).is_err());
        assert!(ParameterCheck("f").finite_vector("p", DVec3::new(0.0, f64::NAN, 0.0)).is_err());
    }
}
