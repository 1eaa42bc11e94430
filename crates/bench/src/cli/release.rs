//! `microsig release`: makes a challenge from a dataset.

use std::path::PathBuf;

use clap::Args;

use super::Common;
use super::options::ImageTables;
use super::output::{progress, summarize, warn};
use arena::release::{ReleaseOptions, release};
use scenario::Assignment;
use storage::argument::folder;
use storage::dataset::manifest::ScoringRules;
use storage::error::Result;

/// Make a challenge: a public package and the withheld truth
#[derive(Debug, Args)]
#[command(
    long_about = "Make a challenge: a public package and the withheld truth.\n\nTrain is DATASET, unchanged. Val is the same scenario \
    drawn with a public seed derived from that of the dataset, with truth. Test is the same scenario drawn with a secret 256-bit key from \
    the operating system; its package holds images, calibration and a submission template, but no truth. Publish OUT/public \
    unchanged and keep OUT/withheld: submissions are scored against OUT/withheld/test. After the deadline, `microsig reveal` writes its \
    truth for publication; it verifies against public/commitment.sha256.",
    after_help = "Example: microsig release datasets/quickstart --out challenges/quickstart --creator 'Doe, Jane'"
)]
pub(super) struct Release {
    /// The dataset's folder; it becomes the train split
    dataset: PathBuf,
    /// Folder of the release
    #[arg(long, short, value_name = "DIR", value_parser = folder())]
    out: PathBuf,
    /// Change a value of motion or particles in the test split; may be repeated
    #[arg(long, value_name = "PATH=VALUE")]
    test_set: Vec<String>,
    /// Radius of the matching gate in the image plane [default: the dataset's]
    #[arg(long, value_name = "PX", alias = "gate-xy-px")]
    gate_xy: Option<f64>,
    /// Half height of the gate along z [default: the dataset's]
    #[arg(long, value_name = "UM", alias = "gate-z-um")]
    gate_z: Option<f64>,
    /// Score in 2 or 3 dimensions [default: as the dataset states]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u8).range(2..=3))]
    dims: Option<u8>,
    #[command(flatten)]
    options: ReleaseOptions,
    #[command(flatten)]
    tables: ImageTables,
}

impl Release {
    pub(super) fn run(&self, common: &Common) -> Result<()> {
        let mut options = ReleaseOptions {
            out: self.out.clone(),
            test_set: Assignment::all(&self.test_set)?,
            rules: ScoringRules {
                gate_xy_px: self.gate_xy,
                gate_z_um: self.gate_z,
                dims: self.dims,
                ..ScoringRules::default()
            },
            ..self.options.clone()
        };
        options.challenge.progress = progress(common);
        options.challenge.context = common.context.clone();
        let released = release(&self.dataset, &options)?;
        let Some(released) = released else {
            let text = format!("the challenge already exists in {}", self.out.display());
            return summarize(&text, &serde_json::json!({ "out": self.out }), common);
        };
        warn(&released.warnings, common);
        let [train, val, test] = released.images;
        let text = format!(
            "challenge {}: {train} + {val} + {test} images (train, val, test) in {:.2} s; publish {}, keep {} private",
            released.name,
            released.seconds,
            released.out.join("public").display(),
            released.out.join("withheld").display()
        );
        summarize(&text, &released, common)
    }
}
