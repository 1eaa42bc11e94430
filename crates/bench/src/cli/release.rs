//! `microsig release`: makes a challenge from a dataset.

use std::path::PathBuf;

use clap::Args;

use super::Common;
use super::argument::folder;
use super::options::{ImageTables, Replace};
use super::output::{progress, summarize, warn};
use arena::release::{Deadline, Publication, ReleaseOptions, release};
use scenario::Assignment;
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
    /// Pairs or frames of the validation split [default: as many as the dataset has]
    #[arg(long, value_name = "N")]
    val: Option<u32>,
    /// Pairs or frames of the test split [default: as many as the dataset has]
    #[arg(long, value_name = "N")]
    test: Option<u32>,
    /// Change a value of motion or particles in the test split; may be repeated
    #[arg(long, value_name = "PATH=VALUE")]
    test_set: Vec<String>,
    /// Publish the exact times of the test split's frames [default: nominal times, without jitter]
    #[arg(long)]
    exact_times: bool,
    /// Score displacement fields instead of particles, even if train reveals the flow of test
    #[arg(long)]
    fields: bool,
    /// Radius of the matching gate in the image plane [default: the dataset's]
    #[arg(long, value_name = "PX", alias = "gate-xy-px")]
    gate_xy: Option<f64>,
    /// Half height of the gate along z [default: the dataset's]
    #[arg(long, value_name = "UM", alias = "gate-z-um")]
    gate_z: Option<f64>,
    /// Score in 2 or 3 dimensions [default: as the dataset states]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u8).range(2..=3))]
    dims: Option<u8>,
    /// Also write withheld/codabench.zip, a bundle for the Codabench platform
    #[arg(long)]
    codabench: bool,
    /// Python wheel of microsig for the bundle's scoring program [default: microsig is installed in the
    /// container]
    #[arg(long, value_name = "FILE", requires = "codabench")]
    wheel: Option<PathBuf>,
    /// Last day for submissions, such as 2027-03-01: until it has ended everywhere on Earth
    #[arg(long, value_name = "DATE")]
    deadline: Option<Deadline>,
    /// Title of the challenge [default: the dataset's]
    #[arg(long)]
    title: Option<String>,
    /// Author to cite, as `Family, Given` or the name of a group; may be repeated
    #[arg(long, value_name = "NAME")]
    creator: Vec<String>,
    /// Continue an interrupted run, also one with --force and --new-keys; a finished release of this dataset is
    /// left unchanged
    #[arg(long)]
    resume: bool,
    /// With --force: replace a challenge and draw a new secret key, which invalidates everything published of
    /// it
    #[arg(long, conflicts_with = "resume")]
    new_keys: bool,
    /// Version of the challenge [default: 1.0.0]
    #[arg(long, value_name = "TEXT")]
    release_version: Option<String>,
    #[command(flatten)]
    replace: Replace,
    #[command(flatten)]
    tables: ImageTables,
}

impl Release {
    pub(super) fn run(&self, common: &Common) -> Result<()> {
        let about = Publication {
            title: self.title.clone(),
            creators: self.creator.clone(),
            version: self.release_version.clone(),
        };
        let released = release(
            &self.dataset,
            &ReleaseOptions {
                out: self.out.clone(),
                force: self.replace.force,
                resume: self.resume,
                new_keys: self.new_keys,
                val: self.val,
                test: self.test,
                test_set: Assignment::all(&self.test_set)?,
                exact_times: self.exact_times,
                fields: self.fields,
                rules: ScoringRules {
                    gate_xy_px: self.gate_xy,
                    gate_z_um: self.gate_z,
                    dims: self.dims,
                    ..ScoringRules::default()
                },
                codabench: self.codabench,
                wheel: self.wheel.clone(),
                deadline: self.deadline,
                about,
                progress: progress(common),
                context: common.context.clone(),
            },
        )?;
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
