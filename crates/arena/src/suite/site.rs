//! The site of a leaderboard (`suite score --site`): a folder that can be copied to any server, or opened from
//! disk.
//!
//! ```text
//! index.html  rules.html                       standings, curves and cases; tracks and how they are ranked
//! suite_scores.csv  suite_scores.json          all scores
//! scores/TRACKER/TRACK/CASE/report.html score.json
//! ```
//!
//! All links are relative, and nothing is fetched from elsewhere. Files of single results pass through
//! [`report::published`], so a withheld truth stays withheld.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use maud::{Markup, html};
use percent_encoding::{AsciiSet, NON_ALPHANUMERIC, utf8_percent_encode};

use super::{CaseScores, PAGE, SCORES, SUITE_SCORES, SUITE_SCORES_CSV, SuiteScores};
use crate::report;
use scenario::{Suite, TrackSpec};
use scoring::evaluate::Evaluation;
use scoring::ranking::{Better, ScoreDef, ranks_fields};
use storage::dataset::manifest::ScoringGates;
use storage::error::{Error, Result};
use storage::folder::{Earlier, Partial, check_replaceable};

/// Name of the page with the rules.
pub(super) const RULES: &str = "rules.html";

/// Characters of a path that stay as they are in a link.
const PATH: &AsciiSet = &NON_ALPHANUMERIC.remove(b'-').remove(b'_').remove(b'.').remove(b'~').remove(b'/');

/// File of a site whose scores have not been placed yet: the next run replaces what an interrupted one left.
const UNFINISHED: &str = ".unfinished";

/// A site under construction.
#[derive(Debug)]
pub(super) struct Site {
    folder: PathBuf,
    partial: Partial,
    earlier: Earlier,
    reports: BTreeSet<String>,
}

/// Path of the report of a result.
pub(super) fn report_of(tracker: &str, case: &CaseScores) -> String {
    format!("{SCORES}/{tracker}/{}/{}/{}", case.track, case.case, report::REPORT)
}

/// A relative path as a link.
pub(super) fn link(path: &str) -> String {
    utf8_percent_encode(path, PATH).to_string()
}

impl Site {
    /// Starts a site.
    /// Errors: an existing folder, unless it is a site and `force`.
    pub(super) fn start(folder: &Path, force: bool) -> Result<Self> {
        let earlier = Earlier::new(RULES, force || folder.join(UNFINISHED).is_file());
        check_replaceable(folder, earlier)?;
        let partial = Partial::start(folder)?;
        Ok(Site { folder: folder.to_owned(), partial, earlier, reports: BTreeSet::new() })
    }

    /// Adds the files of a result, `TRACKER/TRACK/CASE`.
    pub(super) fn add(&mut self, result: &str, evaluation: &Evaluation) -> Result<()> {
        let below = format!("{SCORES}/{result}");
        let folder = self.partial.folder().subfolder(&below)?;
        for (name, text) in report::published_files(evaluation)? {
            folder.save_bytes(name, text)?;
            self.reports.extend((name == report::REPORT).then(|| format!("{below}/{name}")));
        }
        Ok(())
    }

    pub(super) fn reports(&self) -> &BTreeSet<String> {
        &self.reports
    }

    /// Adds the pages and tables, gives the folder its name, and then places the scores.
    pub(super) fn finish(
        self,
        rules: &str,
        index: &str,
        tables: [&[u8]; 2],
        place_scores: impl FnOnce() -> Result<()>,
    ) -> Result<()> {
        let folder = self.partial.folder();
        let [csv, json] = tables;
        for (name, bytes) in [
            (PAGE, index.as_bytes()),
            (RULES, rules.as_bytes()),
            (SUITE_SCORES_CSV, csv),
            (SUITE_SCORES, json),
        ] {
            folder.save_bytes(name, bytes)?;
        }
        folder.save_bytes(UNFINISHED, b"")?;
        self.partial.finish(self.earlier)?;
        place_scores()?;
        let mark = self.folder.join(UNFINISHED);
        std::fs::remove_file(&mark).map_err(Error::write(&mark))
    }
}

/// The links of the first page.
pub(super) fn contents() -> Markup {
    html! {
        p { a href=(RULES) { "Rules" } ", all scores as " a href=(SUITE_SCORES_CSV) { "table" } " and "
            a href=(SUITE_SCORES) { "JSON" } ". The name of a tracker in the table of a case leads to the report of its result." }
    }
}

/// `rules.html`. The page of a released suite, one folder above the site, says how to take part.
pub(super) fn rules(suite: &Suite, scores: &SuiteScores, is_released: bool) -> String {
    let (name, version, size) = (&scores.suite, &scores.version, scores.size.name());
    let title = format!("Rules of {name} {version}, size {size}");
    let scored = |track: &&TrackSpec| scores.cases.iter().any(|case| case.track == track.name);
    let body = html! {
        h1 { (title) }
        p { a href=(PAGE) { "Standings" } }
        @if !suite.spec.title.is_empty() { p { b { (suite.spec.title) } } }
        @if !suite.spec.description.is_empty() { p { (suite.spec.description) } }
        h2 { "Taking part" }
        @if is_released { p { a href=(format!("../{PAGE}")) { "The page of the challenge" } " has data, deadline and how to submit." } } @else {
        p { "Run a tracker on the test split of every case of a track, and write its results to files " code { "results/NAME/TRACK/CASE/results.csv" }
            ". Choose parameters on train and val only: the seeds of the test splits are public, so the comparison relies on trackers that do not \
            use the truth of test." }
        pre { "microsig suite generate " (name) " --size " (size) " --out suites/" (size) "\n\
            microsig check-submission suites/" (size) " results/NAME --suite " (name) "\n\
            microsig suite score " (name) " suites/" (size) " --results results --out scores --site site" }
        }
        @for track in suite.spec.tracks.iter().filter(scored) {
            @let cases = scores.cases.iter().filter(|case| case.track == track.name);
            (track_rules(track, cases.map(|case| case.rank_by.as_slice()).collect()))
        }
        h2 { "Ranks" }
        (ranks())
        p.soft { "Scored by microsig " (scores.microsig) ", whose documentation defines all scores." }
    };
    report::document(&title, &body)
}

/// The scores and gates of a track; `orders`: the scores that rank each of its cases.
pub(super) fn track_rules(track: &TrackSpec, mut orders: Vec<&[scenario::Metric]>) -> Markup {
    let n = orders.len();
    orders.dedup();
    let gate_z =
        track.gate_z_um.map_or_else(|| "a tenth of the depth range".to_owned(), |um| format!("{um} um"));
    html! {
        h2 { "Track " (track.name) ": " (track.title) }
        p { (n) @if n == 1 { " case." } @else { " cases." }
            @if !ranks_fields(&track.rank_by) {
                " A point belongs to a particle within " (track.gate_xy_px.unwrap_or(ScoringGates::XY_PX)) " px in the image plane"
                @if track.dims != Some(2) { " and " (gate_z) " along z" } "."
            }
        }
        @for order in orders {
            p { "Ranked by, in this order" @if track.rank_by != *order { " (some cases)" } ":" }
            ol { @for metric in order {
                @let def = ScoreDef::of(*metric);
                li { (def.title()) " (" code { (def.name) } "), " (match def.better {
                    Better::Greater => "larger is better",
                    Better::Smaller => "smaller is better",
                    Better::NearOne => "nearer to 1 is better",
                    Better::NearZero => "nearer to 0 is better",
                }) }
            } }
        }
    }
}

/// How results are compared.
pub(super) fn ranks() -> Markup {
    html! {
        ul {
            li { "Each case is ranked separately. Two results are compared by each score of the track, in paired tests on the same true \
                tracks or nodes, in 1000 bootstrap resamples that are the same for all results; of two results of equal skill, at most 5 % are \
                separated. The first score that separates them decides." }
            li { "The rank is 1 plus the number of results that are better, directly or through others: a better result ranks first, whoever else \
                takes part. Different ranks are not a separation: of two results that no score separates, one ranks behind the other if a third \
                one lies between them." }
            li { "For errors of found particles, the test counts the particles that one result locates more accurately by more than a tenth of the \
                median error, so leaving out the worst particles gains nothing." }
            li { "A result for which a score is undefined is behind all results for which it is defined." }
            li { "Of two trackers, the one that is better in more cases of a track is ahead in its standing; a case without a result, or with one \
                that cannot be scored, is behind all others. Scores of different cases are never averaged. A team enters one tracker." }
        }
    }
}
