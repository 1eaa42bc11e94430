//! Plots of errors of depth against planes of known height: over height, over the distance from the middle,
//! and over the field of view.

use maud::Markup;

use super::figure::{error_map, figure_of, histogram, names};
use super::plots::{AxisLabels, Series, lines};
use scoring::evaluate::Score;
use scoring::evaluate::planes::{PlaneBin, PlanePoint, PlaneScore};
use storage::error::Result;

/// The plots; none without such errors.
pub(super) fn plots(
    score: &Score,
    points: &[PlanePoint],
    sensor_px: Option<(f64, f64)>,
) -> Result<Vec<Markup>> {
    let Some(PlaneScore { over_height, over_radius, gate_z_um, .. }) = &score.planes else {
        return Ok(Vec::new());
    };
    let mut plots = vec![over("height of the plane, um", over_height)?];
    if !over_radius.is_empty() {
        plots.push(over("distance from the middle of the image, px", over_radius)?);
    }
    let within = || points.iter().filter(|point| point.error_um.abs() < *gate_z_um);
    plots.extend(histogram("error of z, um", "number of points", within().map(|point| point.error_um))?);
    if let Some(size) = sensor_px {
        let errors = within().map(|point| ((point.x_px, point.y_px), point.error_um.abs()));
        plots.extend(error_map(
            size,
            errors,
            ("um", "RMS error of z over the sensor; cells without points are empty."),
        )?);
    }
    Ok(plots)
}

fn over(x: &str, bins: &[PlaneBin]) -> Result<Markup> {
    let series = |name: &str, value: fn(&PlaneBin) -> Option<f64>| {
        let point = |bin: &PlaneBin| (f64::midpoint(bin.from, bin.to), value(bin).unwrap_or(f64::NAN));
        Series::new(name, bins.iter().map(point).collect())
    };
    let bias = series("bias", |bin| bin.bias_z_um);
    let bars = bins.iter().map(|bin| {
        let (bias, random) = (bin.bias_z_um.unwrap_or(f64::NAN), bin.random_z_um.unwrap_or(f64::NAN));
        (bias - random, bias + random)
    });
    let all = [bias.with_bars(bars.collect()), series("RMS", |bin| bin.rms_z_um)];
    let svg = lines(&AxisLabels { x, y: "error of z, um", title: "Error of z" }, &all)?;
    let caption = format!(
        "Errors of z within the gate against the {x}; bars: one standard deviation of the random error."
    );
    Ok(figure_of(svg, &names(&all), &caption))
}
