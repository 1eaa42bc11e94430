//! `cargo validate expected`: compares expected images with the mean of very many rays.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use anyhow::Context;
use clap::Args;
use microsig_core::emission::SpheroidLaw;
use microsig_core::render::Tables;
use microsig_core::render::expected::ExpectedRenderer;
use microsig_core::{Particle, Settings};
use plotters::prelude::*;
use suite::ensemble::Ensemble;
use suite::expected::Agreement;
use suite::picture::side_by_side;
use suite::template::fill;

use crate::curves;

/// Tolerance of the expected images, finer than the default.
const TOLERANCE: f64 = 1e-3;

/// Selection of comparisons.
#[derive(Args)]
pub(crate) struct Comparison {
    /// Output folder of agreement.csv, pictures and README.md.
    #[arg(long, default_value = "target/expected")]
    out: PathBuf,
    /// Number of images by the renderer `rays` for each mean.
    #[arg(long, default_value_t = 10_000)]
    images: u32,
    /// Number of random rays for each mean; about 10 s of CPU time for 30 million.
    #[arg(long, default_value_t = 30_000_000)]
    random_rays: u64,
    /// Settings to compare: 1, 1a, 2; default all.
    #[arg(long, value_delimiter = ',')]
    settings: Vec<String>,
    /// Depths, um; default those of each setting.
    #[arg(long, value_delimiter = ',', allow_hyphen_values = true)]
    depths: Vec<f64>,
}

/// The rays with which an expected image is compared.
#[derive(Clone, Copy, PartialEq)]
enum Light {
    /// Random points and directions.
    Random,
    /// The renderer `rays`. Its regular spirals leave a row pattern in any mean, which grows with defocus.
    Rays,
}

impl Light {
    fn name(self) -> &'static str {
        match self {
            Light::Random => "random",
            Light::Rays => "rays",
        }
    }
}

/// Depths at which the pattern of `rays` is below the tolerance, in settings 1 and 1a, um.
const WITHOUT_PATTERN: std::ops::RangeInclusive<f64> = -80.0..=20.0;

/// The depths of a setting, on a sensor for a single particle image.
struct Series {
    name: &'static str,
    settings: Settings,
    lights: &'static [Light],
    depths: Vec<f64>,
    d_um: f64,
}

fn all_series(comparison: &Comparison) -> Vec<Series> {
    let small = |settings: Settings| Settings { pixel_dim_x: 141, pixel_dim_y: 141, ..settings };
    let of = |name, settings, lights, depths: std::ops::RangeInclusive<i32>, d_um| Series {
        name,
        settings: small(settings),
        lights,
        depths: match &comparison.depths[..] {
            [] => depths.step_by(5).map(f64::from).collect(),
            chosen => chosen.to_vec(),
        },
        d_um,
    };
    let both = &[Light::Random, Light::Rays];
    let all = [
        of("setting 1", Settings::setting1(), both, -80..=40, 2.0),
        of("setting 1a", Settings::setting1a(), both, -80..=40, 2.0),
        of("setting 2", Settings::setting2(), &[Light::Random], -40..=5, 1.0),
    ];
    let chosen = |series: &Series| {
        let named = |name: &String| series.name.strip_prefix("setting ") == Some(name);
        comparison.settings.is_empty() || comparison.settings.iter().any(named)
    };
    all.into_iter().filter(chosen).collect()
}

/// A particle and its agreement.
struct Row {
    series: &'static str,
    light: Light,
    place: &'static str,
    particle: Particle,
    images: u32,
    agreement: Agreement,
    total_percent: f64,
    tables_error: f64,
}

impl Row {
    /// Whether it agrees or is exempt.
    fn is_well(&self) -> bool {
        let patterned = self.light == Light::Rays && !WITHOUT_PATTERN.contains(&self.particle.z_um);
        patterned || self.agreement.holds()
    }
}

/// A sub-pixel position that differs at every depth, from a low-discrepancy sequence.
fn within_a_pixel(k: usize) -> [f64; 2] {
    [0.618_033_988_749_894_9, 0.754_877_666_246_692_8].map(|step| (k as f64 * step).fract() - 0.5)
}

pub(crate) fn run(comparison: &Comparison) -> anyhow::Result<ExitCode> {
    let (out, all_series) = (&*comparison.out, all_series(comparison));
    std::fs::create_dir_all(out).with_context(|| out.display().to_string())?;
    let (mut rows, mut strips) = (Vec::new(), Vec::new());
    for series in &all_series {
        let renderer = ExpectedRenderer::new(&series.settings, SpheroidLaw::Original, TOLERANCE)?;
        for (k, &z_um) in series.depths.iter().enumerate() {
            let [dx, dy] = within_a_pixel(k + 1);
            for (place, x, y) in [("middle", 71.0 + dx, 71.0 + dy), ("edge", 3.0 + dx, 135.0 + dy)] {
                let particle = Particle::sphere(x, y, z_um, series.d_um);
                let ours = renderer.draw(&[particle]).values;
                for &light in series.lights {
                    let seed = 1000 + rows.len() as u64;
                    let mean = match light {
                        Light::Rays => {
                            let (law, images) = (SpheroidLaw::Original, comparison.images);
                            Ensemble::draw(&series.settings, &[particle], law, seed, images)?
                        }
                        Light::Random => {
                            let rays = comparison.random_rays;
                            Ensemble::of_random_light(&series.settings, &particle, seed, rays)
                        }
                    };
                    let row = Row {
                        series: series.name,
                        light,
                        place,
                        particle,
                        images: mean.images,
                        agreement: Agreement::of(&ours, &mean, TOLERANCE),
                        total_percent: 100.0 * (ours.iter().sum::<f64>() / mean.of_mean.total - 1.0),
                        tables_error: renderer.state().error,
                    };
                    println!("{} {} {place} z {z_um}: {:?}", row.series, light.name(), row.agreement);
                    rows.push(row);
                    if Some(&light) == series.lights.last() && place == "middle" && k % 6 == 1 {
                        let picture = strip(series, &ours, &mean.mean);
                        strips.push((format!("{}, z = {z_um} um, {}", series.name, light.name()), picture));
                    }
                }
            }
        }
    }
    write(out, &rows)?;
    for (i, (_, picture)) in strips.iter().enumerate() {
        picture.save(out.join(format!("difference_{i}.png")))?;
    }
    plot(&out.join("agreement.svg"), &rows)?;
    std::fs::write(out.join("README.md"), page(&rows, &strips, comparison)?)?;
    let missed = rows.iter().filter(|row| !row.is_well()).count();
    println!("{missed} of {} means exceed the limits", rows.len());
    Ok(if missed == 0 { ExitCode::SUCCESS } else { ExitCode::FAILURE })
}

/// The expected image, the mean of rays, and their difference: gray is zero, white and black are 1 % of the
/// peak.
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

fn write(out: &Path, rows: &[Row]) -> anyhow::Result<()> {
    let mut table = csv::Writer::from_path(out.join("agreement.csv"))?;
    let header =
        ["setting", "light", "place", "x_px", "y_px", "z_um", "images", "total_percent", "used_total"];
    table.write_record(header.into_iter().chain(["used_rms", "used_worst", "holds"]))?;
    for row in rows {
        let (p, a) = (&row.particle, &row.agreement);
        table.write_record([
            row.series,
            row.light.name(),
            row.place,
            &format!("{:.4}", p.x_px),
            &format!("{:.4}", p.y_px),
            &p.z_um.to_string(),
            &row.images.to_string(),
            &format!("{:+.4}", row.total_percent),
            &format!("{:.3}", a.total),
            &format!("{:.3}", a.rms),
            &format!("{:.3}", a.worst),
            &a.holds().to_string(),
        ])?;
    }
    Ok(table.flush()?)
}

/// The rows grouped by setting and light, in order of first occurrence.
fn groups(rows: &[Row]) -> Vec<Vec<&Row>> {
    let mut groups: Vec<Vec<&Row>> = Vec::new();
    for row in rows {
        let same = |group: &&mut Vec<&Row>| group[0].series == row.series && group[0].light == row.light;
        match groups.iter_mut().find(same) {
            Some(group) => group.push(row),
            None => groups.push(vec![row]),
        }
    }
    groups
}

fn page(
    rows: &[Row],
    strips: &[(String, image::GrayImage)],
    comparison: &Comparison,
) -> anyhow::Result<String> {
    let missed = rows.iter().filter(|row| !row.is_well()).count();
    let mut lines = String::new();
    for group in groups(rows) {
        let worst = |value: &dyn Fn(&Row) -> f64| group.iter().map(|row| value(row)).fold(0.0, f64::max);
        writeln!(
            lines,
            "| {} | {} | {} of {} | {:.3} | {:.2} | {:.2} | {:.2} | {:.1e} |",
            group[0].series,
            group[0].light.name(),
            group.iter().filter(|row| row.agreement.holds()).count(),
            group.len(),
            worst(&|row| row.total_percent.abs()),
            worst(&|row| row.agreement.total),
            worst(&|row| row.agreement.rms),
            worst(&|row| row.agreement.worst),
            worst(&|row| row.tables_error),
        )?;
    }
    let mut pictures = String::new();
    for (i, (name, _)) in strips.iter().enumerate() {
        writeln!(pictures, "\n{name}\n\n![{name}](difference_{i}.png)")?;
    }
    Ok(fill(
        include_str!("expected.md"),
        &[
            ("missed", &missed.to_string()),
            ("means", &rows.len().to_string()),
            ("version", env!("CARGO_PKG_VERSION")),
            ("random_rays", &format!("{:.0e}", comparison.random_rays as f64)),
            ("images", &comparison.images.to_string()),
            ("top", &WITHOUT_PATTERN.end().to_string()),
            ("tolerance", &TOLERANCE.to_string()),
            ("rows", &lines),
            ("pictures", pictures.trim_end()),
        ],
    ))
}

/// Plots the rms error against depth, in units of the tolerance.
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
    let color = |row: &Row| match (row.series, row.light) {
        ("setting 1", Light::Random) => RGBColor(0, 90, 181),
        ("setting 1", Light::Rays) => RGBColor(120, 180, 235),
        ("setting 1a", Light::Random) => RGBColor(220, 80, 0),
        ("setting 1a", Light::Rays) => RGBColor(245, 175, 120),
        _ => RGBColor(0, 130, 80),
    };
    for group in groups(rows) {
        let color = color(group[0]);
        let middle = group.iter().filter(|row| row.place == "middle");
        let points = middle.map(|row| (row.particle.z_um, row.agreement.rms));
        let name = format!("{}, {}", group[0].series, group[0].light.name());
        curves::draw(&mut chart, name, color, points)?;
    }
    curves::legend(&mut chart, SeriesLabelPosition::UpperRight)?;
    area.present()?;
    Ok(())
}
