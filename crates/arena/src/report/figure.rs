//! Figures shared by the reports of particles and of fields.

use maud::{Markup, PreEscaped, html};

use super::plots::{AxisLabels, Cell, Series, Style, bars, lines, sensor_map, sign};
use scoring::evaluate::statistics::{Errors, quantile};
use scoring::evaluate::uncertainty::Uncertainty;
use storage::error::Result;

pub(super) fn figure(svg: String, caption: &str) -> Markup {
    figure_of(svg, &[], caption)
}

/// A plot of several series, with a legend in their colors above the caption.
pub(crate) fn figure_of(svg: String, names: &[&str], caption: &str) -> Markup {
    html! {
        figure {
            (PreEscaped(svg))
            figcaption {
                @for (i, name) in names.iter().enumerate().filter(|(_, name)| !name.is_empty()) {
                    span.name style=(format!("color: var(--c{})", i % 6)) { (sign(i)) " " (name) }
                }
                @if !names.is_empty() { br; }
                (caption)
            }
        }
    }
}

/// The names of series, empty for those without points: they are not listed, but the colors of the others
/// stay the same from plot to plot.
pub(crate) fn names(series: &[Series]) -> Vec<&str> {
    series.iter().map(|s| if s.has_points() { s.name.as_str() } else { "" }).collect()
}

/// RMS error against claimed uncertainty, in classes of similar claimed uncertainty.
pub(super) fn claimed(axis: &str, of: &Uncertainty) -> Result<Markup> {
    let found = of.bins.iter().map(|b| (b.claimed_rms, b.error_rms)).collect();
    let most = of.bins.iter().map(|b| b.claimed_rms).fold(0.0, f64::max);
    let (x, y) = (format!("claimed uncertainty of {axis}"), format!("RMS error of {axis}"));
    let series = [
        Series::new("result", found),
        Series::new("calibrated: RMS error = claim", vec![(0.0, 0.0), (most, most)]).drawn(Style::Line),
    ];
    let svg = lines(&AxisLabels { x: &x, y: &y, title: "Claimed and actual errors" }, &series)?;
    Ok(figure_of(svg, &names(&series), &format!("{y} against {x}, in ten classes of equal size.")))
}

/// Histogram of errors without the extreme 1 %, symmetric about 0 to show a bias. `None` if all errors are 0.
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
    let svg = bars(&AxisLabels { x, y, title: x }, &drawn)?;
    Ok(Some(figure(svg, &format!("Distribution of the {x} (central 99 %)."))))
}

/// Map of the RMS error over the sensor; `errors` holds positions (px) and magnitudes in a unit. `None`
/// without errors.
pub(super) fn error_map(
    (width, height): (f64, f64),
    errors: impl Iterator<Item = ((f64, f64), f64)>,
    (unit, caption): (&str, &str),
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
        Some(([corner(column, row), corner(column + 1, row + 1)], (*v)?))
    });
    let shaded: Vec<Cell> = shaded.collect();
    let labels = AxisLabels { x: "x, px", y: "y, px", title: "Error over the sensor" };
    let svg = sensor_map(&labels, (width, height), &shaded, most, &format!("RMS, {unit}"))?;
    Ok(Some(figure(svg, caption)))
}
