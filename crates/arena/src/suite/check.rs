//! `check-submission` for a whole suite: what `suite score` would refuse, told before an upload.

use std::path::Path;
use std::time::SystemTime;

use serde::Serialize;

use super::RESULT;
use super::entry::Entry;
use crate::release::Deadline;
use generator::runner::{RECORD, SuiteRecord};
use scoring::evaluate::measurement::{beyond, facts_of};
use scoring::results::{self, Conventions};
use storage::error::{Error, Result};

/// A submission to a suite of which something can be scored.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Checked {
    /// Number of cases with a result that can be scored.
    pub found: usize,
    /// Cases without a result, which count as behind all others.
    pub missing: Vec<String>,
    /// Valid but suspicious properties.
    pub warnings: Vec<String>,
    /// Summary, in one line.
    #[serde(skip)]
    pub text: String,
}

/// Checks the results of a tracker, a folder or archive, for the suite in a folder: generated, released, or with the test
/// splits of a release unpacked beside its `suite.json`. `cases`: every `TRACK/CASE` of the suite.
/// Errors: [`Error::Input`] with every problem; no results.
pub fn check(record: &SuiteRecord, datasets: &Path, cases: &[String], submission: &Path) -> Result<Checked> {
    let entry = Entry::open(submission, submission.to_owned(), (record, datasets, cases))?;
    if let Some(fault) = &entry.fault {
        return Err(Error::input(fault));
    }
    let mut problems = entry.unknown(record, cases)?;
    let (mut found, mut missing, mut warnings) = (0, Vec::new(), Vec::new());
    for case in cases {
        let is_there = entry.folder.join(case).join(RESULT).exists();
        match record.test_split(datasets, case) {
            _ if !is_there => missing.push(case.clone()),
            None => problems.push(format!(
                "{}: no test split of {case}; unpack its archive beside {RECORD}",
                datasets.display()
            )),
            Some(test) => match entry.result(record, case, &test) {
                Ok(Some((result, more))) => {
                    found += 1;
                    let given = Conventions::default();
                    let facts = facts_of(&test, &given)?;
                    match results::read(&result, &given.completed(&facts)) {
                        Ok(read) => problems.extend(beyond(&facts, &result, &read)),
                        Err(e) => problems.extend(e.problems()),
                    }
                    warnings.extend(more.iter().map(|warning| format!("{case}: {warning}")));
                }
                Ok(None) => missing.push(case.clone()),
                Err(e) => problems.extend(e.problems()),
            },
        }
    }
    if missing.len() == cases.len() && problems.is_empty() {
        let expected = format!("expected TRACK/CASE/{RESULT}");
        return Err(Error::input(format!("{}: no results; {expected}", submission.display())));
    }
    if !problems.is_empty() {
        return Err(Error::Input(problems));
    }
    let day = record.deadline.as_deref().and_then(|day| day.parse::<Deadline>().ok());
    if let Some(day) = day.filter(|day| day.has_passed(SystemTime::now())) {
        warnings.push(format!("the deadline, {day}, has passed"));
    }
    let mut text = format!("{}: {found} of {} cases can be scored", record.edition(), cases.len());
    if !missing.is_empty() {
        text += &format!("; {}", missing_text(&missing));
    }
    text += &record.deadline.as_ref().map(|day| format!("; deadline {day}")).unwrap_or_default();
    Ok(Checked { found, missing, warnings, text })
}

/// All missing cases in one line.
pub(super) fn missing_text(missing: &[impl AsRef<str>]) -> String {
    const SHOWN: usize = 4;
    let shown: Vec<&str> = missing.iter().take(SHOWN).map(AsRef::as_ref).collect();
    let more = missing.len().saturating_sub(SHOWN);
    let more = if more > 0 { format!(" and {more} more") } else { String::new() };
    format!("{} missing, behind all others: {}{more}", missing.len(), shown.join(", "))
}
