//! Optics as a picture for a column of a paper (85 mm): images of one particle over depth, and curves of peak, size and bounds.

use base64::Engine;
use image::GrayImage;
use image::imageops::{FilterType, resize};
use plotters::coord::Shift;
use plotters::coord::ranged1d::ValueFormatter;
use plotters::coord::types::RangedCoordf64;
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};

use super::{Optics, letter};
use arena::report::{MOST_LINES, log_ticks, markers, sign};
use generator::preview::{SizeCurves, tick_label};
use microsig_core::visibility::{DepthScan, ScanImage};
use scoring::evaluate::crlb::{DepthBound, DepthBounds, PositionBound};
use storage::error::{Error, Result};

/// Width of the picture; text of 15 has 7.5 points if it is printed 85 mm wide.
const WIDTH: u32 = 480;
const FONT: i32 = 15;
/// Text of captions that do not fit otherwise.
const SMALLEST: i32 = 10;
/// Margin left of the strips and curves.
const LEFT: i32 = 70;
/// Images of a strip.
const TILES: usize = 7;
/// Width of an image and the gap to the next, in the picture's units.
const TILE: i32 = 54;
const GAP: i32 = 4;
/// Pixels of a tile: its size at 300 dots per inch.
const TILE_PX: u32 = 113;
/// Height of the caption of a strip, of the depths and widths below it, of a chart, and of the name of the axis of depth.
const CAPTION: i32 = 24;
const BELOW: i32 = 38;
const CHART: u32 = 190;
const DEPTHS: u32 = 18;
/// Pixels per unit of an image of pixels: 300 dots per inch at 85 mm.
const SCALE: f32 = 1004.0 / WIDTH as f32;
/// Most scenarios in a picture.
pub(crate) const MOST: usize = MOST_LINES;
/// Colors distinguishable in grayscale and with color blindness.
const COLORS: [RGBColor; MOST] = [
    RGBColor(0, 0, 0),
    RGBColor(0, 114, 178),
    RGBColor(213, 94, 0),
    RGBColor(0, 158, 115),
    RGBColor(204, 121, 167),
    RGBColor(230, 159, 0),
];
/// Distance between the markers of a curve, depths.
const EVERY: usize = 10;

type Drawn<T> = std::result::Result<T, Box<dyn std::error::Error>>;
type Area<'a> = DrawingArea<SVGBackend<'a>, Shift>;

/// What is drawn in one color.
struct Shown<'a> {
    name: String,
    curves: &'a SizeCurves,
    scan: &'a DepthScan,
    bounds: Option<&'a DepthBounds>,
}

/// The sizes of one scenario, or the mean sizes of several.
fn shown(all: &[Optics]) -> Vec<Shown<'_>> {
    let mut shown = Vec::new();
    for (k, Optics { preview, bounds, label, .. }) in all.iter().enumerate() {
        let is_alone = all.len() == 1;
        for (i, (curves, scan)) in preview.sizes.iter().zip(&preview.scans).enumerate() {
            let is_mean = i == preview.middle;
            let name =
                if is_alone { format!("{} um", curves.d_um) } else { format!("{}: {label}", letter(k)) };
            if is_alone || is_mean {
                shown.push(Shown { name, curves, scan, bounds: is_mean.then_some(bounds) });
            }
        }
    }
    shown.truncate(MOST);
    shown
}

/// The picture as SVG: the sizes of one scenario, or the mean sizes of several.
pub fn svg(all: &[Optics]) -> Result<String> {
    let shown = shown(all);
    let row = CAPTION + TILE + BELOW;
    let (top, title) = (shown.len() as i32 * row, "picture of the optics");
    let mut text = String::new();
    charts(all, &shown, &mut text, top).map_err(|e| Error::input(format!("{title}: {e}")))?;
    let end = text.rfind("</svg>").unwrap_or(text.len());
    let mut images = String::new();
    for (i, shown) in shown.iter().enumerate() {
        images += &strip(shown, i, i as i32 * row)?;
    }
    text.insert_str(end, &images);
    // Without a size of its own, a page decides how large it is.
    Ok(text)
}

/// A picture in SVG as PNG, of 300 dots per inch if it is printed 85 mm wide.
pub fn png(svg: &str) -> Result<Vec<u8>> {
    let failed = |e: String| Error::input(format!("picture: {e}"));
    let mut options = resvg::usvg::Options::default();
    options.fontdb_mut().load_system_fonts();
    if options.fontdb.is_empty() {
        return Err(failed(
            "no font is installed to draw text with: use a file that ends in .svg".to_owned(),
        ));
    }
    let sans = ["DejaVu Sans", "Liberation Sans", "Arial", "Helvetica"].map(str::to_owned);
    let has = |name: &String| {
        options.fontdb.faces().any(|face| face.families.iter().any(|family| family.0 == *name))
    };
    let first = options.fontdb.faces().next().and_then(|face| Some(face.families.first()?.0.clone()));
    let name = sans.into_iter().find(has).or(first);
    if let Some(name) = name {
        options.fontdb_mut().set_sans_serif_family(name);
    }
    let tree = resvg::usvg::Tree::from_str(svg, &options).map_err(|e| failed(e.to_string()))?;
    let size = tree.size().to_int_size().scale_by(SCALE).ok_or_else(|| failed("it is empty".to_owned()))?;
    let mut pixels = resvg::tiny_skia::Pixmap::new(size.width(), size.height())
        .ok_or_else(|| failed("it is too large".to_owned()))?;
    pixels.fill(resvg::tiny_skia::Color::WHITE);
    resvg::render(&tree, resvg::tiny_skia::Transform::from_scale(SCALE, SCALE), &mut pixels.as_mut());
    pixels.encode_png().map_err(|e| failed(e.to_string()))
}

/// Text of the picture beside what plotters draws.
fn label(x: i32, y: i32, style: &str, text: &str) -> String {
    let text = text.replace('&', "&amp;").replace('<', "&lt;");
    format!("<text x=\"{x}\" y=\"{y}\" font-family=\"sans-serif\" {style}>{text}</text>\n")
}

/// Images of one size, from the lowest depth to the highest.
fn strip(shown: &Shown<'_>, index: usize, top: i32) -> Result<String> {
    let RGBColor(r, g, b) = COLORS[index % MOST];
    let name = format!("{} {}", sign(index), shown.name);
    // A letter is about 0.6 times as wide as the font is high.
    let fits = |font: i32| (f64::from(WIDTH as i32 - 16) / (0.6 * f64::from(font))) as usize;
    let n = name.chars().count();
    let font = (SMALLEST..=FONT).rev().find(|font| fits(*font) >= n).unwrap_or(SMALLEST);
    let cut = n > fits(font);
    let name: String =
        if cut { name.chars().take(fits(font) - 1).chain(['\u{2026}']).collect() } else { name };
    let style = format!("font-size=\"{font}\" fill=\"#{r:02x}{g:02x}{b:02x}\"");
    let mut text = label(8, top + CAPTION - 7, &style, &name);
    text += &label(8, top + CAPTION + TILE + 14, &format!("font-size=\"{}\"", FONT - 2), "z, um");
    text += &label(8, top + CAPTION + TILE + 30, &format!("font-size=\"{}\"", FONT - 2), "side, px");
    let last = shown.scan.images.len() - 1;
    for i in 0..TILES {
        let at = i * last / (TILES - 1);
        let spot = &shown.scan.images[at];
        let mut png = std::io::Cursor::new(Vec::new());
        tile(spot)
            .write_to(&mut png, image::ImageFormat::Png)
            .map_err(|e| Error::input(format!("picture: {e}")))?;
        let data = base64::engine::general_purpose::STANDARD.encode(png.get_ref());
        let (x, y) = (LEFT + i as i32 * (TILE + GAP), top + CAPTION);
        text += &format!(
            "<image x=\"{x}\" y=\"{y}\" width=\"{TILE}\" height=\"{TILE}\" style=\"image-rendering:pixelated\" \
             href=\"data:image/png;base64,{data}\"/>\n"
        );
        let style = format!("text-anchor=\"middle\" font-size=\"{}\"", FONT - 2);
        let z_um = tick_label((10.0 * shown.scan.depths_um[at]).round() / 10.0, &(-1.0..1.0));
        text += &label(x + TILE / 2, y + TILE + 14, &style, &z_um);
        text += &label(x + TILE / 2, y + TILE + 30, &style, &format!("{}", 2 * spot.half_px + 1));
    }
    Ok(text)
}

/// A whole image: square roots of its light in gray.
fn tile(spot: &ScanImage) -> GrayImage {
    let side = 2 * spot.half_px as u32 + 1;
    let whole = GrayImage::from_fn(side, side, |x, y| {
        let share = spot.light[(y * side + x) as usize] / spot.peak.max(f64::MIN_POSITIVE);
        image::Luma([(255.0 * share.max(0.0).sqrt()).round() as u8])
    });
    // Small images keep their pixels, large ones are averaged.
    resize(&whole, TILE_PX, TILE_PX, if side < TILE_PX { FilterType::Nearest } else { FilterType::Triangle })
}

type Point = (f64, f64);

/// A curve with its markers, full or dashed; what is not finite is left out.
struct Curve {
    index: usize,
    points: Vec<Point>,
    is_full: bool,
}

struct Panel {
    name: &'static str,
    curves: Vec<Curve>,
    levels: Vec<Level>,
    /// The largest value of a logarithmic axis.
    most: Option<f64>,
}

/// A horizontal line with its name.
type Level = (&'static str, f64);

fn charts(all: &[Optics], shown: &[Shown<'_>], text: &mut String, top: i32) -> Drawn<()> {
    let preview = &all[0].preview;
    let z = all.iter().map(|optics| optics.preview.depth_range_um);
    let z = z.reduce(|(a, b), (low, high)| (a.min(low), b.max(high))).unwrap_or_default();
    let of_depths = |of: fn(&generator::preview::DepthFacts) -> f64, is_full: bool| {
        let curve = move |(index, shown): (usize, &Shown<'_>)| Curve {
            index,
            points: shown.curves.depths.iter().map(|depth| (depth.z_um, of(depth))).collect(),
            is_full,
        };
        shown.iter().enumerate().map(curve).collect::<Vec<_>>()
    };
    let of_bounds = |of: fn(&PositionBound) -> Option<f64>, keep: fn(&DepthBound) -> bool, is_full: bool| {
        let curve = move |(index, shown): (usize, &Shown<'_>)| {
            let depths = shown.bounds.map_or(&[][..], |bounds| &bounds.depths);
            let value = |depth: &DepthBound| of(&depth.bound).filter(|_| keep(depth)).unwrap_or(f64::NAN);
            Curve { index, points: depths.iter().map(|depth| (depth.z_um, value(depth))).collect(), is_full }
        };
        shown.iter().enumerate().map(curve).collect::<Vec<_>>()
    };
    let joined = |a: Vec<Curve>, b: Vec<Curve>| a.into_iter().chain(b).collect::<Vec<_>>();
    let peaks = of_depths(|depth| depth.peak_counts, true);
    let highest = peaks.iter().flat_map(|curve| &curve.points).map(|p| p.1).fold(0.0, f64::max);
    let same = |of: fn(&Optics) -> f64| all.iter().all(|optics| of(optics) == of(&all[0]));
    let mut levels: Vec<Level> = Vec::new();
    if same(|o| o.preview.background_noise_counts) && preview.background_noise_counts > 0.0 {
        levels.push(("noise of the background", preview.background_noise_counts));
    }
    let room = preview.saturation_counts - preview.background_counts;
    if same(|o| o.preview.saturation_counts - o.preview.background_counts) && room < 20.0 * highest {
        levels.push(("saturation", room));
    }
    let sizes = joined(of_depths(|depth| depth.width_px, true), of_depths(|depth| depth.height_px, false));
    let lateral = joined(
        of_bounds(|bound| bound.crlb_x_px, |_| true, true),
        of_bounds(|bound| bound.crlb_y_px, |_| true, false),
    );
    // Dashes show where full lines have gaps. A bound of more than the depth range says that z is unknown.
    let axial = joined(
        of_bounds(|bound| bound.crlb_z_um, |depth| depth.is_determined, true),
        of_bounds(|bound| bound.crlb_z_um, |_| true, false),
    );
    let panel = |name, curves, levels, most| Panel { name, curves, levels, most };
    let all = [
        panel("peak, counts", peaks, levels, Some(f64::INFINITY)),
        panel("width, height (dashed), px", sizes, Vec::new(), None),
        panel("bound of x, y (dashed), px", lateral, Vec::new(), Some(f64::INFINITY)),
        panel("bound of z, um", axial, Vec::new(), Some(z.1 - z.0)),
    ];
    let drawn: Vec<Panel> = all.into_iter().filter(|panel| panel.curves.iter().any(has_points)).collect();
    let size = (WIDTH, top as u32 + drawn.len() as u32 * CHART + DEPTHS);
    let root = SVGBackend::with_string(text, size).into_drawing_area();
    root.fill(&WHITE)?;
    let (_, mut rest) = root.split_vertically(top);
    for (i, panel) in drawn.iter().enumerate() {
        let is_last = i + 1 == drawn.len();
        let (upper, lower) = rest.split_vertically(CHART + if is_last { DEPTHS } else { 0 });
        chart(&upper, z, panel, is_last)?;
        rest = lower;
    }
    root.present()?;
    Ok(())
}

fn has_points(curve: &Curve) -> bool {
    curve.points.iter().any(|p| p.1.is_finite() && p.1 > 0.0)
}

/// Curves over depth; the last chart names the axis of depth.
fn chart(area: &Area<'_>, (z0, z1): Point, panel: &Panel, is_last: bool) -> Drawn<()> {
    let Panel { name, curves, levels, most } = panel;
    let along = if is_last { "z, um (away from the lens)" } else { "" };
    let values = curves.iter().flat_map(|curve| &curve.points).map(|p| p.1);
    let values = values.chain(levels.iter().map(|level| level.1)).filter(|v| v.is_finite() && *v > 0.0);
    let (low, high) = values.fold((f64::INFINITY, 0.0f64), |(low, high), v| (low.min(v), high.max(v)));
    let mut builder = ChartBuilder::on(area);
    builder
        .margin(6)
        .margin_right(20)
        .x_label_area_size(24 + if is_last { DEPTHS } else { 0 })
        .y_label_area_size(LEFT as u32 - 6);
    match most {
        None => {
            let mut chart = builder.build_cartesian_2d(z0..z1, 0.0..1.08 * high)?;
            mesh(&mut chart, [along, name])?;
            curves.iter().try_for_each(|curve| draw(&mut chart, curve, f64::INFINITY))
        }
        Some(most) => {
            let high = high.min(*most).max(1.01 * low);
            let (low, high) = (0.7 * low, 1.5 * high);
            let y = (low..high).log_scale().with_key_points(log_ticks(low, high));
            let mut chart = builder.build_cartesian_2d(z0..z1, y)?;
            mesh(&mut chart, [along, name])?;
            for (name, level) in levels {
                chart.draw_series(DashedLineSeries::new(
                    [(z0, *level), (z1, *level)],
                    2,
                    3,
                    BLACK.stroke_width(1),
                ))?;
                let style = ("sans-serif", FONT - 2)
                    .into_font()
                    .color(&BLACK)
                    .pos(Pos::new(HPos::Left, VPos::Bottom));
                chart.draw_series([Text::new(*name, (z0 + 0.01 * (z1 - z0), 1.05 * level), style)])?;
            }
            curves.iter().try_for_each(|curve| draw(&mut chart, curve, high))
        }
    }
}

type Chart<'a, 'b, Y> = ChartContext<'a, SVGBackend<'b>, Cartesian2d<RangedCoordf64, Y>>;

fn mesh<Y>(chart: &mut Chart<'_, '_, Y>, [x, y]: [&str; 2]) -> Drawn<()>
where
    Y: Ranged<ValueType = f64> + ValueFormatter<f64>,
{
    let (depths, values) = (chart.x_range(), chart.y_range());
    chart
        .configure_mesh()
        .light_line_style(TRANSPARENT)
        .x_labels(7)
        .y_labels(5)
        .x_desc(x)
        .y_desc(y)
        .x_label_formatter(&|z| tick_label(*z, &depths))
        .y_label_formatter(&|value| tick_label(*value, &values))
        .label_style(("sans-serif", FONT))
        .draw()?;
    Ok(())
}

fn draw<Y: Ranged<ValueType = f64>>(chart: &mut Chart<'_, '_, Y>, curve: &Curve, most: f64) -> Drawn<()> {
    let is_drawn = |p: &Point| p.1 > 0.0 && p.1 <= most;
    let color = COLORS[curve.index % MOST];
    for run in curve.points.chunk_by(|a, b| is_drawn(a) && is_drawn(b)).filter(|run| is_drawn(&run[0])) {
        let points = run.iter().copied();
        if curve.is_full {
            chart.draw_series(LineSeries::new(points, color.stroke_width(2)))?;
        } else {
            chart.draw_series(DashedLineSeries::new(points, 5, 4, color.stroke_width(1)))?;
        }
    }
    // Curves that coincide have their markers at different depths.
    let marked = curve.points.iter().skip(curve.index * EVERY / MOST).step_by(EVERY).filter(|p| is_drawn(p));
    markers(chart, curve.index, color, 4, marked.copied())?;
    Ok(())
}
