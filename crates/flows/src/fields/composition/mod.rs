//! Compositions of fields: sum, scaling, translation, rotation, moving frame, modulation in time, reflection.
//!
//! With f the inner field:
//! - sum: u = SUM f_i(x, t)
//! - scaled: u = a f(c + (x - c) / L, t)
//! - translated: u = f(x - d, t)
//! - rotated: u = R f(c + R^T (x - c), t), R being the rotation by an angle about an axis through c
//! - moving: u = V + f(x - V t, t), the field including its far field moves with V
//! - modulated: u = g(t) f(x, t), g = m + a cos(2 pi f t + p)
//! - mirrored: u = M f(M x, t), M being the reflection at a plane normal to an axis
//!
//! Gradients follow by the chain rule. A closed-form trajectory of f gives one of the composition: always for
//! translation, rotation, reflection and a moving frame; for a steady f also for scaling (time runs at the
//! rate a / L) and modulation (time is the integral of g). Walls of f are transformed with it; the fluid of a
//! sum is the intersection of the fluids of its terms.

/// What a composition of one field takes from it: whether it is divergence-free, the field that particles of a
/// diameter follow and, with `same_walls`, the axes along which walls do not change.
macro_rules! like_inner {
    ($type:ident, same_walls) => {
        like_inner!($type);

        fn walls_same_along(&self) -> [bool; 3] {
            self.inner.walls_same_along()
        }
    };
    ($type:ident) => {
        fn is_divergence_free(&self) -> bool {
            self.inner.is_divergence_free()
        }

        fn for_diameter(&self, d_um: f64) -> Option<Inner> {
            Some(std::sync::Arc::new($type { inner: self.inner.for_diameter(d_um)?, ..*self }))
        }
    };
}

mod entries;
mod placed;
mod scaled;
mod sum;
mod unsteady;

pub(in crate::fields) use entries::vortex;
pub(crate) use entries::{MIRRORED, MODULATED, MOVING, ROTATED, SCALED, SUM, TRANSLATED};
pub use placed::{MirroredParams, RotatedParams, TranslatedParams};
pub use scaled::ScaledParams;
pub use sum::Sum;
pub use unsteady::{ModulatedParams, MovingParams};

use crate::{Result, VelocityField};
use std::sync::Arc;

type Inner = Arc<dyn VelocityField>;
type Field = Box<dyn VelocityField>;

/// Parameters of a composition of one field.
pub trait Transform {
    /// The transformed field.
    fn apply(&self, field: Box<dyn VelocityField>) -> Result<Box<dyn VelocityField>>;
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fields::{LambOseen, LambOseenParams, Poiseuille, PoiseuilleParams};
    use glam::DVec3;

    fn poiseuille() -> Box<dyn VelocityField> {
        Box::new(Poiseuille::from_params(&PoiseuilleParams::default()).unwrap())
    }

    fn vortex(viscosity_um2_s: f64) -> Box<dyn VelocityField> {
        let params = LambOseenParams { viscosity_um2_s, ..Default::default() };
        Box::new(LambOseen::from_params(&params).unwrap())
    }

    #[test]
    fn closed_forms_survive_only_where_they_hold() {
        let twice = ScaledParams { velocity_factor: 2.0, ..Default::default() };
        let closed = |field: &dyn VelocityField| field.flow_map(DVec3::X * 30.0, 0.0, 0.01).is_some();
        assert!(closed(twice.apply(vortex(0.0)).unwrap().as_ref()));
        assert!(!closed(twice.apply(vortex(1e3)).unwrap().as_ref()));
        // Doubling speeds and lengths leaves the time scale unchanged, also for a decaying vortex.
        let larger = ScaledParams { length_factor: 2.0, ..twice };
        assert!(closed(larger.apply(vortex(1e3)).unwrap().as_ref()));
        let pulse = ModulatedParams { amplitude: 0.5, ..Default::default() };
        assert!(!closed(pulse.apply(vortex(1e3)).unwrap().as_ref()));
        assert!(closed(&Sum::new(vec![vortex(1e3)]).unwrap()));
        assert!(!closed(&Sum::new(vec![vortex(0.0), poiseuille()]).unwrap()));
    }

    #[test]
    fn factors_are_checked() {
        let flat = ScaledParams { length_factor: 0.0, ..Default::default() };
        let message = flat.apply(poiseuille()).unwrap_err().to_string();
        assert_eq!(message, "scaled: length_factor = 0: expected a finite number > 0");
        let flat = RotatedParams { axis: [0.0; 3], ..Default::default() };
        let message = flat.apply(poiseuille()).unwrap_err().to_string();
        assert_eq!(message, "rotated: axis = [0.0, 0.0, 0.0]: expected a vector other than zero");
        assert_eq!(Sum::new(vec![]).unwrap_err().to_string(), "sum: fields = none: expected one or more");
        let wrong: [&dyn Transform; 4] = [
            &MovingParams { velocity_um_s: [f64::NAN; 3] },
            &TranslatedParams { offset_um: [f64::INFINITY; 3] },
            &ModulatedParams { frequency_hz: -1.0, ..Default::default() },
            &MirroredParams { at_um: f64::NAN, ..Default::default() },
        ];
        assert!(wrong.iter().all(|params| params.apply(poiseuille()).is_err()));
    }
}
