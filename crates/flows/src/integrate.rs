//! Trajectories dx/dt = u(x, t), by the field's closed form or by numerical integration.
//!
//! The integrator is DOPRI5(4), the fifth-order Runge-Kutta pair of Dormand and Prince (J. Comput. Appl.
//! Math. 6 (1980) 19) with local extrapolation and step control after Hairer, Norsett & Wanner, Solving
//! Ordinary Differential Equations I, sections II.4 and II.5. The error of a step is a length, and its
//! relative tolerance refers to the distance from the starting point, not to the coordinates: a trajectory
//! does not depend on the position of the origin or the orientation of the axes.

use crate::{Error, Result, VelocityField};
use glam::DVec3;

/// Error allowed per integration step, um: `absolute_um` + `relative` * distance from the starting point.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Tolerance {
    /// Error relative to the distance from the starting point, dimensionless.
    pub relative: f64,
    /// Absolute error, um.
    pub absolute_um: f64,
}

impl Default for Tolerance {
    /// 1e-10 and 1e-10 um: an error of about 5e-8 px over 100 frames of 20 px.
    fn default() -> Self {
        Tolerance { relative: 1e-10, absolute_um: 1e-10 }
    }
}

/// Maximum number of steps tried for one trajectory.
const MAX_STEPS: u32 = 1_000_000;
/// First step as a fraction of the time scale in which the velocity changes by its own magnitude.
const FIRST_STEP: f64 = 0.05;

/// Position (um) at `t1` (s, earlier or later) of the fluid element that is at `x` (um) at `t0` (s): by the
/// closed form if the field has one, otherwise by [`integrate`] with the default tolerance.
/// [`Error::Trajectory`] if the trajectory meets a velocity that is not finite, or its steps become too small
/// or too many.
pub fn advance<F: VelocityField + ?Sized>(field: &F, x: DVec3, t0: f64, t1: f64) -> Result<DVec3> {
    match field.flow_map(x, t0, t1) {
        Some(end) if end.is_finite() => Ok(end),
        Some(_) => Err(Error::Trajectory { at_um: x, t_s: t0, reason: "the end point is not finite" }),
        None => integrate(field, x, t0, t1, Tolerance::default()),
    }
}

/// Position (um) at `t1` (s) of the fluid element that is at `start` (um) at `t0` (s), always by DOPRI5(4),
/// even if the field has a closed form. Errors as for [`advance`].
pub fn integrate<F: VelocityField + ?Sized>(
    field: &F,
    start: DVec3,
    t0: f64,
    t1: f64,
    tolerance: Tolerance,
) -> Result<DVec3> {
    let stop = |at_um, t_s, reason| Err(Error::Trajectory { at_um, t_s, reason });
    let (mut x, mut t) = (start, t0);
    let mut u = field.velocity(x, t);
    if !u.is_finite() {
        return stop(x, t, "the velocity is not finite");
    }
    let mut h = first_step(field, x, t, t1 - t0, u);
    let mut growth = 5.0;
    for _ in 0..MAX_STEPS {
        if t == t1 {
            return Ok(x);
        }
        let limit = field.step_limit(x, t);
        if let Some(limit) = limit.filter(|limit| *limit > 0.0) {
            h = h.clamp(-limit, limit);
        }
        // Stretching the last step by up to 1 % avoids a tiny step after it.
        let last = (t1 - t).abs() <= 1.01 * h.abs();
        let h_now = if last { t1 - t } else { h };
        let t_next = if last { t1 } else { t + h_now };
        if t_next == t {
            return stop(x, t, "the integration steps become too small");
        }
        let mut step = Step::take(field, x, t, h_now, u);
        if limit.is_some() {
            step = step.halved(field, x, t, h_now, u);
        }
        let distance = (x - start).length().max((step.x - start).length());
        let error = step.error.length() / (tolerance.absolute_um + tolerance.relative * distance);
        if error <= 1.0 {
            (x, t, u) = (step.x, t_next, step.velocity);
            h = h_now * (0.9 * libm::pow(error, -0.2)).clamp(0.2, growth);
            growth = 5.0;
        } else {
            // A step with a non-finite result has a NaN error: try a much shorter one.
            let shrink = if error.is_finite() { 0.9 * libm::pow(error, -0.2) } else { 0.1 };
            h = h_now * shrink.clamp(0.1, 0.9);
            growth = 1.0;
        }
    }
    stop(x, t, "the integration needs more than 1000000 steps")
}

/// Lower bound of the first step as a fraction of the time span, needed where the velocity is momentarily
/// zero.
const LEAST_FIRST_STEP: f64 = 1e-4;

/// The first step (s): a fraction of the time scale on which the velocity changes along the path, estimated
/// over a thousandth of the time span.
fn first_step<F: VelocityField + ?Sized>(field: &F, x: DVec3, t: f64, span: f64, u: DVec3) -> f64 {
    let probe = 1e-3 * span;
    let change = (field.velocity(x + u * probe, t + probe) - u).length();
    let step = FIRST_STEP * u.length() / change * probe;
    if step.is_finite() {
        step.abs().clamp(LEAST_FIRST_STEP * span.abs(), span.abs()).copysign(span)
    } else {
        span
    }
}

/// One step of the Dormand-Prince pair.
struct Step {
    /// Position at the end of the step, fifth order, um.
    x: DVec3,
    /// Velocity at the end of the step, um/s: the last stage, which is also the first stage of the next step.
    velocity: DVec3,
    /// Difference between the fifth-order and the fourth-order solution, um.
    error: DVec3,
}

impl Step {
    fn take<F: VelocityField + ?Sized>(field: &F, x: DVec3, t: f64, h: f64, k1: DVec3) -> Step {
        let stage = |c: f64, sum: DVec3| field.velocity(x + sum * h, t + c * h);
        let k2 = stage(1.0 / 5.0, k1 * (1.0 / 5.0));
        let k3 = stage(3.0 / 10.0, k1 * (3.0 / 40.0) + k2 * (9.0 / 40.0));
        let k4 = stage(4.0 / 5.0, k1 * (44.0 / 45.0) - k2 * (56.0 / 15.0) + k3 * (32.0 / 9.0));
        let k5 = stage(
            8.0 / 9.0,
            k1 * (19372.0 / 6561.0) - k2 * (25360.0 / 2187.0) + k3 * (64448.0 / 6561.0)
                - k4 * (212.0 / 729.0),
        );
        let k6 = stage(
            1.0,
            k1 * (9017.0 / 3168.0) - k2 * (355.0 / 33.0) + k3 * (46732.0 / 5247.0) + k4 * (49.0 / 176.0)
                - k5 * (5103.0 / 18656.0),
        );
        let sum = k1 * (35.0 / 384.0) + k3 * (500.0 / 1113.0) + k4 * (125.0 / 192.0) - k5 * (2187.0 / 6784.0)
            + k6 * (11.0 / 84.0);
        let end = x + sum * h;
        let k7 = field.velocity(end, t + h);
        let error = k1 * (71.0 / 57600.0) - k3 * (71.0 / 16695.0) + k4 * (71.0 / 1920.0)
            - k5 * (17253.0 / 339_200.0)
            + k6 * (22.0 / 525.0)
            - k7 * (1.0 / 40.0);
        Step { x: end, velocity: k7, error: error * h }
    }

    /// The same step in two halves. Across a surface where the gradient jumps, the error estimate of a step
    /// can vanish although the error does not (for example when the surface is crossed at 83 % of the step);
    /// the error is therefore the larger of the estimate and the difference between the full step and the two
    /// half steps.
    fn halved<F: VelocityField + ?Sized>(self, field: &F, x: DVec3, t: f64, h: f64, k1: DVec3) -> Step {
        let first = Step::take(field, x, t, 0.5 * h, k1);
        let second = Step::take(field, first.x, t + 0.5 * h, 0.5 * h, first.velocity);
        let difference = second.x - self.x;
        let larger = difference.length_squared() > self.error.length_squared();
        Step { error: if larger { difference } else { self.error }, ..second }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::region::Region;
    use std::sync::atomic::{AtomicU32, Ordering};

    /// A field given by a function, with a step limit and a counter of its evaluations.
    #[derive(Debug)]
    struct Test {
        velocity: fn(DVec3, f64) -> DVec3,
        limit: Option<f64>,
        calls: AtomicU32,
    }

    impl Test {
        fn new(velocity: fn(DVec3, f64) -> DVec3) -> Self {
            Test { velocity, limit: None, calls: AtomicU32::new(0) }
        }
    }

    impl VelocityField for Test {
        fn velocity(&self, x: DVec3, t: f64) -> DVec3 {
            self.calls.fetch_add(1, Ordering::Relaxed);
            (self.velocity)(x, t)
        }
        fn max_speed(&self, _region: &Region, _t0: f64, _t1: f64) -> f64 {
            f64::INFINITY
        }
        fn step_limit(&self, _x: DVec3, _t: f64) -> Option<f64> {
            self.limit
        }
    }

    /// Circles with angular velocity cos t about (1000, 0): the angle turned is sin t.
    fn swing() -> Test {
        Test::new(|x, t| DVec3::new(-x.y, x.x - 1000.0, 0.0) * libm::cos(t))
    }

    fn swing_exact(t: f64) -> DVec3 {
        let (sin, cos) = libm::sincos(libm::sin(t));
        DVec3::new(1000.0 + 20.0 * cos, 20.0 * sin, 3.0)
    }

    #[test]
    fn the_step_is_of_fifth_order_and_its_estimate_of_fourth() {
        let field = swing();
        let one = |h: f64| {
            let (x, t) = (swing_exact(0.3), 0.3);
            let step = Step::take(&field, x, t, h, field.velocity(x, t));
            ((step.x - swing_exact(t + h)).length(), step.error.length())
        };
        let ((error, estimate), (error_half, estimate_half)) = (one(0.2), one(0.1));
        // Local errors of order 6 and 5: ratios 64 and 32, with corrections of order h.
        assert!((45.0..85.0).contains(&(error / error_half)), "{}", error / error_half);
        assert!((24.0..42.0).contains(&(estimate / estimate_half)), "{}", estimate / estimate_half);
    }

    #[test]
    fn the_error_follows_the_tolerance() {
        for (exponent, allowed) in [(1e-6, 1e-4), (1e-8, 1e-6), (1e-10, 1e-8)] {
            let tolerance = Tolerance { relative: exponent, absolute_um: exponent };
            let end = integrate(&swing(), swing_exact(0.0), 0.0, 5.0, tolerance).unwrap();
            let error = (end - swing_exact(5.0)).length();
            // Some tens of steps with errors of at most 40 um times the tolerance, which partly cancel.
            assert!(error < allowed, "{exponent:e}: {error:e}");
            let back = integrate(&swing(), end, 5.0, 0.0, tolerance).unwrap();
            assert!((back - swing_exact(0.0)).length() < 2.0 * allowed);
        }
    }

    #[test]
    fn the_limit_on_the_step_is_kept() {
        let limited = Test { limit: Some(0.01), ..Test::new(|_, _| DVec3::X) };
        let end = integrate(&limited, DVec3::ZERO, 0.0, 1.0, Tolerance::default()).unwrap();
        assert!((end.x - 1.0).abs() < 1e-14);
        // 100 steps of 6 evaluations each and 12 for the half steps; without the limit one step would cover
        // the whole span.
        assert!(limited.calls.load(Ordering::Relaxed) > 1700);
        let free = Test::new(|_, _| DVec3::X);
        integrate(&free, DVec3::ZERO, 0.0, 1.0, Tolerance::default()).unwrap();
        assert!(free.calls.load(Ordering::Relaxed) < 20);
    }

    #[test]
    fn a_kink_costs_steps_but_no_accuracy() {
        // v = max(x, 0) on a path x = t - 1: y = (t - 1)^2 / 2 from t = 1 on.
        let kink = Test::new(|x, _| DVec3::new(1.0, x.x.max(0.0), 0.0));
        let end = integrate(&kink, DVec3::new(-1.0, 0.0, 0.0), 0.0, 3.0, Tolerance::default()).unwrap();
        // The error of the step across the kink is controlled to 4e-10 um; the paths on both sides are
        // polynomials.
        assert!((end.y - 2.0).abs() < 1e-8, "{end}");
    }

    #[test]
    fn a_flow_that_turns_round_is_followed() {
        // The velocity is zero at the start, up to rounding; x = sin t - 1.
        let pendulum = Test::new(|_, t| DVec3::X * libm::cos(t));
        let start = std::f64::consts::FRAC_PI_2;
        let end = integrate(&pendulum, DVec3::ZERO, start, start + 3.0, Tolerance::default()).unwrap();
        assert!((end.x - (libm::sin(start + 3.0) - 1.0)).abs() < 1e-9, "{end}");
    }

    #[test]
    fn no_time_is_no_way() {
        let x = DVec3::new(1.0, 2.0, 3.0);
        assert_eq!(integrate(&swing(), x, 0.7, 0.7, Tolerance::default()).unwrap(), x);
    }

    #[test]
    fn singular_fields_end_in_an_error() {
        let poles: [fn(DVec3, f64) -> DVec3; 3] = [
            |_, _| DVec3::splat(f64::NAN),
            |_, t| DVec3::X / (0.5 - t),         // not integrable at t = 0.5
            |x, _| DVec3::X * (1.0 + x.x * x.x), // at infinity at t = pi/2
        ];
        for pole in poles {
            let end = advance(&Test::new(pole), DVec3::ZERO, 0.0, 2.0);
            assert!(matches!(end, Err(Error::Trajectory { .. })), "{end:?}");
        }
    }
}
