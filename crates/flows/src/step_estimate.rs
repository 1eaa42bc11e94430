//! Estimate of the number of integration steps of the trajectories, made before integration: a scenario whose
//! speeds are wrong by orders of magnitude is rejected instead of running for hours.
//!
//! Closed-form trajectories count as zero steps. Otherwise DOPRI5(4) at the default tolerance takes about 30
//! steps per unit of |grad u| dt (measured: 9 steps for 20 px along a vortex of 200 um), and near a
//! discontinuity of the gradient the field limits the step.

use glam::DVec3;

use crate::divergence::lattice;
use crate::{FluidRegion, ParameterCheck, Result, VelocityField};

/// Number of steps per unit of |grad u| dt.
const STEPS_PER_STRAIN: f64 = 30.0;
/// Maximum mean number of steps of a trajectory between two frames.
pub const MAX_STEPS: f64 = 20_000.0;
/// Number of sampling points of the estimate along each axis.
const NODES: u32 = 8;

/// Estimated number of integration steps of a trajectory over `dt_s` (s), averaged over the fluid of the
/// domain at `t` (s); 0 if there is no fluid.
pub fn steps(field: &dyn VelocityField, fluid: &FluidRegion<'_>, t: f64, dt_s: f64) -> f64 {
    let (mut sum, mut number) = (0.0, 0.0);
    for x in lattice(fluid.domain().region(), NODES).filter(|x| fluid.contains(*x, t)) {
        number += 1.0;
        if field.flow_map(x, t, t + dt_s).is_some() {
            continue;
        }
        let gradient = field.gradient(x, t);
        let rate = libm::sqrt((0..3).map(|i| gradient.col(i).length_squared()).sum::<f64>());
        let limited = field.step_limit(x, t).map_or(0.0, |limit| dt_s / limit);
        sum += (STEPS_PER_STRAIN * rate * dt_s).max(limited);
    }
    if number > 0.0 { sum / number } else { 0.0 }
}

/// Checks that closed-form trajectories end at a finite position, and that the others take at most
/// [`MAX_STEPS`] steps on average between two frames `dt_s` (s) apart; `Err` gives the highest speed found.
pub fn check(field: &dyn VelocityField, fluid: &FluidRegion<'_>, t: f64, dt_s: f64) -> Result<()> {
    let ends = |x: DVec3| field.flow_map(x, t, t + dt_s).is_none_or(DVec3::is_finite);
    if let Some(x) = lattice(fluid.domain().region(), NODES).find(|x| fluid.contains(*x, t) && !ends(*x)) {
        let value = format!("{:e} at ({}, {}, {}) um", field.velocity(x, t).length(), x.x, x.y, x.z);
        let allowed = format!("speeds at which paths over {dt_s} s end at a finite position");
        return Err(ParameterCheck("flow").fault("speed_um_s", value, &allowed));
    }
    let steps = steps(field, fluid, t, dt_s);
    if steps <= MAX_STEPS {
        return Ok(());
    }
    let speeds = lattice(fluid.domain().region(), NODES).map(|x| field.velocity(x, t).length());
    let value = format!("up to {:.3e}", speeds.fold(0.0, f64::max));
    let most = MAX_STEPS / steps;
    let allowed = format!(
        "at most about {most:.1e} times this speed, or frames closer than {dt_s} s: each trajectory would take {steps:.1e} \
         integration steps between frames, at most {MAX_STEPS} are allowed"
    );
    Err(ParameterCheck("flow").fault("speed_um_s", value, &allowed))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fields::{Poiseuille, PoiseuilleParams, TaylorGreen, TaylorGreenParams};
    use crate::{Boundary, Domain, Region};

    #[test]
    fn hopeless_speeds_are_refused_and_closed_forms_are_free() {
        let region = Region::new(DVec3::new(-200.0, -100.0, -80.0), DVec3::new(200.0, 100.0, 20.0)).unwrap();
        let domain = Domain::new(region, [Boundary::Open; 3]);
        let of = |field: &dyn VelocityField| check(field, &FluidRegion::new(field, &domain, &[]), 0.0, 0.005);
        let vortices = |speed: f64| {
            TaylorGreen::new(&TaylorGreenParams { max_speed_um_s: speed, ..Default::default() }).unwrap()
        };
        assert!(of(&vortices(1290.0)).is_ok() && of(&vortices(1e6)).is_ok());
        let message = of(&vortices(1e12)).unwrap_err().to_string();
        assert!(message.starts_with("flow: speed_um_s = up to 7.07"), "{message}");
        assert!(message.contains("integration steps") && message.contains("at most 20000"), "{message}");
        let fast = PoiseuilleParams { max_speed_um_s: Some(1e12), ..Default::default() };
        assert!(of(&Poiseuille::from_params(&fast).unwrap()).is_ok());
    }
}
