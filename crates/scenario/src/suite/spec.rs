//! The keys of a suite file.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use storage::advice;
use storage::dataset::manifest::Metric;

/// A suite: a frozen, named set of datasets in tracks, by which trackers are compared.
#[derive(Debug, Clone, Serialize, Deserialize, JsonSchema)]
pub struct SuiteSpec {
    /// Name of the suite; the names of its datasets begin with it.
    #[schemars(example = &"stand-in")]
    pub name: String,
    /// Version of the suite; it changes whenever the bytes of a dataset change.
    #[schemars(example = &"0")]
    pub version: String,
    /// Title, in one line.
    #[serde(default)]
    pub title: String,
    /// Purpose of the suite.
    #[serde(default)]
    pub description: String,
    /// Its tracks.
    #[schemars(length(min = 1), example = Vec::<TrackSpec>::new())]
    pub tracks: Vec<TrackSpec>,
}

/// A track: cases that are ranked by the same scores.
#[derive(Debug, Clone, Serialize, Deserialize, JsonSchema)]
pub struct TrackSpec {
    /// Name of the track and of its folder.
    pub name: String,
    /// Title, in one line.
    pub title: String,
    /// The scores by which trackers are ranked, in order of priority.
    #[schemars(length(min = 1))]
    pub rank_by: Vec<Metric>,
    /// Radius of the matching gate in the image plane, px; by default as for `evaluate`.
    #[serde(default)]
    #[schemars(range(min = 1e-6, max = 1000))]
    pub gate_xy_px: Option<f64>,
    /// Half-height of the matching gate along z, um; by default a tenth of the depth range.
    #[serde(default)]
    #[schemars(range(min = 1e-6, max = 1e6))]
    pub gate_z_um: Option<f64>,
    /// Dimensions in which particles are scored; by default 3 if truth and result have depth.
    #[serde(default)]
    #[schemars(range(min = 2, max = 3))]
    pub dims: Option<u8>,
    /// The sizes of the track's datasets.
    pub sizes: Sizes,
    /// Its cases: scenarios and sweeps.
    #[schemars(length(min = 1))]
    pub ladders: Vec<LadderSpec>,
}

/// Numbers of frames and other changes for each size of a suite.
#[derive(Debug, Clone, Serialize, Deserialize, JsonSchema)]
pub struct Sizes {
    /// For tests: runs in seconds.
    pub smoke: SizeSpec,
    /// For a laptop: runs in minutes.
    pub small: SizeSpec,
    /// For publications.
    pub full: SizeSpec,
}

/// Size of the datasets of a case.
#[derive(Debug, Clone, Serialize, Deserialize, JsonSchema)]
pub struct SizeSpec {
    /// Image pairs, frames or bursts of train.
    #[schemars(range(min = 1, max = 10_000_000))]
    pub train: u32,
    /// Image pairs, frames or bursts of val.
    #[schemars(range(min = 1, max = 10_000_000))]
    pub val: u32,
    /// Image pairs, frames or bursts of test.
    #[schemars(range(min = 1, max = 10_000_000))]
    pub test: u32,
    /// Values of the scenario that this size replaces, `path=value`.
    #[serde(default)]
    pub set: Vec<String>,
}

/// Cases that differ in a few parameters: the cases of a sweep, or a single scenario.
#[derive(Debug, Clone, Serialize, Deserialize, JsonSchema)]
pub struct LadderSpec {
    /// Name of the ladder.
    pub name: String,
    /// Title, in one line.
    pub title: String,
    /// Its sweep or scenario: a file, relative to the suite file.
    pub from: String,
    /// Names of the cases; each `{}` is replaced by the value of an axis, in order. By default the name of
    /// the ladder, followed by the values.
    #[serde(default)]
    pub case: Option<String>,
    /// Dimensions in which particles are scored; by default as for the track.
    #[serde(default)]
    #[schemars(range(min = 2, max = 3))]
    pub dims: Option<u8>,
    /// The scores by which its cases are ranked; by default as for the track.
    #[serde(default)]
    #[schemars(length(min = 1), example = vec![Metric::F1])]
    pub rank_by: Option<Vec<Metric>>,
    /// Labels and factors with which the values of the axes are shown; by default as in the sweep.
    #[serde(default)]
    pub labels: Vec<AxisLabel>,
    /// The cases of size smoke, by name; by default all.
    #[serde(default)]
    pub smoke: Option<Vec<String>>,
    /// The cases of size small, by name; by default all.
    #[serde(default)]
    pub small: Option<Vec<String>>,
    /// Sizes, if they differ from the track's.
    #[serde(default)]
    pub sizes: Option<Sizes>,
}

/// Label of an axis of a sweep.
#[derive(Debug, Clone, Serialize, Deserialize, JsonSchema)]
pub struct AxisLabel {
    /// Name of the quantity.
    pub name: String,
    /// Factor from the key's value to the quantity, for example 0.1 from counts to SNR at a noise of 10
    /// counts.
    #[serde(default = "one")]
    #[schemars(extend("exclusiveMinimum" = 0, "maximum" = 1e9))]
    pub factor: f64,
}

fn one() -> f64 {
    1.0
}

/// Size of a suite.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Size {
    /// For tests: runs in seconds.
    Smoke,
    /// For a laptop: runs in minutes.
    Small,
    /// For publications.
    Full,
}

impl Size {
    /// All sizes.
    pub const ALL: [Size; 3] = [Size::Smoke, Size::Small, Size::Full];

    /// Its name.
    pub fn name(self) -> &'static str {
        match self {
            Size::Smoke => "smoke",
            Size::Small => "small",
            Size::Full => "full",
        }
    }

    /// The size with this name.
    pub fn parse(name: &str) -> storage::Result<Self> {
        let found = Size::ALL.into_iter().find(|size| size.name() == name);
        found.ok_or_else(|| {
            storage::Error::option(advice!(
                advice::option("size").is(name),
                ": expected smoke, small or full"
            ))
        })
    }
}

impl Sizes {
    /// The specification of a size.
    pub fn of(&self, size: Size) -> &SizeSpec {
        match size {
            Size::Smoke => &self.smoke,
            Size::Small => &self.small,
            Size::Full => &self.full,
        }
    }
}

impl LadderSpec {
    /// Names of the cases that a size has; `None`: all.
    pub fn only(&self, size: Size) -> Option<&[String]> {
        match size {
            Size::Smoke => self.smoke.as_deref(),
            Size::Small => self.small.as_deref(),
            Size::Full => None,
        }
    }
}
