//! Suites: tracks of cases, each with the splits train, val and test, in three sizes.
//!
//! A suite file lists scenarios and sweeps next to it, with the language, seeds and messages of
//! `generate` and `sweep`. A case is a scenario, or a case of a sweep, with the splits of a challenge.

mod read;
mod spec;

use std::path::{Path, PathBuf};
use std::sync::Arc;

pub use read::suite_schema;
pub use spec::{AxisLabel, LadderSpec, Size, SizeSpec, Sizes, SuiteSpec, TrackSpec};

pub use storage::dataset::manifest::Metric;
use storage::dataset::manifest::{ScoringRules, SuitePlace};

use super::load::{Assignment, set};
use super::shipped::{SHIPPED, shipped_suites};
use super::source::read_text;
use super::spec::Spec;
use super::splits::Split;
use storage::{Error, InputFile, Result, TemporaryFolder, advice};

/// Name of a suite file.
pub const SUITE: &str = "suite.ron";

/// A valid suite.
#[derive(Debug, Clone)]
pub struct Suite {
    /// The suite file.
    pub spec: SuiteSpec,
    /// Folder of the suite file.
    pub folder: PathBuf,
    /// Whether it is a suite that is embedded in the program, unpacked into a temporary folder.
    pub is_shipped: bool,
    /// The cases of each ladder of each track, in order.
    rungs: Vec<Vec<Vec<Rung>>>,
    _unpacked: Option<Arc<TemporaryFolder>>,
}

/// A case before a size is chosen.
#[derive(Debug, Clone)]
struct Rung {
    name: String,
    axes: Vec<AxisValue>,
    spec: Spec,
    inputs: PathBuf,
}

/// Value of an axis of a case.
#[derive(Debug, Clone, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct AxisValue {
    /// Name of the quantity.
    pub label: String,
    /// Its value, as shown.
    pub shown: String,
    /// Its value, if it is a number.
    pub number: Option<f64>,
}

/// A case of a suite at one size.
#[derive(Debug, Clone)]
pub struct SuiteCase {
    /// Name of its track.
    pub track: String,
    /// Name of its ladder.
    pub ladder: String,
    /// Its name, unique in the track.
    pub name: String,
    /// The values that distinguish it from other cases of its ladder.
    pub axes: Vec<AxisValue>,
    /// How it is scored and ranked.
    pub rules: ScoringRules,
    /// Number of pairs, frames or bursts of train, val and test.
    pub counts: [u32; 3],
    /// The scenario of train, with the changes of the size.
    spec: Spec,
    /// Folder that paths in the scenario are relative to.
    pub inputs: PathBuf,
}

impl SuiteCase {
    /// The scenario of a split.
    pub fn scenario(&self, split: Split) -> Result<Spec> {
        let at = Split::ALL.iter().position(|one| *one == split).unwrap_or(0);
        split.scenario(&self.spec, Some(self.counts[at]))
    }

    /// Name of the dataset of train; the others have `-val` and `-test` appended.
    pub fn dataset(&self) -> &str {
        &self.spec.name
    }

    /// Its folder in a generated suite.
    pub fn folder(&self) -> String {
        format!("{}/{}", self.track, self.name)
    }

    /// The folder of one of its datasets.
    pub fn split_folder(&self, split: Split) -> String {
        format!("{}/{}", self.folder(), split.name())
    }
}

impl Suite {
    /// Reads a suite: a file, a folder with a `suite.ron`, or the name of an embedded suite. Errors: a file
    /// that cannot be read; all problems of the suite and of its scenarios and sweeps, each with file and
    /// line.
    pub fn open(suite: impl Into<InputFile>) -> Result<Self> {
        let suite = suite.into();
        let file = if suite.is_dir() { suite.join(SUITE).into() } else { suite.clone() };
        if file.exists() || file.is_standard() {
            let folder = file.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
            return Suite::parse(&read_text(&file)?, &file.display().to_string(), folder);
        }
        let name = suite.to_str().unwrap_or_default();
        let known = shipped_suites();
        let Some(files) = SHIPPED.get_dir(name).filter(|_| known.contains(&name)) else {
            let path = suite.display();
            let known = known.join(", ");
            return Err(Error::input(format!("{path}: no such file, folder or shipped suite ({known})")));
        };
        let place = TemporaryFolder::new()?;
        let folder = place.path().join(name);
        std::fs::create_dir(&folder).map_err(Error::write(&folder))?;
        files.extract(place.path()).map_err(Error::write(&folder))?;
        let mut suite = Suite::parse(&read_text(folder.join(SUITE))?, &format!("{name}/{SUITE}"), &folder)?;
        (suite.is_shipped, suite._unpacked) = (true, Some(Arc::new(place)));
        Ok(suite)
    }

    /// Reads a suite from a text; `name` is its name in messages, and paths in it are relative to `folder`.
    pub fn parse(text: &str, name: &str, folder: &Path) -> Result<Self> {
        read::parse(text, name, folder)
    }

    /// A track, by name. Errors: [`Error::Input`] with the names of the tracks.
    pub fn track(&self, name: &str) -> Result<&TrackSpec> {
        self.spec.tracks.iter().find(|track| track.name == name).ok_or_else(|| {
            let names: Vec<&str> = self.spec.tracks.iter().map(|track| track.name.as_str()).collect();
            let what = format!(": expected one of {}", names.join(", "));
            Error::option(advice!(advice::option("track").is(name), what))
        })
    }

    /// All cases of a size, in order. Errors: a change of the size that does not fit a scenario.
    pub fn cases(&self, size: Size) -> Result<Vec<SuiteCase>> {
        let mut cases = Vec::new();
        for (track, ladders) in self.spec.tracks.iter().zip(&self.rungs) {
            for (ladder, rungs) in track.ladders.iter().zip(ladders) {
                let size_spec = ladder.sizes.as_ref().unwrap_or(&track.sizes).of(size);
                for rung in rungs {
                    if ladder.only(size).is_some_and(|only| !only.contains(&rung.name)) {
                        continue;
                    }
                    let mut spec = rung.spec.clone();
                    for assigned in &size_spec.set {
                        let Assignment { path, value } = assigned.parse()?;
                        spec = set(&spec, &path, &value)?;
                    }
                    spec.name = format!("{}-{}-{}", self.spec.name, track.name.to_lowercase(), rung.name);
                    let dims = ladder.dims.or(track.dims);
                    let rules = ScoringRules {
                        gate_xy_px: track.gate_xy_px,
                        gate_z_um: track.gate_z_um.filter(|_| dims != Some(2)),
                        dims,
                        rank_by: ladder.rank_by.as_ref().unwrap_or(&track.rank_by).clone(),
                        suite: Some(SuitePlace {
                            name: self.spec.name.clone(),
                            version: self.spec.version.clone(),
                            size: size.name().to_owned(),
                            track: track.name.clone(),
                            case: rung.name.clone(),
                        }),
                    };
                    spec.scoring = Some(rules.clone());
                    cases.push(SuiteCase {
                        track: track.name.clone(),
                        ladder: ladder.name.clone(),
                        name: rung.name.clone(),
                        axes: rung.axes.clone(),
                        rules,
                        counts: [size_spec.train, size_spec.val, size_spec.test],
                        spec,
                        inputs: rung.inputs.clone(),
                    });
                }
            }
        }
        Ok(cases)
    }
}
