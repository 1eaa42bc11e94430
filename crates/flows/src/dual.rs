//! Exact derivatives of formulas by forward-mode automatic differentiation.
//!
//! A field written once for any [`Real`] gives its velocity with f64 and its gradient with [`Dual`], a dual
//! number with three partial derivatives (Griewank & Walther, Evaluating Derivatives, chapter 3). There is no
//! second formula to maintain, and no truncation error.

use glam::{DMat3, DVec3};
use std::ops::{Add, Div, Mul, Neg, Sub};

/// The arithmetic that formulas use, for plain and for dual numbers.
pub(crate) trait Real:
    Copy
    + Add<Output = Self>
    + Sub<Output = Self>
    + Mul<Output = Self>
    + Div<Output = Self>
    + Neg<Output = Self>
    + Add<f64, Output = Self>
    + Sub<f64, Output = Self>
    + Mul<f64, Output = Self>
    + Div<f64, Output = Self>
{
    /// A constant: all its derivatives are zero.
    fn constant(value: f64) -> Self;

    /// The number without its derivatives.
    fn value(self) -> f64;

    /// A function of this number, with its derivative.
    fn map(self, function: impl Fn(f64) -> f64, derivative: impl Fn(f64) -> f64) -> Self;

    fn sin(self) -> Self {
        self.map(libm::sin, libm::cos)
    }

    fn cos(self) -> Self {
        self.map(libm::cos, |x| -libm::sin(x))
    }

    fn sinh(self) -> Self {
        self.map(libm::sinh, libm::cosh)
    }

    fn cosh(self) -> Self {
        self.map(libm::cosh, libm::sinh)
    }

    fn sqrt(self) -> Self {
        self.map(libm::sqrt, |x| 0.5 / libm::sqrt(x))
    }

    fn ln(self) -> Self {
        self.map(libm::log, |x| 1.0 / x)
    }

    fn squared(self) -> Self {
        self * self
    }
}

impl Real for f64 {
    fn constant(value: f64) -> Self {
        value
    }

    fn value(self) -> f64 {
        self
    }

    fn map(self, function: impl Fn(f64) -> f64, _derivative: impl Fn(f64) -> f64) -> Self {
        function(self)
    }
}

/// A dual number: a value and its partial derivatives with respect to x, y and z.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Dual {
    value: f64,
    gradient: DVec3,
}

impl Real for Dual {
    fn constant(value: f64) -> Self {
        Dual { value, gradient: DVec3::ZERO }
    }

    fn value(self) -> f64 {
        self.value
    }

    fn map(self, function: impl Fn(f64) -> f64, derivative: impl Fn(f64) -> f64) -> Self {
        Dual { value: function(self.value), gradient: self.gradient * derivative(self.value) }
    }
}

impl Add for Dual {
    type Output = Self;
    fn add(self, other: Self) -> Self {
        Dual { value: self.value + other.value, gradient: self.gradient + other.gradient }
    }
}

impl Sub for Dual {
    type Output = Self;
    fn sub(self, other: Self) -> Self {
        Dual { value: self.value - other.value, gradient: self.gradient - other.gradient }
    }
}

impl Mul for Dual {
    type Output = Self;
    fn mul(self, other: Self) -> Self {
        Dual {
            value: self.value * other.value,
            gradient: self.gradient * other.value + other.gradient * self.value,
        }
    }
}

impl Div for Dual {
    type Output = Self;
    fn div(self, other: Self) -> Self {
        let value = self.value / other.value;
        Dual { value, gradient: (self.gradient - other.gradient * value) / other.value }
    }
}

impl Neg for Dual {
    type Output = Self;
    fn neg(self) -> Self {
        Dual { value: -self.value, gradient: -self.gradient }
    }
}

impl Add<f64> for Dual {
    type Output = Self;
    fn add(self, other: f64) -> Self {
        Dual { value: self.value + other, ..self }
    }
}

impl Sub<f64> for Dual {
    type Output = Self;
    fn sub(self, other: f64) -> Self {
        Dual { value: self.value - other, ..self }
    }
}

impl Mul<f64> for Dual {
    type Output = Self;
    fn mul(self, other: f64) -> Self {
        Dual { value: self.value * other, gradient: self.gradient * other }
    }
}

impl Div<f64> for Dual {
    type Output = Self;
    fn div(self, other: f64) -> Self {
        Dual { value: self.value / other, gradient: self.gradient / other }
    }
}

/// A velocity field written as a formula that is generic over the number type.
pub(crate) trait Formula {
    /// The velocity at a point (um) and time (s), um/s.
    fn formula<S: Real>(&self, x: [S; 3], t: f64) -> [S; 3];

    /// [`crate::VelocityField::velocity`].
    fn value(&self, x: DVec3, t: f64) -> DVec3 {
        DVec3::from_array(self.formula(x.to_array(), t))
    }

    /// [`crate::VelocityField::gradient`].
    fn jacobian(&self, x: DVec3, t: f64) -> DMat3 {
        let seeds = std::array::from_fn(|i| Dual { value: x[i], gradient: DVec3::AXES[i] });
        let [u, v, w] = self.formula(seeds, t).map(|component| component.gradient);
        // Each of the three is a row of the gradient.
        DMat3::from_cols(u, v, w).transpose()
    }
}

/// Implements `velocity` and `gradient` of a [`crate::VelocityField`] by its [`Formula`].
macro_rules! by_formula {
    () => {
        fn velocity(&self, x: glam::DVec3, t: f64) -> glam::DVec3 {
            self.value(x, t)
        }

        fn gradient(&self, x: glam::DVec3, t: f64) -> glam::DMat3 {
            self.jacobian(x, t)
        }
    };
}
pub(crate) use by_formula;

#[cfg(test)]
mod tests {
    use super::*;

    struct Mixed;

    impl Formula for Mixed {
        fn formula<S: Real>(&self, [x, y, z]: [S; 3], t: f64) -> [S; 3] {
            [x * y / z + t, (x.sin() * y.cos() - z.sqrt()) / 2.0, -(x.sinh() - y.cosh()) + z.ln().squared()]
        }
    }

    #[test]
    fn derivatives_are_those_of_calculus() {
        let (x, y, z) = (0.3, 0.7, 2.0);
        let gradient = Mixed.jacobian(DVec3::new(x, y, z), 1.0);
        let expected = DMat3::from_cols(
            DVec3::new(y / z, 0.5 * libm::cos(x) * libm::cos(y), -libm::cosh(x)),
            DVec3::new(x / z, -0.5 * libm::sin(x) * libm::sin(y), libm::sinh(y)),
            DVec3::new(-x * y / (z * z), -0.25 / libm::sqrt(z), 2.0 * libm::log(z) / z),
        );
        // Rounding errors of numbers near 1.
        assert!(gradient.abs_diff_eq(expected, 1e-15), "{gradient} {expected}");
        assert_eq!(Mixed.value(DVec3::new(x, y, z), 1.0).x, x * y / z + 1.0);
    }
}
