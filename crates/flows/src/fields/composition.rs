//! Fields made of fields: sum, scale, translate, rotate, moving frame, modulation in time, mirror.
//!
//! With f the inner field:
//!   sum         u = SUM f_i(x, t)
//!   scaled      u = a f(c + (x - c) / L, t)
//!   translated  u = f(x - d, t)
//!   rotated     u = R f(c + R^T (x - c), t), R by an angle about an axis through c
//!   moving      u = V + f(x - V t, t): the field is carried along with V, its far field included
//!   modulated   u = g(t) f(x, t), g = m + a cos(2 pi f t + p)
//!   mirrored    u = M f(M x, t), M the reflection at a plane across an axis
//! Gradients follow by the chain rule. A closed trajectory of f becomes one of the composition: always when it is moved, turned
//! or mirrored; for a steady f also when it is scaled (time runs at the rate a / L) or modulated (time is the integral of g).

use super::ROUNDING_MARGIN;
use crate::error::{Check, Result};
use crate::field::VelocityField;
use crate::params::params;
use crate::region::{Axis, Region};
use glam::{DMat3, DQuat, DVec3};
use std::f64::consts::PI;

const SUM: Check = Check("sum");
const SCALED: Check = Check("scaled");
const TRANSLATED: Check = Check("translated");
const ROTATED: Check = Check("rotated");
const MOVING: Check = Check("moving");
const MODULATED: Check = Check("modulated");
const MIRRORED: Check = Check("mirrored");

/// A field inside another.
type Inner = Box<dyn VelocityField>;

params! {
    /// Parameters of [`Scaled`].
    ScaledParams {
        /// Factor on the velocity.
        velocity_factor: f64 = 1.0, "finite";
        /// Factor on lengths.
        length_factor: f64 = 1.0, "> 0";
        /// The point that stays in place, um.
        centre_um: [f64; 3] = [0.0, 0.0, 0.0], "finite";
    }
}

params! {
    /// Parameters of [`Translated`].
    TranslatedParams {
        /// Displacement of the field, um.
        offset_um: [f64; 3] = [0.0, 0.0, 0.0], "finite";
    }
}

params! {
    /// Parameters of [`Rotated`].
    RotatedParams {
        /// Direction of the axis.
        axis: [f64; 3] = [0.0, 0.0, 1.0], "finite, not all zero";
        /// Angle, rad; about z positive looks clockwise on the screen.
        angle_rad: f64 = 0.0, "finite";
        /// A point of the axis, um.
        centre_um: [f64; 3] = [0.0, 0.0, 0.0], "finite";
    }
}

params! {
    /// Parameters of [`Moving`].
    MovingParams {
        /// Velocity of the frame that carries the field, um/s.
        velocity_um_s: [f64; 3] = [0.0, 0.0, 0.0], "finite";
    }
}

params! {
    /// Parameters of [`Modulated`].
    ModulatedParams {
        /// Mean m of the factor.
        mean: f64 = 1.0, "finite";
        /// Amplitude a of the factor.
        amplitude: f64 = 0.0, "finite";
        /// Frequency, Hz.
        frequency_hz: f64 = 10.0, ">= 0";
        /// Phase p of the cosine, rad.
        phase_rad: f64 = 0.0, "finite";
    }
}

params! {
    /// Parameters of [`Mirrored`].
    MirroredParams {
        /// Axis across the mirror.
        axis: Axis = Axis::X, "x, y or z";
        /// Where the mirror stands on it, um.
        at_um: f64 = 0.0, "finite";
    }
}

/// The sum of some fields.
#[derive(Debug)]
pub struct Sum(Vec<Inner>);

impl Sum {
    /// The sum of one or more fields.
    pub fn new(fields: Vec<Inner>) -> Result<Self> {
        if fields.is_empty() { Err(SUM.fault("fields", "none", "one or more")) } else { Ok(Sum(fields)) }
    }
}

impl VelocityField for Sum {
    fn velocity(&self, x: DVec3, t: f64) -> DVec3 {
        self.0.iter().map(|field| field.velocity(x, t)).sum()
    }

    fn gradient(&self, x: DVec3, t: f64) -> DMat3 {
        self.0.iter().fold(DMat3::ZERO, |sum, field| sum + field.gradient(x, t))
    }

    fn flow_map(&self, x: DVec3, t0: f64, t1: f64) -> Option<DVec3> {
        if let [only] = self.0.as_slice() { only.flow_map(x, t0, t1) } else { None }
    }

    fn invariant(&self, x: DVec3, t: f64) -> Option<f64> {
        if let [only] = self.0.as_slice() { only.invariant(x, t) } else { None }
    }

    fn is_divergence_free(&self) -> bool {
        self.0.iter().all(|field| field.is_divergence_free())
    }

    fn is_steady(&self) -> bool {
        self.0.iter().all(|field| field.is_steady())
    }

    fn max_speed(&self, region: &Region, t0: f64, t1: f64) -> f64 {
        self.0.iter().map(|field| field.max_speed(region, t0, t1)).sum::<f64>() * ROUNDING_MARGIN
    }

    fn step_limit(&self, x: DVec3, t: f64) -> Option<f64> {
        // Together the fields are faster than each alone: keep each one's length, at the speed of the sum.
        let speed = self.velocity(x, t).length();
        self.0
            .iter()
            .filter_map(|field| Some(field.step_limit(x, t)? * field.velocity(x, t).length() / speed))
            .filter(|limit| *limit > 0.0)
            .reduce(f64::min)
    }

    fn confine(&self, x: DVec3, t: f64, radius: f64) -> DVec3 {
        self.0.iter().fold(x, |x, field| field.confine(x, t, radius))
    }
}

/// A field with other speeds and lengths.
#[derive(Debug)]
pub struct Scaled {
    inner: Inner,
    velocity: f64,
    length: f64,
    center: DVec3,
}

impl Scaled {
    /// `inner` scaled.
    pub fn new(inner: Inner, params: &ScaledParams) -> Result<Self> {
        Ok(Scaled {
            inner,
            velocity: SCALED.finite("velocity_factor", params.velocity_factor)?,
            length: SCALED.positive("length_factor", params.length_factor)?,
            center: DVec3::from_array(SCALED.all_finite("centre_um", params.centre_um)?),
        })
    }

    fn inward(&self, x: DVec3) -> DVec3 {
        self.center + (x - self.center) / self.length
    }

    fn outward(&self, x: DVec3) -> DVec3 {
        self.center + (x - self.center) * self.length
    }
}

impl VelocityField for Scaled {
    fn velocity(&self, x: DVec3, t: f64) -> DVec3 {
        self.inner.velocity(self.inward(x), t) * self.velocity
    }

    fn gradient(&self, x: DVec3, t: f64) -> DMat3 {
        self.inner.gradient(self.inward(x), t) * (self.velocity / self.length)
    }

    fn flow_map(&self, x: DVec3, t0: f64, t1: f64) -> Option<DVec3> {
        let rate = self.velocity / self.length;
        let steady = self.inner.is_steady() || rate == 1.0;
        let (t0, t1) = if rate == 1.0 { (t0, t1) } else { (0.0, (t1 - t0) * rate) };
        if steady { Some(self.outward(self.inner.flow_map(self.inward(x), t0, t1)?)) } else { None }
    }

    fn invariant(&self, x: DVec3, t: f64) -> Option<f64> {
        let similar = self.inner.is_steady() || self.velocity == self.length;
        if similar { self.inner.invariant(self.inward(x), t) } else { None }
    }

    fn is_divergence_free(&self) -> bool {
        self.inner.is_divergence_free()
    }

    fn is_steady(&self) -> bool {
        self.inner.is_steady()
    }

    fn max_speed(&self, region: &Region, t0: f64, t1: f64) -> f64 {
        let inner = self.inner.max_speed(&region.mapped(|x| self.inward(x)), t0, t1);
        if self.velocity == 0.0 { 0.0 } else { inner * self.velocity.abs() * ROUNDING_MARGIN }
    }

    fn step_limit(&self, x: DVec3, t: f64) -> Option<f64> {
        Some(self.inner.step_limit(self.inward(x), t)? * (self.length / self.velocity).abs())
    }

    fn confine(&self, x: DVec3, t: f64, radius: f64) -> DVec3 {
        let inward = self.inward(x);
        let held = self.inner.confine(inward, t, radius / self.length);
        // Where nothing is held the place stays as it is to the last bit.
        if held == inward { x } else { self.outward(held) }
    }
}

/// A field carried to another place, turned, or seen in a mirror: u = T f(T^-1 x).
#[derive(Debug)]
struct Placed {
    inner: Inner,
    /// Orthogonal.
    turn: DMat3,
    /// x = turn y + shift.
    shift: DVec3,
}

impl Placed {
    /// T x = `turn` (x - `center`) + `center` + `shift`.
    fn new(inner: Inner, turn: DMat3, center: DVec3, shift: DVec3) -> Placed {
        Placed { inner, turn, shift: center - turn * center + shift }
    }

    fn inward(&self, x: DVec3) -> DVec3 {
        self.turn.transpose() * (x - self.shift)
    }

    fn outward(&self, x: DVec3) -> DVec3 {
        self.turn * x + self.shift
    }

    fn max_speed(&self, region: &Region, t0: f64, t1: f64) -> f64 {
        // Rounding may move a corner a little inward.
        let inner = region.mapped(|x| self.inward(x)).grown(1e-9);
        self.inner.max_speed(&inner, t0, t1) * ROUNDING_MARGIN
    }
}

/// The methods of a field that wraps a [`Placed`].
macro_rules! by_placement {
    ($field:ty) => {
        impl VelocityField for $field {
            fn velocity(&self, x: DVec3, t: f64) -> DVec3 {
                self.0.turn * self.0.inner.velocity(self.0.inward(x), t)
            }

            fn gradient(&self, x: DVec3, t: f64) -> DMat3 {
                self.0.turn * self.0.inner.gradient(self.0.inward(x), t) * self.0.turn.transpose()
            }

            fn flow_map(&self, x: DVec3, t0: f64, t1: f64) -> Option<DVec3> {
                Some(self.0.outward(self.0.inner.flow_map(self.0.inward(x), t0, t1)?))
            }

            fn invariant(&self, x: DVec3, t: f64) -> Option<f64> {
                self.0.inner.invariant(self.0.inward(x), t)
            }

            fn is_divergence_free(&self) -> bool {
                self.0.inner.is_divergence_free()
            }

            fn is_steady(&self) -> bool {
                self.0.inner.is_steady()
            }

            fn max_speed(&self, region: &Region, t0: f64, t1: f64) -> f64 {
                self.0.max_speed(region, t0, t1)
            }

            fn step_limit(&self, x: DVec3, t: f64) -> Option<f64> {
                self.0.inner.step_limit(self.0.inward(x), t)
            }

            fn confine(&self, x: DVec3, t: f64, radius: f64) -> DVec3 {
                let inward = self.0.inward(x);
                let held = self.0.inner.confine(inward, t, radius);
                // Where nothing is held the place stays as it is to the last bit.
                if held == inward { x } else { self.0.outward(held) }
            }
        }
    };
}

/// A field at another place.
#[derive(Debug)]
pub struct Translated(Placed);

impl Translated {
    /// `inner` displaced.
    pub fn new(inner: Inner, params: &TranslatedParams) -> Result<Self> {
        let offset = DVec3::from_array(TRANSLATED.all_finite("offset_um", params.offset_um)?);
        Ok(Translated(Placed::new(inner, DMat3::IDENTITY, DVec3::ZERO, offset)))
    }
}

by_placement!(Translated);

/// A field turned about an axis.
#[derive(Debug)]
pub struct Rotated(Placed);

impl Rotated {
    /// `inner` turned.
    pub fn new(inner: Inner, params: &RotatedParams) -> Result<Self> {
        let axis = DVec3::from_array(ROTATED.all_finite("axis", params.axis)?);
        let center = DVec3::from_array(ROTATED.all_finite("centre_um", params.centre_um)?);
        let half = 0.5 * ROTATED.finite("angle_rad", params.angle_rad)?;
        let Some(axis) = axis.try_normalize() else {
            return Err(ROTATED.fault("axis", format!("{:?}", params.axis), "a vector other than zero"));
        };
        let (sin, cos) = libm::sincos(half);
        let turn = DMat3::from_quat(DQuat::from_xyzw(axis.x * sin, axis.y * sin, axis.z * sin, cos));
        Ok(Rotated(Placed::new(inner, turn, center, DVec3::ZERO)))
    }
}

by_placement!(Rotated);

/// A field seen in a mirror; vortices turn the other way.
#[derive(Debug)]
pub struct Mirrored(Placed);

impl Mirrored {
    /// `inner` reflected.
    pub fn new(inner: Inner, params: &MirroredParams) -> Result<Self> {
        let center = params.axis.unit() * MIRRORED.finite("at_um", params.at_um)?;
        let turn = DMat3::from_diagonal(DVec3::ONE - 2.0 * params.axis.unit());
        Ok(Mirrored(Placed::new(inner, turn, center, DVec3::ZERO)))
    }
}

by_placement!(Mirrored);

/// A field in a moving frame.
#[derive(Debug)]
pub struct Moving {
    inner: Inner,
    velocity: DVec3,
}

impl Moving {
    /// `inner` carried along.
    pub fn new(inner: Inner, params: &MovingParams) -> Result<Self> {
        let velocity = DVec3::from_array(MOVING.all_finite("velocity_um_s", params.velocity_um_s)?);
        Ok(Moving { inner, velocity })
    }

    fn inward(&self, x: DVec3, t: f64) -> DVec3 {
        x - self.velocity * t
    }
}

impl VelocityField for Moving {
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

    fn is_divergence_free(&self) -> bool {
        self.inner.is_divergence_free()
    }

    fn is_steady(&self) -> bool {
        self.velocity == DVec3::ZERO && self.inner.is_steady()
    }

    fn max_speed(&self, region: &Region, t0: f64, t1: f64) -> f64 {
        // The box in the frame of the inner field, at both times and in between.
        let swept = region.mapped(|x| self.inward(x, t0)).joined(&region.mapped(|x| self.inward(x, t1)));
        let inner = self.inner.max_speed(&swept.grown(1e-9), t0, t1);
        (self.velocity.length() + inner) * ROUNDING_MARGIN
    }

    fn step_limit(&self, x: DVec3, t: f64) -> Option<f64> {
        self.inner.step_limit(self.inward(x, t), t)
    }

    fn confine(&self, x: DVec3, t: f64, radius: f64) -> DVec3 {
        let inward = self.inward(x, t);
        x + (self.inner.confine(inward, t, radius) - inward)
    }
}

/// A field whose strength changes in time.
#[derive(Debug)]
pub struct Modulated {
    inner: Inner,
    mean: f64,
    amplitude: f64,
    omega: f64,
    phase: f64,
}

impl Modulated {
    /// `inner` times a function of time.
    pub fn new(inner: Inner, params: &ModulatedParams) -> Result<Self> {
        Ok(Modulated {
            inner,
            mean: MODULATED.finite("mean", params.mean)?,
            amplitude: MODULATED.finite("amplitude", params.amplitude)?,
            omega: 2.0 * PI * MODULATED.not_negative("frequency_hz", params.frequency_hz)?,
            phase: MODULATED.finite("phase_rad", params.phase_rad)?,
        })
    }

    fn factor(&self, t: f64) -> f64 {
        self.mean + self.amplitude * libm::cos(self.omega * t + self.phase)
    }

    /// The integral of the factor, s.
    fn stretched(&self, t0: f64, t1: f64) -> f64 {
        let half = 0.5 * self.omega * (t1 - t0);
        // sin(h) / h; 1 for h = 0.
        let share = if half == 0.0 { 1.0 } else { libm::sin(half) / half };
        let middle = libm::cos(self.omega * 0.5 * (t0 + t1) + self.phase);
        (self.mean + self.amplitude * middle * share) * (t1 - t0)
    }
}

impl VelocityField for Modulated {
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

    fn is_divergence_free(&self) -> bool {
        self.inner.is_divergence_free()
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

    fn confine(&self, x: DVec3, t: f64, radius: f64) -> DVec3 {
        self.inner.confine(x, t, radius)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fields::{LambOseen, LambOseenParams, Poiseuille, PoiseuilleParams, Rankine, RankineParams};

    fn poiseuille() -> Inner {
        Box::new(Poiseuille::from_params(&PoiseuilleParams::default()).unwrap())
    }

    fn vortex(viscosity_um2_s: f64) -> Inner {
        let params = LambOseenParams { viscosity_um2_s, ..Default::default() };
        Box::new(LambOseen::from_params(&params).unwrap())
    }

    #[test]
    fn a_quarter_turn_about_z_sends_columns_to_rows() {
        let params = RotatedParams { angle_rad: 0.5 * PI, ..Default::default() };
        let field = Rotated::new(poiseuille(), &params).unwrap();
        let u = field.velocity(DVec3::new(5.0, 7.0, -30.0), 0.0);
        assert!((u - DVec3::Y * 1290.0).length() < 1e-12 * 1290.0);
        let flat = RotatedParams { axis: [0.0; 3], ..params };
        let message = Rotated::new(poiseuille(), &flat).unwrap_err().to_string();
        assert_eq!(message, "rotated: axis = [0.0, 0.0, 0.0]: expected a vector other than zero");
    }

    #[test]
    fn a_mirror_turns_vortices_the_other_way() {
        let rankine: Inner = Box::new(Rankine::new(&RankineParams::default()).unwrap());
        let spin = |field: &dyn VelocityField, x: DVec3| {
            let gradient = field.gradient(x, 0.0);
            gradient.x_axis.y - gradient.y_axis.x
        };
        let before = spin(rankine.as_ref(), DVec3::ZERO);
        let mirrored = Mirrored::new(rankine, &MirroredParams { axis: Axis::X, at_um: 50.0 }).unwrap();
        assert_eq!(spin(&mirrored, DVec3::X * 100.0), -before);
    }

    #[test]
    fn closed_forms_survive_only_where_they_hold() {
        let twice = ScaledParams { velocity_factor: 2.0, ..Default::default() };
        let closed = |field: &dyn VelocityField| field.flow_map(DVec3::X * 30.0, 0.0, 0.01).is_some();
        assert!(closed(&Scaled::new(vortex(0.0), &twice).unwrap()));
        assert!(!closed(&Scaled::new(vortex(1e3), &twice).unwrap()));
        // Twice as fast and twice as large takes the same time, also when it decays.
        let larger = ScaledParams { length_factor: 2.0, ..twice };
        assert!(closed(&Scaled::new(vortex(1e3), &larger).unwrap()));
        let pulse = ModulatedParams { amplitude: 0.5, ..Default::default() };
        assert!(!closed(&Modulated::new(vortex(1e3), &pulse).unwrap()));
        assert!(closed(&Sum::new(vec![vortex(1e3)]).unwrap()));
        assert!(!closed(&Sum::new(vec![vortex(0.0), poiseuille()]).unwrap()));
    }

    #[test]
    fn sums_add_and_need_a_term() {
        let field = Sum::new(vec![poiseuille(), vortex(0.0)]).unwrap();
        let x = DVec3::new(10.0, 20.0, -60.0);
        let expected = poiseuille().velocity(x, 0.0) + vortex(0.0).velocity(x, 0.0);
        assert_eq!(field.velocity(x, 0.0), expected);
        assert_eq!(Sum::new(vec![]).unwrap_err().to_string(), "sum: fields = none: expected one or more");
    }

    #[test]
    fn factors_are_checked() {
        let flat = ScaledParams { length_factor: 0.0, ..Default::default() };
        let message = Scaled::new(poiseuille(), &flat).unwrap_err().to_string();
        assert_eq!(message, "scaled: length_factor = 0: expected a finite number > 0");
        assert!(Moving::new(poiseuille(), &MovingParams { velocity_um_s: [f64::NAN; 3] }).is_err());
        assert!(Translated::new(poiseuille(), &TranslatedParams { offset_um: [f64::INFINITY; 3] }).is_err());
        assert!(
            Modulated::new(poiseuille(), &ModulatedParams { frequency_hz: -1.0, ..Default::default() })
                .is_err()
        );
        assert!(
            Mirrored::new(poiseuille(), &MirroredParams { at_um: f64::NAN, ..Default::default() }).is_err()
        );
    }
}
