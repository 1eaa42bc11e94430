//! Values that can be replaced in a resolved scenario, without resolving it again.

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
            // The extent of Gaussian spots depends on the gain.
            "optics.gain" => self.spec.optics.gaussian.is_none(),
            "particles.number.count" | "particles.number.ppp" => self.field().is_some(),
            _ => false,
        }
    }

    /// Replaces the value at a path for which [`Scenario::can_replace`] is true; the value must be within its
    /// range. The result is the scenario that would be resolved with this value, except for its warnings.
    ///
    /// # Errors
    /// [`Error::Problems`] if the particles do not fit into the box.
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
            "particles.number.count" => self.replace_number(Number::Count(value as u32))?,
            "particles.number.ppp" => self.replace_number(Number::Ppp(value))?,
            _ => return Err(Error::input(format!("{path}: cannot be replaced in a resolved scenario"))),
        }
        Ok(())
    }

    fn replace_number(&mut self, number: Number) -> Result<()> {
        self.spec.particles.number = Some(number);
        let mut problems = Problems::default();
        let mut files = Files { folder: Path::new("."), inputs: Vec::new() };
        let z_um = (self.domain.region().min().z, self.domain.region().max().z);
        let seeding: Option<Seeding> = self.spec.particles.diameters(&mut problems).and_then(|diameters| {
            let stack = || Err(Error::input("particles.number: a source density cannot be replaced"));
            let optics = (&self.scale, &self.settings);
            self.spec.particles.seeding(diameters, optics, z_um, stack, &mut files, &mut problems)
        });
        problems.finish()?;
        self.seeding = seeding.ok_or_else(|| Error::input("particles: cannot be placed"))?;
        Ok(())
    }

    /// Replaces the seed of all random numbers.
    pub fn reseed(&mut self, seed: u64) {
        (self.spec.seed, self.streams) = (seed, Streams::new(seed));
    }
}
