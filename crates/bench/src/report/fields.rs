//! Plots of displacement fields.

use maud::Markup;

use super::html::{claimed, error_map, figure, figure_of, histogram};
use super::plots::{Line, Marks, Words, bars, lines, sensor};
use crate::error::Result;
use crate::evaluate::Evaluation;
use crate::evaluate::field::{Against, Compared, Spectrum};
use crate::evaluate::statistics::quantile;

/// All plots of a scored field.
pub(super) fn plots(evaluation: &Evaluation) -> Result<Vec<Markup>> {
    let Some(score) = &evaluation.score.field else { return Ok(Vec::new()) };
    let main = &score.main;
    let valid: Vec<&Compared> = evaluation.vectors.iter().filter(|c| c.found.flag == 0).collect();
    let extent = |k: fn(&crate::results::Position) -> f64| {
        valid.iter().map(|c| k(&c.found.at)).fold(1.0f64, f64::max).ceil()
    };
    let size = (extent(|p| p.x_px), extent(|p| p.y_px));
    let mut plots = vec![arrows(&valid, size, main.outlier_threshold_px)?];
    // Outliers are seen above; here they would hide all else.
    let inliers: Vec<&&Compared> =
        valid.iter().filter(|c| c.endpoint() < main.outlier_threshold_px).collect();
    let errors = inliers.iter().map(|c| ((c.found.at.x_px, c.found.at.y_px), c.endpoint()));
    plots.extend(error_map(size, errors)?);
    for (k, x) in ["error in u of inliers, px", "error in v of inliers, px"].into_iter().enumerate() {
        plots.extend(histogram(x, "vectors", inliers.iter().map(|c| c.error()[k]))?);
    }
    plots.extend(responses(&main.spectra)?);
    plots.extend(locking(main)?);
    for (axis, of) in
        [("u of inliers, px", &main.uncertainty.u_inliers), ("v of inliers, px", &main.uncertainty.v_inliers)]
    {
        plots.extend(of.as_ref().map(|u| claimed(axis, u)).transpose()?);
    }
    Ok(plots)
}

/// Vectors drawn at most.
const ARROWS: usize = 900;

/// True and measured vectors of the first pair, outliers in a colour of their own.
fn arrows(valid: &[&Compared], size: (f64, f64), outlier_px: f64) -> Result<Markup> {
    let first = valid.first().and_then(|c| c.found.pair);
    let shown: Vec<&&Compared> = valid.iter().filter(|c| c.found.pair == first).collect();
    let shown: Vec<&&Compared> = shown.iter().step_by(shown.len().div_ceil(ARROWS).max(1)).copied().collect();
    let mut lengths: Vec<f64> = shown.iter().map(|c| c.exact[0].hypot(c.exact[1])).collect();
    lengths.sort_unstable_by(f64::total_cmp);
    let spacing = (size.0 * size.1 / shown.len().max(1) as f64).sqrt();
    let stretch = quantile(&lengths, 0.95).filter(|l| *l > 0.0).map_or(1.0, |l| spacing / l);
    let segment = |at: &crate::results::Position, moved: &[f64; 3]| {
        let foot = (at.x_px, at.y_px);
        // Wild outliers would leave the page.
        let reach = |v: f64| (stretch * v).clamp(-4.0 * spacing, 4.0 * spacing);
        [foot, (foot.0 + reach(moved[0]), foot.1 + reach(moved[1]))]
    };
    let mut segments: Vec<_> = shown.iter().map(|c| (segment(&c.found.at, &c.exact), 2)).collect();
    for c in &shown {
        let series = usize::from(c.endpoint() >= outlier_px);
        segments.push((segment(&c.found.at, &c.found.moved), series));
    }
    let words = Words { x: "x, px", y: "y, px", title: "True and measured vectors" };
    let svg = sensor(&words, size, &Marks::Segments(segments))?;
    let outliers = valid.iter().filter(|c| c.endpoint() >= outlier_px).count();
    let names = [
        "measured".to_owned(),
        format!("off by {outlier_px} px or more ({outliers} in all)"),
        "true".to_owned(),
    ];
    let caption = format!("Displacements of one image pair from their dots, {stretch:.1} times as long.");
    Ok(figure_of(svg, &names.iter().map(String::as_str).collect::<Vec<_>>(), &caption))
}

/// Amplitude response and power of the error against the wavenumber.
fn responses(spectra: &[Spectrum]) -> Result<Vec<Markup>> {
    let line = |s: &Spectrum, value: fn(&crate::evaluate::field::Wave) -> f64| Line {
        name: format!("{} along {}", s.component, s.along),
        points: s.waves.iter().map(|w| (1.0 / w.wavelength_px, value(w))).collect(),
    };
    let mut plots = Vec::new();
    let seen = spectra.iter().filter(|s| s.waves.iter().any(|w| w.response.is_some()));
    let response: Vec<Line> = seen.map(|s| line(s, |w| w.response.unwrap_or(f64::NAN))).collect();
    let error: Vec<Line> = spectra.iter().map(|s| line(s, |w| w.error_power_px3)).collect();
    for (series, y, caption) in [
        (response, "amplitude response", "Share of the true amplitude that is left, against 1 / wavelength."),
        (error, "power of the error, px^3", "Spectrum of the error, against 1 / wavelength."),
    ] {
        if !series.is_empty() {
            let svg = lines(&Words { x: "1 / wavelength, 1/px", y, title: y }, &series)?;
            let names: Vec<&str> = series.iter().map(|l| l.name.as_str()).collect();
            plots.push(figure_of(svg, &names, caption));
        }
    }
    Ok(plots)
}

fn locking(main: &Against) -> Result<[Markup; 2]> {
    let tenths: Vec<_> = main
        .peak_locking
        .histogram_u
        .iter()
        .enumerate()
        .map(|(i, &n)| (i as f64 / 10.0, (i + 1) as f64 / 10.0, n as f64))
        .collect();
    let words = Words { x: "fraction of u, px", y: "vectors", title: "Peak locking" };
    let fractions = bars(&words, &tenths)?;
    let curve = main.peak_locking.bias_curve_px.iter().enumerate();
    let points = curve.map(|(i, b)| ((i as f64 + 0.5) / 20.0, b.unwrap_or(f64::NAN))).collect();
    let words =
        Words { x: "fraction of the true u, px", y: "bias of u, px", title: "Bias over the fraction" };
    let bias = lines(&words, &[Line { name: "bias".to_owned(), points }])?;
    Ok([
        figure(fractions, "Fractions of the measured displacement u: even without peak locking."),
        figure(bias, "Bias of u against the fraction of the true displacement."),
    ])
}
