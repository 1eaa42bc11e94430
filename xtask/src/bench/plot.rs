//! Plots of the growth of run time and memory.

use std::path::Path;

use plotters::prelude::*;

use super::workload::GROWTH;
use super::{Measured, Record};

const COLORS: [RGBColor; 5] = [
    RGBColor(0, 90, 181),
    RGBColor(220, 80, 0),
    RGBColor(0, 130, 80),
    RGBColor(150, 60, 160),
    RGBColor(90, 90, 90),
];

/// A curve: its name, and its points relative to the smallest workload.
type Curve = (String, Vec<(f64, f64)>);

/// Writes `growth.svg` (CPU time) and `memory.svg` (peak memory).
pub(super) fn write(out: &Path, record: &Record) -> anyhow::Result<()> {
    let curves = |of: fn(&Measured) -> f64, relative: bool| -> Vec<Curve> {
        let curve = |(group, unit): (&str, &str)| {
            let members: Vec<&Measured> =
                record.measured.iter().filter(|m| m.workload.group == group).collect();
            let first = members.first()?;
            let unit_of_y = if relative { of(first) } else { 1.0 };
            let points = members.iter().map(|m| (m.workload.size / first.workload.size, of(m) / unit_of_y));
            Some((format!("{group} (from {} {unit})", first.workload.size.round()), points.collect()))
        };
        GROWTH.into_iter().filter_map(curve).collect()
    };
    let time = curves(|m| m.usage.cpu_s, true);
    if time.is_empty() {
        return Ok(());
    }
    draw(
        &out.join("growth.svg"),
        "CPU time against size, both relative to the smallest size",
        "CPU time",
        &time,
        true,
    )?;
    let memory = curves(|m| m.usage.peak_mb, false);
    draw(&out.join("memory.svg"), "Peak memory against size", "peak memory, MB", &memory, false)
}

fn draw(path: &Path, title: &str, y_name: &str, curves: &[Curve], proportional: bool) -> anyhow::Result<()> {
    let points = || curves.iter().flat_map(|(_, points)| points);
    let top = points().map(|p| p.1).fold(1.0, f64::max) * 1.3;
    let bottom = points().map(|p| p.1).fold(f64::INFINITY, f64::min).min(top / 2.0) / 1.3;
    let right = points().map(|p| p.0).fold(2.0, f64::max) * 1.15;
    let area = SVGBackend::new(path, (760, 460)).into_drawing_area();
    area.fill(&WHITE)?;
    let mut chart = ChartBuilder::on(&area)
        .caption(title, ("sans-serif", 20))
        .margin(12)
        .margin_right(24)
        .x_label_area_size(50)
        .y_label_area_size(72)
        .build_cartesian_2d((0.9..right).log_scale(), (bottom..top).log_scale())?;
    chart
        .configure_mesh()
        .x_desc("size relative to the smallest")
        .y_desc(y_name)
        .axis_desc_style(("sans-serif", 16))
        .label_style(("sans-serif", 15))
        .x_label_formatter(&|x| format!("{x:.0}"))
        .y_label_formatter(&|y| if *y < 10.0 { format!("{y:.1}") } else { format!("{y:.0}") })
        .light_line_style(WHITE)
        .bold_line_style(RGBColor(225, 225, 225))
        .draw()?;
    if proportional {
        let line = [(1.0, 1.0), (right, right)].into_iter().filter(|p| p.1 <= top);
        let line = line.chain((right > top).then_some((top, top)));
        chart
            .draw_series(LineSeries::new(line, BLACK.mix(0.4)))?
            .label("proportional")
            .legend(|(x, y)| PathElement::new([(x, y), (x + 24, y)], BLACK.mix(0.4)));
    }
    for ((name, points), color) in curves.iter().zip(COLORS) {
        chart
            .draw_series(LineSeries::new(points.iter().copied(), color.stroke_width(2)).point_size(3))?
            .label(name)
            .legend(move |(x, y)| PathElement::new([(x, y), (x + 24, y)], color.stroke_width(2)));
    }
    chart
        .configure_series_labels()
        .position(if proportional { SeriesLabelPosition::UpperLeft } else { SeriesLabelPosition::LowerRight })
        .label_font(("sans-serif", 14))
        .background_style(WHITE.mix(0.9))
        .border_style(RGBColor(180, 180, 180))
        .margin(10)
        .draw()?;
    area.present()?;
    Ok(())
}
