//! `cargo xtask expected`: expected images beside the mean of very many images of rays.

use std::fmt::Write as _;
use std::path::Path;
use std::process::ExitCode;

use anyhow::Context;
use microsig_core::emission::SpheroidLaw;
use microsig_core::render::expected::{DEFAULT_TOLERANCE, ExpectedRenderer};
use microsig_core::{Particle, Settings};
use plotters::prelude::*;
use suite::ensemble::Ensemble;
use suite::expected::Agreement;

use crate::picture::side_by_side;

/// The rays that an expected image is held against.
#[derive(Clone, Copy, PartialEq)]
enum Light {
    /// The renderer `rays`.
    Rays,
    /// Random points and directions: in setting 2 the model's spirals keep a pattern of rows in any mean.
    Random,
}

/// Depths of a setting, on a sensor of a single particle's image.
struct Series {
    name: &'static str,
    settings: Settings,
    light: Light,
    depths: std::ops::RangeInclusive<i32>,
    step_um: usize,
    d_um: f64,
}

fn series() -> [Series; 3] {
    let small = |settings: Settings| Settings { pixel_dim_x: 141, pixel_dim_y: 141, ..settings };
    let of = |name, settings, light, depths, step_um, d_um| Series {
        name,
        settings: small(settings),
        light,
        depths,
        step_um,
        d_um,
    };
    [
        of("setting 1", Settings::setting1(), Light::Rays, -80..=40, 5, 2.0),
        of("setting 1a", Settings::setting1a(), Light::Rays, -80..=40, 5, 2.0),
        of("setting 2", Settings::setting2(), Light::Random, -40..=5, 9, 1.0),
    ]
}

/// A particle and what was found.
struct Row {
    series: &'static str,
    place: &'static str,
    particle: Particle,
    agreement: Agreement,
    total_percent: f64,
    tables_error: f64,
}

/// A place between pixel centres that no depth shares with another: steps of the golden ratio.
fn within_a_pixel(k: usize) -> [f64; 2] {
    [0.618_033_988_749_894_9, 0.754_877_666_246_692_8].map(|step| (k as f64 * step).fract() - 0.5)
}

pub(crate) fn run(out: &Path, images: u32) -> anyhow::Result<ExitCode> {
    std::fs::create_dir_all(out).with_context(|| out.display().to_string())?;
    let (mut rows, mut strips) = (Vec::new(), Vec::new());
    for series in series() {
        let renderer = ExpectedRenderer::new(&series.settings, SpheroidLaw::Original, DEFAULT_TOLERANCE)?;
        for (k, z) in series.depths.clone().step_by(series.step_um).enumerate() {
            let [dx, dy] = within_a_pixel(k + 1);
            for (place, x, y) in [("middle", 71.0 + dx, 71.0 + dy), ("edge", 3.0 + dx, 135.0 + dy)] {
                let particle = Particle::sphere(x, y, f64::from(z), series.d_um);
                let seed = 1000 + rows.len() as u64;
                let rays = match series.light {
                    Light::Rays => {
                        let law = SpheroidLaw::Original;
                        Ensemble::draw(&series.settings, &[particle], law, seed, images)?
                    }
                    Light::Random => Ensemble::of_random_light(&series.settings, &particle, seed, images),
                };
                let ours = renderer.light(&[particle]).values;
                let agreement = Agreement::of(&ours, &rays, DEFAULT_TOLERANCE);
                let total: f64 = ours.iter().sum();
                if place == "middle" && k % 6 == 1 {
                    strips.push((format!("{}, z = {z} um", series.name), strip(&series, &ours, &rays.mean)));
                }
                println!("{} {place} z {z}: {agreement:?}", series.name);
                rows.push(Row {
                    series: series.name,
                    place,
                    particle,
                    agreement,
                    total_percent: 100.0 * (total / rays.of_mean.total - 1.0),
                    tables_error: renderer.tables().2,
                });
            }
        }
    }
    write(out, &rows, images)?;
    for (i, (_, picture)) in strips.iter().enumerate() {
        picture.save(out.join(format!("difference_{i}.png")))?;
    }
    plot(&out.join("agreement.svg"), &rows)?;
    let missed = rows.iter().filter(|row| !row.agreement.holds()).count();
    std::fs::write(out.join("README.md"), page(&rows, &strips, images, missed)?)?;
    println!("{} of {} images hold", rows.len() - missed, rows.len());
    Ok(if missed == 0 { ExitCode::SUCCESS } else { ExitCode::FAILURE })
}

/// The expected image, the mean of rays, and their difference: grey is none, white and black are 1 % of the peak.
fn strip(series: &Series, ours: &[f64], rays: &[f64]) -> image::GrayImage {
    let peak = ours.iter().copied().fold(0.0, f64::max);
    let picture = |level: &dyn Fn(usize) -> f64| {
        image::GrayImage::from_fn(series.settings.pixel_dim_x, series.settings.pixel_dim_y, |x, y| {
            let level = level((y * series.settings.pixel_dim_x + x) as usize);
            image::Luma([(level * 255.0).round().clamp(0.0, 255.0) as u8])
        })
    };
    let tiles = [
        picture(&|i| ours[i] / peak),
        picture(&|i| rays[i] / peak),
        picture(&|i| 0.5 + 50.0 * (ours[i] - rays[i]) / peak),
    ];
    side_by_side(&tiles)
}

fn write(out: &Path, rows: &[Row], images: u32) -> anyhow::Result<()> {
    let mut table = csv::Writer::from_path(out.join("agreement.csv"))?;
    let header = ["setting", "place", "x_px", "y_px", "z_um", "images", "total_percent", "used_total"];
    table.write_record(header.into_iter().chain(["used_rms", "used_worst", "holds"]))?;
    for row in rows {
        let (p, a) = (&row.particle, &row.agreement);
        table.write_record([
            row.series,
            row.place,
            &format!("{:.4}", p.x_px),
            &format!("{:.4}", p.y_px),
            &p.z_um.to_string(),
            &images.to_string(),
            &format!("{:+.4}", row.total_percent),
            &format!("{:.3}", a.total),
            &format!("{:.3}", a.rms),
            &format!("{:.3}", a.worst),
            &a.holds().to_string(),
        ])?;
    }
    Ok(table.flush()?)
}

fn page(
    rows: &[Row],
    strips: &[(String, image::GrayImage)],
    images: u32,
    missed: usize,
) -> anyhow::Result<String> {
    let mut text = format!(
        "# Expected images against the mean of {images} images of rays\n\n**{} of {} images hold.**\n\n\
         Made by `cargo xtask expected` with version {} of this workspace. One particle on 141 x 141 px, in the middle and over a \
         corner of the sensor, at places within a pixel that differ from depth to depth. Settings 1 and 1a: the mean of the renderer \
         `rays`; setting 2: as many rays from random points in random directions, because the regular spirals of the model leave a \
         pattern of rows there in any mean.\n\n\
         Used shares of what is allowed (`tests/src/expected.rs`): of the total 0.1 % and 4 standard errors; rms over lit pixels beyond \
         the statistical error one tolerance ({DEFAULT_TOLERANCE} of the peak); of a single pixel 4 tolerances and 5 standard errors. \
         `agreement.csv` has every image.\n\n\
         | setting | images that hold | total, worst, % | used: total | rms | single pixel | error that the tables know of |\n\
         |---|---|---|---|---|---|---|\n",
        rows.len() - missed,
        rows.len(),
        env!("CARGO_PKG_VERSION"),
    );
    for series in series() {
        let of_it: Vec<&Row> = rows.iter().filter(|row| row.series == series.name).collect();
        let worst = |value: &dyn Fn(&Row) -> f64| of_it.iter().map(|row| value(row)).fold(0.0, f64::max);
        writeln!(
            text,
            "| {} | {} of {} | {:.3} | {:.2} | {:.2} | {:.2} | {:.1e} |",
            series.name,
            of_it.iter().filter(|row| row.agreement.holds()).count(),
            of_it.len(),
            worst(&|row| row.total_percent.abs()),
            worst(&|row| row.agreement.total),
            worst(&|row| row.agreement.rms),
            worst(&|row| row.agreement.worst),
            worst(&|row| row.tables_error),
        )?;
    }
    text += "\n![Agreement over depth](agreement.svg)\n\n\
             Expected image, mean of rays, and their difference (grey: none; black and white: 1 % of the peak):\n";
    for (i, (name, _)) in strips.iter().enumerate() {
        writeln!(text, "\n{name}\n\n![{name}](difference_{i}.png)")?;
    }
    Ok(text)
}

/// The rms error over depth, in units of the tolerance.
fn plot(path: &Path, rows: &[Row]) -> anyhow::Result<()> {
    let top = rows.iter().map(|row| row.agreement.rms).fold(1.2, f64::max) * 1.1;
    let area = SVGBackend::new(path, (760, 420)).into_drawing_area();
    area.fill(&WHITE)?;
    let mut chart = ChartBuilder::on(&area)
        .margin(12)
        .x_label_area_size(50)
        .y_label_area_size(64)
        .build_cartesian_2d(-85.0..45.0, 0.0..top)?;
    chart
        .configure_mesh()
        .x_desc("depth z, um")
        .y_desc("rms error beyond statistics / tolerance")
        .axis_desc_style(("sans-serif", 16))
        .label_style(("sans-serif", 15))
        .light_line_style(WHITE)
        .bold_line_style(RGBColor(225, 225, 225))
        .draw()?;
    chart.draw_series(LineSeries::new([(-85.0, 1.0), (45.0, 1.0)], BLACK.mix(0.4)))?;
    let colours = [RGBColor(0, 90, 181), RGBColor(220, 80, 0), RGBColor(0, 130, 80)];
    for (series, colour) in series().iter().zip(colours) {
        let middle = rows.iter().filter(|row| row.series == series.name && row.place == "middle");
        let points = middle.map(|row| (row.particle.z_um, row.agreement.rms));
        chart
            .draw_series(LineSeries::new(points, colour.stroke_width(2)).point_size(3))?
            .label(series.name)
            .legend(move |(x, y)| PathElement::new([(x, y), (x + 24, y)], colour.stroke_width(2)));
    }
    chart
        .configure_series_labels()
        .position(SeriesLabelPosition::UpperRight)
        .label_font(("sans-serif", 14))
        .background_style(WHITE.mix(0.9))
        .border_style(RGBColor(180, 180, 180))
        .draw()?;
    area.present()?;
    Ok(())
}
