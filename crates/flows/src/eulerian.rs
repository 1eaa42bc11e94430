//! Displacements at fixed positions: the ground truth for PIV results.
//!
//! The displacement at a position X over an interval from t0 to t1 can be defined in several ways, and in
//! curved flow the definitions differ by more than the error of a good method. With Phi the flow map and tm =
//! (t0 + t1) / 2:
//!
//! - [`forward`]: Phi(t0 -> t1)(X) - X, of the fluid that is at X in the first image; measured by a
//!   correlation that deforms the second image only.
//! - [`backward`]: X - Phi(t1 -> t0)(X), of the fluid that is at X in the second image.
//! - [`central`]: Phi(tm -> t1)(X) - Phi(tm -> t0)(X), of the fluid that is at X at mid-time; measured by
//!   symmetric deformation of both images (Wereley & Meinhart, Exp. Fluids 31 (2001) 258, compare forward and
//!   central schemes).
//!
//! All three follow the fluid: walls and bodies act through the field only, and Brownian motion is excluded.

use crate::integrate::advance;
use crate::{Result, VelocityField};
use glam::DVec3;

/// The displacement (um) from `t0` to `t1` (s) of the fluid that is at `x` (um) at `t0`. `Err` if its
/// trajectory meets a velocity that is not finite.
pub fn forward<F: VelocityField + ?Sized>(field: &F, x: DVec3, (t0, t1): (f64, f64)) -> Result<DVec3> {
    Ok(advance(field, x, t0, t1)? - x)
}

/// The displacement (um) from `t0` to `t1` (s) of the fluid that is at `x` (um) at `t1`. Errors as for
/// [`forward`].
pub fn backward<F: VelocityField + ?Sized>(field: &F, x: DVec3, (t0, t1): (f64, f64)) -> Result<DVec3> {
    Ok(x - advance(field, x, t1, t0)?)
}

/// The displacement (um) from `t0` to `t1` (s) of the fluid that is at `x` (um) at mid-time. Errors as for
/// [`forward`].
pub fn central<F: VelocityField + ?Sized>(field: &F, x: DVec3, (t0, t1): (f64, f64)) -> Result<DVec3> {
    let middle = f64::midpoint(t0, t1);
    Ok(advance(field, x, middle, t1)? - advance(field, x, middle, t0)?)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fields::{TaylorGreen, TaylorGreenParams};

    /// 20 px per frame in vortices of 200 um, against four digits from an independent integration.
    #[test]
    fn definitions_part_in_a_vortex() {
        let um_per_px = 0.645;
        let params = TaylorGreenParams {
            max_speed_um_s: 20.0 * um_per_px,
            wavelength_um: 200.0,
            viscosity_um2_s: 0.0,
            ..Default::default()
        };
        let field = TaylorGreen::new(&params).unwrap();
        let (x, interval) = (DVec3::new(0.1 * 200.0, 0.35 * 200.0, 0.0), (0.0, 1.0));
        let px = |v: DVec3| v / um_per_px;
        let straight = px(field.velocity(x, 0.0));
        let (forward, backward, central) = (
            px(forward(&field, x, interval).unwrap()),
            px(backward(&field, x, interval).unwrap()),
            px(central(&field, x, interval).unwrap()),
        );
        let near = |v: DVec3, x: f64, y: f64, digits: f64| (v - DVec3::new(x, y, 0.0)).length() < digits;
        assert!(near(straight, -6.91, -13.09, 0.005), "{straight}");
        assert!(near(forward, -5.04, -14.85, 0.005), "{forward}");
        assert!(near(central, -6.924, -13.062, 0.0005), "{central}");
        assert!(((forward - straight).length() - 2.57).abs() < 0.005);
        assert!(((central - straight).length() - 0.032).abs() < 0.0005);
        // Forward and backward lie on either side of central.
        assert!(((forward + backward) * 0.5 - central).length() < 0.1, "{backward}");
    }
}
