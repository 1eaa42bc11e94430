//! The splits of a challenge (train, val, test): the same scenario with different random numbers.
//!
//! Train is the dataset itself. Val uses a public seed derived from the dataset's, so that anybody can
//! regenerate it. Test uses a secret key. Random velocity fields get an independent realization in each
//! split.

use std::path::Path;

use microsig_core::stream::Streams;

use super::ReleaseOptions;
use generator::dataset::manifest::{GENERATOR_VERSION, Manifest};
use generator::dataset::secret;
use generator::runner::Progress;
use generator::runner::verify;
use scenario::spec::{Motion, Number, Spec, Timing};
use scenario::{self, Scenario, assignment, resolve, set};
use storage::checksums::Fingerprint;
use storage::error::{Error, Result};

/// Sections of the scenario that may differ in the test split; they are withheld from participants.
const HIDDEN: [&str; 2] = ["motion.", "particles."];

/// A dataset from which a challenge is made.
#[derive(Debug)]
pub(super) struct Train {
    pub(super) scenario: Scenario,
    pub(super) manifest: Manifest,
}

impl Train {
    /// Reads and verifies the dataset.
    pub(super) fn open(dataset: &Path) -> Result<Self> {
        verify(dataset, false, Progress::Hidden)?;
        if secret::streams(dataset)?.is_some() {
            return Err(Error::input(format!(
                "{}: was generated with a secret key, so it is not a public dataset",
                dataset.display()
            )));
        }
        let manifest = Manifest::read(dataset)?;
        let version = manifest.microsig.generator_version.as_deref().unwrap_or("another version");
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
    pub(super) fn val(&self, dataset: &Path, options: &ReleaseOptions) -> Result<Scenario> {
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
    pub(super) fn test(&self, dataset: &Path, options: &ReleaseOptions) -> Result<Scenario> {
        let mut spec = self.sized(options.test)?;
        for assigned in &options.test_set {
            let (path, value) = assignment(assigned)?;
            if !HIDDEN.iter().any(|part| path.starts_with(part)) {
                return Err(Error::input(format!(
                    "--test-set {assigned}: expected a key of motion or particles; all other keys are known to participants"
                )));
            }
            spec = set(&spec, path, value)?;
        }
        // Participants calibrate with the stack of the train split, so the test split has none.
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

    /// The scenario with `count` pairs or frames.
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

/// Refuses scenarios whose truth does not depend on random numbers.
fn check(scenario: &Scenario) -> Result<()> {
    let known = |what: &str| {
        Err(Error::input(format!(
            "{}: {what}, so the train split would reveal the truth of the test split",
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

/// A seed derived from another one, different for each name.
pub fn derived_seed(seed: u64, name: &str) -> u64 {
    let digest = Fingerprint::of(format!("microsig release\nseed={seed}\n{name}\n").as_bytes()).sha256;
    let (first, _) = digest.0.as_chunks();
    first.first().map_or(seed, |first| u64::from_be_bytes(*first))
}

/// The scenario with new seeds for its random velocity fields.
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
    use scenario::{compact, parse};

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
