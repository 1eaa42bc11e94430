//! `microsig verify`: checks that a dataset is complete, unchanged and consistent with its manifest.

use std::collections::BTreeMap;
use std::io::ErrorKind;
use std::path::Path;

use glam::DVec3;
use microsig_core::render::Context;
use serde::Serialize;

use super::generate::{GenerateOptions, generate};
use scenario::{self, Scenario, write};
use storage::checksums::{self, Fingerprint, SHA256SUMS};
use storage::dataset::manifest::{MANIFEST, Manifest, RECORDING, Resource, SchemaField, TableSchema};
use storage::dataset::{Row, TableReader, TrackRow};
use storage::folder::{files_below, is_partial};
use storage::{Error, Progress, Result, TemporaryFolder, input, read_text};

/// Summary of a verification.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Verified {
    /// Number of files, all with matching checksums.
    pub files: usize,
    /// Total size of the files, bytes.
    pub bytes: u64,
    /// Whether the dataset was generated again and compared.
    pub regenerated: bool,
}

/// Checks a dataset: no file is missing or additional, and checksums, manifest and tables agree. With
/// `regenerate`, it is generated again from its scenario and compared byte by byte. Errors: [`Error::Input`]
/// if this is not a dataset; [`Error::Failed`] with all failed checks; a file that cannot be read.
pub fn verify(dataset: &Path, regenerate: bool, progress: Progress, context: &Context) -> Result<Verified> {
    if is_partial(dataset) {
        return Err(Error::Failed(vec![format!("{}: unfinished", dataset.display())]));
    }
    let path = dataset.join(SHA256SUMS);
    if !path.is_file() {
        let what =
            if dataset.is_dir() { "not a dataset: it has no SHA256SUMS" } else { "no such file or folder" };
        return Err(Error::input(format!("{}: {what}", dataset.display())));
    }
    let text = read_text(&path)?;
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
            failures.push(format!("{file}: changed: its SHA-256 differs from {SHA256SUMS}"));
        }
    }
    manifest_agrees(dataset, &fingerprints, &mut failures)?;
    // The same checksums can be written with different bytes, for example in another order.
    if failures.is_empty() && checksums::write(&fingerprints) != text {
        failures.push(format!("{SHA256SUMS}: changed, although its checksums are correct"));
    }
    if !failures.is_empty() {
        return Err(Error::Failed(failures));
    }
    if Manifest::read(dataset)?.microsig.kind.as_deref() != Some(RECORDING) {
        scenario_agrees(dataset, regenerate.then_some(progress), &text, context)?;
    } else if regenerate {
        return Err(Error::input(format!(
            "{}: a recording, which cannot be generated again",
            dataset.display()
        )));
    }
    let bytes = fingerprints.values().map(|f| f.bytes).sum();
    Ok(Verified { files: fingerprints.len(), bytes, regenerated: regenerate })
}

/// Checks size and hash of every resource and the columns of every table against the manifest.
fn manifest_agrees(
    dataset: &Path,
    fingerprints: &BTreeMap<String, Fingerprint>,
    failures: &mut Vec<String>,
) -> Result<()> {
    let Some(manifest) = checked(Manifest::read(dataset), failures)? else { return Ok(()) };
    let resources: BTreeMap<&str, &Resource> =
        manifest.resources.iter().map(|r| (r.path.as_str(), r)).collect();
    for (file, fingerprint) in fingerprints.iter().filter(|(file, _)| *file != MANIFEST) {
        match resources.get(file.as_str()) {
            None => failures.push(format!("{file}: not in {MANIFEST}")),
            Some(r) => {
                if r.bytes != fingerprint.bytes || r.sha256() != fingerprint.sha256.to_string() {
                    failures.push(format!("{file}: size or hash differs from {MANIFEST}"));
                }
            }
        }
    }
    for file in resources.keys().filter(|f| !fingerprints.contains_key(**f)) {
        failures.push(format!("{file}: in {MANIFEST} but missing"));
    }
    for (path, resource) in resources {
        if let Some(schema) = resource.schema.as_ref().filter(|_| fingerprints.contains_key(path)) {
            checked(table_agrees(dataset, path, schema), failures)?;
        }
    }
    Ok(())
}

/// Adds what is wrong with a file to the failed checks. Errors: a file that exists and cannot be read: it is
/// neither right nor wrong.
fn checked<T>(result: Result<T>, failures: &mut Vec<String>) -> Result<Option<T>> {
    match result {
        Ok(value) => Ok(Some(value)),
        Err(Error::Read { path, source }) if source.kind() != ErrorKind::NotFound => {
            Err(Error::Read { path, source })
        }
        Err(e) => {
            failures.extend(e.problems());
            Ok(None)
        }
    }
}

/// Checks a table against its schema: the columns, and that each cell has the type of its column.
fn table_agrees(dataset: &Path, path: &str, schema: &TableSchema) -> Result<()> {
    let mut table = TableReader::new(path, input::open(&dataset.join(path))?)?;
    if !table.header().iter().eq(schema.fields.iter().map(|field| &field.name)) {
        return Err(Error::input(format!("{path}: columns differ from {MANIFEST}")));
    }
    while let Some((line, cells)) = table.next_row()? {
        for (cell, SchemaField { name, kind, .. }) in cells.iter().zip(&schema.fields) {
            let fits = cell.is_empty()
                || match kind.as_str() {
                    "integer" => cell.parse::<i64>().is_ok(),
                    "number" => cell.parse::<f64>().is_ok_and(f64::is_finite),
                    _ => true,
                };
            if !fits {
                let what = format!("{name} = {cell:?}: expected a value of type {kind}");
                return Err(Error::input(format!("{path}:{line}: {what}")));
            }
        }
    }
    Ok(())
}

/// Checks that no true particle overlaps a wall of the flow or the box, or a body.
fn particles_in_fluid(dataset: &Path, scenario: &Scenario) -> Result<()> {
    let Some(field) = scenario.field() else { return Ok(()) };
    let fluid = scenario.fluid(field);
    let path = dataset.join(TrackRow::PATH);
    if !path.exists() {
        return Ok(());
    }
    let inside = |_: u64, row: TrackRow| {
        let TrackRow { t_s, x_um: x, y_um: y, z_um: z, d_um: d, .. } = row;
        // Rows are skipped if the table lacks one of the columns.
        if [t_s, x, y, z, d].iter().any(|number| !number.is_finite())
            || fluid.holds(DVec3::new(x, y, z), t_s, 0.5 * d, OVERLAP_UM)
        {
            return Ok(());
        }
        Err(format!("a particle of {d} um at ({x}, {y}, {z}) um overlaps a wall of the flow or a body"))
    };
    let table = TableReader::new(TrackRow::PATH, input::open(&path)?)?;
    table.rows(&[], inside).map(drop).map_err(|e| match e {
        Error::Read { .. } => e,
        wrong => Error::Failed(wrong.messages()),
    })
}

/// Tolerated overlap with a wall, from rounding, um.
const OVERLAP_UM: f64 = 1e-6;

/// Checks that the scenario resolves to itself and, with `regenerate`, that it generates the same bytes
/// again.
fn scenario_agrees(
    dataset: &Path,
    regenerate: Option<Progress>,
    sums: &str,
    context: &Context,
) -> Result<()> {
    let (scenario, text) = scenario::of_dataset(dataset, context)?;
    if write(&scenario.spec)? != text {
        return Err(Error::Failed(vec!["scenario.ron: resolving it yields a different scenario".to_owned()]));
    }
    particles_in_fluid(dataset, &scenario)?;
    let Some(progress) = regenerate else { return Ok(()) };
    let temporary = TemporaryFolder::new()?;
    let out = temporary.path().join("again");
    generate(&scenario, &GenerateOptions { out: out.clone(), force: false, resume: false, progress })?;
    let again = read_text(&out.join(SHA256SUMS))?;
    if again == sums {
        return Ok(());
    }
    let (old, new) = (checksums::read(sums, SHA256SUMS)?, checksums::read(&again, SHA256SUMS)?);
    let differ = |f: &&String| old.get(*f) != new.get(*f);
    let files: std::collections::BTreeSet<&String> = old.keys().chain(new.keys()).filter(differ).collect();
    Err(Error::Failed(
        files.into_iter().map(|f| format!("{f}: has different bytes when generated again")).collect(),
    ))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_that_cannot_be_read_is_neither_right_nor_wrong() {
        let read = |kind| Err::<(), _>(Error::read(Path::new("a.csv"), kind));
        let mut failures = Vec::new();
        assert!(checked(read(ErrorKind::PermissionDenied.into()), &mut failures).is_err());
        assert!(failures.is_empty());
        assert_eq!(checked(read(ErrorKind::NotFound.into()), &mut failures).unwrap(), None);
        assert_eq!(checked(Err::<(), _>(Error::input("a.csv:2: no number")), &mut failures).unwrap(), None);
        assert_eq!(failures.len(), 2, "{failures:?}");
    }
}
