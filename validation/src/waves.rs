//! `cargo validate waves`: wave optics in the limits where its images are known.

use std::fmt::Write as _;
use std::path::Path;
use std::process::ExitCode;

use anyhow::Context;
use image::GrayImage;
use microsig_core::emission::{SpheroidLaw, sphere_points};
use microsig_core::render::Render;
use microsig_core::render::expected::ExpectedRenderer;
use microsig_core::render::waves::{Lens, WaveOptics, WavesRenderer};
use microsig_core::{Particle, Settings};
use plotters::prelude::*;
use suite::picture::{magnified, side_by_side, square_roots};
use suite::template::fill;

use crate::curves;

/// Side of the compared part of an image, px.
const SIDE: usize = 41;
const WAVELENGTHS_UM: [f64; 3] = [0.52, 0.2, 0.1];
/// Differences below which a limit is reached, and the allowed factor on the differences of the earlier
/// study.
const REACHED: f64 = 0.03;
const FACTOR: f64 = 1.5;

/// A sphere, and the largest differences at each wavelength found in an earlier numerical study; NaN: none.
struct Case {
    name: &'static str,
    settings: Settings,
    d_um: f64,
    z_um: f64,
    earlier: [f64; 3],
}

fn cases() -> Vec<Case> {
    let of = |name, d_um, z_um, earlier| {
        let settings = if name == "1a" { Settings::setting1a() } else { Settings::setting1() };
        Case { name, settings, d_um, z_um, earlier }
    };
    vec![
        of("1", 2.0, 0.0, [0.157, f64::NAN, 0.025]),
        of("1", 2.0, -12.0, [0.053, f64::NAN, 0.038]),
        of("1", 2.0, -40.0, [0.375, f64::NAN, 0.278]),
        of("1", 5.0, 0.0, [0.130, f64::NAN, 0.017]),
        of("1a", 2.0, -20.0, [0.233, f64::NAN, 0.022]),
        of("1a", 2.0, 0.0, [0.138, f64::NAN, 0.024]),
    ]
}

/// Differences at a wavelength, relative to the peak, and the image.
struct Found {
    largest: f64,
    rms: f64,
    image: Vec<f64>,
}

/// A number predicted by theory.
struct Check {
    name: String,
    found: f64,
    theory: f64,
    allowed: f64,
}

impl Check {
    fn holds(&self) -> bool {
        (self.found - self.theory).abs() <= self.allowed
    }
}

pub(crate) fn run(out: &Path) -> anyhow::Result<ExitCode> {
    std::fs::create_dir_all(out).with_context(|| out.display().to_string())?;
    let (mut rows, mut pictures, mut series) = (String::new(), String::new(), Vec::new());
    let (mut checks, mut missed) = (0, 0);
    for (number, case) in cases().iter().enumerate() {
        let expected = ExpectedRenderer::new(&case.settings, SpheroidLaw::Original, 1e-3)?;
        let rays = expected.shares(case.z_um, case.d_um, &places(1.0));
        let found: Vec<Found> =
            WAVELENGTHS_UM.map(|um| difference(case, &rays, um)).into_iter().collect::<Result<_, _>>()?;
        write!(rows, "| {} | {} | {} |", case.name, case.d_um, case.z_um)?;
        for (found, earlier) in found.iter().zip(case.earlier) {
            let bounded = earlier < REACHED;
            checks += usize::from(bounded);
            missed += usize::from(bounded && found.largest > FACTOR * earlier);
            let known = if earlier.is_nan() { String::new() } else { format!(" ({earlier})") };
            write!(rows, " {:.4}, {:.4}{known} |", found.largest, found.rms)?;
        }
        writeln!(rows)?;
        println!(
            "{} d {} z {}: {:?}",
            case.name,
            case.d_um,
            case.z_um,
            found.iter().map(|f| f.largest).collect::<Vec<_>>()
        );
        let images = std::iter::once(&rays).chain(found.iter().rev().map(|found| &found.image));
        let file = format!("limit_{number}.png");
        strip(images).save(out.join(&file))?;
        let name = format!("setting {}, {} um, z = {} um", case.name, case.d_um, case.z_um);
        write!(pictures, "\n{name}\n\n![{name}]({file})\n")?;
        series.push((name, found.iter().map(|found| found.largest).collect::<Vec<_>>()));
    }
    plot(&out.join("limit.svg"), &series)?;
    let light: Vec<Check> = [totals()?, airy()?].into_iter().flatten().collect();
    checks += light.len();
    missed += light.iter().filter(|check| !check.holds()).count();
    let line = |check: &Check| {
        format!("| {} | {:.4} | {:.4} | {} |\n", check.name, check.found, check.theory, check.allowed)
    };
    let page = fill(
        include_str!("waves.md"),
        &[
            ("missed", &missed.to_string()),
            ("checks", &checks.to_string()),
            ("version", env!("CARGO_PKG_VERSION")),
            ("side", &SIDE.to_string()),
            ("head", &WAVELENGTHS_UM.map(|um| format!(" {um} um |")).concat()),
            ("rule", &"---|".repeat(WAVELENGTHS_UM.len())),
            ("limit", &rows),
            ("pictures", pictures.trim_end()),
            ("light", light.iter().map(line).collect::<String>().trim_end()),
        ],
    );
    std::fs::write(out.join("README.md"), page)?;
    println!("{missed} of {checks} checks fail");
    Ok(if missed == 0 { ExitCode::SUCCESS } else { ExitCode::FAILURE })
}

/// Pixels around a sphere, `step` px apart.
fn places(step: f64) -> Vec<[f64; 2]> {
    let at = |i: usize| (i as f64 - (SIDE / 2) as f64) * step;
    (0..SIDE * SIDE).map(|i| [at(i % SIDE), at(i / SIDE)]).collect()
}

fn difference(case: &Case, rays: &[f64], wavelength_um: f64) -> anyhow::Result<Found> {
    let renderer = WavesRenderer::new(&case.settings, &WaveOptics::new(wavelength_um), 1e-3)?;
    let image = renderer.share_at(case.z_um, case.d_um, &places(1.0));
    let peak = rays.iter().copied().fold(0.0, f64::max);
    let differences = || image.iter().zip(rays).map(|(a, b)| (a - b).abs() / peak);
    let squares: f64 = differences().map(|d| d * d).sum();
    Ok(Found { largest: differences().fold(0.0, f64::max), rms: (squares / rays.len() as f64).sqrt(), image })
}

/// Accepted light by waves over that of `expected` on a sensor that holds all of it.
fn totals() -> anyhow::Result<Vec<Check>> {
    let mut checks = Vec::new();
    for (name, settings) in [("1", Settings::setting1()), ("1a", Settings::setting1a())] {
        let settings = Settings { pixel_dim_x: 301, pixel_dim_y: 301, ..settings };
        let waves = WavesRenderer::new(&settings, &WaveOptics::new(0.52), 1e-3)?;
        let expected = ExpectedRenderer::new(&settings, SpheroidLaw::Original, 1e-3)?;
        for z_um in [-60.0, -12.0, 10.0] {
            let particle = Particle::sphere(151.0, 151.0, z_um, 2.0);
            let rays: f64 = expected.draw(&[particle]).values.iter().sum();
            checks.push(Check {
                name: format!("light accepted over that of `expected`, setting {name}, z = {z_um} um"),
                found: waves.accepted_light(&particle).unwrap_or(f64::NAN) / rays,
                theory: 1.0,
                allowed: 1e-3,
            });
        }
    }
    Ok(checks)
}

/// The image of a point in focus behind aplanatic objectives, on pixels a thirtieth of the Airy radius wide.
fn airy() -> anyhow::Result<Vec<Check>> {
    const PER_RADIUS: f64 = 30.0;
    let mut checks = Vec::new();
    for (magnification, numerical_aperture) in [(10.0, 0.25), (20.0, 0.45), (63.0, 0.75)] {
        let radius_um = 0.61 * 0.52 * magnification / numerical_aperture;
        let settings = Settings {
            magnification,
            numerical_aperture,
            pixel_size: radius_um / PER_RADIUS,
            pixel_dim_x: 201,
            pixel_dim_y: 201,
            ..Settings::setting1()
        };
        let optics = WaveOptics { lens: Lens::Aplanatic, ..WaveOptics::new(0.52) };
        let renderer = WavesRenderer::new(&settings, &optics, 1e-3)?;
        let side = 2 * PER_RADIUS as i32 + 1;
        let places: Vec<[f64; 2]> = (0..side * side)
            .map(|i| [f64::from(i % side - side / 2), f64::from(i / side - side / 2)])
            .collect();
        let shares = renderer.share_at(0.0, 0.0, &places);
        let within = places.iter().zip(&shares).filter(|([x, y], _)| x.hypot(*y) <= PER_RADIUS);
        let particle = Particle::sphere(101.0, 101.0, 0.0, 1.0);
        let emitted = sphere_points(&settings, 1.0) as f64 * (f64::from(settings.n_rays) + 1.0);
        let accepted = renderer.accepted_light(&particle).unwrap_or(f64::NAN) / emitted;
        let along: Vec<[f64; 2]> = (0..400).map(|i| [0.8 * PER_RADIUS + 0.03 * f64::from(i), 0.0]).collect();
        let dark = renderer.share_at(0.0, 0.0, &along);
        let least = (0..dark.len()).min_by(|a, b| dark[*a].total_cmp(&dark[*b])).unwrap_or(0);
        let name = format!("{magnification}x / {numerical_aperture}");
        let theory = Focus(numerical_aperture);
        checks.push(Check {
            name: format!("share within the Airy disc, {name}"),
            found: within.map(|(_, share)| share).sum::<f64>() / accepted,
            theory: theory.share_within(1.0),
            allowed: 0.005,
        });
        checks.push(Check {
            name: format!("radius of the first dark ring, {name}"),
            found: along[least][0] / PER_RADIUS,
            theory: theory.dark_ring(),
            allowed: 0.003,
        });
    }
    Ok(checks)
}

/// The focus of an aplanatic lens of this numerical aperture for an isotropic emitter: a pupil whose
/// amplitude grows as 1/sqrt(cos theta). Radii are in units of 0.61 lambda M / NA.
struct Focus(f64);

impl Focus {
    const STEPS: usize = 2000;

    /// The integral of `of` over the pupil's radius, from 0 to 1, by the midpoint rule.
    fn over_pupil(&self, of: impl Fn(f64, f64) -> f64) -> f64 {
        let step = 1.0 / Self::STEPS as f64;
        let radii = (0..Self::STEPS).map(|i| (i as f64 + 0.5) * step);
        radii.map(|t| step * of(t, (1.0 - (self.0 * t).powi(2)).powf(-0.25))).sum()
    }

    fn field(&self, radius: f64) -> f64 {
        let v = 2.0 * std::f64::consts::PI * 0.61 * radius;
        self.over_pupil(|t, amplitude| amplitude * libm::j0(v * t) * t)
    }

    /// Share of the light within a radius.
    fn share_within(&self, radius: f64) -> f64 {
        let step = radius / 200.0;
        let light = |i: i32| {
            let r = (f64::from(i) + 0.5) * step;
            self.field(r).powi(2) * r * step
        };
        let unit = 2.0 * std::f64::consts::PI * 0.61;
        (0..200).map(light).sum::<f64>() * unit * unit
            / self.over_pupil(|t, amplitude| amplitude * amplitude * t)
    }

    /// Radius of the first zero.
    fn dark_ring(&self) -> f64 {
        let (mut low, mut high) = (0.5, 1.2);
        for _ in 0..50 {
            let middle = 0.5 * (low + high);
            if self.field(middle) > 0.0 { low = middle } else { high = middle }
        }
        low
    }
}

/// Images side by side.
fn strip<'a>(images: impl Iterator<Item = &'a Vec<f64>>) -> GrayImage {
    const ZOOM: u32 = 3;
    let tiles: Vec<GrayImage> = images.map(|image| square_roots(image, SIDE as u32)).collect();
    magnified(&side_by_side(&tiles), ZOOM)
}

fn plot(path: &Path, series: &[(String, Vec<f64>)]) -> anyhow::Result<()> {
    let area = SVGBackend::new(path, (760, 440)).into_drawing_area();
    area.fill(&WHITE)?;
    let mut chart = ChartBuilder::on(&area)
        .margin(12)
        .x_label_area_size(50)
        .y_label_area_size(70)
        .build_cartesian_2d((0.08..0.7).log_scale(), (0.003..1.0).log_scale())?;
    chart
        .configure_mesh()
        .x_desc("wavelength, um")
        .y_desc("largest difference / peak")
        .x_label_formatter(&|um| format!("{um:.1}"))
        .axis_desc_style(("sans-serif", 16))
        .label_style(("sans-serif", 15))
        .light_line_style(WHITE)
        .bold_line_style(RGBColor(225, 225, 225))
        .draw()?;
    for (i, (name, values)) in series.iter().enumerate() {
        let (r, g, b) = Palette99::COLORS[i];
        let points = WAVELENGTHS_UM.into_iter().zip(values.iter().copied());
        curves::draw(&mut chart, name.clone(), RGBColor(r, g, b), points)?;
    }
    curves::legend(&mut chart, SeriesLabelPosition::LowerRight)?;
    area.present()?;
    Ok(())
}
