//! Submissions: folders or zip archives with `results.csv` and `submission.json`, validated without the
//! truth.

use std::collections::{BTreeMap, BTreeSet};
use std::io::Read;
use std::path::{Path, PathBuf};
use std::time::SystemTime;

use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

use super::deadline::Deadline;
use scoring::evaluate::measurement;
use scoring::results::{self, Conventions, Format, Limits, TrackerResult};
use storage::checksums::{SHA256SUMS, images_digest};
use storage::dataset::RecordingFacts;
use storage::dataset::manifest::{Manifest, ResultKind, SuitePlace};
use storage::error::{Error, Result};
use storage::input;
use storage::{InputFile, TemporaryFolder};

/// Name of the file with the points or vectors.
pub(crate) const RESULTS: &str = "results.csv";
/// Name of the file with the metadata.
pub(crate) const SUBMISSION: &str = "submission.json";

/// Template of `results.csv`: its header for particles.
const OF_PARTICLES: &str = "frame,track,x_px,y_px,z_um\n";
/// The same for displacement fields.
const OF_FIELDS: &str = "pair,x_px,y_px,dx_px,dy_px,flag\n";

/// Template of `results.csv`: its header.
pub(crate) fn results_header(is_for_fields: bool) -> &'static str {
    if is_for_fields { OF_FIELDS } else { OF_PARTICLES }
}

/// Coordinate convention that every team declares.
const DECLARATION: &str = "x_px to the right and y_px downward, center of the top-left pixel at (1, 1); z_um physical depth in \
um, growing away from the lens; frames from 0";

/// The largest `submission.json`, bytes.
pub(crate) const LARGEST_ABOUT: u64 = 1 << 20;

/// `submission.json`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Submission {
    pub team: String,
    pub method: String,
    pub version: String,
    /// Parameters of the method, in any form.
    pub params: serde_json::Map<String, serde_json::Value>,
    /// Run time for the whole split, s.
    pub runtime_s: Option<f64>,
    pub hardware: String,
    /// Coordinate convention of `results.csv`; must equal the text of the template.
    pub coordinate_declaration: String,
    /// SHA-256 of the list of images used: `grep ' images/' SHA256SUMS | sha256sum`.
    pub images_sha256: ImagesHash,
    /// The suite with version and size, if the images belong to one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub suite: Option<String>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub notes: Option<String>,
}

/// Hash of the images that were used.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(untagged, expecting = "expected a SHA-256 or, for a suite, one for each TRACK/CASE")]
pub enum ImagesHash {
    /// Of one test split.
    Split(String),
    /// Of the test splits of a suite, by `TRACK/CASE`.
    Cases(BTreeMap<String, String>),
}

impl Submission {
    /// Parses `submission.json`.
    /// Errors: invalid JSON, unknown or missing keys, wrong types.
    pub fn parse(text: &str) -> std::result::Result<Self, String> {
        storage::json::parse(text)
    }
}

/// Template of `submission.json`.
pub(crate) fn template(suite: Option<&str>, images_sha256: &Value) -> String {
    let mut template = json!({
        "team": "",
        "method": "",
        "version": "",
        "params": {},
        "runtime_s": null,
        "hardware": "",
        "coordinate_declaration": DECLARATION,
        "images_sha256": images_sha256,
    });
    if let Some(suite) = suite {
        template["suite"] = suite.into();
    }
    format!("{template:#}\n")
}

/// A valid submission.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Validated {
    pub submission: Submission,
    /// `particles` or `vectors`.
    pub kind: &'static str,
    /// Number of rows with coordinates.
    pub rows: usize,
    /// The last day for submissions, if the test split states one.
    pub deadline: Option<String>,
    /// Valid but suspicious properties.
    pub warnings: Vec<String>,
}

/// The files of a submission; archives are unpacked into a temporary folder.
#[derive(Debug)]
pub struct SubmissionFiles {
    /// The path that was given.
    given: PathBuf,
    folder: PathBuf,
    _unpacked: Option<TemporaryFolder>,
}

impl SubmissionFiles {
    /// Whether the path is a submission (folder or zip archive) rather than a result file.
    pub fn are_at(path: &Path) -> bool {
        [SUBMISSION, RESULTS].iter().any(|name| path.join(name).exists())
            || path.extension().is_some_and(|e| e.eq_ignore_ascii_case("zip"))
    }

    /// Opens a submission.
    /// Errors: an archive that is invalid, exceeds `limits` or lacks one of the files; links and devices anywhere in
    /// it.
    pub fn open(path: &Path, limits: Limits) -> Result<Self> {
        if path.is_dir() {
            only_regular(path)?;
            let given = path.to_owned();
            return Ok(SubmissionFiles { folder: given.clone(), given, _unpacked: None });
        }
        let place = TemporaryFolder::new()?;
        let found = unpack(path, path, place.path(), |parts| {
            Ok(match parts {
                [RESULTS] | [_, RESULTS] => Some((RESULTS.to_owned(), limits.bytes)),
                [SUBMISSION] | [_, SUBMISSION] => Some((SUBMISSION.to_owned(), LARGEST_ABOUT)),
                _ => None,
            })
        })?;
        if let Some(name) = [RESULTS, SUBMISSION].iter().find(|name| !found.contains(**name)) {
            return Err(Error::input(format!("{}: contains no {name}", path.display())));
        }
        let given = path.to_owned();
        Ok(SubmissionFiles { given, folder: place.path().to_owned(), _unpacked: Some(place) })
    }

    /// The file with the points or vectors.
    pub fn results(&self) -> InputFile {
        self.file(RESULTS)
    }

    fn about(&self) -> InputFile {
        self.file(SUBMISSION)
    }

    fn file(&self, name: &str) -> InputFile {
        InputFile::shown_as(self.folder.join(name), self.given.join(name))
    }
}

/// Unpacks the files of an archive, called `given` in messages, to which `wanted` gives a path in `out` and a largest size in
/// bytes, by the parts of their names. Returns these paths.
/// Errors: an archive that is invalid; a wanted file that is larger, a link, or there several times; errors of `wanted`.
pub(crate) fn unpack(
    path: &Path,
    given: &Path,
    out: &Path,
    wanted: impl Fn(&[&str]) -> Result<Option<(String, u64)>>,
) -> Result<BTreeSet<String>> {
    let wrong = |what: String| Error::input(format!("{}: {what}", given.display()));
    let mut archive = zip::ZipArchive::new(input::open(path)?)
        .map_err(|e| wrong(format!("not a complete ZIP archive: {e}")))?;
    let mut found: BTreeMap<String, (Vec<usize>, u64)> = BTreeMap::new();
    for at in 0..archive.len() {
        let Some(Ok(name)) = archive.name_for_index(at) else { continue };
        if let Some((to, most)) = wanted(&name.split('/').collect::<Vec<_>>())? {
            found.entry(to).or_insert((Vec::new(), most)).0.push(at);
        }
    }
    for (to, (places, most)) in &found {
        let [at] = places[..] else {
            return Err(wrong(format!("contains {} entries named {to}; expected one", places.len())));
        };
        let entry = archive.by_index(at).map_err(|e| wrong(e.to_string()))?;
        if entry.is_symlink() {
            return Err(wrong(format!("{to} is a symbolic link; expected a regular file")));
        }
        let whole = out.join(to);
        let above = whole.parent().unwrap_or(out);
        std::fs::create_dir_all(above).map_err(Error::write(above))?;
        let mut file = std::fs::File::create(&whole).map_err(Error::write(&whole))?;
        // The size stated in the archive is not trusted.
        let n = std::io::copy(&mut entry.take(most.saturating_add(1)), &mut file)
            .map_err(|e| wrong(format!("{to}: {e}")))?;
        if n > *most {
            return Err(wrong(format!("{to} is larger than {most} bytes, the limit for this dataset")));
        }
    }
    Ok(found.into_keys().collect())
}

/// Maximum number of entries in the folder of a submission.
const MOST_ENTRIES: usize = 10_000;

/// Refuses links, pipes and devices anywhere below a folder: a link could point to the truth.
pub(crate) fn only_regular(folder: &Path) -> Result<()> {
    let (mut folders, mut n) = (vec![folder.to_owned()], 0);
    while let Some(folder) = folders.pop() {
        for entry in std::fs::read_dir(&folder).map_err(|e| Error::read(&folder, e))? {
            let path = entry.map_err(|e| Error::read(&folder, e))?.path();
            let kind = std::fs::symlink_metadata(&path).map_err(|e| Error::read(&path, e))?.file_type();
            n += 1;
            if n > MOST_ENTRIES {
                let what = format!("{}: more than {MOST_ENTRIES} files in a submission", folder.display());
                return Err(Error::input(what));
            }
            match kind {
                kind if kind.is_dir() => folders.push(path),
                kind if kind.is_file() => {}
                kind => {
                    let what = if kind.is_symlink() { "a symbolic link" } else { "a pipe, device or socket" };
                    let path = path.display();
                    return Err(Error::input(format!(
                        "{path}: {what}; a submission holds regular files only"
                    )));
                }
            }
        }
    }
    Ok(())
}

/// Limits on the size of results for a test split.
pub fn limits(test: &Path) -> Result<Limits> {
    measurement::limits(test, &RecordingFacts::read(test)?)
}

/// Validates a submission for a test split, without the truth. Messages begin with the given path; for an
/// archive, the names of its files follow.
/// Errors: [`Error::Input`] with every problem, with line numbers.
pub fn validate(test: &Path, files: &SubmissionFiles) -> Result<Validated> {
    let mut problems = Vec::new();
    let place = Manifest::read(test)?.microsig.scoring.and_then(|rules| rules.suite);
    let submission = about(&files.about(), place.as_ref().map(SuitePlace::edition), &mut problems);
    if let Some(submission) = &submission {
        let case = place.map(|place| format!("{}/{}", place.track, place.case)).unwrap_or_default();
        let hash = images_digest(&input::read_text(&test.join(SHA256SUMS))?);
        problems.extend(other_images(submission, &files.about(), &case, &hash));
    }
    let found = particles_or_vectors(test, &files.results(), &mut problems)?;
    match (submission, found) {
        (Some(submission), Some((kind, rows, mut warnings))) if problems.is_empty() => {
            let deadline = Manifest::read(test)?.microsig.deadline;
            let day = deadline.as_deref().and_then(|text| text.parse::<Deadline>().ok());
            let late = day.filter(|day| day.has_passed(SystemTime::now()));
            warnings.extend(late.map(|day| format!("the deadline of the challenge, {day}, has passed")));
            Ok(Validated { submission, kind, rows, deadline, warnings })
        }
        _ => Err(Error::Input(problems)),
    }
}

/// Reads `submission.json`. `edition`: the suite of the images, with version and size.
pub(crate) fn about(
    path: &InputFile,
    edition: Option<String>,
    problems: &mut Vec<String>,
) -> Option<Submission> {
    let text = path.open().and_then(|file| input::text_of(path, file, LARGEST_ABOUT));
    let parsed = match text {
        Ok(text) => Submission::parse(&text).map_err(|e| format!("{}: {e}", path.display())),
        Err(e) => Err(e.to_string()),
    };
    let submission = match parsed {
        Ok(submission) => submission,
        Err(e) => {
            problems.push(e);
            return None;
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
    if let (Some(edition), Some(stated)) = (&edition, &submission.suite)
        && stated != edition
    {
        wrong("suite", &format!("{edition}; the submission is for {stated}"));
    }
    Some(submission)
}

/// The problem with a submission for other images than the test split with this hash, of this `TRACK/CASE`.
pub(crate) fn other_images(
    submission: &Submission,
    path: &InputFile,
    case: &str,
    hash: &str,
) -> Option<String> {
    let (key, stated) = match &submission.images_sha256 {
        ImagesHash::Split(stated) => ("images_sha256".to_owned(), Some(stated)),
        ImagesHash::Cases(cases) => (format!("images_sha256.{case}"), cases.get(case)),
    };
    (stated.map(String::as_str) != Some(hash)).then(|| {
        let what = if stated.is_some() { "; different images were used" } else { "" };
        format!(
            "{}: {key}: expected the hash of this split's images, from `grep '  images/' SHA256SUMS | sha256sum`{what}",
            path.display()
        )
    })
}

/// Marker files in the withheld part that state that only particles or only fields are scored.
const PARTICLES_ONLY: &str = "particles_only.txt";
const FIELDS_ONLY: &str = "fields_only.txt";

/// Name and text of the marker file if only particles or only fields are scored.
pub(super) fn marker(scored: &[ResultKind]) -> Option<(&'static str, &'static str)> {
    match scored {
        [ResultKind::Particles] => Some((
            PARTICLES_ONLY,
            "The train split reveals the velocity field of the test split: submissions of fields are refused.\n",
        )),
        [ResultKind::Fields] => {
            Some((FIELDS_ONLY, "Displacement fields are scored: submissions of particles are refused.\n"))
        }
        _ => None,
    }
}

fn is_marked(test: &Path, marker: &str) -> bool {
    test.canonicalize().ok().and_then(|test| Some(test.parent()?.join(marker).exists())).unwrap_or(false)
}

/// Reads the result as for scoring and performs all checks that do not need the truth.
pub(crate) fn particles_or_vectors(
    test: &Path,
    path: &InputFile,
    problems: &mut Vec<String>,
) -> Result<Option<(&'static str, usize, Vec<String>)>> {
    let facts = RecordingFacts::read(test)?;
    let only_particles = facts.is_for_particles_only || is_marked(test, PARTICLES_ONLY);
    let only_fields = facts.is_for_fields_only || is_marked(test, FIELDS_ONLY);
    let known = Conventions { limits: limits(test)?, ..Conventions::default().completed(&facts) };
    let read = results::detect(path).and_then(|format| match format {
        Format::Canonical | Format::Field => {
            results::read(path, &Conventions { format: Some(format), ..known })
        }
        _ => Err(Error::input(format!(
            "{}:1: expected the columns of the template, {}",
            path.display(),
            results_header(only_fields).trim_end()
        ))),
    });
    let found = match read {
        Ok(found) => found,
        Err(e) => {
            problems.extend(e.problems());
            return Ok(None);
        }
    };
    let (kind, rows, n_nan) = match &found {
        TrackerResult::Points(p) => ("particles", p.rows.len(), p.n_nan),
        TrackerResult::Field(f) => ("vectors", f.vectors.len(), f.n_nan),
    };
    if matches!(found, TrackerResult::Points(_)) && only_fields {
        problems.push(format!(
            "{}: particles; this challenge scores displacement fields, with the columns {}",
            path.display(),
            OF_FIELDS.trim_end()
        ));
        return Ok(None);
    }
    if matches!(found, TrackerResult::Field(_)) && only_particles {
        problems.push(format!(
            "{}: vectors; this challenge scores particles only, because the train split reveals the velocity field",
            path.display()
        ));
    }
    problems.extend(measurement::beyond(&facts, path, &found));
    let mut warnings = Vec::new();
    if n_nan > 0 {
        warnings.push(format!("{n_nan} rows without coordinates are ignored"));
    }
    if let (TrackerResult::Points(points), Some((width, height))) = (&found, facts.sensor_px) {
        let on = |v: f64, size: f64| v >= 0.5 && v < size + 0.5;
        let off = points.rows.iter().filter(|r| !(on(r.at.x_px, width) && on(r.at.y_px, height))).count();
        if off > 0 {
            warnings.push(format!("{off} points lie outside the image"));
        }
        let deep = |z: f64| facts.depth_um.is_some_and(|(low, high)| !(low..=high).contains(&z));
        let n_deep = points.rows.iter().filter(|r| points.has_z && deep(r.at.z_um)).count();
        if n_deep > 0 {
            warnings.push(format!("{n_deep} points lie outside the depth range"));
        }
        match (points.has_depth(), facts.is_scored_in_depth()) {
            (true, _) => {}
            // Without depth, the gate would be wider.
            (false, true) => problems.push(format!(
                "{}: no z_um, or 0 in every row; this challenge is scored in depth",
                path.display()
            )),
            (false, false) => warnings.push("no z_um: scored in the image plane only".to_owned()),
        }
        let sure = Limits::for_truth(0, 0, (width * height) as u64).rows;
        if rows > sure {
            warnings.push(format!(
                "more than {sure} rows: scoring refuses results of more than {} rows for each row of the truth",
                Limits::TIMES
            ));
        }
        if points.rows.iter().all(|r| r.track < 0) {
            warnings.push("no point is linked: track scores are not meaningful".to_owned());
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
