//! Scores of a suite as CSV and as text.

use std::fmt::Write as _;

use super::check::missing_text;
use super::{CaseResult, Status, SuiteScores};
use scoring::ranking::ScoreDef;
use storage::error::{Error, Result};
use storage::shown::cell;

/// One row for each tracker and case; every score with the ends of its 95 % interval.
pub(super) fn csv(scores: &SuiteScores) -> Result<Vec<u8>> {
    let failed = |e: csv::Error| Error::input(e.to_string());
    let mut table = csv::Writer::from_writer(Vec::new());
    let mut header: Vec<String> =
        ["suite", "version", "size", "track", "ladder", "case", "axes", "tracker", "status", "rank"]
            .map(str::to_owned)
            .to_vec();
    for metric in ScoreDef::metrics() {
        let name = ScoreDef::of(metric).name;
        header.extend([name.to_owned(), format!("{name}_low"), format!("{name}_high")]);
    }
    header.push("reason".to_owned());
    table.write_record(&header).map_err(failed)?;
    for case in &scores.cases {
        let axes: Vec<String> = case.axes.iter().map(|a| format!("{}={}", a.label, a.shown)).collect();
        for result in &case.results {
            let mut row = vec![scores.suite.clone(), scores.version.clone(), scores.size.name().to_owned()];
            row.extend([case.track.clone(), case.ladder.clone(), case.case.clone(), axes.join("; ")]);
            row.extend([cell(&result.tracker), status(result).to_owned()]);
            row.push(result.rank.map(|rank| rank.to_string()).unwrap_or_default());
            let text = |number: Option<f64>| number.map(|x| x.to_string()).unwrap_or_default();
            for metric in ScoreDef::metrics() {
                let value = result.value(metric);
                row.extend([
                    text(value.and_then(|v| v.value)),
                    text(value.and_then(|v| v.low)),
                    text(value.and_then(|v| v.high)),
                ]);
            }
            // A reason may start like a spreadsheet formula, such as `--dims 3: ...`.
            row.push(
                result.reason.as_deref().map(|why| cell(&format!("refused: {why}"))).unwrap_or_default(),
            );
            table.write_record(&row).map_err(failed)?;
        }
    }
    table.into_inner().map_err(|e| failed(e.into_error().into()))
}

fn status(result: &CaseResult) -> &'static str {
    match result.status {
        Status::Scored => "scored",
        Status::Missing => "missing",
        Status::Refused => "refused",
    }
}

/// Standings of each track, followed by its cases.
pub(super) fn text(scores: &SuiteScores) -> String {
    let mut text = format!("{} {}, size {}\n", scores.suite, scores.version, scores.size.name());
    let mut tracks: Vec<&str> = scores.cases.iter().map(|case| case.track.as_str()).collect();
    tracks.dedup();
    for track in tracks {
        let standings: Vec<_> = scores.standings.iter().filter(|s| s.track == track).collect();
        if standings.is_empty() {
            continue;
        }
        // Writing to a string cannot fail.
        let _ = writeln!(text, "\n{track}: {:<20} {:>4}  {:>6}  {:>5}", "tracker", "rank", "cases", "first");
        for s in standings {
            let space = " ".repeat(track.len() + 2);
            let cases = format!("{}/{}", s.scored, s.cases);
            let _ = writeln!(text, "{space}{:<20} {:>4}  {cases:>6}  {:>5}", s.tracker, s.rank, s.first);
        }
        for case in scores.cases.iter().filter(|case| case.track == track) {
            let names: Vec<String> =
                case.rank_by.iter().map(|metric| ScoreDef::of(*metric).title()).collect();
            let _ =
                writeln!(text, "  {} ({}; {} independent units)", case.case, names.join(", "), case.units);
            for result in case.results.iter().filter(|result| result.status != Status::Missing) {
                let rank = result.rank.map_or_else(|| "-".to_owned(), |rank| rank.to_string());
                let values = case.rank_by.iter().map(|metric| {
                    let value = result.value(*metric);
                    let shown = |x: f64| format!("{x:.4}");
                    let of = |v: super::MetricValue| {
                        let ends = v.low.zip(v.high).map(|(a, b)| format!(" [{}, {}]", shown(a), shown(b)));
                        v.value.map(|x| shown(x) + &ends.unwrap_or_default())
                    };
                    value.and_then(of).unwrap_or_else(|| "-".to_owned())
                });
                let values = match result.status {
                    Status::Scored => values.collect::<Vec<_>>().join(", "),
                    Status::Missing => String::new(),
                    Status::Refused => format!("refused: {}", result.reason.as_deref().unwrap_or_default()),
                };
                let _ = writeln!(text, "    {rank:>2}  {:<20} {values}", result.tracker);
            }
        }
    }
    let mut trackers: Vec<&str> = scores.standings.iter().map(|s| s.tracker.as_str()).collect();
    trackers.sort_unstable();
    trackers.dedup();
    for tracker in trackers {
        let is_missing = |result: &CaseResult| result.tracker == tracker && result.status == Status::Missing;
        let cases = scores.cases.iter().filter(|case| case.results.iter().any(is_missing));
        let missing: Vec<String> = cases.map(|case| format!("{}/{}", case.track, case.case)).collect();
        if !missing.is_empty() {
            let _ = writeln!(text, "\n{tracker}: {}", missing_text(&missing));
        }
    }
    for s in scores.standings.iter().filter(|s| !scores.published.contains(&s.tracker)) {
        let cases: Vec<_> = scores.cases.iter().filter(|case| case.track == s.track).collect();
        for other in
            scores.standings.iter().filter(|of| of.track == s.track && scores.published.contains(&of.tracker))
        {
            let n = |sign| {
                cases.iter().filter(|case| case.difference(&s.tracker, &other.tracker) == sign).count()
            };
            let (track, tracker, other) = (&s.track, &s.tracker, &other.tracker);
            let [better, worse, equal] = [1, -1, 0].map(n);
            let _ = writeln!(
                text,
                "{track}: {tracker} and published {other}: better in {better}, worse in {worse}, not separated in {equal} cases"
            );
        }
    }
    text.trim_end().to_owned()
}
