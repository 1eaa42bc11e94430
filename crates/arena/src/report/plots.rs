//! SVG plots that take their colors from the page, for light, dark and print styles.

use plotters::coord::Shift;
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};

use generator::preview::tick_label;
use storage::error::{Error, Result};

/// Placeholder colors that are replaced by CSS variables: plotters writes fixed colors only.
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

/// A named series of points; values that are not finite leave gaps.
#[derive(Debug, Clone, Default, PartialEq)]
pub(crate) struct Series {
    pub(crate) name: String,
    pub(crate) points: Vec<(f64, f64)>,
    /// Ends of the error bar of every point; empty or NaN without error bars.
    pub(crate) bars: Vec<(f64, f64)>,
    /// The individual values whose means are the points, drawn as faint dots.
    pub(crate) singles: Vec<(f64, f64)>,
    pub(crate) style: Style,
}

/// How the points of a series are drawn.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(crate) enum Style {
    /// Dots joined by lines.
    #[default]
    LinesAndDots,
    /// A line alone.
    Line,
    /// Small dots only, for many points.
    Dots,
    /// Dots only.
    LargeDots,
}

impl Series {
    pub(crate) fn new(name: impl Into<String>, points: Vec<(f64, f64)>) -> Self {
        Series { name: name.into(), points, ..Series::default() }
    }

    pub(crate) fn with_bars(self, bars: Vec<(f64, f64)>) -> Self {
        Series { bars, ..self }
    }

    pub(crate) fn drawn(self, style: Style) -> Self {
        Series { style, ..self }
    }

    /// Dots without lines, moved along the horizontal axis.
    fn beside(&self, shift: f64) -> Self {
        let moved = |points: &[(f64, f64)]| points.iter().map(|(x, y)| (x + shift, *y)).collect();
        Series {
            points: moved(&self.points),
            singles: moved(&self.singles),
            style: Style::LargeDots,
            ..self.clone()
        }
    }

    /// Whether there is a point to draw.
    pub(crate) fn has_points(&self) -> bool {
        self.points.iter().any(|p| p.0.is_finite() && p.1.is_finite())
    }
}

/// The texts of a plot.
#[derive(Debug, Clone, Copy)]
pub(crate) struct AxisLabels<'a> {
    pub(crate) x: &'a str,
    pub(crate) y: &'a str,
    /// Title, for screen readers.
    pub(crate) title: &'a str,
}

/// Width and height of a plot, in the units of its font.
const SIZE: (u32, u32) = (560, 360);
/// Font size of tick labels; pages scale plots by 0.8 to 1.2, a column of 85 mm by 0.6 (7.7 points).
const TICKS: i32 = 18;
/// Font size of axis labels.
const NAMES: i32 = 19;
/// Opacity of individual values behind their mean.
const FAINT: f64 = 0.35;
/// Space for tick and axis labels.
const BELOW: u32 = 58;
const LEFT: u32 = 98;

fn failed(e: impl std::fmt::Display) -> Error {
    Error::input(format!("plot: {e}"))
}

type Area<'a> = DrawingArea<SVGBackend<'a>, Shift>;

/// A chart with space for its labels.
fn chart_on<'a, 'b>(area: &'a Area<'b>) -> ChartBuilder<'a, 'b, SVGBackend<'b>> {
    let mut chart = ChartBuilder::on(area);
    chart.margin(12).x_label_area_size(BELOW).y_label_area_size(LEFT);
    chart
}

fn draw(title: &str, size: (u32, u32), with: impl FnOnce(&Area<'_>) -> Result<()>) -> Result<String> {
    let mut svg = String::new();
    {
        let area = SVGBackend::with_string(&mut svg, size).into_drawing_area();
        with(&area)?;
        area.present().map_err(failed)?;
    }
    let hex = |c: RGBColor| format!("#{:02X}{:02X}{:02X}", c.0, c.1, c.2);
    svg = svg.replace(&hex(INK), "currentColor").replace(&hex(GRID), "var(--grid)");
    for (i, c) in SERIES.iter().enumerate() {
        svg = svg.replace(&hex(*c), &format!("var(--c{i})"));
    }
    // Let the figure scale with the page, and add a title.
    let escaped = title.replace('&', "&amp;").replace('"', "&quot;").replace('<', "&lt;");
    let (width, height) = size;
    let old = format!("<svg width=\"{width}\" height=\"{height}\"");
    let new = format!("<svg role=\"img\" aria-label=\"{escaped}\"");
    Ok(svg.replacen(&old, &new, 1))
}

/// Axis range of values, with a margin; never empty.
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
    let margin = if high > low {
        0.05 * (high - low)
    } else if high == 0.0 {
        1.0
    } else {
        0.5 * high.abs()
    };
    high += margin;
    if !(from_zero && low == 0.0) {
        low -= margin;
    }
    (low, high)
}

macro_rules! mesh {
    ($chart:expr, $labels:expr $(, $setting:ident($($value:expr)?))*) => {
        let (x_range, y_range) = ($chart.x_range(), $chart.y_range());
        $chart
            .configure_mesh()
            .axis_style(INK)
            .bold_line_style(GRID)
            .light_line_style(TRANSPARENT)
            .label_style(("sans-serif", TICKS, &INK))
            .axis_desc_style(("sans-serif", NAMES, &INK))
            .x_desc($labels.x)
            .y_desc($labels.y)
            .x_labels(ACROSS)
            .y_labels(6)
            .x_label_formatter(&|x| tick_label(*x, &x_range))
            .y_label_formatter(&|y| tick_label(*y, &y_range))
            $(.$setting($($value)?))*
            .draw()
            .map_err(failed)?
    };
}

macro_rules! draw_all {
    ($chart:expr, $series:expr) => {
        for (i, series) in $series.iter().enumerate() {
            let color = SERIES[i % SERIES.len()];
            let whole = |p: &(f64, f64)| p.0.is_finite() && p.1.is_finite();
            let faint = color.mix(FAINT).filled();
            let singles = series.singles.iter().filter(|p| whole(p)).map(|p| Circle::new(*p, 3, faint));
            $chart.draw_series(singles).map_err(failed)?;
            let bars = series.points.iter().zip(&series.bars).filter(|(p, b)| whole(p) && whole(b));
            for ((x, _), (low, high)) in bars {
                let bar = PathElement::new(vec![(*x, *low), (*x, *high)], color.stroke_width(1));
                $chart.draw_series([bar]).map_err(failed)?;
            }
            if !matches!(series.style, Style::Dots | Style::LargeDots) {
                for run in series.points.chunk_by(|a, b| whole(a) && whole(b)).filter(|run| whole(&run[0])) {
                    let line = LineSeries::new(run.iter().copied(), color.stroke_width(2));
                    $chart.draw_series(line).map_err(failed)?;
                }
            }
            let size = match series.style {
                Style::LinesAndDots | Style::LargeDots => 4,
                Style::Dots => 1,
                Style::Line => continue,
            };
            markers(&mut $chart, i, color, size, series.points.iter().copied().filter(|p| whole(p)))?;
        }
    };
}

/// Draws the marker of a series, which distinguishes it in gray, too, at points.
pub fn markers<X: Ranged<ValueType = f64>, Y: Ranged<ValueType = f64>>(
    chart: &mut ChartContext<'_, SVGBackend<'_>, Cartesian2d<X, Y>>,
    series: usize,
    color: RGBColor,
    half: i32,
    points: impl Iterator<Item = (f64, f64)>,
) -> Result<()> {
    let (fill, stroke) = (color.filled(), color.stroke_width(2));
    match series % MOST_LINES {
        0 => chart.draw_series(points.map(|p| Circle::new(p, half, fill))),
        1 => chart.draw_series(points.map(|p| TriangleMarker::new(p, half + 2, fill))),
        2 => {
            let square = |p| EmptyElement::at(p) + Rectangle::new([(-half, -half), (half, half)], fill);
            chart.draw_series(points.map(square))
        }
        3 => chart.draw_series(points.map(|p| Cross::new(p, half, stroke))),
        4 => chart.draw_series(points.map(|p| Circle::new(p, half + 1, stroke))),
        _ => chart.draw_series(points.map(|p| TriangleMarker::new(p, half + 3, stroke))),
    }
    .map_err(failed)?;
    Ok(())
}

/// Lines whose colors and markers differ.
pub const MOST_LINES: usize = SERIES.len();

/// Marker of a series in a legend.
pub fn sign(series: usize) -> char {
    ['\u{25cf}', '\u{25b2}', '\u{25a0}', '\u{2715}', '\u{25cb}', '\u{25b3}'][series % MOST_LINES]
}

/// The horizontal axis of panels.
pub(super) enum Across<'a> {
    Linear,
    /// Logarithmic, with these ticks.
    Log(Vec<f64>),
    /// A place for each name, from 0; points are not joined.
    Names(&'a [&'a str]),
}

/// Panels one below the other, with their titles and common ranges; each has the same series.
pub(super) fn panels(
    labels: &AxisLabels<'_>,
    panels: &[(String, Vec<Series>)],
    across: &Across<'_>,
) -> Result<String> {
    let points = || panels.iter().flat_map(|panel| all_points(&panel.1));
    let (y0, y1) = range(points().map(|p| p.1), true);
    let (low, high) = range(points().map(|p| p.0), false);
    // Names have as many lines as the longest needs.
    let letters = match across {
        Across::Names(names) => {
            ((SIZE.0 - LEFT) as usize / (TICKS as usize * 3 / 5) / names.len().max(1)).max(4)
        }
        _ => 0,
    };
    let wrapped: Vec<Vec<String>> = match across {
        Across::Names(names) => names.iter().map(|name| wrap(name, letters)).collect(),
        _ => Vec::new(),
    };
    let below =
        BELOW + TICKS as u32 * (wrapped.iter().map(Vec::len).max().unwrap_or(1) as u32).saturating_sub(1);
    let high_px = if panels.len() > 1 { 270 } else { SIZE.1 } + below - BELOW;
    draw(labels.title, (SIZE.0, high_px * panels.len() as u32), |area| {
        for (part, (title, series)) in area.split_evenly((panels.len(), 1)).iter().zip(panels) {
            let mut builder = chart_on(part);
            builder.x_label_area_size(below);
            if !title.is_empty() {
                builder.caption(title, ("sans-serif", NAMES, &INK));
            }
            match across {
                Across::Linear => {
                    let mut chart = builder.build_cartesian_2d(low..high, y0..y1).map_err(failed)?;
                    mesh!(chart, labels);
                    draw_all!(chart, series);
                }
                Across::Log(ticks) => {
                    let (a, b) = points().fold((f64::INFINITY, 0.0f64), |(a, b), p| (a.min(p.0), b.max(p.0)));
                    let x = (a / 1.3..b * 1.3).log_scale().with_key_points(ticks.clone());
                    let mut chart = builder.build_cartesian_2d(x, y0..y1).map_err(failed)?;
                    mesh!(chart, labels);
                    draw_all!(chart, series);
                }
                Across::Names(names) => {
                    let end = names.len() as f64 - 0.5;
                    let mut chart = builder.build_cartesian_2d(-0.5..end, y0..y1).map_err(failed)?;
                    mesh!(chart, labels, x_labels(0), disable_x_mesh());
                    // Beside each other, so that intervals do not cover each other.
                    let shift = |k: usize| 0.6 * ((k as f64 + 0.5) / series.len() as f64 - 0.5);
                    let beside = series.iter().enumerate().map(|(k, of)| of.beside(shift(k)));
                    let beside: Vec<Series> = beside.collect();
                    draw_all!(chart, beside);
                    let font = ("sans-serif", TICKS, &INK).into_text_style(part);
                    let font = font.pos(Pos::new(HPos::Center, VPos::Top));
                    for (k, lines) in wrapped.iter().enumerate() {
                        let (x, y) = chart.backend_coord(&(k as f64, y0));
                        let (left, top) = part.get_base_pixel();
                        for (row, line) in lines.iter().enumerate() {
                            let at = (x - left, y - top + 6 + TICKS * row as i32);
                            part.draw(&Text::new(line.clone(), at, font.clone())).map_err(failed)?;
                        }
                    }
                }
            }
        }
        Ok(())
    })
}

/// A text in lines of at most this number of letters, if its words are not longer.
fn wrap(text: &str, letters: usize) -> Vec<String> {
    let mut lines: Vec<String> = Vec::new();
    for word in text.split(' ') {
        match lines.last_mut() {
            Some(line) if line.chars().count() + 1 + word.chars().count() <= letters => {
                *line += &format!(" {word}")
            }
            _ => lines.push(word.to_owned()),
        }
    }
    lines
}

/// Plots series on linear axes.
pub(crate) fn lines(labels: &AxisLabels<'_>, series: &[Series]) -> Result<String> {
    panels(labels, &[(String::new(), series.to_vec())], &Across::Linear)
}

/// Plots series on logarithmic axes, omitting values that are not positive. `None` if nothing remains.
pub(crate) fn log_lines(labels: &AxisLabels<'_>, series: &[Series]) -> Result<Option<String>> {
    let positive = |p: &&(f64, f64)| p.0 > 0.0 && p.1 > 0.0 && p.0.is_finite() && p.1.is_finite();
    let mut kept = series.to_vec();
    for s in &mut kept {
        s.points = s.points.iter().filter(positive).copied().collect();
        s.singles.retain(|p| positive(&p));
        s.bars.clear();
    }
    if !kept.iter().any(Series::has_points) {
        return Ok(None);
    }
    let decades = |value: fn((f64, f64)) -> f64| {
        let values = || all_points(&kept).map(value);
        let (low, high) = values().fold((f64::INFINITY, 0.0f64), |(l, h), v| (l.min(v), h.max(v)));
        // Limit the axis to 12 decades: the error spectrum of a perfect result consists of rounding errors.
        let low = low.max(high * 1e-12);
        (low / 1.3, high * 1.3)
    };
    let ((x0, x1), (y0, y1)) = (decades(|p| p.0), decades(|p| p.1));
    draw(labels.title, SIZE, |area| {
        let mut chart = chart_on(area)
            .build_cartesian_2d(
                (x0..x1).log_scale().with_key_points(log_ticks(x0, x1)),
                (y0..y1).log_scale().with_key_points(log_ticks(y0, y1)),
            )
            .map_err(failed)?;
        mesh!(chart, labels);
        draw_all!(chart, kept);
        Ok(())
    })
    .map(Some)
}

/// Plots series over a logarithmic axis. `values`: positive, in ascending order; candidates for ticks.
pub(crate) fn lines_over_log(labels: &AxisLabels<'_>, series: &[Series], values: &[f64]) -> Result<String> {
    let (x0, x1) = match values {
        [low, .., high] => (low / 1.3, high * 1.3),
        _ => return lines(labels, series),
    };
    let (y0, y1) = range(all_points(series).map(|p| p.1), true);
    let ticks = values.iter().copied().step_by(values.len().div_ceil(ACROSS)).collect();
    draw(labels.title, SIZE, |area| {
        let mut chart = chart_on(area)
            .build_cartesian_2d((x0..x1).log_scale().with_key_points(ticks), y0..y1)
            .map_err(failed)?;
        mesh!(chart, labels);
        draw_all!(chart, series);
        Ok(())
    })
}

/// All points, single values and ends of error bars.
fn all_points(series: &[Series]) -> impl Iterator<Item = (f64, f64)> {
    series.iter().flat_map(|s| {
        let ends = s.points.iter().zip(&s.bars).flat_map(|(p, b)| [(p.0, b.0), (p.0, b.1)]);
        s.points.iter().chain(&s.singles).copied().chain(ends)
    })
}

/// Plots bars (from, to, height).
pub(super) fn bars(labels: &AxisLabels<'_>, bars: &[(f64, f64, f64)]) -> Result<String> {
    let (x0, x1) = range(bars.iter().flat_map(|b| [b.0, b.1]), false);
    let (_, y1) = range(bars.iter().map(|b| b.2), true);
    draw(labels.title, SIZE, |area| {
        let mut chart = chart_on(area).build_cartesian_2d(x0..x1, 0.0..y1.max(1e-9)).map_err(failed)?;
        mesh!(chart, labels);
        chart
            .draw_series(bars.iter().map(|b| {
                let gap = 0.04 * (b.1 - b.0);
                Rectangle::new([(b.0 + gap, 0.0), (b.1 - gap, b.2)], SERIES[0].filled())
            }))
            .map_err(failed)?;
        Ok(())
    })
}

/// Plots two series as grouped bars with class names below.
pub(super) fn classes(labels: &AxisLabels<'_>, names: &[&str], series: [&[usize]; 2]) -> Result<String> {
    let most = series.iter().copied().flatten().copied().max().unwrap_or(0).max(1) as f64;
    draw(labels.title, SIZE, |area| {
        let mut chart =
            chart_on(area).build_cartesian_2d(0.0..names.len() as f64, 0.0..1.05 * most).map_err(failed)?;
        let of_count = |y: &f64| tick_label(*y, &(0.0..most));
        mesh!(chart, labels, x_labels(0), y_label_formatter(&of_count), disable_x_mesh());
        for (k, counts) in series.iter().enumerate() {
            let color = SERIES[k];
            let left = 0.1 + 0.4 * k as f64;
            let bars = counts.iter().enumerate().map(|(i, &n)| {
                let x = i as f64 + left;
                Rectangle::new([(x, 0.0), (x + 0.38, n as f64)], color.filled())
            });
            chart.draw_series(bars).map_err(failed)?;
        }
        // Class names are drawn below the axis, outside the chart.
        let font = ("sans-serif", TICKS, &INK).into_text_style(area).pos(Pos::new(HPos::Center, VPos::Top));
        for (i, name) in names.iter().enumerate() {
            let (x, y) = chart.backend_coord(&(i as f64 + 0.49, 0.0));
            area.draw(&Text::new((*name).to_owned(), (x, y + 6), font.clone())).map_err(failed)?;
        }
        Ok(())
    })
}

/// Marks on a map of the sensor, y downward.
pub(super) enum Marks {
    /// True particles that were found (circles) or missed (dots), and ghosts (crosses).
    Places { found: Vec<(f64, f64)>, missed: Vec<(f64, f64)>, ghosts: Vec<(f64, f64)> },
    /// Line segments, each with the index of its series.
    Segments(Vec<([(f64, f64); 2], usize)>),
}

/// Size of a plot with the aspect ratio of the sensor and space at the right.
fn page_size(size_px: (f64, f64), right: u32) -> (u32, u32) {
    let aspect = (size_px.1 / size_px.0).clamp(0.3, 1.5);
    (SIZE.0, (f64::from(SIZE.0 - LEFT - 36 - right) * aspect) as u32 + BELOW + 24)
}

/// Corners of a rectangle of the sensor, px, and its value.
pub(super) type Cell = ([(f64, f64); 2], f64);

/// Map of values from 0 to `most` over the sensor, with a color bar labeled `unit`.
pub(super) fn sensor_map(
    labels: &AxisLabels<'_>,
    size_px: (f64, f64),
    cells: &[Cell],
    most: f64,
    unit: &str,
) -> Result<String> {
    const BAR: u32 = 110;
    const STEPS: i32 = 48;
    let shade = |share: f64| SERIES[0].mix(share.clamp(0.0, 1.0)).filled();
    draw(labels.title, page_size(size_px, BAR), |area| {
        let (width, _) = area.dim_in_pixel();
        let (left, right) = area.split_horizontally(width - BAR);
        let mut chart = chart_on(&left)
            .build_cartesian_2d(0.5..size_px.0 + 0.5, (size_px.1 + 0.5)..0.5)
            .map_err(failed)?;
        mesh!(chart, labels);
        let drawn = cells.iter().map(|(corners, value)| Rectangle::new(*corners, shade(value / most)));
        chart.draw_series(drawn).map_err(failed)?;
        let (_, height) = right.dim_in_pixel();
        let (top, bottom) = (28, height as i32 - BELOW as i32 - 12);
        let at = |share: f64| bottom - (f64::from(bottom - top) * share) as i32;
        for step in 0..STEPS {
            let (a, b) = (f64::from(step) / f64::from(STEPS), f64::from(step + 1) / f64::from(STEPS));
            let piece = Rectangle::new([(2, at(a)), (20, at(b))], shade(f64::midpoint(a, b)));
            right.draw(&piece).map_err(failed)?;
        }
        right.draw(&Rectangle::new([(2, at(0.0)), (20, at(1.0))], INK.stroke_width(1))).map_err(failed)?;
        let font = ("sans-serif", TICKS, &INK).into_text_style(&right);
        let beside = font.pos(Pos::new(HPos::Left, VPos::Center));
        for share in [0.0, 0.25, 0.5, 0.75, 1.0] {
            let text = Text::new(digits(share * most), (26, at(share)), beside.clone());
            right.draw(&text).map_err(failed)?;
        }
        right.draw(&Text::new(unit.to_owned(), (2, 14), beside)).map_err(failed)
    })
}

/// A number with three significant digits.
fn digits(value: f64) -> String {
    if value == 0.0 {
        return "0".to_owned();
    }
    let places = (2.0 - value.abs().log10().floor()).clamp(0.0, 9.0) as usize;
    format!("{value:.places$}")
}

pub(super) fn sensor(labels: &AxisLabels<'_>, size_px: (f64, f64), marks: &Marks) -> Result<String> {
    let aspect = (size_px.1 / size_px.0).clamp(0.3, 1.5);
    let size = (SIZE.0, (f64::from(SIZE.0 - 100) * aspect) as u32 + 70);
    draw(labels.title, size, |area| {
        let mut chart = chart_on(area)
            .build_cartesian_2d(0.5..size_px.0 + 0.5, (size_px.1 + 0.5)..0.5)
            .map_err(failed)?;
        mesh!(chart, labels);
        match marks {
            Marks::Places { found, missed, ghosts } => {
                let ring = |p: &(f64, f64)| Circle::new(*p, 4, SERIES[0].stroke_width(1));
                chart.draw_series(found.iter().map(ring)).map_err(failed)?;
                let dot = |p: &(f64, f64)| Circle::new(*p, 4, SERIES[1].filled());
                chart.draw_series(missed.iter().map(dot)).map_err(failed)?;
                let cross = |p: &(f64, f64)| Cross::new(*p, 4, SERIES[2].stroke_width(2));
                chart.draw_series(ghosts.iter().map(cross)).map_err(failed)?;
            }
            Marks::Segments(segments) => {
                for (ends, series) in segments {
                    let color = SERIES[series % SERIES.len()];
                    let segment = PathElement::new(ends.to_vec(), color.stroke_width(1));
                    // A dot marks the start.
                    let foot = Circle::new(ends[0], 1, color.filled());
                    chart.draw_series([segment]).map_err(failed)?;
                    chart.draw_series([foot]).map_err(failed)?;
                }
            }
        }
        Ok(())
    })
}

/// Maximum number of labels of a horizontal axis.
pub(super) const ACROSS: usize = 7;

/// Minimum ratio of the largest to the smallest value of a logarithmic axis.
const LOGARITHMIC: f64 = 10.0;

/// Whether rising values have roughly equal ratios, over a decade or more.
pub(crate) fn is_logarithmic(values: &[f64]) -> bool {
    let [low, _, .., high] = values else { return false };
    let steps = || values.windows(2).map(|pair| (pair[1] / pair[0]).ln());
    let (least, most) = steps().fold((f64::INFINITY, 0.0f64), |(a, b), step| (a.min(step), b.max(step)));
    // 2, 4, 10, 50 has steps of 2 to 5.
    *low > 0.0 && high / low >= LOGARITHMIC && most <= 2.5 * least
}

/// Multiples of powers of ten at which ticks may be, from few to many.
const MULTIPLES: [&[f64]; 4] = [
    &[1.0],
    &[1.0, 2.0, 5.0],
    &[1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 9.0],
    &[1.0, 1.5, 2.0, 2.5, 3.0, 3.5, 4.0, 4.5, 5.0, 5.5, 6.0, 6.5, 7.0, 7.5, 8.0, 8.5, 9.0, 9.5],
];

/// Ticks of a logarithmic axis: as many as fit, or some of the powers of ten.
pub fn log_ticks(low: f64, high: f64) -> Vec<f64> {
    let decades = low.log10().floor() as i32..=high.log10().ceil() as i32;
    let every = decades.clone().count().div_ceil(ACROSS);
    let ticks = |multiples: &[f64], every: usize| -> Vec<f64> {
        // Parsed from decimal text, because products are not exact.
        let tick = |multiple: &f64, decade: i32| format!("{multiple}e{decade}").parse().unwrap_or(f64::NAN);
        let of_decade = |decade: i32| multiples.iter().map(move |multiple| tick(multiple, decade));
        decades
            .clone()
            .step_by(every)
            .flat_map(of_decade)
            .filter(|tick| (low..=high).contains(tick))
            .collect()
    };
    let all = MULTIPLES.iter().rev().map(|multiples| ticks(multiples, 1));
    all.into_iter().find(|ticks| ticks.len() <= ACROSS).unwrap_or_else(|| ticks(MULTIPLES[0], every))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_axis_across_0_has_a_tick_0() {
        let labels = AxisLabels { x: "x", y: "y", title: "title" };
        for k in 1..30 {
            let low = -0.01 * f64::from(k);
            let svg = lines(&labels, &[Series::new("bias", vec![(low, low), (0.3, 0.3)])]).unwrap();
            let text = |line: &&str| !line.starts_with('<');
            let ticks: Vec<&str> = svg.lines().map(str::trim).filter(text).collect();
            assert_eq!(ticks.iter().filter(|tick| **tick == "0").count(), 2, "{low}: {ticks:?}");
            assert!(!ticks.iter().any(|tick| tick.contains("e-")), "{low}: {ticks:?}");
        }
    }

    #[test]
    fn a_logarithmic_axis_has_ticks_at_1_2_and_5() {
        assert_eq!(log_ticks(0.13, 1.4), [0.2, 0.5, 1.0]);
        assert_eq!(log_ticks(1.5, 65.0), [2.0, 5.0, 10.0, 20.0, 50.0]);
        assert_eq!(log_ticks(0.5, 2e3), [1.0, 10.0, 100.0, 1000.0]);
        assert_eq!(log_ticks(1e-12, 1.0).len(), 7);
        // Values that vary little.
        assert_eq!(log_ticks(0.231, 0.455), [0.25, 0.3, 0.35, 0.4, 0.45]);
        assert_eq!(log_ticks(2.7, 3.8), [3.0, 3.5]);
        // The largest set that fits.
        assert!(log_ticks(1.0, 999.0).len() <= ACROSS);
    }

    #[test]
    fn an_axis_of_equal_ratios_is_logarithmic() {
        for (values, expected) in [
            (&[4.0, 16.0, 64.0, 256.0][..], true),
            (&[1.0, 2.0, 5.0, 10.0, 20.0, 50.0], true),
            (&[2.0, 4.0, 10.0, 50.0], true),
            (&[1.0, 2.0, 4.0], false),
            (&[0.0, 20.0, 100.0, 400.0], false),
            (&[-1.0, 10.0, 100.0], false),
            (&[1.0, 20.0, 40.0, 60.0], false),
            (&[1.0, 100.0], false),
            (&[], false),
        ] {
            assert_eq!(is_logarithmic(values), expected, "{values:?}");
        }
    }
}
