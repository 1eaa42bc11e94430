//! Existing challenges: their secret keys are not replaced by accident.
//!
//! Images and commitment of a challenge may have been published. A new key would draw different images and a
//! different truth, against which no submission could be scored.

use std::io::Read;
use std::path::{Path, PathBuf};

use serde::Deserialize;
use serde_json::{Value, json};

use super::{MARK, ReleaseOptions};
use scenario::SCENARIO;
use storage::advice;
use storage::advice::{flag, option};
use storage::checksums::SHA256SUMS;
use storage::dataset::manifest::{MANIFEST, Manifest, ScoringRules};
use storage::error::{Error, Result};
use storage::folder::{Earlier, check_replaceable};

/// The file beside a challenge that is being replaced with a new key: an interrupted replacement is continued, because
/// the key to be replaced may be known.
fn replacing(out: &Path) -> PathBuf {
    let name = out.file_name().unwrap_or_default().to_string_lossy();
    out.with_file_name(format!(".{name}.new-keys"))
}

/// Marks a challenge, if there is one, as being replaced with a new key.
pub(crate) fn replace(out: &Path) -> Result<()> {
    if out.join(MARK).is_file() { storage::save_bytes(&replacing(out), b"") } else { Ok(()) }
}

/// Removes the mark of [`replace`].
pub(super) fn replaced(out: &Path) -> Result<()> {
    remove_if_there(&replacing(out))
}

/// Removes a file, if it exists.
pub(crate) fn remove_if_there(file: &Path) -> Result<()> {
    match std::fs::remove_file(file) {
        Err(e) if e.kind() != std::io::ErrorKind::NotFound => Err(Error::write(file)(e)),
        _ => Ok(()),
    }
}

/// Whether the replacement of a challenge has begun.
pub(super) fn is_replacing(out: &Path) -> bool {
    replacing(out).exists()
}

/// Whether there is a challenge that is not being replaced.
pub(crate) fn is_made(out: &Path) -> bool {
    out.join(MARK).is_file() && !is_replacing(out)
}

/// Whether the release already exists and is to be left unchanged.
/// Errors: an existing challenge, unless it was made from the dataset and `options.challenge.resume` keeps it, or
/// `options.challenge.force` and `options.challenge.new_keys` replace it, or `options.challenge.resume` continues that; any other folder that is not empty.
pub(super) fn is_there(dataset: &Path, options: &ReleaseOptions) -> Result<bool> {
    let out = &options.out;
    if !out.join(MARK).is_file() {
        check_replaceable(out, Earlier::new(MARK, options.challenge.force))?;
        return Ok(false);
    }
    if options.challenge.resume && is_made(out) {
        return belongs(dataset, options).map(|()| true);
    }
    let may_go_on = options.challenge.resume || (options.challenge.force && options.challenge.new_keys);
    if !may_go_on {
        if is_replacing(out) {
            let hint = format!(" continues it; to keep the key instead, remove {}", replacing(out).display());
            let what = "its replacement with a new secret key was interrupted: ";
            return Err(Error::Exists { path: out.clone(), hint: advice!(what, flag("resume"), hint) });
        }
        let hint = advice!(
            "is a challenge with its secret key: ",
            flag("resume"),
            " leaves it unchanged, ",
            flag("force"),
            " with ",
            flag("new_keys"),
            " replaces it by another one, for which nothing that has been published of it holds"
        );
        return Err(Error::Exists { path: out.clone(), hint });
    }
    check_replaceable(out, Earlier::new(MARK, true)).map(|()| false)
}

/// Checks that a challenge was made from this dataset, in this version: its archive of train has the
/// dataset's checksums.
fn belongs(dataset: &Path, options: &ReleaseOptions) -> Result<()> {
    let out = &options.out;
    let refuse = |what: &str| {
        let (force, keys) = (flag("force"), flag("new_keys"));
        let how = " replaces the challenge and its secret key";
        Err(Error::Exists {
            path: out.clone(),
            hint: advice!(what, "; cannot resume; ", force, " with ", keys, how),
        })
    };
    let manifest = storage::read_text(&out.join("public").join(MANIFEST))?;
    let manifest: serde_json::Value = serde_json::from_str(&manifest).unwrap_or_default();
    let Some(name) = name_of(&manifest) else { return refuse("lists no archive of a train split") };
    let version = &options.version;
    if manifest["version"].as_str() != Some(version) {
        return refuse(&format!("does not have version {version}"));
    }
    let of_dataset = Manifest::read(dataset)?.microsig.scoring.unwrap_or_default();
    let is_ruled = options.rules != ScoringRules::default();
    let rules =
        if is_ruled { ScoringRules { suite: None, ..options.rules.or(&of_dataset) } } else { of_dataset };
    let found = serde_json::from_value(manifest["microsig"]["scoring"].clone());
    if !found.is_ok_and(|found: Option<ScoringRules>| found.unwrap_or_default() == rules) {
        return refuse("was made with other gates");
    }
    // With gates of the release, train has another scenario, card and manifest than the dataset.
    let changed = [SCENARIO, MANIFEST, "README.md"];
    let is_kept =
        |line: &&str| !(is_ruled && changed.iter().any(|file| line.ends_with(&format!("  {file}"))));
    let sums = storage::read_text(&dataset.join(SHA256SUMS))?;
    let of_train = sums_of_train(out, name).unwrap_or_default();
    if !of_train.lines().filter(is_kept).eq(sums.lines().filter(is_kept)) {
        return refuse(&format!("was not made from {}", dataset.display()));
    }
    // Challenges of earlier versions have no record of their options.
    let path = out.join("withheld").join(OPTIONS);
    if !path.is_file() {
        return Ok(());
    }
    let made: serde_json::Map<String, Value> =
        serde_json::from_str(&storage::read_text(&path)?).unwrap_or_default();
    let shown = |value: Option<&Value>| match value {
        None | Some(Value::Null) => "none".to_owned(),
        Some(Value::String(text)) => text.clone(),
        Some(value) => value.to_string(),
    };
    for (name, now) in chosen(options) {
        if made.get(&name) != Some(&now) {
            let what = format!(" {}, not {}; ", shown(made.get(&name)), shown(Some(&now)));
            let (option, again) = (option(&name.replace('-', "_")), " needs the options of the first run");
            let hint = advice!("was made with ", option, what, flag("resume"), again);
            return Err(Error::Exists { path: out.clone(), hint });
        }
    }
    Ok(())
}

/// File in the withheld part with the options with which a challenge was made.
pub(super) const OPTIONS: &str = "options.json";

/// The options that shape a challenge, by name, besides gates and version.
pub(super) fn chosen(options: &ReleaseOptions) -> serde_json::Map<String, Value> {
    let assigned = options.test_set.iter().map(|of| format!("{}={}", of.path, of.value));
    let all = [
        ("val", json!(options.val)),
        ("test", json!(options.test)),
        ("test_set", json!(assigned.collect::<Vec<_>>())),
        ("exact_times", json!(options.exact_times)),
        ("fields", json!(options.fields)),
        ("codabench", json!(options.challenge.codabench)),
        ("deadline", json!(options.challenge.deadline.map(|day| day.to_string()))),
        ("title", json!(options.title)),
        ("creator", json!(options.challenge.creators)),
    ];
    all.into_iter().map(|(name, value)| (name.to_owned(), value)).collect()
}

/// Deadline and commitment in the public manifest of a release.
#[derive(Debug, Clone, Default, Deserialize)]
pub(super) struct PublicFacts {
    #[serde(default)]
    pub(super) deadline: Option<String>,
    #[serde(default)]
    pub(super) commitment_sha256: String,
}

/// Name and facts of a release, from its public manifest.
#[derive(Debug, Clone)]
pub(super) struct PublicManifest {
    pub(super) name: String,
    pub(super) facts: PublicFacts,
}

impl PublicManifest {
    /// Reads the manifest of a release.
    pub(super) fn read(release: &Path) -> Result<Self> {
        let path = release.join("public").join(MANIFEST);
        let no = |what: &str| Error::input(format!("{}: {what}", path.display()));
        if !release.exists() {
            return Err(Error::input(format!("{}: no such file or folder", release.display())));
        }
        if !path.is_file() {
            let what = "not a challenge made by `microsig release`: it has no public";
            return Err(Error::input(format!("{}: {what}/{MANIFEST}", release.display())));
        }
        let value: serde_json::Value =
            serde_json::from_str(&storage::read_text(&path)?).map_err(|e| no(&e.to_string()))?;
        let name = name_of(&value).ok_or_else(|| no("lists no archive of a train split"))?;
        let facts = serde_json::from_value(value["microsig"].clone()).map_err(|e| no(&e.to_string()))?;
        Ok(PublicManifest { name: name.to_owned(), facts })
    }
}

/// The name of a challenge, from the archive of train in its manifest.
fn name_of(manifest: &serde_json::Value) -> Option<&str> {
    let resources = manifest["resources"].as_array().into_iter().flatten();
    resources.filter_map(|of| of["path"].as_str()).find_map(|path| path.strip_suffix("-train.zip"))
}

/// Maximum size of a list of checksums, bytes; a million files take 100 MB.
const LONGEST: u64 = 1 << 30;

/// The checksums in the archive of the train split.
fn sums_of_train(out: &Path, name: &str) -> Option<String> {
    let archive = storage::input::open(&out.join("public").join(format!("{name}-train.zip"))).ok()?;
    let mut archive = zip::ZipArchive::new(archive).ok()?;
    let entry = archive.by_name(&format!("{name}-train/{SHA256SUMS}")).ok()?;
    let mut text = String::new();
    entry.take(LONGEST).read_to_string(&mut text).ok()?;
    Some(text)
}
