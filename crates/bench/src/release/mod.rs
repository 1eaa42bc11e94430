//! `microsig release`: a dataset becomes a challenge, a public part with images and a withheld part with the truth of the
//! test split.
//!
//! ```text
//! OUT/public/      to be published as it is, all files side by side
//!   NAME-train.zip  NAME-val.zip      datasets with their truth
//!   NAME-test.zip                     images, calibration and a template for submissions, no truth
//!   commitment.sha256                 SHA-256 of salt and truth archive: the truth cannot be changed afterwards
//!   README.md LICENSE CITATION.cff .zenodo.json croissant.json datapackage.json SHA256SUMS
//! OUT/withheld/    to be kept until the deadline
//!   test/                             the test split as a whole dataset, with its secret key: submissions are scored on it
//!   NAME-test-truth.zip  salt.bin     what is published in the end
//!   README.md                         what to do with it
//! ```
//!
//! What a participant must not learn about the test split never enters its package: files and manifest keys are listed
//! here one by one, not copied but for some. docs/challenge.md says what else is done and why.

mod about;
mod package;
mod splits;
mod submission;
mod test_split;

pub use about::About;
pub use splits::derived_seed;
pub use submission::{Files as SubmissionFiles, Submission, Validated, validate};

use std::path::{Path, PathBuf};
use std::time::Instant;

use serde::Serialize;

use crate::dataset::checksums::{self, SHA256SUMS};
use crate::dataset::folder::{Partial, may_stand};
use crate::dataset::manifest::MANIFEST;
use crate::dataset::save_bytes;
use crate::dataset::secret;
use crate::error::{Error, Result};
use crate::runner::{GenerateOptions, Progress, generate};
use crate::scenario::Scenario;
use crate::scenario::license::LICENSE;
use package::Package;
use splits::Train;

/// How to release.
#[derive(Debug, Clone)]
pub struct Options {
    /// The release's folder.
    pub out: PathBuf,
    /// Replace a release of that name.
    pub force: bool,
    /// Pairs or frames of the validation split; `None`: as many as the dataset has.
    pub val: Option<u32>,
    /// Pairs or frames of the test split; `None`: as many as the dataset has.
    pub test: Option<u32>,
    /// Values of the scenario that are others in the test split: `path=value`.
    pub test_set: Vec<String>,
    /// Tell when the frames of the test split were taken, not only when they were meant to be.
    pub exact_times: bool,
    /// Who releases what.
    pub about: About,
    /// Whether to show bars.
    pub progress: Progress,
}

/// What was released.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Released {
    /// The release's folder.
    pub out: PathBuf,
    /// Name of the challenge.
    pub name: String,
    /// Images of train, val and test.
    pub images: [u32; 3],
    /// SHA-256 of salt and truth archive.
    pub commitment: String,
    /// Duration, s.
    pub seconds: f64,
}

/// Name of the commitment's file.
pub const COMMITMENT: &str = "commitment.sha256";
/// Name of the salt's file.
pub const SALT: &str = "salt.bin";
/// The file that tells a release from other folders.
const MARK: &str = "public/commitment.sha256";

/// Makes the release. It appears whole or not at all.
///
/// # Errors
/// A dataset that does not verify or cannot hide its truth; a release that stands in the way; writing.
pub fn release(dataset: &Path, options: &Options) -> Result<Released> {
    let start = Instant::now();
    may_stand(&options.out, options.force.then_some(MARK))?;
    let train = Train::open(dataset)?;
    let (val, test) = (train.val(dataset, options)?, train.test(dataset, options)?);
    let name = &train.scenario.spec.name;

    let partial = Partial::anew(&options.out)?;
    let (public, withheld) = (partial.folder().join("public"), partial.folder().join("withheld"));
    std::fs::create_dir(&public).map_err(Error::write(&public))?;
    std::fs::create_dir(&withheld).map_err(Error::write(&withheld))?;
    keep_private(&withheld)?;

    let archive = |split: &str| public.join(format!("{name}-{split}.zip"));
    whole(dataset)?.zip(&format!("{name}-train"), &archive("train"))?;

    let folder = partial.folder().join("val");
    make(&val, &folder, options.progress.clone())?;
    whole(&folder)?.zip(&format!("{name}-val"), &archive("val"))?;
    std::fs::remove_dir_all(&folder).map_err(Error::write(&folder))?;

    let folder = withheld.join("test");
    make(&test, &folder, options.progress.clone())?;
    let truth = withheld.join(format!("{name}-test-truth.zip"));
    let mut kept = Package::default();
    kept.copy_folder(&folder, |path| !path.starts_with("images/"))?;
    kept.zip(&format!("{name}-test"), &truth)?;
    let commitment = commit(&withheld.join(SALT), &truth)?;

    let about = options.about.of(&train, &commitment);
    let recordings = (!options.exact_times).then_some(&test.recordings);
    test_split::package(dataset, &folder, recordings, &about)?
        .zip(&format!("{name}-test"), &archive("test"))?;
    save_bytes(&withheld.join("README.md"), about.withheld().as_bytes())?;
    publish(&public, &about)?;
    partial.finish(options.force.then_some(MARK))?;
    Ok(Released {
        out: options.out.clone(),
        name: name.clone(),
        images: [&train.scenario, &val, &test].map(|s| s.recordings.frames()),
        commitment,
        seconds: start.elapsed().as_secs_f64(),
    })
}

fn make(scenario: &Scenario, out: &Path, progress: Progress) -> Result<()> {
    let options = GenerateOptions { out: out.to_owned(), force: false, resume: false, progress };
    generate(scenario, &options).map(drop)
}

fn whole(folder: &Path) -> Result<Package> {
    let mut package = Package::default();
    package.copy_folder(folder, |_| true)?;
    Ok(package)
}

/// Draws a salt and gives the SHA-256 of it and the archive. Without the salt, whoever guesses a truth could check it.
fn commit(salt: &Path, archive: &Path) -> Result<String> {
    let drawn = secret::draw()?;
    save_bytes(salt, &drawn)?;
    checksums::fingerprint_after(&drawn, archive).map(|f| f.sha256.to_string())
}

/// Writes what lies beside the archives.
fn publish(public: &Path, about: &about::Facts<'_>) -> Result<()> {
    let mut archives = Package::default();
    archives.copy_folder(public, |_| true)?;
    let archives = archives.fingerprints()?;
    let mut package = Package::default();
    // As `sha256sum -c` reads it, the archive being its standard input.
    package.write(COMMITMENT, format!("{}  -\n", about.commitment));
    package.write("README.md", about.readme());
    package.write(LICENSE, about.licence());
    package.write("CITATION.cff", about.citation());
    package.write("croissant.json", about.croissant(&archives));
    let mut all = archives;
    all.extend(package.fingerprints()?);
    package.write(MANIFEST, about.manifest(&all));
    all.extend(package.fingerprints()?);
    package.write(SHA256SUMS, checksums::write(&all));
    // For whoever publishes; those who copy `public/*` do not even see it, so it has no checksum.
    package.write(".zenodo.json", about.zenodo());
    package.unpack(public)
}

/// Others on the machine need not see the withheld part.
#[cfg(unix)]
fn keep_private(folder: &Path) -> Result<()> {
    use std::os::unix::fs::PermissionsExt;
    let mode = std::fs::Permissions::from_mode(0o700);
    std::fs::set_permissions(folder, mode).map_err(Error::write(folder))
}

#[cfg(not(unix))]
fn keep_private(_: &Path) -> Result<()> {
    Ok(())
}
