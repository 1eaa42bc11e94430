//! `microsig suite`: frozen benchmark suites for comparing trackers.

use std::path::{Path, PathBuf};

use clap::{Args, Subcommand};
use serde_json::json;

use super::Common;
use super::argument::{folder, input};
use super::options::{Drawing, ImageTables, Replace};
use super::output::{progress, report, summarize, warn};
use super::shard::ShardOption;
use arena::release::{Deadline, Publication, ReleaseOptions, release};
use arena::suite::{ScoreOptions, score};
use generator::runner::{
    Frozen, SuiteOptions, SuiteRecord, SuiteSelection, check_suite, generate_suite, same_dataset,
};
use scenario::{Size, Split};
use scoring::ranking::{ScoreDef, ranks_fields};
use storage::InputFile;
use storage::error::{Error, Result};
use storage::save_bytes;

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
    /// Make a challenge of each case: public packages, and withheld truth of test splits drawn with secret
    /// keys
    Release(Release),
}

/// The datasets to work on.
#[derive(Debug, Args)]
struct Selection {
    /// Only this track
    #[arg(long, value_name = "NAME")]
    track: Option<String>,
    /// Only this case
    #[arg(long, value_name = "NAME")]
    case: Option<String>,
    /// Only train, val or test
    #[arg(long, value_name = "SPLIT")]
    split: Option<String>,
    #[command(flatten)]
    shard: ShardOption,
}

impl Selection {
    fn read(&self, common: &Common) -> Result<SuiteSelection> {
        Ok(SuiteSelection {
            track: self.track.clone(),
            case: self.case.clone(),
            split: self.split.as_deref().map(Split::parse).transpose()?,
            shard: self.shard.read(common)?,
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
    /// The generated suite
    datasets: PathBuf,
    /// The results: RESULTS/TRACKER/TRACK/CASE/results.csv
    #[arg(long, value_name = "RESULTS")]
    results: PathBuf,
    /// Output folder of the scores
    #[arg(long, short, value_name = "OUT", value_parser = folder())]
    out: PathBuf,
    /// Only this track
    #[arg(long, value_name = "NAME")]
    track: Option<String>,
    /// Only this case
    #[arg(long, value_name = "NAME")]
    case: Option<String>,
    /// Also write a site of the leaderboard with rules and reports, to be copied to any server or opened from
    /// disk
    #[arg(long, value_name = "DIR", value_parser = folder())]
    site: Option<PathBuf>,
    #[command(flatten)]
    drawing: Drawing,
    #[command(flatten)]
    replace: Replace,
}

#[derive(Debug, Args)]
struct Release {
    /// The suite
    #[arg(value_parser = input())]
    suite: InputFile,
    /// The generated suite; its train splits become those of the challenges
    datasets: PathBuf,
    /// Output folder of the releases: OUT/TRACK/CASE
    #[arg(long, short, value_name = "OUT", value_parser = folder())]
    out: PathBuf,
    /// Only this track
    #[arg(long, value_name = "NAME")]
    track: Option<String>,
    /// Only this case
    #[arg(long, value_name = "NAME")]
    case: Option<String>,
    /// Author to cite, as `Family, Given` or the name of a group; may be repeated
    #[arg(long, value_name = "NAME")]
    creator: Vec<String>,
    /// Last day for submissions, such as 2027-03-01: until it has ended everywhere on Earth
    #[arg(long, value_name = "DATE")]
    deadline: Option<Deadline>,
    /// Continue an interrupted run; finished challenges keep their secret keys
    #[arg(long)]
    resume: bool,
    /// With --force: replace challenges and draw new secret keys, which invalidates everything published of
    /// them
    #[arg(long)]
    new_keys: bool,
    /// Also write a bundle for the Codabench platform for each case
    #[arg(long)]
    codabench: bool,
    /// Python wheel of microsig for the scoring programs of the bundles
    #[arg(long, value_name = "FILE", requires = "codabench")]
    wheel: Option<PathBuf>,
    #[command(flatten)]
    replace: Replace,
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

    /// See `Verb::keeps_tables`.
    pub(super) fn keeps_tables(&self) -> bool {
        let tables = match &self.action {
            Action::Generate(action) => &action.tables,
            Action::Check(action) => &action.tables,
            Action::Release(action) => &action.tables,
            Action::List(_) | Action::Score(_) => return false,
        };
        tables.are_kept()
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
                    "case": case.name, "ladder": case.ladder, "dataset": case.dataset(), "axes": case.axes, "dims": case.dims,
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
        let selection = SuiteSelection {
            track: self.track.clone(),
            case: self.case.clone(),
            ..SuiteSelection::default()
        };
        let options = ScoreOptions {
            results: self.results.clone(),
            out: self.out.clone(),
            site: self.site.clone(),
            force: self.replace.force,
            selection,
            seed: self.drawing.seed,
        };
        let scores = score(&suite, &self.datasets, &options)?;
        warn(&scores.warning, common);
        summarize(&scores.text(), &scores, common)
    }
}

impl Release {
    fn run(&self, common: &Common) -> Result<()> {
        let suite = scenario::Suite::open(&self.suite)?;
        let record = SuiteRecord::read(&self.datasets)?;
        record.matches(&suite, &self.datasets)?;
        let chosen = SuiteSelection {
            track: self.track.clone(),
            case: self.case.clone(),
            split: Some(Split::Train),
            ..SuiteSelection::default()
        };
        let (mut released, mut made) = (Vec::new(), 0);
        for (case, split) in chosen.of(&suite, record.size)? {
            let out = self.out.join(case.folder());
            let above = out.parent().unwrap_or(&self.out);
            std::fs::create_dir_all(above).map_err(Error::write(above))?;
            let [_, val, test] = case.counts;
            let about = Publication {
                title: Some(format!("{}: {} {}", suite.spec.title, case.track, case.name)),
                creators: self.creator.clone(),
                version: Some(suite.spec.version.clone()),
            };
            let options = ReleaseOptions {
                out,
                force: self.replace.force,
                resume: self.resume,
                new_keys: self.new_keys,
                val: Some(val),
                test: Some(test),
                test_set: Vec::new(),
                exact_times: false,
                fields: ranks_fields(&case.rank_by),
                codabench: self.codabench,
                wheel: self.wheel.clone(),
                deadline: self.deadline,
                about,
                progress: progress(common),
                context: common.context.clone(),
            };
            let one = release(&self.datasets.join(case.split_folder(split)), &options)?;
            let Some(one) = one else {
                released.push(json!({ "out": options.out, "made": false }));
                continue;
            };
            let warnings: Vec<String> =
                one.warnings.iter().map(|warning| format!("{}: {warning}", case.folder())).collect();
            warn(&warnings, common);
            made += 1;
            released.push(serde_json::to_value(one).map_err(|e| Error::input(e.to_string()))?);
        }
        let text = format!(
            "{} challenges of suite {} {}, {made} made now, in {}; publish TRACK/CASE/public, keep TRACK/CASE/withheld private",
            released.len(),
            suite.spec.name,
            suite.spec.version,
            self.out.display()
        );
        summarize(&text, &released, common)
    }
}
