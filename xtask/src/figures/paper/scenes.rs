//! Fig. 4: random particles in a channel, without and with the cylinder (A, B), and spheroids (C).

use std::path::Path;

use image::GrayImage;
use microsig_core::emission::SpheroidLaw;
use microsig_core::render::RayRenderer;
use microsig_core::sensor::{Image, Sensor};
use microsig_core::stream::{Purpose, Streams};
use microsig_core::{Particle, Settings, Spheroid};

use crate::picture::{Figure, Label, crop, quantile, stacked, stretch};

pub(super) fn draw(out: &Path) -> anyhow::Result<()> {
    channel(
        out,
        "fig4a_channel",
        "Setting 1: 90 particles of 2 µm, z = -80 to 20 µm",
        &Settings::setting1(),
    )?;
    channel(
        out,
        "fig4b_channel_astigmatic",
        "Setting 1a: the same particles with a cylindrical lens",
        &Settings::setting1a(),
    )?;
    spheroids(out, "fig4c_spheroids_original", "Law of the original program", SpheroidLaw::Original)?;
    spheroids(out, "fig4c_spheroids_uniform", "Uniform law", SpheroidLaw::Uniform)
}

fn image(settings: &Settings, particles: &[Particle], law: SpheroidLaw) -> anyhow::Result<Image> {
    let streams = Streams::new(1);
    let light = RayRenderer::new(settings, law)?.light(particles, &streams, Purpose::Rays, 0);
    Ok(Sensor::new(settings).expose(&light, &streams, Purpose::BackgroundNoise, 0))
}

fn channel(out: &Path, name: &str, title: &str, settings: &Settings) -> anyhow::Result<()> {
    let mut places = Streams::new(4).stream(Purpose::Seeding, 0, 0);
    let particles: Vec<Particle> = (0..90)
        .map(|_| {
            let x = 0.5 + f64::from(settings.pixel_dim_x) * places.uniform();
            let y = 0.5 + f64::from(settings.pixel_dim_y) * places.uniform();
            Particle::sphere(x, y, -80.0 + 100.0 * places.uniform(), 2.0)
        })
        .collect();
    let image = image(settings, &particles, SpheroidLaw::Original)?;
    let white = quantile(&image, 0.992);
    let black = settings.background_mean - settings.background_noise;
    let picture = stretch(&image, black, white);
    let caption =
        format!("752 x 366 px of 0.645 µm; grey from {black:.0} to {white:.0} counts, cores are brighter");
    Figure {
        picture: &picture,
        title,
        scale: 1.0,
        left: 10.0,
        below: 34.0,
        labels: Vec::new(),
        caption: &caption,
    }
    .write(out, name)
}

/// Spheroids in rows of one shape and depth and columns of one orientation.
fn spheroids(out: &Path, name: &str, title: &str, law: SpheroidLaw) -> anyhow::Result<()> {
    const CELL: u32 = 80;
    const ROWS: u32 = 5;
    let diagonal = 0.5f64.sqrt();
    let columns = [
        ("along x", [1.0, 0.0, 0.0]),
        ("along y", [0.0, 1.0, 0.0]),
        ("diagonal", [diagonal, diagonal, 0.0]),
        ("x, right nearer", [diagonal, 0.0, -diagonal]),
        ("x, left nearer", [diagonal, 0.0, diagonal]),
        ("y, lower nearer", [0.0, diagonal, -diagonal]),
        ("along z", [0.0, 0.0, 1.0]),
    ];
    // Label, aspect ratio, equatorial diameter and depth.
    let rows: [_; ROWS as usize] = [
        ("rod, z = -60", 3.0, 6.0, -60.0),
        ("rod, z = -30", 3.0, 6.0, -30.0),
        ("rod, z = 0", 3.0, 6.0, 0.0),
        ("rod, z = 20", 3.0, 6.0, 20.0),
        ("disc, z = -30", 0.3, 12.0, -30.0),
    ];
    let settings = Settings {
        pixel_dim_x: CELL * columns.len() as u32,
        pixel_dim_y: CELL * ROWS,
        ..Settings::setting1()
    };
    let middle = |index: usize| (index as f64 + 0.5) * f64::from(CELL);
    let mut particles = Vec::new();
    let mut labels = Vec::new();
    for (row, (label, e_p, d_um, z_um)) in rows.into_iter().enumerate() {
        labels.push(Label { x: -44.0, y: middle(row), text: label.to_owned() });
        for (column, (_, axis)) in columns.iter().enumerate() {
            particles.push(Particle {
                spheroid: Some(Spheroid::from_axis(e_p, *axis)),
                ..Particle::sphere(0.5 + middle(column), 0.5 + middle(row), z_um, d_um)
            });
        }
    }
    let below = f64::from(settings.pixel_dim_y) + 10.0;
    labels.extend(columns.iter().enumerate().map(|(column, (text, _))| Label {
        x: middle(column),
        y: below,
        text: (*text).to_owned(),
    }));
    let image = image(&settings, &particles, law)?;
    let black = settings.background_mean - settings.background_noise;
    let bands: Vec<GrayImage> = (0..ROWS)
        .map(|row| {
            let band = crop(&image, row * CELL, CELL);
            let white = quantile(&band, 0.993);
            stretch(&band, black, white)
        })
        .collect();
    let picture = stacked(&bands);
    let title = format!("{title}: rods 18 x 6 µm and discs 3.6 x 12 µm, setting 1");
    Figure {
        picture: &picture,
        title: &title,
        scale: 1.5,
        left: 130.0,
        below: 64.0,
        labels,
        caption: "direction of the symmetry axis (\"nearer\": tilted by 45°, that end nearer the lens); z in µm; grey scaled row by row",
    }
    .write(out, name)
}
