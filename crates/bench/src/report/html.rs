//! One self-contained page: scores, plots, what was assumed. No script, no network.

use maud::{DOCTYPE, Markup, PreEscaped, html};

use super::fields;
use super::plots::{Line, Marks, Words, bars, classes, lines, sensor};
use super::table::{number, signed, table};
use crate::error::Result;
use crate::evaluate::crlb::{BoundBin, Crlb};
use crate::evaluate::curves::{Bin, Curve};
use crate::evaluate::detection::{error, per_frame};
use crate::evaluate::lpt::LENGTHS;
use crate::evaluate::matching::NONE;
use crate::evaluate::statistics::{Errors, quantile};
use crate::evaluate::uncertainty::Uncertainty;
use crate::evaluate::{Evaluation, Particles, Score};

const STYLE: &str = "
:root { color-scheme: light dark; --ink: #1b1f24; --paper: #ffffff; --soft: #57606a; --grid: #d8dee4;
  --c0: #0b62b8; --c1: #c4432b; --c2: #157f3b; --c3: #8250df; --c4: #9a6700; --c5: #0b7f84; }
@media (prefers-color-scheme: dark) { :root { --ink: #e6edf3; --paper: #0d1117; --soft: #9da7b3; --grid: #30363d;
  --c0: #6cb6ff; --c1: #ff8b73; --c2: #56d364; --c3: #c297ff; --c4: #e3b341; --c5: #56d4dd; } }
@media print { :root { --ink: #000; --paper: #fff; --soft: #444; --grid: #ccc;
  --c0: #0b62b8; --c1: #c4432b; --c2: #157f3b; --c3: #8250df; --c4: #9a6700; --c5: #0b7f84; } }
* { box-sizing: border-box; }
@page { margin: 14mm; }
@media print { body { padding: 0; max-width: none; font-size: 11px; } .plots { gap: .6rem; }
  .plots { grid-template-columns: 1fr 1fr !important; } .key { grid-template-columns: repeat(4, 1fr) !important; }
  pre { break-inside: avoid; white-space: pre-wrap; } h2 { break-after: avoid; } }
body { margin: 0 auto; padding: 1.5rem; max-width: 78rem; color: var(--ink); background: var(--paper);
  font: 16px/1.5 system-ui, sans-serif; }
h1 { font-size: 1.6rem; margin: 0 0 .3rem; } h2 { font-size: 1.15rem; margin: 2rem 0 .6rem; }
p, li { max-width: 60rem; } .soft { color: var(--soft); }
.key { display: grid; grid-template-columns: repeat(auto-fit, minmax(11rem, 1fr)); gap: .8rem; margin: 1rem 0; }
.key div { border: 1px solid var(--grid); border-radius: .4rem; padding: .6rem .8rem; }
.key b { display: block; font-size: 1.35rem; font-variant-numeric: tabular-nums; }
.plots { display: grid; grid-template-columns: repeat(auto-fit, minmax(min(100%, 28rem), 1fr)); gap: 1.2rem; }
figure { margin: 0; break-inside: avoid; } figcaption { font-size: .9rem; color: var(--soft); }
.name { display: inline-block; margin-right: 1rem; }
svg { width: 100%; height: auto; color: var(--ink); }
table { border-collapse: collapse; font-variant-numeric: tabular-nums; } .scroll { overflow-x: auto; }
th, td { padding: .25rem .8rem; text-align: right; border-bottom: 1px solid var(--grid); }
th:first-child, td:first-child { text-align: left; white-space: nowrap; }
.board { font-size: .9rem; } .board th, .board td { padding: .25rem .4rem; } .board td { white-space: nowrap; }
.board th:nth-child(2), .board td:nth-child(2) { text-align: left; }
@media print { .scroll { overflow: visible; } .board { font-size: 10px; } .board th, .board td { padding: .2rem .3rem; } }
pre { overflow-x: auto; font-size: .82rem; border: 1px solid var(--grid); border-radius: .4rem; padding: .8rem; }
.warning { border-left: .3rem solid var(--c1); padding: .3rem .8rem; margin: .6rem 0; }
";

/// A page with this title and body.
pub(super) fn document(title: &str, body: &Markup) -> String {
    html! {
        (DOCTYPE)
        html lang="en" {
            head {
                meta charset="utf-8";
                meta name="viewport" content="width=device-width, initial-scale=1";
                title { (title) }
                style { (PreEscaped(STYLE)) }
            }
            body { (body) }
        }
    }
    .into_string()
}

/// A plot with its caption.
pub(super) fn figure(svg: String, caption: &str) -> Markup {
    figure_of(svg, &[], caption)
}

/// A plot of several series, with their names in their colours above the caption.
pub(super) fn figure_of(svg: String, names: &[&str], caption: &str) -> Markup {
    html! {
        figure {
            (PreEscaped(svg))
            figcaption {
                @for (i, name) in names.iter().enumerate() {
                    span.name style=(format!("color: var(--c{})", i % 6)) { "\u{25cf} " (name) }
                }
                @if !names.is_empty() { br; }
                (caption)
            }
        }
    }
}

fn names(series: &[Line]) -> Vec<&str> {
    series.iter().map(|l| l.name.as_str()).collect()
}

/// The report of an evaluation.
///
/// # Errors
/// A plot that cannot be drawn.
pub(super) fn page(evaluation: &Evaluation) -> Result<String> {
    let score = &evaluation.score;
    let mut plots = Vec::new();
    if let Some(particles) = &evaluation.particles {
        plots = particle_plots(score, particles)?;
    }
    if !evaluation.vectors.is_empty() {
        plots.extend(fields::plots(evaluation)?);
    }
    let body = html! {
        h1 { (score.result) " against " (score.dataset) }
        p.soft { (summary(score)) }
        @for warning in &score.warnings { p.warning { (warning) } }
        div.key { @for (name, value) in key_numbers(score) { div { (name) b { (value) } } } }
        @if !plots.is_empty() { h2 { "Where it is good, where it fails" } div.plots { @for plot in &plots { (plot) } } }
        h2 { "All scores" }
        pre { (table(score)) }
        @if !score.gates.is_empty() {
            h2 { "Other gates" }
            div.scroll { table {
                tr { th { "gate" } th { "precision" } th { "recall" } th { "F1" } th { "RMSE xy, px" } th { "RMSE z, um" } }
                @for g in &score.gates { tr {
                    td { (g.gate) } td { (number(g.precision)) } td { (number(g.recall)) } td { (number(g.f1)) }
                    td { (number(g.rmse_xy_px)) } td { (number(g.rmse_z_um)) }
                } }
            } }
        }
        p.soft { "Definitions: docs/scoring.md of microsig " (score.definitions.versions.microsig)
            ". Intervals in brackets: 95 %, bootstrap." }
    };
    Ok(document(&format!("{} against {}", score.result, score.dataset), &body))
}

fn summary(score: &Score) -> String {
    match (&score.definitions.gate, &score.field) {
        (Some(gate), _) => format!(
            "{} true and {} found particles in {} frames; gate {}",
            score.counts.n_truth,
            score.counts.n_result,
            score.counts.frames,
            crate::evaluate::words(gate)
        ),
        (None, Some(f)) => {
            format!("{} of {} vectors valid, against the {} field", f.n_reported, f.n_total, f.against)
        }
        (None, None) => String::new(),
    }
}

/// The numbers that rank, never one without its partner.
fn key_numbers(score: &Score) -> Vec<(&'static str, String)> {
    let n = number;
    let mut numbers = Vec::new();
    if let Some(d) = &score.detection {
        numbers.push(("recall", n(d.recall)));
        numbers.push(("precision", n(d.precision)));
        numbers.push(("RMSE xy, px", n(d.rmse_xy_px)));
        numbers.push(("bias x, y, px", format!("{}, {}", signed(d.bias_x_px), signed(d.bias_y_px))));
    }
    numbers.extend(score.gdpt.as_ref().map(|g| ("sigma z / h", n(g.sigma_z_over_h))));
    numbers.extend(score.links.as_ref().map(|l| ("link F1", n(l.f1))));
    numbers.extend(score.hota.as_ref().map(|h| ("HOTA", n(h.hota))));
    numbers
        .extend(score.isbi.as_ref().map(|i| ("ISBI alpha, beta", format!("{}, {}", n(i.alpha), n(i.beta)))));
    if let Some(f) = &score.field {
        numbers.push(("valid vectors", n(f.main.valid_vector_probability)));
        numbers.push(("AEE, px", n(f.main.aee_px)));
        numbers.push(("RMS u of inliers, px", n(f.main.u_inliers.rms_px)));
        numbers
            .push(("bias u, v, px", format!("{}, {}", signed(f.main.u.bias_px), signed(f.main.v.bias_px))));
    }
    numbers
}

/// A line of a curve: the middle of every bin that has an end.
fn line(name: &str, curve: &Curve, value: impl Fn(&Bin) -> Option<f64>) -> Line {
    let points = curve
        .bins
        .iter()
        .filter(|b| b.to.is_finite())
        .map(|b| (f64::midpoint(b.from, b.to), value(b).unwrap_or(f64::NAN)))
        .collect();
    Line { name: name.to_owned(), points }
}

/// What a curve is drawn against, in words.
pub(super) fn axis(against: &str) -> &str {
    match against {
        "z_um" => "depth z, um",
        "neighbour_px" => "distance to the nearest neighbour, px",
        "snr" => "signal over noise",
        "overlap" => "overlap",
        other => other,
    }
}

fn particle_plots(score: &Score, of: &Particles) -> Result<Vec<Markup>> {
    let mut plots = Vec::new();
    for curve in &score.curves {
        let x = axis(&curve.against);
        let words = Words { x, y: "recall", title: "Recall" };
        let recall = lines(&words, &[line("recall", curve, |b| b.recall)])?;
        plots.push(figure(recall, &format!("Share of particles found, against {x}.")));
        let bound = score.crlb.as_ref().filter(|_| curve.against == "z_um");
        let bound = |name: &str, value: fn(&BoundBin) -> Option<f64>| {
            let points = |b: &Crlb| b.bins.iter().map(|b| (b.z_um, value(b).unwrap_or(f64::NAN))).collect();
            bound.map(|b| Line { name: name.to_owned(), points: points(b) })
        };
        let words = Words { x, y: "error, px", title: "Error in the image plane" };
        let mut series = vec![
            line("RMS x", curve, |b| b.rms_x_px),
            line("RMS y", curve, |b| b.rms_y_px),
            line("bias x", curve, |b| b.bias_x_px),
            line("bias y", curve, |b| b.bias_y_px),
        ];
        series.extend(bound("Cramer-Rao bound x", |b| b.crlb_x_px));
        series.extend(bound("Cramer-Rao bound y", |b| b.crlb_y_px));
        let caption = format!("RMS error and bias in the image plane, against {x}.");
        plots.push(figure_of(lines(&words, &series)?, &names(&series), &caption));
        if of.depth {
            let words = Words { x, y: "error, um", title: "Error in depth" };
            let mut series =
                vec![line("RMS z", curve, |b| b.rms_z_um), line("bias z", curve, |b| b.bias_z_um)];
            series.extend(bound("Cramer-Rao bound", |b| b.crlb_z_um));
            let caption = format!("RMS error and bias in depth, against {x}.");
            plots.push(figure_of(lines(&words, &series)?, &names(&series), &caption));
        }
    }
    plots.extend(histograms(of)?);
    let claims = score.uncertainty.iter().flat_map(|c| [("x, px", &c.x), ("y, px", &c.y), ("z, um", &c.z)]);
    for (axis, of) in claims {
        plots.extend(of.as_ref().map(|u| claimed(axis, u)).transpose()?);
    }
    if let Some(lpt) = &score.lpt {
        let words = Words { x: "points of a track", y: "tracks", title: "Lengths of tracks" };
        let svg = classes(&words, &LENGTHS, [&lpt.true_lengths, &lpt.lengths])?;
        plots.push(figure_of(svg, &["truth", "result"], "Lengths of true and of found tracks."));
    }
    plots.extend(sensor_plots(of)?);
    Ok(plots)
}

/// Errors of similar claims against the claim.
pub(super) fn claimed(axis: &str, of: &Uncertainty) -> Result<Markup> {
    let found = of.bins.iter().map(|b| (b.claimed_rms, b.error_rms)).collect();
    let most = of.bins.iter().map(|b| b.claimed_rms).fold(0.0, f64::max);
    let (x, y) = (format!("claimed uncertainty of {axis}"), format!("RMS error of {axis}"));
    let series = [
        Line { name: "result".to_owned(), points: found },
        Line { name: "an honest claim".to_owned(), points: vec![(0.0, 0.0), (most, most)] },
    ];
    let svg = lines(&Words { x: &x, y: &y, title: "Claimed and actual errors" }, &series)?;
    Ok(figure_of(
        svg,
        &names(&series),
        &format!("{y} against its {x}, in tenths of the particles or vectors."),
    ))
}

fn histograms(of: &Particles) -> Result<Vec<Markup>> {
    let (t, r) = (&of.scored.truth, &of.scored.result);
    let errors: Vec<[f64; 3]> = of.matching.pairs().map(|p| error(t, r, p)).collect();
    let mut plots = Vec::new();
    for (k, axis) in ["x, px", "y, px", "z, um"].iter().enumerate().take(if of.depth { 3 } else { 2 }) {
        plots.extend(histogram(&format!("error in {axis}"), "particles", errors.iter().map(|e| e[k]))?);
    }
    Ok(plots)
}

/// The distribution of errors, without the rarest, symmetric so that a bias is seen. `None` if all are 0.
pub(super) fn histogram(x: &str, y: &str, errors: impl Iterator<Item = f64>) -> Result<Option<Markup>> {
    const BINS: usize = 40;
    let mut values: Vec<f64> = errors.collect();
    values.sort_unstable_by(f64::total_cmp);
    let ends = quantile(&values, 0.005).zip(quantile(&values, 0.995));
    let Some(reach) = ends.map(|(a, b)| a.abs().max(b.abs())).filter(|reach| *reach > 0.0) else {
        return Ok(None);
    };
    let mut counts = vec![0.0; BINS];
    for v in &values {
        let at = (v + reach) / (2.0 * reach) * BINS as f64;
        if (0.0..BINS as f64).contains(&at) {
            counts[at as usize] += 1.0;
        }
    }
    let edge = |i: usize| -reach + 2.0 * reach * i as f64 / BINS as f64;
    let drawn: Vec<_> = counts.iter().enumerate().map(|(i, &n)| (edge(i), edge(i + 1), n)).collect();
    let svg = bars(&Words { x, y, title: x }, &drawn)?;
    Ok(Some(figure(svg, &format!("Distribution of the {x} (99 % of it)."))))
}

/// RMS of errors over the sensor; `errors` are places and sizes. `None` if there are none.
pub(super) fn error_map(
    (width, height): (f64, f64),
    errors: impl Iterator<Item = ((f64, f64), f64)>,
) -> Result<Option<Markup>> {
    const COLUMNS: usize = 12;
    let side = width / COLUMNS as f64;
    let rows = ((height / side).ceil() as usize).clamp(1, 40);
    let tall = height / rows as f64;
    let mut cells: Vec<Vec<f64>> = vec![Vec::new(); COLUMNS * rows];
    for ((x, y), size) in errors {
        let column = (((x - 0.5) / side).max(0.0) as usize).min(COLUMNS - 1);
        let row = (((y - 0.5) / tall).max(0.0) as usize).min(rows - 1);
        cells[row * COLUMNS + column].push(size);
    }
    let values: Vec<Option<f64>> = cells.iter().map(|c| Errors::of(c.iter().copied()).rms).collect();
    let most = values.iter().flatten().copied().fold(0.0, f64::max);
    if most <= 0.0 {
        return Ok(None);
    }
    let corner = |column: usize, row: usize| (0.5 + column as f64 * side, 0.5 + row as f64 * tall);
    let shaded = values.iter().enumerate().filter_map(|(i, v)| {
        let (row, column) = (i / COLUMNS, i % COLUMNS);
        Some(([corner(column, row), corner(column + 1, row + 1)], (*v)? / most))
    });
    let words = Words { x: "x, px", y: "y, px", title: "Error over the sensor" };
    let svg = sensor(&words, (width, height), &Marks::Cells(shaded.collect()))?;
    let caption = format!("RMS error in the image plane over the sensor; full shade is {most:.3} px.");
    Ok(Some(figure(svg, &caption)))
}

/// The error over the sensor, and the frames with most and fewest mistakes.
fn sensor_plots(of: &Particles) -> Result<Vec<Markup>> {
    let (t, r) = (&of.scored.truth, &of.scored.result);
    let extent = |value: fn(&crate::evaluate::cloud::Point) -> f64| {
        t.points.iter().chain(&r.points).map(value).fold(1.0f64, f64::max).ceil()
    };
    let (width, height) = of.sensor_px.unwrap_or_else(|| (extent(|p| p.at.x_px), extent(|p| p.at.y_px)));
    let mut plots = Vec::new();

    let errors = of.matching.pairs().map(|pair| {
        let ([dx, dy, _], at) = (error(t, r, pair), &t.points[pair.0].at);
        ((at.x_px, at.y_px), (dx * dx + dy * dy).sqrt())
    });
    plots.extend(error_map((width, height), errors)?);

    let frames = per_frame(t, r, &of.matching);
    let mistakes = |f: &&crate::evaluate::detection::FrameCounts| f.counts[1] + f.counts[2];
    let shown = [
        (frames.first(), "The first frame"),
        (frames.iter().rev().max_by_key(mistakes), "The frame with most mistakes"),
        (frames.iter().min_by_key(mistakes), "The frame with fewest mistakes"),
    ];
    let mut done = Vec::new();
    for (frame, why) in shown {
        let Some(frame) = frame.filter(|f| !done.contains(&f.frame)) else { continue };
        done.push(frame.frame);
        let place = |p: &crate::evaluate::cloud::Point| (p.at.x_px, p.at.y_px);
        let of_frame = |cloud: &'_ crate::evaluate::cloud::Cloud| {
            cloud.frames.iter().find(|f| f.0 == frame.frame).map_or(0..0, |f| f.1.clone())
        };
        let (mut found, mut missed) = (Vec::new(), Vec::new());
        for i in of_frame(t) {
            let list = if of.matching.of_truth[i] == NONE { &mut missed } else { &mut found };
            list.push(place(&t.points[i]));
        }
        let ghosts =
            of_frame(r).filter(|&j| of.matching.of_result[j] == NONE).map(|j| place(&r.points[j])).collect();
        let [hits, misses, extra] = frame.counts;
        let caption = format!("{why} ({}).", frame.frame);
        let names =
            [hits, misses, extra].into_iter().zip(["found (rings)", "missed (dots)", "ghosts (crosses)"]);
        let names: Vec<String> = names.map(|(n, what)| format!("{n} {what}")).collect();
        let words = Words { x: "x, px", y: "y, px", title: why };
        let svg = sensor(&words, (width, height), &Marks::Places { found, missed, ghosts })?;
        plots.push(figure_of(svg, &names.iter().map(String::as_str).collect::<Vec<_>>(), &caption));
    }
    Ok(plots)
}
