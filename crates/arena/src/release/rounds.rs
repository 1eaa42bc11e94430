//! Rounds of a challenge: each has a secret key of its own, and the public part lists the earlier ones.
//!
//! A round is a release in a folder of its own, so that the key, truth and scores of the earlier rounds stay
//! where they are. The withheld list also has the SHA-256 of each key file, which tells which key belongs to
//! which round; the public one has the commitment, which does not depend on the key alone.

use std::path::Path;

use serde::{Deserialize, Serialize};

use super::deadline::{Deadline, UNTIL};
use super::{ReleaseOptions, existing};
use dataset::manifest::MANIFEST;
use generator::dataset::secret::KEY_FILE;
use storage::advice;
use storage::advice::option;
use storage::checksums::fingerprint;
use storage::error::{Error, Result};

/// Withheld list of all rounds with their keys.
pub(super) const ROUNDS: &str = "rounds.json";

/// A round of a challenge, as it is published.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Round {
    /// Its number, from 1.
    pub round: u32,
    /// Version of the challenge.
    pub version: String,
    /// Its deadline; `None` if it states none.
    #[serde(default)]
    pub deadline: Option<String>,
    /// SHA-256 of salt and truth archive.
    pub commitment_sha256: String,
    /// SHA-256 of its key file; only in the withheld list.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub key_sha256: Option<String>,
}

/// What the public manifest of a release says of its rounds.
#[derive(Debug, Clone, Default, Deserialize)]
pub(super) struct PublicFacts {
    #[serde(default)]
    pub(super) deadline: Option<String>,
    #[serde(default)]
    pub(super) commitment_sha256: String,
    #[serde(default)]
    round: Option<u32>,
}

/// Name, version and facts of a release, from its public manifest.
#[derive(Debug, Clone)]
pub(super) struct PublicManifest {
    pub(super) name: String,
    pub(super) version: String,
    pub(super) facts: PublicFacts,
}

impl PublicManifest {
    /// Reads the manifest of a release.
    ///
    /// # Errors
    /// A folder that is no release.
    pub(super) fn read(release: &Path) -> Result<Self> {
        let path = release.join("public").join(MANIFEST);
        let no = |what: &str| Error::input(format!("{}: {what}", path.display()));
        if !path.is_file() {
            let what = "not a challenge made by `microsig release`: it has no public";
            return Err(Error::input(format!("{}: {what}/{MANIFEST}", release.display())));
        }
        let value: serde_json::Value =
            serde_json::from_str(&storage::read_text(&path)?).map_err(|e| no(&e.to_string()))?;
        let name = existing::name_of(&value).ok_or_else(|| no("lists no archive of a train split"))?;
        let facts = serde_json::from_value(value["microsig"].clone()).map_err(|e| no(&e.to_string()))?;
        let version = value["version"].as_str().unwrap_or_default().to_owned();
        Ok(PublicManifest { name: name.to_owned(), version, facts })
    }
}

/// The rounds before a new release.
///
/// # Errors
/// A folder that is no complete release, or that the new release would replace.
pub(super) fn before(options: &ReleaseOptions) -> Result<Vec<Round>> {
    let Some(after) = &options.after else { return Ok(Vec::new()) };
    let same = after.canonicalize().ok().zip(options.out.canonicalize().ok());
    if same.is_some_and(|(after, out)| after == out) {
        let hint = ": is the folder of the new round; expected another one, because each round keeps its key and truth";
        return Err(Error::option(advice!(option("after").of(after.display()), hint)));
    }
    until(after)
}

/// All rounds up to that of an existing release, with their keys.
///
/// # Errors
/// A folder that is no complete release; an unreadable list.
fn until(release: &Path) -> Result<Vec<Round>> {
    let PublicManifest { version, facts, .. } = PublicManifest::read(release)?;
    let withheld = release.join("withheld");
    let list = withheld.join(ROUNDS);
    if list.is_file() {
        let text = storage::read_text(&list)?;
        let rounds: Vec<Round> =
            serde_json::from_str(&text).map_err(|e| Error::input(format!("{}: {e}", list.display())))?;
        let is_own = |last: &Round| last.commitment_sha256 == facts.commitment_sha256;
        if !rounds.last().is_some_and(is_own) {
            let what = "its last round does not have the commitment of public";
            return Err(Error::input(format!("{}: {what}/{MANIFEST}", list.display())));
        }
        return Ok(rounds);
    }
    // A release of an earlier version.
    Ok(vec![Round {
        round: facts.round.unwrap_or(1),
        version,
        deadline: facts.deadline,
        commitment_sha256: facts.commitment_sha256,
        key_sha256: Some(key_sha256(&withheld.join("test"))?),
    }])
}

/// SHA-256 of the key file of a test split.
pub(super) fn key_sha256(test: &Path) -> Result<String> {
    Ok(fingerprint(&test.join(KEY_FILE))?.sha256.to_string())
}

/// The public part of a list of rounds: without keys.
pub(super) fn public(rounds: &[Round]) -> Vec<Round> {
    rounds.iter().cloned().map(|round| Round { key_sha256: None, ..round }).collect()
}

/// `rounds.json`.
pub(super) fn list(rounds: &[Round]) -> Result<String> {
    let text = serde_json::to_string_pretty(rounds).map_err(|e| Error::input(e.to_string()))?;
    Ok(text + "\n")
}

/// Deadline and rounds, for README files.
pub(super) fn timetable(deadline: Option<Deadline>, rounds: &[Round]) -> String {
    let mut text = deadline.map(|day| format!("**Deadline: {day}**, {UNTIL}.\n\n")).unwrap_or_default();
    if let [_, .., own] = rounds {
        text += &format!(
            "This is round {}. Each round has images of its own, drawn with a new secret key.\n\n\
             | round | version | deadline | commitment |\n|---|---|---|---|\n",
            own.round
        );
        for Round { round, version, deadline, commitment_sha256, .. } in rounds {
            let deadline = deadline.as_deref().unwrap_or("none");
            text += &format!("| {round} | {version} | {deadline} | `{commitment_sha256}` |\n");
        }
        text.push('\n');
    }
    text
}
