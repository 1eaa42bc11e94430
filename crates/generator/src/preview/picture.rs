//! A preview as a picture: strips of one particle over depth, and curves of peak and size.

use base64::Engine;
use image::GrayImage;
use plotters::coord::Shift;
use plotters::prelude::*;

use super::{DepthFacts, Preview, tick_label};
use microsig_core::visibility::{DepthScan, ScanImage};
use storage::error::{Error, Result};

/// Width of the picture.
const WIDTH: u32 = 960;
/// Margin left of the strips and curves.
const LEFT: i32 = 60;
/// Images of a strip.
const TILES: usize = 11;
/// Width of an image and the gap to the next, in the picture's units.
const TILE: i32 = 76;
const GAP: i32 = 4;
/// Height of the caption of a strip, and of the depths below it.
const CAPTION: i32 = 24;
const DEPTHS: i32 = 18;
/// Space for the ticks and the label of a vertical axis: six digits.
const BESIDE: u32 = 76;
/// Height of a chart.
const CHART: u32 = 300;
/// Longest side of an image that is shown, px.
const MOST_PX: usize = 121;
/// Colors of sizes, distinguishable in grayscale and with color-blindness.
const COLORS: [RGBColor; 8] = [
    RGBColor(0, 90, 160),
    RGBColor(200, 80, 0),
    RGBColor(90, 90, 90),
    RGBColor(0, 150, 110),
    RGBColor(190, 110, 160),
    RGBColor(80, 170, 230),
    RGBColor(220, 160, 0),
    RGBColor(0, 0, 0),
];

type Drawn<T> = std::result::Result<T, Box<dyn std::error::Error>>;
type Area<'a> = DrawingArea<SVGBackend<'a>, Shift>;

/// The picture as SVG.
///
/// # Errors
/// [`Error::Input`] if the picture cannot be drawn.
pub fn svg(preview: &Preview) -> Result<String> {
    let strips: Vec<Strip> = preview.scans.iter().map(Strip::new).collect();
    let row = CAPTION + TILE + DEPTHS;
    let height = strips.len() as u32 * row as u32 + 2 * CHART;
    let mut text = String::new();
    charts(preview, &mut text, (WIDTH, height), strips.len() as i32 * row)
        .map_err(|e| Error::input(format!("{}: picture of the optics: {e}", preview.name)))?;
    let end = text.rfind("</svg>").unwrap_or(text.len());
    let mut images = String::new();
    for (i, (strip, size)) in strips.iter().zip(&preview.sizes).enumerate() {
        images += &strip.svg(i as i32 * row, size.d_um)?;
    }
    text.insert_str(end, &images);
    Ok(text)
}

/// Images of one size, from the lowest depth to the highest.
struct Strip {
    /// Depth and gray image of each tile.
    tiles: Vec<(f64, GrayImage)>,
    side_px: usize,
}

impl Strip {
    fn new(scan: &DepthScan) -> Self {
        let last = scan.images.len() - 1;
        let shown: Vec<usize> = (0..TILES).map(|i| i * last / (TILES - 1)).collect();
        let largest = shown.iter().map(|i| 2 * scan.images[*i].half_px + 3).max().unwrap_or(1);
        let side_px = largest.min(MOST_PX);
        let tiles = shown.iter().map(|i| (scan.depths_um[*i], tile(&scan.images[*i], side_px))).collect();
        Strip { tiles, side_px }
    }

    fn svg(&self, top: i32, d_um: f64) -> Result<String> {
        let place = top + CAPTION - 8;
        let mut text = format!(
            "<text x=\"{LEFT}\" y=\"{place}\" font-family=\"sans-serif\" font-size=\"14\">{d_um} um; square roots of the light, \
             each image on its own scale and {} px wide</text>\n",
            self.side_px
        );
        for (i, (z_um, tile)) in self.tiles.iter().enumerate() {
            let mut png = std::io::Cursor::new(Vec::new());
            tile.write_to(&mut png, image::ImageFormat::Png)
                .map_err(|e| Error::input(format!("picture: {e}")))?;
            let data = base64::engine::general_purpose::STANDARD.encode(png.get_ref());
            let (x, y) = (LEFT + i as i32 * (TILE + GAP), top + CAPTION);
            text += &format!(
                "<image x=\"{x}\" y=\"{y}\" width=\"{TILE}\" height=\"{TILE}\" style=\"image-rendering:pixelated\" \
                 href=\"data:image/png;base64,{data}\"/>\n\
                 <text x=\"{}\" y=\"{}\" text-anchor=\"middle\" font-family=\"sans-serif\" font-size=\"11\">{z_um:.1}</text>\n",
                x + TILE / 2,
                y + TILE + 13
            );
        }
        Ok(text)
    }
}

/// The central part of an image in gray.
fn tile(spot: &ScanImage, side_px: usize) -> GrayImage {
    let (of_spot, half) = (2 * spot.half_px + 1, side_px / 2);
    GrayImage::from_fn(side_px as u32, side_px as u32, |x, y| {
        let at = |v: u32| (v as usize + spot.half_px).checked_sub(half).filter(|v| *v < of_spot);
        let light = at(x).zip(at(y)).map_or(0.0, |(x, y)| spot.light[y * of_spot + x]);
        let share = light / spot.peak.max(f64::MIN_POSITIVE);
        image::Luma([(255.0 * share.max(0.0).sqrt()).round() as u8])
    })
}

fn charts(preview: &Preview, text: &mut String, size: (u32, u32), top: i32) -> Drawn<()> {
    let root = SVGBackend::with_string(text, size).into_drawing_area();
    root.fill(&WHITE)?;
    let (_, curves) = root.split_vertically(top);
    let (upper, lower) = curves.split_vertically(CHART);
    peaks(preview, &upper)?;
    sizes(preview, &lower)?;
    root.present()?;
    Ok(())
}

/// Peaks over depth, with saturation and noise.
fn peaks(preview: &Preview, area: &Area<'_>) -> Drawn<()> {
    let all = || preview.sizes.iter().flat_map(|size| &size.depths).map(|depth| depth.peak_counts);
    let highest = all().fold(0.0, f64::max).max(1e-9);
    let room = preview.saturation_counts - preview.background_counts;
    let noise = preview.background_noise_counts;
    let lowest = all().filter(|peak| *peak > 0.0).fold(highest, f64::min);
    let low = if noise > 0.0 { lowest.min(noise) } else { lowest };
    let high = if room < 20.0 * highest { highest.max(room) } else { highest };
    let (z0, z1) = preview.depth_range_um;
    let mut chart = ChartBuilder::on(area)
        .margin(8)
        .margin_right(20)
        .x_label_area_size(38)
        .y_label_area_size(BESIDE)
        .build_cartesian_2d(z0..z1, (0.7 * low..1.5 * high).log_scale())?;
    let (depths, counts) = (chart.x_range(), chart.y_range());
    chart
        .configure_mesh()
        .light_line_style(TRANSPARENT)
        .x_desc("z, um (away from the lens)")
        .y_desc("peak, counts above the background")
        .x_label_formatter(&|z| tick_label(*z, &depths))
        .y_label_formatter(&|peak| tick_label(*peak, &counts))
        .label_style(("sans-serif", 13))
        .draw()?;
    // Each label is on the side of its line that lies within the chart.
    for (name, level, top) in [("noise of the background", noise, 1.8), ("saturation", room, 0.97)] {
        if level > 0.0 && level <= 1.5 * high {
            let line = [(z0, level), (z1, level)];
            chart.draw_series(DashedLineSeries::new(line, 5, 4, BLACK.stroke_width(1)))?;
            let style = ("sans-serif", 12).into_font();
            chart.draw_series(std::iter::once(Text::new(
                name,
                (z0 + 0.01 * (z1 - z0), level * top),
                style,
            )))?;
        }
    }
    for (size, color) in preview.sizes.iter().zip(COLORS) {
        let points = size.depths.iter().filter(|d| d.peak_counts > 0.0).map(|d| (d.z_um, d.peak_counts));
        chart
            .draw_series(LineSeries::new(points, color.stroke_width(2)))?
            .label(format!("{} um", size.d_um))
            .legend(move |(x, y)| PathElement::new([(x, y), (x + 16, y)], color.stroke_width(2)));
    }
    chart.configure_series_labels().border_style(BLACK.mix(0.3)).background_style(WHITE.mix(0.8)).draw()?;
    Ok(())
}

/// Width and height of images over depth.
fn sizes(preview: &Preview, area: &Area<'_>) -> Drawn<()> {
    let of_depth = |depth: &DepthFacts| depth.width_px.max(depth.height_px);
    let largest = preview.sizes.iter().flat_map(|size| &size.depths).map(of_depth).fold(1.0, f64::max);
    let (z0, z1) = preview.depth_range_um;
    let mut chart = ChartBuilder::on(area)
        .margin(8)
        .margin_right(20)
        .x_label_area_size(38)
        .y_label_area_size(BESIDE)
        .build_cartesian_2d(z0..z1, 0.0..1.08 * largest)?;
    let (depths, pixels) = (chart.x_range(), chart.y_range());
    chart
        .configure_mesh()
        .light_line_style(TRANSPARENT)
        .x_desc("z, um (away from the lens)")
        .y_desc("width (full) and height (dashed), px")
        .x_label_formatter(&|z| tick_label(*z, &depths))
        .y_label_formatter(&|size| tick_label(*size, &pixels))
        .label_style(("sans-serif", 13))
        .draw()?;
    for (size, color) in preview.sizes.iter().zip(COLORS) {
        let width = size.depths.iter().map(|depth| (depth.z_um, depth.width_px));
        let height = size.depths.iter().map(|depth| (depth.z_um, depth.height_px));
        chart.draw_series(LineSeries::new(width, color.stroke_width(2)))?;
        chart.draw_series(DashedLineSeries::new(height, 6, 4, color.stroke_width(2)))?;
    }
    let airy = 2.0 * preview.airy_radius_px;
    if airy < 1.08 * largest {
        chart.draw_series(DashedLineSeries::new([(z0, airy), (z1, airy)], 2, 4, BLACK.stroke_width(1)))?;
        let style = ("sans-serif", 12).into_font();
        let place = (z0 + 0.01 * (z1 - z0), airy + 0.05 * largest);
        chart.draw_series(std::iter::once(Text::new("Airy disc", place, style)))?;
    }
    Ok(())
}
