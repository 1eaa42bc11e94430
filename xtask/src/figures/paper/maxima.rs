//! Fig. 3C and D: maximum intensity against depth, compared with the original program.

use std::path::Path;

use microsig_core::Settings;
use plotters::prelude::*;
use suite::maxima::{self, Maximum};

struct Plot {
    name: &'static str,
    title: &'static str,
    settings: Settings,
    d_um: f64,
}

pub(super) fn draw(out: &Path) -> anyhow::Result<()> {
    let plots = [
        Plot {
            name: "fig3c",
            title: "Setting 1: M 10, NA 0.3, 2 µm particle",
            settings: Settings::setting1(),
            d_um: 2.0,
        },
        Plot {
            name: "fig3d",
            title: "Setting 2: M 63, NA 0.75, 1 µm particle",
            settings: Settings::setting2(),
            d_um: 1.0,
        },
    ];
    let mut table = csv::Writer::from_path(out.join("maxima.csv"))?;
    table.write_record([
        "figure",
        "z_um",
        "ours_mean",
        "ours_deviation",
        "original_mean",
        "original_deviation",
    ])?;
    for plot in plots {
        let theirs = maxima::read(&suite::data().join(format!("optics/{}.csv", plot.name)))?;
        let depths: Vec<f64> = theirs.iter().map(|m| m.z_um).collect();
        let ours = maxima::curve(&plot.settings, plot.d_um, &depths, 1, 50)?;
        for (a, b) in ours.iter().zip(&theirs) {
            let numbers = [a.z_um, a.mean, a.deviation, b.mean, b.deviation].map(|v| format!("{v:.2}"));
            table.write_record(std::iter::once(plot.name.to_owned()).chain(numbers))?;
        }
        plot.draw(out, &ours, &theirs)?;
    }
    Ok(table.flush()?)
}

impl Plot {
    fn draw(&self, out: &Path, ours: &[Maximum], theirs: &[Maximum]) -> anyhow::Result<()> {
        let path = out.join(format!("{}.svg", self.name));
        let area = SVGBackend::new(&path, (760, 460)).into_drawing_area();
        area.fill(&WHITE)?;
        let top = ours.iter().map(|m| m.mean + m.deviation).fold(0.0, f64::max);
        let (first, last) = (ours[0].z_um, ours[ours.len() - 1].z_um);
        let mut chart = ChartBuilder::on(&area)
            .caption(self.title, ("sans-serif", 20))
            .margin(12)
            .margin_right(24)
            .x_label_area_size(50)
            .y_label_area_size(72)
            .build_cartesian_2d(first..last, 0.0..top * 1.08)?;
        chart
            .configure_mesh()
            .x_desc("depth z, µm (grows away from the lens)")
            .y_desc("maximum of the image, counts")
            .axis_desc_style(("sans-serif", 16))
            .label_style(("sans-serif", 15))
            .x_label_formatter(&|z| format!("{z:.0}"))
            .y_label_formatter(&|v| format!("{v:.0}"))
            .light_line_style(WHITE)
            .bold_line_style(RGBColor(225, 225, 225))
            .draw()?;

        let blue = RGBColor(0, 90, 181);
        let orange = RGBColor(220, 80, 0);
        let upper = ours.iter().map(|m| (m.z_um, m.mean + m.deviation));
        let lower = ours.iter().rev().map(|m| (m.z_um, m.mean - m.deviation));
        chart
            .draw_series([Polygon::new(upper.chain(lower).collect::<Vec<_>>(), blue.mix(0.25))])?
            .label("± its standard deviation")
            .legend(move |(x, y)| Rectangle::new([(x, y - 6), (x + 24, y + 6)], blue.mix(0.25).filled()));
        chart
            .draw_series(LineSeries::new(ours.iter().map(|m| (m.z_um, m.mean)), blue.stroke_width(2)))?
            .label("ours, mean of 50 images")
            .legend(move |(x, y)| PathElement::new([(x, y), (x + 24, y)], blue.stroke_width(2)));
        chart
            .draw_series(theirs.iter().map(|m| Circle::new((m.z_um, m.mean), 3, orange.filled())))?
            .label("original program, mean of 10")
            .legend(move |(x, y)| Circle::new((x + 12, y), 3, orange.filled()));
        chart
            .configure_series_labels()
            .position(SeriesLabelPosition::UpperLeft)
            .label_font(("sans-serif", 15))
            .background_style(WHITE.mix(0.9))
            .border_style(RGBColor(180, 180, 180))
            .margin(10)
            .draw()?;
        area.present()?;
        Ok(())
    }
}
