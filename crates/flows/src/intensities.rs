//! Brightness of tracers: a factor relative to the light that MicroSIG's model gives a particle of that size.

use crate::error::{ParameterCheck, Result};
use microsig_core::random::normal;
use microsig_core::stream::Stream;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

const CHECK: ParameterCheck = ParameterCheck("intensities");

/// Largest standard deviation of the normal distribution in units of its mean; above it redrawing takes too
/// long.
const MAX_SPREAD: f64 = 10.0;

/// Brightness factor of the particles, relative to the brightness that the optics give for their size.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
#[schemars(rename = "Brightness")]
pub enum Intensities {
    /// The same for all particles.
    Constant(#[schemars(range(min = 0.0, max = 1e6), example = 1.0)] f64),
    /// Uniform distribution.
    Uniform {
        /// Smallest factor.
        #[schemars(range(min = 0.0, max = 1e6), example = 0.5)]
        min: f64,
        /// Largest factor.
        #[schemars(range(min = 0.0, max = 1e6), example = 1.5)]
        max: f64,
    },
    /// Normal distribution, truncated to positive factors.
    Normal {
        /// Mean before truncation.
        #[schemars(extend("exclusiveMinimum" = 0, "maximum" = 1e6), example = 1.0)]
        mean: f64,
        /// Standard deviation before truncation.
        #[schemars(range(min = 0.0, max = 1e6), example = 0.2)]
        sd: f64,
    },
    /// The factor is (d / `reference_um`)^`exponent` for a particle of diameter d.
    PowerOfDiameter {
        /// Diameter at which the factor is 1.
        #[schemars(extend("exclusiveMinimum" = 0, "maximum" = 1e6), example = 2.0)]
        reference_um: f64,
        /// Exponent; 1 for particles dyed throughout their volume, whose light is proportional to d^3 (the
        /// optics alone give d^2, as for surface emission).
        #[schemars(range(min = -100.0, max = 100.0), example = 1.0)]
        exponent: f64,
    },
}

impl Default for Intensities {
    fn default() -> Self {
        Intensities::Constant(1.0)
    }
}

impl Intensities {
    /// The same distribution, or `Err` if a value is out of range. A normal distribution may be at most as wide as 10
    /// times its mean.
    pub fn checked(self) -> Result<Self> {
        match self {
            Intensities::Constant(factor) => drop(CHECK.not_negative("factor", factor)?),
            Intensities::Uniform { min, max } => {
                CHECK.not_negative("min", min)?;
                CHECK.not_negative("max", max)?;
                if min > max {
                    return Err(CHECK.fault("max", max, &format!("a number >= min = {min}")));
                }
            }
            Intensities::Normal { mean, sd } => {
                CHECK.positive("mean", mean)?;
                CHECK.not_negative("sd", sd)?;
                if sd > MAX_SPREAD * mean {
                    return Err(CHECK.fault("sd", sd, &format!("at most 10 mean = {}", MAX_SPREAD * mean)));
                }
            }
            Intensities::PowerOfDiameter { reference_um, exponent } => {
                CHECK.positive("reference_um", reference_um)?;
                CHECK.finite("exponent", exponent)?;
            }
        }
        Ok(self)
    }

    /// A typical factor (the center of the distribution before truncation) for a particle of diameter `d_um`
    /// (um).
    pub fn typical(&self, d_um: f64) -> f64 {
        match *self {
            Intensities::Constant(factor) => factor,
            Intensities::Uniform { min, max } => f64::midpoint(min, max),
            Intensities::Normal { mean, .. } => mean,
            Intensities::PowerOfDiameter { reference_um, exponent } => {
                libm::pow(d_um / reference_um, exponent)
            }
        }
    }

    /// A random factor for a particle of diameter `d_um` (um).
    pub fn draw(&self, d_um: f64, stream: &mut Stream) -> f64 {
        match *self {
            Intensities::Constant(factor) => factor,
            Intensities::Uniform { min, max } => min + (max - min) * stream.uniform(),
            Intensities::Normal { mean, sd } => loop {
                let factor = mean + sd * normal(stream);
                if factor > 0.0 {
                    break factor;
                }
            },
            Intensities::PowerOfDiameter { reference_um, exponent } => {
                libm::pow(d_um / reference_um, exponent)
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use microsig_core::stream::{Purpose, Streams};

    #[test]
    fn factors_have_the_moments_they_claim() {
        let mut stream = Streams::new(2).stream(Purpose::Intensity, 0, 0);
        for (kind, mean, sd) in [
            (Intensities::default(), 1.0, 0.0),
            (Intensities::Uniform { min: 0.5, max: 2.0 }, 1.25, 1.5 / libm::sqrt(12.0)),
            (Intensities::Normal { mean: 1.0, sd: 0.1 }, 1.0, 0.1),
            (Intensities::PowerOfDiameter { reference_um: 2.0, exponent: 3.0 }, 0.125, 0.0),
        ] {
            let factors: Vec<f64> = (0..20_000).map(|_| kind.draw(1.0, &mut stream)).collect();
            let found = factors.iter().sum::<f64>() / 20_000.0;
            let variance = factors.iter().map(|f| (f - found) * (f - found)).sum::<f64>() / 20_000.0;
            // Standard errors: sd / 141 and about sd / 200.
            assert!((found - mean).abs() <= 4.0 * sd / 141.0 + 1e-12, "{kind:?}: {found}");
            assert!((libm::sqrt(variance) - sd).abs() <= 4.0 * sd / 200.0 + 1e-7, "{kind:?}: {variance}");
        }
        // Always positive, even if almost half of the distribution before truncation is negative.
        let wide = Intensities::Normal { mean: 0.1, sd: 1.0 };
        assert!((0..1000).all(|_| wide.draw(1.0, &mut stream) > 0.0));
    }

    #[test]
    fn impossible_factors_are_refused() {
        assert!(Intensities::Constant(-1.0).checked().is_err());
        assert!(Intensities::Uniform { min: 2.0, max: 1.0 }.checked().is_err());
        assert!(Intensities::PowerOfDiameter { reference_um: 0.0, exponent: 1.0 }.checked().is_err());
        let message = Intensities::Normal { mean: 1.0, sd: 20.0 }.checked().unwrap_err().to_string();
        assert_eq!(message, "intensities: sd = 20: expected at most 10 mean = 10");
    }
}
