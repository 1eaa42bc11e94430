//! The files of a leaderboard: README.md, scores.csv, index.html, versions.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::path::Path;

use anyhow::ensure;
use serde_json::Value;

use super::example;
use super::run::RECORD;
use super::trackers::{How, Tracker};
use arena::suite::{Annotations, PAGE, SUITE_SCORES, SUITE_SCORES_CSV, SuiteScores, page, unmeasured};
use scoring::ranking::{ScoreDef, ranks_fields};

/// Case for the example image, and cases for which depth errors are plotted, of each track.
const PICTURES: usize = 2;

/// Writes the leaderboard of the scores in `work`.
pub(super) fn write(
    out: &Path,
    work: &Path,
    trackers: &[Tracker],
    unusable: &[(String, String)],
    notes: &[String],
) -> anyhow::Result<()> {
    let scores = SuiteScores::read(&work.join("scores").join(SUITE_SCORES))?;
    let mut more = Annotations { notes: notes.to_vec(), ..Annotations::default() };
    more.notes.push(
        "Trackers see images, calibration images, optics and times of the test splits, but not the truth. The seeds of these test splits \
        are public, so the leaderboard relies on the honesty of participants; `microsig suite release` makes challenges with secret keys."
            .to_owned(),
    );
    more.notes.push(
        "microsig's own trackers run with their default parameters. Third-party trackers in `examples/trackers` run with parameters that \
        their `tune.py` found on train and val splits with a limited number of evaluations (`--tune`; `tuning.csv` lists them), or with defaults \
        where no parameters were searched."
            .to_owned(),
    );
    more.notes.extend(unusable.iter().map(|(name, why)| format!("{name} {why}")));
    more.without_depth = trackers.iter().filter(|t| !t.has_depth).map(|t| t.name.clone()).collect();
    more.made_for = trackers.iter().map(|t| (t.name.clone(), t.made_for.clone())).collect();
    for case in &scores.cases {
        let folder = format!("{}/{}", case.track, case.case);
        for result in &case.results {
            let record = work.join("results").join(&result.tracker).join(&folder).join(RECORD);
            let Ok(text) = std::fs::read_to_string(&record) else { continue };
            let run: Value = serde_json::from_str(&text)?;
            let key = (result.tracker.clone(), folder.clone());
            match run["failure"].as_str() {
                Some(failure) => more.failures.extend([(key, failure.to_owned())]),
                None => more.seconds_per_frame.extend(run["seconds_per_frame"].as_f64().map(|s| (key, s))),
            }
        }
        let shown = more.pictures.entry(case.track.clone()).or_default();
        let is_of_fields = ranks_fields(&case.rank_by);
        if is_of_fields || shown.len() < PICTURES {
            shown.extend(example::picture(work, case)?);
        }
        // The fields of the last cases of a track vary most over the image.
        if shown.len() > PICTURES {
            shown.remove(0);
        }
        let curves = more.depth_errors.entry(case.track.clone()).or_default();
        if curves.len() < PICTURES {
            curves.extend(example::depth_errors(work, case)?);
        }
    }
    std::fs::create_dir_all(out)?;
    std::fs::write(out.join(PAGE), page(&scores, &more)?)?;
    std::fs::copy(work.join("scores").join(SUITE_SCORES_CSV), out.join("scores.csv"))?;
    std::fs::write(out.join("times.csv"), times(&scores, &more)?)?;
    std::fs::write(out.join("README.md"), readme(&scores, &more)?)?;
    let versions = out.join("versions");
    std::fs::create_dir_all(&versions)?;
    for tracker in trackers.iter().filter(|tracker| !tracker.versions.is_empty()) {
        std::fs::write(versions.join(format!("{}.txt", tracker.name)), &tracker.versions)?;
    }
    println!("{}", out.join(PAGE).display());
    // Third-party trackers may fail outside their range of use; microsig's own may not.
    let own = |name: &str| trackers.iter().any(|t| t.name == name && matches!(t.how, How::Own(_)));
    let failed: Vec<String> = (more.failures.iter().filter(|((name, _), _)| own(name)))
        .map(|((name, case), why)| format!("{name} on {case}: {why}"))
        .collect();
    ensure!(failed.is_empty(), "microsig's own trackers failed: {}", failed.join("; "));
    Ok(())
}

/// Time per frame, or the reason of failure, of every run.
fn times(scores: &SuiteScores, more: &Annotations) -> anyhow::Result<Vec<u8>> {
    let mut table = csv::Writer::from_writer(Vec::new());
    table.write_record(["tracker", "track", "case", "seconds_per_frame", "failure"])?;
    for case in &scores.cases {
        let mut trackers: Vec<&String> = case.results.iter().map(|result| &result.tracker).collect();
        trackers.sort();
        for tracker in trackers {
            let key = (tracker.clone(), format!("{}/{}", case.track, case.case));
            let seconds = more.seconds_per_frame.get(&key).map(|s| format!("{s:.4}")).unwrap_or_default();
            let failure = more.failures.get(&key).map_or("", String::as_str);
            table.write_record([tracker, &case.track, &case.case, &seconds, failure])?;
        }
    }
    Ok(table.into_inner()?)
}

/// The standings.
fn readme(scores: &SuiteScores, more: &Annotations) -> anyhow::Result<String> {
    let mut text = format!(
        "# Leaderboard of {} {}, size {}\n\n`index.html`, which the command writes beside this file and which is not kept in the repository, shows all cases with intervals, curves and example images; `scores.csv` contains all scores \
         with the ends of their 95 % intervals, `times.csv` the time per frame, `versions/` the packages of each environment.\n",
        scores.suite,
        scores.version,
        scores.size.name()
    );
    for note in &more.notes {
        write!(text, "\n{note}\n")?;
    }
    text += "\nEach case is ranked separately; scores of different cases are never averaged. Of two trackers, the one that is better in more \
             cases of the track is ahead, and a case without a result is behind all others.\n";
    let mut tracks: Vec<&str> = scores.cases.iter().map(|case| case.track.as_str()).collect();
    tracks.dedup();
    for track in tracks {
        let standings: Vec<_> = scores.standings.iter().filter(|s| s.track == track).collect();
        write!(text, "\n## Track {track}\n\n")?;
        if standings.is_empty() {
            text += "No tracker has entered this track.\n";
            continue;
        }
        let of_track: Vec<_> = scores.cases.iter().filter(|case| case.track == track).collect();
        for metric in unmeasured(&of_track) {
            writeln!(
                text,
                "No tracker listed here has a value for the score \"{}\"; ranks follow from the other scores.\n",
                ScoreDef::of(metric).title()
            )?;
        }
        text += "| tracker | rank | cases | first in | s per frame, median | made for |\n|---|---|---|---|---|---|\n";
        for s in standings {
            let of_track =
                |key: &&(String, String)| key.0 == s.tracker && key.1.starts_with(&format!("{track}/"));
            let mut times: Vec<f64> =
                more.seconds_per_frame.iter().filter(|(key, _)| of_track(key)).map(|(_, t)| *t).collect();
            times.sort_by(f64::total_cmp);
            let time = times.get(times.len() / 2).map_or_else(|| "–".to_owned(), |t| format!("{t:.3}"));
            let none = String::new();
            let made_for = more.made_for.get(&s.tracker).unwrap_or(&none);
            writeln!(
                text,
                "| {} | {} | {} of {} | {} | {time} | {} |",
                s.tracker,
                s.rank,
                s.scored,
                s.cases,
                s.first,
                made_for.replace('\n', " ").trim()
            )?;
        }
    }
    let mut failures: BTreeMap<&str, Vec<&str>> = BTreeMap::new();
    for ((tracker, case), failure) in &more.failures {
        failures.entry(tracker).or_default().extend([case.as_str(), failure.as_str()]);
    }
    if !failures.is_empty() {
        text += "\n## Runs that failed\n\n";
        for (tracker, listed) in failures {
            for pair in listed.chunks(2) {
                writeln!(text, "- {tracker} on {}", pair.join(": "))?;
            }
        }
    }
    Ok(text)
}
