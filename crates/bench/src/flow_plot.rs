//! Plot of a velocity field: speed in a plane of the default scene, and streamlines.

use std::ops::Range;

use base64::Engine;
use flows::VelocityField;
use flows::registry::{FieldEntry, PlotPlane};
use flows::{Axis, Region};
use glam::DVec3;
use image::RgbImage;
use plotters::prelude::*;

use generator::preview::tick_label;
use storage::error::{Error, Result};

/// The default scene, um: field of view of setting 1 in a channel 100 um deep.
const SCENE: (DVec3, DVec3) = (DVec3::new(-242.0, -118.0, -80.0), DVec3::new(242.0, 118.0, 20.0));

/// Cells of the speed map along the longer side.
const CELLS: u32 = 160;
/// Streamline seeds along the longer side.
const SEEDS: u32 = 13;
/// Steps of a streamline in each direction from its seed.
const STEPS: u32 = 30;

/// The plot at time 0 as SVG.
pub fn svg(entry: &FieldEntry) -> Result<String> {
    let field = (entry.make)()?;
    draw(entry, field.as_ref()).map_err(|e| Error::input(format!("{}: {e}", entry.name)))
}

/// The horizontal and the vertical axis of a plot plane.
fn axes(plane: PlotPlane) -> (Axis, Axis) {
    match plane.across {
        Axis::X => (Axis::Y, Axis::Z),
        Axis::Y => (Axis::X, Axis::Z),
        Axis::Z => (Axis::X, Axis::Y),
    }
}

fn name(axis: Axis) -> &'static str {
    match axis {
        Axis::X => "x",
        Axis::Y => "y",
        Axis::Z => "z",
    }
}

type Drawn<T> = std::result::Result<T, Box<dyn std::error::Error>>;

fn draw(entry: &FieldEntry, field: &dyn VelocityField) -> Drawn<String> {
    let plane = entry.plane;
    let (right, down) = axes(plane);
    let scene = Region::new(SCENE.0, SCENE.1)?;
    let (low, high) = (scene.min(), scene.max());
    let span = |axis: Axis| (low[axis as usize], high[axis as usize]);
    let ((u0, u1), (v0, v1)) = (span(right), span(down));
    let at = |u: f64, v: f64| right.unit() * u + down.unit() * v + plane.across.unit() * plane.at_um;

    let width = 820u32;
    let height = ((f64::from(width) - 170.0) * (v1 - v0) / (u1 - u0)) as u32 + 110;
    let mut plot = String::new();
    let root = SVGBackend::with_string(&mut plot, (width, height)).into_drawing_area();
    let (picture, key) = root.split_horizontally(width - 90);
    // Rows grow downward, as in the image; depth grows upward, away from the lens.
    let (bottom, top) = if down == Axis::Y { (v1, v0) } else { (v0, v1) };
    let position = match plane.across {
        Axis::Z => format!("z = {} um", plane.at_um),
        other => format!("{} = {} um", name(other), plane.at_um),
    };
    let mut chart = ChartBuilder::on(&picture)
        .caption(format!("{}: speed and streamlines at {position}, t = 0", entry.name), ("sans-serif", 18))
        .margin(8)
        .x_label_area_size(40)
        .y_label_area_size(55)
        .build_cartesian_2d(u0..u1, bottom..top)?;
    let label = |axis: Axis| match axis {
        Axis::Y => "y, um (downward)".to_owned(),
        Axis::Z => "z, um (away from the lens)".to_owned(),
        Axis::X => "x, um".to_owned(),
    };
    chart
        .configure_mesh()
        .disable_mesh()
        .x_desc(label(right))
        .y_desc(label(down))
        .x_label_formatter(&|u| tick_label(*u, &(u0..u1)))
        .y_label_formatter(&|v| tick_label(*v, &(v0..v1)))
        .label_style(("sans-serif", 13))
        .draw()?;

    let map = SpeedMap::new(field, &at, (u0, u1), (v0, v1), bottom < top);
    let fastest = map.fastest;
    let seeds_down = (f64::from(SEEDS) * (v1 - v0) / (u1 - u0)).ceil().max(5.0) as u32;
    let ink = RGBColor(20, 20, 20).mix(0.75);
    for j in 0..seeds_down {
        for i in 0..SEEDS {
            let u = u0 + (u1 - u0) * (f64::from(i) + 0.5) / f64::from(SEEDS);
            let v = v0 + (v1 - v0) * (f64::from(j) + 0.5) / f64::from(seeds_down);
            let line = streamline(field, (right, down), at(u, v), &scene, (u1 - u0) / 400.0, fastest);
            let line: Vec<(f64, f64)> = line.iter().map(|x| (x[right as usize], x[down as usize])).collect();
            if line.len() > 4 {
                chart.draw_series(std::iter::once(PathElement::new(line.clone(), ink.stroke_width(1))))?;
                chart.draw_series(
                    arrow(&line, (u1 - u0) / 90.0).map(|head| Polygon::new(head, ink.filled())),
                )?;
            }
        }
    }
    color_key(&key, fastest, height)?;
    root.present()?;
    let area = chart.plotting_area().get_pixel_range();
    drop((chart, picture, key, root));
    Ok(format!(
        "<svg width=\"{width}\" height=\"{height}\" viewBox=\"0 0 {width} {height}\" xmlns=\"http://www.w3.org/2000/svg\">\n\
         <rect width=\"100%\" height=\"100%\" fill=\"#FFFFFF\"/>\n{}\n{plot}</svg>\n",
        map.image(area)?
    ))
}

/// Speed in a plane, as an image.
struct SpeedMap {
    pixels: RgbImage,
    fastest: f64,
}

impl SpeedMap {
    fn new(
        field: &dyn VelocityField,
        at: &dyn Fn(f64, f64) -> DVec3,
        (u0, u1): (f64, f64),
        (v0, v1): (f64, f64),
        upward: bool,
    ) -> Self {
        let rows = (f64::from(CELLS) * (v1 - v0) / (u1 - u0)).ceil() as u32;
        let (du, dv) = ((u1 - u0) / f64::from(CELLS), (v1 - v0) / f64::from(rows));
        let speed = |i: u32, j: u32| {
            let j = if upward { rows - 1 - j } else { j };
            field.velocity(at(u0 + du * (f64::from(i) + 0.5), v0 + dv * (f64::from(j) + 0.5)), 0.0).length()
        };
        // The scale ends at the 99.5 % quantile, because the speed diverges near singular points.
        let mut speeds: Vec<f64> = (0..rows)
            .flat_map(|j| (0..CELLS).map(move |i| (i, j)))
            .map(|(i, j)| speed(i, j))
            .filter(|s| s.is_finite())
            .collect();
        speeds.sort_by(f64::total_cmp);
        let fastest =
            speeds.get(speeds.len().saturating_sub(1) * 995 / 1000).copied().unwrap_or(0.0).max(1e-12);
        let pixels = RgbImage::from_fn(CELLS, rows, |i, j| {
            let RGBColor(r, g, b) =
                shade(Some(speed(i, j)).filter(|s| s.is_finite()).unwrap_or(0.0) / fastest);
            image::Rgb([r, g, b])
        });
        SpeedMap { pixels, fastest }
    }

    /// The map as an element of an SVG file, from the centers of the first to the last of these columns
    /// and rows, as plotters places axes; it would write thousands of rectangles.
    fn image(&self, (columns, rows): (Range<i32>, Range<i32>)) -> Drawn<String> {
        let mut png = std::io::Cursor::new(Vec::new());
        self.pixels.write_to(&mut png, image::ImageFormat::Png)?;
        Ok(format!(
            "<image x=\"{}\" y=\"{}\" width=\"{}\" height=\"{}\" preserveAspectRatio=\"none\" \
             href=\"data:image/png;base64,{}\"/>",
            columns.start,
            rows.start,
            columns.len() - 1,
            rows.len() - 1,
            base64::engine::general_purpose::STANDARD.encode(png.get_ref())
        ))
    }
}

/// A short streamline of the in-plane velocity, in both directions from a seed.
fn streamline(
    field: &dyn VelocityField,
    (right, down): (Axis, Axis),
    seed: DVec3,
    scene: &Region,
    step: f64,
    fastest: f64,
) -> Vec<DVec3> {
    let direction = |x: DVec3| {
        let velocity = field.velocity(x, 0.0);
        let inside = right.unit() * velocity[right as usize] + down.unit() * velocity[down as usize];
        (inside.length() > 1e-6 * fastest).then(|| inside.normalize_or_zero())
    };
    let follow = |sign: f64| {
        let mut line = Vec::new();
        let mut x = seed;
        for _ in 0..STEPS {
            // The midpoint rule is accurate enough for a plot.
            let next = direction(x)
                .and_then(|d| direction(x + d * (0.5 * sign * step)))
                .map(|d| x + d * (sign * step))
                .filter(|next| next.is_finite() && scene.contains(*next));
            let Some(next) = next else { break };
            line.push(next);
            x = next;
        }
        line
    };
    let mut line = follow(-1.0);
    line.reverse();
    line.push(seed);
    line.extend(follow(1.0));
    line
}

/// An arrow head in the middle of a line.
fn arrow(line: &[(f64, f64)], size: f64) -> impl Iterator<Item = Vec<(f64, f64)>> {
    let middle = line.len() / 2;
    let (from, to) = (line[middle.saturating_sub(1)], line[(middle + 1).min(line.len() - 1)]);
    let (dx, dy) = (to.0 - from.0, to.1 - from.1);
    let length = dx.hypot(dy);
    (length > 0.0)
        .then(|| {
            let (dx, dy) = (dx / length * size, dy / length * size);
            let (x, y) = line[middle];
            vec![
                (x + dx, y + dy),
                (x - 0.5 * dx - 0.6 * dy, y - 0.5 * dy + 0.6 * dx),
                (x - 0.5 * dx + 0.6 * dy, y - 0.5 * dy - 0.6 * dx),
            ]
        })
        .into_iter()
}

fn color_key(
    area: &DrawingArea<SVGBackend<'_>, plotters::coord::Shift>,
    fastest: f64,
    height: u32,
) -> Drawn<()> {
    let (top, bottom) = (40i32, height as i32 - 60);
    let n = 60;
    for i in 0..n {
        let y = |i: i32| bottom - (bottom - top) * i / n;
        let color = shade((f64::from(i) + 0.5) / f64::from(n));
        area.draw(&Rectangle::new([(5, y(i + 1)), (23, y(i))], color.filled()))?;
    }
    let style = ("sans-serif", 12).into_font();
    for (share, y) in [(0.0, bottom), (0.5, (top + bottom) / 2), (1.0, top)] {
        let speed = fastest * share;
        let digits = if fastest >= 100.0 {
            0
        } else if fastest >= 1.0 {
            1
        } else {
            3
        };
        area.draw(&Text::new(format!("{speed:.digits$}"), (28, y - 6), style.clone()))?;
    }
    area.draw(&Text::new("um/s", (5, top - 20), style))?;
    Ok(())
}

/// Color map from white through blue-green to dark blue: roughly perceptually uniform, and monotonic in
/// grayscale.
fn shade(share: f64) -> RGBColor {
    const STOPS: [(f64, f64, f64); 4] =
        [(255.0, 255.0, 255.0), (178.0, 216.0, 216.0), (66.0, 146.0, 198.0), (8.0, 64.0, 129.0)];
    let position = share.clamp(0.0, 1.0) * 3.0;
    let (i, rest) = ((position as usize).min(2), position - (position as usize).min(2) as f64);
    let mix = |a: f64, b: f64| (a + (b - a) * rest) as u8;
    let (a, b) = (STOPS[i], STOPS[i + 1]);
    RGBColor(mix(a.0, b.0), mix(a.1, b.1), mix(a.2, b.2))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_field_has_a_picture() {
        for entry in flows::registry::ENTRIES {
            let picture = svg(entry).unwrap();
            assert!(
                picture.starts_with("<svg") && picture.contains("<polyline") && picture.contains("<image"),
                "{}",
                entry.name
            );
        }
    }
}
