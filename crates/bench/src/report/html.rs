//! One self-contained page: scores, plots, what was assumed. No script, no network.

use maud::{DOCTYPE, Markup, PreEscaped, html};

use super::plots::{Line, Marks, Words, bars, classes, lines, sensor};
use super::table::{number, table};
use crate::error::Result;
use crate::evaluate::curves::{Bin, Curve};
use crate::evaluate::detection::{error, per_frame};
use crate::evaluate::lpt::LENGTHS;
use crate::evaluate::matching::NONE;
use crate::evaluate::statistics::{Errors, quantile};
use crate::evaluate::{Evaluation, Particles, Score};

const STYLE: &str = "
:root { color-scheme: light dark; --ink: #1b1f24; --paper: #ffffff; --soft: #57606a; --grid: #d8dee4;
  --c0: #0b62b8; --c1: #c4432b; --c2: #157f3b; --c3: #8250df; --c4: #9a6700; --c5: #0b7f84; }
@media (prefers-color-scheme: dark) { :root { --ink: #e6edf3; --paper: #0d1117; --soft: #9da7b3; --grid: #30363d;
  --c0: #6cb6ff; --c1: #ff8b73; --c2: #56d364; --c3: #c297ff; --c4: #e3b341; --c5: #56d4dd; } }
@media print { :root { --ink: #000; --paper: #fff; --soft: #444; --grid: #ccc;
  --c0: #0b62b8; --c1: #c4432b; --c2: #157f3b; --c3: #8250df; --c4: #9a6700; --c5: #0b7f84; } }
* { box-sizing: border-box; }
body { margin: 0 auto; padding: 1.5rem; max-width: 78rem; color: var(--ink); background: var(--paper);
  font: 16px/1.5 system-ui, sans-serif; }
h1 { font-size: 1.6rem; margin: 0 0 .3rem; } h2 { font-size: 1.15rem; margin: 2rem 0 .6rem; }
p, li { max-width: 60rem; } .soft { color: var(--soft); }
.key { display: grid; grid-template-columns: repeat(auto-fit, minmax(11rem, 1fr)); gap: .8rem; margin: 1rem 0; }
.key div { border: 1px solid var(--grid); border-radius: .4rem; padding: .6rem .8rem; }
.key b { display: block; font-size: 1.35rem; font-variant-numeric: tabular-nums; }
.plots { display: grid; grid-template-columns: repeat(auto-fit, minmax(min(100%, 28rem), 1fr)); gap: 1.2rem; }
figure { margin: 0; break-inside: avoid; } figcaption { font-size: .9rem; color: var(--soft); }
.name { margin-right: 1rem; white-space: nowrap; }
svg { width: 100%; height: auto; color: var(--ink); }
table { border-collapse: collapse; font-variant-numeric: tabular-nums; } .scroll { overflow-x: auto; }
th, td { padding: .25rem .8rem; text-align: right; border-bottom: 1px solid var(--grid); }
th:first-child, td:first-child { text-align: left; }
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
        plots.extend(field_plots(evaluation)?);
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
            ". Intervals in brackets: 95 %, bootstrap over frames." }
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
        numbers.push(("bias x, y, px", format!("{}, {}", n(d.bias_x_px), n(d.bias_y_px))));
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
        numbers.push(("bias u, px", n(f.main.u.bias_px)));
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

fn particle_plots(score: &Score, of: &Particles) -> Result<Vec<Markup>> {
    let mut plots = Vec::new();
    for curve in &score.curves {
        let x = match curve.against.as_str() {
            "z_um" => "depth z, um",
            "neighbour_px" => "distance to the nearest neighbour, px",
            "snr" => "signal over noise",
            "overlap" => "overlap",
            other => other,
        };
        let words = Words { x, y: "recall", title: "Recall" };
        let recall = lines(&words, &[line("recall", curve, |b| b.recall)])?;
        plots.push(figure(recall, &format!("Share of particles found, against {x}.")));
        let words = Words { x, y: "error, px", title: "Error in the image plane" };
        let series = [
            line("RMS x", curve, |b| b.rms_x_px),
            line("RMS y", curve, |b| b.rms_y_px),
            line("bias x", curve, |b| b.bias_x_px),
            line("bias y", curve, |b| b.bias_y_px),
        ];
        let caption = format!("RMS error and bias in the image plane, against {x}.");
        plots.push(figure_of(lines(&words, &series)?, &names(&series), &caption));
        if of.depth {
            let words = Words { x, y: "error, um", title: "Error in depth" };
            let mut series =
                vec![line("RMS z", curve, |b| b.rms_z_um), line("bias z", curve, |b| b.bias_z_um)];
            if let Some(bound) = score.crlb.as_ref().filter(|_| curve.against == "z_um") {
                let points = bound.bins.iter().map(|b| (b.z_um, b.crlb_z_um.unwrap_or(f64::NAN))).collect();
                series.push(Line { name: "Cramer-Rao bound".to_owned(), points });
            }
            let caption = format!("RMS error and bias in depth, against {x}.");
            plots.push(figure_of(lines(&words, &series)?, &names(&series), &caption));
        }
    }
    plots.extend(histograms(of)?);
    if let Some(lpt) = &score.lpt {
        let words = Words { x: "points of a track", y: "tracks", title: "Lengths of tracks" };
        let svg = classes(&words, &LENGTHS, [&lpt.true_lengths, &lpt.lengths])?;
        plots.push(figure_of(svg, &["truth", "result"], "Lengths of true and of found tracks."));
    }
    plots.extend(sensor_plots(of)?);
    Ok(plots)
}

fn histograms(of: &Particles) -> Result<Vec<Markup>> {
    const BINS: usize = 40;
    let (t, r) = (&of.scored.truth, &of.scored.result);
    let errors: Vec<[f64; 3]> = of.matching.pairs().map(|p| error(t, r, p)).collect();
    let mut plots = Vec::new();
    for (k, axis) in ["x, px", "y, px", "z, um"].iter().enumerate().take(if of.depth { 3 } else { 2 }) {
        let mut values: Vec<f64> = errors.iter().map(|e| e[k]).collect();
        values.sort_unstable_by(f64::total_cmp);
        // Ends without the rarest errors, symmetric so that a bias is seen.
        let ends = quantile(&values, 0.005).zip(quantile(&values, 0.995));
        let Some(reach) = ends.map(|(a, b)| a.abs().max(b.abs())).filter(|reach| *reach > 0.0) else {
            continue;
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
        let x = format!("error in {axis}");
        let words = Words { x: &x, y: "particles", title: &x };
        plots.push(figure(
            bars(&words, &drawn)?,
            &format!("Distribution of the error in {axis} (99 % of it)."),
        ));
    }
    Ok(plots)
}

/// The error over the sensor, and the frames with most and fewest mistakes.
fn sensor_plots(of: &Particles) -> Result<Vec<Markup>> {
    let (t, r) = (&of.scored.truth, &of.scored.result);
    let extent = |value: fn(&crate::evaluate::cloud::Point) -> f64| {
        t.points.iter().chain(&r.points).map(value).fold(1.0f64, f64::max).ceil()
    };
    let (width, height) = of.sensor_px.unwrap_or_else(|| (extent(|p| p.at.x_px), extent(|p| p.at.y_px)));
    let mut plots = Vec::new();

    const COLUMNS: usize = 12;
    let side = width / COLUMNS as f64;
    let rows = ((height / side).ceil() as usize).clamp(1, 40);
    let tall = height / rows as f64;
    let mut cells: Vec<Vec<f64>> = vec![Vec::new(); COLUMNS * rows];
    for pair in of.matching.pairs() {
        let at = &t.points[pair.0].at;
        let column = (((at.x_px - 0.5) / side).max(0.0) as usize).min(COLUMNS - 1);
        let row = (((at.y_px - 0.5) / tall).max(0.0) as usize).min(rows - 1);
        let [dx, dy, _] = error(t, r, pair);
        cells[row * COLUMNS + column].push((dx * dx + dy * dy).sqrt());
    }
    let values: Vec<Option<f64>> = cells.iter().map(|c| Errors::of(c.iter().copied()).rms).collect();
    let most = values.iter().flatten().copied().fold(0.0, f64::max);
    if most > 0.0 {
        let corner = |column: usize, row: usize| (0.5 + column as f64 * side, 0.5 + row as f64 * tall);
        let shaded = values.iter().enumerate().filter_map(|(i, v)| {
            let (row, column) = (i / COLUMNS, i % COLUMNS);
            Some(([corner(column, row), corner(column + 1, row + 1)], (*v)? / most))
        });
        let words = Words { x: "x, px", y: "y, px", title: "Error over the sensor" };
        let svg = sensor(&words, (width, height), &Marks::Cells(shaded.collect()))?;
        plots.push(figure(
            svg,
            &format!("RMS error in the image plane over the sensor; full shade is {most:.3} px."),
        ));
    }

    let frames = per_frame(t, r, &of.matching);
    let mistakes = |f: &&crate::evaluate::detection::FrameCounts| f.counts[1] + f.counts[2];
    let shown = [frames.first(), frames.iter().rev().max_by_key(mistakes)];
    let mut done = Vec::new();
    for (frame, why) in shown.into_iter().flatten().zip(["The first frame", "The frame with most mistakes"]) {
        if done.contains(&frame.frame) {
            continue;
        }
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

fn field_plots(evaluation: &Evaluation) -> Result<Vec<Markup>> {
    let Some(score) = &evaluation.score.field else { return Ok(Vec::new()) };
    let locking = &score.main.peak_locking;
    let tenths: Vec<_> = locking
        .histogram_u
        .iter()
        .enumerate()
        .map(|(i, &n)| (i as f64 / 10.0, (i + 1) as f64 / 10.0, n as f64))
        .collect();
    let words = Words { x: "fraction of u, px", y: "vectors", title: "Peak locking" };
    let mut plots = vec![figure(
        bars(&words, &tenths)?,
        "Fractions of the measured displacement u: even without peak locking.",
    )];
    let points = locking
        .bias_curve_px
        .iter()
        .enumerate()
        .map(|(i, b)| ((i as f64 + 0.5) / 20.0, b.unwrap_or(f64::NAN)))
        .collect();
    let words =
        Words { x: "fraction of the true u, px", y: "bias of u, px", title: "Bias over the fraction" };
    let curve = [Line { name: "bias".to_owned(), points }];
    plots.push(figure(lines(&words, &curve)?, "Bias of u against the fraction of the true displacement."));
    let extent = |k: fn(&crate::results::Position) -> f64| {
        evaluation.vectors.iter().map(|c| k(&c.found.at)).fold(1.0f64, f64::max)
    };
    let size = (extent(|p| p.x_px), extent(|p| p.y_px));
    let missed: Vec<_> = evaluation
        .vectors
        .iter()
        .filter(|c| c.found.flag == 0 && c.endpoint() >= score.main.outlier_threshold_px)
        .map(|c| (c.found.at.x_px, c.found.at.y_px))
        .take(5000)
        .collect();
    let words = Words { x: "x, px", y: "y, px", title: "Outliers" };
    let marks = Marks::Places { found: Vec::new(), missed, ghosts: Vec::new() };
    plots.push(figure(sensor(&words, size, &marks)?, "Places of outliers (off by 1 px and more)."));
    Ok(plots)
}
