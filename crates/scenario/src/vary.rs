//! Values of a scenario that can be replaced without resolving the whole again.

use std::path::Path;

use flows::Seeding;
use microsig_core::stream::Streams;

use super::files::Files;
use super::language::problems::Problems;
use super::resolved::Scenario;
use super::spec::Number;
use storage::error::{Error, Result};

impl Scenario {
    /// Whether [`Scenario::replace`] can replace the value at a path.
    pub fn can_replace(&self, path: &str) -> bool {
        match path {
            "optics.background_mean" | "optics.background_noise" => true,
            // The reach of Gaussian spots depends on it.
            "optics.gain" => self.spec.optics.gaussian.is_none(),
            "particles.number.count" | "particles.number.ppp" => self.field().is_some(),
            _ => false,
        }
    }

    /// Replaces a value that is within its range, at a path for which [`Scenario::can_replace`] holds. The
    /// scenario is then the one that would be resolved with this value, but for what no image depends on: its
    /// warnings.
    ///
    /// # Errors
    /// [`Error::Problems`] if particles of that number do not fit.
    pub fn replace(&mut self, path: &str, value: f64) -> Result<()> {
        let optics = &mut self.spec.optics;
        match path {
            "optics.background_mean" => {
                (self.settings.background_mean, optics.background_mean) = (value, Some(value));
            }
            "optics.background_noise" => {
                (self.settings.background_noise, optics.background_noise) = (value, Some(value));
            }
            "optics.gain" => (self.settings.gain, optics.gain) = (value, Some(value)),
            "particles.number.count" => self.seed_anew(Number::Count(value as u32))?,
            "particles.number.ppp" => self.seed_anew(Number::Ppp(value))?,
            _ => return Err(Error::input(format!("{path}: cannot be replaced in a resolved scenario"))),
        }
        Ok(())
    }

    fn seed_anew(&mut self, number: Number) -> Result<()> {
        self.spec.particles.number = Some(number);
        let mut problems = Problems::default();
        let mut files = Files { folder: Path::new("."), inputs: Vec::new() };
        let z_um = (self.domain.region().min().z, self.domain.region().max().z);
        let diameters: Option<Seeding> = self.spec.particles.diameters(&mut problems).and_then(|diameters| {
            let stack = || Err(Error::input("particles.number: no density by area here"));
            let place = (&self.scale, &self.settings);
            self.spec.particles.seeding(diameters, place, z_um, stack, &mut files, &mut problems)
        });
        problems.finish()?;
        self.seeding = diameters.ok_or_else(|| Error::input("particles: cannot be placed"))?;
        Ok(())
    }

    /// Replaces the seed of all random numbers.
    pub fn reseed(&mut self, seed: u64) {
        (self.spec.seed, self.streams) = (seed, Streams::new(seed));
    }
}
