//! A field in a moving frame, or modulated in time.

use super::{Field, Inner, Transform};
use crate::fields::prelude::*;

params! {
    /// Parameters of a field in a moving frame.
    MovingParams("moving") {
        /// Velocity of the moving frame, um/s.
        velocity_um_s: [f64; 3] = [0.0, 0.0, 0.0], [finite];
    }
}

params! {
    /// Parameters of a field multiplied by a function of time.
    ModulatedParams("modulated") {
        /// Mean m of the modulation factor.
        mean: f64 = 1.0, [finite];
        /// Amplitude a of the modulation factor.
        amplitude: f64 = 0.0, [finite];
        /// Frequency f of the modulation, Hz.
        frequency_hz: f64 = 10.0, [>= 0];
        /// Phase p of the cosine, rad.
        phase_rad: f64 = 0.0, [finite];
    }
}

#[derive(Debug)]
struct Moving {
    inner: Inner,
    velocity: DVec3,
}

impl Transform for MovingParams {
    fn apply(&self, inner: Field) -> Result<Field> {
        let velocity = DVec3::from_array(self.checked()?.velocity_um_s);
        Ok(Box::new(Moving { inner: inner.into(), velocity }))
    }
}

impl Moving {
    fn inward(&self, x: DVec3, t: f64) -> DVec3 {
        x - self.velocity * t
    }
}

impl VelocityField for Moving {
    like_inner!(Moving, same_walls);

    fn velocity(&self, x: DVec3, t: f64) -> DVec3 {
        self.velocity + self.inner.velocity(self.inward(x, t), t)
    }

    fn gradient(&self, x: DVec3, t: f64) -> DMat3 {
        self.inner.gradient(self.inward(x, t), t)
    }

    fn flow_map(&self, x: DVec3, t0: f64, t1: f64) -> Option<DVec3> {
        Some(self.inner.flow_map(self.inward(x, t0), t0, t1)? + self.velocity * t1)
    }

    fn invariant(&self, x: DVec3, t: f64) -> Option<f64> {
        self.inner.invariant(self.inward(x, t), t)
    }

    fn is_steady(&self) -> bool {
        self.velocity == DVec3::ZERO && self.inner.is_steady()
    }

    fn max_speed(&self, region: &Region, t0: f64, t1: f64) -> f64 {
        // The box in the frame of the inner field, swept over the interval.
        let swept = region.mapped(|x| self.inward(x, t0)).joined(&region.mapped(|x| self.inward(x, t1)));
        let inner = self.inner.max_speed(&swept.grown(1e-9), t0, t1);
        (self.velocity.length() + inner) * ROUNDING_MARGIN
    }

    fn step_limit(&self, x: DVec3, t: f64) -> Option<f64> {
        self.inner.step_limit(self.inward(x, t), t)
    }

    fn wall(&self, x: DVec3, t: f64) -> Option<Wall> {
        self.inner.wall(self.inward(x, t), t)
    }

    fn confine(&self, x: DVec3, t: f64, radius: f64) -> DVec3 {
        let inward = self.inward(x, t);
        x + (self.inner.confine(inward, t, radius) - inward)
    }
}

#[derive(Debug)]
struct Modulated {
    inner: Inner,
    mean: f64,
    amplitude: f64,
    omega: f64,
    phase: f64,
}

impl Transform for ModulatedParams {
    fn apply(&self, inner: Field) -> Result<Field> {
        let ModulatedParams { mean, amplitude, frequency_hz, phase_rad: phase } = self.checked()?;
        let omega = 2.0 * PI * frequency_hz;
        Ok(Box::new(Modulated { inner: inner.into(), mean, amplitude, omega, phase }))
    }
}

impl Modulated {
    fn factor(&self, t: f64) -> f64 {
        self.mean + self.amplitude * libm::cos(self.omega * t + self.phase)
    }

    /// The integral of the factor from `t0` to `t1`, s.
    fn stretched(&self, t0: f64, t1: f64) -> f64 {
        let half = 0.5 * self.omega * (t1 - t0);
        // sin(h) / h; 1 for h = 0.
        let share = if half == 0.0 { 1.0 } else { libm::sin(half) / half };
        let middle = libm::cos(self.omega * 0.5 * (t0 + t1) + self.phase);
        (self.mean + self.amplitude * middle * share) * (t1 - t0)
    }
}

impl VelocityField for Modulated {
    like_inner!(Modulated, same_walls);

    fn velocity(&self, x: DVec3, t: f64) -> DVec3 {
        self.inner.velocity(x, t) * self.factor(t)
    }

    fn gradient(&self, x: DVec3, t: f64) -> DMat3 {
        self.inner.gradient(x, t) * self.factor(t)
    }

    fn flow_map(&self, x: DVec3, t0: f64, t1: f64) -> Option<DVec3> {
        if self.inner.is_steady() { self.inner.flow_map(x, 0.0, self.stretched(t0, t1)) } else { None }
    }

    fn invariant(&self, x: DVec3, t: f64) -> Option<f64> {
        if self.inner.is_steady() { self.inner.invariant(x, t) } else { None }
    }

    fn is_steady(&self) -> bool {
        (self.amplitude == 0.0 || self.omega == 0.0) && self.inner.is_steady()
    }

    fn max_speed(&self, region: &Region, t0: f64, t1: f64) -> f64 {
        let strongest = self.mean.abs() + self.amplitude.abs();
        if strongest == 0.0 {
            0.0
        } else {
            self.inner.max_speed(region, t0, t1) * strongest * ROUNDING_MARGIN
        }
    }

    fn step_limit(&self, x: DVec3, t: f64) -> Option<f64> {
        Some(self.inner.step_limit(x, t)? / (self.mean.abs() + self.amplitude.abs()))
    }

    fn wall(&self, x: DVec3, t: f64) -> Option<Wall> {
        self.inner.wall(x, t)
    }

    fn confine(&self, x: DVec3, t: f64, radius: f64) -> DVec3 {
        self.inner.confine(x, t, radius)
    }
}
