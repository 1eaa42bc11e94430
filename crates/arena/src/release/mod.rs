//! `microsig release`: turns a dataset into a challenge with a public part (images) and a withheld part
//! (truth of the test split).
//!
//! ```text
//! OUT/public/      to be published unchanged, all files in one folder
//!   NAME-train.zip  NAME-val.zip      datasets with their truth
//!   NAME-test.zip                     images, calibration and a template for submissions, no truth
//!   commitment.sha256                 SHA-256 of salt and truth archive: the truth cannot be changed later
//!   README.md LICENSE CITATION.cff .zenodo.json croissant.json datapackage.json SHA256SUMS
//! OUT/withheld/    to be kept until the deadline
//!   test/                             the complete test split with its secret key, for scoring submissions
//!   NAME-test-truth.zip  salt.bin     to be published after the deadline
//!   codabench.zip                     a bundle for the Codabench platform, with --codabench
//!   README.md  options.json           instructions; the options of the release
//! ```
//!
//! The package of the test split is built from lists of allowed files and manifest keys rather than by
//! removing secret ones, so that nothing secret can slip in. docs/challenge.md describes the other
//! precautions and their reasons.

mod about;
mod codabench;
mod croissant;
mod deadline;
pub(crate) mod existing;
mod overlap;
mod reveal;
mod splits;
pub(crate) mod submission;
mod test_split;
#[cfg(test)]
mod tests;

pub use deadline::Deadline;
pub(crate) use deadline::UNTIL;
pub use reveal::{RevealOptions, Revealed, reveal};
pub use scenario::derived_seed;
pub use submission::{Submission, SubmissionFiles, Validated, limits, validate};

use std::path::{Path, PathBuf};
use std::time::{Instant, SystemTime};

use clap::Args;
use microsig_core::render::Context;
use serde::Serialize;

use crate::package::Package;
use crate::report::FEWEST;
use generator::runner::{GenerateOptions, generate};
use scenario::license::LICENSE;
use scenario::{Assignment, Scenario};
use scoring::ranking::ranks_fields;
use splits::Train;
use storage::advice;
use storage::advice::option;
use storage::checksums::{self, SHA256SUMS};
use storage::dataset::manifest::{MANIFEST, ResultKind, ScoringRules};
use storage::dataset::secret;
use storage::error::{Error, Result};
use storage::folder::{Earlier, Partial, remove_own};
use storage::{OutputFolder, Progress};

/// Options of a challenge, and of the challenges of a suite.
#[derive(Debug, Clone, Args)]
pub struct ChallengeOptions {
    /// Author to cite, as `Family, Given` or the name of a group; may be repeated
    #[arg(long = "creator", value_name = "NAME")]
    pub creators: Vec<String>,
    /// Last day for submissions, such as 2027-03-01: until it has ended everywhere on Earth
    #[arg(long, value_name = "DATE")]
    pub deadline: Option<Deadline>,
    /// Also write a bundle for the Codabench platform, withheld/codabench.zip
    #[arg(long)]
    pub codabench: bool,
    /// Python wheel of microsig for the bundle's scoring program [default: microsig is installed in the
    /// container]
    #[arg(long, value_name = "FILE", requires = "codabench")]
    pub wheel: Option<PathBuf>,
    /// Continue an interrupted run, also one with --force and --new-keys; a finished challenge is left unchanged with its
    /// secret key
    #[arg(long)]
    pub resume: bool,
    /// Replace existing output
    #[arg(long, short)]
    pub force: bool,
    /// With --force: replace a challenge and draw a new secret key, which invalidates everything published of
    /// it
    #[arg(long, conflicts_with = "resume")]
    pub new_keys: bool,
    #[arg(skip)]
    pub progress: Progress,
    #[arg(skip)]
    pub context: Context,
}

#[derive(Debug, Clone, Args)]
pub struct ReleaseOptions {
    #[arg(skip)]
    pub out: PathBuf,
    /// Scenario values to change in the test split.
    #[arg(skip)]
    pub test_set: Vec<Assignment>,
    /// How results are scored; what is not given follows from the dataset.
    #[arg(skip)]
    pub rules: ScoringRules,
    /// Pairs or frames of the validation split [default: as many as the dataset has]
    #[arg(long, value_name = "N")]
    pub val: Option<u32>,
    /// Pairs or frames of the test split [default: as many as the dataset has]
    #[arg(long, value_name = "N")]
    pub test: Option<u32>,
    /// Publish the exact times of the test split's frames [default: nominal times, without jitter]
    #[arg(long)]
    pub exact_times: bool,
    /// Score displacement fields instead of particles, even if train reveals the flow of test
    #[arg(long)]
    pub fields: bool,
    /// Title of the challenge [default: the dataset's]
    #[arg(long)]
    pub title: Option<String>,
    /// Version of the challenge
    #[arg(long = "release-version", value_name = "TEXT", default_value = "1.0.0")]
    pub version: String,
    /// Options that all challenges of a suite share.
    #[command(flatten)]
    pub challenge: ChallengeOptions,
}

#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Released {
    pub out: PathBuf,
    pub name: String,
    /// Number of images of train, val and test.
    pub images: [u32; 3],
    /// SHA-256 of salt and truth archive.
    pub commitment: String,
    pub deadline: Option<String>,
    /// What participants are scored on: particles, and fields unless the train split reveals the velocity
    /// field of the test split.
    pub scored: Vec<ResultKind>,
    /// Warnings to read before publication.
    pub warnings: Vec<String>,
    /// Duration, s.
    pub seconds: f64,
}

/// Name of the commitment file.
pub const COMMITMENT: &str = "commitment.sha256";
/// Name of the salt file.
pub const SALT: &str = "salt.bin";
/// File that identifies a folder as a release.
const MARK: &str = "public/commitment.sha256";

/// Creates the release, atomically; `None` if it is to be resumed but is already finished.
/// Errors: a deadline that has passed; a dataset that does not verify or whose truth cannot be hidden; an existing release, unless `resume`, or
/// `force` and `new_keys`; an I/O error.
pub fn release(dataset: &Path, options: &ReleaseOptions) -> Result<Option<Released>> {
    let start = Instant::now();
    if existing::is_there(dataset, options)? {
        return Ok(None);
    }
    check_deadline(options.challenge.deadline)?;
    let replaces =
        (options.challenge.force && options.challenge.new_keys) || existing::is_replacing(&options.out);
    let mut train = Train::open(dataset, &options.challenge.context)?;
    let is_ruled = options.rules != ScoringRules::default();
    if is_ruled {
        train.rule(&options.rules)?;
    }
    let (val, test) = (train.val(dataset, options)?, train.test(dataset, options)?);
    let name = &train.scenario.spec.name;
    for (split, of) in [("train", &train.scenario), ("val", &val), ("test", &test)] {
        if of.recordings.frames() < 2 {
            let what =
                "has a single frame; a challenge needs two or more, such as timing: sequence(frames: 2)";
            return Err(Error::input(format!("{}: {split} {what}", dataset.display())));
        }
    }

    if replaces {
        existing::replace(&options.out)?;
    }
    let partial = Partial::start(&options.out)?;
    options.challenge.progress.warn(partial.warning());
    let (public, withheld) = (partial.folder().subfolder("public")?, partial.folder().subfolder("withheld")?);
    keep_private(withheld.path())?;

    let archive = |split: &str| format!("{name}-{split}.zip");
    let ruled;
    let dataset = if is_ruled {
        ruled = partial.folder().nested("train")?;
        make(&train.scenario, &ruled, options.challenge.progress.clone())?;
        ruled.as_path()
    } else {
        dataset
    };
    whole(dataset)?.zip(&format!("{name}-train"), &public, &archive("train"))?;

    let folder = partial.folder().nested("val")?;
    make(&val, &folder, options.challenge.progress.clone())?;
    whole(&folder)?.zip(&format!("{name}-val"), &public, &archive("val"))?;
    remove_own(&folder)?;

    let folder = withheld.nested("test")?;
    make(&test, &folder, options.challenge.progress.clone())?;
    let is_flow_known = compare(dataset, &folder)?;
    let of_fields = options.fields || ranks_fields(&train.rules().rank_by);
    let scored = match (of_fields, is_flow_known) {
        (true, _) => vec![ResultKind::Fields],
        (false, true) => vec![ResultKind::Particles],
        (false, false) => vec![ResultKind::Particles, ResultKind::Fields],
    };
    let units = overlap::units(&folder, &scored)?;
    if let Some((marker, text)) = submission::marker(&scored) {
        withheld.save_bytes(marker, text)?;
    }
    let truth = format!("{name}-test-truth.zip");
    let mut kept = Package::default();
    kept.copy_folder(&folder, |path| !path.starts_with("images/"))?;
    kept.zip(&format!("{name}-test"), &withheld, &truth)?;
    let commitment = commit(&withheld, &truth)?;

    let about = options.texts(&train, &commitment, &scored, is_flow_known);
    let recordings = (!options.exact_times).then_some(&test.recordings);
    test_split::package(dataset, &folder, recordings, &about)?.zip(
        &format!("{name}-test"),
        &public,
        &archive("test"),
    )?;
    if options.challenge.codabench {
        codabench::write(&withheld, (dataset, &folder), &about, options.challenge.wheel.as_deref())?;
    }
    withheld.save_bytes("README.md", about.withheld())?;
    let chosen = serde_json::Value::from(existing::chosen(options));
    withheld.save_bytes(existing::OPTIONS, format!("{chosen:#}\n"))?;
    publish(&public, &about)?;
    if is_ruled {
        remove_own(dataset)?;
    }
    partial.finish(Earlier::new(MARK, replaces))?;
    existing::replaced(&options.out)?;
    Ok(Some(Released {
        out: options.out.clone(),
        name: name.clone(),
        deadline: options.challenge.deadline.map(|deadline| deadline.to_string()),
        scored,
        warnings: warnings(of_fields, is_flow_known, units),
        images: [&train.scenario, &val, &test].map(|s| s.recordings.frames()),
        commitment,
        seconds: start.elapsed().as_secs_f64(),
    }))
}

/// What an organizer should know.
fn warnings(of_fields: bool, is_flow_known: bool, units: usize) -> Vec<String> {
    let known = "the train split reveals the velocity field of the test split, which does not depend on random numbers";
    let change = "a different flow can be set for the test split";
    let mut warnings = match (is_flow_known, of_fields) {
        (false, _) => Vec::new(),
        (true, true) => {
            vec![format!("{known}; fields are scored nevertheless, as README.md states; {change}")]
        }
        (true, false) => vec![format!("{known}; submissions of fields are refused; {change}")],
    };
    // Half of them may be missed.
    warnings.extend((units < 2 * FEWEST).then(|| few(units, of_fields)));
    warnings
}

/// Refuses a deadline that has passed.
pub(crate) fn check_deadline(deadline: Option<Deadline>) -> Result<()> {
    match deadline.filter(|day| day.has_passed(SystemTime::now())) {
        Some(day) => Err(Error::option(advice!(option("deadline").of(day), ": has passed"))),
        None => Ok(()),
    }
}

/// What a test split with few tracks or squares of nodes means.
fn few(units: usize, of_fields: bool) -> String {
    let (of, more) = if of_fields {
        ("squares of 32 px with nodes", "larger images")
    } else {
        ("tracks", "more particles, or more pairs or frames")
    };
    format!(
        "test has {units} {of}, and scores of a result that finds fewer than {FEWEST} are withheld; use {more}"
    )
}

/// Compares the truth of train and test: if they share more particles than expected by chance, the challenge
/// can be solved without the images. Returns whether train reveals the velocity field of test.
fn compare(train: &Path, test: &Path) -> Result<bool> {
    if let Some(shared) = overlap::particles(train, test)?.filter(overlap::Shared::is_beyond_chance) {
        let what = format!(
            "{}: {:.1} % of the tracks of the test split coincide with tracks of the train split, {:.1} % would coincide by chance: \
             the seeding hardly depends on random numbers, so train reveals the truth of test; use a random seeding, or \
             a different one for the test split with ",
            train.display(),
            100.0 * shared.found / shared.tracks as f64,
            100.0 * shared.by_chance / shared.tracks as f64
        );
        return Err(Error::option(advice!(what, option("test_set"))));
    }
    overlap::field(train, test)
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

/// Draws a salt and returns the SHA-256 of salt and archive. Without a salt, a guessed truth could be
/// verified.
fn commit(withheld: &OutputFolder, archive: &str) -> Result<String> {
    let drawn = secret::draw()?;
    withheld.save_bytes(SALT, drawn)?;
    checksums::fingerprint_after(&drawn, &withheld.join(archive)).map(|f| f.sha256.to_string())
}

/// Writes the files that accompany the archives.
fn publish(public: &OutputFolder, about: &about::ReleaseTexts<'_>) -> Result<()> {
    let mut archives = Package::default();
    archives.copy_folder(public.path(), |_| true)?;
    let archives = archives.fingerprints()?;
    let mut package = Package::default();
    // In the format of `sha256sum -c`, with salt and archive on standard input.
    package.write(COMMITMENT, format!("{}  -\n", about.commitment));
    package.write("README.md", about.readme());
    package.write(LICENSE, about.license_text());
    package.write("CITATION.cff", about.citation());
    package.write("croissant.json", about.croissant(&archives));
    let mut all = archives;
    all.extend(package.fingerprints()?);
    package.write(MANIFEST, about.manifest(&all));
    all.extend(package.fingerprints()?);
    package.write(SHA256SUMS, checksums::write(&all));
    // For the publisher only; `cp public/*` skips hidden files, so it has no checksum.
    package.write(".zenodo.json", about.zenodo());
    package.unpack(public)
}

/// Hides the withheld part from other users of the computer.
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
