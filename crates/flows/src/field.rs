//! The interface of a velocity field.
//!
//! Positions in um, times in s, velocities in um/s, gradients in 1/s. Axes: x = image columns (right), y =
//! image rows (down), z = optical axis, growing away from the lens. The axes are right-handed; because y
//! points down, a rotation with positive z vorticity looks clockwise on the screen.

use crate::region::Region;
use crate::wall::{Wall, push_off};
use glam::{DMat3, DVec3};
use std::fmt::Debug;
use std::sync::Arc;

/// A velocity field u(x, t), steady or not.
///
/// The velocity is defined at every finite point: inside walls it is the wall's, at singular points it
/// is not finite. A trajectory that reaches such a point ends in [`crate::Error::Trajectory`].
pub trait VelocityField: Send + Sync + Debug {
    /// The velocity at `x` (um) and `t` (s), um/s.
    fn velocity(&self, x: DVec3, t: f64) -> DVec3;

    /// The velocity gradient G_ij = du_i/dx_j at `x` (um) and `t` (s), 1/s.
    ///
    /// glam stores columns: column j is the derivative of u along x_j, so `gradient(x, t) * dx` is the
    /// velocity difference over a small `dx`, and G_ij is `.col(j)[i]`. Where the gradient jumps, either
    /// one-sided value may be returned. The default is [`differences`].
    fn gradient(&self, x: DVec3, t: f64) -> DMat3 {
        differences(self, x, t)
    }

    /// Position (um) at `t1` (s, earlier or later) of the fluid element that is at `x` (um) at `t0` (s),
    /// exact up to rounding; `None` if the field has no closed form.
    fn flow_map(&self, _x: DVec3, _t0: f64, _t1: f64) -> Option<DVec3> {
        None
    }

    /// A quantity that is constant along every trajectory, in a unit that the field chooses; `None` if the
    /// field has none.
    fn invariant(&self, _x: DVec3, _t: f64) -> Option<f64> {
        None
    }

    /// Whether div u = 0 everywhere, so that a uniform cloud of tracers stays uniform.
    fn is_divergence_free(&self) -> bool {
        false
    }

    /// Whether the velocity is independent of time. `false` is always safe.
    fn is_steady(&self) -> bool {
        false
    }

    /// An upper bound of the speed in `region` between `t0` and `t1` (in either order), um/s.
    ///
    /// It bounds how far inside an open face new particles can appear, so it must never be too small; a
    /// larger bound only costs time. Infinity is allowed.
    fn max_speed(&self, region: &Region, t0: f64, t1: f64) -> f64;

    /// The longest time step (s) that an integrator may take from `x` at `t` without stepping over a surface
    /// where the gradient is discontinuous; `None` if the field is smooth. Usually max(distance from the
    /// surface, 2 % of its radius) / speed.
    fn step_limit(&self, _x: DVec3, _t: f64) -> Option<f64> {
        None
    }

    /// Fraction (0 to 1) of the volume of a region in which the velocity is not measured or computed, but
    /// extrapolated from the edge of the data.
    fn share_without_data(&self, _region: &Region) -> f64 {
        0.0
    }

    /// The wall of the field nearest to `x` (um) at `t` (s); `None` everywhere if the field has no walls.
    /// Fluid is where the clearance is >= 0, and the velocity there never crosses the wall. A clearance never
    /// exceeds three times the true distance from the wall.
    fn wall(&self, _x: DVec3, _t: f64) -> Option<Wall> {
        None
    }

    /// The axes (x, y, z) along which [`Self::wall`] does not change, at any time; `false` is always safe.
    /// Measuring the fluid between such walls takes much less time.
    fn walls_same_along(&self) -> [bool; 3] {
        [false; 3]
    }

    /// The position (um) nearest to `x` (um) at which a particle of `radius` (um) does not overlap the
    /// field's own walls at `t` (s); `x` itself, bit for bit, if it overlaps none.
    fn confine(&self, x: DVec3, t: f64, radius: f64) -> DVec3 {
        push_off(|x| self.wall(x, t), x, radius)
    }

    /// The velocity field that particles of diameter `d_um` (um) follow, if a force such as the acoustic
    /// radiation force moves them relative to the fluid; `None` if all particles follow the fluid.
    fn for_diameter(&self, _d_um: f64) -> Option<Arc<dyn VelocityField>> {
        None
    }
}

/// Step of [`differences`], um.
///
/// The truncation error relative to u/L is about (h/L)^4 / 30, the rounding error 1e-16 L/h: below 1e-9 for
/// flow length scales L from 4 um to 1 mm.
const DIFFERENCE_STEP_UM: f64 = 0.05;

/// The gradient of `field` by fourth-order central differences, for fields without an analytic gradient and
/// to test analytic ones: (-u(x+2h) + 8 u(x+h) - 8 u(x-h) + u(x-2h)) / 12h. Meaningless within 0.1 um of a
/// jump.
pub fn differences<F: VelocityField + ?Sized>(field: &F, x: DVec3, t: f64) -> DMat3 {
    let along = |axis: DVec3| {
        let u = |steps: f64| field.velocity(x + axis * (steps * DIFFERENCE_STEP_UM), t);
        ((u(1.0) - u(-1.0)) * 8.0 - (u(2.0) - u(-2.0))) / (12.0 * DIFFERENCE_STEP_UM)
    };
    DMat3::from_cols(along(DVec3::X), along(DVec3::Y), along(DVec3::Z))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// u = (x y^3, z, 0): a polynomial of fourth degree, for which the differences are exact.
    #[derive(Debug)]
    struct Quartic;

    impl VelocityField for Quartic {
        fn velocity(&self, x: DVec3, _t: f64) -> DVec3 {
            DVec3::new(x.x * x.y * x.y * x.y, x.z, 0.0)
        }
        fn max_speed(&self, _region: &Region, _t0: f64, _t1: f64) -> f64 {
            f64::INFINITY
        }
    }

    #[test]
    fn columns_are_derivatives_and_a_quartic_is_exact() {
        let gradient = Quartic.gradient(DVec3::new(2.0, 3.0, 5.0), 0.0);
        let expected = DMat3::from_cols(
            DVec3::new(27.0, 0.0, 0.0), // d/dx
            DVec3::new(54.0, 0.0, 0.0), // d/dy
            DVec3::new(0.0, 1.0, 0.0),  // d/dz
        );
        // Rounding: |u| 54 times 1e-16 over h = 0.05 is 1e-13.
        assert!(gradient.abs_diff_eq(expected, 1e-12), "{gradient}");
        assert_eq!(Quartic.flow_map(DVec3::ONE, 0.0, 1.0), None);
    }
}
