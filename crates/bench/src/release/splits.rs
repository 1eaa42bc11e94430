//! Train, val and test of a challenge: the same scenario, other random numbers.
//!
//! Train is the dataset as it is. Val is drawn from a public seed made from the dataset's, so that anybody can make it
//! again. Test is drawn from a secret key. Velocity fields that are random themselves get a realisation of their own in
//! each split.

use std::path::Path;

use microsig_core::stream::Streams;
use serde_json::Value;

use super::Options;
use crate::dataset::checksums::Fingerprint;
use crate::dataset::manifest::{GENERATOR_VERSION, MANIFEST};
use crate::dataset::secret;
use crate::dataset::verify::verify;
use crate::error::{Error, Result};
use crate::runner::Progress;
use crate::scenario::spec::{Motion, Number, Spec, Timing};
use crate::scenario::{self, Scenario, assignment, resolve, set};

/// What may differ between the public scenario and that of the test split: what participants are not told anyway.
const HIDDEN: [&str; 2] = ["motion.", "particles."];

/// A dataset that a challenge can be made from.
#[derive(Debug)]
pub(super) struct Train {
    pub(super) scenario: Scenario,
    pub(super) manifest: Value,
}

impl Train {
    /// Reads and verifies the dataset.
    pub(super) fn open(dataset: &Path) -> Result<Self> {
        verify(dataset, false, Progress::Hidden)?;
        if secret::streams(dataset)?.is_some() {
            return Err(Error::input(format!(
                "{}: is made from a secret key, so it is no public dataset",
                dataset.display()
            )));
        }
        let path = dataset.join(MANIFEST);
        let text = std::fs::read_to_string(&path).map_err(|e| Error::read(&path, e))?;
        let manifest: Value =
            serde_json::from_str(&text).map_err(|e| Error::input(format!("{}: {e}", path.display())))?;
        let version = manifest["microsig"]["generator_version"].as_str().unwrap_or("another version");
        if version != GENERATOR_VERSION {
            return Err(Error::input(format!(
                "{}: made by microsig {version}, this is {GENERATOR_VERSION}; generate it again",
                dataset.display()
            )));
        }
        let (scenario, _) = scenario::of_dataset(dataset)?;
        check(&scenario)?;
        Ok(Train { scenario, manifest })
    }

    /// The scenario of the validation split.
    pub(super) fn val(&self, dataset: &Path, options: &Options) -> Result<Scenario> {
        let spec = self.sized(options.val)?;
        let seed = derived_seed(spec.seed, "val");
        let mut draws = 0;
        let fields = || {
            draws += 1;
            Ok(derived_seed(seed, &format!("field {draws}")))
        };
        let mut spec = reseeded(spec, fields)?;
        spec.name += "-val";
        spec.seed = seed;
        resolve(spec, dataset)
    }

    /// The scenario of the test split, with a new secret key.
    pub(super) fn test(&self, dataset: &Path, options: &Options) -> Result<Scenario> {
        let mut spec = self.sized(options.test)?;
        for assigned in &options.test_set {
            let (path, value) = assignment(assigned)?;
            if !HIDDEN.iter().any(|part| path.starts_with(part)) {
                return Err(Error::input(format!(
                    "--test-set {assigned}: expected a key of motion or particles; participants are told all others"
                )));
            }
            spec = set(&spec, path, value)?;
        }
        // Participants calibrate with the stack of the train split; a secret one would be of no use.
        spec = set(&spec, "calibration", "none")?;
        let mut spec = reseeded(spec, || {
            let [a, b, c, d, e, f, g, h, ..] = secret::draw()?;
            Ok(u64::from_le_bytes([a, b, c, d, e, f, g, h]))
        })?;
        spec.name += "-test";
        spec.seed = 0;
        let mut scenario = resolve(spec, dataset)?;
        check(&scenario)?;
        scenario.streams = Streams::secret(secret::draw()?);
        Ok(scenario)
    }

    /// The scenario with another number of pairs or frames.
    fn sized(&self, count: Option<u32>) -> Result<Spec> {
        let spec = &self.scenario.spec;
        let Some(count) = count else { return Ok(spec.clone()) };
        let path = match spec.timing {
            Timing::Sequence(_) => "timing.sequence.frames".to_owned(),
            other => format!("timing.{}.count", other.mode()),
        };
        set(spec, &path, &count.to_string())
    }
}

/// Refuses scenarios whose truth is no secret, whatever the random numbers.
fn check(scenario: &Scenario) -> Result<()> {
    let known = |what: &str| {
        Err(Error::input(format!(
            "{}: {what}, so the train split would tell the truth of the test split",
            scenario.spec.name
        )))
    };
    if matches!(scenario.spec.particles.number, Some(Number::File(_))) {
        return known("particles are placed by a file");
    }
    match scenario.spec.motion {
        Motion::Flow(_) => Ok(()),
        Motion::Tracks(_) => known("particles follow recorded tracks"),
    }
}

/// A seed made from another one, of its own for each name.
pub fn derived_seed(seed: u64, name: &str) -> u64 {
    let digest = Fingerprint::of(format!("microsig release\nseed={seed}\n{name}\n").as_bytes()).sha256;
    let (first, _) = digest.0.as_chunks();
    first.first().map_or(seed, |first| u64::from_be_bytes(*first))
}

/// The scenario with new seeds of its random velocity fields.
fn reseeded(mut spec: Spec, mut draw: impl FnMut() -> Result<u64>) -> Result<Spec> {
    match &mut spec.motion {
        Motion::Flow(flow) => flow.field.reseed(&mut draw)?,
        Motion::Tracks(_) => {}
    }
    Ok(spec)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scenario::{compact, parse};

    #[test]
    fn every_random_field_gets_a_seed_of_its_own() {
        let text = r#"(name: "sum", timing: pairs(count: 1), motion: flow(field: sum([
            kraichnan(seed: 5), uniform(), scaled(field: kraichnan(seed: 5), by: (velocity_factor: 2)),
        ])))"#;
        let mut n = 100;
        let draw = || {
            n += 1;
            Ok(n)
        };
        let motion = compact(&reseeded(parse(text, "s.ron").unwrap(), draw).unwrap().motion).unwrap();
        assert!(!motion.contains("seed: 5") && !motion.contains("seed:5"), "{motion}");
        assert!(motion.contains("101") && motion.contains("102"), "{motion}");
    }

    #[test]
    fn derived_seeds_differ_by_seed_and_name() {
        let seeds = [derived_seed(1, "val"), derived_seed(2, "val"), derived_seed(1, "test")];
        assert!(seeds[0] != seeds[1] && seeds[0] != seeds[2] && seeds[1] != seeds[2]);
        assert_eq!(derived_seed(1, "val"), seeds[0]);
    }
}
