//! Plots of displacement fields.

use maud::Markup;

use super::figure::{claimed, error_map, figure, figure_of, histogram, names};
use super::plots::{AxisLabels, Marks, Series, bars, lines, log_lines, sensor};
use scoring::evaluate::Evaluation;
use scoring::evaluate::field::{ComparedVector, FieldErrors, SpectralPoint, Spectrum};
use scoring::evaluate::statistics::quantile;
use storage::error::Result;

const FIELD_MAP: &str = "RMS error in the image plane over the sensor; cells without particles are empty.";

/// All plots of a scored field. `with_true_positions`: including the map of true and measured vectors.
pub(super) fn plots(evaluation: &Evaluation, with_true_positions: bool) -> Result<Vec<Markup>> {
    let Some(score) = &evaluation.score.field else { return Ok(Vec::new()) };
    let main = &score.main;
    let valid: Vec<&ComparedVector> = evaluation.vectors.iter().filter(|c| c.measured.flag == 0).collect();
    let extent = |k: fn(&scoring::results::Position) -> f64| {
        valid.iter().map(|c| k(&c.measured.at)).fold(1.0f64, f64::max).ceil()
    };
    let size = (extent(|p| p.x_px), extent(|p| p.y_px));
    let mut plots = Vec::new();
    if with_true_positions {
        plots.push(arrows(&valid, size, main.outlier_threshold_px)?);
    }
    // Outliers are shown above; in these plots they would dominate the scale.
    let inliers: Vec<&&ComparedVector> =
        valid.iter().filter(|c| c.endpoint() < main.outlier_threshold_px).collect();
    let errors = inliers.iter().map(|c| ((c.measured.at.x_px, c.measured.at.y_px), c.endpoint()));
    if with_true_positions {
        plots.extend(error_map(size, errors, ("px", FIELD_MAP))?);
        for (k, x) in ["error in u of inliers, px", "error in v of inliers, px"].into_iter().enumerate() {
            plots.extend(histogram(x, "vectors", inliers.iter().map(|c| c.error()[k]))?);
        }
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

/// Maximum number of vectors drawn.
const ARROWS: usize = 900;

/// True and measured vectors of the first image pair, with outliers in a separate color.
fn arrows(valid: &[&ComparedVector], size: (f64, f64), outlier_px: f64) -> Result<Markup> {
    let first = valid.first().and_then(|c| c.measured.pair);
    let shown: Vec<&&ComparedVector> = valid.iter().filter(|c| c.measured.pair == first).collect();
    let shown: Vec<&&ComparedVector> =
        shown.iter().step_by(shown.len().div_ceil(ARROWS).max(1)).copied().collect();
    let mut lengths: Vec<f64> = shown.iter().map(|c| c.truth[0].hypot(c.truth[1])).collect();
    lengths.sort_unstable_by(f64::total_cmp);
    let spacing = (size.0 * size.1 / shown.len().max(1) as f64).sqrt();
    let stretch = quantile(&lengths, 0.95).filter(|l| *l > 0.0).map_or(1.0, |l| spacing / l);
    let segment = |at: &scoring::results::Position, moved: &[f64; 3]| {
        let foot = (at.x_px, at.y_px);
        // Clip gross outliers to the plot.
        let reach = |v: f64| (stretch * v).clamp(-4.0 * spacing, 4.0 * spacing);
        [foot, (foot.0 + reach(moved[0]), foot.1 + reach(moved[1]))]
    };
    let mut segments: Vec<_> = shown.iter().map(|c| (segment(&c.measured.at, &c.truth), 2)).collect();
    for c in &shown {
        let series = usize::from(c.endpoint() >= outlier_px);
        segments.push((segment(&c.measured.at, &c.measured.moved), series));
    }
    let labels = AxisLabels { x: "x, px", y: "y, px", title: "True and measured vectors" };
    let svg = sensor(&labels, size, &Marks::Segments(segments))?;
    let outliers = valid.iter().filter(|c| c.endpoint() >= outlier_px).count();
    let names = [
        "measured".to_owned(),
        format!("off by {outlier_px} px or more ({outliers} in all)"),
        "true".to_owned(),
    ];
    let caption = format!(
        "Displacement vectors of one image pair, starting at the dots, magnified {stretch:.1} times."
    );
    Ok(figure_of(svg, &names.iter().map(String::as_str).collect::<Vec<_>>(), &caption))
}

/// Amplitude response, and power spectra of truth, result and error.
fn responses(spectra: &[Spectrum]) -> Result<Vec<Markup>> {
    let line = |s: &Spectrum, name: &str, value: fn(&SpectralPoint) -> f64| {
        let points = s.waves.iter().map(|w| (1.0 / w.wavelength_px, value(w))).collect();
        Series::new(format!("{name}{} along {}", s.component, s.along), points)
    };
    let mut plots = Vec::new();
    let seen = spectra.iter().filter(|s| s.waves.iter().any(|w| w.response.is_some()));
    let response: Vec<Series> = seen.map(|s| line(s, "", |w| w.response.unwrap_or(f64::NAN))).collect();
    let x = "wavenumber 1 / wavelength, 1/px";
    if !response.is_empty() {
        let labels = AxisLabels { x, y: "amplitude response", title: "Amplitude response" };
        let caption = "Measured fraction of the true amplitude against the wavenumber.";
        plots.push(figure_of(lines(&labels, &response)?, &names(&response), caption));
    }
    for s in spectra {
        let series = [
            line(s, "result: ", |w| w.found_power_px3),
            line(s, "error: ", |w| w.error_power_px3),
            line(s, "truth: ", |w| w.true_power_px3),
        ];
        let labels = AxisLabels { x, y: "power density, px^3", title: "Power spectra" };
        if let Some(svg) = log_lines(&labels, &series)? {
            let caption = format!("Power spectra of {} along {}, logarithmic axes.", s.component, s.along);
            plots.push(figure_of(svg, &names(&series), &caption));
        }
    }
    Ok(plots)
}

fn locking(main: &FieldErrors) -> Result<[Markup; 2]> {
    let tenths: Vec<_> = main
        .peak_locking
        .histogram_u
        .iter()
        .enumerate()
        .map(|(i, &n)| (i as f64 / 10.0, (i + 1) as f64 / 10.0, n as f64))
        .collect();
    let labels = AxisLabels { x: "fraction of u, px", y: "vectors", title: "Peak locking" };
    let fractions = bars(&labels, &tenths)?;
    let curve = main.peak_locking.bias_curve_px.iter().enumerate();
    let points = curve.map(|(i, b)| ((i as f64 + 0.5) / 20.0, b.unwrap_or(f64::NAN))).collect();
    let labels =
        AxisLabels { x: "fraction of the true u, px", y: "bias of u, px", title: "Bias over the fraction" };
    let bias = lines(&labels, &[Series::new("bias", points)])?;
    Ok([
        figure(fractions, "Fractional part of the measured displacement u; uniform without peak locking."),
        figure(bias, "Bias of u against the fractional part of the true displacement."),
    ])
}
