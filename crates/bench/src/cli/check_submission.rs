//! `microsig check-submission`: reports what is wrong with a submission before it is uploaded.

use std::path::{Path, PathBuf};

use clap::Args;
use serde_json::json;

use super::Common;
use super::argument::input;
use super::evaluate::{Checked, checked};
use super::output::{summarize, warn};
use arena::suite::RESULT;
use generator::runner::{SuiteRecord, SuiteSelection};
use scenario::Split;
use scoring::results::Conventions;
use storage::InputFile;
use storage::error::{Error, Result};

/// Check a submission without the truth; exit code 2 if it would be refused
#[derive(Debug, Args)]
#[command(after_help = "Example: microsig check-submission channel-test my_submission.zip\n\
Example: microsig check-submission suites/odpc1-small results/mine --suite odpc1")]
pub(super) struct CheckSubmission {
    /// The test split or, with --suite, the generated suite
    dataset: PathBuf,
    /// A result or a submission (folder or zip archive); for a suite, a folder with TRACK/CASE/results.csv
    #[arg(value_parser = input())]
    submission: InputFile,
    /// The suite
    #[arg(long, value_name = "SUITE", value_parser = input())]
    suite: Option<InputFile>,
}

impl CheckSubmission {
    pub(super) fn run(&self, common: &Common) -> Result<()> {
        if let Some(suite) = &self.suite {
            return self.of_suite(&scenario::Suite::open(suite)?, common);
        }
        let Checked { text, value, warnings } =
            checked(&self.dataset, &self.submission, Conventions::default())?;
        warn(&warnings, common);
        summarize(&text, &value, common)
    }

    /// Checks the results of a tracker for a whole suite.
    fn of_suite(&self, suite: &scenario::Suite, common: &Common) -> Result<()> {
        let record = SuiteRecord::read(&self.dataset)?;
        record.matches(suite, &self.dataset)?;
        let tests = SuiteSelection { split: Some(Split::Test), ..SuiteSelection::default() };
        let (mut problems, mut lines, mut missing, mut known) = (Vec::new(), Vec::new(), 0, Vec::new());
        for (case, split) in tests.of(suite, record.size)? {
            let result = self.submission.join(case.folder()).join(RESULT);
            known.push(result.clone());
            if !result.exists() {
                missing += 1;
                lines.push(format!("{}: missing", case.folder()));
                continue;
            }
            let dataset = self.dataset.join(case.split_folder(split));
            match checked(&dataset, &result.into(), Conventions::default()) {
                Ok(Checked { text, .. }) => lines.push(text),
                Err(e) => problems.extend(e.problems()),
            }
        }
        for path in results_below(&self.submission)? {
            if !known.contains(&path) {
                let size = record.size.name();
                problems.push(format!("{}: the suite has no such case at size {size}", path.display()));
            }
        }
        if missing == known.len() && problems.is_empty() {
            let expected = format!("expected TRACK/CASE/{RESULT}");
            return Err(Error::input(format!("{}: no results; {expected}", self.submission.display())));
        }
        if !problems.is_empty() {
            return Err(Error::Input(problems));
        }
        let found = known.len() - missing;
        lines.push(format!("{found} of {} cases can be scored, {missing} missing", known.len()));
        summarize(&lines.join("\n"), &json!({ "found": found, "missing": missing }), common)
    }
}

/// All files `A/B/results.csv` below a folder.
fn results_below(folder: &Path) -> Result<Vec<PathBuf>> {
    let mut found = Vec::new();
    let inside = |folder: &Path| -> Result<Vec<PathBuf>> {
        let entries = std::fs::read_dir(folder).map_err(|e| Error::read(folder, e))?;
        entries.map(|entry| entry.map(|e| e.path()).map_err(|e| Error::read(folder, e))).collect()
    };
    for track in inside(folder)?.into_iter().filter(|path| path.is_dir()) {
        for case in inside(&track)?.into_iter().filter(|path| path.is_dir()) {
            found.extend(Some(case.join(RESULT)).filter(|path| path.exists()));
        }
    }
    found.sort();
    Ok(found)
}
