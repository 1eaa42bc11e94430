//! `microsig suite generate` and `check`: generates the datasets of a suite, and checks whether they still
//! have the frozen checksums.
//!
//! ```text
//! OUT/suite.json                 name, version and size of the suite
//! OUT/TRACK/CASE/{train,val,test}/   a dataset each, or SPLIT.failed with the reason
//! OUT/suite.csv                  all datasets, once they are complete
//! ```

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::time::Instant;

use microsig_core::render::Context;
use serde::{Deserialize, Serialize};

use super::generate::{GenerateOptions, generate};
use super::shard::Shard;
use super::sweep::{Outcome, Swept, attempt, reason, refuse_existing};
use super::verify::verify;
use scenario::{Size, Split, Suite, SuiteCase, resolve};
use storage::checksums::{Fingerprint, SHA256SUMS};
use storage::dataset::manifest::{MANIFEST, Manifest};
use storage::{Error, Progress, Result, TemporaryFolder, advice, read_text, save_changed};

/// The datasets of a suite to work on.
#[derive(Debug, Clone, Default)]
pub struct SuiteSelection {
    /// Only this track.
    pub track: Option<String>,
    /// Only this case.
    pub case: Option<String>,
    /// Only this split.
    pub split: Option<Split>,
    /// Every N-th dataset only.
    pub shard: Shard,
}

impl SuiteSelection {
    /// The chosen datasets of a size, in order.
    pub fn of(&self, suite: &Suite, size: Size) -> Result<Vec<(SuiteCase, Split)>> {
        if let Some(track) = &self.track {
            suite.track(track)?;
        }
        let mut cases = suite.cases(size)?;
        cases.retain(|case| self.track.as_ref().is_none_or(|track| case.track == *track));
        if let Some(name) = &self.case {
            let names: Vec<String> = cases.iter().map(|case| case.name.clone()).collect();
            cases.retain(|case| case.name == *name);
            if cases.is_empty() {
                let (size, names) = (size.name(), names.join(", "));
                let what = format!(": size {size} has the cases {names}");
                return Err(Error::option(advice!(advice::option("case").is(name), what)));
            }
        }
        let all = cases.into_iter().flat_map(|case| Split::ALL.map(|split| (case.clone(), split)));
        let chosen = all.filter(|(_, split)| self.split.is_none_or(|only| only == *split));
        Ok(chosen.enumerate().filter(|(i, _)| self.shard.has(*i)).map(|(_, one)| one).collect())
    }

    /// Whether these are all datasets.
    pub fn is_all(&self) -> bool {
        self.track.is_none() && self.case.is_none() && self.split.is_none() && self.shard == Shard::ALL
    }
}

/// Options of [`generate_suite`].
#[derive(Debug, Clone)]
pub struct SuiteOptions {
    /// Folder of the generated suite.
    pub out: PathBuf,
    /// Replace existing datasets.
    pub force: bool,
    /// Skip finished datasets and continue interrupted ones.
    pub resume: bool,
    /// How progress is shown.
    pub progress: Progress,
    /// Where renderers keep their tables.
    pub context: Context,
}

/// `suite.json`: identifies the suite in a folder.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct SuiteRecord {
    /// Name of the suite.
    pub name: String,
    /// Version of the suite.
    pub version: String,
    /// Size.
    pub size: Size,
    /// In a release: the hash of the images of each test split, by `TRACK/CASE`.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub images_sha256: BTreeMap<String, String>,
    /// In a release: the last day for submissions.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub deadline: Option<String>,
}

/// Name of the record.
pub const RECORD: &str = "suite.json";
/// Name of the table of all datasets.
const TABLE: &str = "suite.csv";

impl SuiteRecord {
    /// The record of a generated suite.
    pub fn of(suite: &Suite, size: Size) -> Self {
        let (name, version) = (suite.spec.name.clone(), suite.spec.version.clone());
        SuiteRecord { name, version, size, images_sha256: BTreeMap::new(), deadline: None }
    }

    /// The suite with its version and size.
    pub fn edition(&self) -> String {
        format!("{} {}, size {}", self.name, self.version, self.size.name())
    }

    /// Whether this is a release, whose test splits have secret keys.
    pub fn is_release(&self) -> bool {
        !self.images_sha256.is_empty()
    }

    /// The test split of a `TRACK/CASE` in the folder of the record: as generated, as released, or as unpacked by
    /// participants.
    pub fn test_split(&self, folder: &Path, case: &str) -> Option<PathBuf> {
        let unpacked = format!("{}-{}-test", self.name, case.to_lowercase().replace('/', "-"));
        let places = [format!("{case}/test"), format!("{case}/withheld/test"), unpacked];
        places.iter().map(|place| folder.join(place)).find(|place| place.is_dir())
    }

    /// Reads the record of a generated suite.
    pub fn read(folder: &Path) -> Result<Self> {
        let path = folder.join(RECORD);
        if !path.is_file() {
            let hint =
                format!("has no {RECORD}; expected a folder of `microsig suite generate` or `suite release`");
            return Err(Error::input(format!("{}: {hint}", folder.display())));
        }
        storage::json::parse(&read_text(&path)?).map_err(|e| Error::input(format!("{}: {e}", path.display())))
    }

    /// Refuses a folder of another suite, version or size.
    pub fn matches(&self, suite: &Suite, folder: &Path) -> Result<()> {
        let expected = SuiteRecord::of(suite, self.size);
        if (&self.name, &self.version) == (&expected.name, &expected.version) {
            return Ok(());
        }
        Err(Error::input(format!(
            "{}: contains {} {}, expected {} {}",
            folder.join(RECORD).display(),
            self.name,
            self.version,
            expected.name,
            expected.version
        )))
    }
}

/// Refuses a dataset with other rules than its case; one of an earlier version may state none unless
/// `stated`. Errors: [`Error::Input`] with the dataset.
pub fn check_rules(case: &SuiteCase, dataset: &Path, stated: bool) -> Result<()> {
    match Manifest::read(dataset)?.microsig.scoring {
        None if !stated => Ok(()),
        Some(rules) if rules == case.rules => Ok(()),
        _ => {
            let what = "its gates and scores differ from the suite's; generate it again";
            Err(Error::input(format!("{}: {what}", dataset.display())))
        }
    }
}

/// Generates the chosen datasets of a suite. One that fails is recorded with the reason and does not stop the
/// others. Errors: a folder that contains another suite, version or size; an existing dataset, unless
/// `resume` or `force`; an I/O error.
pub fn generate_suite(
    suite: &Suite,
    size: Size,
    chosen: &SuiteSelection,
    options: &SuiteOptions,
) -> Result<Swept> {
    let start = Instant::now();
    let mine = chosen.of(suite, size)?;
    let out = &options.out;
    if out.join(RECORD).exists() {
        let found = SuiteRecord::read(out)?;
        found.matches(suite, out)?;
        if found.size != size {
            let (is, asked) = (found.size.name(), size.name());
            return Err(Error::input(format!("{}: contains size {is}, not {asked}", out.display())));
        }
    }
    if !options.resume && !options.force {
        for (case, split) in &mine {
            refuse_existing(&out.join(case.split_folder(*split)))?;
        }
    }
    std::fs::create_dir_all(out).map_err(Error::write(out))?;
    let record = serde_json::to_string_pretty(&SuiteRecord::of(suite, size));
    let record = record.map_err(|e| Error::input(e.to_string()))?;
    save_changed(&out.join(RECORD), format!("{record}\n").as_bytes())?;
    let (bar, within) = options.progress.cases(mine.len() as u64);
    let mut made = 0;
    for (case, split) in &mine {
        options.progress.check()?;
        bar.set_message(case.split_folder(*split));
        let dataset = out.join(case.split_folder(*split));
        let above = out.join(case.folder());
        std::fs::create_dir_all(&above).map_err(Error::write(&above))?;
        let scenario = case.scenario(*split).and_then(|spec| resolve(spec, &case.inputs, &options.context));
        made += usize::from(attempt(scenario, &dataset, (options.force, options.resume), &within)?);
        bar.inc(1);
    }
    bar.finish();
    let failed_now =
        mine.iter().filter(|(case, split)| reason(&out.join(case.split_folder(*split))).exists()).count();
    let (cases, done, failed) = collect(suite, size, out)?;
    let (out, shard) = (out.clone(), chosen.shard);
    Ok(Swept { out, shard, cases, done, failed, made, failed_now, seconds: start.elapsed().as_secs_f64() })
}

/// Counts the finished and failed datasets of a size, and writes the table if none is outstanding.
fn collect(suite: &Suite, size: Size, out: &Path) -> Result<(usize, usize, usize)> {
    let all = SuiteSelection::default().of(suite, size)?;
    let unwritable = |e: csv::Error| Error::Write { path: out.join(TABLE), source: std::io::Error::other(e) };
    let mut table = csv::Writer::from_writer(Vec::new());
    let header = ["track", "ladder", "case", "split", "dataset", "seed", "axes"];
    let header: Vec<&str> = header.into_iter().chain(Outcome::COLUMNS).collect();
    table.write_record(&header).map_err(unwritable)?;
    let (mut done, mut failures) = (0, 0);
    for (case, split) in &all {
        let dataset = out.join(case.split_folder(*split));
        let spec = case.scenario(*split)?;
        let axes: Vec<String> = case.axes.iter().map(|a| format!("{}={}", a.label, a.shown)).collect();
        let [track, ladder, name] = [&case.track, &case.ladder, &case.name].map(String::to_owned);
        let mut row = vec![track, ladder, name, split.name().to_owned(), spec.name.clone()];
        row.extend([spec.seed.to_string(), axes.join("; ")]);
        let Some(outcome) = Outcome::of(&dataset, (&spec.name, spec.seed), "suite")? else { continue };
        *(if outcome.is_done() { &mut done } else { &mut failures }) += 1;
        row.extend(outcome.cells());
        table.write_record(&row).map_err(unwritable)?;
    }
    if done + failures == all.len() {
        let bytes = table.into_inner().map_err(|e| unwritable(csv::Error::from(e.into_error())))?;
        save_changed(&out.join(TABLE), &bytes)?;
    }
    Ok((all.len(), done, failures))
}

/// Folder beside a suite's file with a list of hashes for each size.
pub const FROZEN: &str = "frozen";

/// Parts of a dataset whose bytes are frozen. Card and manifest name the version of the program.
const PARTS: [&str; 4] = ["images", "truth", "particles", "calibration"];

/// The hashes of a dataset's parts, by part.
pub type FrozenDataset = BTreeMap<String, String>;

/// The hash of each part of a dataset: the SHA-256 of its lines of `SHA256SUMS`, which for images is `grep
/// '  images/' SHA256SUMS | sha256sum`.
pub fn digests(dataset: &Path) -> Result<FrozenDataset> {
    let sums = read_text(&dataset.join(SHA256SUMS))?;
    let of = |part: &str| {
        let beginning = format!("{part}/");
        let is_of = |line: &&str| line.split_once("  ").is_some_and(|(_, path)| path.starts_with(&beginning));
        let lines: String = sums.lines().filter(is_of).map(|line| format!("{line}\n")).collect();
        (!lines.is_empty()).then(|| (part.to_owned(), Fingerprint::of(lines.as_bytes()).sha256.to_string()))
    };
    Ok(PARTS.iter().filter_map(|part| of(part)).collect())
}

/// The frozen hashes of a suite at one size, by `TRACK/CASE/SPLIT/PART`.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Frozen {
    /// Version of the suite.
    pub version: String,
    /// SHA-256 by part.
    pub hashes: BTreeMap<String, String>,
}

impl Frozen {
    /// Path of the frozen checksums of a suite.
    pub fn path(suite: &Suite, size: Size) -> PathBuf {
        suite.folder.join(FROZEN).join(format!("{}.sha256", size.name()))
    }

    /// Parses a list; `name` is its name in messages. Errors: a line that is neither the version nor a hash
    /// with its part.
    pub fn parse(text: &str, name: &str) -> Result<Self> {
        let mut frozen = Frozen::default();
        for (i, line) in text.lines().enumerate() {
            if let Some(version) = line.strip_prefix("# version ") {
                version.clone_into(&mut frozen.version);
                continue;
            }
            // One line at a time, so that messages state the line of the file.
            let refused =
                || Error::input(format!("{name}:{}: expected a SHA-256, two spaces, a part", i + 1));
            frozen.hashes.extend(storage::checksums::read(line, name).map_err(|_| refused())?);
        }
        Ok(frozen)
    }

    /// The list as text.
    pub fn text(&self) -> String {
        let rows = self.hashes.iter().map(|(part, hash)| format!("{hash}  {part}\n"));
        format!("# version {}\n{}", self.version, rows.collect::<String>())
    }
}

/// Result of [`check_suite`].
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct SuiteCheck {
    /// Size.
    pub size: Size,
    /// The shard that was checked.
    pub shard: Shard,
    /// Number of datasets.
    pub datasets: usize,
    /// Hash of each part, by `TRACK/CASE/SPLIT/PART`.
    #[serde(skip)]
    pub hashes: BTreeMap<String, String>,
    /// Differences from the frozen checksums.
    pub differences: Vec<String>,
    /// Duration, s.
    pub seconds: f64,
}

/// Compares the chosen datasets of a suite with the frozen checksums: either those in `folder`, which are
/// verified file by file, or all of them, generated again. Without checksums (`None`) there are no
/// differences.
pub fn check_suite(
    suite: &Suite,
    size: Size,
    chosen: &SuiteSelection,
    (folder, frozen): (Option<&Path>, Option<&Frozen>),
    (progress, context): (&Progress, &Context),
) -> Result<SuiteCheck> {
    let start = Instant::now();
    let mine = chosen.of(suite, size)?;
    let mut check = SuiteCheck {
        size,
        shard: chosen.shard,
        datasets: mine.len(),
        hashes: BTreeMap::new(),
        differences: Vec::new(),
        seconds: 0.0,
    };
    let mut unread: Vec<String> = Vec::new();
    let (bar, within) = progress.cases(mine.len() as u64);
    for (case, split) in &mine {
        progress.check()?;
        let name = case.split_folder(*split);
        bar.set_message(name.clone());
        let found = match folder {
            Some(folder) => there(&folder.join(&name), context),
            None => again(case, *split, &within, context).map(Ok),
        }?;
        let found = found.unwrap_or_else(|problems| {
            check.differences.extend(problems.iter().map(|problem| format!("{name}/{problem}")));
            unread.push(name.clone());
            FrozenDataset::new()
        });
        let named = found.into_iter().map(|(part, hash)| (format!("{name}/{part}"), hash));
        check.hashes.extend(named);
        bar.inc(1);
    }
    bar.finish();
    if let Some(frozen) = frozen {
        let is_chosen = |part: &&String| {
            mine.iter().any(|(case, split)| {
                part.strip_prefix(&case.split_folder(*split)).is_some_and(|rest| rest.starts_with('/'))
            })
        };
        let is_read = |part: &str| !unread.iter().any(|dataset| same_dataset(dataset, part));
        let mut differences = Vec::new();
        for (part, hash) in &check.hashes {
            match frozen.hashes.get(part) {
                Some(expected) if expected == hash => {}
                Some(_) => differences.push(format!("{part}: differs from the frozen checksum")),
                None => differences.push(format!("{part}: has no frozen checksum")),
            }
        }
        for part in frozen.hashes.keys().filter(|part| chosen.is_all() || is_chosen(part)) {
            if !check.hashes.contains_key(part) && is_read(part) {
                differences.push(format!("{part}: has a frozen checksum but is no longer in the suite"));
            }
        }
        check.differences.extend(differences);
    }
    check.seconds = start.elapsed().as_secs_f64();
    Ok(check)
}

/// Whether two paths `TRACK/CASE/SPLIT/...` belong to the same dataset.
pub fn same_dataset(a: &str, b: &str) -> bool {
    a.split('/').take(3).eq(b.split('/').take(3))
}

/// The hashes of a dataset on disk, or the problems with it.
fn there(dataset: &Path, context: &Context) -> Result<std::result::Result<FrozenDataset, Vec<String>>> {
    if !dataset.join(MANIFEST).is_file() {
        return Ok(Err(vec![format!("{MANIFEST}: missing, so this is not a dataset")]));
    }
    match verify(dataset, false, Progress::default(), context) {
        Ok(_) => digests(dataset).map(Ok),
        Err(Error::Failed(problems)) => Ok(Err(problems)),
        Err(e) => Err(e),
    }
}

/// The hashes of a dataset, generated into a temporary folder.
fn again(case: &SuiteCase, split: Split, progress: &Progress, context: &Context) -> Result<FrozenDataset> {
    let place = TemporaryFolder::new()?;
    let out = place.path().join("dataset");
    let scenario = resolve(case.scenario(split)?, &case.inputs, context)?;
    let progress = progress.clone();
    generate(&scenario, &GenerateOptions { out: out.clone(), force: false, resume: false, progress })?;
    digests(&out)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_frozen_list_is_read_as_it_is_written() {
        let hash = "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad".to_owned();
        let hashes = BTreeMap::from([("D3/a/test/images".to_owned(), hash)]);
        let frozen = Frozen { version: "1.0.0".to_owned(), hashes };
        assert_eq!(Frozen::parse(&frozen.text(), "small.sha256").unwrap(), frozen);
        let wrong = Frozen::parse("# version 1\nxyz\n", "small.sha256").unwrap_err().to_string();
        assert!(wrong.contains("small.sha256:2: expected a SHA-256"), "{wrong}");
    }
}
