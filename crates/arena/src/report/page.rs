//! Self-contained HTML report: scores, plots and assumptions, without scripts or network access.

use maud::{DOCTYPE, Markup, PreEscaped, html};

use super::table::{number, signed, table};
use super::{field_plots, particle_plots, plane_plots};
use scoring::evaluate::{Evaluation, Score};
use storage::error::Result;

const STYLE: &str = "
:root { color-scheme: light dark; --ink: #1b1f24; --paper: #ffffff; --soft: #57606a; --grid: #d8dee4;
  --c0: #0072b2; --c1: #c84e00; --c2: #1f1f1f; --c3: #00805e; --c4: #a3559a; --c5: #9a6700; }
@media (prefers-color-scheme: dark) { :root { --ink: #e6edf3; --paper: #0d1117; --soft: #9da7b3; --grid: #30363d;
  --c0: #6cb6ff; --c1: #ff8b73; --c2: #56d364; --c3: #c297ff; --c4: #e3b341; --c5: #56d4dd; } }
@media print { :root { --ink: #000; --paper: #fff; --soft: #444; --grid: #ccc;
  --c0: #0072b2; --c1: #c84e00; --c2: #1f1f1f; --c3: #00805e; --c4: #a3559a; --c5: #9a6700; } }
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
.windows td, .windows th { padding: .1rem; border: 0; text-align: center; font-size: .8rem; }
.windows img { display: block; width: 5.6rem; image-rendering: pixelated; }
pre { overflow-x: auto; font-size: .82rem; border: 1px solid var(--grid); border-radius: .4rem; padding: .8rem; }
.warning { border-left: .3rem solid var(--c1); padding: .3rem .8rem; margin: .6rem 0; }
";

/// An HTML document with this title and body.
pub(crate) fn document(title: &str, body: &Markup) -> String {
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

/// The report of an evaluation. `with_true_positions`: including plots that show true positions.
pub(super) fn page(evaluation: &Evaluation, with_true_positions: bool) -> Result<String> {
    let score = &evaluation.score;
    let mut plots = Vec::new();
    if let Some(particles) = &evaluation.particles {
        plots = particle_plots::plots(score, particles, with_true_positions)?;
    }
    if !evaluation.vectors.is_empty() {
        plots.extend(field_plots::plots(evaluation, with_true_positions)?);
    }
    plots.extend(plane_plots::plots(score, &evaluation.plane_points, evaluation.sensor_px)?);
    let body = html! {
        h1 { (score.result) " against " (score.dataset) }
        p.soft { (summary(score)) }
        @for warning in score.caveats() { p.warning { (warning) } }
        @for what in &score.unknown { p.warning { "Not known: " (what) } }
        div.key { @for (name, value) in key_numbers(score) { div { (name) b { (value) } } } }
        @if !plots.is_empty() { h2 { "Strengths and weaknesses of the result" } div.plots { @for plot in &plots { (plot) } } }
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
            score.counts.n_truth, score.counts.n_result, score.counts.frames, gate
        ),
        (None, Some(f)) => {
            format!("{} of {} vectors valid, against the {} field", f.n_reported, f.n_total, f.against)
        }
        (None, None) => score.planes.as_ref().map_or_else(String::new, |planes| {
            format!("{} points in {} frames whose plane is known", planes.n, planes.frames)
        }),
    }
}

/// The main scores; errors are always shown together with recall.
fn key_numbers(score: &Score) -> Vec<(&'static str, String)> {
    let n = number;
    let mut numbers = Vec::new();
    if let Some(d) = &score.detection {
        numbers.push(("recall", n(d.recall)));
        numbers.push(("precision", n(d.precision)));
        numbers.push(("RMSE xy, px", n(d.rmse_xy_px)));
        numbers.push(("bias x, y, px", format!("{}, {}", signed(d.bias_x_px), signed(d.bias_y_px))));
    }
    if let Some(p) = &score.planes {
        numbers.push(("points near their plane", n(p.share_within)));
        numbers.push(("RMSE z, um", n(p.rmse_z_um)));
        numbers.push(("bias z, um", signed(p.bias_z_um)));
    }
    numbers.extend(score.gdpt.as_ref().map(|g| ("sigma z / h", n(g.sigma_z_over_h))));
    numbers.extend(score.links.as_ref().map(|l| ("link F1", n(l.f1))));
    numbers.extend(score.hota.as_ref().map(|h| ("HOTA", n(h.hota))));
    numbers
        .extend(score.isbi.as_ref().map(|i| ("ISBI alpha, beta", format!("{}, {}", n(i.alpha), n(i.beta)))));
    if let Some(f) = &score.field {
        numbers.push(("valid nodes", n(f.nodes.valid)));
        numbers.push(("valid vectors", n(f.main.valid_vector_probability)));
        numbers.push(("AEE, px", n(f.main.aee_px)));
        numbers.push(("RMS u of inliers, px", n(f.main.u_inliers.rms_px)));
        numbers
            .push(("bias u, v, px", format!("{}, {}", signed(f.main.u.bias_px), signed(f.main.v.bias_px))));
    }
    numbers
}
