//! `microsig suite`: frozen benchmark suites for comparing trackers.

use std::path::{Path, PathBuf};

use clap::{Args, Subcommand};
use serde_json::json;

use super::Common;
use super::options::{ImageTables, Replace, ShardOption};
use super::output::{progress, report, summarize, warn};
use super::track::methods;
use arena::release::{ChallengeOptions, Released};
use arena::suite::{
    BASELINES, RESULT, ScoreOptions, SuiteReleaseOptions, published_test, release, score, suite_template,
};
use generator::runner::{
    Frozen, SuiteOptions, SuiteRecord, SuiteSelection, check_suite, generate_suite, same_dataset,
};
use scenario::{Size, Split, SuiteCase};
use scoring::ranking::{ScoreDef, ranks_fields};
use storage::InputFile;
use storage::argument::{folder, input};
use storage::error::{Error, Result};
use storage::save_bytes;
use tracking::{TrackOptions, track};

/// Work with frozen suites of datasets, for comparing trackers
#[derive(Debug, Args)]
#[command(
    after_help = "SUITE is the file or folder of a suite, or the name of a shipped one, such as odpc1.\n\
Example: microsig suite generate odpc1 --size smoke --out suites/smoke"
)]
pub(super) struct Suite {
    #[command(subcommand)]
    action: Action,
}

#[derive(Debug, Subcommand)]
enum Action {
    /// List tracks and cases
    List(List),
    /// Generate the datasets: DIR/TRACK/CASE/{train,val,test}
    Generate(Generate),
    /// Check the datasets against the frozen checksums; exit code 1 if one differs
    Check(Check),
    /// Score all results in one table, ranked case by case
    Score(Score),
    /// Make a challenge of each case, with test splits drawn with secret keys, and one folder to be published
    Release(Release),
}

/// The cases to work on.
#[derive(Debug, Args)]
struct Cases {
    /// Only this track
    #[arg(long, value_name = "NAME")]
    track: Option<String>,
    /// Only this case
    #[arg(long, value_name = "NAME")]
    case: Option<String>,
}

impl Cases {
    fn selection(&self) -> SuiteSelection {
        SuiteSelection { track: self.track.clone(), case: self.case.clone(), ..SuiteSelection::default() }
    }
}

/// The datasets to work on.
#[derive(Debug, Args)]
struct Selection {
    #[command(flatten)]
    cases: Cases,
    /// Only train, val or test
    #[arg(long, value_name = "SPLIT")]
    split: Option<String>,
    #[command(flatten)]
    shard: ShardOption,
}

impl Selection {
    fn read(&self, common: &Common) -> Result<SuiteSelection> {
        Ok(SuiteSelection {
            split: self.split.as_deref().map(Split::parse).transpose()?,
            shard: self.shard.read(common)?,
            ..self.cases.selection()
        })
    }
}

#[derive(Debug, Args)]
struct List {
    /// The suite
    #[arg(value_parser = input())]
    suite: InputFile,
    /// smoke, small or full
    #[arg(long, default_value = "full")]
    size: String,
}

#[derive(Debug, Args)]
struct Generate {
    /// The suite
    #[arg(value_parser = input())]
    suite: InputFile,
    /// smoke, small or full
    #[arg(long)]
    size: String,
    /// Output folder [default: suites/NAME-SIZE]
    #[arg(long, short, value_name = "DIR", value_parser = folder())]
    out: Option<PathBuf>,
    #[command(flatten)]
    selection: Selection,
    /// Continue an interrupted run; failed datasets are tried again
    #[arg(long)]
    resume: bool,
    #[command(flatten)]
    replace: Replace,
    #[command(flatten)]
    tables: ImageTables,
}

#[derive(Debug, Args)]
struct Check {
    /// The suite
    #[arg(value_parser = input())]
    suite: InputFile,
    /// smoke, small or full
    #[arg(long)]
    size: String,
    /// A generated suite to verify file by file [default: generate every dataset again]
    #[arg(long, value_name = "DIR")]
    datasets: Option<PathBuf>,
    #[command(flatten)]
    selection: Selection,
    /// Write the frozen checksums of a new version instead; datasets that are not selected keep their lines
    #[arg(long)]
    freeze: bool,
    #[command(flatten)]
    tables: ImageTables,
}

#[derive(Debug, Args)]
struct Score {
    /// The suite
    #[arg(value_parser = input())]
    suite: InputFile,
    /// The generated or released suite
    datasets: PathBuf,
    #[command(flatten)]
    cases: Cases,
    #[command(flatten)]
    options: ScoreOptions,
}

#[derive(Debug, Args)]
struct Release {
    /// The suite
    #[arg(value_parser = input())]
    suite: InputFile,
    /// The generated suite; its train splits become the challenges'
    datasets: PathBuf,
    /// Output folder of the releases: OUT/TRACK/CASE
    #[arg(long, short, value_name = "OUT", value_parser = folder())]
    out: PathBuf,
    #[command(flatten)]
    cases: Cases,
    /// Address or URL to which teams send their results, shown on the page
    #[arg(long, value_name = "TEXT")]
    submit_to: Option<String>,
    /// Run these trackers on the published test splits, into OUT/baselines for `suite score --results`
    #[arg(long, value_name = "METHOD", value_delimiter = ',', value_parser = methods())]
    baselines: Vec<String>,
    #[command(flatten)]
    challenge: ChallengeOptions,
    #[command(flatten)]
    tables: ImageTables,
}

impl Suite {
    pub(super) fn run(&self, common: &Common) -> Result<()> {
        match &self.action {
            Action::List(action) => action.run(common),
            Action::Generate(action) => action.run(common),
            Action::Check(action) => action.run(common),
            Action::Score(action) => action.run(common),
            Action::Release(action) => action.run(common),
        }
    }
}

impl List {
    fn run(&self, common: &Common) -> Result<()> {
        let suite = scenario::Suite::open(&self.suite)?;
        let size = Size::parse(&self.size)?;
        let cases = suite.cases(size)?;
        let (name, version) = (&suite.spec.name, &suite.spec.version);
        let mut lines = vec![format!("{name} {version}, size {}: {}", size.name(), suite.spec.title)];
        let mut tracks = Vec::new();
        for track in &suite.spec.tracks {
            let ranked: Vec<&str> = track.rank_by.iter().map(|metric| ScoreDef::of(*metric).name).collect();
            lines.push(format!("{}  {}; ranked by {}", track.name, track.title, ranked.join(", ")));
            let mut listed = Vec::new();
            for case in cases.iter().filter(|case| case.track == track.name) {
                let [train, val, test] = case.counts;
                lines.push(format!("    {:<28} {train} + {val} + {test}", case.name));
                listed.push(json!({
                    "case": case.name, "ladder": case.ladder, "dataset": case.dataset(), "axes": case.axes, "dims": case.rules.dims,
                    "train": train, "val": val, "test": test,
                }));
            }
            tracks.push(json!({
                "track": track.name, "title": track.title, "rank_by": track.rank_by,
                "gate_xy_px": track.gate_xy_px, "gate_z_um": track.gate_z_um, "cases": listed,
            }));
        }
        lines.push("(number of image pairs, frames or bursts in train + val + test)".to_owned());
        let whole = json!({ "suite": name, "version": version, "size": size, "tracks": tracks });
        report(&lines.join("\n"), &whole, common)
    }
}

impl Generate {
    fn run(&self, common: &Common) -> Result<()> {
        let suite = scenario::Suite::open(&self.suite)?;
        let size = Size::parse(&self.size)?;
        let default = || Path::new("suites").join(format!("{}-{}", suite.spec.name, size.name()));
        let out = self.out.clone().unwrap_or_else(default);
        let (force, resume, progress) = (self.replace.force, self.resume, progress(common));
        let context = common.context.clone();
        let options = SuiteOptions { out, force, resume, progress, context };
        let selection = self.selection.read(common)?;
        let made = generate_suite(&suite, size, &selection, &options)?;
        let text = format!(
            "suite {} {}, size {}{}: {} of {} datasets done, {} failed, {} generated now in {:.2} s, in {}",
            suite.spec.name,
            suite.spec.version,
            size.name(),
            made.shard.in_title(),
            made.done,
            made.cases,
            made.failed,
            made.made,
            made.seconds,
            made.out.display()
        );
        summarize(&text, &made, common)?;
        if made.failed > 0 {
            return Err(Error::Failed(vec![format!("{} datasets failed; see *.failed", made.failed)]));
        }
        Ok(())
    }
}

impl Check {
    fn run(&self, common: &Common) -> Result<()> {
        let suite = scenario::Suite::open(&self.suite)?;
        let size = Size::parse(&self.size)?;
        let selection = self.selection.read(common)?;
        if let Some(folder) = &self.datasets {
            let found = SuiteRecord::read(folder)?;
            found.matches(&suite, folder)?;
            if found.size != size {
                let (is, asked) = (found.size.name(), size.name());
                return Err(Error::input(format!("{}: contains size {is}, not {asked}", folder.display())));
            }
        }
        let frozen = frozen(&suite, size)?;
        if self.freeze {
            return self.freeze(&suite, size, &selection, frozen.as_ref(), common);
        }
        let Some(frozen) = frozen else {
            let path = shown(&suite, size);
            return Err(Error::input(format!("{path}: no frozen checksums; --freeze writes them")));
        };
        if frozen.version != suite.spec.version {
            let (path, version) = (shown(&suite, size), &suite.spec.version);
            let hint = "a new version of a suite needs new frozen checksums, which --freeze writes";
            let of = &frozen.version;
            return Err(Error::Failed(vec![format!(
                "{path}: belongs to version {of}, not {version}; {hint}"
            )]));
        }
        let folder = self.datasets.as_deref();
        let checked = check_suite(
            &suite,
            size,
            &selection,
            (folder, Some(&frozen)),
            (&progress(common), &common.context),
        )?;
        let text = format!(
            "suite {} {}, size {}{}: {} datasets checked in {:.2} s, {} differences",
            suite.spec.name,
            suite.spec.version,
            size.name(),
            checked.shard.in_title(),
            checked.datasets,
            checked.seconds,
            checked.differences.len()
        );
        summarize(&text, &checked, common)?;
        if checked.differences.is_empty() { Ok(()) } else { Err(Error::Failed(checked.differences)) }
    }

    /// Writes the frozen checksums. Those of a released version may not change.
    fn freeze(
        &self,
        suite: &scenario::Suite,
        size: Size,
        selection: &SuiteSelection,
        before: Option<&Frozen>,
        common: &Common,
    ) -> Result<()> {
        let path = Frozen::path(suite, size);
        if suite.is_shipped {
            return Err(Error::input("--freeze: expected the file of a suite, not a shipped suite"));
        }
        let part_of = before.filter(|before| before.version == suite.spec.version);
        if !selection.is_all() && part_of.is_none() {
            return Err(Error::input(
                "--freeze: expected all datasets, without --track, --case, --split, --shard, because this version has no frozen checksums yet",
            ));
        }
        let checked = check_suite(
            suite,
            size,
            selection,
            (self.datasets.as_deref(), None),
            (&progress(common), &common.context),
        )?;
        if !checked.differences.is_empty() {
            return Err(Error::Failed(checked.differences));
        }
        let mut hashes = checked.hashes;
        if let Some(before) = part_of.filter(|_| !selection.is_all()) {
            let others =
                before.hashes.iter().filter(|(part, _)| !hashes.keys().any(|new| same_dataset(new, part)));
            let others: Vec<_> = others.map(|(part, hash)| (part.clone(), hash.clone())).collect();
            hashes.extend(others);
        }
        let now = Frozen { version: suite.spec.version.clone(), hashes };
        let is_released = |version: &str| !version.contains('-');
        if let Some(before) =
            before.filter(|b| b.version == now.version && is_released(&b.version) && **b != now)
        {
            let what = format!("version {} already has different frozen checksums", before.version);
            let hint = "raise `version` of the suite (X.Y.Z-dev until it is released)";
            return Err(Error::Failed(vec![format!("{}: {what}; {hint}", path.display())]));
        }
        let folder = path.parent().unwrap_or(Path::new("."));
        std::fs::create_dir_all(folder).map_err(Error::write(folder))?;
        save_bytes(&path, now.text().as_bytes())?;
        let text = format!("{}: {} datasets, {} hashes", path.display(), checked.datasets, now.hashes.len());
        summarize(&text, &json!({ "file": path, "datasets": checked.datasets }), common)
    }
}

/// Path of the frozen checksums, for messages.
fn shown(suite: &scenario::Suite, size: Size) -> String {
    Frozen::path(suite, size).display().to_string()
}

/// The frozen checksums, if there are any.
fn frozen(suite: &scenario::Suite, size: Size) -> Result<Option<Frozen>> {
    let path = Frozen::path(suite, size);
    if !path.exists() {
        return Ok(None);
    }
    Frozen::parse(&storage::read_text(&path)?, &path.display().to_string()).map(Some)
}

impl Score {
    fn run(&self, common: &Common) -> Result<()> {
        let suite = scenario::Suite::open(&self.suite)?;
        let options = ScoreOptions { selection: self.cases.selection(), ..self.options.clone() };
        let scores = score(&suite, &self.datasets, &options)?;
        warn(&scores.warnings, common);
        summarize(&scores.text(), &scores, common)
    }
}

impl Release {
    fn run(&self, common: &Common) -> Result<()> {
        let suite = scenario::Suite::open(&self.suite)?;
        let options = SuiteReleaseOptions {
            out: self.out.clone(),
            selection: self.cases.selection(),
            submit_to: self.submit_to.clone(),
            challenge: ChallengeOptions {
                progress: progress(common),
                context: common.context.clone(),
                ..self.challenge.clone()
            },
        };
        let released = release(&suite, &self.datasets, &options)?;
        let mut listed = Vec::new();
        for (case, one) in &released {
            let warnings = one.iter().flat_map(|one| &one.warnings);
            let warnings: Vec<String> =
                warnings.map(|warning| format!("{}: {warning}", case.folder())).collect();
            warn(&warnings, common);
            let kept = json!({ "out": self.out.join(case.folder()), "made": false });
            listed.push(
                one.as_ref()
                    .map_or(Ok(kept), serde_json::to_value)
                    .map_err(|e| Error::input(e.to_string()))?,
            );
        }
        let made = released.iter().filter(|(_, one)| one.is_some()).count();
        for method in &self.baselines {
            self.baseline(method, &released, common)?;
        }
        let text = format!(
            "{} challenges of suite {} {}, {made} made now; publish {}, keep the rest of {} private",
            released.len(),
            suite.spec.name,
            suite.spec.version,
            self.out.join("public").display(),
            self.out.display()
        );
        summarize(&text, &listed, common)
    }

    /// Runs a tracker on the published test splits: `OUT/baselines/METHOD/TRACK/CASE/results.csv`. Results that exist are kept,
    /// unless their challenge has been made now.
    fn baseline(
        &self,
        method: &str,
        released: &[(SuiteCase, Option<Released>)],
        common: &Common,
    ) -> Result<()> {
        let folder = self.out.join(BASELINES).join(method);
        let mut ran = false;
        for (case, one) in released {
            let out = folder.join(case.folder()).join(RESULT);
            let is_of_fields = ranks_fields(&case.rules.rank_by);
            if is_of_fields != (method == "piv") || (out.exists() && one.is_none()) {
                continue;
            }
            let (_unpacked, test) = published_test(&self.out, case)?;
            let above = out.parent().unwrap_or(&folder);
            std::fs::create_dir_all(above).map_err(Error::write(above))?;
            let options = TrackOptions {
                force: true,
                context: common.context.clone(),
                ..TrackOptions::of(method, progress(common))
            };
            match track(&test, &out, &options) {
                Ok(tracked) => warn(&tracked.warnings, common),
                // For example without a calibration stack.
                Err(e @ Error::Input(_)) => warn([format!("{method} on {}: {e}", case.folder())], common),
                Err(e) => return Err(e),
            }
            ran = true;
        }
        if !ran {
            return Ok(());
        }
        let record = SuiteRecord::read(&self.out)?;
        let mut about: serde_json::Value = serde_json::from_str(&suite_template(&record)).unwrap_or_default();
        for (key, text) in [
            ("team", "microsig"),
            ("method", method),
            ("version", VERSION),
            ("hardware", "of the organizers"),
        ] {
            about[key] = text.into();
        }
        save_bytes(&folder.join("submission.json"), format!("{about:#}\n").as_bytes())
    }
}

const VERSION: &str = env!("CARGO_PKG_VERSION");
