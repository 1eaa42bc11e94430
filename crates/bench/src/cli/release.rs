//! `microsig release`: makes a challenge from a dataset.

use std::path::PathBuf;

use clap::Args;

use super::Common;
use super::output::{progress, report, warn};
use crate::release::{Publication, ReleaseOptions, release};
use storage::error::Result;

/// A public challenge package and its withheld truth
#[derive(Debug, Args)]
#[command(
    long_about = "A public challenge package and its withheld truth.\n\nTrain is DATASET as it is. Val is the same scenario \
drawn from a public seed made from the dataset's, with truth. Test is the same scenario drawn from a secret key of 256 bits from the \
operating system: its package holds images, calibration and a template for submissions, no truth. OUT/public is to be \
published as it is, OUT/withheld to be kept: submissions are scored on OUT/withheld/test, and its truth is published after the \
deadline and verifies against public/commitment.sha256.",
    after_help = "Example: microsig release datasets/quickstart --out challenges/quickstart --creator 'Doe, Jane'"
)]
pub(super) struct Release {
    /// The dataset's folder; it becomes the train split
    dataset: PathBuf,
    /// The release's folder
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// Pairs or frames of the validation split [default: as many as the dataset has]
    #[arg(long, value_name = "N")]
    val: Option<u32>,
    /// Pairs or frames of the test split [default: as many as the dataset has]
    #[arg(long, value_name = "N")]
    test: Option<u32>,
    /// A value of motion or particles that differs in the test split; may be given several times
    #[arg(long, value_name = "PATH=VALUE")]
    test_set: Vec<String>,
    /// State the exact times of the test split's frames [default: the nominal ones, without jitter]
    #[arg(long)]
    exact_times: bool,
    /// Score displacement fields instead of particles, even if train reveals the flow of test
    #[arg(long)]
    fields: bool,
    /// Also write withheld/codabench.zip, a bundle for the platform Codabench
    #[arg(long)]
    codabench: bool,
    /// The Python wheel of microsig, for the bundle's scoring program [default: the container has microsig]
    #[arg(long, value_name = "FILE", requires = "codabench")]
    wheel: Option<PathBuf>,
    /// Title of the challenge [default: the dataset's]
    #[arg(long)]
    title: Option<String>,
    /// Who is cited, `Family, Given` or a group's name; may be given several times
    #[arg(long, value_name = "NAME")]
    creator: Vec<String>,
    /// Leave a finished release of this dataset as it is
    #[arg(long)]
    resume: bool,
    /// With --force: replace a challenge and draw a new secret key; what has been published of it no longer
    /// holds
    #[arg(long)]
    new_keys: bool,
    /// Version of the challenge
    #[arg(long, value_name = "TEXT", default_value = "1.0.0")]
    release_version: String,
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
                force: common.force,
                resume: self.resume,
                new_keys: self.new_keys,
                val: self.val,
                test: self.test,
                test_set: self.test_set.clone(),
                exact_times: self.exact_times,
                fields: self.fields,
                codabench: self.codabench,
                wheel: self.wheel.clone(),
                about,
                progress: progress(common),
            },
        )?;
        let Some(released) = released else {
            let text = format!("the challenge is there already, in {}", self.out.display());
            return report(&text, &serde_json::json!({ "out": self.out }), common);
        };
        warn(&released.warnings, common);
        let [train, val, test] = released.images;
        let text = format!(
            "challenge {}: {train} + {val} + {test} images (train, val, test) in {:.2} s; publish {}, keep {} to yourself",
            released.name,
            released.seconds,
            released.out.join("public").display(),
            released.out.join("withheld").display()
        );
        report(&text, &released, common)
    }
}
