//! Plots as SVG that takes its colours from the page, so that it reads in light, dark and print.

use plotters::coord::Shift;
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};

use crate::error::{Error, Result};

/// Stand-ins that become the page's colours: plotters writes plain colours only.
const INK: RGBColor = RGBColor(1, 2, 3);
const GRID: RGBColor = RGBColor(4, 5, 6);
const SERIES: [RGBColor; 6] = [
    RGBColor(11, 1, 1),
    RGBColor(11, 2, 2),
    RGBColor(11, 3, 3),
    RGBColor(11, 4, 4),
    RGBColor(11, 5, 5),
    RGBColor(11, 6, 6),
];

/// A named line; gaps where y is not finite.
pub(super) struct Line {
    pub(super) name: String,
    pub(super) points: Vec<(f64, f64)>,
}

/// The words of a plot.
pub(super) struct Words<'a> {
    pub(super) x: &'a str,
    pub(super) y: &'a str,
    /// What it shows, for who cannot see it.
    pub(super) title: &'a str,
}

const SIZE: (u32, u32) = (560, 340);

fn failed(e: impl std::fmt::Display) -> Error {
    Error::input(format!("plot: {e}"))
}

type Area<'a> = DrawingArea<SVGBackend<'a>, Shift>;

fn draw(title: &str, size: (u32, u32), with: impl FnOnce(&Area<'_>) -> Result<()>) -> Result<String> {
    let mut svg = String::new();
    {
        let area = SVGBackend::with_string(&mut svg, size).into_drawing_area();
        with(&area)?;
        area.present().map_err(failed)?;
    }
    let colour = |c: RGBColor| format!("#{:02X}{:02X}{:02X}", c.0, c.1, c.2);
    svg = svg.replace(&colour(INK), "currentColor").replace(&colour(GRID), "var(--grid)");
    for (i, c) in SERIES.iter().enumerate() {
        svg = svg.replace(&colour(*c), &format!("var(--c{i})"));
    }
    // A figure scales with the page, and says what it is.
    let escaped = title.replace('&', "&amp;").replace('"', "&quot;").replace('<', "&lt;");
    let (width, height) = size;
    let old = format!("<svg width=\"{width}\" height=\"{height}\"");
    let new = format!("<svg role=\"img\" aria-label=\"{escaped}\"");
    Ok(svg.replacen(&old, &new, 1))
}

/// Least and greatest of values, widened to an interval that can be drawn.
fn range(values: impl Iterator<Item = f64>, from_zero: bool) -> (f64, f64) {
    let (mut low, mut high) = values
        .filter(|v| v.is_finite())
        .fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), v| (l.min(v), h.max(v)));
    if low > high {
        return (0.0, 1.0);
    }
    if from_zero {
        low = low.min(0.0);
    }
    let margin = if high > low { 0.05 * (high - low) } else { 0.5 * high.abs().max(1e-6) };
    high += margin;
    if !(from_zero && low == 0.0) {
        low -= margin;
    }
    (low, high)
}

/// A number at an axis, without needless zeros.
fn label(value: &f64) -> String {
    let text = format!("{value:.6}");
    let text = text.trim_end_matches('0').trim_end_matches('.');
    if text == "-0" { "0".to_owned() } else { text.to_owned() }
}

macro_rules! mesh {
    ($chart:expr, $words:expr) => {
        $chart
            .configure_mesh()
            .axis_style(INK)
            .bold_line_style(GRID)
            .light_line_style(TRANSPARENT)
            .label_style(("sans-serif", 13, &INK))
            .x_desc($words.x)
            .y_desc($words.y)
            .x_labels(8)
            .y_labels(6)
            .x_label_formatter(&label)
            .y_label_formatter(&label)
            .draw()
            .map_err(failed)?
    };
}

/// Lines with dots.
pub(super) fn lines(words: &Words<'_>, series: &[Line]) -> Result<String> {
    let all = || series.iter().flat_map(|l| l.points.iter().copied());
    let (x0, x1) = range(all().map(|p| p.0), false);
    let (y0, y1) = range(all().map(|p| p.1), true);
    draw(words.title, SIZE, |area| {
        let mut chart = ChartBuilder::on(area)
            .margin(12)
            .x_label_area_size(40)
            .y_label_area_size(64)
            .build_cartesian_2d(x0..x1, y0..y1)
            .map_err(failed)?;
        mesh!(chart, words);
        for (i, line) in series.iter().enumerate() {
            let colour = SERIES[i % SERIES.len()];
            let whole = |p: &(f64, f64)| p.0.is_finite() && p.1.is_finite();
            for run in line.points.chunk_by(|a, b| whole(a) && whole(b)).filter(|run| whole(&run[0])) {
                chart
                    .draw_series(LineSeries::new(run.iter().copied(), colour.stroke_width(2)))
                    .map_err(failed)?;
            }
            let dots = line.points.iter().filter(|p| whole(p)).map(|p| Circle::new(*p, 3, colour.filled()));
            chart.draw_series(dots).map_err(failed)?;
        }
        Ok(())
    })
}

/// Bars over intervals [from, to].
pub(super) fn bars(words: &Words<'_>, bars: &[(f64, f64, f64)]) -> Result<String> {
    let (x0, x1) = range(bars.iter().flat_map(|b| [b.0, b.1]), false);
    let (_, y1) = range(bars.iter().map(|b| b.2), true);
    draw(words.title, SIZE, |area| {
        let mut chart = ChartBuilder::on(area)
            .margin(12)
            .x_label_area_size(40)
            .y_label_area_size(64)
            .build_cartesian_2d(x0..x1, 0.0..y1.max(1e-9))
            .map_err(failed)?;
        mesh!(chart, words);
        chart
            .draw_series(bars.iter().map(|b| {
                let gap = 0.04 * (b.1 - b.0);
                Rectangle::new([(b.0 + gap, 0.0), (b.1 - gap, b.2)], SERIES[0].filled())
            }))
            .map_err(failed)?;
        Ok(())
    })
}

/// Groups of bars with names below, two series side by side.
pub(super) fn classes(words: &Words<'_>, names: &[&str], series: [&[usize]; 2]) -> Result<String> {
    let most = series.iter().copied().flatten().copied().max().unwrap_or(0).max(1) as f64;
    draw(words.title, SIZE, |area| {
        let mut chart = ChartBuilder::on(area)
            .margin(12)
            .x_label_area_size(40)
            .y_label_area_size(64)
            .build_cartesian_2d(0.0..names.len() as f64, 0.0..1.05 * most)
            .map_err(failed)?;
        chart
            .configure_mesh()
            .axis_style(INK)
            .bold_line_style(GRID)
            .light_line_style(TRANSPARENT)
            .label_style(("sans-serif", 13, &INK))
            .x_desc(words.x)
            .y_desc(words.y)
            .x_labels(0)
            .y_labels(6)
            .y_label_formatter(&label)
            .disable_x_mesh()
            .draw()
            .map_err(failed)?;
        for (k, counts) in series.iter().enumerate() {
            let colour = SERIES[k];
            let left = 0.1 + 0.4 * k as f64;
            let bars = counts.iter().enumerate().map(|(i, &n)| {
                let x = i as f64 + left;
                Rectangle::new([(x, 0.0), (x + 0.38, n as f64)], colour.filled())
            });
            chart.draw_series(bars).map_err(failed)?;
        }
        // Names stand below the axis, outside of the chart.
        let font = ("sans-serif", 13, &INK).into_text_style(area).pos(Pos::new(HPos::Center, VPos::Top));
        for (i, name) in names.iter().enumerate() {
            let (x, y) = chart.backend_coord(&(i as f64 + 0.49, 0.0));
            area.draw(&Text::new((*name).to_owned(), (x, y + 6), font.clone())).map_err(failed)?;
        }
        Ok(())
    })
}

/// The sensor, y downward: places of three kinds, or cells shaded by a share of 1.
pub(super) enum Marks {
    /// Truth that was found (hollow), missed (filled) and ghosts (crosses).
    Places { found: Vec<(f64, f64)>, missed: Vec<(f64, f64)>, ghosts: Vec<(f64, f64)> },
    /// Rectangles with their shade in [0, 1].
    Cells(Vec<([(f64, f64); 2], f64)>),
    /// Segments from a place to another, each with the number of its series.
    Segments(Vec<([(f64, f64); 2], usize)>),
}

/// Draws marks over the sensor.
pub(super) fn sensor(words: &Words<'_>, size_px: (f64, f64), marks: &Marks) -> Result<String> {
    let aspect = (size_px.1 / size_px.0).clamp(0.3, 1.5);
    let size = (SIZE.0, (f64::from(SIZE.0 - 100) * aspect) as u32 + 70);
    draw(words.title, size, |area| {
        let mut chart = ChartBuilder::on(area)
            .margin(12)
            .x_label_area_size(40)
            .y_label_area_size(64)
            .build_cartesian_2d(0.5..size_px.0 + 0.5, (size_px.1 + 0.5)..0.5)
            .map_err(failed)?;
        mesh!(chart, words);
        match marks {
            Marks::Places { found, missed, ghosts } => {
                let ring = |p: &(f64, f64)| Circle::new(*p, 4, SERIES[0].stroke_width(1));
                chart.draw_series(found.iter().map(ring)).map_err(failed)?;
                let dot = |p: &(f64, f64)| Circle::new(*p, 4, SERIES[1].filled());
                chart.draw_series(missed.iter().map(dot)).map_err(failed)?;
                let cross = |p: &(f64, f64)| Cross::new(*p, 4, SERIES[2].stroke_width(2));
                chart.draw_series(ghosts.iter().map(cross)).map_err(failed)?;
            }
            Marks::Cells(cells) => {
                let cell = |(corners, shade): &([(f64, f64); 2], f64)| {
                    Rectangle::new(*corners, SERIES[0].mix(shade.clamp(0.0, 1.0)).filled())
                };
                chart.draw_series(cells.iter().map(cell)).map_err(failed)?;
            }
            Marks::Segments(segments) => {
                for (ends, series) in segments {
                    let colour = SERIES[series % SERIES.len()];
                    let segment = PathElement::new(ends.to_vec(), colour.stroke_width(1));
                    // A dot marks where it begins.
                    let foot = Circle::new(ends[0], 1, colour.filled());
                    chart.draw_series([segment]).map_err(failed)?;
                    chart.draw_series([foot]).map_err(failed)?;
                }
            }
        }
        Ok(())
    })
}
