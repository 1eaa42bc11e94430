//! `microsig compare`: a leaderboard of several scores, and their curves in one plot.
//!
//! Particles are ranked by F1 of detection; where 95 % intervals do not tell scores apart by their errors in the image plane
//! and in depth, then by F1 of links, then by HOTA. Fields, on a list of their own, by the probability of a valid vector, RMS
//! error of inliers, AEE. Who is told apart by none of these shares a rank. Localisation stands beside recall, never alone.

use std::path::{Path, PathBuf};

use maud::html;
use serde::Serialize;
use serde_json::Value;

use super::html::{axis, document, figure_of};
use super::plots::{Line, Words, lines};
use super::ranking::{Level, ranks};
use super::score_file::{self, at};
use super::table::number;
use super::{SCORE, rows, save};
use crate::dataset::folder::Partial;
use crate::error::{Error, Result};
use crate::evaluate::statistics::Interval;

/// A line of the leaderboard.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
#[allow(missing_docs)]
pub struct Entry {
    /// Among those of its kind.
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
    pub rms_v_inliers_px: Option<f64>,
    pub kind: Kind,
    /// What it is ranked by, one after the other.
    #[serde(skip)]
    levels: Vec<Level>,
}

/// What was scored.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Kind {
    /// Particles.
    #[default]
    Particles,
    /// A displacement field.
    Field,
}

impl Entry {
    fn of(name: String, score: &Value) -> Self {
        let get = |key: &str| at(score, key).as_f64();
        let interval = |key: &str| -> Interval {
            let ends = at(score, key);
            ends[0].as_f64().zip(ends[1].as_f64()).map(|(low, high)| [low, high])
        };
        let rate = |key: &str, of: &str| Level::rate(get(key), interval(of));
        let error = |key: &str, of: &str| Level::error(get(key), interval(of));
        let kind = if score["detection"].is_object() { Kind::Particles } else { Kind::Field };
        let (levels, ends) = match kind {
            Kind::Particles => (
                vec![
                    rate("detection.f1", "detection.interval.f1"),
                    error("detection.rmse_xy_px", "detection.interval.rmse_xy_px"),
                    error("gdpt.sigma_z_over_h", "gdpt.interval.sigma_z_over_h"),
                    rate("links.f1", "links.interval_f1"),
                    rate("hota.hota", "hota.interval_hota"),
                ],
                interval("detection.interval.f1"),
            ),
            Kind::Field => {
                let both = get("field.u_inliers.rms_px").zip(get("field.v_inliers.rms_px"));
                // At least as wide as that of the sum.
                let ends = interval("field.interval_rms_u_inliers_px")
                    .zip(interval("field.interval_rms_v_inliers_px"))
                    .map(|(u, v)| [u[0].hypot(v[0]), u[1].hypot(v[1])]);
                (
                    vec![
                        rate("field.valid_vector_probability", "field.interval_valid_vector_probability"),
                        Level::error(both.map(|(u, v)| u.hypot(v)), ends),
                        error("field.aee_px", "field.interval_aee_px"),
                    ],
                    interval("field.interval_valid_vector_probability"),
                )
            }
        };
        Entry {
            rank: 0,
            name,
            dataset: score["dataset"].as_str().unwrap_or_default().to_owned(),
            f1: get("detection.f1"),
            low: ends.map(|e| e[0]),
            high: ends.map(|e| e[1]),
            recall: get("detection.recall"),
            precision: get("detection.precision"),
            rmse_xy_px: get("detection.rmse_xy_px"),
            sigma_z_over_h: get("gdpt.sigma_z_over_h"),
            link_f1: get("links.f1"),
            hota: get("hota.hota"),
            alpha: get("isbi.alpha"),
            beta: get("isbi.beta"),
            jsc: get("isbi.jsc"),
            jsc_theta: get("isbi.jsc_theta"),
            valid_vector_probability: get("field.valid_vector_probability"),
            aee_px: get("field.aee_px"),
            rms_u_inliers_px: get("field.u_inliers.rms_px"),
            rms_v_inliers_px: get("field.v_inliers.rms_px"),
            kind,
            levels,
        }
    }
}

/// What was compared.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Compared {
    /// The leaderboard, best first: particles, then fields.
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
        match score_file::read(path) {
            Ok(score) => scores.push((Entry::of(name(path), &score), score)),
            Err(e) => problems.extend(e.to_string().lines().map(str::to_owned)),
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
    let scores = ranked(scores);
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

/// Folders are named after trackers more often than files are.
fn name(path: &Path) -> String {
    let file = if path.is_dir() { path.join(SCORE) } else { path.to_owned() };
    let folder = file.parent().and_then(Path::file_name).map(|n| n.to_string_lossy().into_owned());
    folder.filter(|_| file.ends_with(SCORE)).unwrap_or_else(|| file.display().to_string())
}

/// The scores of each kind in their order, with their ranks.
fn ranked(mut scores: Vec<(Entry, Value)>) -> Vec<(Entry, Value)> {
    scores.sort_by(|a, b| a.0.kind.cmp(&b.0.kind).then_with(|| a.0.name.cmp(&b.0.name)));
    let mut ranked = Vec::with_capacity(scores.len());
    for same in scores.chunk_by(|a, b| a.0.kind == b.0.kind) {
        let levels: Vec<Vec<Level>> = same.iter().map(|s| s.0.levels.clone()).collect();
        ranked.extend(ranks(&levels).into_iter().map(|(i, rank)| {
            let (entry, score) = &same[i];
            (Entry { rank, ..entry.clone() }, score.clone())
        }));
    }
    ranked
}

/// What makes scores incomparable.
fn differences(scores: &[(Entry, Value)]) -> Vec<String> {
    let mut warnings = Vec::new();
    let differ =
        |scores: &[(Entry, Value)], key: &str| scores.iter().any(|s| at(&s.1, key) != at(&scores[0].1, key));
    // The truth itself tells datasets apart that have one name; scores of old have only that.
    let hashed = scores.iter().all(|s| at(&s.1, "definitions.truth_sha256").is_string());
    if differ(scores, if hashed { "definitions.truth_sha256" } else { "dataset" }) {
        let mut names: Vec<&str> = scores.iter().map(|s| s.0.dataset.as_str()).collect();
        names.sort_unstable();
        names.dedup();
        let what = match names[..] {
            [one] => format!("of different datasets, all named {one} (other seeds or other particles)"),
            _ => format!("of different datasets ({})", names.join(", ")),
        };
        warnings.push(format!("the scores are {what}: their order means little"));
    }
    for same in scores.chunk_by(|a, b| a.0.kind == b.0.kind) {
        for (what, key) in [
            ("gates", "definitions.gate"),
            ("gates of ISBI", "definitions.isbi_gate_px"),
            ("numbers of dimensions", "definitions.dims"),
            ("borders", "definitions.border_px"),
            ("planes", "field.plane_um"),
            ("true fields", "field.against"),
        ] {
            if differ(same, key) {
                warnings.push(format!("the scores are of different {what}: their order means little"));
            }
        }
    }
    warnings
}

/// The leaderboard in 80 columns.
fn text(entries: &[Entry], warnings: &[String]) -> String {
    let n = number;
    let tied = |e: &Entry| entries.iter().filter(|o| (o.kind, o.rank) == (e.kind, e.rank)).count() > 1;
    let rank = |e: &Entry| format!("{}{}", e.rank, if tied(e) { "=" } else { "" });
    let name = |e: &Entry| {
        let name: String = e.name.chars().take(14).collect();
        if name.len() < e.name.len() { name + "~" } else { name }
    };
    let mut lines = Vec::new();
    let of = |kind: Kind| entries.iter().filter(move |e| e.kind == kind);
    if of(Kind::Particles).count() > 0 {
        lines.push(format!(
            "{:<4} {:<15} {:>6}  {:<16} {:>6} {:>6} {:>6} {:>6} {:>6}",
            "rank", "name", "F1", "95 %", "recall", "xy px", "z / h", "links", "HOTA"
        ));
        let short = |v: Option<f64>| v.map_or("-".to_owned(), |v| format!("{v:.4}"));
        lines.extend(of(Kind::Particles).map(|e| {
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
    if of(Kind::Field).count() > 0 {
        lines.push(format!(
            "{:<4} {:<15} {:>8}  {:<16} {:>9} {:>8}",
            "rank", "name", "valid", "95 %", "RMS in px", "AEE px"
        ));
        lines.extend(of(Kind::Field).map(|e| {
            format!(
                "{:<4} {:<15} {:>8}  {:<16} {:>9} {:>8}",
                rank(e),
                name(e),
                n(e.valid_vector_probability),
                e.low.zip(e.high).map_or("-".to_owned(), |(l, h)| format!("[{l:.4}, {h:.4}]")),
                n(e.rms_u_inliers_px.zip(e.rms_v_inliers_px).map(|(u, v)| u.hypot(v))),
                n(e.aee_px)
            )
        }));
    }
    lines.push(
        "=: no 95 % interval tells them apart (F1, errors, links, HOTA; fields: valid, RMS, AEE).".to_owned(),
    );
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
    let columns: [(&str, Column); 17] = [
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
        ("RMS v of inliers, px", |e| e.rms_v_inliers_px),
        ("link F1", |e| e.link_f1),
        ("HOTA", |e| e.hota),
        ("alpha", |e| e.alpha),
        ("beta", |e| e.beta),
        ("JSC", |e| e.jsc),
        ("JSC_theta", |e| e.jsc_theta),
    ];
    let body = html! {
        h1 { "Leaderboard" }
        p.soft { "Particles are ranked by F1 of detection, then by errors in the image plane and in depth, F1 of links, HOTA; \
            fields by the probability of a valid vector, then RMS error of inliers, AEE. What the 95 % intervals of one do not \
            tell apart the next one may; equal ranks are told apart by none. Errors count found particles only, so read them \
            beside recall." }
        @for warning in warnings { p.warning { (warning) } }
        @for same in scores.chunk_by(|a, b| a.0.kind == b.0.kind) {
            h2 { (match same[0].0.kind { Kind::Particles => "Particles", Kind::Field => "Fields" }) }
            // Fields and particles have other scores.
            @let columns: Vec<_> = columns.iter().filter(|(_, value)| same.iter().any(|(e, _)| value(e).is_some())).collect();
            div.scroll { table.board {
                tr { th { "rank" } th { "name" } @for (name, _) in &columns { th { (name) } } }
                @for (e, _) in same { tr {
                    td { (e.rank) } td { (e.name) } @for (_, value) in &columns { td { (n(value(e))) } }
                } }
            } }
        }
        @if !plots.is_empty() { h2 { "Curves" } div.plots { @for plot in &plots { (plot) } } }
    };
    Ok(document("Leaderboard", &body))
}
