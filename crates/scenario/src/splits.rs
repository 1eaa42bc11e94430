//! The splits of a benchmark (train, val, test): the same scenario with different random numbers.
//!
//! Train is the scenario itself. The seeds of val and of a public test split follow from its seed, so that
//! anyone can generate them. Random velocity fields have an independent realization in each split.

use storage::checksums::Fingerprint;
use storage::{Error, Result, advice};

use super::load::set;
use super::spec::{Motion, Spec, Timing};

/// A split of a benchmark.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Split {
    /// For training and calibration.
    Train,
    /// For choosing parameters.
    Val,
    /// For comparing trackers.
    Test,
}

impl Split {
    /// All splits, in order.
    pub const ALL: [Split; 3] = [Split::Train, Split::Val, Split::Test];

    /// Name of the split.
    pub fn name(self) -> &'static str {
        match self {
            Split::Train => "train",
            Split::Val => "val",
            Split::Test => "test",
        }
    }

    /// The split with this name.
    pub fn parse(name: &str) -> Result<Self> {
        let found = Split::ALL.into_iter().find(|split| split.name() == name);
        found.ok_or_else(|| {
            Error::option(advice!(advice::option("split").is(name), ": expected train, val or test"))
        })
    }

    /// The scenario of this split with a public seed, with `count` pairs or frames (`None`: as many as the
    /// scenario has). `spec` is the scenario of train.
    pub fn scenario(self, spec: &Spec, count: Option<u32>) -> Result<Spec> {
        let spec = sized(spec, count)?;
        if self == Split::Train {
            return Ok(spec);
        }
        let seed = derived_seed(spec.seed, self.name());
        let mut draws = 0;
        let fields = || {
            draws += 1;
            Ok(derived_seed(seed, &format!("field {draws}")))
        };
        let mut spec = reseeded(spec, fields)?;
        spec.name += &format!("-{}", self.name());
        spec.seed = seed;
        Ok(spec)
    }
}

/// The scenario with `count` pairs, frames or bursts.
pub fn sized(spec: &Spec, count: Option<u32>) -> Result<Spec> {
    let Some(count) = count else { return Ok(spec.clone()) };
    let path = match spec.timing {
        Timing::Sequence(_) => "timing.sequence.frames".to_owned(),
        other => format!("timing.{}.count", other.mode()),
    };
    set(spec, &path, &count.to_string())
}

/// A seed derived from another one, different for each name.
pub fn derived_seed(seed: u64, name: &str) -> u64 {
    let digest = Fingerprint::of(format!("microsig release\nseed={seed}\n{name}\n").as_bytes()).sha256;
    let (first, _) = digest.0.as_chunks();
    first.first().map_or(seed, |first| u64::from_be_bytes(*first))
}

/// The scenario with new seeds for its random velocity fields.
pub fn reseeded(mut spec: Spec, mut draw: impl FnMut() -> Result<u64>) -> Result<Spec> {
    match &mut spec.motion {
        Motion::Flow(flow) => flow.field.reseed(&mut draw)?,
        Motion::Tracks(_) | Motion::Own(_) => {}
    }
    Ok(spec)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{compact, parse};

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

    #[test]
    fn splits_have_names_seeds_and_sizes_of_their_own() {
        let text =
            r#"(name: "a", seed: 7, motion: flow(field: kraichnan(seed: 5)), timing: sequence(frames: 9))"#;
        let spec = parse(text, "a.ron").unwrap();
        let [train, val, test] = Split::ALL.map(|split| split.scenario(&spec, Some(4)).unwrap());
        assert_eq!([&train.name, &val.name, &test.name], ["a", "a-val", "a-test"]);
        assert_eq!([train.seed, val.seed, test.seed], [7, derived_seed(7, "val"), derived_seed(7, "test")]);
        assert!(compact(&train.motion).unwrap() != compact(&val.motion).unwrap());
        assert!(matches!(test.timing, Timing::Sequence(timing) if timing.frames == 4));
        assert!(Split::Val.scenario(&spec, Some(0)).is_err());
    }
}
