//! Results of a tracker for a suite: a folder or zip archive with `TRACK/CASE/results.csv`.
//!
//! `submission.json` beside the folders of the tracks (or beside a single `results.csv`) states the suite and the hashes of
//! the images: results for other images are refused. A release demands it; for a generated suite it may be left out.

use std::path::{Path, PathBuf};
use std::time::SystemTime;

use super::RESULT;
use super::participants::ABOUT;
use crate::release::submission::{
    LARGEST_ABOUT, SUBMISSION, about, only_regular, other_images, particles_or_vectors, unpack,
};
use crate::release::{Deadline, Submission, limits};
use generator::runner::SuiteRecord;
use storage::checksums::{SHA256SUMS, images_digest};
use storage::error::{Error, Result};
use storage::{InputFile, TemporaryFolder, input};

/// The results of a tracker.
#[derive(Debug)]
pub(super) struct Entry {
    /// Name of the tracker, its folder or archive.
    pub(super) name: String,
    /// The folder with the tracks.
    pub(super) folder: PathBuf,
    /// Path of that folder or archive in messages.
    pub(super) given: PathBuf,
    about: Option<Submission>,
    /// Why nothing of it can be scored.
    pub(super) fault: Option<String>,
    _unpacked: Option<TemporaryFolder>,
}

impl Entry {
    /// Opens a folder or archive, which messages call `given`. What is wrong with a submission is its `fault`.
    pub(super) fn open(path: &Path, given: PathBuf, suite: (&SuiteRecord, &Path, &[String])) -> Result<Self> {
        let is_archive = path.is_file();
        let name = if is_archive { path.file_stem() } else { path.file_name() };
        let name = name.unwrap_or_default().to_string_lossy().into_owned();
        let (place, mut fault) = if is_archive {
            let place = TemporaryFolder::new()?;
            let fault = unpack_suite(path, &given, place.path(), suite).err().map(|e| e.to_string());
            (Some(place), fault)
        } else {
            (None, None)
        };
        let folder = place.as_ref().map_or_else(|| path.to_owned(), |place| place.path().to_owned());
        let (record, ..) = suite;
        let mut entry = Entry { name, folder, given, about: None, fault: None, _unpacked: place };
        let file = entry.file(SUBMISSION);
        if fault.is_none() && (is_archive || record.is_release() || entry.has(SUBMISSION)) {
            fault = only_regular(&entry.folder).err().map(|e| e.to_string());
            if entry.has(SUBMISSION) && fault.is_none() {
                let mut problems = Vec::new();
                entry.about = about(&file, Some(record.edition()), &mut problems);
                fault = (!problems.is_empty()).then(|| problems.join("; "));
            }
        }
        Ok(Entry { fault, ..entry })
    }

    pub(super) fn is_archive(&self) -> bool {
        self._unpacked.is_some()
    }

    /// Whether it states what was sent, so that its faults are a team's.
    pub(super) fn is_submission(&self) -> bool {
        self.is_archive() || self.about.is_some() || self.fault.is_some()
    }

    /// Refuses it if it was written or received after the deadline.
    pub(super) fn refuse_late(&mut self, deadline: Option<&str>, path: &Path) {
        let Some(day) = deadline.and_then(|day| day.parse::<Deadline>().ok()) else { return };
        let file = if path.is_file() { path.to_owned() } else { path.join(SUBMISSION) };
        let written = file.metadata().and_then(|of| of.modified()).unwrap_or(SystemTime::UNIX_EPOCH);
        if day.has_passed(written) {
            let file = file.file_name().unwrap_or_default().to_string_lossy().into_owned();
            self.fault = Some(format!("received after the deadline {day}, by the time of {file}"));
        }
    }

    fn has(&self, path: impl AsRef<Path>) -> bool {
        self.folder.join(path).exists()
    }

    fn file(&self, path: impl AsRef<Path>) -> InputFile {
        InputFile::shown_as(self.folder.join(&path), self.given.join(path))
    }

    /// The result for a `TRACK/CASE` whose test split is in a folder; `None` if there is none. With what may be wrong with it.
    /// Errors: why it cannot be scored: results for other images, and what [`crate::release::validate`] refuses.
    pub(super) fn result(
        &self,
        record: &SuiteRecord,
        case: &str,
        test: &Path,
    ) -> Result<Option<(InputFile, Vec<String>)>> {
        if let Some(fault) = &self.fault {
            return Err(Error::input(fault));
        }
        let result = self.file(Path::new(case).join(RESULT));
        if !self.has(Path::new(case).join(RESULT)) {
            return Ok(None);
        }
        let mut problems = Vec::new();
        let own = self.file(Path::new(case).join(SUBMISSION));
        let (stated, path) = if self.has(Path::new(case).join(SUBMISSION)) {
            (about(&own, Some(record.edition()), &mut problems), own)
        } else {
            (self.about.clone(), self.file(SUBMISSION))
        };
        let Some(stated) = stated else {
            if problems.is_empty() && record.is_release() {
                problems.push(format!("{}: missing; it states the images that were used", path.display()));
            }
            return if problems.is_empty() {
                Ok(Some((result, Vec::new())))
            } else {
                Err(Error::Input(problems))
            };
        };
        let sums = input::read_text(&test.join(SHA256SUMS))?;
        problems.extend(other_images(&stated, &path, case, &images_digest(&sums)));
        let found = particles_or_vectors(test, &result, &mut problems)?;
        match found {
            Some((_, _, warnings)) if problems.is_empty() => Ok(Some((result, warnings))),
            _ => Err(Error::Input(problems)),
        }
    }

    /// Folders in it that are no tracks or cases of the suite: their names would otherwise count as missing results.
    pub(super) fn unknown(&self, record: &SuiteRecord, cases: &[String]) -> Result<Vec<String>> {
        let mut unknown = Vec::new();
        for track in super::folders(&self.folder)? {
            let shown = self.given.join(&track);
            if !cases.iter().any(|known| known.starts_with(&format!("{track}/"))) {
                unknown.push(format!("{}: suite {} has no such track", shown.display(), record.name));
                continue;
            }
            for case in super::folders(&self.folder.join(&track))? {
                if !cases.contains(&format!("{track}/{case}")) {
                    let (path, size) = (shown.join(case), record.size.name());
                    unknown
                        .push(format!("{}: track {track} has no such case at size {size}", path.display()));
                }
            }
        }
        Ok(unknown)
    }
}

/// Unpacks the results and descriptions in an archive, which may be below one folder; other files are left out.
fn unpack_suite(
    path: &Path,
    given: &Path,
    out: &Path,
    (record, datasets, cases): (&SuiteRecord, &Path, &[String]),
) -> Result<()> {
    let wrong = |what: String| Error::input(format!("{}: {what}", given.display()));
    let found = unpack(path, given, out, |parts| {
        Ok(match parts {
            [SUBMISSION] | [_, SUBMISSION] => Some((SUBMISSION.to_owned(), LARGEST_ABOUT)),
            [ABOUT] | [_, ABOUT] => Some((ABOUT.to_owned(), LARGEST_ABOUT)),
            [track, case, file @ (RESULT | SUBMISSION)] | [_, track, case, file @ (RESULT | SUBMISSION)] => {
                let case = format!("{track}/{case}");
                if !cases.contains(&case) {
                    return Err(wrong(format!("{case}: {} has no such case", record.edition())));
                }
                let most = match record.test_split(datasets, &case) {
                    Some(test) if *file == RESULT => limits(&test)?.bytes,
                    _ => LARGEST_ABOUT,
                };
                Some((format!("{case}/{file}"), most))
            }
            _ => None,
        })
    })?;
    if found.iter().any(|name| name.ends_with(RESULT)) {
        return Ok(());
    }
    Err(wrong(format!("contains no TRACK/CASE/{RESULT}")))
}
