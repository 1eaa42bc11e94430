//! `microsig compare`: a leaderboard of several scores, and their curves in one plot.
//!
//! Ranked by F1 of detection (fields: probability of a valid vector). A score whose 95 % interval reaches that of the best of
//! a rank shares the rank: the data do not tell them apart; those stand in the order of their errors. Localisation stands
//! beside recall, never alone.

use std::path::{Path, PathBuf};

use maud::html;
use serde::Serialize;
use serde_json::Value;

use super::html::{axis, document, figure_of};
use super::plots::{Line, Words, lines};
use super::table::number;
use super::{SCORE, rows, save};
use crate::dataset::folder::Partial;
use crate::error::{Error, Result};

/// A line of the leaderboard.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
#[allow(missing_docs)]
pub struct Entry {
    pub rank: usize,
    pub name: String,
    pub dataset: String,
    pub f1: Option<f64>,
    /// Interval of what it is ranked by.
    pub low: Option<f64>,
    pub high: Option<f64>,
    pub recall: Option<f64>,
    pub precision: Option<f64>,
    pub rmse_xy_px: Option<f64>,
    pub sigma_z_over_h: Option<f64>,
    pub link_f1: Option<f64>,
    pub hota: Option<f64>,
    pub alpha: Option<f64>,
    pub beta: Option<f64>,
    pub jsc: Option<f64>,
    pub jsc_theta: Option<f64>,
    pub valid_vector_probability: Option<f64>,
    pub aee_px: Option<f64>,
    pub rms_u_inliers_px: Option<f64>,
}

impl Entry {
    fn of(name: String, score: &Value) -> Self {
        let get = |pointer: &str| score.pointer(pointer).and_then(Value::as_f64);
        let end = |i: usize| {
            get(&format!("/detection/interval/f1/{i}"))
                .or_else(|| get(&format!("/field/interval_valid_vector_probability/{i}")))
        };
        Entry {
            rank: 0,
            name,
            dataset: score["dataset"].as_str().unwrap_or_default().to_owned(),
            f1: get("/detection/f1"),
            low: end(0),
            high: end(1),
            recall: get("/detection/recall"),
            precision: get("/detection/precision"),
            rmse_xy_px: get("/detection/rmse_xy_px"),
            sigma_z_over_h: get("/gdpt/sigma_z_over_h"),
            link_f1: get("/links/f1"),
            hota: get("/hota/hota"),
            alpha: get("/isbi/alpha"),
            beta: get("/isbi/beta"),
            jsc: get("/isbi/jsc"),
            jsc_theta: get("/isbi/jsc_theta"),
            valid_vector_probability: get("/field/valid_vector_probability"),
            aee_px: get("/field/aee_px"),
            rms_u_inliers_px: get("/field/u_inliers/rms_px"),
        }
    }

    /// What it is ranked by.
    fn key(&self) -> f64 {
        self.f1.or(self.valid_vector_probability).unwrap_or(f64::NEG_INFINITY)
    }
}

/// What was compared.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Compared {
    /// The leaderboard, best first.
    pub entries: Vec<Entry>,
    /// What must be known about it.
    pub warnings: Vec<String>,
    /// The folder.
    pub out: PathBuf,
    /// It as text.
    #[serde(skip)]
    pub text: String,
}

/// Compares scores and writes `leaderboard.csv`, `curves.csv` and `leaderboard.html`.
///
/// # Errors
/// Files that are no scores; a folder that exists unless `force`; writing.
pub fn compare(paths: &[PathBuf], out: &Path, force: bool) -> Result<Compared> {
    if out.exists() && !force {
        return Err(Error::Exists(out.to_owned()));
    }
    let (mut scores, mut problems) = (Vec::new(), Vec::new());
    for path in paths {
        match read(path) {
            Ok(score) => scores.push(score),
            Err(e) => problems.push(e.to_string()),
        }
    }
    if !problems.is_empty() {
        return Err(Error::Input(problems));
    }
    for i in 1..scores.len() {
        // Folders of the same name in different places are different trackers.
        if scores[..i].iter().any(|s| s.0.name == scores[i].0.name) {
            scores[i].0.name = format!("{} ({})", scores[i].0.name, paths[i].display());
        }
    }
    scores.sort_by(|a, b| b.0.key().total_cmp(&a.0.key()).then_with(|| a.0.name.cmp(&b.0.name)));
    rank(&mut scores);
    // Who shares a rank stands in the order of errors.
    let error = |e: &Entry| e.rmse_xy_px.or(e.aee_px).unwrap_or(f64::INFINITY);
    scores.sort_by(|(a, _), (b, _)| a.rank.cmp(&b.rank).then(error(a).total_cmp(&error(b))));
    let entries: Vec<Entry> = scores.iter().map(|s| s.0.clone()).collect();
    let mut warnings = differences(&scores);
    for (entry, score) in &scores {
        let own = score["warnings"].as_array().into_iter().flatten().filter_map(Value::as_str);
        warnings.extend(own.map(|w| format!("{}: {w}", entry.name)));
    }
    let text = text(&entries, &warnings);

    let partial = Partial::anew(out)?;
    rows(&partial.folder().join("leaderboard.csv"), entries.iter())?;
    rows(&partial.folder().join("curves.csv"), curve_rows(&scores).into_iter())?;
    save(&partial.folder().join("leaderboard.html"), page(&scores, &warnings)?.as_bytes())?;
    partial.finish(force.then_some("leaderboard.csv"))?;
    Ok(Compared { entries, warnings, out: out.to_owned(), text })
}

fn read(path: &Path) -> Result<(Entry, Value)> {
    let file = if path.is_dir() { path.join(SCORE) } else { path.to_owned() };
    let text = std::fs::read_to_string(&file).map_err(|e| Error::read(&file, e))?;
    let score: Value =
        serde_json::from_str(&text).map_err(|e| Error::input(format!("{}: {e}", file.display())))?;
    if score["definitions"]["versions"].is_null() {
        return Err(Error::input(format!("{}: no score of microsig evaluate", file.display())));
    }
    // Folders are named after trackers more often than files are.
    let folder = file.parent().and_then(Path::file_name).map(|n| n.to_string_lossy().into_owned());
    let name = folder.filter(|_| file.ends_with(SCORE)).unwrap_or_else(|| file.display().to_string());
    Ok((Entry::of(name, &score), score))
}

/// Ranks sorted scores; one that cannot be told from the best of a rank shares it.
fn rank(scores: &mut [(Entry, Value)]) {
    let mut leader: Option<(usize, Option<f64>)> = None;
    for (i, (entry, _)) in scores.iter_mut().enumerate() {
        let tied = leader.and_then(|(_, low)| low).zip(entry.high).is_some_and(|(low, high)| high >= low);
        if !tied {
            leader = Some((i + 1, entry.low));
        }
        entry.rank = leader.map_or(i + 1, |l| l.0);
    }
}

/// What makes scores incomparable.
fn differences(scores: &[(Entry, Value)]) -> Vec<String> {
    let mut warnings = Vec::new();
    for (what, pointer) in [
        ("datasets", "/dataset"),
        ("gates", "/definitions/gate"),
        ("gates of ISBI", "/definitions/isbi_gate_px"),
        ("numbers of dimensions", "/definitions/dims"),
        ("borders", "/definitions/border_px"),
    ] {
        let first = scores.first().and_then(|s| s.1.pointer(pointer));
        if scores.iter().any(|s| s.1.pointer(pointer) != first) {
            warnings.push(format!("the scores are of different {what}: their order means little"));
        }
    }
    warnings
}

/// The leaderboard in 80 columns.
fn text(entries: &[Entry], warnings: &[String]) -> String {
    let n = number;
    let tied = |e: &Entry| entries.iter().filter(|o| o.rank == e.rank).count() > 1;
    let rank = |e: &Entry| format!("{}{}", e.rank, if tied(e) { "=" } else { "" });
    let name = |e: &Entry| {
        let name: String = e.name.chars().take(14).collect();
        if name.len() < e.name.len() { name + "~" } else { name }
    };
    let mut lines = Vec::new();
    if entries.iter().any(|e| e.f1.is_some()) {
        lines.push(format!(
            "{:<4} {:<15} {:>6}  {:<16} {:>6} {:>6} {:>6} {:>6} {:>6}",
            "rank", "name", "F1", "95 %", "recall", "xy px", "z / h", "links", "HOTA"
        ));
        let short = |v: Option<f64>| v.map_or("-".to_owned(), |v| format!("{v:.4}"));
        lines.extend(entries.iter().filter(|e| e.f1.is_some()).map(|e| {
            format!(
                "{:<4} {:<15} {:>6}  {:<16} {:>6} {:>6} {:>6} {:>6} {:>6}",
                rank(e),
                name(e),
                short(e.f1),
                e.low.zip(e.high).map_or("-".to_owned(), |(l, h)| format!("[{l:.4}, {h:.4}]")),
                short(e.recall),
                short(e.rmse_xy_px),
                short(e.sigma_z_over_h),
                short(e.link_f1),
                short(e.hota)
            )
        }));
    }
    if entries.iter().any(|e| e.aee_px.is_some()) {
        lines.push(format!(
            "{:<4} {:<15} {:>8}  {:<16} {:>8} {:>12}",
            "rank", "name", "valid", "95 %", "AEE px", "RMS u in px"
        ));
        lines.extend(entries.iter().filter(|e| e.aee_px.is_some()).map(|e| {
            format!(
                "{:<4} {:<15} {:>8}  {:<16} {:>8} {:>12}",
                rank(e),
                name(e),
                n(e.valid_vector_probability),
                e.low.zip(e.high).map_or("-".to_owned(), |(l, h)| format!("[{l:.4}, {h:.4}]")),
                n(e.aee_px),
                n(e.rms_u_inliers_px)
            )
        }));
    }
    lines.push("=: 95 % intervals of what ranks reach each other.".to_owned());
    lines.extend(warnings.iter().map(|w| format!("WARNING {w}")));
    lines.join("\n")
}

#[derive(Serialize)]
struct CurveRow {
    name: String,
    against: String,
    from: Option<f64>,
    to: Option<f64>,
    recall: Option<f64>,
    rms_x_px: Option<f64>,
    rms_y_px: Option<f64>,
    rms_z_um: Option<f64>,
}

fn curve_rows(scores: &[(Entry, Value)]) -> Vec<CurveRow> {
    let mut rows = Vec::new();
    for (entry, score) in scores {
        for curve in score["curves"].as_array().into_iter().flatten() {
            for bin in curve["bins"].as_array().into_iter().flatten() {
                rows.push(CurveRow {
                    name: entry.name.clone(),
                    against: curve["against"].as_str().unwrap_or_default().to_owned(),
                    from: bin["from"].as_f64(),
                    to: bin["to"].as_f64(),
                    recall: bin["recall"].as_f64(),
                    rms_x_px: bin["rms_x_px"].as_f64(),
                    rms_y_px: bin["rms_y_px"].as_f64(),
                    rms_z_um: bin["rms_z_um"].as_f64(),
                });
            }
        }
    }
    rows
}

fn page(scores: &[(Entry, Value)], warnings: &[String]) -> Result<String> {
    let n = number;
    let rows = curve_rows(scores);
    let mut against: Vec<&str> = rows.iter().map(|r| r.against.as_str()).collect();
    against.sort_unstable();
    against.dedup();
    let mut plots = Vec::new();
    type Value = fn(&CurveRow) -> Option<f64>;
    let values: [(&str, Value); 3] =
        [("recall", |r| r.recall), ("RMS error x, px", |r| r.rms_x_px), ("RMS error z, um", |r| r.rms_z_um)];
    for x in against {
        for (y, value) in values {
            let series: Vec<Line> = scores
                .iter()
                .map(|(entry, _)| Line {
                    name: entry.name.clone(),
                    points: rows
                        .iter()
                        .filter(|r| r.name == entry.name && r.against == x)
                        .filter_map(|r| Some((f64::midpoint(r.from?, r.to?), value(r).unwrap_or(f64::NAN))))
                        .collect(),
                })
                .collect();
            if series.iter().any(|l| l.points.iter().any(|p| p.1.is_finite())) {
                let x = axis(x);
                let svg = lines(&Words { x, y, title: y }, &series)?;
                let names: Vec<&str> = series.iter().map(|l| l.name.as_str()).collect();
                let mut caption = format!("{y} against {x}.");
                caption[..1].make_ascii_uppercase();
                plots.push(figure_of(svg, &names, &caption));
            }
        }
    }
    type Column = fn(&Entry) -> Option<f64>;
    let columns: [(&str, Column); 16] = [
        ("F1", |e| e.f1),
        ("valid vectors", |e| e.valid_vector_probability),
        ("95 % from", |e| e.low),
        ("to", |e| e.high),
        ("recall", |e| e.recall),
        ("precision", |e| e.precision),
        ("RMSE xy, px", |e| e.rmse_xy_px),
        ("sigma z / h", |e| e.sigma_z_over_h),
        ("AEE, px", |e| e.aee_px),
        ("RMS u of inliers, px", |e| e.rms_u_inliers_px),
        ("link F1", |e| e.link_f1),
        ("HOTA", |e| e.hota),
        ("alpha", |e| e.alpha),
        ("beta", |e| e.beta),
        ("JSC", |e| e.jsc),
        ("JSC_theta", |e| e.jsc_theta),
    ];
    // Fields and particles have other scores.
    let columns: Vec<_> =
        columns.into_iter().filter(|(_, value)| scores.iter().any(|(e, _)| value(e).is_some())).collect();
    let body = html! {
        h1 { "Leaderboard" }
        p.soft { "Ranked by F1 of detection, fields by the probability of a valid vector. Equal ranks: the 95 % intervals of what they are ranked by reach each other. "
            "Errors count found particles only, so read them beside recall." }
        @for warning in warnings { p.warning { (warning) } }
        div.scroll { table.board {
            tr { th { "rank" } th { "name" } @for (name, _) in &columns { th { (name) } } }
            @for (e, _) in scores { tr {
                td { (e.rank) } td { (e.name) } @for (_, value) in &columns { td { (n(value(e))) } }
            } }
        } }
        @if !plots.is_empty() { h2 { "Curves" } div.plots { @for plot in &plots { (plot) } } }
    };
    Ok(document("Leaderboard", &body))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn scores_that_intervals_do_not_tell_apart_share_a_rank() {
        let entry = |f1: f64, half: f64| {
            let score = serde_json::json!({ "detection": { "f1": f1, "interval": { "f1": [f1 - half, f1 + half] } } });
            (Entry::of(f1.to_string(), &score), score)
        };
        let mut scores = vec![entry(0.9, 0.02), entry(0.87, 0.02), entry(0.85, 0.02), entry(0.84, 0.02)];
        rank(&mut scores);
        // The third does not reach the first, so it begins a rank of its own, which the fourth shares.
        let ranks: Vec<usize> = scores.iter().map(|s| s.0.rank).collect();
        assert_eq!(ranks, [1, 1, 3, 3]);
    }
}
