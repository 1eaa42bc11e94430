//! The page of a suite's scores: for each track, standings, curves over each ladder, and tables of all cases.

use std::collections::{BTreeMap, BTreeSet};

use maud::{Markup, html};

use super::site::{contents, link, report_of};
use super::{CaseResult, CaseScores, MetricValue, Standing, Status, SuiteScores};
use crate::report::{
    AxisLabels, Series, document, figure_of, is_logarithmic, lines, lines_over_log, log_lines, names,
};
use scenario::Metric;
use scoring::ranking::{Better, ScoreDef};
use storage::error::Result;

/// Information besides the scores.
#[derive(Debug, Clone, Default)]
pub struct Annotations {
    /// Names of trackers on the page, where they differ from the names of their folders.
    pub names: BTreeMap<String, String>,
    /// What each tracker was made for, by name.
    pub made_for: BTreeMap<String, String>,
    /// Time per frame, s, by tracker and `TRACK/CASE`.
    pub seconds_per_frame: BTreeMap<(String, String), f64>,
    /// Whether the page belongs to a site, with rules and tables.
    pub is_site: bool,
    /// Paths of the reports of single results beside the page.
    pub reports: BTreeSet<String>,
}

impl Annotations {
    fn name<'a>(&'a self, tracker: &'a str) -> &'a str {
        self.names.get(tracker).map_or(tracker, String::as_str)
    }
}

/// The page, without scripts or network access.
pub fn page(scores: &SuiteScores, more: &Annotations) -> Result<String> {
    let mut tracks: Vec<&str> = scores.cases.iter().map(|case| case.track.as_str()).collect();
    tracks.dedup();
    let mut parts = Vec::new();
    for track in tracks {
        parts.push(track_section(scores, track, more)?);
    }
    let title = format!("{} {}, size {}", scores.suite, scores.version, scores.size.name());
    let body = html! {
        h1 { (title) }
        p.soft { "Scored by microsig " (scores.microsig) ". Each case is ranked separately, by the scores in the order of the \
        columns: of two results, the first score whose difference on the particles or nodes of the case is significant decides. \
        All scores of a case are tested together: two results of equal skill are separated in at most 5 % of all cases (intervals in \
        brackets are 95 % and those of each score alone). The rank is 1 plus the number of results that are better, directly or through others; different ranks alone are not a separation. \
        Scores of different cases are never averaged. In the standing of a track, of two trackers the one that is better in more cases is ahead; a case \
        without a result is behind all others. The standing is no test: it counts cases. Errors cover found particles only: read them together with recall or F1." }
        @if more.is_site { (contents()) }
        @for part in &parts { (part) }
    };
    Ok(document(&title, &body))
}

fn track_section(scores: &SuiteScores, track: &str, more: &Annotations) -> Result<Markup> {
    let cases: Vec<&CaseScores> = scores.cases.iter().filter(|case| case.track == track).collect();
    let standings: Vec<&Standing> = scores.standings.iter().filter(|s| s.track == track).collect();
    let mut plots = Vec::new();
    let mut ladders: Vec<&str> = cases.iter().map(|case| case.ladder.as_str()).collect();
    ladders.dedup();
    for ladder in ladders {
        let of_ladder: Vec<&CaseScores> = cases.iter().filter(|c| c.ladder == ladder).copied().collect();
        plots.extend(curves(ladder, &of_ladder)?);
    }
    Ok(html! {
        h2 { "Track " (track) }
        @if standings.is_empty() { p { "No tracker has entered this track." } }
        @else {
            div.scroll { table.board {
                tr { th { "tracker" } th { "rank" } th { "cases" } th { "first" } th { "s per frame, median" } th style="text-align: left" { "made for" } }
                @for s in &standings { tr {
                    td { (more.name(&s.tracker)) } td { (s.rank) }
                    td { (s.scored) " of " (s.cases) @if s.refused > 0 { ", " (s.refused) " refused" } }
                    td { (s.first) } td { (time(&s.tracker, &cases, more)) }
                    td style="text-align: left; white-space: normal; max-width: 30rem" {
                        (more.made_for.get(&s.tracker).map_or("", String::as_str))
                    }
                } }
            } }
            @let unmeasured = unmeasured(&cases);
            @if !unmeasured.is_empty() { p {
                "Without a value (undefined for all, or not shown: of a withheld truth with few units): " (unmeasured.join(", ")) "."
            } }
            @if !plots.is_empty() { div.plots { @for plot in &plots { (plot) } } }
            @for case in &cases { (table(case, more)) }
        }
    })
}

/// Ranking scores of a track that none of its results has.
fn unmeasured(cases: &[&CaseScores]) -> Vec<String> {
    let has = |metric: Metric| {
        let mut results = cases.iter().flat_map(|case| &case.results);
        results.any(|result| result.value(metric).is_some_and(|value| value.value.is_some()))
    };
    let ranks = |metric: &Metric| cases.iter().any(|case| case.rank_by.contains(metric));
    let none = ScoreDef::metrics().filter(|metric| ranks(metric) && !has(*metric));
    none.map(|metric| ScoreDef::of(metric).title()).collect()
}

/// Median time per frame of a tracker over the cases of a track.
fn time(tracker: &str, cases: &[&CaseScores], more: &Annotations) -> String {
    let of = |case: &&CaseScores| {
        more.seconds_per_frame.get(&(tracker.to_owned(), format!("{}/{}", case.track, case.case))).copied()
    };
    let mut times: Vec<f64> = cases.iter().filter_map(of).collect();
    times.sort_by(f64::total_cmp);
    times.get(times.len() / 2).map_or_else(|| "-".to_owned(), |t| format!("{t:.3}"))
}

fn table(case: &CaseScores, more: &Annotations) -> Markup {
    let axes: Vec<String> = case.axes.iter().map(|a| format!("{} = {}", a.label, a.shown)).collect();
    let others: Vec<Metric> = ScoreDef::metrics()
        .filter(|m| !case.rank_by.contains(m))
        .filter(|m| case.results.iter().any(|r| r.value(*m).is_some_and(|v| v.value.is_some())))
        .collect();
    let key = |result: &CaseResult| (result.tracker.clone(), format!("{}/{}", case.track, case.case));
    let why = |result: &CaseResult| match result.status {
        Status::Refused => format!("refused: {}", result.reason.as_deref().unwrap_or_default()),
        _ => "missing".to_owned(),
    };
    let columns = case.rank_by.len() + others.len() + 1;
    html! {
        details {
            summary { b { (case.case) } " " span.soft { (axes.join(", ")) @if case.units > 0 { "; " (case.units) " independent units" } } }
            div.scroll { table.board {
                tr {
                    th { "rank" } th { "tracker" }
                    @for metric in case.rank_by.iter().chain(&others) { th { (ScoreDef::of(*metric).title()) } }
                    th { "s per frame" }
                }
                @for result in &case.results { tr {
                    td { (result.rank.map_or_else(|| "-".to_owned(), |rank| rank.to_string())) }
                    @let report = report_of(&result.tracker, case);
                    td { @if more.reports.contains(&report) { a href=(link(&report)) { (more.name(&result.tracker)) } }
                        @else { (more.name(&result.tracker)) } }
                    @if result.status == Status::Scored {
                        @for metric in case.rank_by.iter().chain(&others) { td { (shown(result.value(*metric))) } }
                        td { (more.seconds_per_frame.get(&key(result)).map_or_else(|| "-".to_owned(), |t| format!("{t:.3}"))) }
                    } @else { td colspan=(columns) style="text-align: left" { (why(result)) } }
                } }
            } }
        }
    }
}

fn shown(value: Option<MetricValue>) -> String {
    let Some(value) = value else { return "-".to_owned() };
    let digits = |x: f64| {
        if x.abs() >= 100.0 {
            format!("{x:.0}")
        } else if x.abs() >= 10.0 {
            format!("{x:.1}")
        } else {
            format!("{x:.3}")
        }
    };
    let ends = value.low.zip(value.high).map(|(a, b)| format!(" [{}, {}]", digits(a), digits(b)));
    value.value.map_or_else(|| "-".to_owned(), |x| digits(x) + &ends.unwrap_or_default())
}

/// Ranking scores over each axis of a ladder on which cases differ.
fn curves(ladder: &str, cases: &[&CaseScores]) -> Result<Vec<Markup>> {
    let Some(first) = cases.first() else { return Ok(Vec::new()) };
    let mut plots = Vec::new();
    for axis in 0..first.axes.len() {
        let mut values: Vec<f64> =
            cases.iter().filter_map(|case| case.axes.get(axis).and_then(|a| a.number)).collect();
        values.sort_by(f64::total_cmp);
        values.dedup();
        if values.len() < 2 {
            continue;
        }
        let is_log = is_logarithmic(&values);
        for metric in &first.rank_by {
            let series = over(axis, *metric, cases);
            if !series.iter().any(Series::has_points) {
                continue;
            }
            let x = &first.axes[axis].label;
            let def = ScoreDef::of(*metric);
            let title = def.title();
            let labels = AxisLabels { x, y: &title, title: &title };
            // A quantity on a logarithmic axis changes errors by ratios, so they are logarithmic as well.
            let svg =
                if is_log && def.better == Better::Smaller { log_lines(&labels, &series)? } else { None };
            let svg = match svg {
                Some(svg) => svg,
                None if is_log => lines_over_log(&labels, &series, &values)?,
                None => lines(&labels, &series)?,
            };
            let caption = format!("{title} over {x}, ladder {ladder}.");
            plots.push(figure_of(svg, &names(&series), &caption));
        }
    }
    Ok(plots)
}

/// A line for each tracker and each combination of values of the other axes. Combinations for which no
/// tracker has a line are left out; otherwise a tracker without a line keeps its place, and all others their
/// colors.
fn over(axis: usize, metric: Metric, cases: &[&CaseScores]) -> Vec<Series> {
    type Points = Vec<(f64, MetricValue)>;
    let mut points: BTreeMap<(String, String), Points> = BTreeMap::new();
    for case in cases {
        let Some(x) = case.axes.get(axis).and_then(|a| a.number) else { continue };
        let others = case.axes.iter().enumerate().filter(|(i, _)| *i != axis);
        let others: Vec<String> = others.map(|(_, a)| format!("{} {}", a.label, a.shown)).collect();
        for result in &case.results {
            let of_name = points.entry((result.tracker.clone(), others.join(", "))).or_default();
            of_name.extend(result.value(metric).filter(|v| v.value.is_some()).map(|value| (x, value)));
        }
    }
    let is_line = |points: &Points| points.len() > 1;
    let drawn: BTreeSet<String> =
        points.iter().filter(|(_, of)| is_line(of)).map(|((_, others), _)| others.clone()).collect();
    points
        .into_iter()
        .filter(|((_, others), _)| drawn.contains(others))
        .map(|((tracker, others), mut points)| {
            let name = if others.is_empty() { tracker } else { format!("{tracker}, {others}") };
            if !is_line(&points) {
                points.clear();
            }
            points.sort_by(|a, b| a.0.total_cmp(&b.0));
            let nan = f64::NAN;
            let bars = points.iter().map(|(_, v)| v.low.zip(v.high).unwrap_or((nan, nan))).collect();
            Series::new(name, points.iter().map(|(x, v)| (*x, v.value.unwrap_or(nan))).collect())
                .with_bars(bars)
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn trackers_keep_their_places_whatever_combinations_are_drawn() {
        let case = |n_s: f64, noise: f64| -> CaseScores {
            let of = |tracker: &str| {
                serde_json::json!({ "tracker": tracker, "status": "scored", "reason": null, "rank": 1, "warnings": [],
                    "scores": [{ "metric": "f1", "value": 0.5, "low": null, "high": null }] })
            };
            let axis = |label: &str, x: f64| serde_json::json!({ "label": label, "shown": x.to_string(), "number": x });
            serde_json::from_value(serde_json::json!({ "track": "D3", "ladder": "density", "case": "", "dataset": "",
                "axes": [axis("N_S", n_s), axis("noise", noise)], "rank_by": ["f1"], "results": [of("a"), of("b")] }))
            .unwrap()
        };
        // Only the noise of 50 has more than one N_S.
        let cases = [case(0.1, 10.0), case(0.1, 50.0), case(0.3, 50.0)];
        let cases: Vec<&CaseScores> = cases.iter().collect();
        let names = |axis| over(axis, Metric::F1, &cases).iter().map(|s| s.name.clone()).collect::<Vec<_>>();
        assert_eq!(names(0), ["a, noise 50", "b, noise 50"]);
        assert_eq!(names(1), ["a, N_S 0.1", "b, N_S 0.1"]);
    }
}
