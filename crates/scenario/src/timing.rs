//! Times of the frames in scenarios.

use flows::Shutter;
use microsig_core::problem::Problems;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::findings::Collect;

/// Maximum number of frames in a dataset.
const MAX_FRAMES: u32 = 10_000_000;

/// Longest time, s.
const LONGEST: f64 = 1e9;

/// Length of the segments that streaks are divided into, px.
const SEGMENT_PX: f64 = 0.25;

/// Times at which frames are recorded.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Timing {
    /// Independent image pairs.
    Pairs(Pairs),
    /// A time-resolved sequence of frames of the same particles.
    Sequence(Sequence),
    /// Independently seeded bursts of four frames, at 0, dt, dt + gap and 2 dt + gap.
    FourPulse(FourPulse),
}

/// Image pairs.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Pairs {
    /// Number of pairs.
    #[schemars(range(min = 1, max = MAX_FRAMES / 2), example = 10)]
    pub count: u32,
    /// Time between frames A and B.
    #[serde(default = "default_dt")]
    #[schemars(extend("exclusiveMinimum" = 0, "maximum" = LONGEST))]
    pub dt_s: f64,
    /// Time between the A frames of consecutive pairs; only relevant for unsteady fields and for `seeding:
    /// continuing`.
    #[serde(default)]
    #[schemars(extend("minimum" = 0, "maximum" = LONGEST))]
    pub interval_s: f64,
    /// Whether consecutive pairs show the same particles.
    #[serde(default)]
    pub seeding: PairSeeding,
    /// Exposure time; particle images become streaks, and the time of a frame is the middle of its exposure.
    /// 0: instantaneous.
    #[serde(default)]
    #[schemars(extend("minimum" = 0, "maximum" = LONGEST))]
    pub exposure_s: f64,
    /// Flashes per frame, if there is more than one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub flashes: Option<Flashes>,
    /// Standard deviation of the frame times (timing jitter); at most a tenth of the time between frames.
    #[serde(default)]
    #[schemars(extend("minimum" = 0, "maximum" = LONGEST))]
    pub jitter_s: f64,
}

impl Pairs {
    /// Independent pairs with defaults for all other keys.
    pub fn new(count: u32, dt_s: f64) -> Self {
        let (exposure_s, flashes, jitter_s) = (0.0, None, 0.0);
        Pairs { count, dt_s, interval_s: 0.0, seeding: PairSeeding::Fresh, exposure_s, flashes, jitter_s }
    }
}

/// Whether consecutive pairs show the same particles.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum PairSeeding {
    /// Every pair is seeded independently.
    #[default]
    Fresh,
    /// The same particles continue from pair to pair, `interval_s` apart.
    Continuing,
}

/// A time-resolved sequence.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Sequence {
    /// Number of frames.
    #[schemars(range(min = 1, max = MAX_FRAMES), example = 20)]
    pub frames: u32,
    /// Time between frames.
    #[serde(default = "default_dt")]
    #[schemars(extend("exclusiveMinimum" = 0, "maximum" = LONGEST))]
    pub dt_s: f64,
    /// Exposure time; particle images become streaks, and the time of a frame is the middle of its exposure.
    /// 0: instantaneous.
    #[serde(default)]
    #[schemars(extend("minimum" = 0, "maximum" = LONGEST))]
    pub exposure_s: f64,
    /// Flashes per frame, if there is more than one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub flashes: Option<Flashes>,
    /// Standard deviation of the frame times (timing jitter); at most a tenth of the time between frames.
    #[serde(default)]
    #[schemars(extend("minimum" = 0, "maximum" = LONGEST))]
    pub jitter_s: f64,
}

impl Sequence {
    /// A sequence with defaults for all other keys.
    pub fn new(frames: u32, dt_s: f64) -> Self {
        Sequence { frames, dt_s, exposure_s: 0.0, flashes: None, jitter_s: 0.0 }
    }
}

/// Bursts of four frames at 0, dt, dt + gap and 2 dt + gap.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct FourPulse {
    /// Number of bursts.
    #[schemars(range(min = 1, max = MAX_FRAMES / 4), example = 5)]
    pub count: u32,
    /// Time from the first frame to the second, and from the third to the fourth.
    #[serde(default = "default_dt")]
    #[schemars(extend("exclusiveMinimum" = 0, "maximum" = LONGEST))]
    pub dt_s: f64,
    /// Time from the second frame to the third.
    #[serde(default = "default_gap")]
    #[schemars(extend("exclusiveMinimum" = 0, "maximum" = LONGEST))]
    pub gap_s: f64,
    /// Time between the first frames of consecutive bursts.
    #[serde(default)]
    #[schemars(extend("minimum" = 0, "maximum" = LONGEST))]
    pub interval_s: f64,
    /// Exposure time; particle images become streaks, and the time of a frame is the middle of its exposure.
    /// 0: instantaneous.
    #[serde(default)]
    #[schemars(extend("minimum" = 0, "maximum" = LONGEST))]
    pub exposure_s: f64,
    /// Flashes per frame, if there is more than one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub flashes: Option<Flashes>,
    /// Standard deviation of the frame times (timing jitter); at most a tenth of the time between frames.
    #[serde(default)]
    #[schemars(extend("minimum" = 0, "maximum" = LONGEST))]
    pub jitter_s: f64,
}

/// Flashes within one frame.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Flashes {
    /// Number of flashes per frame.
    #[schemars(range(min = 1, max = 100), example = 2)]
    pub count: u32,
    /// Time between flashes.
    #[schemars(extend("minimum" = 0, "maximum" = LONGEST), example = 0.001)]
    pub spacing_s: f64,
}

/// The default time between frames gives a displacement of 10 px at the default speed of 1290 um/s with
/// setting 1.
fn default_dt() -> f64 {
    0.005
}

/// Twice the default `dt_s`.
fn default_gap() -> f64 {
    0.01
}

impl Timing {
    /// What all timing modes have: exposure time (s), flashes per frame if there is more than one, standard
    /// deviation of the frame times (s).
    pub(super) fn exposure(&self) -> (f64, Option<Flashes>, f64) {
        match *self {
            Timing::Pairs(Pairs { exposure_s, flashes, jitter_s, .. })
            | Timing::Sequence(Sequence { exposure_s, flashes, jitter_s, .. })
            | Timing::FourPulse(FourPulse { exposure_s, flashes, jitter_s, .. }) => {
                (exposure_s, flashes, jitter_s)
            }
        }
    }

    /// Name of the mode in keys and in the manifest.
    pub fn mode(&self) -> &'static str {
        match self {
            Timing::Pairs(_) => "pairs",
            Timing::Sequence(_) => "sequence",
            Timing::FourPulse(_) => "four_pulse",
        }
    }

    /// The shutter; `None` if exposures are instantaneous.
    pub(super) fn shutter(&self, um_per_px: f64, problems: &mut Problems) -> Option<Shutter> {
        let (exposure_s, flashes, _) = self.exposure();
        let Flashes { count, spacing_s } = flashes.unwrap_or(Flashes { count: 1, spacing_s: 0.0 });
        let shutter = Shutter::new(exposure_s, count, spacing_s, SEGMENT_PX * um_per_px);
        problems.of(&format!("timing.{}", self.mode()), shutter).filter(|shutter| shutter.span_s() > 0.0)
    }
}
