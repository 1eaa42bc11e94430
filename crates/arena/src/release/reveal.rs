//! `microsig reveal`: publishes the truth of a challenge after its deadline.
//!
//! ```text
//! OUT/  NAME-test-truth.zip  salt.bin    the truth of the test split with its key, and the salt
//!       commitment.sha256                a copy of the published one, which both files match
//!       README.md  SHA256SUMS
//! ```
//!
//! The truth is written only if it matches the commitment: participants can check it against the copy that
//! they downloaded before the deadline.

use std::io::Read;
use std::path::{Path, PathBuf};
use std::time::SystemTime;

use clap::Args;
use serde::Serialize;

use super::deadline::{Deadline, UNTIL};
use super::existing::PublicManifest;
use super::{COMMITMENT, SALT};
use crate::package::Package;
use storage::advice;
use storage::advice::flag;
use storage::argument::folder;
use storage::checksums::{self, SHA256SUMS};
use storage::error::{Error, Result};
use storage::folder::{Earlier, Partial, check_replaceable};

#[derive(Debug, Clone, Args)]
pub struct RevealOptions {
    /// Folder to be published
    #[arg(long, short, value_name = "DIR", value_parser = folder())]
    pub out: PathBuf,
    /// Also before the deadline, or without one
    #[arg(long)]
    pub early: bool,
    /// Replace existing output
    #[arg(long, short)]
    pub force: bool,
    /// The time at which the deadline is checked.
    #[arg(skip = SystemTime::now())]
    pub now: SystemTime,
}

/// Summary of a publication.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Revealed {
    /// The folder to be published.
    pub out: PathBuf,
    pub name: String,
    /// Its deadline, if it states one.
    pub deadline: Option<String>,
    /// The commitment that the truth matches.
    pub commitment: String,
    /// Warning of a file system without locks.
    #[serde(skip)]
    pub warning: Option<String>,
}

/// Writes the truth of a challenge into a folder, after checking it against the published commitment.
/// Errors: a deadline that has not passed, or no deadline, unless `early`; files that do not match the commitment; an existing
/// folder, unless `force`.
pub fn reveal(challenge: &Path, options: &RevealOptions) -> Result<Revealed> {
    let earlier = Earlier::new(COMMITMENT, options.force);
    check_replaceable(&options.out, earlier)?;
    let PublicManifest { name, facts } = PublicManifest::read(challenge)?;
    let refuse = |why: String, hint: &str| {
        let what = format!("{}: {why}; ", challenge.display());
        Err(Error::option(advice!(what, flag("early"), hint)))
    };
    let deadline: Option<Deadline> =
        facts.deadline.as_deref().map(str::parse).transpose().map_err(|what: String| {
            Error::input(format!("{}: microsig.deadline: {what}", challenge.display()))
        })?;
    match deadline {
        _ if options.early => {}
        None => {
            let hint = " publishes the truth, after which no result is blind";
            return refuse("states no deadline".to_owned(), hint);
        }
        Some(deadline) if !deadline.has_passed(options.now) => {
            let hint = " publishes the truth nevertheless, after which no result is blind";
            return refuse(format!("its deadline is {deadline} ({UNTIL})"), hint);
        }
        Some(_) => {}
    }
    let (public, withheld) = (challenge.join("public"), challenge.join("withheld"));
    let published = storage::read_text(&public.join(COMMITMENT))?;
    let archive = format!("{name}-test-truth.zip");
    let (salt, truth) = (withheld.join(SALT), withheld.join(&archive));
    let mut drawn = Vec::new();
    storage::input::open(&salt)?.read_to_end(&mut drawn).map_err(|e| Error::read(&salt, e))?;
    let commitment = checksums::fingerprint_after(&drawn, &truth)?.sha256.to_string();
    let is_promised = published.split_whitespace().next() == Some(&commitment);
    if !is_promised || facts.commitment_sha256 != commitment {
        let what = format!(
            "withheld/{SALT} and withheld/{archive} do not match public/{COMMITMENT}: they are not the truth that was promised"
        );
        return Err(Error::input(format!("{}: {what}", challenge.display())));
    }

    let partial = Partial::start(&options.out)?;
    let warning = partial.warning().map(str::to_owned);
    let folder = partial.folder();
    let mut package = Package::default();
    package.write(SALT, drawn);
    package.write(COMMITMENT, published);
    package.write("README.md", readme(&name, &archive, &commitment));
    package.unpack(folder)?;
    folder.place(&archive, &truth, false)?;
    package.copy(&archive, folder.join(&archive));
    let sums = checksums::write(&package.fingerprints()?);
    folder.save_bytes(SHA256SUMS, sums)?;
    partial.finish(earlier)?;
    let deadline = deadline.map(|deadline| deadline.to_string());
    Ok(Revealed { out: options.out.clone(), name, deadline, commitment, warning })
}

fn readme(name: &str, archive: &str, commitment: &str) -> String {
    format!(
        "# {name}: truth of the test split\n\n\
         `{archive}` is the truth with the scenario and the secret key of the test split. Its commitment, `{commitment}`, was published with \
         the challenge. To check that nothing was changed since, use your own copy of `{COMMITMENT}`:\n\n\
         ```sh\n\
         cat {SALT} {archive} | sha256sum -c {COMMITMENT}           # the truth matches the commitment\n\
         unzip {archive} -d revealed\n\
         cp -r {name}-test/images revealed/{name}-test/           # from the archive {name}-test.zip of the challenge\n\
         microsig verify revealed/{name}-test --regenerate        # scenario and key reproduce images and truth\n\
         microsig evaluate revealed/{name}-test results.csv\n\
         ```\n"
    )
}
