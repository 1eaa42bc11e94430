//! Curves with points and a legend, alike in all plots.

use plotters::coord::ranged1d::Ranged;
use plotters::prelude::*;

/// A plot in a file, with numbers along both axes.
type Chart<'a, X, Y> = ChartContext<'a, SVGBackend<'a>, Cartesian2d<X, Y>>;

/// Draws a curve through points and names it in the legend.
pub(crate) fn draw<'a, X, Y>(
    chart: &mut Chart<'a, X, Y>,
    name: String,
    color: RGBColor,
    points: impl Iterator<Item = (f64, f64)>,
) -> anyhow::Result<()>
where
    X: Ranged<ValueType = f64> + 'a,
    Y: Ranged<ValueType = f64> + 'a,
{
    chart
        .draw_series(LineSeries::new(points, color.stroke_width(2)).point_size(3))?
        .label(name)
        .legend(move |(x, y)| PathElement::new([(x, y), (x + 24, y)], color.stroke_width(2)));
    Ok(())
}

/// Draws the legend.
pub(crate) fn legend<'a, X, Y>(chart: &mut Chart<'a, X, Y>, place: SeriesLabelPosition) -> anyhow::Result<()>
where
    X: Ranged<ValueType = f64> + 'a,
    Y: Ranged<ValueType = f64> + 'a,
{
    chart
        .configure_series_labels()
        .position(place)
        .label_font(("sans-serif", 14))
        .background_style(WHITE.mix(0.9))
        .border_style(RGBColor(180, 180, 180))
        .draw()?;
    Ok(())
}
