//! Brightness of tracers: a factor relative to the light that MicroSIG's model gives a particle of that size.

use crate::error::{ParameterCheck, Result};
use microsig_core::random::normal;
use microsig_core::stream::Stream;

const CHECK: ParameterCheck = ParameterCheck("intensities");

/// Largest standard deviation of the normal distribution in units of its mean; above it redrawing takes too
/// long.
const MAX_SPREAD: f64 = 10.0;

/// A distribution of the factor c_int, dimensionless, >= 0.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Intensities(Distribution);

#[derive(Debug, Clone, Copy, PartialEq)]
enum Distribution {
    Equal(f64),
    Uniform { min: f64, max: f64 },
    Normal { mean: f64, sd: f64 },
    Power { reference: f64, exponent: f64 },
}

impl Default for Intensities {
    /// All 1.
    fn default() -> Self {
        Intensities(Distribution::Equal(1.0))
    }
}

impl Intensities {
    /// All factors equal, >= 0.
    pub fn equal(factor: f64) -> Result<Self> {
        Ok(Intensities(Distribution::Equal(CHECK.not_negative("factor", factor)?)))
    }

    /// Uniform between `min` and `max`, 0 <= min <= max.
    pub fn uniform(min: f64, max: f64) -> Result<Self> {
        CHECK.not_negative("min", min)?;
        CHECK.not_negative("max", max)?;
        if min > max {
            return Err(CHECK.fault("max", max, &format!("a number >= min = {min}")));
        }
        Ok(Intensities(Distribution::Uniform { min, max }))
    }

    /// Normal distribution with `mean` (> 0) and standard deviation `sd` (0 to 10 `mean`), truncated to
    /// positive factors by redrawing.
    pub fn normal(mean: f64, sd: f64) -> Result<Self> {
        CHECK.positive("mean", mean)?;
        CHECK.not_negative("sd", sd)?;
        if sd > MAX_SPREAD * mean {
            return Err(CHECK.fault("sd", sd, &format!("at most 10 mean = {}", MAX_SPREAD * mean)));
        }
        Ok(Intensities(Distribution::Normal { mean, sd }))
    }

    /// The factor (d / `reference`)^`exponent`, `reference` in um (> 0), in addition to the renderer's own
    /// dependence on size.
    pub fn power_of_diameter(reference: f64, exponent: f64) -> Result<Self> {
        CHECK.positive("reference_um", reference)?;
        CHECK.finite("exponent", exponent)?;
        Ok(Intensities(Distribution::Power { reference, exponent }))
    }

    /// A typical factor (the center of the distribution before truncation) for a particle of diameter `d_um`
    /// (um).
    pub fn typical(&self, d_um: f64) -> f64 {
        match self.0 {
            Distribution::Equal(factor) => factor,
            Distribution::Uniform { min, max } => f64::midpoint(min, max),
            Distribution::Normal { mean, .. } => mean,
            Distribution::Power { reference, exponent } => libm::pow(d_um / reference, exponent),
        }
    }

    /// A random factor for a particle of diameter `d_um` (um).
    pub fn draw(&self, d_um: f64, stream: &mut Stream) -> f64 {
        match self.0 {
            Distribution::Equal(factor) => factor,
            Distribution::Uniform { min, max } => min + (max - min) * stream.uniform(),
            Distribution::Normal { mean, sd } => loop {
                let factor = mean + sd * normal(stream);
                if factor > 0.0 {
                    break factor;
                }
            },
            Distribution::Power { reference, exponent } => libm::pow(d_um / reference, exponent),
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
            (Intensities::uniform(0.5, 2.0).unwrap(), 1.25, 1.5 / libm::sqrt(12.0)),
            (Intensities::normal(1.0, 0.1).unwrap(), 1.0, 0.1),
            (Intensities::power_of_diameter(2.0, 3.0).unwrap(), 0.125, 0.0),
        ] {
            let factors: Vec<f64> = (0..20_000).map(|_| kind.draw(1.0, &mut stream)).collect();
            let found = factors.iter().sum::<f64>() / 20_000.0;
            let variance = factors.iter().map(|f| (f - found) * (f - found)).sum::<f64>() / 20_000.0;
            // Standard errors: sd / 141 and about sd / 200.
            assert!((found - mean).abs() <= 4.0 * sd / 141.0 + 1e-12, "{kind:?}: {found}");
            assert!((libm::sqrt(variance) - sd).abs() <= 4.0 * sd / 200.0 + 1e-7, "{kind:?}: {variance}");
        }
        // Always positive, even if almost half of the distribution before truncation is negative.
        let wide = Intensities::normal(0.1, 1.0).unwrap();
        assert!((0..1000).all(|_| wide.draw(1.0, &mut stream) > 0.0));
    }

    #[test]
    fn impossible_factors_are_refused() {
        assert!(Intensities::equal(-1.0).is_err() && Intensities::uniform(2.0, 1.0).is_err());
        let message = Intensities::normal(1.0, 20.0).unwrap_err().to_string();
        assert_eq!(message, "intensities: sd = 20: expected at most 10 mean = 10");
    }
}
