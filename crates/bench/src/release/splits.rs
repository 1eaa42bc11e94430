//! The splits of a challenge (train, val, test): the same scenario with different random numbers.
//!
//! Train is the dataset itself. Val uses a public seed derived from the dataset's, so that anybody can
//! regenerate it. Test uses a secret key. Random velocity fields get an independent realization in each
//! split.

use std::path::Path;

use microsig_core::stream::Streams;

use super::ReleaseOptions;
use dataset::manifest::{GENERATOR_VERSION, Manifest};
use generator::dataset::secret;
use generator::runner::Progress;
use generator::runner::verify;
use scenario::spec::{Motion, Number};
use scenario::{self, Scenario, Split, assignment, reseeded, resolve, set, sized};
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
        resolve(Split::Val.scenario(&self.scenario.spec, options.val)?, dataset)
    }

    /// The scenario of the test split, with a new secret key.
    pub(super) fn test(&self, dataset: &Path, options: &ReleaseOptions) -> Result<Scenario> {
        let mut spec = sized(&self.scenario.spec, options.test)?;
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
