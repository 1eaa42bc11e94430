//! `microsig verify`: is a dataset whole, unchanged and as its manifest says?

use std::collections::BTreeMap;
use std::path::Path;

use serde::Serialize;
use serde_json::Value;

use super::checksums::{self, Fingerprint, SHA256SUMS};
use super::folder::{files_below, is_partial};
use super::manifest::MANIFEST;
use super::secret;
use crate::error::{Error, Result};
use crate::runner::{GenerateOptions, Progress, generate};
use crate::scenario::{self, write};

/// What was verified.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Verified {
    /// Number of files whose checksums agree.
    pub files: usize,
    /// Their size, bytes.
    pub bytes: u64,
    /// Whether the dataset was generated again and compared.
    pub regenerated: bool,
}

/// Checks a dataset: every file there, none more, all checksums, manifest and tables in agreement. With `regenerate` it
/// is made again from its scenario and compared byte by byte.
///
/// # Errors
/// [`Error::Input`] if this is no dataset; [`Error::Failed`] with all that does not hold.
pub fn verify(dataset: &Path, regenerate: bool, progress: Progress) -> Result<Verified> {
    if is_partial(dataset) {
        return Err(Error::Failed(vec![format!("{}: unfinished", dataset.display())]));
    }
    let path = dataset.join(SHA256SUMS);
    if !path.is_file() {
        let what = if dataset.is_dir() { "no dataset, it has no SHA256SUMS" } else { "no such folder" };
        return Err(Error::input(format!("{}: {what}", dataset.display())));
    }
    let text = std::fs::read_to_string(&path).map_err(|e| Error::read(&path, e))?;
    let sums = checksums::read(&text, &path.display().to_string())?;

    let mut failures = Vec::new();
    let present: Vec<String> = files_below(dataset)?.into_iter().filter(|f| f != SHA256SUMS).collect();
    let is_missing = |f: &&String| present.binary_search(f).is_err();
    failures.extend(sums.keys().filter(is_missing).map(|f| format!("{f}: missing")));
    failures.extend(
        present.iter().filter(|f| !sums.contains_key(*f)).map(|f| format!("{f}: not in {SHA256SUMS}")),
    );
    let fingerprints = checksums::fingerprints(dataset, &present)?;
    for (file, fingerprint) in &fingerprints {
        if sums.get(file).is_some_and(|hash| *hash != fingerprint.sha256.to_string()) {
            failures.push(format!("{file}: changed, its SHA-256 is not the one in {SHA256SUMS}"));
        }
    }
    manifest_agrees(dataset, &fingerprints, &mut failures);
    // What other programs may read as the same sums is not the same bytes.
    if failures.is_empty() && checksums::write(&fingerprints) != text {
        failures.push(format!("{SHA256SUMS}: changed, though its sums are right"));
    }
    if !failures.is_empty() {
        return Err(Error::Failed(failures));
    }
    scenario_agrees(dataset, regenerate.then_some(progress), &text)?;
    let bytes = fingerprints.values().map(|f| f.bytes).sum();
    Ok(Verified { files: fingerprints.len(), bytes, regenerated: regenerate })
}

/// Size and hash of every resource, and the columns of every table, are what the manifest says.
fn manifest_agrees(dataset: &Path, fingerprints: &BTreeMap<String, Fingerprint>, failures: &mut Vec<String>) {
    let read = std::fs::read_to_string(dataset.join(MANIFEST)).map_err(|e| e.to_string());
    let manifest = match read.and_then(|text| serde_json::from_str::<Value>(&text).map_err(|e| e.to_string()))
    {
        Ok(manifest) => manifest,
        Err(e) => return failures.push(format!("{MANIFEST}: {e}")),
    };
    let resources: BTreeMap<&str, &Value> = manifest["resources"]
        .as_array()
        .into_iter()
        .flatten()
        .filter_map(|r| r["path"].as_str().map(|path| (path, r)))
        .collect();
    for (file, fingerprint) in fingerprints.iter().filter(|(file, _)| *file != MANIFEST) {
        match resources.get(file.as_str()) {
            None => failures.push(format!("{file}: not in {MANIFEST}")),
            Some(r) => {
                if r["bytes"] != fingerprint.bytes || r["hash"] != format!("sha256:{}", fingerprint.sha256) {
                    failures.push(format!("{file}: size or hash is not the one in {MANIFEST}"));
                }
            }
        }
    }
    for file in resources.keys().filter(|f| !fingerprints.contains_key(**f)) {
        failures.push(format!("{file}: in {MANIFEST} but missing"));
    }
    for (path, resource) in resources {
        if fingerprints.contains_key(path) && resource["schema"].is_object() {
            failures.extend(
                table_disagrees(&dataset.join(path), &resource["schema"]).map(|e| format!("{path}{e}")),
            );
        }
    }
}

/// The first thing in which a table is not as its schema says: the columns, or a cell that is not of its column's type.
fn table_disagrees(path: &Path, schema: &Value) -> Option<String> {
    let fields: Vec<(&str, &str)> = schema["fields"]
        .as_array()
        .into_iter()
        .flatten()
        .filter_map(|f| Some((f["name"].as_str()?, f["type"].as_str()?)))
        .collect();
    let mut reader = match csv::Reader::from_path(path) {
        Ok(reader) => reader,
        Err(e) => return Some(format!(": {e}")),
    };
    match reader.headers() {
        Ok(header) if header.iter().eq(fields.iter().map(|(name, _)| *name)) => {}
        Ok(_) => return Some(format!(": columns are not those in {MANIFEST}")),
        Err(e) => return Some(format!(": {e}")),
    }
    let mut record = csv::StringRecord::new();
    loop {
        match reader.read_record(&mut record) {
            Ok(true) => {}
            Ok(false) => return None,
            Err(e) => return Some(format!(": {e}")),
        }
        for (cell, (name, kind)) in record.iter().zip(&fields) {
            let fits = cell.is_empty()
                || match *kind {
                    "integer" => cell.parse::<i64>().is_ok(),
                    "number" => cell.parse::<f64>().is_ok_and(f64::is_finite),
                    _ => true,
                };
            if !fits {
                let line = record.position().map_or(0, csv::Position::line);
                return Some(format!(":{line}: {name} = {cell:?}: expected a value of type {kind}"));
            }
        }
    }
}

/// The scenario resolves to itself and, if asked for, makes the same bytes again.
fn scenario_agrees(dataset: &Path, regenerate: Option<Progress>, sums: &str) -> Result<()> {
    let (mut scenario, text) = scenario::of_dataset(dataset)?;
    if let Some(streams) = secret::streams(dataset)? {
        scenario.streams = streams;
    }
    if write(&scenario.spec)? != text {
        return Err(Error::Failed(vec!["scenario.ron: resolving it gives another scenario".to_owned()]));
    }
    let Some(progress) = regenerate else { return Ok(()) };
    let place = tempfile::tempdir().map_err(Error::write(&std::env::temp_dir()))?;
    let out = place.path().join("again");
    generate(&scenario, &GenerateOptions { out: out.clone(), force: false, resume: false, progress })?;
    let again = std::fs::read_to_string(out.join(SHA256SUMS)).map_err(Error::write(&out))?;
    if again == sums {
        return Ok(());
    }
    let (old, new) = (checksums::read(sums, SHA256SUMS)?, checksums::read(&again, SHA256SUMS)?);
    let differ = |f: &&String| old.get(*f) != new.get(*f);
    let files: std::collections::BTreeSet<&String> = old.keys().chain(new.keys()).filter(differ).collect();
    Err(Error::Failed(
        files.into_iter().map(|f| format!("{f}: generated again, it has other bytes")).collect(),
    ))
}
