//! Orientation of spheroids: initial distributions, and Jeffery's equation along the path.
//!
//! The symmetry axis n of a spheroid of aspect ratio e (length along the axis over length across it) obeys
//! dn/dt = O n + L (E n - n (n . E n)) (Jeffery, Proc. R. Soc. A 102 (1922) 161), where O and E are the
//! antisymmetric and symmetric parts of the velocity gradient and L = (e^2 - 1) / (e^2 + 1). The equation is
//! equivalent to a linear one: n = q / |q| with dq/dt = (O + L E) q. Over a step q is multiplied by the
//! exponential of the fourth-order Magnus expansion with two Gauss points (Blanes et al., Physics Reports 470
//! (2009) 151, section 5), which is exact in a constant gradient; a step is halved until it agrees with its
//! two halves. In simple shear of rate g the axis rotates with the period (2 pi / g) (e + 1/e).

use crate::fields::exponential;
use crate::integrate::advance;
use crate::{Error, ParameterCheck, Result, VelocityField};
use glam::{DMat3, DVec3};
use microsig_core::random::normal;
use microsig_core::stream::Stream;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::f64::consts::PI;

const CHECK: ParameterCheck = ParameterCheck("orientation");

/// Largest difference between a step and its two halves, rad.
const TOLERANCE: f64 = 1e-9;
/// Maximum number of times a frame interval is halved.
const MAX_HALVINGS: u32 = 20;

/// The axis at `t1` (s) of a spheroid of aspect ratio `aspect` (> 0) that is at `x` (um) with the axis `axis`
/// (unit vector) at `t0` (s) and is advected by the flow. Errors as for [`advance`].
pub fn carry<F: VelocityField + ?Sized>(
    field: &F,
    x: DVec3,
    axis: DVec3,
    aspect: f64,
    t0: f64,
    t1: f64,
) -> Result<DVec3> {
    let squared = aspect * aspect;
    let shape = (squared - 1.0) / (squared + 1.0);
    let whole = turn(field, x, shape, t0, t1)?;
    refine(field, x, axis, shape, (t0, t1), whole, MAX_HALVINGS)
}

/// `axis` after an interval for which a single step gives `whole`; the interval is halved until the result
/// has converged.
fn refine<F: VelocityField + ?Sized>(
    field: &F,
    x: DVec3,
    axis: DVec3,
    shape: f64,
    (t0, t1): (f64, f64),
    whole: DMat3,
    halvings: u32,
) -> Result<DVec3> {
    let middle = 0.5 * (t0 + t1);
    let half_way = advance(field, x, t0, middle)?;
    let first = turn(field, x, shape, t0, middle)?;
    let second = turn(field, half_way, shape, middle, t1)?;
    let halves = (second * (first * axis).normalize()).normalize();
    if (halves - (whole * axis).normalize()).length() <= TOLERANCE {
        return Ok(halves);
    }
    if halvings == 0 || !halves.is_finite() {
        return Err(Error::Trajectory {
            at_um: x,
            t_s: t0,
            reason: "the integration of the orientation does not converge",
        });
    }
    let axis = refine(field, x, axis, shape, (t0, middle), first, halvings - 1)?;
    refine(field, half_way, axis, shape, (middle, t1), second, halvings - 1)
}

/// The matrix that propagates q over one step.
fn turn<F: VelocityField + ?Sized>(field: &F, x: DVec3, shape: f64, t0: f64, t1: f64) -> Result<DMat3> {
    let h = t1 - t0;
    let root = libm::sqrt(3.0) / 6.0;
    let at = |share: f64| -> Result<DMat3> {
        let t = t0 + share * h;
        let gradient = field.gradient(advance(field, x, t0, t)?, t);
        let transposed = gradient.transpose();
        Ok((gradient - transposed) * 0.5 + (gradient + transposed) * (0.5 * shape))
    };
    let (first, second) = (at(0.5 - root)?, at(0.5 + root)?);
    let commutator = second * first - first * second;
    Ok(exponential((first + second) * (0.5 * h) + commutator * (0.5 * root * h * h)))
}

/// Initial orientation of the symmetry axes of spheroids.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Orientation {
    /// Uniformly distributed over all directions.
    #[default]
    Random,
    /// All axes along one direction (x, y, z).
    Aligned(#[schemars(example = (1, 0, 0))] (f64, f64, f64)),
    /// Von Mises-Fisher distribution about a mean direction, density proportional to exp(kappa cos(a)) at the
    /// angle a from it.
    VonMisesFisher {
        /// Mean direction (x, y, z).
        #[schemars(example = (1, 0, 0))]
        mean: (f64, f64, f64),
        /// Concentration kappa.
        #[schemars(extend("exclusiveMinimum" = 0, "maximum" = 1e6), example = 10.0)]
        kappa: f64,
    },
}

impl Orientation {
    /// A random direction (unit vector).
    pub fn draw(&self, stream: &mut Stream) -> DVec3 {
        match *self {
            Orientation::Random => loop {
                let xi = DVec3::new(normal(stream), normal(stream), normal(stream));
                if let Some(direction) = xi.try_normalize() {
                    break direction;
                }
            },
            Orientation::Aligned(direction) => DVec3::from(direction).normalize(),
            // Fisher, Proc. R. Soc. A 217 (1953) 295; the angle from the mean is about 1 / sqrt(kappa) rad.
            Orientation::VonMisesFisher { mean, kappa } => {
                let mean = DVec3::from(mean).normalize();
                // The cosine of the angle, by inversion: 1 + ln(u + (1 - u) e^(-2 kappa)) / kappa.
                let u = 1.0 - stream.uniform();
                let cos = (1.0 + libm::log(u + (1.0 - u) * libm::exp(-2.0 * kappa)) / kappa).max(-1.0);
                let sin = libm::sqrt((1.0 - cos * cos).max(0.0));
                let (s, c) = libm::sincos(2.0 * PI * stream.uniform());
                let (across, beside) = mean.any_orthonormal_pair();
                (mean * cos + (across * c + beside * s) * sin).normalize()
            }
        }
    }
}

/// Spheroids.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Spheroids {
    /// Aspect ratio, polar over equatorial diameter: above 1 for rods (prolate), below 1 for discs (oblate).
    #[schemars(range(min = 0.01, max = 100.0), example = 3.0)]
    pub e_p: f64,
    /// Initial orientation of their symmetry axes.
    #[serde(default)]
    pub orientation: Orientation,
}

impl Spheroids {
    /// The same spheroids, or `Err` if a value is out of range; directions may have any length but zero.
    pub fn checked(self) -> Result<Self> {
        if !(0.01..=100.0).contains(&self.e_p) {
            return Err(CHECK.fault("aspect_ratio", self.e_p, "a number from 0.01 to 100"));
        }
        match self.orientation {
            Orientation::Random => {}
            Orientation::Aligned(direction) => drop(CHECK.direction("direction", direction.into())?),
            Orientation::VonMisesFisher { mean, kappa } => {
                if !(kappa > 0.0 && kappa <= 1e6) {
                    return Err(CHECK.fault("kappa", kappa, "a number > 0, at most 1e6"));
                }
                CHECK.direction("direction", mean.into())?;
            }
        }
        Ok(self)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fields::{LambOseen, LambOseenParams, Linear};
    use crate::region::Axis;
    use microsig_core::stream::{Purpose, Streams};

    #[test]
    fn a_rod_in_shear_turns_with_jefferys_period() {
        let field = Linear::shear(12.9, Axis::X, Axis::Y, DVec3::ZERO).unwrap();
        for aspect in [0.2, 1.0, 3.0, 10.0] {
            let period = 2.0 * PI / 12.9 * (aspect + 1.0 / aspect);
            let start = DVec3::new(0.3, 0.8, 0.4).normalize();
            // Over 50 frames, so that errors of single steps would accumulate.
            let carried = |time: f64| {
                (0..50).fold(start, |axis, k| {
                    let (t0, t1) = (time * f64::from(k) / 50.0, time * f64::from(k + 1) / 50.0);
                    carry(&field, DVec3::Y, axis, aspect, t0, t1).unwrap()
                })
            };
            // After one period the axis has returned to its start.
            assert!((carried(period) - start).length() < 1e-9, "{aspect}");
            // After half a period the in-plane components are reversed; n and -n are the same rod only in the
            // plane of shear.
            let half = carried(0.5 * period);
            assert!((half - DVec3::new(-start.x, -start.y, start.z)).length() < 1e-9, "{aspect}: {half}");
            // After a quarter period it has not returned: a constant axis would fail here.
            assert!((carried(0.25 * period) - start).length() > 0.1);
        }
    }

    #[test]
    fn along_a_path_it_agrees_with_small_steps_of_the_equation() {
        let field = LambOseen::from_params(&LambOseenParams::default()).unwrap();
        let (x, aspect) = (DVec3::new(30.0, 20.0, 0.0), 4.0);
        let start = DVec3::new(1.0, 0.5, 0.7).normalize();
        let end = carry(&field, x, start, aspect, 0.0, 0.05).unwrap();
        // The nonlinear equation by the midpoint rule in 20000 steps.
        let shape = (aspect * aspect - 1.0) / (aspect * aspect + 1.0);
        let rate = |n: DVec3, t: f64| {
            let g = field.gradient(field.flow_map(x, 0.0, t).unwrap(), t);
            let (spin, strain) = ((g - g.transpose()) * 0.5, (g + g.transpose()) * 0.5);
            spin * n + (strain * n - n * n.dot(strain * n)) * shape
        };
        let h = 0.05 / 20_000.0;
        let n = (0..20_000)
            .map(|k| h * f64::from(k))
            .fold(start, |n, t| n + rate(n + rate(n, t) * (0.5 * h), t + 0.5 * h) * h);
        // The error of the midpoint rule is (h g)^2 g t / 24 = 1e-9, of the steps under test 1e-9 each.
        assert!((end - n).length() < 1e-8, "{}", (end - n).length());
        // Backward in time.
        let there = field.flow_map(x, 0.0, 0.05).unwrap();
        assert!((carry(&field, there, end, aspect, 0.05, 0.0).unwrap() - start).length() < 1e-7);
    }

    #[test]
    fn directions_are_spread_as_they_should() {
        let mut stream = Streams::new(2).stream(Purpose::Orientation, 0, 0);
        let mean = DVec3::new(1.0, -2.0, 2.0) / 3.0;
        for (orientation, cosine, square) in [
            (Orientation::Random, 0.0, 1.0 / 3.0),
            (Orientation::Aligned((mean * 7.0).into()), 1.0, 1.0),
            // coth kappa - 1 / kappa, and 1 - 2 (that) / kappa.
            (Orientation::VonMisesFisher { mean: mean.into(), kappa: 2.0 }, 0.537_315, 0.462_685),
            (Orientation::VonMisesFisher { mean: mean.into(), kappa: 500.0 }, 0.998, 0.996_008),
        ] {
            let (mut first, mut second) = (0.0, 0.0);
            for _ in 0..20_000 {
                let n = orientation.draw(&mut stream);
                assert!((n.length() - 1.0).abs() < 1e-14);
                first += n.dot(mean) / 20_000.0;
                second += n.dot(mean) * n.dot(mean) / 20_000.0;
            }
            // Standard errors at most 0.58 / 141 and 0.3 / 141.
            assert!(
                (first - cosine).abs() < 0.017 && (second - square).abs() < 0.01,
                "{orientation:?} {first} {second}"
            );
        }
    }

    #[test]
    fn impossible_spheroids_are_refused() {
        let checked = |e_p, orientation| Spheroids { e_p, orientation }.checked();
        let message = checked(-2.0, Orientation::Random).unwrap_err().to_string();
        assert_eq!(message, "orientation: aspect_ratio = -2: expected a number from 0.01 to 100");
        assert!(checked(2.0, Orientation::Aligned((0.0, 0.0, 0.0))).is_err());
        let mean = (1.0, 0.0, 0.0);
        assert!(checked(2.0, Orientation::VonMisesFisher { mean, kappa: f64::NAN }).is_err());
    }
}
