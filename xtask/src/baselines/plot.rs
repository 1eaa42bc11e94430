//! Plot of precision, recall and depth error against density.

use std::path::Path;

use plotters::prelude::*;

use super::Scored;

/// The curves: group, tracker, label and color.
const CURVES: [(&str, &str, &str, RGBColor); 5] = [
    ("spherical", "ncc", "ncc, spherical lens", RGBColor(0, 90, 181)),
    ("spherical", "mle", "mle, spherical lens", RGBColor(120, 60, 160)),
    ("astigmatic", "ncc", "ncc, astigmatic", RGBColor(220, 80, 0)),
    ("astigmatic", "mle", "mle, astigmatic", RGBColor(180, 150, 0)),
    ("astigmatic", "aptv", "aptv, astigmatic", RGBColor(0, 130, 80)),
];

/// The panels: label, path in score.json, unit factor, and upper limit.
const PANELS: [(&str, &str, f64, f64); 3] = [
    ("precision", "/detection/precision", 1.0, 1.0),
    ("recall", "/detection/recall", 1.0, 1.0),
    ("sigma_z / h, %", "/gdpt/sigma_z_over_h", 100.0, 4.0),
];

/// Writes `defocused.svg`.
pub(super) fn write(out: &Path, scored: &[Scored]) -> anyhow::Result<()> {
    let path = out.join("defocused.svg");
    let area = SVGBackend::new(&path, (1080, 400)).into_drawing_area();
    area.fill(&WHITE)?;
    let right = 1.05 * scored.iter().filter(|s| s.tracker == "ncc").map(|s| s.n_s).fold(0.1, f64::max);
    for (panel, (name, pointer, unit, top)) in area.split_evenly((1, 3)).iter().zip(PANELS) {
        let mut chart = ChartBuilder::on(panel)
            .caption(name, ("sans-serif", 18))
            .margin(10)
            .x_label_area_size(44)
            .y_label_area_size(44)
            .build_cartesian_2d(0.0..right, 0.0..1.02 * top)?;
        chart
            .configure_mesh()
            .x_desc("N_S")
            .axis_desc_style(("sans-serif", 15))
            .label_style(("sans-serif", 14))
            .x_labels(6)
            .light_line_style(WHITE)
            .bold_line_style(RGBColor(225, 225, 225))
            .draw()?;
        for (group, tracker, label, color) in CURVES {
            // Low noise in full color, high noise pale.
            for (noise, shade) in [(10.0, 1.0), (50.0, 0.45)] {
                let style = color.mix(shade).stroke_width(2);
                let chosen =
                    scored.iter().filter(|s| s.group == group && s.tracker == tracker && s.noise == noise);
                let points = chosen.filter_map(|s| Some((s.n_s, (unit * s.value(pointer)?).min(top))));
                chart
                    .draw_series(LineSeries::new(points, style).point_size(3))?
                    .label(format!("{label}, noise {noise}"))
                    .legend(move |(x, y)| PathElement::new([(x, y), (x + 20, y)], style));
            }
        }
        if name == "precision" {
            chart
                .configure_series_labels()
                .position(SeriesLabelPosition::LowerLeft)
                .label_font(("sans-serif", 13))
                .background_style(WHITE.mix(0.9))
                .border_style(RGBColor(180, 180, 180))
                .draw()?;
        }
    }
    area.present()?;
    Ok(())
}
