//! `suite release`: a challenge of each case, and one folder for any static server.
//!
//! ```text
//! OUT/suite.json               suite, deadline, and the hash of the images of each test split
//! OUT/TRACK/CASE/              the challenge of a case: public, withheld
//! OUT/public/                  to be published unchanged
//!   index.html  suite.json  SHA256SUMS
//!   example.zip                a submission without rows, with the hashes of all images
//!   kit.zip                    examples/kit: short programs that read images, write and pack results
//!   TRACK/CASE/                the files of each challenge
//! ```

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use include_dir::{Dir, include_dir};
use maud::{Markup, html};
use serde_json::json;

use super::site::{link, ranks, track_rules};
use super::{PAGE, RESULT};
use crate::package::Package;
use crate::release::existing::{self, remove_if_there};
use crate::release::submission::{SUBMISSION, results_header, template};
use crate::release::{
    ChallengeOptions, ReleaseOptions, Released, check_deadline, release as release_dataset,
};
use crate::report::document;
use generator::runner::{RECORD, SuiteRecord, SuiteSelection, check_rules};
use scenario::{Split, Suite, SuiteCase, TrackSpec};
use scoring::ranking::ranks_fields;
use storage::checksums::{self, Fingerprint, SHA256SUMS, images_digest};
use storage::dataset::manifest::ScoringRules;
use storage::error::{Error, Result};
use storage::{OutputFolder, TemporaryFolder, input, save_changed};

/// The folder `examples/kit`, found by `build.rs`.
static KIT: Dir<'static> = include_dir!("$MICROSIG_KIT");

/// Folder to be published.
const PUBLIC: &str = "public";
/// Folder of the results of baselines, `METHOD/TRACK/CASE/results.csv`.
pub const BASELINES: &str = "baselines";
/// Folder of the leaderboard beside the page.
const BOARD: &str = "board";

#[derive(Debug, Clone)]
pub struct SuiteReleaseOptions {
    pub out: PathBuf,
    pub selection: SuiteSelection,
    /// Address or URL to which teams send their archives, for the page.
    pub submit_to: Option<String>,
    /// Options of each challenge.
    pub challenge: ChallengeOptions,
}

/// Makes a challenge of each chosen case, and the folder to be published. Returns the cases, each with its challenge if it
/// was made now.
/// Errors: as for [`crate::release::release`]; datasets with other rules than the suite's; a release of another suite,
/// version, size or deadline.
pub fn release(
    suite: &Suite,
    datasets: &Path,
    options: &SuiteReleaseOptions,
) -> Result<Vec<(SuiteCase, Option<Released>)>> {
    let generated = SuiteRecord::read(datasets)?;
    generated.matches(suite, datasets)?;
    let mut record = SuiteRecord::of(suite, generated.size);
    record.deadline = options.challenge.deadline.map(|day| day.to_string());
    let path = options.out.join(RECORD);
    if path.exists() {
        let found = SuiteRecord::read(&options.out)?;
        if found.edition() != record.edition() || found.deadline != record.deadline {
            let day = |record: &SuiteRecord| record.deadline.clone().unwrap_or_else(|| "none".to_owned());
            let of = |record: &SuiteRecord| format!("{}, deadline {}", record.edition(), day(record));
            let what = format!("contains {}, expected {}", of(&found), of(&record));
            return Err(Error::input(format!("{}: {what}", path.display())));
        }
        record = found;
    }
    let chosen = SuiteSelection { split: Some(Split::Train), ..options.selection.clone() };
    let chosen: Vec<SuiteCase> =
        chosen.of(suite, generated.size)?.into_iter().map(|(case, _)| case).collect();
    for case in &chosen {
        check_rules(case, &datasets.join(case.split_folder(Split::Train)), true)?;
    }
    std::fs::create_dir_all(&options.out).map_err(Error::write(&options.out))?;
    save_changed(&path, &bytes(&record)?)?;
    if options.challenge.force && options.challenge.new_keys {
        // Before the first is replaced, so that a run that continues replaces all. The page comes back last.
        check_deadline(options.challenge.deadline)?;
        chosen.iter().try_for_each(|case| existing::replace(&options.out.join(case.folder())))?;
        remove_if_there(&options.out.join(PUBLIC).join(PAGE))?;
    }
    let mut released = Vec::new();
    for case in chosen {
        if !existing::is_made(&options.out.join(case.folder())) {
            forget_baselines(&options.out, &case)?;
        }
        let one = release_dataset(
            &datasets.join(case.split_folder(Split::Train)),
            &case_options(suite, &case, options)?,
        )?;
        let sums = options.out.join(case.folder()).join("withheld/test").join(SHA256SUMS);
        record.images_sha256.insert(case.folder(), images_digest(&input::read_text(&sums)?));
        save_changed(&path, &bytes(&record)?)?;
        released.push((case, one));
    }
    publish(suite, &record, options)?;
    Ok(released)
}

/// Removes the results of baselines for images that are to be replaced.
fn forget_baselines(out: &Path, case: &SuiteCase) -> Result<()> {
    let Ok(methods) = std::fs::read_dir(out.join(BASELINES)) else { return Ok(()) };
    methods.flatten().try_for_each(|method| remove_if_there(&method.path().join(case.folder()).join(RESULT)))
}

fn case_options(suite: &Suite, case: &SuiteCase, options: &SuiteReleaseOptions) -> Result<ReleaseOptions> {
    let out = options.out.join(case.folder());
    let above = out.parent().unwrap_or(&options.out);
    std::fs::create_dir_all(above).map_err(Error::write(above))?;
    let [_, val, test] = case.counts;
    Ok(ReleaseOptions {
        out,
        challenge: options.challenge.clone(),
        val: Some(val),
        test: Some(test),
        test_set: Vec::new(),
        exact_times: false,
        fields: false,
        rules: ScoringRules::default(),
        title: Some(format!("{}: {} {}", suite.spec.title, case.track, case.name)),
        version: suite.spec.version.clone(),
    })
}

fn bytes(record: &SuiteRecord) -> Result<Vec<u8>> {
    let text = serde_json::to_string_pretty(record).map_err(|e| Error::input(e.to_string()))?;
    Ok(format!("{text}\n").into_bytes())
}

/// `submission.json` of a suite with the hashes of all images, to be filled in.
pub fn suite_template(record: &SuiteRecord) -> String {
    template(Some(&record.edition()), &json!(record.images_sha256))
}

/// A case of a release with the files of its challenge.
struct Packages {
    case: SuiteCase,
    /// Sizes and hashes by file name.
    files: BTreeMap<String, Fingerprint>,
}

/// Writes the folder to be published; a leaderboard in it is kept. The page comes last.
fn publish(suite: &Suite, record: &SuiteRecord, options: &SuiteReleaseOptions) -> Result<()> {
    let out = &options.out;
    let public = out.join(PUBLIC);
    std::fs::create_dir_all(&public).map_err(Error::write(&public))?;
    let folder = OutputFolder::existing(&public);
    let mut own = Package::default();
    own.write(RECORD, bytes(record)?);
    let (mut cases, mut example) = (Vec::new(), Package::default());
    example.write(SUBMISSION, suite_template(record));
    for case in suite.cases(record.size)? {
        if !record.images_sha256.contains_key(&case.folder()) {
            continue;
        }
        let header = results_header(ranks_fields(&case.rules.rank_by));
        example.write(&format!("{}/{RESULT}", case.folder()), header);
        let from = out.join(case.folder()).join(PUBLIC);
        let mut package = Package::default();
        package.copy_folder(&from, |path| !path.starts_with('.'))?;
        let to = folder.subfolder(&case.folder())?;
        for file in package.paths() {
            // Placed again: a challenge may have been replaced.
            remove_if_there(&to.join(&file))?;
            to.place(&file, &from.join(&file), true)?;
        }
        let files = package.fingerprints()?;
        cases.push(Packages { case, files });
    }
    own.write("example.zip", example.zipped("example.zip")?);
    let mut kit = Package::default();
    add(&mut kit, &KIT);
    own.write("kit.zip", kit.zipped("kit.zip")?);
    let mut sums = own.fingerprints()?;
    for Packages { case, files } in &cases {
        sums.extend(files.iter().map(|(file, of)| (format!("{}/{file}", case.folder()), *of)));
        // Once more for those who download archives into one folder; their names are unique.
        let archives = files.iter().filter(|(file, _)| file.ends_with(".zip"));
        sums.extend(archives.map(|(file, of)| (file.clone(), *of)));
    }
    own.write(SHA256SUMS, checksums::write(&sums));
    own.unpack(&folder)?;
    folder.save_bytes(PAGE, page(suite, record, &cases, options))
}

/// Adds the files of an embedded folder.
fn add(package: &mut Package, folder: &Dir<'_>) {
    for file in folder.files() {
        package.write(&format!("kit/{}", file.path().display()), file.contents());
    }
    folder.dirs().for_each(|inner| add(package, inner));
}

/// `index.html`.
fn page(suite: &Suite, record: &SuiteRecord, cases: &[Packages], options: &SuiteReleaseOptions) -> String {
    let title = if suite.spec.title.is_empty() { &suite.spec.name } else { &suite.spec.title };
    let entered = |track: &&TrackSpec| cases.iter().any(|of| of.case.track == track.name);
    let body = html! {
        h1 { (title) }
        p.soft { (record.edition()) }
        @if !suite.spec.description.is_empty() { p { (suite.spec.description) } }
        p { "Images of tracer particles for comparing methods of PIV and particle tracking. Train and val come with their truth. The truth of test is \
            published after the deadline; until then, " code { "commitment.sha256" } " of each case proves that it is not changed." }
        @if !options.challenge.creators.is_empty() { p { "Organized by " (options.challenge.creators.join("; ")) "." } }
        @if let Some(day) = &record.deadline { p { b { "Deadline: " (day) } ", " (crate::release::UNTIL) "." } }
        p { a href=(format!("{BOARD}/{PAGE}")) { "Leaderboard" } ", with the scores of baselines; it exists as soon as the organizers have scored them." }
        h2 { "Data" }
        p { "The table has the number of image pairs, frames or bursts of each split, and the size of its archive. Check downloaded files with " code { "sha256sum -c --ignore-missing SHA256SUMS" } " (" a href=(SHA256SUMS) { "SHA256SUMS" } "), with the archives in one folder or in the folders of the server. A copy of everything: "
            code { "wget --recursive --no-parent --no-host-directories ADDRESS" } "." }
        div.scroll { table.board {
            tr { th { "track" } th { "case" } th { "train" } th { "val" } th { "test" } th { "about" } }
            @for of in cases { (row(of)) }
        } }
        h2 { "Taking part" }
        ol {
            li { "Download " a href=(RECORD) { (RECORD) } ", " a href=(SHA256SUMS) { (SHA256SUMS) } " and the archives into a folder, check them, and unpack them there. Each has a README.md that states axes, units and files." }
            li { "Choose parameters on train and val. Run your method on the images of each test split, and write " code { "RESULTS/TRACK/CASE/results.csv" } ". Cases may be left out: they count as behind all others." }
            li { "Copy " code { "submission.json" } " from " a href=("example.zip") { "example.zip" } " to " code { "RESULTS" } " and fill it in. A submission of another suite, version or size is refused." }
            li { "Check and pack it with " a href=("kit.zip") { "kit.zip" } ", which also has programs to start from: in Python " code { "python kit/python/pack.py FOLDER RESULTS team.zip" }
                ", in Octave and MATLAB " code { "pack_results('FOLDER', 'RESULTS', 'team.zip')" } ". "
                code { "python -m microsig check FOLDER team.zip" } " checks it as the organizers do (" code { "pip install microsig" } ")." }
            li { "Send " code { "team.zip" } " to " @match options.submit_to.as_deref() {
                Some(to) if to.contains("://") => { a href=(to) { (to) } },
                to => { (to.unwrap_or("the organizers")) },
            } ". The leaderboard shows the scores, rounded." }
        }
        h2 { "Rules" }
        @for track in suite.spec.tracks.iter().filter(entered) {
            @let orders: Vec<&[scenario::Metric]> = cases.iter().filter(|of| of.case.track == track.name).map(|of| of.case.rules.rank_by.as_slice()).collect();
            (track_rules(track, orders))
        }
        h2 { "Ranks" }
        (ranks())
    };
    document(title, &body)
}

/// A row of the table of cases.
fn row(Packages { case, files }: &Packages) -> Markup {
    let folder = case.folder();
    let megabytes = |bytes: u64| format!("{:.2} MB", bytes as f64 / 1e6);
    let axes: Vec<String> = case.axes.iter().map(|axis| format!("{} {}", axis.label, axis.shown)).collect();
    html! { tr {
        td { (case.track) }
        td { (case.name) @if !axes.is_empty() { ": " (axes.join(", ")) } }
        @for (split, n) in Split::ALL.iter().zip(case.counts) {
            @let file = format!("{}-{}.zip", case.dataset(), split.name());
            td { a href=(link(&format!("{folder}/{file}"))) { (n) } ", " (files.get(&file).map_or_else(String::new, |of| megabytes(of.bytes))) }
        }
        td { a href=(link(&format!("{folder}/README.md"))) { "README" } }
    } }
}

/// The published test split of a released case, unpacked into a temporary folder: what participants have.
pub fn published_test(out: &Path, case: &SuiteCase) -> Result<(TemporaryFolder, PathBuf)> {
    let name = format!("{}-test", case.dataset());
    let archive = out.join(case.folder()).join(PUBLIC).join(format!("{name}.zip"));
    let place = TemporaryFolder::new()?;
    let unreadable = |e: zip::result::ZipError| Error::input(format!("{}: {e}", archive.display()));
    zip::ZipArchive::new(input::open(&archive)?)
        .and_then(|mut zip| zip.extract(place.path()))
        .map_err(unreadable)?;
    let folder = place.path().join(name);
    Ok((place, folder))
}
