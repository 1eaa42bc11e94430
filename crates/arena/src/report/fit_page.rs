//! The report of a fit of a microscope: fitted quantities, quality of the fit, next steps.

use maud::{Markup, html};

use super::figure::{figure_of, names};
use super::page::document;
use super::plots::{AxisLabels, Series, Style, lines};
use super::tiles::{self, SHOWN_SD};
use fit::{Evidence, Fitted, Parameter, Sample, Verdict};
use storage::error::Result;

/// Number of planes and of particles in the montage.
const COLUMNS: usize = 11;
const ROWS: usize = 3;

/// The first series of a plot is the data, the second the model.
const KINDS: [&str; 2] = ["data", "model"];

/// The report of a fit whose files are in the folder `out`.
pub fn fit_page(fitted: &Fitted, evidence: &Evidence, scan: &str, out: &str) -> Result<String> {
    let title = format!("Fit of {scan}");
    let plots = plots(fitted, evidence)?;
    let body = html! {
        h1 { (title) }
        p.soft { (fitted.particles.len()) " particles in " (fitted.planes.len()) " planes, windows of " (evidence.edge_px)
            " x " (evidence.edge_px) " px; microsig " (fitted.version) }
        p { b { (sentence(fitted)) } }
        @for warning in &fitted.warnings { p.warning { (warning) } }
        div.key { @for (name, value) in key_numbers(fitted) { div { (name) b { (value) } } } }
        h2 { "Data, model and residual over depth" }
        (montage(evidence)?)
        h2 { "Width, brightness and goodness of fit over depth" }
        div.plots { @for plot in &plots { (plot) } }
        h2 { "Parameters" }
        (parameters(fitted))
        (correlations(fitted))
        h2 { "Particles" }
        (particles(fitted))
        h2 { "What to do next" }
        (next(fitted, out))
    };
    Ok(document(&title, &body))
}

/// The conclusion with a capital letter and a period.
fn sentence(fitted: &Fitted) -> String {
    let mut text = fitted.sentence();
    text[..1].make_ascii_uppercase();
    text + "."
}

fn key_numbers(fitted: &Fitted) -> Vec<(&str, String)> {
    let mut numbers: Vec<(&str, String)> =
        fitted.parameters.iter().filter(|p| p.free).map(|p| (p.name.as_str(), with_error(p))).collect();
    numbers.push(("chi2 per pixel", format!("{:.3}", fitted.chi2)));
    numbers.push(("light explained", format!("{:.1} %", 100.0 * fitted.r2)));
    numbers
}

/// Value and standard deviation, to two digits of the latter.
fn with_error(p: &Parameter) -> String {
    let places = decimals(p.sd);
    let unit = if p.unit.is_empty() { String::new() } else { format!(" {}", p.unit) };
    format!("{:.places$} \u{b1} {:.places$}{unit}", p.value, p.sd)
}

/// Decimals that show two digits of a number.
pub(super) fn decimals(value: f64) -> usize {
    if value > 0.0 { (1.0 - value.log10().floor()).clamp(0.0, 9.0) as usize } else { 4 }
}

/// Rows of windows over depth for a few particles: data, model, residual.
fn montage(evidence: &Evidence) -> Result<Markup> {
    let particles = evidence.samples.iter().map(|s| s.particle + 1).max().unwrap_or(0);
    let mut rows = Vec::new();
    for k in 0..particles.min(ROWS) {
        let own: Vec<&Sample> = evidence.samples.iter().filter(|s| s.particle == k).collect();
        let columns = own.len().min(COLUMNS);
        let chosen: Vec<&Sample> =
            (0..columns).map(|c| own[c * (own.len() - 1) / (columns - 1).max(1)]).collect();
        rows.push((k, chosen));
    }
    Ok(html! {
        @for (k, samples) in &rows {
            div.scroll { table.windows {
                tr { th { "particle " (k + 1) } @for sample in samples { th { (format!("{:.1}", sample.z_um)) " um" } } }
                @for (name, of) in [("data", 0), ("model", 1), ("residual", 2)] {
                    tr { td { (name) } @for sample in samples { td { img alt=(name) src=(tile(evidence, sample, of)?); } } }
                }
                tr { td { "chi2" } @for sample in samples { td { (format!("{:.2}", sample.chi2)) @if sample.rejected { " rejected" } } } }
            } }
        }
        p.soft { "Depth in the model above each column. Data and model have the same gray scale in a column, from the background to the \
            brightest pixel. Residuals: blue and red are " (-SHOWN_SD) " and +" (SHOWN_SD) " standard deviations, white is zero; hatched \
            pixels belong to another particle." }
    })
}

/// One image of the montage, as a data URI.
fn tile(evidence: &Evidence, sample: &Sample, of: usize) -> Result<String> {
    let [data, model] = [&sample.data.counts, &sample.model.counts].map(Vec::as_slice);
    tiles::of(evidence.edge_px, [data, model, &sample.residual], of)
}

fn plots(fitted: &Fitted, evidence: &Evidence) -> Result<Vec<Markup>> {
    let mut plots = Vec::new();
    let axes: &[&str] =
        if evidence.astigmatic { &["along the axis", "across the axis"] } else { &["radius"] };
    for (axis, name) in axes.iter().enumerate() {
        let caption = format!(
            "Distance from the particle that contains half of its light ({name}), for all particles against their depth. The minimum is \
             the focal plane; the slopes on both sides determine NA, and their difference and the rounding between them determine f."
        );
        plots.push(over_depth(evidence, "half-light width, px", &caption, &|s, model| {
            if model { s.model.half_light_px[axis] } else { s.data.half_light_px[axis] }
        })?);
    }
    let scale: Vec<f64> = fitted.particles.iter().map(|p| p.light_counts.max(1e-9)).collect();
    let most = evidence.samples.iter().map(|s| s.model.peak / scale[s.particle]).fold(1e-12, f64::max);
    plots.push(over_depth(
        evidence,
        "peak, relative",
        "Mean of the pixels that are brightest in the model, relative to the brightest plane and to the particle's light.",
        &|s, model| (if model { s.model.peak } else { s.data.peak }) / scale[s.particle] / most,
    )?);
    let brightest = evidence.samples.iter().map(|s| s.model.light / scale[s.particle]).fold(1e-12, f64::max);
    plots.push(over_depth(
        evidence,
        "light, relative",
        "Light in the window, relative to the brightest plane and to the particle's light.",
        &|s, model| (if model { s.model.light } else { s.data.light }) / scale[s.particle] / brightest,
    )?);
    let planes = |value: &dyn Fn(&fit::PlaneFit) -> f64| {
        fitted.planes.iter().map(|p| (p.stage_um, value(p))).collect::<Vec<_>>()
    };
    let x = "stage position, um";
    let labels = AxisLabels { x, y: "chi2 per pixel", title: "Goodness of fit over the scan" };
    let series = [Series::new("chi2 per pixel", planes(&|p| p.chi2))];
    let caption = "Squared residuals divided by the variance of the noise, for each plane; 1 is expected from noise alone.";
    plots.push(figure_of(lines(&labels, &series)?, &[], caption));
    let labels = AxisLabels { x, y: "brightness, relative", title: "Brightness of planes" };
    let series = [Series::new("brightness", planes(&|p| p.flux))];
    let caption = "Brightness of each plane relative to the model, common to all particles: bleaching and vignetting show here.";
    plots.push(figure_of(lines(&labels, &series)?, &[], caption));
    Ok(plots)
}

/// A quantity of all particles over their depth: data as dots, the model as a line.
fn over_depth(
    evidence: &Evidence,
    y: &str,
    caption: &str,
    value: &dyn Fn(&Sample, bool) -> f64,
) -> Result<Markup> {
    let used = || evidence.samples.iter().filter(|sample| !sample.rejected);
    let data = used().map(|sample| (sample.z_um, value(sample, false))).collect();
    let mut model: Vec<(f64, f64)> = used().map(|sample| (sample.z_um, value(sample, true))).collect();
    model.sort_by(|a, b| a.0.total_cmp(&b.0));
    let series =
        [Series::new(KINDS[0], data).drawn(Style::Dots), Series::new(KINDS[1], model).drawn(Style::Line)];
    let labels = AxisLabels { x: "depth z of the particle in the model, um", y, title: y };
    Ok(figure_of(lines(&labels, &series)?, &names(&series), caption))
}

fn parameters(fitted: &Fitted) -> Markup {
    html! {
        div.scroll { table {
            tr { th { "parameter" } th { "value" } th { "sd" } th { "95 % interval" } th { "correlates with" } }
            @for p in &fitted.parameters {
                @let places = if p.free { decimals(p.sd) } else { 4 };
                tr {
                    td { (p.name) @if !p.unit.is_empty() { ", " (p.unit) } }
                    td { (format!("{:.places$}", p.value)) }
                    @if p.free {
                        td { (format!("{:.places$}", p.sd)) }
                        td { (format!("{:.places$} to {:.places$}", p.low_95, p.high_95)) }
                        td { @if let Some((other, r)) = &p.correlates_with { (other) " (" (format!("{r:+.2}")) ")" } }
                    } @else { td {} td { "given" } td {} }
                }
            }
            @for (name, value) in [
                ("background_mean, counts", fitted.settings.background_mean),
                ("background_noise, counts", fitted.settings.background_noise),
                ("variance per count of light, counts", fitted.variance_per_count),
                ("drift x, px/um", fitted.drift_px_per_um[0]),
                ("drift y, px/um", fitted.drift_px_per_um[1]),
            ] { tr { td { (name) } td { (format!("{value:.4}")) } td {} td { "measured in the scan" } td {} } }
        } }
    }
}

fn correlations(fitted: &Fitted) -> Markup {
    let names = &fitted.correlations.names;
    html! {
        h2 { "Correlations" }
        div.scroll { table {
            tr { th {} @for name in names { th { (name) } } }
            @for (name, row) in names.iter().zip(&fitted.correlations.matrix) {
                tr { td { (name) } @for r in row { td { (format!("{r:+.2}")) } } }
            }
        } }
        p.soft { "Near +1 or -1, the scan determines a combination of two quantities better than each of them." }
    }
}

fn particles(fitted: &Fitted) -> Markup {
    html! {
        div.scroll { table {
            tr { th { "particle" } th { "x, px" } th { "y, px" } th { "z at stage 0, um" } th { "light, counts" } th { "background, counts" } }
            @for (k, p) in fitted.particles.iter().enumerate() { tr {
                td { (k + 1) }
                td { (format!("{:.3} \u{b1} {:.3}", p.x_px, p.sd[0])) }
                td { (format!("{:.3} \u{b1} {:.3}", p.y_px, p.sd[1])) }
                td { (format!("{:.2} \u{b1} {:.2}", p.z_um, p.sd[2])) }
                td { (format!("{:.0}", p.light_counts)) }
                td { (format!("{:.2}", p.background_counts)) }
            } }
        } }
        @if !fitted.rejected.is_empty() {
            p.soft { "Rejected windows, whose residuals far exceed those of the others (particle, plane from 0): "
                @for (i, (k, plane)) in fitted.rejected.iter().enumerate() { @if i > 0 { "; " } (k + 1) ", " (plane) } }
        }
    }
}

fn next(fitted: &Fitted, out: &str) -> Markup {
    html! {
        @if fitted.verdict == Verdict::NotDescribed {
            p { "Do not use these settings. Fit images shaped by diffraction with " code { "--model waves --wavelength UM" }
            "; with rays, fit a scan over a longer range, far from focus." }
        } @else {
            p { "The digital twin of this microscope is in " code { "scenario.ron" } ": choose a flow and a number of particles there, then run" }
            pre { "microsig generate " (out) "/scenario.ron --out twin\nmicrosig track twin --method ncc --out found.csv\n\
                microsig evaluate twin found.csv --out scores --report" }
            p { code { "settings.txt" } " is a settings file of MicroSIG with the same optics. Look at the residuals above first: rings or \
            crosses that all particles share are errors of the model; a bright spot in a few planes is a neighboring particle." }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn errors_have_two_digits() {
        assert_eq!([0.0123, 1.5, 0.2, 37.0].map(decimals), [3, 1, 2, 0]);
    }
}
