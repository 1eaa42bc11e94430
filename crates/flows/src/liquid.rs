//! The suspending liquid: temperature and viscosity for diffusion and settling.

use crate::error::{ParameterCheck, Result};

const CHECK: ParameterCheck = ParameterCheck("liquid");

/// Boltzmann's constant, J/K, times 1e18: with lengths in um it gives um^2/s and 1/s.
const BOLTZMANN: f64 = 1.380_649e-23 * 1e18;

/// A Newtonian liquid.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize), serde(default))]
pub struct Liquid {
    /// Temperature, K, > 0.
    pub temperature_k: f64,
    /// Dynamic viscosity, Pa s, > 0.
    pub viscosity_pa_s: f64,
}

impl Default for Liquid {
    /// Water at 25 degrees Celsius.
    fn default() -> Self {
        Liquid { temperature_k: 298.15, viscosity_pa_s: 0.89e-3 }
    }
}

impl Liquid {
    /// The same liquid, or `Err` if a property is not finite and > 0.
    pub fn checked(self) -> Result<Self> {
        CHECK.positive("temperature_k", self.temperature_k)?;
        CHECK.positive("viscosity_pa_s", self.viscosity_pa_s)?;
        Ok(self)
    }

    /// kB T / mu, um^3/s.
    pub(crate) fn kt_over_viscosity(&self) -> f64 {
        BOLTZMANN * self.temperature_k / self.viscosity_pa_s
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_liquid_needs_positive_properties() {
        let water = Liquid::default();
        let message = Liquid { temperature_k: -1.0, ..water }.checked().unwrap_err().to_string();
        assert_eq!(message, "liquid: temperature_k = -1: expected a finite number > 0");
        assert!(Liquid { viscosity_pa_s: 0.0, ..water }.checked().is_err());
    }
}
