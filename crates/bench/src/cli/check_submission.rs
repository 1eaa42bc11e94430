//! `microsig check-submission`: reports what is wrong with a submission before it is uploaded.

use std::path::PathBuf;

use clap::Args;

use super::Common;
use super::evaluate::{Checked, checked};
use super::output::{summarize, warn};
use arena::suite::check;
use generator::runner::{RECORD, SuiteRecord};
use scenario::SuiteCase;
use scoring::results::Conventions;
use storage::InputFile;
use storage::argument::input;
use storage::error::{Error, Result};

/// Check a submission without the truth; exit code 2 if it would be refused
#[derive(Debug, Args)]
#[command(
    visible_alias = "check",
    after_help = "Example: microsig check-submission channel-test my_submission.zip\n\
Example: microsig check-submission suites/odpc1-small results/mine --suite odpc1"
)]
pub(super) struct CheckSubmission {
    /// The test split; or a suite: generated, or a folder with suite.json of a release and its unpacked test splits
    dataset: PathBuf,
    /// A result or a submission (folder or zip archive); for a suite, one with TRACK/CASE/results.csv
    #[arg(value_parser = input())]
    submission: InputFile,
    /// The suite, if it is a generated one
    #[arg(long, value_name = "SUITE", value_parser = input())]
    suite: Option<InputFile>,
}

impl CheckSubmission {
    pub(super) fn run(&self, common: &Common) -> Result<()> {
        if self.suite.is_some() || self.dataset.join(RECORD).is_file() {
            return self.check_suite(common);
        }
        let Checked { text, value, warnings } =
            checked(&self.dataset, &self.submission, Conventions::default())?;
        warn(&warnings, common);
        summarize(&text, &value, common)
    }

    /// Checks the results of a tracker for a whole suite.
    fn check_suite(&self, common: &Common) -> Result<()> {
        let record = SuiteRecord::read(&self.dataset)?;
        let cases: Vec<String> = match &self.suite {
            Some(suite) => {
                let suite = scenario::Suite::open(suite)?;
                record.matches(&suite, &self.dataset)?;
                suite.cases(record.size)?.iter().map(SuiteCase::folder).collect()
            }
            None if record.is_release() => record.images_sha256.keys().cloned().collect(),
            None => {
                let what = format!("a generated suite; give --suite {}", record.name);
                return Err(Error::input(format!("{}: {what}", self.dataset.display())));
            }
        };
        let checked = check(&record, &self.dataset, &cases, &self.submission)?;
        warn(&checked.warnings, common);
        summarize(&checked.text, &checked, common)
    }
}
