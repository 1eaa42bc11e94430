//! Submissions: a folder or zip archive with `results.csv` and `submission.json`, checked without the truth.

use std::io::Read;
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};
use serde_json::json;

use crate::dataset::checksums::{SHA256SUMS, images_digest};
use crate::error::{Error, Result};
use crate::evaluate::truth::conventions;
use crate::results::{self, Conventions, Format, Found};

/// Name of the file with the points or vectors.
pub(super) const RESULTS: &str = "results.csv";
/// Name of the file about them.
pub(super) const SUBMISSION: &str = "submission.json";

/// The template of `results.csv`.
pub(super) const RESULTS_HEADER: &str = "frame,track,x_px,y_px,z_um\n";

/// What every team declares, so that nobody is scored in other coordinates than meant.
const DECLARATION: &str = "x_px to the right and y_px downward, centre of the top-left pixel at (1, 1); z_um physical depth in \
um, growing away from the lens; frames from 0";

/// Most bytes that are unpacked of an archive.
const LARGEST: u64 = 4 << 30;

/// `submission.json`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Submission {
    /// Who.
    pub team: String,
    /// Which method.
    pub method: String,
    /// Which version of it.
    pub version: String,
    /// Its parameters, in whatever form.
    pub params: serde_json::Map<String, serde_json::Value>,
    /// How long it took for the whole split, s.
    pub runtime_s: Option<f64>,
    /// On which machine.
    pub hardware: String,
    /// The coordinates of `results.csv`; only those of the template are accepted.
    pub coordinate_declaration: String,
    /// SHA-256 of the images that were used: `grep '  images/' SHA256SUMS | sha256sum`.
    pub images_sha256: String,
    /// Anything else.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub notes: Option<String>,
}

/// The template of `submission.json`.
pub(super) fn template() -> String {
    let template = json!({
        "team": "",
        "method": "",
        "version": "",
        "params": {},
        "runtime_s": null,
        "hardware": "",
        "coordinate_declaration": DECLARATION,
        "images_sha256": "",
    });
    format!("{template:#}\n")
}

/// What was validated.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Validated {
    /// What the submission says about itself.
    pub submission: Submission,
    /// `particles` or `vectors`.
    pub kind: &'static str,
    /// Rows with coordinates.
    pub rows: usize,
    /// What is allowed, but perhaps not meant.
    pub warnings: Vec<String>,
}

/// A submission's files; an archive's are unpacked and removed again.
#[derive(Debug)]
pub struct Files {
    folder: PathBuf,
    _unpacked: Option<tempfile::TempDir>,
}

impl Files {
    /// Whether this is a submission, not a result alone.
    pub fn are_at(path: &Path) -> bool {
        path.is_dir() || path.extension().is_some_and(|e| e.eq_ignore_ascii_case("zip"))
    }

    /// Finds the two files.
    ///
    /// # Errors
    /// An archive that is none, too large, or lacks them.
    pub fn open(path: &Path) -> Result<Self> {
        if path.is_dir() {
            return Ok(Files { folder: path.to_owned(), _unpacked: None });
        }
        let wrong = |what: String| Error::input(format!("{}: {what}", path.display()));
        let file = std::fs::File::open(path).map_err(|e| Error::read(path, e))?;
        let mut archive = zip::ZipArchive::new(file).map_err(|e| wrong(e.to_string()))?;
        let place = tempfile::tempdir().map_err(Error::write(&std::env::temp_dir()))?;
        for name in [RESULTS, SUBMISSION] {
            // At the top, or in the one folder that archives of folders have.
            let is_it = |n: &str| n == name || n.split_once('/').is_some_and(|(_, rest)| rest == name);
            let at = (0..archive.len())
                .find(|&i| archive.name_for_index(i).is_some_and(|n| n.is_ok_and(|n| is_it(&n))));
            let Some(at) = at else { return Err(wrong(format!("has no {name}"))) };
            let entry = archive.by_index(at).map_err(|e| wrong(e.to_string()))?;
            let out = place.path().join(name);
            let mut file = std::fs::File::create(&out).map_err(Error::write(&out))?;
            // The size that an archive states may be wrong.
            let n =
                std::io::copy(&mut entry.take(LARGEST + 1), &mut file).map_err(|e| wrong(e.to_string()))?;
            if n > LARGEST {
                return Err(wrong(format!("{name} is larger than {LARGEST} bytes")));
            }
        }
        Ok(Files { folder: place.path().to_owned(), _unpacked: Some(place) })
    }

    /// The file with the points or vectors.
    pub fn results(&self) -> PathBuf {
        self.folder.join(RESULTS)
    }

    fn about(&self) -> PathBuf {
        self.folder.join(SUBMISSION)
    }
}

/// Checks a submission against a test split, whose truth is not needed. Paths in messages are those in the submission.
///
/// # Errors
/// [`Error::Input`] with all that is wrong, with line numbers.
pub fn validate(test: &Path, files: &Files) -> Result<Validated> {
    let mut problems = Vec::new();
    let submission = about(test, &files.about(), &mut problems)?;
    let found = particles_or_vectors(test, &files.results(), &mut problems)?;
    match (submission, found) {
        (Some(submission), Some((kind, rows, warnings))) if problems.is_empty() => {
            Ok(Validated { submission, kind, rows, warnings })
        }
        _ => {
            let prefix = format!("{}/", files.folder.display());
            Err(Error::Input(problems.iter().map(|p| p.replace(&prefix, "")).collect()))
        }
    }
}

fn about(test: &Path, path: &Path, problems: &mut Vec<String>) -> Result<Option<Submission>> {
    let sums = test.join(SHA256SUMS);
    let sums = std::fs::read_to_string(&sums).map_err(|e| Error::read(&sums, e))?;
    let read = std::fs::read_to_string(path).map_err(|e| e.to_string());
    let parsed = read.and_then(|text| serde_json::from_str::<Submission>(&text).map_err(|e| e.to_string()));
    let submission = match parsed {
        Ok(submission) => submission,
        Err(e) => {
            problems.push(format!("{}: {e}", path.display()));
            return Ok(None);
        }
    };
    let mut wrong = |key: &str, expected: &str| {
        problems.push(format!("{}: {key}: expected {expected}", path.display()));
    };
    for (key, value) in [
        ("team", &submission.team),
        ("method", &submission.method),
        ("version", &submission.version),
        ("hardware", &submission.hardware),
    ] {
        if value.trim().is_empty() {
            wrong(key, "some text");
        }
    }
    if !submission.runtime_s.is_none_or(|s| s >= 0.0 && s.is_finite()) {
        wrong("runtime_s", "a time >= 0 s, or null");
    }
    if submission.coordinate_declaration != DECLARATION {
        wrong("coordinate_declaration", &format!("the template's text: {DECLARATION:?}"));
    }
    if submission.images_sha256 != images_digest(&sums) {
        wrong(
            "images_sha256",
            "the hash of this split's images, of `grep '  images/' SHA256SUMS | sha256sum`; other images were used",
        );
    }
    Ok(Some(submission))
}

/// Reads the result as it will be read for scoring, and checks what can be checked without the truth.
fn particles_or_vectors(
    test: &Path,
    path: &Path,
    problems: &mut Vec<String>,
) -> Result<Option<(&'static str, usize, Vec<String>)>> {
    let known = conventions(test, Conventions::default())?;
    let facts = crate::evaluate::truth::facts(test)?;
    let read = results::detect(path).and_then(|format| match format {
        Format::Canonical | Format::Field => {
            results::read(path, &Conventions { format: Some(format), ..known })
        }
        _ => Err(Error::input(format!(
            "{}:1: expected the columns of the template, {}",
            path.display(),
            RESULTS_HEADER.trim_end()
        ))),
    });
    let found = match read {
        Ok(found) => found,
        Err(e) => {
            problems.extend(e.to_string().lines().map(str::to_owned));
            return Ok(None);
        }
    };
    let (kind, rows, n_nan) = match &found {
        Found::Points(p) => ("particles", p.rows.len(), p.n_nan),
        Found::Field(f) => ("vectors", f.vectors.len(), f.n_nan),
    };
    problems.extend(facts.beyond(path, &found));
    let mut warnings = Vec::new();
    if n_nan > 0 {
        warnings.push(format!("{n_nan} rows have no coordinates and do not count"));
    }
    if let (Found::Points(points), Some((width, height))) = (&found, facts.sensor_px) {
        let on = |v: f64, size: f64| v >= 0.5 && v < size + 0.5;
        let off = points.rows.iter().filter(|r| !(on(r.at.x_px, width) && on(r.at.y_px, height))).count();
        if off > 0 {
            warnings.push(format!("{off} points lie beyond the edge of the image"));
        }
        let deep = |z: f64| facts.depth_um.is_some_and(|(low, high)| !(low..=high).contains(&z));
        let n_deep = points.rows.iter().filter(|r| points.has_z && deep(r.at.z_um)).count();
        if n_deep > 0 {
            warnings.push(format!("{n_deep} points lie outside of the depth range"));
        }
        if !points.has_z {
            warnings.push("no z_um: only scores in the image plane".to_owned());
        }
        if points.rows.iter().all(|r| r.track < 0) {
            warnings.push("no point is linked: no scores of tracks".to_owned());
        }
        let mut seen: Vec<u32> = points.rows.iter().map(|r| r.frame).collect();
        seen.sort_unstable();
        seen.dedup();
        let empty = facts.frames.unwrap_or(0) as usize - seen.len().min(facts.frames.unwrap_or(0) as usize);
        if empty > 0 {
            warnings.push(format!("{empty} frames have no points"));
        }
    }
    Ok(Some((kind, rows, warnings)))
}
